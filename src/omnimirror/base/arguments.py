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
MAX_VALUE_CHARACTERS = 60
"""Maximum number of characters of a value in a message."""
MAX_PATH_CHARACTERS = 4096
MIN_DISTANCE_MM = 1e-9
MIN_IMAGE_RADIUS_PX, MAX_IMAGE_RADIUS_PX = 1e-6, 1e9
MAX_INTEGER = 2**31 - 1


class InvalidType(InvalidParameter, TypeError):
    """Argument of a wrong type: text instead of numbers, None instead of a sensor."""


# -- Numbers ---------------------------------------------------------------------------------------


def numbers(name: str, value: ArrayLike, expected: str = "numbers of shape (n,)") -> Array:
    """Check numbers of any shape, at least one; ``expected`` describes them in messages.

    >>> numbers("omega_deg", [0, 90])
    array([ 0., 90.])
    """
    array = _real_array(name, value, expected)
    if not array.size:
        raise InvalidParameter(f"{name} must contain at least one number; got none")
    return array


def positions(name: str, value: ArrayLike, *, is_row: bool = False) -> Array:
    """Check positions along an axis, (...), possibly empty; a scalar becomes (1,).

    Infinite values become NaN, which excludes them from computations; ``is_row`` accepts (n,) only.

    >>> positions("omega", 1), positions("omega", [0, np.inf])
    (array([1.]), array([ 0., nan]))
    """
    array = np.atleast_1d(_real_array(name, value, "numbers of shape (n,)"))
    if is_row and array.ndim > 1:
        raise InvalidParameter(
            f"{name} must be a number or have the shape (n,); got shape {array.shape}"
        )
    is_finite = np.isfinite(array)
    return array if is_finite.all() else np.where(is_finite, array, np.nan)


def coordinates(name: str, value: ArrayLike) -> Array:
    """Check numbers of any shape, possibly empty, without conversion: for arrays from inner loops
    of a ray trace.

    >>> coordinates("x_mm", [0, 30]), coordinates("x_mm", 5.0)
    (array([ 0., 30.]), array(5.))
    """
    if type(value) is np.ndarray and value.dtype == float:
        return value
    return _real_array(name, value, "numbers")


def _real_array(name: str, value: ArrayLike, expected: str) -> Array:
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
        raise InvalidType(f"{name} must be {expected}; got {format_value(value)}") from None


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
    shape = "(n,)" if last is None else f"(..., {last})"
    array = numbers(name, value, f"numbers of shape {shape}")
    if last is not None and (array.ndim == 0 or array.shape[-1] != last):
        raise InvalidParameter(f"{name} must have the shape {shape}; got shape {array.shape}")
    is_invalid = ~(np.isfinite(array) & (array >= low) & (array <= high))
    if is_invalid.any():
        at = tuple(int(i) for i in np.argwhere(is_invalid)[0])
        label = f"{name}[{', '.join(map(str, at))}]" if at else name
        raise InvalidParameter(f"{label} must be {_range(low, high, unit)}; got {array[at]:g}")
    return array


def vectors(name: str, value: ArrayLike, length: int, *, is_list: bool = False) -> Array:
    """Check vectors (..., n, length), possibly empty; infinite values become NaN.

    ``is_list`` accepts (n, length) only.

    >>> vectors("pixels", [[1, np.inf]], 2)
    array([[ 1., nan]])
    """
    array = _real_array(name, value, f"numbers of shape (n, {length})")
    if array.ndim < 2 or (is_list and array.ndim > 2) or array.shape[-1] != length:
        raise InvalidParameter(f"{name} must have the shape (n, {length}); got shape {array.shape}")
    is_finite = np.isfinite(array)
    return array if is_finite.all() else np.where(is_finite, array, np.nan)


