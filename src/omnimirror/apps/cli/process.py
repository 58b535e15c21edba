"""Process state during a command: signal handlers, environment and streams, all restored at its
end.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from .streams import prepared

BY_SIGNAL = 128
"""Offset of exit codes after a signal (shell convention)."""
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals handled like Ctrl-C, for which Python raises KeyboardInterrupt."""
AGAIN_S = 0.05

_number: int = signal.SIGINT


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; unlike its base class, instances support weak references."""


class Terminated(Interrupted):
    """Termination by a service manager or a closed terminal, handled like Ctrl-C."""


def stopped_code() -> int:
    """Return the exit code of an interrupted command: 130 after Ctrl-C, 143 after SIGTERM, 129
    after SIGHUP.
    """
    return BY_SIGNAL + _number


@contextmanager
def process_state(is_quiet: bool) -> Iterator[None]:
    """Prepare the process for a command and restore its state at the end.

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
    """Raise :class:`Terminated` on termination signals; ignored signals, as under nohup, stay
    ignored.
    """
    global _number
    _number = signal.SIGINT
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *ENDING)}
    hook = sys.unraisablehook
    again: list[threading.Timer] = []

    def send_again(number: int) -> None:
        again.append(threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)))
        again[-1].start()

    def unraisable(lost: Any) -> None:
        """Resend a signal whose exception Python could not raise, for example in a destructor."""
        if isinstance(lost.exc_value, KeyboardInterrupt):
            stop.is_lost = True
            send_again(_number)
        else:
            hook(lost)

    stop = _Stop(send_again)
    for number, handler in before.items():
        if handler is signal.default_int_handler or (number in ENDING and handler is not signal.SIG_IGN):
            signal.signal(number, stop)
    sys.unraisablehook = unraisable
    try:
        yield
    finally:
        for timer in again:  # the command has ended: a late signal would replace its exit code
            timer.cancel()
        sys.unraisablehook = hook
        for number, handler in before.items():
            if handler is not None:  # None: installed by C code, cannot be restored from Python
                signal.signal(number, handler)


class _Stop:
    """Handler that raises :class:`Interrupted` or :class:`Terminated` once: systemd and
    terminals send two signals in succession.

    The second signal must not interrupt the cleanup after the first. It is raised only if the first
    exception was suppressed. During an import the signal is sent again later: extension modules,
    among them OpenEXR, discard exceptions or convert them to ImportError.
    """

    def __init__(self, send_again: Callable[[int], None]) -> None:
        self._send_again = send_again
        self._is_raised: Any = lambda: None
        self.is_lost = False
        """Whether Python reported the exception as unraisable; it may still exist when the signal is sent again."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        global _number
        if self._is_raised() is not None:
            if self.is_lost:
                self._send_again(number)
            return
        if _is_importing(frame):
            self._send_again(number)
            return
        self.is_lost = False
        _number = number
        error = Interrupted() if number == signal.SIGINT else Terminated()
        self._is_raised = weakref.ref(error)
        try:
            raise error
        finally:
            del error  # the traceback refers to this frame


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether a frame of the running command belongs to an import."""
    while frame is not None and frame.f_globals.get("__name__") != __package__:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False
