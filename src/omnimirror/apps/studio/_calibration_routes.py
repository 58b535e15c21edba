"""HTTP and WebSocket routes of calibration: detection, joint analysis, calibration, dewarped
boards."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import FastAPI, Query, Request, WebSocket
from fastapi.responses import Response
from pydantic import BaseModel

from ...interop.http_server.request_bodies import receive_message
from ._calibration_boards import together
from ._http_messages import BYTES, FILE_BODY, unframed
from ._uploads import uploaded_file
from ._workers import BoardDetectorPool, Workers, serve_socket, serve_task
from .calibration_messages import (
    STOP,
    BoardDetection,
    BoardDetectionRequest,
    BoardViewRequest,
    CalibrationOptions,
    CalibrationRequest,
    CalibrationStatus,
    MultiImageRequest,
    MultiImageSummary,
)

if TYPE_CHECKING:
    from ._server_state import Studio

MAX_CALIBRATIONS = 2
"""Maximum number of simultaneous calibrations."""


def add_calibrate(app: FastAPI, studio: Studio) -> None:
    """Register the routes of calibration."""
    _add_questions(app, studio.board_detectors)
    _add_straight(app, studio)
    _add_socket(
        app,
        Workers("omnimirror.apps.studio._calibration_process", MAX_CALIBRATIONS, "calibrations"),
    )


def _add_questions(app: FastAPI, board_detectors: BoardDetectorPool) -> None:
    @app.get("/api/calibrate")
    def start() -> CalibrationOptions:
        """Return the available options."""
        from ...calibration.estimation.model_sequence import KINDS
        from ...calibration.sensor_model import SensorModel
        from ...calibration.targets.boards import families

        return CalibrationOptions(
            models=tuple(KINDS), mirrors_only=(SensorModel.KIND,), families=tuple(families())
        )

    @app.post("/api/calibrate/look", openapi_extra=FILE_BODY)
    async def look(
        request: Request, message: Annotated[BoardDetectionRequest, Query()]
    ) -> BoardDetection:
        """Return the corners of a board in an image, or the reason for the failed detection."""
        data = await uploaded_file(request)
        return await board_detectors.look(message, data, request)

    @app.post("/api/calibrate/together")
    def images_together(message: MultiImageRequest) -> MultiImageSummary:
        """Return the consistency and field coverage of images, and the recommended next image."""
        return together(message)


def _add_straight(app: FastAPI, studio: Studio) -> None:
    @app.post(
        "/api/calibrate/straight",
        openapi_extra=FILE_BODY,
        response_class=Response,
        responses={200: BYTES},
    )
    async def straight(request: Request) -> Response:
        """Return a dewarped board as JPEG; the request header precedes the image."""
        from ._calibration_boards import render_board_view  # deferred import: requires the dewarper

        message, data = unframed(await uploaded_file(request), BoardViewRequest)
        board_view = await studio.conversions.run(request, lambda: render_board_view(message, data))
        return Response(board_view, media_type="image/jpeg")


def _add_socket(app: FastAPI, workers: Workers) -> None:
    @app.websocket("/api/calibrate/work")
    async def work(socket: WebSocket) -> None:
        """Run one calibration: request, detections, then progress messages; closing the socket
        cancels it."""
        await serve_socket(
            socket, lambda socket: serve_task(socket, workers, _task, _status, (STOP,))
        )


async def _task(socket: WebSocket) -> list[BaseModel]:
    """Receive the request and its detections."""
    message = await receive_message(socket, CalibrationRequest)
    return [
        message,
        *[await receive_message(socket, BoardDetection) for _ in range(message.images)],
    ]


def _status(state: Literal["waiting", "failed"], message: str) -> CalibrationStatus:
    return CalibrationStatus(state=state, message=message)
