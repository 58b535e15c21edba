"""Board detection in uploaded images by worker processes, because one image can take seconds."""

from __future__ import annotations

import asyncio
import subprocess
from contextlib import suppress

from fastapi import Request

from ....base.errors import InvalidParameter
from ....interop.http_server.limits import MAX_QUEUED_JOBS, ServerBusy
from ..messages import Problem
from ..workers import begun, ended
from . import board_process
from .messages import BoardLook, BoardSeen

MOST_AT_ONCE = 2
IDLE_S = 60.0
"""Idle time after which a worker process is terminated, s."""


class Lookers:
    """Pool of board detection processes, each with one image at a time; started on demand."""

    def __init__(self) -> None:
        self._turn = asyncio.Semaphore(MOST_AT_ONCE)
        self._idle: list[subprocess.Popen[bytes]] = []
        self._asked = 0
        self._letting_go: asyncio.TimerHandle | None = None

    async def look(self, ask: BoardLook, data: bytes, request: Request) -> BoardSeen:
        """Detect the board in an image; a disconnect of the client cancels the search.

        Raises
        ------
        ServerBusy
            Too many queued requests.
        OmnimirrorError
            Unreadable image or invalid board.
        """
        if self._asked >= MAX_QUEUED_JOBS:
            raise ServerBusy("more pictures are looked at than can be waited for; try again in a while")
        self._asked += 1
        if self._letting_go is not None:
            self._letting_go.cancel()
        try:
            async with self._turn:
                answer = await self._answer(ask, data, request)
        finally:
            self._asked -= 1
            if not self._asked:
                self._letting_go = asyncio.get_running_loop().call_later(IDLE_S, self.close)
        if answer.startswith(b'{"detail"'):
            raise InvalidParameter(Problem.model_validate_json(answer).detail)
        return BoardSeen.model_validate_json(answer)

    def close(self) -> None:
        """Terminate the idle processes."""
        while self._idle:
            ended(self._idle.pop())

    async def _answer(self, ask: BoardLook, data: bytes, request: Request) -> bytes:
        looker = self._idle.pop() if self._idle else begun(board_process.__name__)
        asked = asyncio.create_task(asyncio.to_thread(_asked, looker, ask, data))
        gone = asyncio.create_task(_gone(request))
        answer = b""
        try:
            await asyncio.wait({asked, gone}, return_when=asyncio.FIRST_COMPLETED)
            answer = asked.result() if asked.done() else b""
        finally:
            gone.cancel()
            if answer:
                self._idle.append(looker)
            else:
                ended(looker)  # also ends the thread that waits for its answer
        if not answer:
            raise InvalidParameter(f"looking at {ask.name} was cut off; try again")
        return answer


def _asked(looker: subprocess.Popen[bytes], ask: BoardLook, data: bytes) -> bytes:
    assert looker.stdin is not None
    assert looker.stdout is not None
    with suppress(OSError, ValueError):  # terminated in the meantime
        looker.stdin.write(b"%s\n%d\n" % (ask.model_dump_json().encode(), len(data)))
        looker.stdin.write(data)
        looker.stdin.flush()
        return looker.stdout.readline()
    return b""


async def _gone(request: Request) -> None:
    """Wait until the client disconnects."""
    while (await request.receive())["type"] != "http.disconnect":
        continue
