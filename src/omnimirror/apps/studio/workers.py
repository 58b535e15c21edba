"""What takes time runs in processes of its own, which sliders do not feel and which can be ended at any moment.

Such a process reads what it is to do from its input, a line each, and writes its news, a line each.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import IO, Any

from fastapi import WebSocket, WebSocketDisconnect

from ...base.errors import InvalidParameter


def begun(module: str) -> subprocess.Popen[bytes]:
    """A module as a process that Ctrl-C at the server does not reach."""
    return subprocess.Popen(
        [sys.executable, "-m", module], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )


def ended(process: subprocess.Popen[bytes]) -> None:
    """End a process, and let go of what it read and wrote."""
    process.kill()
    process.wait()  # which a killed process does not make long
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # what it was told last may not have reached it
            stream.close()  # type: ignore[union-attr]


async def while_open(socket: WebSocket, work: Callable[[WebSocket], Awaitable[None]]) -> None:
    """Answer a socket until either end has had enough."""
    await socket.accept()
    with suppress(WebSocketDisconnect, RuntimeError, OSError):
        await work(socket)


class Worker:
    """A process at work."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def tell(self, line: str) -> None:
        """Give it a line more; one that has ended needs none."""
        stdin: IO[bytes] | None = self._process.stdin
        assert stdin is not None
        with suppress(OSError):
            stdin.write(line.encode() + b"\n")
            stdin.flush()

    async def lines(self) -> AsyncIterator[str]:
        """Its news."""
        stdout = self._process.stdout
        assert stdout is not None
        while line := await asyncio.to_thread(stdout.readline):
            yield line.decode()


class Workers:
    """Processes at work, never too many.

    Parameters
    ----------
    module
        What they run.
    most
        How many at once.
    what
        They do, in the plural, for who has to wait.
    """

    def __init__(self, module: str, most: int, what: str) -> None:
        self.module, self.most, self.what = module, most, what
        self._running = 0

    @asynccontextmanager
    async def one(self) -> AsyncIterator[Worker]:
        """A worker; leaving the block ends it.

        Raises
        ------
        InvalidParameter
            Too many are at work.
        """
        if self._running >= self.most:
            raise InvalidParameter(f"{self.most} {self.what} are running already; wait for one of them, or cancel it")
        self._running += 1
        process = begun(self.module)
        try:
            yield Worker(process)
        finally:
            self._running -= 1
            ended(process)


async def relay(worker: Worker, socket: WebSocket, listening: asyncio.Task[Any]) -> None:
    """Send a worker's news to a page, until there are no more or the page has gone, which ends ``listening``."""
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
