"""What public functions ask of what they are given; an error names the argument, the value and what would be valid."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidParameter

Array = NDArray[np.float64]
T = TypeVar("T")

LONGEST = 60  # characters of a value that a message repeats
LONGEST_PATH = 4096
LARGEST_RADIUS_PX = 1e9  # that a picture is scaled to
WHOLE_LIMIT = 2**31 - 1


class WrongKind(InvalidParameter, TypeError):
    """An argument is of the wrong type altogether: text where numbers belong, None where a sensor does."""


# -- numbers -----------------------------------------------------------------------------------------


def numbers(name: str, value: ArrayLike, shape: str = "of shape (n,)") -> Array:
    """Numbers of any shape, at least one.

    >>> numbers("omega_deg", [0, 90])
    array([ 0., 90.])
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iufO":  # words that look like numbers, dates, truth values, complex numbers
            raise TypeError
        if array.dtype.kind == "O" and any(isinstance(v, bool | str | None) for v in array.flat):
            raise TypeError
        array = array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise WrongKind(f"{name} = {shown(value)} cannot be read as numbers {shape}") from None
    if not array.size:
        raise InvalidParameter(f"{name} is empty; it is valid with at least one number")
    return array


def finite(
    name: str, value: ArrayLike, low: float = -np.inf, high: float = np.inf, *, unit: str = "", last: int | None = None
) -> Array:
    """Finite numbers between two bounds, which are valid themselves.

    Parameters
    ----------
    last
        Length of the last axis: 2 for pixels, 3 for points and directions.

    Examples
    --------
    >>> finite("pixels", [[3, 4]], last=2)
    array([[3., 4.]])
    """
    array = numbers(name, value, "of shape (n,)" if last is None else f"of shape (.., {last})")
    if last is not None and (array.ndim == 0 or array.shape[-1] != last):
        raise InvalidParameter(f"{name} has shape {array.shape}; it is valid as (.., {last})")
    bad = ~(np.isfinite(array) & (array >= low) & (array <= high))
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        label = f"{name}[{', '.join(map(str, at))}]" if at else name
        raise InvalidParameter(f"{label} = {array[at]:g} is not valid; it is valid {_range(low, high, unit)}")
    return array


def vectors(name: str, value: ArrayLike, length: int) -> Array:
    """Vectors (.., n, length), perhaps none; what is infinite becomes NaN, which nothing computes further with.

    >>> vectors("pixels", [[1, np.inf]], 2)
    array([[ 1., nan]])
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise WrongKind(f"{name} = {shown(value)} cannot be read as numbers of shape (n, {length})") from None
    if array.ndim < 2 or array.shape[-1] != length:
        raise InvalidParameter(f"{name} has shape {array.shape}; it is valid as (n, {length})")
    known = np.isfinite(array)
    return array if known.all() else np.where(known, array, np.nan)


def row(name: str, value: ArrayLike) -> Array:
    """Numbers in a row (n,); one alone is a row of one."""
    array = np.atleast_1d(numbers(name, value))
    if array.ndim > 1:
        raise InvalidParameter(f"{name} has shape {array.shape}; it is valid as one number or a row of them, (n,)")
    return array


def number(
    name: str, value: Any, *, above: float = -np.inf, low: float = -np.inf, high: float = np.inf, unit: str = ""
) -> float:
    """One finite number, above a bound or between two that are valid themselves.

    >>> number("width_px", 12, above=0)
    12.0
    """
    array = numbers(name, value, "(it takes one)")
    if array.ndim or not (np.isfinite(array) and array > above and low <= array <= high):
        if np.isinf(above):
            valid = "as one finite number" if np.isinf(low) and np.isinf(high) else _range(low, high, unit)
        else:
            most = "and finite" if np.isinf(high) else f"up to {high:g}"
            valid = f"above {above:g}{unit and ' ' + unit}, {most}"
        raise InvalidParameter(f"{name} = {shown(value)} is not valid; it is valid {valid}")
    return float(array)


def whole(name: str, value: Any, low: int = 0, high: int = WHOLE_LIMIT) -> int:
    """One whole number between two bounds, which are valid themselves.

    >>> whole("samples", 4, 1)
    4
    """
    array = numbers(name, value, "(it takes a whole one)")
    if array.ndim or not low <= array <= high or array != np.floor(array):
        raise InvalidParameter(f"{name} = {shown(value)} is not valid; it is valid as a whole number, {low} to {high}")
    return int(array)


def optional_number(
    name: str, value: Any, *, above: float = -np.inf, high: float = np.inf, unit: str = ""
) -> float | None:
    """One finite number, or None."""
    return None if value is None else number(name, value, above=above, high=high, unit=unit)


def distances(name: str, value: ArrayLike) -> Array:
    """Distances above 0, infinity allowed."""
    array = numbers(name, value)
    if not np.all(array > 0):
        bad = array[~(array > 0)].flat[0]
        raise InvalidParameter(f"{name} = {bad:g} is not a distance; it is valid above 0, and inf")
    return array


def float_of(text: str) -> float:
    """A number as people write it: Python's underscores and other scripts' digits are slips.

    >>> float_of("1e3"), float_of("-inf")
    (1000.0, -inf)

    Raises
    ------
    ValueError
        It is none.
    """
    if not text.isascii() or "_" in text:
        raise ValueError(f"{shown(text)} is not a number")
    return float(text)


# -- words, files, things ------------------------------------------------------------------------------


def choice(name: str, value: Any, valid: Iterable[str]) -> None:
    """One of a few words."""
    words = list(valid)
    if not isinstance(value, str) or value not in words:
        raise InvalidParameter(f"{name} = {shown(value)} is not known; valid are {', '.join(words)}")


def file_name(name: str, value: Any) -> Path:
    """The name of a file."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise WrongKind(f"{name} = {shown(value)} is not a file name")
    if not text or "\0" in text or len(text) > LONGEST_PATH:
        why = "empty" if not text else "too long" if len(text) > LONGEST_PATH else "one with a null character"
        raise InvalidParameter(f"{name} = {shown(text)} is not valid as a file name: it is {why}")
    return Path(text)


def instance(name: str, value: Any, kind: type[T] | tuple[type[T], ...], what: str) -> T:
    """A thing of a kind; ``what`` says in words which: "a sensor"."""
    if not isinstance(value, kind):
        raise WrongKind(f"{name} = {shown(value)} is not {what}")
    return value


# -- messages ------------------------------------------------------------------------------------------


def shown(value: Any) -> str:
    """A value as a message repeats it.

    >>> shown("room"), shown(range(3)), shown([1.5] * 100_000)
    ("'room'", 'range(0, 3)', '[1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1...')
    """
    if isinstance(value, str | bytes | list | tuple):
        value = value[: 2 * LONGEST]  # the rest is not shown, and need not be written out
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # whole numbers of thousands of digits have no text
        text = f"a {type(value).__name__}"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _range(low: float, high: float, unit: str) -> str:
    unit = f" {unit}" if unit else ""
    if np.isinf(low) and np.isinf(high):
        return "where it is finite"
    if np.isinf(high):
        return f"from {low:g}{unit}, and finite"
    if np.isinf(low):
        return f"up to {high:g}{unit}, and finite"
    return f"from {low:g} to {high:g}{unit}"
