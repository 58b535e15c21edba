"""The three standard streams of a command, whatever the shell has made of them: closed, ASCII, or spoken into."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
import unicodedata
import warnings
from contextlib import suppress
from typing import TextIO

import click

from ..errors import OmnimirrorWarning

_QUIET = "omnimirror.quiet"
SPELLED = {"–": "-", "—": "-", "−": "-", "×": "x", "…": "..", "·": ".", "°": " deg", "²": "2", "±": "+-", "→": "->"}
"""How a terminal that lacks a character shows it."""


class Closed(io.TextIOBase):
    """Standard output that the caller has closed: a word to it is an error."""

    encoding = "utf-8"

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "it is closed", "standard output")


def prepare(is_quiet: bool) -> None:
    """Make the streams usable: open, able to show any name, and ours alone.

    Parameters
    ----------
    is_quiet
        Suppress warnings of Python except :class:`OmnimirrorWarning`, and messages of libraries in C, since the error
        message of the command describes what is wrong with a file.
    """
    for number in range(3):  # or a file that is opened next would become standard output
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None:
        sys.stdout = Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    codecs.register_error("omnimirror", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="omnimirror")
    if is_quiet:
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", OmnimirrorWarning)
        warnings.showwarning = _show_warning
        sys.stderr = _ours_alone(sys.stderr)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as one line on standard error."""
    click.echo(f"Warning: {message}", err=True)


def _ours_alone(stream: TextIO) -> TextIO:
    """Standard error on a descriptor of its own; what else is said on number 2 is thrown away."""
    with suppress(OSError, ValueError):  # a stream of a test has no descriptor
        if stream.fileno() == 2:
            stream.flush()
            own = open(os.dup(2), "w", 1, encoding=stream.encoding, errors="omnimirror")  # noqa: SIM115
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 2)
            os.close(nothing)
            return own
    return stream


def _spelled(error: UnicodeError) -> tuple[str, int]:
    """What to show for characters that a stream cannot, in ASCII."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(character: str) -> str:
    if character in SPELLED:
        return SPELLED[character]
    if "\udc80" <= character <= "\udcff":  # a byte of a file name that is not UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    ascii = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return ascii or character.encode("ascii", "backslashreplace").decode()


def forget_output() -> None:
    """Let nothing more be written to standard output: its reader has gone."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(nothing, sys.stdout.fileno())
    os.close(nothing)


def be_quiet(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """What the option ``--quiet`` does: tables, words and bars are left out; files, warnings and errors stay."""
    ctx.meta[_QUIET] = value


def is_quiet() -> bool:
    """Whether nothing is said but what went wrong."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_QUIET))
