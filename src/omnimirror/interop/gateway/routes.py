"""HTTP routes of the gateway: streams, images, WebRTC (WHEP) and the JSON interface for steering."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, aclosing, asynccontextmanager, contextmanager
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from pydantic import BaseModel, ConfigDict, Field
from starlette.types import ASGIApp, Receive, Scope, Send

from ... import __version__
from ...base.arguments import format_value
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.escaping import html_text
from ..http_server.auth import AccessGuard
from ..http_server.limits import RequestLimits
from ..http_server.request_bodies import reject_invalid_bodies, validation_message
from .live_views import STEERING_ANGLES, Gateway, LiveView
from .webrtc import PeerConnections

MULTIPART_BOUNDARY = "frame"
MAX_CLIENTS = 64
"""Maximum number of clients of all views, including WebRTC."""
TIMEOUT_S = 15.0
"""Maximum waiting time for an image or a playlist."""
RANGE_ERRORS = (
    "greater_than",
    "greater_than_equal",
    "less_than",
    "less_than_equal",
    "finite_number",
)
"""pydantic error types about the magnitude of a number."""
MAX_TILT_DEG = 90.0
MAX_ZOOM = 1e6
STREAM_TYPES = {"mjpg": "MJPEG", "ts": "MPEG-TS", "m3u8": "HLS", "jpg": "image"}
"""Stream types by URL suffix."""


class Steering(BaseModel):
    """Request to steer a view; omitted values remain unchanged."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    pan_deg: float | None = Field(None, ge=-360, le=360)
    tilt_deg: float | None = Field(None, ge=-MAX_TILT_DEG, le=MAX_TILT_DEG)
    roll_deg: float | None = Field(None, ge=-360, le=360)
    hfov_deg: float | None = Field(None, gt=-180, lt=180)
    zoom: float | None = Field(None, gt=0, le=MAX_ZOOM)
    relative: bool = False
    """True to add angles to the current values and multiply the current zoom."""


def create_app(gateway: Gateway, token: str | None, publish_to: str | None = None) -> ASGIApp:
    """Return the gateway as an ASGI application with access control and request limits.

    Parameters
    ----------
    gateway
        Source and views.
    token
        Access token; None for unrestricted access.
    publish_to
        URL with ``{view}`` to which all views are pushed.
    """
    app = RequestLimits(create_routes(gateway, token, publish_to), {})
    return AccessGuard(app, (), token, "default-src 'none'", accept_passwords=True)


