"""Checks of arguments of public functions; errors contain name, value and valid range."""

from __future__ import annotations

import os
import sys
import types
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import fields
from functools import cache, wraps
from inspect import Parameter, signature
from math import isnan
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from .errors import InvalidParameter
from .typing import Array

T = TypeVar("T")
P = ParamSpec("P")

NUMBERS = (float, int)
LONGEST = 60  # maximum number of characters of a value in a message
LONGEST_PATH = 4096
LEAST_DISTANCE_MM = 1e-9
LEAST_RADIUS_PX, LARGEST_RADIUS_PX = 1e-6, 1e9  # bounds of the image radius
WHOLE_LIMIT = 2**31 - 1


class WrongKind(InvalidParameter, TypeError):
    """Argument of a wrong type: text instead of numbers, None instead of a sensor."""


# -- numbers ---------------------------------------------------------------------------------------


def numbers(name: str, value: ArrayLike, shape: str = "of shape (n,)") -> Array:
    """Check numbers of any shape, at least one.

    >>> numbers("omega_deg", [0, 90])
    array([ 0., 90.])
    """
    array = _real(name, value, shape)
    if not array.size:
        raise InvalidParameter(f"{name} is empty; it is valid with at least one number")
    return array


def places(name: str, value: ArrayLike, *, is_row: bool = False) -> Array:
    """Check positions along an axis, (...), possibly empty; a scalar becomes (1,).

    Infinite values become NaN, which excludes them from computations; ``is_row`` accepts (n,) only.

    >>> places("omega", 1), places("omega", [0, np.inf])
    (array([1.]), array([ 0., nan]))
    """
    array = np.atleast_1d(_real(name, value, "of shape (n,)"))
    if is_row and array.ndim > 1:
        raise InvalidParameter(
            f"{name} has shape {array.shape}; it is valid as one number or a row of them, (n,)"
        )
    known = np.isfinite(array)
    return array if known.all() else np.where(known, array, np.nan)


def coordinates(name: str, value: ArrayLike) -> Array:
    """Check numbers of any shape, possibly empty, without conversion: for arrays from inner loops
    of a ray trace.

    >>> coordinates("x_mm", [0, 30]), coordinates("x_mm", 5.0)
    (array([ 0., 30.]), array(5.))
    """
    if type(value) is np.ndarray and value.dtype == float:
        return value
    return _real(name, value, "of any shape")


