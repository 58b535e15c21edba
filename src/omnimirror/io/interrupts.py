"""Signals that end work, deferred to a safe moment: Ctrl-C, SIGTERM of service managers, SIGHUP of closed terminals.

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
STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
HANGUP = getattr(signal, "SIGHUP", None)
BY_SIGNAL = 128
"""Added to a signal's number for exit codes (130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP); as shells do."""

_pending = threading.Event()
_number: int = signal.SIGINT
_is_signal = False


@contextmanager
def deferred() -> Iterator[None]:
    """Note signals within the block instead of raising them; a second one is raised at once, except for SIGHUP.

    Terminals and service managers send SIGHUP after another signal, which must not cut off the end of the work; where
    it is ignored, as by nohup, it stays so. Outside the main thread, to which signals never come, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOPPING}
    if before.get(HANGUP) is signal.SIG_IGN:
        del before[HANGUP]
    _pending.clear()
    for number in before:
        signal.signal(number, _note)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _pending.clear()


@contextmanager
def postponed() -> Iterator[None]:
    """Note signals within the block, as :func:`deferred` does, and send the noted one again after it."""
    with deferred():
        yield
        code = exit_code()
    if code:
        signal.raise_signal(code - BY_SIGNAL)


def is_pending() -> bool:
    """Whether someone asked to stop and was not answered yet."""
    return _pending.is_set()


def exit_code() -> int:
    """The exit code for who was asked to stop; 0 where nobody asked."""
    return BY_SIGNAL + _number if _pending.is_set() else 0


def is_signal() -> bool:
    """Return whether a signal asked to stop, and not only :func:`request`."""
    return _pending.is_set() and _is_signal


def request() -> None:
    """Do as Ctrl-C does, from any thread."""
    _note(signal.SIGINT, None)


def _note(number: int, frame: FrameType | None) -> None:
    global _number, _is_signal
    if _pending.is_set() and frame is not None and number != HANGUP:
        raise KeyboardInterrupt
    if not _pending.is_set():
        _number, _is_signal = number, frame is not None
    _pending.set()
