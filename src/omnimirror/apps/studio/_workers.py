"""Worker processes for long-running tasks and for board detection."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from hashlib import sha256
from subprocess import Popen
from typing import IO, Any, Literal

from fastapi import Request, WebSocket, WebSocketDisconnect

from ...base.errors import InvalidParameter
from ...base.worker_processes import start_process, terminate_process
from ...interop.http_server.limits import MAX_QUEUED_JOBS, ServerBusy
from . import _board_detection_process, _outline_process
from ._outline_process import OutlineRequest
from .calibration_messages import BoardDetection, BoardDetectionRequest
from .look_messages import OutlineSearchStatus
from .messages import Problem

# -- Worker processes ------------------------------------------------------------------------------
#
# Workers do not delay interactive requests and can be cancelled at any time. A worker reads its task
# from standard input and writes its progress, one message per line.


async def serve_socket(socket: WebSocket, work: Callable[[WebSocket], Awaitable[None]]) -> None:
    """Serve a socket until either side closes it."""
    await socket.accept()
    with suppress(WebSocketDisconnect, RuntimeError, OSError):
        await work(socket)


class Worker:
    """Running worker process."""

    def __init__(self, process: Popen[bytes]) -> None:
        self._process = process

    def send(self, line: str, data: bytes | None = None) -> None:
        """Send a line, and the length and bytes of a file; ignored after the end of the process."""
        stdin: IO[bytes] | None = self._process.stdin
        assert stdin is not None
        with suppress(OSError, ValueError):
            stdin.write(line.encode() + b"\n")
            if data is not None:
                stdin.write(b"%d\n" % len(data))
                stdin.write(data)
            stdin.flush()

    async def lines(self) -> AsyncIterator[str]:
        """Yield the output lines."""
        stdout = self._process.stdout
        assert stdout is not None
        while line := await asyncio.to_thread(stdout.readline):
            yield line.decode()


class Workers:
    """Limited number of worker processes.

    Parameters
    ----------
    module
        Module to run.
    max_workers
        Maximum number of simultaneous processes.
    what
        Plural noun for their tasks, used in the error message.
    """

    def __init__(self, module: str, max_workers: int, what: str) -> None:
        self.module, self.most, self.what = module, max_workers, what
        self._running = 0

    @asynccontextmanager
    async def one(self) -> AsyncIterator[Worker]:
        """Yield a worker; leaving the block terminates it.

        Raises
        ------
        InvalidParameter
            If there are too many active workers.
        """
        if self._running >= self.most:
            raise InvalidParameter(
                f"the limit of {self.most} simultaneous {self.what} is reached; wait or cancel one"
            )
        self._running += 1
        process = start_process(self.module)
        try:
            yield Worker(process)
        finally:
            self._running -= 1
            terminate_process(process)


async def relay(worker: Worker, socket: WebSocket, listening: asyncio.Task[Any]) -> None:
    """Forward progress messages to a page until their end, or until a disconnect ends
    ``listening``."""
    lines = worker.lines()
    try:
        while True:
            line = asyncio.ensure_future(anext(lines))
            await asyncio.wait({listening, line}, return_when=asyncio.FIRST_COMPLETED)
            if not line.done():
                line.cancel()
                return
            await socket.send_text(line.result())
    except StopAsyncIteration:
        return
    finally:
        listening.cancel()


# -- Outline searches ------------------------------------------------------------------------------

MAX_CACHED_OUTLINES = 256
"""Maximum number of cached outlines, about 100 bytes each; a full cache is cleared."""


class OutlineSearches:
    """Outline searches in worker processes, one at a time in the order of their requests.

    Results are cached for reloads of the page.
    """

    def __init__(self) -> None:
        self._workers = Workers(_outline_process.__name__, 1, "outline searches")
        self._turn = asyncio.Semaphore(1)
        self._pending = 0
        self._outlines: dict[bytes, str] = {}

    async def run(self, request: OutlineRequest, data: bytes) -> AsyncIterator[str]:
        """Yield progress messages, one per line; closing the iterator cancels the search."""
        key = sha256(request.model_dump_json().encode() + data).digest()
        if key in self._outlines:
            yield self._outlines[key]
            return
        if self._pending >= MAX_QUEUED_JOBS:
            yield _status("failed", "too many outline searches are queued; try again later")
            return
        self._pending += 1
        try:
            if self._turn.locked():
                yield _status("waiting", "Waiting for another outline search")
            async with self._turn, self._workers.one() as worker:
                last = ""
                await asyncio.to_thread(worker.send, request.model_dump_json(), data)
                async for line in worker.lines():
                    last = line
                    yield line
                if '"state":"done"' in last:
                    if len(self._outlines) >= MAX_CACHED_OUTLINES:
                        self._outlines.clear()
                    self._outlines[key] = last
                elif '"state":"failed"' not in last:
                    yield _status(
                        "failed", f"the outline search in {request.name} was interrupted; try again"
                    )
        finally:
            self._pending -= 1


def _status(state: Literal["waiting", "failed"], message: str) -> str:
    return OutlineSearchStatus(state=state, message=message).model_dump_json() + "\n"


# -- Pool of board detection processes -------------------------------------------------------------

MAX_SIMULTANEOUS = 2
IDLE_S = 60.0
"""Idle time after which a worker process is terminated, s."""


class BoardDetectorPool:
    """Pool of board detection processes, each with one image at a time; started on demand."""

    def __init__(self) -> None:
        self._turn = asyncio.Semaphore(MAX_SIMULTANEOUS)
        self._idle: list[Popen[bytes]] = []
        self._pending = 0
        self._letting_go: asyncio.TimerHandle | None = None

    async def look(
        self, message: BoardDetectionRequest, data: bytes, request: Request
    ) -> BoardDetection:
        """Detect the board in an image; a disconnect of the client cancels the search.

        Raises
        ------
        ServerBusy
            If there are too many queued requests.
        OmnimirrorError
            If the image is unreadable, or the board is invalid.
        """
        if self._pending >= MAX_QUEUED_JOBS:
            raise ServerBusy("too many board detections are queued; try again later")
        self._pending += 1
        if self._letting_go is not None:
            self._letting_go.cancel()
        try:
            async with self._turn:
                answer = await self._answer(message, data, request)
        finally:
            self._pending -= 1
            if not self._pending:
                self._letting_go = asyncio.get_running_loop().call_later(IDLE_S, self.close)
        if answer.startswith(b'{"detail"'):
            raise InvalidParameter(Problem.model_validate_json(answer).detail)
        return BoardDetection.model_validate_json(answer)

    def close(self) -> None:
        """Terminate the idle processes."""
        while self._idle:
            terminate_process(self._idle.pop())

    async def _answer(self, message: BoardDetectionRequest, data: bytes, request: Request) -> bytes:
        process = (
            self._idle.pop() if self._idle else start_process(_board_detection_process.__name__)
        )
        detection = asyncio.create_task(asyncio.to_thread(_detected, process, message, data))
        disconnection = asyncio.create_task(_disconnected(request))
        answer = b""
        try:
            await asyncio.wait({detection, disconnection}, return_when=asyncio.FIRST_COMPLETED)
            answer = detection.result() if detection.done() else b""
        finally:
            disconnection.cancel()
            if answer:
                self._idle.append(process)
            else:
                terminate_process(process)  # also ends the thread that waits for its answer
        if not answer:
            raise InvalidParameter(
                f"the board detection in {message.name} was interrupted; try again"
            )
        return answer


def _detected(process: Popen[bytes], message: BoardDetectionRequest, data: bytes) -> bytes:
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(OSError, ValueError):  # terminated in the meantime
        process.stdin.write(b"%s\n%d\n" % (message.model_dump_json().encode(), len(data)))
        process.stdin.write(data)
        process.stdin.flush()
        return process.stdout.readline()
    return b""


async def _disconnected(request: Request) -> None:
    """Wait until the client disconnects."""
    while (await request.receive())["type"] != "http.disconnect":
        continue
