"""Ctrl-C that waits for a safe moment.

Python raises KeyboardInterrupt between any two steps of the main thread, also while it holds the lock of a
queue that it shares with other threads, which then wait for ever. Work that is shared among threads asks
from time to time instead.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

POLL_S = 0.1  # how long anything waits before it asks again

_pending = threading.Event()


@contextmanager
def deferred() -> Iterator[None]:
    """Within the block Ctrl-C is noted and not raised; a second one is raised at once.

    Outside the main thread, to which Ctrl-C never comes, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    _pending.clear()
    signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _pending.clear()


def is_pending() -> bool:
    """Whether Ctrl-C was pressed and not answered yet."""
    return _pending.is_set()


def request() -> None:
    """Do as Ctrl-C does, from any thread."""
    _pending.set()


def _note(number: int, frame: FrameType | None) -> None:
    if _pending.is_set():
        raise KeyboardInterrupt
    _pending.set()
