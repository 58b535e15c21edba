"""Names of what a built sensor is held to: merits of its trials, and what requirements limit in their own words.

A name is what a table shows and what ``--merit`` takes: ``motion_px after pose``, ``total_blur_px, 20 to 100 deg``,
``mtf at 0.25 cycles/px``. What is to be at least so much begins with ``least``: ``least resolution_px_per_deg``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from .....arguments import shown
from .....errors import InvalidParameter
from ..compensation import CALIBRATIONS
from ..merits import after, merit_names

if TYPE_CHECKING:
    from .....design.criteria.limits import Limit

LEAST = "least "
STRAIGHTNESS = "straightness_deg"
OF_BUILT = (STRAIGHTNESS, "viewpoint_shift_mm", "rim_reach_px", "field_to_deg")
"""Quantities that sensors without errors have no limits of."""
OF_LEAST = ("field_to_deg",)
UNLIMITED = ("focus_distance_mm", "lost_rays")
NUMBER = r"([-+.\deE]+)"
WORDS = re.compile(
    rf"(?P<least>{LEAST})?(?P<quantity>\w+)(?: at {NUMBER} cycles/px)?(?:, (?:at {NUMBER}|{NUMBER} to {NUMBER}) deg)?"
    r"(?: after (?P<after>[-\w]+))?"
)


def _limits() -> Any:
    """Of requirements; they bring all of design with them, which most trials do not need."""
    from .....design.criteria import limits

    return limits


@dataclass(frozen=True)
class MeritName:
    """A name, taken apart.

    Attributes
    ----------
    quantity
        Of the vocabulary.
    is_least
        Whether the least counts and not the largest.
    omega_deg
        Part of the field, deg; all of it without.
    cycles_per_px
        Spatial frequency of an MTF.
    after
        What a calibration leaves, of motions, directions and straightness.
    """

    quantity: str
    is_least: bool = False
    omega_deg: tuple[float, float] | None = None
    cycles_per_px: float | None = None
    after: str = "none"

    @property
    def text(self) -> str:
        """The name.

        >>> MeritName("resolution_px_per_deg", True, (20.0, 100.0)).text
        'least resolution_px_per_deg, 20 to 100 deg'
        """
        frequency = "" if self.cycles_per_px is None else f" at {self.cycles_per_px:g} cycles/px"
        words = f"{LEAST if self.is_least else ''}{self.quantity}{frequency}{_limits().told_part(self.omega_deg)}"
        return after(words, self.after)  # type: ignore[arg-type]  # a word that is no calibration is refused

    def limit(self, value: float) -> Limit:
        """As requirements have it."""
        most, least = (None, value) if self.is_least else (value, None)
        found: Limit = _limits().Limit(self.quantity, most, least, self.omega_deg, self.cycles_per_px)
        return found


@lru_cache(maxsize=1024)
def named(name: str) -> MeritName:
    """A name, taken apart.

    Raises
    ------
    InvalidParameter
        It is the name of nothing that sensors are judged by.

    >>> named("mtf at 0.25 cycles/px, at 90 deg").cycles_per_px
    0.25
    """
    found = WORDS.fullmatch(name) if isinstance(name, str) else None
    if found is None:
        raise _unknown(name)
    try:
        cycles, at, low, high = (None if part is None else float(part) for part in found.group(3, 4, 5, 6))
    except ValueError:
        raise _unknown(name) from None
    part = (at, at) if at is not None else (low, high) if low is not None and high is not None else None
    parsed = MeritName(found["quantity"], found["least"] is not None, part, cycles, found["after"] or "none")
    _check(parsed, name)
    return parsed


def _check(merit: MeritName, name: str) -> None:
    plain = merit.omega_deg is None and merit.cycles_per_px is None
    if name in merit_names() and merit.quantity not in UNLIMITED:
        return
    if merit.quantity in OF_BUILT:
        is_calibrated = merit.after == "none" or (merit.quantity == STRAIGHTNESS and merit.after in CALIBRATIONS)
        if plain and is_calibrated and merit.is_least == (merit.quantity in OF_LEAST):
            return
        right = MeritName(merit.quantity, merit.quantity in OF_LEAST)
        raise InvalidParameter(f"{shown(name)} is not judged; {right.text!r} is, of the whole picture")
    if merit.quantity not in _limits().LIMITABLE or merit.after != "none":
        raise _unknown(name)


def _unknown(name: object) -> InvalidParameter:
    plain = [each for each in merit_names() if " after " not in each and each not in UNLIMITED]
    built = [MeritName(quantity, quantity in OF_LEAST).text for quantity in OF_BUILT]
    calibrations = ", ".join(CALIBRATIONS[1:])
    return InvalidParameter(
        f"{shown(name)} is nothing that trials are judged by; valid are {', '.join(plain + built)}; motions, "
        f"directions and straightness with 'after' and one of {calibrations}, as in 'motion_px after affine'; and what "
        "requirements limit, as in 'total_blur_px, 20 to 100 deg' or 'least resolution_px_per_deg'"
    )


def is_required(name: str) -> bool:
    """Whether a merit is worked out only where it is asked for.

    >>> is_required("motion_px after pose"), is_required("total_blur_px")
    (False, True)
    """
    return name not in merit_names()


def required_of(names: Iterable[str]) -> tuple[str, ...]:
    """Those of some merits that are worked out only where they are asked for."""
    return tuple(name for name in dict.fromkeys(names) if is_required(name))


def is_least(name: str) -> bool:
    """Whether a limit of it is one from below.

    >>> is_least("least field_to_deg")
    True
    """
    return name.startswith(LEAST)


def check_limit(name: str, value: float) -> None:
    """Refuse a limit of nothing, or one that nothing meets."""
    merit = named(name)
    if merit.quantity in _limits().LIMITABLE and is_required(name):
        merit.limit(value)
    elif not value > 0:
        raise InvalidParameter(
            f"the limit {name} {'at least' if merit.is_least else 'at most'} {value:g} is valid above 0"
        )


def names_of(limit: Limit) -> dict[str, float]:
    """A limit of requirements as limits of merits, a side each.

    >>> import omnimirror as om
    >>> names_of(om.Limit("aspect", at_least=0.8, at_most=1.2))
    {'aspect': 1.2, 'least aspect': 0.8}
    """
    sides = ((False, limit.at_most), (True, limit.at_least))
    return {
        MeritName(limit.quantity, is_least, limit.omega_deg, limit.cycles_per_px).text: value
        for is_least, value in sides
        if value is not None
    }
