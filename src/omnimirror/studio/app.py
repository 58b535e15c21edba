"""The studio's server: the page, cameras as tables, pictures and streams."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from fastapi import FastAPI, HTTPException, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import PlainTextResponse, Response
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp

from .. import __version__
from ..errors import OmnimirrorError
from ..frames import CameraLooks, Mount
from ..media import read_image
from .access import Guard, policy_of
from .bench.routes import add_bench
from .limits import LARGEST_PICTURE, Bounded, Busy, Turns
from .look.cameras import Cameras, Known
from .look.sources import Sources
from .look.streams import Streams
from .look.tables import camera_tables
from .messages import CameraModel, Health, Problem, SensorEntry, SensorFile, Start, StreamState
from .pages import PageFile, bench_text, page_text
from .uploads import (
    browser_picture,
    collected,
    eight_bits,
    encoded,
    safe_name,
)

BYTES: dict[str, Any] = {"application/octet-stream": {}}
PNG: dict[str, Any] = {"image/png": {}}
MOST_PIXELS = 4096 * 4096
"""Of a simulated picture, which takes 60 bytes a pixel."""


def _body(schema: dict[str, Any]) -> dict[str, Any]:
    content = {"application/octet-stream": {"schema": schema}}
    return {"requestBody": {"required": True, "content": content}}


FILE_BODY = _body({"type": "string", "format": "binary"})
# Refusals are JSON, whatever the answer would have been.
REFUSED: dict[str, Any] = {
    "model": Problem,
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
REFUSALS: dict[int | str, dict[str, Any]] = dict.fromkeys((400, 403, 404, 408, 413, 503, 507), REFUSED)


@dataclass
class Studio:
    """What a server shows."""

    sources: Sources = field(default_factory=Sources)
    given: Known | None = None
    hosts: tuple[str, ...] = ()
    token: str | None = None

    def __post_init__(self) -> None:
        self.cameras = Cameras(self.given)
        self.streams = Streams()
        self.simulated, self.unpacked, self.reported = Turns(), Turns(), Turns()


def create_app(studio: Studio | None = None) -> ASGIApp:
    """The server as an ASGI application, guarded; :func:`api` is what stands behind the guard."""
    studio = studio or Studio()
    taken = Bounded(api(studio), {"/api/pictures": LARGEST_PICTURE})
    return Guard(taken, studio.hosts, studio.token, policy_of(page_text()))


def api(studio: Studio) -> FastAPI:
    """The routes."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        studio.streams.close()

    app = FastAPI(
        title="omnimirror studio", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None,
        responses=REFUSALS,
    )  # fmt: skip

    @app.exception_handler(OmnimirrorError)
    async def refused(request: Request, error: OmnimirrorError) -> Response:
        return _problem(503 if isinstance(error, Busy) else 400, str(error))

    @app.exception_handler(OSError)
    async def no_room(request: Request, error: OSError) -> Response:
        reason = error.strerror or type(error).__name__
        return _problem(507, f"the server cannot write or read what this needs: {reason}")

    @app.exception_handler(MemoryError)
    async def no_memory(request: Request, error: MemoryError) -> Response:
        return _problem(507, "this needs more memory than the server has")

    @app.exception_handler(ClientDisconnect)
    async def gone(request: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=400)  # of half a file that nobody waits for any more

    _add_page(app, studio)
    _add_cameras(app, studio)
    _add_pictures(app, studio)
    _add_streams(app, studio)
    add_bench(app, FILE_BODY, studio.simulated, studio.reported)
    return app


def _problem(status: int, sentence: str) -> Response:
    return Response(Problem(detail=sentence).model_dump_json(), status, media_type="application/json")


def _add_page(app: FastAPI, studio: Studio) -> None:
    page_file, bench_file = PageFile(page_text(), "text/html"), PageFile(bench_text(), "text/javascript")

    @app.get("/", include_in_schema=False)
    async def page(request: Request) -> Response:
        return page_file.answer(request)

    @app.get("/bench.js", include_in_schema=False)
    async def bench(request: Request) -> Response:
        return bench_file.answer(request)

    @app.get("/health")
    async def health() -> Health:
        """Whether the server is there."""
        return Health(version=__version__)

    @app.get("/api/start")
    def start() -> Start:
        """What there is to look at, and through what."""
        given = studio.sources.given
        return Start(
            version=__version__,
            sources=tuple(shown.message for shown in studio.sources.list()),
            sensors=tuple(studio.cameras.entries()),
            source=given.id if given else None,
            sensor=studio.given.id if studio.given else None,
        )


