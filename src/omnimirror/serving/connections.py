"""Connections that are let go: those that do not say what they want, and those that do not take what they asked for."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0
"""How long the head of a request may take."""
STUCK_S = 60.0
"""How long a full buffer may wait for its reader."""
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
            waiting = [c for c in self.connections if isinstance(c, Connection) and c.is_silent]
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
        return self._head.when() if self._head is not None else 0.0

    def _wait_for_head(self) -> None:
        self._head = self.loop.call_later(HEAD_S, self._give_up)

    def _have_head(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None

    def _give_up(self) -> None:
        if self.is_silent:
            self.transport.abort()


@cache
def most_connections() -> int:
    """As many as there may be open files, and no more than :data:`MOST`."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows has no such bound
        return MOST
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST if soft == resource.RLIM_INFINITY else max(8, min(MOST, soft - SPARE_FILES))
