"""What public functions ask of the numbers they are given; an error names the argument and what would be valid."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidParameter

Array = NDArray[np.float64]

LONGEST = 60  # characters of a value that a message repeats


def numbers(name: str, value: ArrayLike, shape: str = "of shape (n,)") -> Array:
    """Numbers of any shape, at least one.

    >>> numbers("omega_deg", [0, 90])
    array([ 0., 90.])
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biufO":  # words that look like numbers, dates, complex numbers
            raise TypeError
        array = array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise InvalidParameter(f"{name} = {shown(value)} cannot be read as numbers {shape}") from None
    if not array.size:
        raise InvalidParameter(f"{name} is empty; it is valid with at least one number")
    return array


def row(name: str, value: ArrayLike) -> Array:
    """Numbers in a row (n,); one alone is a row of one."""
    array = np.atleast_1d(numbers(name, value))
    if array.ndim > 1:
        raise InvalidParameter(f"{name} has shape {array.shape}; it is valid as one number or a row of them, (n,)")
    return array


def number(name: str, value: Any, *, above: float = -np.inf, unit: str = "") -> float:
    """One finite number.

    >>> number("width_px", 12, above=0)
    12.0
    """
    array = numbers(name, value, "(it takes one)")
    if array.ndim or not (np.isfinite(array) and array > above):
        valid = "as one finite number" if np.isinf(above) else f"above {above:g}{unit and ' ' + unit}, and finite"
        raise InvalidParameter(f"{name} = {shown(value)} is not valid; it is valid {valid}")
    return float(array)


def distances(name: str, value: ArrayLike) -> Array:
    """Distances above 0, infinity allowed."""
    array = numbers(name, value)
    if not np.all(array > 0):
        bad = array[~(array > 0)].flat[0]
        raise InvalidParameter(f"{name} = {bad:g} is not a distance; it is valid above 0, and inf")
    return array


def choice(name: str, value: Any, valid: Iterable[str]) -> None:
    """One of a few words."""
    words = list(valid)
    if value not in words:
        raise InvalidParameter(f"{name} = {shown(value)} is not known; valid are {', '.join(words)}")


def shown(value: Any) -> str:
    """A value as a message repeats it."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # whole numbers of thousands of digits have no text
        text = f"a {type(value).__name__}"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
