"""Standard streams of a command, robust against closed streams, ASCII encodings and output of
libraries.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
import unicodedata
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TextIO

import click

from ...base.errors import OmnimirrorWarning

_QUIET = "omnimirror.quiet"
SPELLED = {"–": "-", "—": "-", "−": "-", "×": "x", "…": "..", "·": ".", "°": " deg", "²": "2", "±": "+-", "→": "->"}
"""Replacements of characters that a terminal cannot display."""


class Closed(io.TextIOBase):
    """Closed standard output: writing raises an error."""

    encoding = "utf-8"

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "it is closed", "standard output")


@contextmanager
def prepared(is_quiet: bool) -> Iterator[None]:
    """Make the streams usable within the block: open, with any character, and free of library
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
    codecs.register_error("omnimirror", _spelled)
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
            sys.stderr = restored.enter_context(_ours_alone(sys.stderr))
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as one line on standard error."""
    click.echo(f"Warning: {message}", err=True)


@contextmanager
def _ours_alone(stream: TextIO) -> Iterator[TextIO]:
    """Move standard error to a descriptor of its own and discard library output on descriptor 2."""
    try:
        is_standard = stream.fileno() == 2
    except (OSError, ValueError):  # streams of tests have no descriptor
        is_standard = False
    if not is_standard:
        yield stream
        return
    stream.flush()
    with open(os.dup(2), "w", 1, encoding=stream.encoding, errors="omnimirror") as own, _discarded(2):
        yield own


@contextmanager
def _discarded(number: int) -> Iterator[None]:
    """Discard output to a descriptor within the block."""
    kept, nothing = os.dup(number), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, number)
        yield
    finally:
        os.dup2(kept, number)
        os.close(kept)
        os.close(nothing)


def _spelled(error: UnicodeError) -> tuple[str, int]:
    """Return an ASCII replacement for characters that a stream cannot encode."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(character: str) -> str:
    if character in SPELLED:
        return SPELLED[character]
    if "\udc80" <= character <= "\udcff":  # byte of a file name that is not UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    ascii = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return ascii or character.encode("ascii", "backslashreplace").decode()


def forget_output() -> None:
    """Discard the buffered standard output after its reader has closed the pipe."""
    with suppress(OSError, ValueError, AttributeError), _discarded(sys.stdout.fileno()):
        sys.stdout.flush()


def be_quiet(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Apply ``--quiet``: omit tables, text and progress bars; keep files, warnings and errors."""
    ctx.meta[_QUIET] = value


def is_quiet() -> bool:
    """Return whether only warnings and errors are printed."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_QUIET))
