"""State of the process during a command: signal handlers, environment and streams, all restored at its end."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from .streams import prepared

BY_SIGNAL = 128
"""Added to the number of the signal that ended a command, for its exit code (a convention of shells)."""
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a command as Ctrl-C does, which Python raises by itself."""
AGAIN_S = 0.05

_number: int = signal.SIGINT


class Terminated(KeyboardInterrupt):
    """A signal of a service manager or a closed terminal; it ends a command as Ctrl-C does."""


def stopped_code() -> int:
    """Return the exit code of a command that was stopped: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP."""
    return BY_SIGNAL + _number


@contextmanager
def process_state(is_quiet: bool) -> Iterator[None]:
    """Prepare the process for a command; what is changed in it is restored at the end.

    Parameters
    ----------
    is_quiet
        As for :func:`omnimirror.apps.cli.streams.prepared`.
    """
    environment = dict(os.environ)
    try:
        with warnings.catch_warnings(), prepared(is_quiet), _signals():
            yield
    finally:
        if os.environ != environment:
            os.environ.clear()
            os.environ.update(environment)


@contextmanager
def _signals() -> Iterator[None]:
    """Raise :class:`Terminated` at signals that end the process; those that are ignored, as under nohup, stay so."""
    global _number
    _number = signal.SIGINT
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in ENDING}
    hook = sys.unraisablehook
    stop = _Stop()
    again: list[threading.Timer] = []

    def unraisable(lost: Any) -> None:
        """Send a signal again whose exception came where Python cannot raise it, such as in a destructor."""
        if isinstance(lost.exc_value, KeyboardInterrupt):
            again.append(threading.Timer(AGAIN_S, os.kill, (os.getpid(), _number)))
            again[-1].start()
        else:
            hook(lost)

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, stop)
    sys.unraisablehook = unraisable
    try:
        yield
    finally:
        for timer in again:  # the command has ended: a signal now would end the process without its exit code
            timer.cancel()
        sys.unraisablehook = hook
        for number, handler in before.items():
            if handler is not None:  # None: installed by C code, which alone could restore it
                signal.signal(number, handler)


class _Stop:
    """Handler that raises :class:`Terminated`, once: systemd and terminals send two signals in a row.

    The second must not cut off what cleans up after the first. It is raised again only once the first exception is
    gone, because something has swallowed it.
    """

    def __init__(self) -> None:
        self._is_raised: Any = lambda: None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        global _number
        if self._is_raised() is not None:
            return
        _number = number
        error = Terminated()
        self._is_raised = weakref.ref(error)
        try:
            raise error
        finally:
            del error  # the traceback refers to this frame
