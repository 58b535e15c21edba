"""Server and connections: start, stop, timeouts and the limit on connections."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from types import FrameType
from typing import Any

import h11
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from ...base.errors import OmnimirrorError
from .auth import is_loopback
from .limits import MAX_MESSAGE_BYTES

REQUEST_TIMEOUT_S = 10.0
"""Maximum time for the header of a request."""
WRITE_TIMEOUT_S = 60.0
"""Maximum time for which a full write buffer waits for its client."""
IDLE_TIMEOUT_S = 1800.0
"""Maximum time without a WebSocket message in either direction."""
CLOSE_GOING_AWAY, CLOSE_INVALID_PAYLOAD = 1001, 1007
MAX_CONNECTIONS = 256
RESERVED_FILES = 64
"""Open files that are not counted as connections."""
ANY_ADDRESS = ("0.0.0.0", "::", "")
HANGUP: Any = getattr(signal, "SIGHUP", None)
"""Signal of a closed terminal; None on Windows."""
BACKLOG = 256
"""Connections waiting to be accepted."""
ACCEPTS_PER_CYCLE = 8
"""Connections accepted per cycle of the event loop; a flood would exhaust the open files."""
SHUTDOWN_CYCLES = 3
"""Cycles of the event loop after which accepted connections are registered."""

# -- connections ---------------------------------------------------------------------------------


class HttpConnection(H11Protocol):
    """HTTP connection with timeouts for the request head and for writing.

    If there are too many connections, the one that has been idle longest is closed. In contrast,
    ``limit_concurrency`` of uvicorn counts idle connections and refuses new ones.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._head_timer: asyncio.TimerHandle | None = None
        self._write_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # narrower type, as in uvicorn
        super().connection_made(transport)
        self._start_head_timer()
        if len(self.connections) > connection_limit():
            kinds = HttpConnection | WebSocketConnection
            idle = [c for c in self.connections if isinstance(c, kinds) and c.is_idle]
            oldest = min(idle, key=lambda c: c.idle_since, default=self)
            self.connections.discard(oldest)  # it closes later and must not be chosen again
            oldest.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._head_timer, self._write_timer):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self.is_idle:
            self._stop_head_timer()
        elif self._head_timer is None:  # the next request begins
            self._start_head_timer()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._write_timer = self.loop.call_later(WRITE_TIMEOUT_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._write_timer is not None:
            self._write_timer.cancel()

    @property
    def is_idle(self) -> bool:
        """True until a complete request head has been received."""
        return self.conn.their_state is h11.IDLE

    @property
    def idle_since(self) -> float:
        """Time of the start of the current request head."""
        if self._head_timer is None:
            return 0.0
        return self._head_timer.when() - REQUEST_TIMEOUT_S

    def _start_head_timer(self) -> None:
        self._head_timer = self.loop.call_later(REQUEST_TIMEOUT_S, self._abort_if_idle)

    def _stop_head_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _abort_if_idle(self) -> None:
        if self.is_idle:
            self.transport.abort()


class WebSocketConnection(WebSocketsSansIOProtocol):
    """WebSocket that is closed after a long time without messages."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self.idle_since = self.loop.time()
        self._is_new = True
        self._idle_timer = self.loop.call_later(IDLE_TIMEOUT_S, self._check_idle)

    def connection_lost(self, exc: Exception | None) -> None:
        self._idle_timer.cancel()
        self.connections.add(self)  # HttpConnection can have discarded it; the base class removes
        super().connection_lost(exc)

    @property
    def is_idle(self) -> bool:
        """True if there has been no message, or none recently."""
        return self._is_new or self.loop.time() - self.idle_since > REQUEST_TIMEOUT_S

    def send_receive_event_to_app(self) -> None:
        self._record_message()
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:  # the base class would log a traceback
                self._close(CLOSE_INVALID_PAYLOAD, "text must be UTF-8")
                return
        super().send_receive_event_to_app()

    async def send(self, message: Any) -> None:
        if message["type"] == "websocket.send":
            self._record_message()
        await super().send(message)

    def _record_message(self) -> None:
        self.idle_since, self._is_new = self.loop.time(), False

    def _check_idle(self) -> None:
        remaining_s = self.idle_since + IDLE_TIMEOUT_S - self.loop.time()
        if remaining_s > 0:
            self._idle_timer = self.loop.call_later(remaining_s, self._check_idle)
        elif not self.close_sent:
            self._close(CLOSE_GOING_AWAY, "idle timeout")

    def _close(self, code: int, reason: str) -> None:
        self.frames = []
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.conn.send_close(code, reason)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.transport.close()


@cache
def connection_limit() -> int:
    """Return the maximum number of connections, given the limit on open files."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows has no such limit
        return MAX_CONNECTIONS
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    return max(8, min(MAX_CONNECTIONS, soft - RESERVED_FILES))


# -- server --------------------------------------------------------------------------------------


class Server(uvicorn.Server):
    """Server that stops quietly on Ctrl-C and SIGHUP and records which signal stopped it.

    Connections that do not close in time are aborted; otherwise their sockets would remain open
    in a process that continues.
    """

    interrupted = False
    hung_up = False

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Handle SIGHUP as a stop signal unless it is ignored; the signal is raised again afterwards."""
        previous = signal.getsignal(HANGUP) if HANGUP is not None else None
        is_main = threading.current_thread() is threading.main_thread()
        if not is_main or previous in (None, signal.SIG_IGN):
            with super().capture_signals():
                yield
            return
        signal.signal(HANGUP, self._handle_hangup)
        try:
            with super().capture_signals():
                yield
        finally:
            signal.signal(HANGUP, previous)
        if self.hung_up:
            signal.raise_signal(HANGUP)

    def _handle_hangup(self, sig: int, frame: FrameType | None) -> None:
        self.hung_up = self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.interrupted |= sig == signal.SIGINT
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(BACKLOG)  # the event loop has set it to ACCEPTS_PER_CYCLE

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)
        for _ in range(SHUTDOWN_CYCLES):
            for connection in list(self.server_state.connections):
                connection.transport.abort()
            await asyncio.sleep(0)


def run_server(app: ASGIApp, listener: socket.socket) -> None:
    """Serve until a signal arrives.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C.
    """
    server = Server(server_config(app))
    try:
        server.run(sockets=[listener])
    finally:
        listener.close()
    if server.interrupted:  # background jobs of scripts ignore the signal that uvicorn raises again
        raise KeyboardInterrupt


def server_config(app: ASGIApp, log_level: str = "warning") -> uvicorn.Config:
    """Return the configuration of a server with its limits."""
    return uvicorn.Config(
        app,
        log_level=log_level,
        http=HttpConnection,
        ws=WebSocketConnection,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,  # images are compressed already
        backlog=ACCEPTS_PER_CYCLE,
        timeout_graceful_shutdown=1,
    )


def server_addresses(host: str) -> list[str]:
    """Return the host names for URLs of a server; the last one is valid on this machine.

    A server that listens on any address has all known addresses of this machine.

    >>> server_addresses("127.0.0.1"), server_addresses("::1")
    (['127.0.0.1'], ['[::1]'])
    """
    if host not in ANY_ADDRESS:
        return [f"[{host}]" if ":" in host else host]
    candidates = {_outgoing_address(socket.AF_INET, "192.0.2.1")}
    if host == "::":
        candidates.add(_outgoing_address(socket.AF_INET6, "2001:db8::1"))
    with suppress(OSError):
        infos = socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        candidates |= {str(info[4][0]) for info in infos}
    external = sorted(a for a in candidates if a and not is_loopback(a))
    return [f"[{a}]" if ":" in a else a for a in external] + ["127.0.0.1"]


def _outgoing_address(family: socket.AddressFamily, remote: str) -> str | None:
    """Return the local address of a route to a documentation address; no packet is sent."""
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((remote, 9))
        except OSError:
            return None
        return str(probe.getsockname()[0])


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket; port 0 selects a free port.

    Raises
    ------
    OmnimirrorError
        If the address is not available.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio disables Nagle's algorithm only for sockets with an explicit protocol. Otherwise the
    # body of a response waits 40 ms for the acknowledgement of its header.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except (OSError, OverflowError) as e:
        listener.close()
        reason = getattr(e, "strerror", None) or str(e)
        raise OmnimirrorError(f"cannot listen on {host}, port {port}: {reason}") from None
    return listener
