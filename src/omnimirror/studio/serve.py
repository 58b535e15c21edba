"""Run the server until Ctrl-C."""

from __future__ import annotations

import logging
import secrets
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable
from types import FrameType

import uvicorn

from ..errors import OmnimirrorError
from .access import is_loopback
from .app import Studio, create_app


class _Server(uvicorn.Server):
    """Says nothing of what Ctrl-C cuts off, such as half an upload, and knows that it was Ctrl-C."""

    interrupted = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.interrupted |= sig == signal.SIGINT
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)


def serve(studio: Studio, host: str, port: int, open_browser: bool, tell: Callable[[str], None]) -> None:
    """Serve the studio, print its address, and open it.

    Parameters
    ----------
    studio
        What to show; beyond this machine it gets a token, which the printed address holds.
    host, port
        Where to listen; port 0 takes any that is free.
    open_browser
        Whether to open the page.
    tell
        Told the address, in a sentence.

    Raises
    ------
    OmnimirrorError
        The address cannot be listened on.
    KeyboardInterrupt
        Ctrl-C ended it.
    """
    if not is_loopback(host):
        studio.token = secrets.token_urlsafe(16)
    listening = _listen(host, port)
    bound = listening.getsockname()[1]
    shown = f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{bound}/" + (f"?token={studio.token}" if studio.token else "")
    config = uvicorn.Config(
        create_app(studio),
        log_level="warning",
        ws="websockets-sansio",
        ws_max_size=1 << 20,
        timeout_graceful_shutdown=1,
    )
    tell(f"omnimirror studio at {address} (Ctrl-C ends it)")
    if open_browser:
        threading.Timer(0.3, webbrowser.open, (address,)).start()
    server = _Server(config)
    try:
        server.run(sockets=[listening])
    finally:
        listening.close()
    if server.interrupted:  # a job that a script started ignores the signal that the server hands on
        raise KeyboardInterrupt


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
    except (OSError, OverflowError) as e:
        listening.close()
        reason = getattr(e, "strerror", None) or str(e)
        raise OmnimirrorError(f"cannot listen on {host}, port {port}: {reason}") from None
    return listening
