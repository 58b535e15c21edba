"""Connections that are let go: those that do not say what they want, and those that do not take what they asked for."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

HEAD_S = 10.0
"""How long the head of a request may take."""
STUCK_S = 60.0
"""How long a full buffer may wait for its reader."""
IDLE_S = 1800.0
"""How long a WebSocket may be open without a message in either direction."""
GOING_AWAY, NOT_TEXT = 1001, 1007
MOST = 256
"""Connections at once."""
SPARE_FILES = 64
"""Open files that are not connections, or not looked at yet."""


class Connection(H11Protocol):
    """An HTTP connection with ends to its patience; of too many the one that has been silent longest goes.

    ``limit_concurrency`` of uvicorn's counts those that are waited for too, and would turn away who comes last.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._head: asyncio.TimerHandle | None = None
        self._stuck: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait_for_head()
        if len(self.connections) > most_connections():
            waiting = [c for c in self.connections if isinstance(c, Connection | Socket) and c.is_silent]
            longest = min(waiting, key=lambda c: c.since, default=self)
            self.connections.discard(longest)  # it goes a moment later, and is not to be chosen again until then
            longest.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._head, self._stuck):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self.is_silent:
            self._have_head()
        elif self._head is None:  # another request begins
            self._wait_for_head()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._stuck = self.loop.call_later(STUCK_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._stuck is not None:
            self._stuck.cancel()

    @property
    def is_silent(self) -> bool:
        """Whether it has not said yet what it wants."""
        return self.conn.their_state is h11.IDLE

    @property
    def since(self) -> float:
        """When it was last known to want something."""
        return self._head.when() - HEAD_S if self._head is not None else 0.0

    def _wait_for_head(self) -> None:
        self._head = self.loop.call_later(HEAD_S, self._give_up)

    def _have_head(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None

    def _give_up(self) -> None:
        if self.is_silent:
            self.transport.abort()


class Socket(WebSocketsSansIOProtocol):
    """WebSocket that is closed when it has been idle for long; among too many connections the first idle one goes."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self.since = self.loop.time()
        self._is_new = True
        self._idle = self.loop.call_later(IDLE_S, self._check_idle)

    def connection_lost(self, exc: Exception | None) -> None:
        self._idle.cancel()
        self.connections.add(self)  # which may have been chosen to go, and is removed here
        super().connection_lost(exc)

    @property
    def is_silent(self) -> bool:
        """Whether no message has passed yet, or none of late."""
        return self._is_new or self.loop.time() - self.since > HEAD_S

    def send_receive_event_to_app(self) -> None:
        self._pass_message()
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:  # the base class would log a traceback
                self._end(NOT_TEXT, "text must be UTF-8")
                return
        super().send_receive_event_to_app()

    async def send(self, message: Any) -> None:
        if message["type"] == "websocket.send":
            self._pass_message()
        await super().send(message)

    def _pass_message(self) -> None:
        self.since, self._is_new = self.loop.time(), False

    def _check_idle(self) -> None:
        left_s = self.since + IDLE_S - self.loop.time()
        if left_s > 0:
            self._idle = self.loop.call_later(left_s, self._check_idle)
        elif not self.close_sent:
            self._end(GOING_AWAY, "no message for long")

    def _end(self, code: int, reason: str) -> None:
        self.frames = []
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.conn.send_close(code, reason)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.transport.close()


@cache
def most_connections() -> int:
    """As many as there may be open files, and no more than :data:`MOST`."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows has no such bound
        return MOST
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST if soft == resource.RLIM_INFINITY else max(8, min(MOST, soft - SPARE_FILES))
