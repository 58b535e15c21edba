"""What the gateway answers: pictures, streams, and a small interface by which views are found and steered."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, aclosing, asynccontextmanager, contextmanager
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.types import ASGIApp, Receive, Scope, Send

from ... import __version__
from ...arguments import shown
from ...errors import InvalidParameter, OmnimirrorError
from ...escaping import html_text
from ..http_server.access import Guard
from ..http_server.bodies import invalid_entry, refuse_invalid_bodies
from ..http_server.limits import Bounded
from .gateway import Gateway
from .live_view import STEERING, LiveView
from .webrtc import Peers

BOUNDARY = "frame"
MOST_WATCHERS = 64
"""Of all views together, those of WebRTC among them; more would have to wait too long."""
PATIENCE_S = 15.0
"""For which a picture or a playlist is waited for."""
BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number")
"""Kinds of errors about the magnitude of a number."""
MAX_TILT_DEG = 90.0
MAX_ZOOM = 1e6
WAYS = {"mjpg": "MJPEG", "ts": "MPEG-TS", "m3u8": "HLS", "jpg": "a picture"}
"""How a view is watched, by what is put behind its name."""


class Steering(BaseModel):
    """Where a view shall look; what is left out stays."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    pan_deg: float | None = Field(None, ge=-360, le=360)
    tilt_deg: float | None = Field(None, ge=-MAX_TILT_DEG, le=MAX_TILT_DEG)
    roll_deg: float | None = Field(None, ge=-360, le=360)
    hfov_deg: float | None = Field(None, gt=-180, lt=180)
    zoom: float | None = Field(None, gt=0, le=MAX_ZOOM)
    relative: bool = False
    """Whether the angles are added to what they are, and the zoom multiplies it."""


def create_app(gateway: Gateway, token: str | None, publish_to: str | None = None) -> ASGIApp:
    """The server as an ASGI application, guarded; views are pushed to ``publish_to``, too."""
    return Guard(Bounded(api(gateway, token, publish_to), {}), (), token, "default-src 'none'", for_programs=True)


def api(gateway: Gateway, token: str | None = None, publish_to: str | None = None) -> FastAPI:
    """The routes; what a playlist names is asked for with the token."""
    peers = Peers()
    seats = Seats(peers)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        pushed = asyncio.create_task(gateway.publish(publish_to)) if publish_to else None
        yield
        if pushed is not None:
            pushed.cancel()
            await asyncio.wait([pushed])
        await peers.close()
        gateway.close()

    app = FastAPI(title="omnimirror gateway", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None)

    refuse_invalid_bodies(app, _misread)

    @app.exception_handler(OmnimirrorError)
    async def refused(request: Request, error: OmnimirrorError) -> Response:
        return JSONResponse({"detail": str(error)}, 400)

    @app.get("/health")
    def health() -> dict[str, str]:
        return {"status": "ok"}

    @app.get("/", response_class=HTMLResponse)
    def page() -> str:
        return _page(gateway)

    @app.get("/api/views")
    def views() -> dict[str, Any]:
        about = [told(view) for view in gateway.views.values()]
        return {"state": gateway.state, "received": gateway.received, "views": about}

    @app.get("/api/views/{name}")
    def view(name: str) -> dict[str, Any]:
        return told(_view(gateway, name))

    @app.post("/api/views/{name}")
    def steer(name: str, steering: Steering) -> dict[str, Any]:
        steered = _view(gateway, name)
        steered.steer(**wanted(steered, steering))
        return told(steered)

    _add_streams(app, gateway, token, seats)
    _add_webrtc(app, peers, gateway, seats)
    return app


class Seats:
    """Clients that watch, counted from when they are admitted, since a stream begins only later."""

    def __init__(self, peers: Peers) -> None:
        self._peers, self._taken = peers, 0

    def check(self) -> None:
        """Refuse one more client where no more can watch."""
        if self._taken + self._peers.count >= MOST_WATCHERS:
            raise HTTPException(503, f"{MOST_WATCHERS} are watching already, and no more can")

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Hold a seat within the block."""
        self.check()
        self._taken += 1
        try:
            yield
        finally:
            self._taken -= 1


class SeatedResponse(StreamingResponse):
    """Stream that holds a seat from its creation to its end, whether or not its first byte is ever sent."""

    def __init__(self, seats: Seats, content: AsyncIterator[bytes], media_type: str) -> None:
        super().__init__(content, media_type=media_type)
        self._seat = ExitStack()
        self._seat.enter_context(seats.taken())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._seat:
            await super().__call__(scope, receive, send)


def _add_streams(app: FastAPI, gateway: Gateway, token: str | None, seats: Seats) -> None:
    query = "" if token is None else f"?token={quote(token, safe='')}"  # VLC gives segments no password of its own

    @app.get("/{name}.mjpg")
    async def mjpeg(name: str) -> StreamingResponse:
        return SeatedResponse(seats, _parts(_view(gateway, name)), f"multipart/x-mixed-replace; boundary={BOUNDARY}")

    @app.get("/{name}.ts")
    async def transport(name: str) -> StreamingResponse:
        return SeatedResponse(seats, _view(gateway, name).transport.chunks(), "video/mp2t")

    @app.get("/{name}.jpg")
    async def picture(name: str) -> Response:
        view = _view(gateway, name)
        with seats.taken():
            async with _patience(gateway), aclosing(view.jpeg.items()) as pictures:
                return Response(await anext(pictures), media_type="image/jpeg")

    @app.get("/{name}.m3u8")
    async def playlist(name: str) -> PlainTextResponse:
        view = _view(gateway, name)
        with seats.taken():
            async with _patience(gateway):
                text = await view.transport.playlist(name, query)
        return PlainTextResponse(text, media_type="application/vnd.apple.mpegurl")

    @app.get("/{name}/{number}.ts")
    async def segment(name: str, number: int) -> Response:
        try:
            return Response(_view(gateway, name).transport.segment(number), media_type="video/mp2t")
        except KeyError:
            raise HTTPException(404, f"segment {number} of {name} is there no more, or not yet") from None


@asynccontextmanager
async def _patience(gateway: Gateway) -> AsyncIterator[None]:
    """Say how the source is where nothing comes of it."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            yield
    except TimeoutError:
        raise HTTPException(503, gateway.state) from None