def create_routes(
    gateway: Gateway, token: str | None = None, publish_to: str | None = None
) -> FastAPI:
    """Return the routes; URLs in playlists contain the token."""
    peers = PeerConnections()
    slots = ClientSlots(peers)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        publisher = asyncio.create_task(gateway.publish(publish_to)) if publish_to else None
        yield
        if publisher is not None:
            publisher.cancel()
            await asyncio.wait([publisher])
        await peers.close()
        gateway.close()

    app = FastAPI(
        title="omnimirror gateway",
        version=__version__,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    reject_invalid_bodies(app, _steering_error)

    @app.exception_handler(OmnimirrorError)
    async def on_error(request: Request, error: OmnimirrorError) -> Response:
        return JSONResponse({"detail": str(error)}, 400)

    @app.get("/health")
    def health() -> dict[str, str]:
        return {"status": "ok"}

    @app.get("/", response_class=HTMLResponse)
    def index() -> str:
        return _index_page(gateway)

    @app.get("/api/views")
    def views() -> dict[str, Any]:
        return {
            "state": gateway.state,
            "frames_received": gateway.frames_received,
            "views": [view_status(view) for view in gateway.views.values()],
        }

    @app.get("/api/views/{name}")
    def view(name: str) -> dict[str, Any]:
        return view_status(_find_view(gateway, name))

    @app.post("/api/views/{name}")
    def steer(name: str, steering: Steering) -> dict[str, Any]:
        steered = _find_view(gateway, name)
        steered.steer(**absolute_steering(steered, steering))
        return view_status(steered)

    _add_stream_routes(app, gateway, token, slots)
    _add_webrtc_routes(app, peers, gateway, slots)
    return app


class ClientSlots:
    """Limit on the number of clients, counted from admission to the end of the response."""

    def __init__(self, peers: PeerConnections) -> None:
        self._peers, self._used = peers, 0

    def check(self) -> None:
        """Raise a 503 error if the maximum number of clients is connected."""
        if self._used + self._peers.count >= MAX_CLIENTS:
            raise HTTPException(503, f"the number of clients must be at most {MAX_CLIENTS}")

    @contextmanager
    def acquire(self) -> Iterator[None]:
        """Occupy a slot within the block."""
        self.check()
        self._used += 1
        try:
            yield
        finally:
            self._used -= 1


class SlotResponse(StreamingResponse):
    """Streaming response that occupies a slot from its creation to its end."""

    def __init__(self, slots: ClientSlots, content: AsyncIterator[bytes], media_type: str) -> None:
        super().__init__(content, media_type=media_type)
        self._slot = ExitStack()
        self._slot.enter_context(slots.acquire())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._slot:
            await super().__call__(scope, receive, send)


def _add_stream_routes(
    app: FastAPI, gateway: Gateway, token: str | None, slots: ClientSlots
) -> None:
    # VLC sends no password with the requests for segments, so their URLs contain the token.
    query = "" if token is None else f"?token={quote(token, safe='')}"

    @app.get("/{name}.mjpg")
    async def mjpeg(name: str) -> StreamingResponse:
        parts = _multipart_images(_find_view(gateway, name))
        media_type = f"multipart/x-mixed-replace; boundary={MULTIPART_BOUNDARY}"
        return SlotResponse(slots, parts, media_type)

    @app.get("/{name}.ts")
    async def transport(name: str) -> StreamingResponse:
        return SlotResponse(slots, _find_view(gateway, name).transport.chunks(), "video/mp2t")

    @app.get("/{name}.jpg")
    async def image(name: str) -> Response:
        view = _find_view(gateway, name)
        with slots.acquire():
            async with _timeout(gateway), aclosing(view.jpeg.items()) as images:
                return Response(await anext(images), media_type="image/jpeg")

    @app.get("/{name}.m3u8")
    async def playlist(name: str) -> PlainTextResponse:
        view = _find_view(gateway, name)
        with slots.acquire():
            async with _timeout(gateway):
                text = await view.transport.playlist(name, query)
        return PlainTextResponse(text, media_type="application/vnd.apple.mpegurl")

    @app.get("/{name}/{number}.ts")
    async def segment(name: str, number: int) -> Response:
        try:
            data = _find_view(gateway, name).transport.segment(number)
        except KeyError:
            raise HTTPException(404, f"segment {number} of {name} is not available") from None
        return Response(data, media_type="video/mp2t")


@asynccontextmanager
async def _timeout(gateway: Gateway) -> AsyncIterator[None]:
    """Raise a 503 error with the state of the source if no frame arrives in time."""
    try:
        async with asyncio.timeout(TIMEOUT_S):
            yield
    except TimeoutError:
        raise HTTPException(503, gateway.state) from None


def _add_webrtc_routes(
    app: FastAPI, peers: PeerConnections, gateway: Gateway, slots: ClientSlots
) -> None:
    """Add the WHEP protocol: an SDP offer by POST, its answer, and DELETE to disconnect."""

    @app.post("/{name}/whep")
    async def connect(name: str, request: Request) -> Response:
        view = _find_view(gateway, name)
        offer = (await request.body()).decode("utf-8", "replace")
        slots.check()  # no await between this check and the registration of the peer
        peer, sdp = await peers.answer(view, offer)
        return Response(sdp, 201, {"location": f"/{name}/whep/{peer}"}, "application/sdp")

    @app.delete("/{name}/whep/{peer}")
    async def disconnect(name: str, peer: str) -> Response:
        await peers.disconnect(peer)
        return Response(status_code=200)


async def _multipart_images(view: LiveView) -> AsyncIterator[bytes]:
    """Yield JPEG images as parts of a multipart/x-mixed-replace response."""
    async for image in view.jpeg.items():
        head = f"--{MULTIPART_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
        yield head.encode() + image + b"\r\n"


def _find_view(gateway: Gateway, name: str) -> LiveView:
    try:
        return gateway.views[name]
    except KeyError:
        valid = ", ".join(gateway.views)
        raise HTTPException(404, f"the view must be one of {valid}; got {name!r}") from None


def _steering_error(error: RequestValidationError) -> str:
    """Return a sentence about an invalid body or path."""
    problem, valid = error.errors()[0], ", ".join(Steering.model_fields)
    if problem["loc"][0] != "body":
        return validation_message(error.errors())
    name = ".".join(str(part) for part in problem["loc"][1:])
    if problem["type"] == "extra_forbidden":
        return f"the keys must be from {valid}; got {name}"
    if name in Steering.model_fields:
        if problem["type"] in RANGE_ERRORS:
            return validation_message(error.errors())
        kind = "true or false" if name == "relative" else "a number"
        return f"{name} must be {kind}; got {format_value(problem['input'])}"
    return f'the body must be a JSON object such as {{"pan_deg": 40}} with keys from {valid}'


def absolute_steering(view: LiveView, steering: Steering) -> dict[str, float]:
    """Return the requested angles and zoom as absolute values.

    Raises
    ------
    InvalidParameter
        If relative values lead out of range.
    """
    values = steering.model_dump(exclude={"relative"}, exclude_none=True)
    if steering.relative:
        current = view_status(view)
        values = {
            key: current[key] * value if key == "zoom" else current[key] + value
            for key, value in values.items()
            if key in current
        }
    for name in ("pan_deg", "roll_deg"):
        if name in values and abs(values[name]) > 360:  # sum of many relative steps
            values[name] = (values[name] + 180) % 360 - 180
    tilt_deg = values.get("tilt_deg", 0.0)
    if abs(tilt_deg) > MAX_TILT_DEG:
        raise InvalidParameter(f"tilt_deg must be between -90 and 90 deg; got {tilt_deg:g}")
    return values


def view_status(view: LiveView) -> dict[str, Any]:
    """Return the state of a view for the JSON interface."""
    name = view.named.name
    status: dict[str, Any] = {
        "name": name,
        "view": str(view.view),
        "size": list(view.size),
        "steerable": view.named.steerable,
        "clients": view.clients,
        "frames_dewarped": view.frames_dewarped,
        "frames_dropped": view.frames_dropped,
        "error": view.error,
        "paths": [f"/{name}.{suffix}" for suffix in STREAM_TYPES],
    }
    if view.named.steerable:
        status |= {key: getattr(view.view, key) for key in STEERING_ANGLES}
        status["zoom"] = view.zoom
    return status


def _index_page(gateway: Gateway) -> str:
    """Return an HTML page with links to all streams."""
    items = []
    for name, view in gateway.views.items():
        links = ", ".join(
            f'<a href="{html_text(name)}.{suffix}">{label}</a>'
            for suffix, label in STREAM_TYPES.items()
        )
        items.append(f"<li>{html_text(name)}: {html_text(str(view.view))}: {links}")
    title = f"<!doctype html><title>omnimirror</title><h1>{html_text(gateway.state)}</h1>"
    return f"{title}<ul>{''.join(items)}</ul>"
