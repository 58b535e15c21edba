"""How a part of a sensor describes its parameters to whoever reads, checks or varies them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .arguments import numbers, shown
from .errors import InvalidParameter


@dataclass(frozen=True)
class Parameter:
    """What a sensor file, a slider, an optimiser or a tolerance needs to know of one parameter."""

    unit: str
    low: float
    high: float
    description: str = ""
    choices: tuple[str, ...] = field(default=())
    """Valid words, for a parameter that is a word and no number."""

    def check(self, name: str, value: Any) -> None:
        """Raise InvalidParameter with the valid range unless every number in value is inside it."""
        if self.choices:
            if not isinstance(value, str) or value not in self.choices:
                raise InvalidParameter(f"{name} = {shown(value)} is not one of {', '.join(self.choices)}")
            return
        if isinstance(value, list | tuple) and not value:
            return  # how many there have to be is the part's own affair
        for i, number in enumerate(numbers(name, value).ravel()):
            if not self.low <= number <= self.high:
                label = f"{name}[{i}]" if np.ndim(value) else name
                unit = f" {self.unit}" if self.unit else ""
                raise InvalidParameter(f"{label} = {number:g}{unit} is outside {self.low:g} to {self.high:g}{unit}")
