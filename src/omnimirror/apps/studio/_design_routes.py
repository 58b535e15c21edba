"""HTTP and WebSocket routes of the Design tab."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Literal

from fastapi import FastAPI, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import PlainTextResponse, Response

from ...base.errors import OmnimirrorError
from ...base.escaping import http_attachment
from ...interop.http_server.request_bodies import InvalidMessage, close_invalid, receive_message
from ...optics.sensor_files import bundled_sensors, load_sensor
from ._design_files import design_file, opened, requirement_file, taken
from ._design_requirements import slider_violations
from ._design_sensors import changed, design_start, sensor_from_tables, tables_from_sensor
from ._http_messages import BYTES, FILE_BODY, FileName
from ._uploads import safe_name, uploaded_file
from ._workers import Workers, serve_socket, serve_task
from .design_messages import (
    AsBuiltRequest,
    DesignChange,
    DesignRequest,
    DesignSensor,
    DesignStart,
    ErrorSourceList,
    ErrorSourcesRequest,
    ExportStart,
    ExportStatus,
    ExportTask,
    FileRequest,
    ImportedFile,
    RenderRequest,
    RequirementFileRequest,
    SearchTask,
    SliderRequest,
    SliderViolations,
    TaskStatus,
    YieldRequest,
    YieldResult,
)

if TYPE_CHECKING:
    from ._server_state import Studio

MAX_SEARCHES = MAX_EXPORTS = 2
"""Maximum numbers of simultaneous searches and exports."""


def add_design_routes(app: FastAPI, studio: Studio) -> None:
    """Register the routes of the Design tab."""
    _add_questions(app, studio)
    _add_files(app, studio)
    _add_tolerances(app, studio)
    _add_sockets(
        app,
        Workers("omnimirror.apps.studio._search_process", MAX_SEARCHES, "searches"),
        Workers("omnimirror.apps.studio._export_process", MAX_EXPORTS, "exports"),
    )


def _add_questions(app: FastAPI, studio: Studio) -> None:
    @app.get("/api/design")
    def start() -> DesignStart:
        """Return the initial data of the Design tab: all parts with their parameters."""
        return design_start()

    @app.get("/api/design/sensor")
    def bundled(name: str) -> DesignSensor:
        """Return a bundled sensor."""
        if name not in (names := bundled_sensors()):
            raise OmnimirrorError(
                f"name must be a bundled sensor; got {name!r}; use {', '.join(names)}"
            )
        return tables_from_sensor(load_sensor(name))

    @app.post("/api/design/slides")
    async def slides(requested: SliderRequest) -> SliderViolations:
        """Return the relative violation of the requirements along all sliders."""
        return await studio.slider_violations.run(
            requested.model_dump_json(), lambda: slider_violations(requested)
        )

    @app.post("/api/design/change")
    def change(requested: DesignChange) -> DesignSensor:
        """Return the sensor with another kind of mirror or lens, or at its best focus."""
        return tables_from_sensor(changed(requested))

    @app.post("/api/design/open", openapi_extra=FILE_BODY)
    async def open_file(request: Request, name: FileName = "sensor.toml") -> ImportedFile:
        """Read a sensor file or a requirement file."""
        data = await uploaded_file(request)
        return await asyncio.to_thread(opened, safe_name(name), data)


def _add_files(app: FastAPI, studio: Studio) -> None:
    @app.post("/api/design/file", response_class=Response, responses={200: BYTES})
    def file(requested: FileRequest) -> Response:
        """Return a small file of a design: sensor file or evaluation."""
        content = design_file(requested)
        headers = {"content-disposition": http_attachment(content.name)}
        return Response(content.data, media_type=content.kind, headers=headers)

    @app.get("/api/design/export")
    def export_start() -> ExportStart:
        """Return the formats of the export, and the entries of the workshop data."""
        from ._export_form import export_start

        return export_start()

    @app.post("/api/design/requirements", response_class=PlainTextResponse)
    def requirements(requested: RequirementFileRequest) -> str:
        """Return the text of a requirement file."""
        return requirement_file(requested.requirements, sensor_from_tables(requested.tables))

    @app.post("/api/design/image", response_class=Response, responses={200: BYTES})
    async def rendered_image(message: RenderRequest) -> Response:
        """Return the rendered image of a room and its panorama: two JPEG files after a header with
        their lengths."""
        images = await studio.simulations.run(message.model_dump_json(), lambda: taken(message))
        return Response(images, media_type="application/octet-stream")


def _add_tolerances(app: FastAPI, studio: Studio) -> None:
    @app.post("/api/design/errors")
    def errors(requested: ErrorSourcesRequest) -> ErrorSourceList:
        """Return the error sources of a sensor."""
        from ._design_tolerances import (
            list_error_sources,
        )  # deferred import: requires the tolerancing modules

        return list_error_sources(requested)

    @app.post("/api/design/built", response_class=Response, responses={200: BYTES})
    async def as_built(requested: AsBuiltRequest) -> Response:
        """Return the image motion of a sensor with errors, as numbers after a header."""
        from ._design_tolerances import built

        content = await studio.built.run(requested.model_dump_json(), lambda: built(requested))
        return Response(content, media_type="application/octet-stream")

    @app.post("/api/design/yield")
    async def yields(requested: YieldRequest) -> YieldResult:
        """Return the predicted yield and the effect of each error source."""
        from ._design_tolerances import predict_yield

        return await studio.toleranced.run(
            requested.model_dump_json(), lambda: predict_yield(requested)
        )


def _add_sockets(app: FastAPI, searches: Workers, exports: Workers) -> None:
    @app.websocket("/api/design/ask")
    async def ask(socket: WebSocket) -> None:
        """Answer evaluation requests; among pending requests of one slot, only the newest is
        evaluated."""
        await socket.accept()
        await _answer_newest(socket)

    @app.websocket("/api/design/work")
    async def work(socket: WebSocket) -> None:
        """Run one task and send its progress; closing the socket cancels it."""

        async def receive(socket: WebSocket) -> list[SearchTask]:
            return [await receive_message(socket, SearchTask)]

        await serve_socket(
            socket, lambda socket: serve_task(socket, searches, receive, _search_status)
        )

    @app.websocket("/api/design/export/run")
    async def export(socket: WebSocket) -> None:
        """Export files, send the progress and then the bytes; closing the socket cancels it."""

        async def receive(socket: WebSocket) -> list[ExportTask]:
            return [await receive_message(socket, ExportTask)]

        await serve_socket(
            socket, lambda socket: serve_task(socket, exports, receive, _export_status)
        )


async def _answer_newest(socket: WebSocket) -> None:
    waiting: dict[int, DesignRequest] = {}
    news = asyncio.Event()
    listening = asyncio.create_task(_listen(socket, waiting, news))
    try:
        while not (listening.done() and not waiting):
            await news.wait()
            news.clear()
            while waiting:
                newest = waiting.pop(min(waiting))  # slot 0 is the current design
                await socket.send_bytes(await asyncio.to_thread(_answered, newest))
    except (WebSocketDisconnect, RuntimeError, OSError):
        return
    finally:
        listening.cancel()


def _answered(message: DesignRequest) -> bytes:
    from ._design_evaluation import answer  # deferred import: requires the analysis modules

    return answer(message)


async def _listen(
    socket: WebSocket, waiting: dict[int, DesignRequest], news: asyncio.Event
) -> None:
    """Queue incoming requests; a newer request replaces an older one of the same slot."""
    try:
        while True:
            requested = await receive_message(socket, DesignRequest)
            waiting[requested.slot] = requested
            news.set()
    except InvalidMessage as e:
        await close_invalid(socket, e)
    except (WebSocketDisconnect, RuntimeError):
        pass
    finally:
        news.set()


def _search_status(state: Literal["waiting", "failed"], message: str) -> TaskStatus:
    return TaskStatus(
        state=state, message=message, fraction=None, value=None, sensor=None, relaxations=()
    )


def _export_status(state: Literal["waiting", "failed"], message: str) -> ExportStatus:
    return ExportStatus(
        state=state, message=message, fraction=None, entry=None, name=None, remarks=()
    )