def _add_webrtc(app: FastAPI, peers: Peers, gateway: Gateway, seats: Seats) -> None:
    """WHEP, as players of WebRTC ask for a stream: an offer by POST, its answer, and DELETE at the end."""

    @app.post("/{name}/whep")
    async def answer(name: str, request: Request) -> Response:
        view = _view(gateway, name)
        offer = (await request.body()).decode("utf-8", "replace")
        seats.check()  # without a pause before the peer is counted
        peer, sdp = await peers.answer(view, offer)
        return Response(sdp, 201, {"location": f"/{name}/whep/{peer}"}, "application/sdp")

    @app.delete("/{name}/whep/{peer}")
    async def end(name: str, peer: str) -> Response:
        await peers.end(peer)
        return Response(status_code=200)


async def _parts(view: LiveView) -> AsyncIterator[bytes]:
    """Pictures as parts of a document that replace each other."""
    async for picture in view.jpeg.items():
        head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
        yield head.encode() + picture + b"\r\n"


def _view(gateway: Gateway, name: str) -> LiveView:
    try:
        return gateway.views[name]
    except KeyError:
        raise HTTPException(404, f"there is no view {name!r}; there are {', '.join(gateway.views)}") from None


def _misread(error: RequestValidationError) -> str:
    """Explain what is wrong with a body or an address."""
    if error.errors()[0]["loc"][0] != "body":
        return invalid_entry(error.errors())
    problem, valid = error.errors()[0], ", ".join(Steering.model_fields)
    name = ".".join(str(part) for part in problem["loc"][1:])
    if problem["type"] == "extra_forbidden":
        return f"{name} is not known; valid are {valid}"
    if name in Steering.model_fields and problem["type"] in BOUNDS:
        return invalid_entry(error.errors())
    if name in Steering.model_fields:
        kind = "true or false" if name == "relative" else "a number"
        return f"{name} = {shown(problem['input'])} is not {kind}"
    return f'what was sent is no JSON such as {{"pan_deg": 40}}; valid are {valid}'


def wanted(view: LiveView, steering: Steering) -> dict[str, float]:
    """Return the direction, field and zoom that are wanted of a view, as absolute values.

    Raises
    ------
    InvalidParameter
        Steps lead out of the range of a value.
    """
    asked = steering.model_dump(exclude={"relative"}, exclude_none=True)
    if steering.relative:
        now = told(view)
        asked = {k: now[k] * value if k == "zoom" else now[k] + value for k, value in asked.items() if k in now}
    for name in ("pan_deg", "roll_deg"):
        if name in asked and abs(asked[name]) > 360:  # many steps lead around again
            asked[name] = (asked[name] + 180) % 360 - 180
    if abs(asked.get("tilt_deg", 0.0)) > MAX_TILT_DEG:
        raise InvalidParameter(f"tilt_deg must be from -90 to 90; the steps lead to {asked['tilt_deg']:g}")
    return asked


def told(view: LiveView) -> dict[str, Any]:
    """What the interface tells of a view."""
    name, looks = view.named.name, view.view
    about: dict[str, Any] = {
        "name": name, "shows": str(looks), "size": list(view.size), "steered": view.named.steered,
        "watchers": view.watchers,
        "dewarped": view.dewarped, "dropped": view.dropped, "problem": view.problem,
        "addresses": [f"/{name}.{suffix}" for suffix in WAYS],
    }  # fmt: skip
    if view.named.steered:
        about |= {key: getattr(looks, key) for key in STEERING}
        about["zoom"] = view.zoom
    return about


def _page(gateway: Gateway) -> str:
    rows = "".join(
        f"<li>{html_text(name)}: {html_text(str(view.view))}: "
        + ", ".join(f'<a href="{html_text(name)}.{suffix}">{way}</a>' for suffix, way in WAYS.items())
        for name, view in gateway.views.items()
    )
    return f"<!doctype html><title>omnimirror</title><h1>{html_text(gateway.state)}</h1><ul>{rows}</ul>"
