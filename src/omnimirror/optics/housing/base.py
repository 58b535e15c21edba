"""What every part of a housing is, and what it is fitted to."""

from __future__ import annotations

from dataclasses import fields
from typing import ClassVar, NamedTuple

from ...base.arguments import check_fields
from ...base.parameters import Parameter


class HousingPart:
    """A part of a housing: it checks its own numbers; what is None is fitted to the sensor."""

    PARAMETERS: ClassVar[dict[str, Parameter]]

    def __post_init__(self) -> None:
        check_fields(self)
        for f in fields(self):  # type: ignore[arg-type]  # every part is a dataclass
            value = getattr(self, f.name)
            if value is not None:
                self.PARAMETERS[f.name].check(f.name, value)


class Envelope(NamedTuple):
    """The sensor as a housing sees it: what it is fitted to. Heights over the vertex, mm."""

    lens_mm: float
    """Of the lens's plane, below 0."""
    base_mm: float
    """Where a tube begins: the plane of the lens, or the back of a second mirror."""
    back_mm: float
    """Of the back of the mirror's body."""
    outer_mm: float
    """Radius of the mirror with its rim."""
    has_secondary: bool = False
