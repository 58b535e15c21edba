"""HTTP and WebSocket routes of the Look tab: cameras as tables, images, streams."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from fastapi import FastAPI, HTTPException, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse, PlainTextResponse, Response, StreamingResponse

from ... import __version__
from ...base.errors import OmnimirrorError
from ...cameras.camera import Mount
from ...cameras.models import MirrorBall
from ...io.image_metadata import UPRIGHT, applied
from ...io.images import read_image_and_metadata
from ...optics.sensor import Sensor
from ._camera_tables import camera_tables
from ._http_messages import (
    BYTES,
    FILE_BODY,
    PNG,
    STATUS_LINES,
    STATUS_MEDIA_TYPE,
    FileName,
    unframed,
)
from ._image_export import camera_of, export_image
from ._look_cameras import Cameras, NamedCamera
from ._outline_process import OutlineRequest
from ._restoration_process import RestorationTask
from ._server_state import Stream
from ._uploads import (
    browser_image,
    display_levels,
    eight_bits,
    encoded,
    image_in,
    png_of,
    safe_name,
    uploaded_file,
)
from .look_messages import (
    CameraInfo,
    CameraRequest,
    EstimatedTilt,
    ImageExportRequest,
    LevelRequest,
    MeasurementResult,
    MeasureRequest,
    PageStart,
    RestoreRequest,
    SensorEntry,
    SensorFileRequest,
    StreamState,
)

if TYPE_CHECKING:
    from ._server_state import Studio


# -- Images ----------------------------------------------------------------------------------------

MAX_PIXELS = 4096 * 4096
"""Maximum size of a rendered image; rendering takes 60 bytes per pixel."""


RADIANCE_SUFFIXES = (".hdr", ".exr")


def read_as_png(path: Path, stored_orientation: bool, on_note: Callable[[str], None]) -> bytes:
    """Return an image of the server, and report an orientation in its file."""
    image, metadata = read_image_and_metadata(path, stored_orientation=stored_orientation)
    if image.dtype == np.float32 and path.suffix.lower() in RADIANCE_SUFFIXES:
        image = display_levels(image)
    if metadata.orientation != UPRIGHT:
        on_note(f"{path}: {applied(metadata.orientation, stored_orientation)}")
    return png_of(image, metadata)


def estimate_tilt(
    camera: Sensor | MirrorBall, message: LevelRequest, data: bytes
) -> EstimatedTilt | None:
    """Estimate the camera tilt of an uploaded image; None if it has too few vertical edges."""
    from ...calibration.levelling import level_from_image

    pixels = eight_bits(image_in(data, safe_name(message.name)))
    level = level_from_image(pixels, camera, camera.mount, message.centre_px, message.rim_radius_px)
    if level is None:
        return None
    return EstimatedTilt(
        pitch_deg=level.pitch_deg,
        roll_deg=level.roll_deg,
        sigma_deg=level.sigma_deg,
        vertical_edges=level.upright,
        is_reliable=level.is_reliable,
    )


def measure_points(cameras: Cameras, message: MeasureRequest) -> MeasurementResult:
    """Measure the angle and distance of two pixels.

    Raises
    ------
    OmnimirrorError
        If a pixel is outside the field of view, or its ray does not reach the plane.
    """
    from ...calibration.measurement import measure

    camera = camera_of(cameras, message)
    result = measure(
        replace(camera, uncertainty=None) if message.is_fitted else camera,
        message.pixels,
        height_mm=message.height_mm,
        wall_mm=message.wall_mm,
        wall_pan_deg=message.wall_pan_deg,
        plane_sigma_mm=message.plane_sigma_mm,
        plane_sigma_deg=message.plane_sigma_deg,
        pixel_sigma_px=message.pixel_sigma_px,
    )
    return MeasurementResult(
        angle_deg=result.angle_deg,
        angle_sigma_deg=result.angle_sigma_deg,
        distance_mm=result.distance_mm,
        distance_sigma_mm=result.distance_sigma_mm,
    )


@lru_cache(maxsize=8)
def render_room(named_camera: NamedCamera) -> bytes:
    """Render the image of a room by a camera.

    Raises
    ------
    OmnimirrorError
        If the image is too large.
    """
    from ...simulation.rendering import SHOWN_SAMPLES, render_image
    from ...simulation.scenes.room import Room

    width, height = named_camera.camera.image_size
    if width * height > MAX_PIXELS:
        raise OmnimirrorError(
            f"the image of {named_camera.name} must have at most {MAX_PIXELS // 10**6} million "
            f"pixels; got {width} x {height} px; omnimirror simulate supports larger "
            "images"
        )
    return encoded(render_image(named_camera.camera, Room(), samples=SHOWN_SAMPLES), ".png")


# -- Routes ----------------------------------------------------------------------------------------

SIZE = "omnimirror-size"
"""Response header with the size of the original image, px."""
NOTE = "omnimirror-note"
"""Response header with a description of the file."""


def add_look(app: FastAPI, studio: Studio) -> None:
    """Register the routes of the Look tab."""
    _add_start(app, studio)
    _add_cameras(app, studio.cameras)
    _add_files(app, studio.cameras)
    _add_measurement(app, studio.cameras)
    _add_images(app, studio)
    _add_streams(app, studio)


def _add_start(app: FastAPI, studio: Studio) -> None:
    @app.get("/api/start")
    def start() -> PageStart:
        """Return the available sources and cameras."""
        first = next(iter(studio.sources.given), None)
        return PageStart(
            version=__version__,
            sources=tuple(source.message for source in studio.sources.list()),
            sensors=tuple(studio.cameras.entries()),
            source=first.id if first else None,
            sensor=studio.given.id if studio.given else None,
        )


def _add_cameras(app: FastAPI, cameras: Cameras) -> None:
    @app.get("/api/camera")
    def camera(message: Annotated[CameraRequest, Query()]) -> CameraInfo:
        """Return a camera with its own or the requested mount."""
        named_camera = _known(cameras, message.id)
        mount = named_camera.entry.mount.model_dump() | message.model_dump(
            exclude={"id"}, exclude_none=True
        )
        return named_camera.model(Mount(**mount))

    @app.get("/api/camera/tables", response_class=Response, responses={200: BYTES})
    def tables(id: str, image_flipped: bool | None = None) -> Response:
        """Return the tables of a camera as little-endian float32; they do not depend on the mount."""
        named_camera = _known(cameras, id)
        flipped = named_camera.entry.mount.image_flipped if image_flipped is None else image_flipped
        standing = named_camera.standing(Mount(image_flipped=flipped))
        return Response(
            camera_tables(standing).values.astype("<f4").tobytes(),
            media_type="application/octet-stream",
        )


def _add_files(app: FastAPI, cameras: Cameras) -> None:
    @app.post("/api/sensors", openapi_extra=FILE_BODY, status_code=201)
    async def load_sensor(
        request: Request, name: FileName = "sensor.toml", optics: str = "mirror"
    ) -> SensorEntry:
        """Read a calibration file: a sensor file, a camera file, or OCamCalib text."""
        data = await uploaded_file(request)
        return (await asyncio.to_thread(cameras.add, safe_name(name), data, optics)).entry

    @app.post("/api/sensor-file", response_class=PlainTextResponse)
    def sensor_file(requested: SensorFileRequest) -> str:
        """Return the file of a sensor with its image circle fitted to an image."""
        _known(cameras, requested.id)
        return cameras.file_of(requested)


def _add_measurement(app: FastAPI, cameras: Cameras) -> None:
    @app.post("/api/measure")
    def measurement(message: MeasureRequest) -> MeasurementResult:
        """Return the angle between two pixels, and their distance on a floor or wall."""
        _known(cameras, message.id)
        return measure_points(cameras, message)


def _add_images(app: FastAPI, studio: Studio) -> None:
    is_stored = studio.stored_orientation

    @app.get("/api/room", response_class=Response, responses={200: PNG})
    async def room(id: str) -> Response:
        """Return the rendered image of a room by a camera."""
        named_camera = _known(studio.cameras, id)
        return _png(await studio.simulations.run(named_camera, lambda: render_room(named_camera)))

    @app.get("/api/image", response_class=Response, responses={200: PNG})
    async def source_image(id: str) -> Response:
        """Return an image of the server as 8-bit PNG."""
        path = await asyncio.to_thread(_image_path, studio, id)
        return _png(
            await studio.conversions.run(
                path, lambda: read_as_png(path, studio.stored_orientation, studio.on_note)
            )
        )

    @app.get("/api/image/file", response_class=FileResponse, responses={200: BYTES})
    async def source_file(id: str) -> FileResponse:
        """Return the original file of an image of the server."""
        path = await asyncio.to_thread(_image_path, studio, id)
        return FileResponse(path, media_type="application/octet-stream")

    @app.post(
        "/api/convert", openapi_extra=FILE_BODY, response_class=Response, responses={200: PNG}
    )
    async def convert(
        request: Request,
        name: FileName = "image",
        max_side: Annotated[int | None, Query(ge=64)] = None,
    ) -> Response:
        """Convert an image that browsers cannot read to an 8-bit PNG.

        Images with a longer side above ``max_side`` px are reduced; a header contains the original
        size.
        """
        data = await uploaded_file(request)
        png, (width, height) = await studio.conversions.run(
            request,
            lambda: browser_image(
                data, safe_name(name), stored_orientation=is_stored, max_side_px=max_side
            ),
        )
        return Response(png, media_type="image/png", headers={SIZE: f"{width}x{height}"})

    @app.post(
        "/api/outline",
        openapi_extra=FILE_BODY,
        response_class=StreamingResponse,
        responses={200: STATUS_LINES},
    )
    async def outline(request: Request, name: FileName = "image") -> StreamingResponse:
        """Detect the mirror outline in an image: progress messages, one per line.

        Closing the connection cancels the search.
        """
        data = await uploaded_file(request)
        requested = OutlineRequest(name=safe_name(name), stored_orientation=is_stored)
        lines = studio.outline_searches.run(requested, data)
        return StreamingResponse(lines, media_type=STATUS_MEDIA_TYPE)

    @app.post(
        "/api/export", openapi_extra=FILE_BODY, response_class=Response, responses={200: BYTES}
    )
    async def export(request: Request) -> Response:
        """Return a view or the light probe of an image at its full resolution and bit depth.

        The request header precedes the original image; a response header describes the file.
        """
        message, image = unframed(await uploaded_file(request), ImageExportRequest)
        _known(studio.cameras, message.id)
        camera = camera_of(studio.cameras, message)
        exported = await studio.conversions.run(
            request, lambda: export_image(camera, message, image, stored_orientation=is_stored)
        )
        headers = {NOTE: exported.note}
        return Response(exported.data, media_type="application/octet-stream", headers=headers)

    @app.post("/api/level", openapi_extra=FILE_BODY)
    async def level(request: Request) -> EstimatedTilt | None:
        """Estimate the camera tilt of an image; the request header precedes the image."""
        message, image = unframed(await uploaded_file(request), LevelRequest)
        _known(studio.cameras, message.id)
        camera = studio.cameras.with_circle(message)
        return await studio.conversions.run(request, lambda: estimate_tilt(camera, message, image))

    @app.post(
        "/api/restore",
        openapi_extra=FILE_BODY,
        response_class=StreamingResponse,
        responses={200: STATUS_LINES},
    )
    async def restore(request: Request) -> StreamingResponse:
        """Restore an image: progress messages, one per line, and a PNG after an empty line.

        The request header precedes the image. Closing the connection cancels the restoration.
        """
        message, image = unframed(await uploaded_file(request), RestoreRequest)
        _known(studio.cameras, message.id)
        task = RestorationTask(
            request=message,
            sensor_file=studio.cameras.file_of(message),
            stored_orientation=is_stored,
        )
        return StreamingResponse(studio.restorations.run(task, image), media_type=STATUS_MEDIA_TYPE)


def _add_streams(app: FastAPI, studio: Studio) -> None:
    @app.websocket("/api/stream")
    async def stream(socket: WebSocket, id: str) -> None:
        """Send frames as JPEG on request, and state changes of the stream as text."""
        await socket.accept()
        try:
            source = studio.sources.find(id)
        except KeyError:
            ended = StreamState(state="ended", message=f"unknown stream {id!r}")
            await socket.send_text(ended.model_dump_json())
            await socket.close()
            return
        async with studio.streams.watch(source) as watched:
            await _serve(socket, watched)


def _known(cameras: Cameras, id: str) -> NamedCamera:
    try:
        return cameras.find(id)
    except KeyError:
        raise HTTPException(
            404,
            f"unknown camera {id!r}; if it was uploaded before a restart of the server, load it again",
        ) from None


def _image_path(studio: Studio, id: str) -> Path:
    """Return the path of an image of the server."""
    try:
        source = studio.sources.find(id)
    except KeyError:
        raise HTTPException(404, f"unknown image {id!r}") from None
    if source.kind != "image":
        raise HTTPException(404, f"{source.name} must be an image; got a {source.kind} source")
    path = Path(source.place)
    if not path.is_file():
        raise HTTPException(404, f"{source.name} does not exist any more")
    return path


def _png(data: bytes) -> Response:
    return Response(data, media_type="image/png")


async def _serve(socket: WebSocket, watched: Stream) -> None:
    """Serve one page: state changes, and the newest frame after each request."""
    count, state = 0, None
    message = asyncio.create_task(socket.receive())
    is_requested = False
    try:
        while True:
            news = asyncio.create_task(
                watched.after(count if is_requested else watched.count, state)
            )
            done, _ = await asyncio.wait({message, news}, return_when=asyncio.FIRST_COMPLETED)
            if message in done:
                if message.result()["type"] == "websocket.disconnect":
                    news.cancel()
                    return
                is_requested, message = True, asyncio.create_task(socket.receive())
            if news not in done:
                news.cancel()
                continue
            number, jpeg, now = news.result()
            if now != state:
                state = now
                await socket.send_text(now.model_dump_json())
            if is_requested and jpeg is not None:
                count, is_requested = number, False
                await socket.send_bytes(jpeg)
    except (WebSocketDisconnect, RuntimeError, OSError):
        return
    finally:
        message.cancel()
