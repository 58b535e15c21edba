"""ASGI application of the studio: the page and the routes of its tabs."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.responses import Response
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp

from ... import __version__
from ...base.errors import OmnimirrorError
from ...interop.http_server.auth import AccessGuard, content_security_policy
from ...interop.http_server.limits import MAX_DETECTIONS_BYTES, MAX_IMAGE_BYTES, RequestLimits, ServerBusy
from ...interop.http_server.request_bodies import reject_invalid_bodies
from .bench.routes import add_bench
from .calibrate.routes import add_calibrate
from .look.routes import add_look
from .messages import Health, Problem
from .pages import SCRIPTS, PageFile, page_text, script_text
from .schema import REFUSALS
from .studio import Studio

PICTURES = ("/api/pictures", "/api/rim", "/api/restore", "/api/level", "/api/calibrate/look", "/api/calibrate/straight")
"""Routes that accept uploaded images."""


def create_app(studio: Studio | None = None) -> ASGIApp:
    """Return the guarded ASGI application; :func:`api` builds the routes behind the guard."""
    studio = studio or Studio()
    larger = dict.fromkeys(PICTURES, MAX_IMAGE_BYTES) | {"/api/calibrate/together": MAX_DETECTIONS_BYTES}
    limited = RequestLimits(api(studio), larger)
    return AccessGuard(limited, studio.hosts, studio.token, content_security_policy(page_text()))


def api(studio: Studio) -> FastAPI:
    """Return the FastAPI application with all routes."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        studio.streams.close()
        studio.lookers.close()

    app = FastAPI(
        title="omnimirror studio", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None,
        responses=REFUSALS,
    )  # fmt: skip

    reject_invalid_bodies(app)

    @app.exception_handler(OmnimirrorError)
    async def refused(request: Request, error: OmnimirrorError) -> Response:
        return _problem(503 if isinstance(error, ServerBusy) else 400, str(error))

    @app.exception_handler(OSError)
    async def no_room(request: Request, error: OSError) -> Response:
        reason = error.strerror or type(error).__name__
        return _problem(507, f"the server cannot write or read what this needs: {reason}")

    @app.exception_handler(MemoryError)
    async def no_memory(request: Request, error: MemoryError) -> Response:
        return _problem(507, "this needs more memory than the server has")

    @app.exception_handler(ClientDisconnect)
    async def gone(request: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=400)  # incomplete upload of a client that disconnected

    _add_page(app)
    add_look(app, studio)
    add_bench(app, studio)
    add_calibrate(app, studio)
    return app


def _problem(status: int, sentence: str) -> Response:
    return Response(Problem(detail=sentence).model_dump_json(), status, media_type="application/json")


def _add_page(app: FastAPI) -> None:
    page_file = PageFile(page_text(), "text/html")

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
