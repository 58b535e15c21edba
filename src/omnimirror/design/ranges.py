"""Numbers or ranges: entries with a free value between two ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import no_info_plain_validator_function

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


@dataclass(frozen=True)
class Between:
    """Annotation of entries that are a number or an increasing pair between low and high.

    ``endless`` permits inf as the high end.
    """

    low: float
    high: float
    endless: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: Any) -> dict[str, Any]:
        number = {"type": "number", "minimum": self.low}
        if not self.endless:
            number["maximum"] = self.high
        return {"anyOf": [number, {"type": "array", "items": number, "minItems": 2, "maxItems": 2}]}

    def _check(self, value: Any) -> Range:
        low, high = self.low, self.high
        try:
            first, last = np.broadcast_to(numbers("a range", value), 2).tolist()
        except ValueError:  # not numeric, or more than two values
            first, last = np.nan, np.nan
        if self.endless and last == np.inf:
            last = high
        if not low <= first <= last <= high:
            raise PydanticCustomError(
                "range",
                f"it should be a number from {low:g} to {high:g}, or a range [LOW, HIGH] of them",
            )
        return first if first == last else (first, last)
