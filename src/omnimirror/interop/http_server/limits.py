"""Limits on requests and background work: body sizes, transfer rates, and a queue of jobs."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Hashable, Mapping
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...base.errors import OmnimirrorError

T = TypeVar("T")

MAX_MESSAGE_BYTES = 1 << 20
"""Maximum size of a JSON message, a design or a calibration."""
MAX_IMAGE_BYTES = 128 << 20
MAX_DETECTIONS_BYTES = 16 << 20
"""Maximum size of the detected corners in all images of a calibration."""
MAX_PENDING_BYTES = 512 << 20
"""Maximum size of all requests that are being received."""
GRACE_PERIOD_S = 30.0
MIN_RATE_BYTES_PER_S = 1024.0
"""Minimum transfer rate of a request after the grace period."""
MAX_QUEUED_JOBS = 16
PAGE_HEADER = b"omnimirror-page"
"""Header with an identifier of the page that sent a request."""
current_page: ContextVar[str] = ContextVar("current_page", default="")
"""Identifier of the page whose request is processed."""


class ServerBusy(OmnimirrorError):
    """Raised when the job queue is full."""


class _Refusal(Exception):
    """Response that ends the reception of a request."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.response = JSONResponse({"detail": message}, status, {"connection": "close"})


class RequestLimits:
    """ASGI middleware that rejects requests that are too large or too slow.

    Parameters
    ----------
    app
        Application to protect.
    larger
        Maximum body size in bytes of paths that accept more than :data:`MAX_MESSAGE_BYTES`.
    """

    def __init__(self, app: ASGIApp, larger: Mapping[str, int]) -> None:
        self.app, self.larger = app, larger
        self.pending_bytes = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        current_page.set(dict(scope["headers"]).get(PAGE_HEADER, b"").decode("latin-1"))
        max_bytes = self.larger.get(scope["path"], MAX_MESSAGE_BYTES)
        body = _LimitedBody(self, receive, max_bytes)

        async def send_unless_refused(message: Message) -> None:
            if body.refusal is None:  # otherwise the application reports an interrupted body
                await send(message)

        try:
            body.check_size(_content_length(scope))
            await self.app(scope, body.receive_message, send_unless_refused)
        except _Refusal:
            pass
        finally:
            self.pending_bytes -= body.size
        if body.refusal is not None:
            await body.refusal.response(scope, receive, send)


class _LimitedBody:
    """Received part of one request."""

    def __init__(self, limits: RequestLimits, receive: Receive, max_bytes: int) -> None:
        self.limits, self.receive, self.max_bytes = limits, receive, max_bytes
        self.size = 0
        self.refusal: _Refusal | None = None
        self._start = time.monotonic()
        self._is_complete = False

    async def receive_message(self) -> Message:
        """Receive the next part of the body, or the disconnection after its end.

        Raises
        ------
        _Refusal
            If the body is too large or arrives too slowly.
        """
        deadline_s = self._start + GRACE_PERIOD_S + self.size / MIN_RATE_BYTES_PER_S
        timeout_s = None if self._is_complete else deadline_s - time.monotonic()
        try:
            async with asyncio.timeout(timeout_s):
                message = await self.receive()
        except TimeoutError:
            rate = MIN_RATE_BYTES_PER_S
            raise self._refuse(408, f"the body must be sent at {rate:g} bytes/s or more") from None
        self._is_complete = not message.get("more_body", False)
        part = len(message.get("body", b""))
        self.size += part
        self.limits.pending_bytes += part
        self.check_size(self.size)
        if self.limits.pending_bytes > MAX_PENDING_BYTES:
            raise self._refuse(503, "the server is receiving too much data; try again later")
        return message

    def check_size(self, size: int) -> None:
        """Reject a body whose size in bytes is above the limit."""
        if size > self.max_bytes:
            message = f"the body must be at most {self.max_bytes >> 20} MB; got {size} bytes"
            raise self._refuse(413, message)

    def _refuse(self, status: int, message: str) -> _Refusal:
        self.refusal = _Refusal(status, message)
        return self.refusal


def _content_length(scope: Scope) -> int:
    for name, value in scope["headers"]:
        if name == b"content-length" and value.isdigit():
            return int(value)
    return 0


class FairSlots:
    """Slots for simultaneous work; a free slot goes to the waiting clients in turn, so that many
    requests of one client do not delay those of another.

    Parameters
    ----------
    slots
        Number of slots.
    """

    def __init__(self, slots: int = 1) -> None:
        self._free = slots
        self._waiting: dict[Hashable, deque[asyncio.Future[None]]] = {}

    @property
    def is_full(self) -> bool:
        """True if the next client has to wait."""
        return not self._free

    @asynccontextmanager
    async def slot(self, client: Hashable) -> AsyncIterator[None]:
        """Wait for a slot and hold it during a block."""
        await self._acquire(client)
        try:
            yield
        finally:
            self._release()

    async def _acquire(self, client: Hashable) -> None:
        if self._free:
            self._free -= 1
            return
        ticket = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(client, deque()).append(ticket)
        try:
            await ticket
        except asyncio.CancelledError:
            if ticket.done() and not ticket.cancelled():  # granted in the meantime
                self._release()
            raise

    def _release(self) -> None:
        """Release a slot to the next client, whose further tickets move to the end of the order."""
        while self._waiting:
            client, tickets = next(iter(self._waiting.items()))
            del self._waiting[client]
            ticket = tickets.popleft()
            if tickets:
                self._waiting[client] = tickets
            if not ticket.done():
                ticket.set_result(None)
                return
        self._free += 1


class JobQueue:
    """Queue of jobs in threads, served fairly to pages; equal jobs are run once for all requests.

    Parameters
    ----------
    slots
        Maximum number of simultaneous jobs.
    """

    def __init__(self, slots: int = 1) -> None:
        self._slots = FairSlots(slots)
        self._jobs: dict[Hashable, asyncio.Task[Any]] = {}

    async def run(self, key: Hashable, function: Callable[[], T]) -> T:
        """Run a function in a thread and return its result.

        Parameters
        ----------
        key
            Identity of the job; pending jobs with equal keys share one run.
        function
            Function to run.

        Raises
        ------
        ServerBusy
            If the queue is full.
        """
        job = self._jobs.get(key)
        if job is None:
            if len(self._jobs) >= MAX_QUEUED_JOBS:
                raise ServerBusy("the server is busy; try again later")
            job = self._jobs[key] = asyncio.create_task(self._run(key, function))
        result: T = await asyncio.shield(job)  # a disconnected client does not cancel the job
        return result

    async def _run(self, key: Hashable, function: Callable[[], T]) -> T:
        try:
            async with self._slots.slot(current_page.get()):
                return await asyncio.to_thread(function)
        finally:
            del self._jobs[key]
