"""Run a server until Ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import uvicorn
from starlette.types import ASGIApp

from ...errors import OmnimirrorError
from .access import is_loopback
from .connections import Connection, Socket
from .limits import LARGEST_MESSAGE

EVERYWHERE = ("0.0.0.0", "::", "")
"""Where a server listens that does not say where."""
HANGUP: Any = getattr(signal, "SIGHUP", None)
"""None on Windows."""
QUEUE = 256
"""Connections that wait to be accepted."""
AT_A_TIME = 8
"""Connections that are accepted before the first of them is looked at; a flood of them would take all open files."""


LAST_ROUNDS = 3
"""Of the event loop, in which connections that were just being accepted come to light."""


class Server(uvicorn.Server):
    """Says nothing of what Ctrl-C cuts off, such as half an upload, and knows that it was Ctrl-C.

    Connections that do not end in time are cut off: their sockets would stay open in a process that goes on.
    """

    interrupted = False

    hung_up = False

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """End at SIGHUP too, of a closed terminal, unless it is ignored; like the others it is raised again then."""
        before = signal.getsignal(HANGUP) if HANGUP is not None else None
        if threading.current_thread() is not threading.main_thread() or before in (None, signal.SIG_IGN):
            with super().capture_signals():
                yield
            return
        signal.signal(HANGUP, self._hang_up)
        try:
            with super().capture_signals():
                yield
        finally:
            signal.signal(HANGUP, before)
        if self.hung_up:
            signal.raise_signal(HANGUP)

    def _hang_up(self, sig: int, frame: FrameType | None) -> None:
        self.hung_up = self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.interrupted |= sig == signal.SIGINT
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listening in sockets or ():
            listening.listen(QUEUE)  # which the event loop made as short as what it accepts at a time

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)
        for _ in range(LAST_ROUNDS):
            for connection in list(self.server_state.connections):
                connection.transport.abort()
            await asyncio.sleep(0)


def run(app: ASGIApp, listening: socket.socket) -> None:
    """Serve until a signal says otherwise.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C ended it.
    """
    server = Server(configured(app))
    try:
        server.run(sockets=[listening])
    finally:
        listening.close()
    if server.interrupted:  # a job that a script started ignores the signal that the server hands on
        raise KeyboardInterrupt


def configured(app: ASGIApp, log_level: str = "warning") -> uvicorn.Config:
    """How a server runs, with its limits."""
    return uvicorn.Config(
        app,
        log_level=log_level,
        http=Connection,
        ws=Socket,
        ws_max_size=LARGEST_MESSAGE,
        ws_per_message_deflate=False,  # pictures are coded already, and would be once more for every page that watches
        backlog=AT_A_TIME,
        timeout_graceful_shutdown=1,
    )


def names_of(host: str) -> list[str]:
    """The names under which a server can be opened, in addresses; the last one from this machine.

    One that listens everywhere has each of this machine's addresses, as far as they can be told.

    >>> names_of("127.0.0.1"), names_of("::1")
    (['127.0.0.1'], ['[::1]'])
    """
    if host not in EVERYWHERE:
        return [f"[{host}]" if ":" in host else host]
    found = {_towards(socket.AF_INET, "192.0.2.1")}
    if host == "::":
        found.add(_towards(socket.AF_INET6, "2001:db8::1"))
    with suppress(OSError):
        found |= {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    real = sorted(address for address in found if address and not is_loopback(address))
    return [f"[{a}]" if ":" in a else a for a in real] + ["127.0.0.1"]


def _towards(family: socket.AddressFamily, documented: str) -> str | None:
    """The address from which this machine would reach others; nothing is sent."""
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((documented, 9))
        except OSError:
            return None
        return str(probe.getsockname()[0])


def listen(host: str, port: int) -> socket.socket:
    """A socket whose address can be opened from here on; port 0 is any that is free.

    Raises
    ------
    OmnimirrorError
        The address cannot be listened on.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Only where the protocol is named does an event loop send what it has at once. An answer is its head and then its
    # body, and one that waits for the head to be acknowledged comes 40 ms late on every connection that is kept.
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(QUEUE)
    except (OSError, OverflowError) as e:
        listening.close()
        reason = getattr(e, "strerror", None) or str(e)
        raise OmnimirrorError(f"cannot listen on {host}, port {port}: {reason}") from None
    return listening
