"""Option values and output that several commands share; each parser serves as a click ``type``."""

from __future__ import annotations

import sys

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

MOST_VALUES = 1_000_000


def values(text: str) -> NDArray[np.float64]:
    """Numbers as ``START:STOP:STEP`` (ends included), or as a comma list.

    >>> values("0:135:45"), values("90, 104")
    (array([  0.,  45.,  90., 135.]), array([ 90., 104.]))
    """
    try:
        parts = [float(p) for p in text.split(":" if ":" in text else ",")]
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a range START:STOP:STEP or a list of numbers") from None
    if not np.isfinite(parts).all():
        raise click.BadParameter(f"{text!r} holds a number that is not finite")
    if ":" not in text:
        return np.array(parts)
    if len(parts) != 3:
        raise click.BadParameter(f"{text!r} has {len(parts)} parts; a range is START:STOP:STEP, such as 0:135:5")
    start, stop, step = parts
    if step <= 0 or stop < start:
        raise click.BadParameter(f"{text!r} is an empty range; START must not be above STOP, nor STEP 0 or less")
    count = int(np.floor((stop - start) / step + 1e-9)) + 1
    if count > MOST_VALUES:
        raise click.BadParameter(f"{text!r} stands for {count} numbers; at most {MOST_VALUES} are valid")
    return start + step * np.arange(count, dtype=np.float64)


def pixel(text: str) -> tuple[float, float]:
    """A pixel as ``U,V``.

    >>> pixel("511.5,11.5")
    (511.5, 11.5)
    """
    try:
        u, v = (float(p) for p in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a pixel U,V") from None
    return u, v


def distance(text: str) -> float:
    """A length in mm above 0, ``inf`` allowed.

    >>> distance("inf")
    inf
    """
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not number > 0:
        raise click.BadParameter(f"{text!r} is not a distance in mm; it is valid above 0, and 'inf'")
    return number


def focus(text: str) -> float | str:
    """A focus distance in mm, or the word ``auto``."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a distance in mm, nor 'auto'") from None


def output_console() -> Console:
    """The terminal as it is; a pipe or a file gets lines as long as they need to be."""
    return Console() if sys.stdout.isatty() else Console(width=200)
