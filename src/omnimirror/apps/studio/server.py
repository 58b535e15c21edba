"""Studio server process, run until Ctrl-C."""

from __future__ import annotations

import secrets
import threading
import webbrowser
from collections.abc import Callable

from ...interop.http_server.auth import is_loopback
from ...interop.http_server.server import listen, run_server, server_addresses
from .app import create_app
from .studio import Studio


def serve(studio: Studio, host: str, port: int, open_browser: bool, tell: Callable[[str], None]) -> None:
    """Serve the studio, print its address, and open it.

    Parameters
    ----------
    studio
        Studio to be served; reachable from other machines only with the token in the printed
        address.
    host, port
        Network address; port 0 selects a free port.
    open_browser
        Whether to open the page.
    tell
        Callback for the message with the address.

    Raises
    ------
    OmnimirrorError
        The address is not available.
    KeyboardInterrupt
        Ended by Ctrl-C.
    """
    if not is_loopback(host):
        studio.token = secrets.token_urlsafe(16)
    listening = listen(host, port)
    bound = listening.getsockname()[1]
    query = f"?token={studio.token}" if studio.token else ""
    addresses = [f"http://{name}:{bound}/{query}" for name in server_addresses(host)]
    tell(f"omnimirror studio at {' or '.join(addresses)} (Ctrl-C ends it)")
    if open_browser:
        threading.Timer(0.3, webbrowser.open, (addresses[-1],)).start()
    run_server(create_app(studio), listening)
