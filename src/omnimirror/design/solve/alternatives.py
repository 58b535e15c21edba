"""Discrete alternatives for infeasible requirements: apex, mirror, filled side, imager.

A separate search verifies each alternative. It is shorter than the search of the main design;
therefore the result of an alternative may be better than reported, but never worse.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ...base.errors import OmnimirrorError
from ...optics.image_sensor import Imager
from ...optics.mirrors.generated import MAPPINGS
from ..catalogue.catalogue import ImagerComponent, read_catalogue
from ..construct.families import FAMILIES
from ..criteria.consistency import OF_MAPPINGS
from ..criteria.requirements import Requirements
from .range_search import RangeSearch
from .space import Say
from .verdict import Verdict, judge

STARTS = 1  # searches for each alternative
IMAGERS = 3  # larger imagers of the catalogue, the smallest of them first
MIN_GAIN = 0.01  # relative decrease of the largest violation that makes an alternative worth reporting


@dataclass(frozen=True)
class Alternative:
    """Alternative value of a discrete choice, with its result.

    Attributes
    ----------
    entry
        Entry of the requirement file, for example ``"mirror.apex"``.
    asked, value
        Requested value and alternative.
    missed
        Requirements that the alternative misses; empty if it meets all.
    worst
        Largest relative violation; 0 if all requirements are met.
    """

    entry: str
    asked: str
    value: str
    missed: tuple[str, ...]
    worst: float

    @property
    def is_met(self) -> bool:
        """Return whether the alternative meets all requirements."""
        return not self.missed


def find_alternatives(requirements: Requirements, verdict: Verdict, say: Say) -> Iterator[Alternative]:
    """Yield the alternatives that meet all requirements or violate them less than a design does.

    Parameters
    ----------
    verdict
        Design with the requested choices.
    say
        Callback for progress messages, called before each alternative.
    """
    for entry, asked, value, other in _choices(requirements):
        say(f"alternative {entry} = {value}")
        try:
            found = RangeSearch(other).best(enough=0.0, starts=STARTS)
            reached = judge(other, found.made.sensor)
        except OmnimirrorError:
            continue
        if reached.is_met or reached.worst < (1 - MIN_GAIN) * verdict.worst:
            yield Alternative(entry, asked, value, reached.missed, reached.worst)


def _choices(requirements: Requirements) -> Iterator[tuple[str, str, str, Requirements]]:
    """Yield entry, requested value, other value and changed requirements of each choice."""
    mirror, lens, imager = requirements.mirror, requirements.lens, requirements.imager
    apex = "smooth" if mirror.is_pointed else "pointed"
    choices: list[tuple[str, str, str, dict[str, Any]]] = []
    if mirror.mapping not in (None, "cylinder"):
        choices.append(("mirror.apex", mirror.apex, apex, {"apex": apex}))
    if imager.width_px != imager.height_px:
        side = "long-side" if lens.fills == "short-side" else "short-side"
        choices.append(("lens.fills", lens.fills, side, {"fills": side}))
    kind = mirror.mapping or mirror.family or ""
    none = dict.fromkeys((*OF_MAPPINGS, "mapping", "family", "conic", "fit"))
    smooth = none | {"apex": "smooth"}
    choices += [("mirror.family", kind, name, smooth | {"family": name}) for name in FAMILIES if name != kind]
    choices += [
        ("mirror.mapping", kind, name, smooth | {"mapping": name})
        for name in MAPPINGS
        if name not in (kind, "tabulated-mapping", "cylinder", "ground-plane")
    ]
    for entry, asked, value, entries in choices:
        try:
            yield entry, asked, value, requirements.changed(**entries)
        except OmnimirrorError:  # the choice does not fit the other entries
            continue
    for part in _larger_imagers(requirements):
        asked = f"{imager.width_px} x {imager.height_px} px of {imager.pixel_pitch_um:g} um"
        larger = Imager(part.width_px, part.height_px, part.pixel_pitch_um)
        yield "imager", asked, part.name, replace(requirements, imager=larger)


def _larger_imagers(requirements: Requirements) -> list[ImagerComponent]:
    """Return the bundled imagers with a larger short side in pixels, smallest first."""

    def short_side(imager: Imager | ImagerComponent) -> int:
        return min(imager.width_px, imager.height_px)

    larger = [part for part in read_catalogue().imagers if short_side(part) > short_side(requirements.imager)]
    return sorted(larger, key=short_side)[:IMAGERS]