def _real(name: str, value: ArrayLike, shape: str) -> Array:
    """Check real numbers, possibly empty; text, dates, truth values and complex numbers are
    rejected.
    """
    try:
        array = np.asarray(value)
        is_mixed = array.dtype.kind == "O" and not all(type(v) in NUMBERS for v in array.flat)
        if array.dtype.kind not in "iufO" or is_mixed or _is_masked(value):
            raise TypeError
        return array.astype(float, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise WrongKind(f"{name} = {shown(value)} cannot be read as numbers {shape}") from None


def _is_masked(value: ArrayLike) -> bool:
    """Return whether an array has masked elements; does not import ``numpy.ma``."""
    return "numpy.ma" in sys.modules and bool(np.ma.is_masked(value))


def finite(
    name: str,
    value: ArrayLike,
    low: float = -np.inf,
    high: float = np.inf,
    *,
    unit: str = "",
    last: int | None = None,
) -> Array:
    """Check finite numbers between two inclusive bounds.

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
        raise InvalidParameter(
            f"{label} = {array[at]:g} is not valid; it is valid {_range(low, high, unit)}"
        )
    return array


def vectors(name: str, value: ArrayLike, length: int, *, is_list: bool = False) -> Array:
    """Check vectors (..., n, length), possibly empty; infinite values become NaN.

    ``is_list`` accepts (n, length) only.

    >>> vectors("pixels", [[1, np.inf]], 2)
    array([[ 1., nan]])
    """
    array = _real(name, value, f"of shape (n, {length})")
    if array.ndim < 2 or (is_list and array.ndim > 2) or array.shape[-1] != length:
        raise InvalidParameter(f"{name} has shape {array.shape}; it is valid as (n, {length})")
    known = np.isfinite(array)
    return array if known.all() else np.where(known, array, np.nan)


def row(name: str, value: ArrayLike) -> Array:
    """Check numbers in a row (n,); a scalar becomes an array of one element."""
    array = np.atleast_1d(numbers(name, value))
    if array.ndim > 1:
        raise InvalidParameter(
            f"{name} has shape {array.shape}; it is valid as one number or a row of them, (n,)"
        )
    return array


def floats(name: str, value: ArrayLike) -> tuple[float, ...]:
    """Return numbers in a row, possibly empty, as stored by parts of a sensor.

    >>> floats("coefficients", [1, 2]), floats("coefficients", ())
    ((1.0, 2.0), ())
    """
    is_empty = isinstance(value, list | tuple) and not value
    return () if is_empty else tuple(row(name, value).tolist())


def number(
    name: str,
    value: Any,
    *,
    above: float = -np.inf,
    low: float = -np.inf,
    high: float = np.inf,
    unit: str = "",
) -> float:
    """Check one finite number, above an exclusive bound or between two inclusive bounds.

    >>> number("width_px", 12, above=0)
    12.0
    """
    if type(value) is float and -np.inf < value < np.inf and value > above and low <= value <= high:
        return value  # fast path
    array = numbers(name, value, "(it takes one)")
    if array.ndim or not (np.isfinite(array) and array > above and low <= array <= high):
        if np.isinf(above):
            valid = (
                "as one finite number"
                if np.isinf(low) and np.isinf(high)
                else _range(low, high, unit)
            )
        else:
            most = "and finite" if np.isinf(high) else f"up to {high:g}"
            valid = f"above {above:g}{unit and ' ' + unit}, {most}"
        raise InvalidParameter(f"{name} = {shown(value)} is not valid; it is valid {valid}")
    return float(array)


def image_radius(value: Any) -> float:
    """Check the radius (px) to which the circle of the image is scaled."""
    return number(
        "image_radius_px", value, above=0.0, low=LEAST_RADIUS_PX, high=LARGEST_RADIUS_PX, unit="px"
    )


def whole(name: str, value: Any, low: int = 0, high: int = WHOLE_LIMIT) -> int:
    """Check one integer between two inclusive bounds.

    >>> whole("samples", 4, 1)
    4
    """
    array = numbers(name, value, "(it takes a whole one)")
    if array.ndim or not low <= array <= high or array != np.floor(array):
        raise InvalidParameter(
            f"{name} = {shown(value)} is not valid; it is valid as a whole number, {low} to {high}"
        )
    return int(array)


def optional_number(
    name: str, value: Any, *, above: float = -np.inf, high: float = np.inf, unit: str = ""
) -> float | None:
    """Check one finite number, or None."""
    return None if value is None else number(name, value, above=above, high=high, unit=unit)


def distances(name: str, value: ArrayLike) -> Array:
    """Check distances above 0, infinity allowed; values without a finite inverse are rejected."""
    array = numbers(name, value)
    near = ~(array >= LEAST_DISTANCE_MM)
    if near.any():
        bad = array[near].flat[0]
        raise InvalidParameter(
            f"{name} = {bad:g} is not a distance; it is valid above 0 (from {LEAST_DISTANCE_MM:g} mm), and inf"
        )
    return array


def float_of(text: str) -> float:
    """Parse a number in plain notation; Python underscores and digits of other scripts are
    rejected.

    >>> float_of("1e3"), float_of("-inf")
    (1000.0, -inf)

    Raises
    ------
    ValueError
        The text is not a number.
    """
    if not text.isascii() or "_" in text:
        raise ValueError(f"{shown(text)} is not a number")
    return float(text)


# -- words, files, objects ------------------------------------------------------------------------


def choice(name: str, value: Any, valid: Iterable[str]) -> None:
    """Check that a value is one of several words."""
    words = list(valid)
    if not isinstance(value, str) or value not in words:
        raise InvalidParameter(
            f"{name} = {shown(value)} is not known; valid are {', '.join(words)}"
        )


def file_name(name: str, value: Any) -> Path:
    """Check a file name."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise WrongKind(f"{name} = {shown(value)} is not a file name")
    if not text or "\0" in text or len(text) > LONGEST_PATH or not _can_be_stored(text):
        why = (
            "empty"
            if not text
            else "too long"
            if len(text) > LONGEST_PATH
            else "one with characters no file can have"
        )
        raise InvalidParameter(f"{name} = {shown(text)} is not valid as a file name: it is {why}")
    return Path(text)


def _can_be_stored(text: str) -> bool:
    try:
        os.fsencode(text)
    except UnicodeEncodeError:  # lone surrogate
        return False
    return True


def instance(name: str, value: Any, kind: type[T] | tuple[type[T], ...], what: str) -> T:
    """Check that a value has a type; ``what`` describes it for messages: "a sensor"."""
    if not isinstance(value, kind):
        raise WrongKind(f"{name} = {shown(value)} is not {what}")
    return value


# -- types by annotations -------------------------------------------------------------------------


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Check the types of the arguments of a public function against its annotations before each
    call.

    Numbers must be numbers and not NaN; their ranges are checked by the function itself, as are
    types that an annotation leaves open (``Any``, ``ArrayLike``).

    >>> @checked
    ... def drawn(path: str | Path, count: int = 1) -> None: ...
    >>> drawn("a.png", count="2")
    Traceback (most recent call last):
    omnimirror.base.arguments.WrongKind: count = '2' is not a whole number
    """
    told = signature(function)

    @wraps(function)
    def called(*args: P.args, **words: P.kwargs) -> T:
        hints = kinds_of(function)
        for name, value in told.bind(*args, **words).arguments.items():
            if name not in hints:
                continue  # self of a method
            if told.parameters[name].kind is Parameter.VAR_POSITIONAL:
                for i, one in enumerate(value):
                    _check_kind(f"{name}[{i}]", one, hints[name])
            elif told.parameters[name].kind is not Parameter.VAR_KEYWORD:
                _check_kind(name, value, hints[name])
        return function(*args, **words)

    return called


def check_fields(thing: Any) -> None:
    """Check the fields of a dataclass likewise, for its ``__post_init__``."""
    hints = kinds_of(thing.__class__)
    for field in fields(thing):
        _check_kind(field.name, getattr(thing, field.name), hints[field.name])


@cache
def kinds_of(thing: Any) -> dict[str, Any]:
    """Return the annotations of a function or class by name of argument or field."""
    return get_type_hints(thing)


@cache
def _parts(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the origin and the arguments of a generic annotation."""
    return get_origin(hint) or hint, get_args(hint)


def _check_kind(name: str, value: Any, hint: Any) -> None:
    kind, inner = _parts(hint)
    if kind is Literal:
        choice(name, value, inner)
    elif not _fits(value, hint):
        raise WrongKind(f"{name} = {shown(value)} is not {_described(hint)}")
    elif Path in inner and isinstance(value, str | Path):
        file_name(name, value)


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value matches an annotation."""
    kind, inner = _parts(hint)
    if kind in (Union, types.UnionType):
        return set(get_args(ArrayLike)) <= set(inner) or any(_fits(value, part) for part in inner)
    if kind is Literal:
        return isinstance(value, str) and value in inner
    if kind in NUMBERS:
        return _is_number(value) and (kind is float or isinstance(value, int | np.integer))
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is tuple and Ellipsis not in inner:
        return (
            _is_row(value, Sequence) and len(value) == len(inner) and all(map(_fits, value, inner))
        )
    if kind in ROWS:
        of = inner[0] if inner else Any
        if of is float and type(value) is tuple and set(map(type, value)) == {float}:  # fast path
            return not any(map(isnan, value))
        return _is_row(value, kind) and (
            not isinstance(value, Collection) or all(_fits(v, of) for v in value)
        )
    if hasattr(kind, "_fields"):  # named tuple; a plain tuple is accepted
        return isinstance(value, tuple) and len(value) == len(kind._fields)
    is_open = (
        kind is Any
        or not isinstance(kind, type)
        or getattr(kind, "_is_runtime_protocol", None) is False
    )
    return is_open or isinstance(value, kind)


ROWS = {
    tuple: Sequence,
    list: Sequence,
    Sequence: Sequence,
    Collection: Collection,
    Iterable: Iterable,
}
"""Annotations of sequences with the types that are accepted for them, arrays included."""


def _is_number(value: Any) -> bool:
    """Return whether a value is a finite-precision number: no truth value, no NaN, within the float
    range.
    """
    if isinstance(value, np.ndarray):
        return (
            value.ndim == 0
            and value.dtype.kind in "iuf"
            and not (_is_masked(value) or np.isnan(value))
        )
    if isinstance(value, bool) or not isinstance(value, float | int | np.integer | np.floating):
        return False
    try:
        return not np.isnan(float(value))
    except OverflowError:
        return False


def _is_row(value: Any, kind: Any) -> bool:
    is_several = (
        np.ndim(value) > 0
        if isinstance(value, np.ndarray)
        else isinstance(value, ROWS.get(kind, kind))
    )
    return is_several and not isinstance(value, str | bytes | bytearray | memoryview | dict)


def _described(hint: Any) -> str:
    """Describe the types of an annotation in words."""
    kind, inner = _parts(hint)
    if kind in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_described(part) for part in inner))
    if kind is Literal:
        return " or ".join(map(repr, inner))
    if kind is tuple and Ellipsis not in inner:
        return f"{len(inner)} values in a row: {', '.join(_described(part) for part in inner)}"
    if kind in ROWS:
        return f"a row of things of which each is {_described(inner[0]) if inner else 'anything'}"
    if kind in KINDS:
        return KINDS[kind]
    name = getattr(kind, "__name__", str(kind))
    return f"{'an' if name[0] in 'AEIO' else 'a'} {name}"


KINDS = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "text",
    Path: "a file name",
    type(None): "None",
    Callable: "a function",
    np.ndarray: "an array",
}


# -- messages --------------------------------------------------------------------------------------


def shown(value: Any) -> str:
    """Format a value for an error message.

    >>> shown("room"), shown(range(3)), shown([1.5] * 100_000)
    ("'room'", 'range(0, 3)', '[1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1...')
    """
    if isinstance(value, str | bytes | list | tuple):
        value = value[: 2 * LONGEST]  # the rest is not displayed
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # integers of thousands of digits have no text
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
