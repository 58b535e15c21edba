"""Deferred handling of termination signals: Ctrl-C, SIGTERM of service managers, SIGHUP of closed
terminals.

Python raises KeyboardInterrupt between any two steps of the main thread, possibly while it holds
the lock of a queue shared with other threads, which then deadlock. Multithreaded work polls for
signals instead.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

POLL_S = 0.1  # polling period of all waits
STOP_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
HANGUP = getattr(signal, "SIGHUP", None)
SIGNAL_EXIT_OFFSET = 128
"""Offset of signal numbers in exit codes (130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP),
as in shells.
"""

_pending = threading.Event()
_number: int = signal.SIGINT
_is_signal = False


@contextmanager
def deferred() -> Iterator[None]:
    """Record signals within the block instead of raising them; a second one is raised at once,
    except SIGHUP.

    Terminals and service managers send SIGHUP after another signal, which must not interrupt the
    cleanup; an ignored SIGHUP, as under nohup, stays ignored. Outside the main thread, which alone
    receives signals, and within another such block, this has no effect.
    """
    if threading.current_thread() is not threading.main_thread() or _is_deferred():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
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
    """Record signals within the block, as :func:`deferred` does, and resend a recorded one after
    it.

    Code that starts a process and stores its handle needs this: a signal in between would leave the
    process running. A mask of signals is insufficient, because the system delivers them to another
    thread, and the handler runs in the main thread nevertheless.
    """
    if _is_deferred():  # the outer block handles its signals
        yield
        return
    with deferred():
        yield
        code = exit_code()
    if code:
        signal.raise_signal(code - SIGNAL_EXIT_OFFSET)


def _is_deferred() -> bool:
    return signal.getsignal(signal.SIGINT) is _note


def is_pending() -> bool:
    """Return whether a stop was requested and not yet handled."""
    return _pending.is_set()


def exit_code() -> int:
    """Return the exit code of the requested stop; 0 without a request."""
    return SIGNAL_EXIT_OFFSET + _number if _pending.is_set() else 0


def is_signal() -> bool:
    """Return whether a signal requested the stop, and not only :func:`request`."""
    return _pending.is_set() and _is_signal


def request() -> None:
    """Request a stop as Ctrl-C does, from any thread."""
    _note(signal.SIGINT, None)


def _note(number: int, frame: FrameType | None) -> None:
    global _number, _is_signal
    if _pending.is_set() and frame is not None and number != HANGUP:
        raise KeyboardInterrupt
    if not _pending.is_set():
        _number, _is_signal = number, frame is not None
    _pending.set()
