"""How much is taken at once: bytes that are handed up, and work under way."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...errors import OmnimirrorError

T = TypeVar("T")

LARGEST_MESSAGE = 1 << 20
"""Bytes of a question, a design or a calibration."""
LARGEST_PICTURE = 128 << 20
LARGEST_SET = 16 << 20
"""Bytes of the corners in all pictures of a calibration."""
MOST_HELD = 512 << 20
"""Bytes of all requests that are being handed up just now."""
GRACE_S = 30.0
SLOWEST = 1024.0
"""Bytes a second that a request has to bring after its grace."""
MOST_WAITING = 16


class Busy(OmnimirrorError):
    """So much is asked for just now that more would have to wait too long."""


class _Refused(Exception):
    """Why no more is taken of a request."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.answer = JSONResponse({"detail": sentence}, status, {"connection": "close"})


class Bounded:
    """Refuses what is handed up once it is too much, too slow, or more than the server holds at once.

    Parameters
    ----------
    app
    larger
        Paths that take more than :data:`LARGEST_MESSAGE`, and how many bytes.
    """

    def __init__(self, app: ASGIApp, larger: Mapping[str, int]) -> None:
        self.app, self.larger = app, larger
        self.held = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        most = self.larger.get(scope["path"], LARGEST_MESSAGE)
        taken = _Taken(self, receive, most)

        async def unless_refused(message: Message) -> None:
            if taken.refusal is None:  # else the application answers that the body was broken
                await send(message)

        try:
            taken.check(_announced(scope))
            await self.app(scope, taken.next, unless_refused)
        except _Refused:
            pass
        finally:
            self.held -= taken.size
        if taken.refusal is not None:
            await taken.refusal.answer(scope, receive, send)


class _Taken:
    """What was taken of one request."""

    def __init__(self, whole: Bounded, receive: Receive, most: int) -> None:
        self.whole, self.receive, self.most = whole, receive, most
        self.size = 0
        self.refusal: _Refused | None = None
        self._start = time.monotonic()
        self._is_complete = False

    async def next(self) -> Message:
        """The next piece, or later that the client has gone.

        Raises
        ------
        _Refused
            It is too much, or came too slowly.
        """
        left_s = self._start + GRACE_S + self.size / SLOWEST - time.monotonic()
        try:
            async with asyncio.timeout(None if self._is_complete else left_s):
                message = await self.receive()
        except TimeoutError:
            raise self._refuse(408, "what was sent came too slowly") from None
        self._is_complete = not message.get("more_body", False)
        piece = len(message.get("body", b""))
        self.size += piece
        self.whole.held += piece
        self.check(self.size)
        if self.whole.held > MOST_HELD:
            raise self._refuse(503, "the server is being handed too much at once just now; try again in a while")
        return message

    def check(self, size: int) -> None:
        """Refuse so many bytes if they are too many."""
        if size > self.most:
            words = f"what was sent is larger than {self.most >> 20} MB, which is the most that is taken here"
            raise self._refuse(413, words)

    def _refuse(self, status: int, sentence: str) -> _Refused:
        self.refusal = _Refused(status, sentence)
        return self.refusal


def _announced(scope: Scope) -> int:
    for name, value in scope["headers"]:
        if name == b"content-length" and value.isdigit():
            return int(value)
    return 0


class Turns:
    """Heavy work, one piece after the other; what is equal is done once for all who ask."""

    def __init__(self) -> None:
        self._turn = asyncio.Semaphore(1)
        self._under_way: dict[Hashable, asyncio.Task[Any]] = {}

    async def do(self, key: Hashable, make: Callable[[], T]) -> T:
        """What ``make`` gives, run in a thread; equal keys under way share one run.

        Raises
        ------
        Busy
            Too many wait for their turn.
        """
        task = self._under_way.get(key)
        if task is None:
            if len(self._under_way) >= MOST_WAITING:
                raise Busy("more is being worked on than can be waited for; try again in a while")
            task = self._under_way[key] = asyncio.create_task(self._run(key, make))
        found: T = await asyncio.shield(task)  # one who leaves takes it from nobody else
        return found

    async def _run(self, key: Hashable, make: Callable[[], T]) -> T:
        try:
            async with self._turn:
                return await asyncio.to_thread(make)
        finally:
            del self._under_way[key]
