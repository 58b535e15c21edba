"""Worker processes for long-running tasks; they do not delay interactive requests and can be
cancelled at any time.

A worker reads its task from standard input and writes its progress, one message per line.
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
    """Start a module as a process that is isolated from Ctrl-C at the server."""
    return subprocess.Popen(
        [sys.executable, "-m", module], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )


def ended(process: subprocess.Popen[bytes]) -> None:
    """Terminate a process and close its pipes."""
    process.kill()
    process.wait()  # short, because the process is killed
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # the last input may not have been delivered
            stream.close()  # type: ignore[union-attr]


async def while_open(socket: WebSocket, work: Callable[[WebSocket], Awaitable[None]]) -> None:
    """Serve a socket until either side closes it."""
    await socket.accept()
    with suppress(WebSocketDisconnect, RuntimeError, OSError):
        await work(socket)


class Worker:
    """Running worker process."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def tell(self, line: str) -> None:
        """Send a line to the process; ignored after its end."""
        stdin: IO[bytes] | None = self._process.stdin
        assert stdin is not None
        with suppress(OSError):
            stdin.write(line.encode() + b"\n")
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
    most
        Maximum number of simultaneous processes.
    what
        Plural noun for their tasks, used in the error message.
    """

    def __init__(self, module: str, most: int, what: str) -> None:
        self.module, self.most, self.what = module, most, what
        self._running = 0

    @asynccontextmanager
    async def one(self) -> AsyncIterator[Worker]:
        """Yield a worker; leaving the block terminates it.

        Raises
        ------
        InvalidParameter
            Too many active workers.
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
