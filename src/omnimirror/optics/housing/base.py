"""Base class of housing parts, and the envelope to which they are fitted."""

from __future__ import annotations

from dataclasses import fields
from typing import ClassVar, NamedTuple

from ...base.arguments import check_fields
from ...base.parameters import Parameter


class HousingPart:
    """Part of a housing: it validates its parameters; None values are fitted to the sensor."""

    PARAMETERS: ClassVar[dict[str, Parameter]]

    def __post_init__(self) -> None:
        check_fields(self)
        for f in fields(self):  # type: ignore[arg-type]  # every part is a dataclass
            value = getattr(self, f.name)
            if value is not None:
                self.PARAMETERS[f.name].check(f.name, value)


class Envelope(NamedTuple):
    """Dimensions of a sensor for fitting its housing. Heights above the vertex, mm."""

    lens_mm: float
    """Height of the plane of the lens, negative."""
    base_mm: float
    """Base of a tube: the plane of the lens, or the back of a second mirror."""
    back_mm: float
    """Height of the back of the mirror's body."""
    outer_mm: float
    """Outer radius of the mirror with its rim."""
    has_secondary: bool = False
