"""ASGI application of the studio, and its server."""

from __future__ import annotations

import secrets
import threading
import webbrowser
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.responses import Response
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp

from ... import __version__
from ...base.errors import OmnimirrorError
from ...interop.http_server.auth import AccessGuard, content_security_policy, is_loopback
from ...interop.http_server.limits import (
    MAX_DETECTIONS_BYTES,
    MAX_IMAGE_BYTES,
    RequestLimits,
    ServerBusy,
)
from ...interop.http_server.request_bodies import reject_invalid_bodies
from ...interop.http_server.server import listen, run_server, server_addresses
from ._calibration_routes import add_calibrate
from ._design_routes import add_design_routes
from ._http_messages import REFUSALS
from ._look_routes import add_look
from ._server_state import Studio
from .messages import Health, Problem
from .pages import SCRIPTS, PageFile, page_text, script_text

# -- ASGI application ------------------------------------------------------------------------------

IMAGE_ROUTES = (
    "/api/convert",
    "/api/export",
    "/api/outline",
    "/api/restore",
    "/api/level",
    "/api/calibrate/look",
    "/api/calibrate/straight",
)
"""Routes that accept uploaded images."""


def create_app(studio: Studio | None = None) -> ASGIApp:
    """Return the guarded ASGI application; :func:`api` builds the routes behind the guard."""
    studio = studio or Studio()
    larger = dict.fromkeys(IMAGE_ROUTES, MAX_IMAGE_BYTES) | {
        "/api/calibrate/together": MAX_DETECTIONS_BYTES
    }
    limited = RequestLimits(api(studio), larger)
    return AccessGuard(limited, studio.hosts, studio.token, content_security_policy(page_text()))


def api(studio: Studio) -> FastAPI:
    """Return the FastAPI application with all routes."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        studio.streams.close()
        studio.board_detectors.close()

    app = FastAPI(
        title="omnimirror studio",
        version=__version__,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        responses=REFUSALS,
    )

    reject_invalid_bodies(app)

    @app.exception_handler(OmnimirrorError)
    async def refused(request: Request, error: OmnimirrorError) -> Response:
        return _problem(503 if isinstance(error, ServerBusy) else 400, str(error))

    @app.exception_handler(OSError)
    async def no_room(request: Request, error: OSError) -> Response:
        reason = error.strerror or type(error).__name__
        return _problem(507, f"the server could not read or write a file: {reason}")

    @app.exception_handler(MemoryError)
    async def no_memory(request: Request, error: MemoryError) -> Response:
        return _problem(507, "the request requires more memory than the server has")

    @app.exception_handler(ClientDisconnect)
    async def gone(request: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=400)  # incomplete upload of a client that disconnected

    _add_page(app, studio.stored_orientation)
    add_look(app, studio)
    add_design_routes(app, studio)
    add_calibrate(app, studio)
    return app


def _problem(status: int, message: str) -> Response:
    return Response(
        Problem(detail=message).model_dump_json(), status, media_type="application/json"
    )


def _add_page(app: FastAPI, stored_orientation: bool) -> None:
    text = page_text()
    if (
        stored_orientation
    ):  # the page then converts images on the server, since browsers rotate them
        text = text.replace("<html", "<html data-stored-orientation", 1)
    page_file = PageFile(text, "text/html")

    @app.get("/", include_in_schema=False)
    async def page(request: Request) -> Response:
        return page_file.answer(request)

    for name in SCRIPTS:
        _add_script(app, name)

    @app.get("/health")
    async def health() -> Health:
        """Report that the server is running."""
        return Health(version=__version__)


def _add_script(app: FastAPI, name: str) -> None:
    file = PageFile(script_text(name), "text/javascript")

    @app.get(f"/{name}", include_in_schema=False)
    async def script(request: Request) -> Response:
        return file.answer(request)


# -- Server ----------------------------------------------------------------------------------------


def serve(
    studio: Studio, host: str, port: int, open_browser: bool, on_progress: Callable[[str], None]
) -> None:
    """Serve the studio, print its address, and open it.

    Parameters
    ----------
    studio
        Studio to be served; reachable from other machines only with the token in the printed
        address.
    host, port
        Network address; port 0 selects a free port.
    open_browser
        Whether to open the page.
    on_progress
        Callback for the message with the address.

    Raises
    ------
    OmnimirrorError
        If the address is not available.
    KeyboardInterrupt
        After Ctrl-C.
    """
    if not is_loopback(host):
        studio.token = secrets.token_urlsafe(16)
    listening = listen(host, port)
    bound = listening.getsockname()[1]
    query = f"?token={studio.token}" if studio.token else ""
    addresses = [f"http://{name}:{bound}/{query}" for name in server_addresses(host)]
    on_progress(f"omnimirror studio at {' or '.join(addresses)} (press Ctrl-C to stop)")
    if open_browser:
        threading.Timer(0.3, webbrowser.open, (addresses[-1],)).start()
    run_server(create_app(studio), listening)
