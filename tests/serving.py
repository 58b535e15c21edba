"""A server that runs in a thread, for as long as a test asks it something."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from starlette.types import ASGIApp

from omnimirror.serving.server import Server, configured, listen


@contextmanager
def served(app: ASGIApp, port: int = 0) -> Iterator[str]:
    """The address of a running server."""
    server, listening = Server(configured(app, "error")), listen("127.0.0.1", port)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.01)
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
    finally:
        time.sleep(0.2)  # its ends of the last connections close a moment after ours
        server.should_exit = True
        thread.join()
