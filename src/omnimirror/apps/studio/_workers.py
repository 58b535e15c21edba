"""Worker processes for long-running tasks and for board detection."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from hashlib import sha256
from subprocess import Popen
from typing import IO, Literal

from fastapi import Request, WebSocket, WebSocketDisconnect
from pydantic import BaseModel

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.worker_processes import start_process, terminate_process
from ...interop.http_server.limits import MAX_QUEUED_JOBS, FairSlots, ServerBusy, current_page
from ...interop.http_server.request_bodies import InvalidMessage, close_invalid
from . import _board_detection_process, _outline_process, _restoration_process
from ._outline_process import OutlineRequest
from ._restoration_process import RestorationTask
from .calibration_messages import BoardDetection, BoardDetectionRequest
from .look_messages import ImageTaskStatus
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
        """Yield the output lines up to an empty one or the end."""
        stdout = self._process.stdout
        assert stdout is not None
        while (line := await asyncio.to_thread(stdout.readline)) not in (b"", b"\n"):
            yield line.decode()

    async def remainder(self) -> bytes:
        """Return the output after the empty line."""
        stdout = self._process.stdout
        assert stdout is not None
        return await asyncio.to_thread(stdout.read)


class Workers:
    """Limited number of worker processes; further tasks wait in the order of their requests.

    Parameters
    ----------
    module
        Module to run.
    max_workers
        Maximum number of simultaneous processes.
    tasks
        Plural noun for their tasks, used in messages.
    """

    def __init__(self, module: str, max_workers: int, tasks: str) -> None:
        self.module, self.tasks = module, tasks
        self._slots = FairSlots(max_workers)
        self._pending = 0

    @property
    def is_busy(self) -> bool:
        """True if the next task has to wait."""
        return self._slots.is_full

    @asynccontextmanager
    async def worker(self) -> AsyncIterator[Worker]:
        """Wait for a worker and yield it; leaving the block terminates it.

        Raises
        ------
        ServerBusy
            If there are too many waiting tasks.
        """
        if self._pending >= MAX_QUEUED_JOBS:
            raise ServerBusy(f"too many {self.tasks} are queued; try again later")
        self._pending += 1
        try:
            async with self._slots.slot(current_page.get()):
                process = start_process(self.module)
                try:
                    yield Worker(process)
                finally:
                    terminate_process(process)
        finally:
            self._pending -= 1


async def run_task(
    socket: WebSocket,
    workers: Workers,
    lines: Sequence[str],
    waiting: str,
    commands: Sequence[str] = (),
) -> bytes:
    """Run a task in a worker, forward its progress messages to a page, and return its remaining
    output.

    Parameters
    ----------
    socket
        Connection to the page.
    workers
        Worker processes of the task.
    lines
        Input of the worker.
    waiting
        Message that is sent if the task has to wait.
    commands
        Messages of the page that are forwarded to the worker.

    Raises
    ------
    ServerBusy
        If there are too many waiting tasks.
    WebSocketDisconnect
        After a disconnect of the page, which also cancels a waiting task.
    """
    started: list[Worker] = []

    async def listen() -> None:
        while (message := await socket.receive())["type"] != "websocket.disconnect":
            if message.get("text") in commands and started:
                started[0].send(message["text"])

    async def work() -> bytes:
        if workers.is_busy:
            await socket.send_text(waiting)
        async with workers.worker() as worker:
            started.append(worker)
            for line in lines:
                await asyncio.to_thread(worker.send, line)
            async for line in worker.lines():
                await socket.send_text(line)
            return await worker.remainder()

    listening, working = asyncio.create_task(listen()), asyncio.create_task(work())
    try:
        await asyncio.wait({listening, working}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise WebSocketDisconnect
        return working.result()
    finally:
        for task in (listening, working):
            task.cancel()


async def serve_task(
    socket: WebSocket,
    workers: Workers,
    receive: Callable[[WebSocket], Awaitable[Sequence[BaseModel]]],
    status: Callable[[Literal["waiting", "failed"], str], BaseModel],
    commands: Sequence[str] = (),
) -> None:
    """Receive a task from a page, run it in a worker, send its progress and output, and close.

    Parameters
    ----------
    socket
        Connection to the page.
    workers
        Worker processes of the task.
    receive
        Returns the messages that define the task.
    status
        Creates a progress message from state and text.
    commands
        Messages of the page that are forwarded to the worker.
    """
    try:
        lines = [message.model_dump_json() for message in await receive(socket)]
        waiting = status("waiting", f"Waiting for other {workers.tasks}")
        data = await run_task(socket, workers, lines, waiting.model_dump_json(), commands)
        if data:
            await socket.send_bytes(data)
    except InvalidMessage as e:
        await close_invalid(socket, e)
        return
    except OmnimirrorError as e:
        await socket.send_text(status("failed", str(e)).model_dump_json())
    await socket.close()


# -- Tasks with an image ---------------------------------------------------------------------------

MAX_CACHED_OUTLINES = 256
"""Maximum number of cached outlines, about 100 bytes each; a full cache is cleared."""


class OutlineSearches:
    """Outline searches in worker processes, one at a time.

    Results are cached for reloads of the page.
    """

    def __init__(self) -> None:
        self._workers = Workers(_outline_process.__name__, 1, "outline searches")
        self._outlines: dict[bytes, bytes] = {}

    async def run(self, request: OutlineRequest, data: bytes) -> AsyncIterator[bytes]:
        """Yield progress messages, one per line; closing the iterator cancels the search."""
        key = sha256(request.model_dump_json().encode() + data).digest()
        if key in self._outlines:
            yield self._outlines[key]
            return
        line = b""
        async for line in _output(self._workers, request, data):
            yield line
        if _is_done(line):
            if len(self._outlines) >= MAX_CACHED_OUTLINES:
                self._outlines.clear()
            self._outlines[key] = line


class Restorations:
    """Restorations in worker processes, one at a time."""

    def __init__(self) -> None:
        self._workers = Workers(_restoration_process.__name__, 1, "restorations")

    def run(self, task: RestorationTask, data: bytes) -> AsyncIterator[bytes]:
        """Yield progress messages, one per line, and after an empty line the restored image.

        Closing the iterator cancels the restoration.
        """
        return _output(self._workers, task, data)


async def _output(workers: Workers, task: BaseModel, data: bytes) -> AsyncIterator[bytes]:
    """Yield the progress messages of a task, one per line, and its file, if any, after an empty
    line; closing the iterator terminates the worker.
    """
    if workers.is_busy:
        yield _status("waiting", f"Waiting for other {workers.tasks}")
    line = b""
    try:
        async with workers.worker() as worker:
            await asyncio.to_thread(worker.send, task.model_dump_json(), data)
            async for text in worker.lines():
                line = text.encode()
                yield line
            if file := await worker.remainder():
                yield b"\n"
                yield file
    except ServerBusy as e:
        yield _status("failed", str(e))
        return
    if not _is_done(line) and b'"state":"failed"' not in line:
        yield _status("failed", "the server interrupted the task; try again")


def _is_done(line: bytes) -> bool:
    return b'"state":"done"' in line


def _status(state: Literal["waiting", "failed"], message: str) -> bytes:
    return ImageTaskStatus(state=state, message=message).model_dump_json().encode() + b"\n"


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