def _add_cameras(app: FastAPI, studio: Studio) -> None:
    def known(id: str) -> Known:
        try:
            return studio.cameras.find(id)
        except KeyError:
            raise HTTPException(404, f"there is no camera {id!r}; it may have been forgotten: load it again") from None

    @app.get("/api/camera")
    def camera(
        id: str,
        camera_looks: CameraLooks | None = None,
        forward_azimuth_deg: Annotated[float | None, Query(ge=-360, le=360)] = None,
        image_flipped: bool | None = None,
        pitch_deg: Annotated[float | None, Query(ge=-90, le=90)] = None,
        roll_deg: Annotated[float | None, Query(ge=-180, le=180)] = None,
    ) -> CameraModel:
        """A camera, standing as its file says or as asked."""
        found = known(id)
        asked = {
            "camera_looks": camera_looks,
            "forward_azimuth_deg": forward_azimuth_deg,
            "image_flipped": image_flipped,
            "pitch_deg": pitch_deg,
            "roll_deg": roll_deg,
        }
        stands = found.entry.mount.model_dump() | {k: v for k, v in asked.items() if v is not None}
        return found.model(Mount(**stands))

    @app.get("/api/camera/tables", response_class=Response, responses={200: {"content": BYTES}})
    def tables(id: str, image_flipped: bool | None = None) -> Response:
        """Its tables as little-endian float32; how a camera stands does not change them."""
        found = known(id)
        flipped = found.entry.mount.image_flipped if image_flipped is None else image_flipped
        camera = found.standing(Mount(image_flipped=flipped))
        return Response(camera_tables(camera).values.astype("<f4").tobytes(), media_type="application/octet-stream")

    @app.post("/api/sensors", openapi_extra=FILE_BODY, status_code=201)
    async def load(
        request: Request, name: Annotated[str, Query(max_length=200)] = "sensor.toml", optics: str = "mirror"
    ) -> SensorEntry:
        """Take a calibration file: a sensor file, or OCamCalib's text."""
        data = await collected(request)
        return (await asyncio.to_thread(studio.cameras.add, safe_name(name), data, optics)).entry

    @app.post("/api/sensor-file", response_class=PlainTextResponse)
    def sensor_file(wanted: SensorFile) -> str:
        """The file of a sensor whose circle was moved to fit a picture."""
        known(wanted.id)
        return studio.cameras.file_of(wanted)

    @app.get("/api/room", response_class=Response, responses={200: {"content": PNG}})
    async def room(id: str) -> Response:
        """The picture that a camera takes of a room, simulated."""
        found = known(id)
        return Response(await studio.simulated.do(found, lambda: _room(found)), media_type="image/png")


def _add_pictures(app: FastAPI, studio: Studio) -> None:
    @app.get("/api/picture", response_class=Response, responses={200: {"content": PNG}})
    async def picture(id: str) -> Response:
        """A picture of the server's, as PNG of 8 bits."""
        try:
            shown = await asyncio.to_thread(studio.sources.find, id)
        except KeyError:
            raise HTTPException(404, f"there is no picture {id!r} here") from None
        if shown.kind != "picture":
            raise HTTPException(404, f"{shown.name} is no picture")
        path = Path(shown.place)
        png = await studio.unpacked.do(path, lambda: encoded(eight_bits(read_image(path)), ".png"))
        return Response(png, media_type="image/png")

    @app.post("/api/pictures", openapi_extra=FILE_BODY, response_class=Response, responses={200: {"content": PNG}})
    async def convert(request: Request, name: Annotated[str, Query(max_length=200)] = "picture") -> Response:
        """A picture that browsers do not read, as PNG of 8 bits."""
        data = await collected(request)
        png = await studio.unpacked.do(request, lambda: browser_picture(data, safe_name(name)))
        return Response(png, media_type="image/png")


def _add_streams(app: FastAPI, studio: Studio) -> None:
    @app.websocket("/api/stream")
    async def stream(socket: WebSocket, id: str) -> None:
        """Frames as JPEG, each when the page asks for one; what becomes of the stream as text."""
        await socket.accept()
        try:
            shown = studio.sources.find(id)
        except KeyError:
            ended = StreamState(state="ended", sentence=f"there is no stream {id!r} here")
            await socket.send_text(ended.model_dump_json())
            await socket.close()
            return
        async with studio.streams.watch(shown) as watched:
            await _serve(socket, watched)


async def _serve(socket: WebSocket, watched: Any) -> None:
    """To one page: a state when it changes, and after each of its requests the newest frame."""
    count, state = 0, None
    asked = asyncio.create_task(socket.receive())
    wants = False
    try:
        while True:
            news = asyncio.create_task(watched.after(count if wants else watched.count, state))
            done, _ = await asyncio.wait({asked, news}, return_when=asyncio.FIRST_COMPLETED)
            if asked in done:
                if asked.result()["type"] == "websocket.disconnect":
                    news.cancel()
                    return
                wants, asked = True, asyncio.create_task(socket.receive())
            if news not in done:
                news.cancel()
                continue
            number, jpeg, now = news.result()
            if now != state:
                state = now
                await socket.send_text(now.model_dump_json())
            if wants and jpeg is not None:
                count, wants = number, False
                await socket.send_bytes(jpeg)
    except (WebSocketDisconnect, RuntimeError, OSError):
        return
    finally:
        asked.cancel()


@lru_cache(maxsize=8)
def _room(known: Known) -> bytes:
    from ..simulate import Room, take_picture
    from ..simulate.rendering.picture import SHOWN_SAMPLES

    width, height = known.camera.image_size
    if width * height > MOST_PIXELS:
        raise OmnimirrorError(
            f"the picture of {known.name}, {width} x {height} px, is too large to be simulated here; valid are "
            f"{MOST_PIXELS // 10**6} million pixels, and omnimirror simulate takes more"
        )
    return encoded(take_picture(known.camera, Room(), samples=SHOWN_SAMPLES), ".png")