def row(name: str, value: ArrayLike) -> Array:
    """Check numbers in a row (n,); a scalar becomes an array of one element."""
    array = np.atleast_1d(numbers(name, value))
    if array.ndim > 1:
        raise InvalidParameter(
            f"{name} must be a number or have the shape (n,); got shape {array.shape}"
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
    array = numbers(name, value, "a number")
    if array.ndim or not (np.isfinite(array) and array > above and low <= array <= high):
        valid = "a finite number"
        if not np.isinf(above):
            limit = "finite" if np.isinf(high) else f"at most {high:g}{unit and ' ' + unit}"
            valid = f"greater than {above:g}{unit and ' ' + unit} and {limit}"
        elif not (np.isinf(low) and np.isinf(high)):
            valid = _range(low, high, unit)
        raise InvalidParameter(f"{name} must be {valid}; got {format_value(value)}")
    return float(array)


def image_radius(value: Any) -> float:
    """Check the radius (px) to which the circle of the image is scaled."""
    return number(
        "image_radius_px",
        value,
        above=0.0,
        low=MIN_IMAGE_RADIUS_PX,
        high=MAX_IMAGE_RADIUS_PX,
        unit="px",
    )


def integer(name: str, value: Any, low: int = 0, high: int = MAX_INTEGER) -> int:
    """Check one integer between two inclusive bounds.

    >>> integer("samples", 4, 1)
    4
    """
    array = numbers(name, value, "an integer")
    if array.ndim or not low <= array <= high or array != np.floor(array):
        raise InvalidParameter(
            f"{name} must be an integer between {low} and {high}; got {format_value(value)}"
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
    is_invalid = ~(array >= MIN_DISTANCE_MM)
    if is_invalid.any():
        raise InvalidParameter(
            f"{name} must be at least {MIN_DISTANCE_MM:g} mm, or inf; got {array[is_invalid].flat[0]:g}"
        )
    return array


def parse_float(text: str) -> float:
    """Parse a number in plain notation; Python underscores and digits of other scripts are
    rejected.

    >>> parse_float("1e3"), parse_float("-inf")
    (1000.0, -inf)

    Raises
    ------
    ValueError
        If the text is not a number.
    """
    if not text.isascii() or "_" in text:
        raise ValueError(f"text must be a number; got {format_value(text)}")
    return float(text)


# -- Words, files, objects ------------------------------------------------------------------------


def choice(name: str, value: Any, valid: Iterable[str]) -> None:
    """Check that a value is one of several names."""
    values = list(valid)
    if not isinstance(value, str) or value not in values:
        raise InvalidParameter(
            f"{name} must be one of {', '.join(w or repr(w) for w in values)}; got {format_value(value)}"
        )


def file_name(name: str, value: Any) -> Path:
    """Check a file name."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise InvalidType(f"{name} must be a file name; got {format_value(value)}")
    if not text:
        raise InvalidParameter(f"{name} must be a file name; got an empty string")
    if len(text) > MAX_PATH_CHARACTERS:
        raise InvalidParameter(
            f"{name} must have at most {MAX_PATH_CHARACTERS} characters; got {format_value(text)}"
        )
    if "\0" in text or not _can_be_encoded(text):
        raise InvalidParameter(
            f"{name} must have only characters that file names support; got {format_value(text)}"
        )
    return Path(text)


def _can_be_encoded(text: str) -> bool:
    try:
        os.fsencode(text)
    except UnicodeEncodeError:  # lone surrogate
        return False
    return True


def instance(name: str, value: Any, kind: type[T] | tuple[type[T], ...], expected: str) -> T:
    """Check that a value has a type; ``expected`` describes it for messages: "a sensor"."""
    if not isinstance(value, kind):
        raise InvalidType(f"{name} must be {expected}; got {format_value(value)}")
    return value


# -- Types by annotations -------------------------------------------------------------------------


def validate_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Check the types of the arguments of a public function against its annotations before each
    call.

    Numbers must be numbers and not NaN; their ranges are checked by the function itself, as are
    types that an annotation leaves open (``Any``, ``ArrayLike``).

    >>> @validate_arguments
    ... def draw(path: str | Path, count: int = 1) -> None: ...
    >>> draw("a.png", count="2")
    Traceback (most recent call last):
    omnimirror.base.arguments.InvalidType: count must be an integer; got '2'
    """
    call = signature(function)

    @wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        hints = type_hints(function)
        for name, value in call.bind(*args, **kwargs).arguments.items():
            if name not in hints:
                continue  # self of a method
            if call.parameters[name].kind is Parameter.VAR_POSITIONAL:
                for i, item in enumerate(value):
                    check_type(f"{name}[{i}]", item, hints[name])
            elif call.parameters[name].kind is not Parameter.VAR_KEYWORD:
                check_type(name, value, hints[name])
        return function(*args, **kwargs)

    return wrapper


def check_fields(instance: Any) -> None:
    """Check the types of the fields of a dataclass against its annotations, in ``__post_init__``."""
    hints = type_hints(instance.__class__)
    for field in fields(instance):
        check_type(field.name, getattr(instance, field.name), hints[field.name])


@cache
def type_hints(annotated: Any) -> dict[str, Any]:
    """Return the annotations of a function or class by name of argument or field."""
    return get_type_hints(annotated)


@cache
def _origin_and_arguments(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the origin and the arguments of a generic annotation."""
    return get_origin(hint) or hint, get_args(hint)


def check_type(name: str, value: Any, hint: Any) -> None:
    """Raise InvalidType unless a value matches an annotation."""
    kind, inner = _origin_and_arguments(hint)
    if kind is Literal:
        choice(name, value, inner)
    elif not _matches(value, hint):
        raise InvalidType(f"{name} must be {_describe_type(hint)}; got {format_value(value)}")
    elif Path in inner and isinstance(value, str | Path):
        file_name(name, value)


def _matches(value: Any, hint: Any) -> bool:
    """Return whether a value matches an annotation."""
    kind, inner = _origin_and_arguments(hint)
    if kind in (Union, types.UnionType):
        return set(get_args(ArrayLike)) <= set(inner) or any(
            _matches(value, part) for part in inner
        )
    if kind is Literal:
        return isinstance(value, str) and value in inner
    if kind in NUMBERS:
        return _is_number(value) and (kind is float or isinstance(value, int | np.integer))
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is tuple and Ellipsis not in inner:
        return (
            _is_sequence(value, Sequence)
            and len(value) == len(inner)
            and all(map(_matches, value, inner))
        )
    if kind in SEQUENCE_TYPES:
        item_hint = inner[0] if inner else Any
        if item_hint is float and type(value) is tuple and set(map(type, value)) == {float}:
            return not any(map(isnan, value))  # fast path
        return _is_sequence(value, kind) and (
            not isinstance(value, Collection) or all(_matches(v, item_hint) for v in value)
        )
    if hasattr(kind, "_fields"):  # named tuple; a plain tuple is accepted
        return isinstance(value, tuple) and len(value) == len(kind._fields)
    is_open = (
        kind is Any
        or not isinstance(kind, type)
        or getattr(kind, "_is_runtime_protocol", None) is False
    )
    return is_open or isinstance(value, kind)


SEQUENCE_TYPES = {
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


def _is_sequence(value: Any, kind: Any) -> bool:
    is_iterable = (
        np.ndim(value) > 0
        if isinstance(value, np.ndarray)
        else isinstance(value, SEQUENCE_TYPES.get(kind, kind))
    )
    return is_iterable and not isinstance(value, str | bytes | bytearray | memoryview | dict)


def _describe_type(hint: Any) -> str:
    """Describe the types of an annotation in words."""
    kind, inner = _origin_and_arguments(hint)
    if kind in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_describe_type(part) for part in inner))
    if kind is Literal:
        return " or ".join(map(repr, inner))
    if kind is tuple and Ellipsis not in inner:
        return f"a tuple of {len(inner)} values ({', '.join(map(_describe_type, inner))})"
    if kind in SEQUENCE_TYPES:
        items = f" (each item: {_describe_type(inner[0])})" if inner else ""
        return f"a sequence{items}"
    if kind in TYPE_NAMES:
        return TYPE_NAMES[kind]
    name = getattr(kind, "__name__", str(kind))
    return f"{'an' if name[0] in 'AEIO' else 'a'} {name}"


TYPE_NAMES = {
    float: "a number",
    int: "an integer",
    bool: "True or False",
    str: "a string",
    Path: "a file name",
    type(None): "None",
    Callable: "a function",
    np.ndarray: "an array",
}


# -- Messages --------------------------------------------------------------------------------------


def format_value(value: Any) -> str:
    """Format a value for an error message.

    >>> format_value("room"), format_value(range(3)), format_value([1.5] * 100_000)
    ("'room'", 'range(0, 3)', '[1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1...')
    """
    if isinstance(value, str | bytes | list | tuple):
        value = value[: 2 * MAX_VALUE_CHARACTERS]  # the rest is not displayed
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # integers of thousands of digits have no text
        text = f"a {type(value).__name__}"
    is_short = len(text) <= MAX_VALUE_CHARACTERS
    return text if is_short else f"{text[: MAX_VALUE_CHARACTERS - 3]}..."


def _range(low: float, high: float, unit: str) -> str:
    unit = f" {unit}" if unit else ""
    if np.isinf(low) and np.isinf(high):
        return "finite"
    if np.isinf(high):
        return f"finite and at least {low:g}{unit}"
    if np.isinf(low):
        return f"finite and at most {high:g}{unit}"
    return f"between {low:g} and {high:g}{unit}"
