"""Numbers or ranges: entries with a free value between two ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from ..base.arguments import format_value, numbers
from ..base.errors import InvalidParameter

Range = float | tuple[float, float]
"""Number, or range (low, high) of a free value."""


def ends(value: Range) -> tuple[float, float]:
    """Return low and high end of a range; both are equal for a number.

    >>> ends(12.0), ends((8, 12))
    ((12.0, 12.0), (8.0, 12.0))
    """
    pair = np.atleast_1d(numbers("a range", value))
    if pair.shape not in ((1,), (2,)):
        raise InvalidParameter(
            f"must be a number or a range (low, high); got {format_value(value)}"
        )
    return float(pair[0]), float(pair[-1])


def ends_or_none(value: Range | None) -> tuple[float, float] | None:
    """Return the ends of an optional range."""
    return None if value is None else ends(value)


def is_free(value: Range | None) -> bool:
    """Return whether a value is free: a range with different ends.

    >>> is_free(12.0), is_free((8.0, 12.0)), is_free(None)
    (False, True, False)
    """
    return isinstance(value, tuple) and value[0] < value[1]


def between(low: float, high: float, endless: bool = False) -> PlainValidator:
    """Return a validator for a number or an increasing pair between low and high.

    ``endless`` permits inf as the high end.
    """

    def check(value: Any) -> Range:
        try:
            first, last = np.broadcast_to(numbers("a range", value), 2).tolist()
        except ValueError:  # not numeric, or more than two values
            first, last = np.nan, np.nan
        if endless and last == np.inf:
            last = high
        if not low <= first <= last <= high:
            raise PydanticCustomError(
                "range",
                f"it should be a number from {low:g} to {high:g}, or a range [LOW, HIGH] of them",
            )
        return first if first == last else (first, last)

    return PlainValidator(check)
