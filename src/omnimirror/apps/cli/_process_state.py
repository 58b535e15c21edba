"""Process state during a command: signal handlers, environment and standard streams, all restored at its end."""

from __future__ import annotations

import codecs
import errno
import io
import os
import signal
import sys
import threading
import unicodedata
import warnings
import weakref
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any, TextIO

import click

from ...base.errors import OmnimirrorWarning

# -- Standard streams ------------------------------------------------------------------------------

QUIET = "omnimirror.quiet"
"""Key of ``--quiet`` in the metadata of the click context."""
ASCII_REPLACEMENTS = {
    "–": "-",
    "—": "-",
    "−": "-",
    "×": "x",
    "…": "...",
    "·": ".",
    "°": " deg",
    "²": "2",
    "±": "+-",
    "→": "->",
}
"""Replacements of characters that a terminal cannot display."""


class Closed(io.TextIOBase):
    """Closed standard output: writing raises an error."""

    encoding = "utf-8"

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "closed", "standard output")


@contextmanager
def prepared(is_quiet: bool) -> Iterator[None]:
    """Provide usable streams within the block: open, with any character, and free of library
    output.

    Parameters
    ----------
    is_quiet
        Suppress Python warnings except :class:`OmnimirrorWarning`, and messages of C libraries,
        since the error message of the command describes the problem of a file.
    """
    for number in range(3):  # otherwise the next opened file would become standard output
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    if sys.stdout is None:
        sys.stdout = Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    codecs.register_error("omnimirror", _ascii_replacement)
    if is_quiet and not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", OmnimirrorWarning)
    if is_quiet:
        warnings.showwarning = _show_warning  # restored with the filters
    with ExitStack() as restored:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper) and stream.errors is not None:
                restored.callback(stream.reconfigure, errors=stream.errors)
                stream.reconfigure(errors="omnimirror")
        if is_quiet:
            sys.stderr = restored.enter_context(_without_library_output(sys.stderr))
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as one line on standard error."""
    click.echo(f"Warning: {message}", err=True)


@contextmanager
def _without_library_output(stream: TextIO) -> Iterator[TextIO]:
    """Move standard error to a descriptor of its own and discard library output on descriptor 2."""
    try:
        is_standard = stream.fileno() == 2
    except (OSError, ValueError):  # streams of tests have no descriptor
        is_standard = False
    if not is_standard:
        yield stream
        return
    stream.flush()
    with (
        open(os.dup(2), "w", 1, encoding=stream.encoding, errors="omnimirror") as own,
        _discarded(2),
    ):
        yield own


@contextmanager
def _discarded(number: int) -> Iterator[None]:
    """Discard output to a descriptor within the block."""
    saved, null = os.dup(number), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, number)
        yield
    finally:
        os.dup2(saved, number)
        os.close(saved)
        os.close(null)


def _ascii_replacement(error: UnicodeError) -> tuple[str, int]:
    """Return an ASCII replacement for characters that a stream cannot encode."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_ascii_character, error.object[error.start : error.end])), error.end


def _ascii_character(character: str) -> str:
    if character in ASCII_REPLACEMENTS:
        return ASCII_REPLACEMENTS[character]
    if "\udc80" <= character <= "\udcff":  # byte of a file name that is not UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    ascii = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return ascii or character.encode("ascii", "backslashreplace").decode()


def discard_output() -> None:
    """Discard the buffered standard output after its reader has closed the pipe."""
    with suppress(OSError, ValueError, AttributeError), _discarded(sys.stdout.fileno()):
        sys.stdout.flush()


# -- Signals and environment -----------------------------------------------------------------------

SIGNAL_EXIT_BASE = 128
"""Offset of exit codes after a signal (shell convention)."""
TERMINATION_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals handled like Ctrl-C, for which Python raises KeyboardInterrupt."""
RESEND_DELAY_S = 0.05

_number: int = signal.SIGINT


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; unlike its base class, instances support weak references."""


class Terminated(Interrupted):
    """Termination by a service manager or a closed terminal, handled like Ctrl-C."""


def interrupted_exit_code() -> int:
    """Return the exit code of an interrupted command: 130 after Ctrl-C, 143 after SIGTERM, 129
    after SIGHUP.
    """
    return SIGNAL_EXIT_BASE + _number


@contextmanager
def process_state(is_quiet: bool) -> Iterator[None]:
    """Prepare the process for a command and restore its state at the end.

    Parameters
    ----------
    is_quiet
        As for :func:`omnimirror.apps.cli._process_state.prepared`.
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
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *TERMINATION_SIGNALS)}
    hook = sys.unraisablehook
    again: list[threading.Timer] = []

    def send_again(number: int) -> None:
        again.append(threading.Timer(RESEND_DELAY_S, os.kill, (os.getpid(), number)))
        again[-1].start()

    def unraisable(exception: Any) -> None:
        """Resend a signal whose exception Python could not raise, for example in a destructor."""
        if isinstance(exception.exc_value, KeyboardInterrupt):
            stop.is_lost = True
            send_again(_number)
        else:
            hook(exception)

    stop = _Stop(send_again)
    for number, handler in before.items():
        if handler is signal.default_int_handler or (
            number in TERMINATION_SIGNALS and handler is not signal.SIG_IGN
        ):
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
        """True if Python reported the exception as unraisable; it may still exist when the signal is sent again."""

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
