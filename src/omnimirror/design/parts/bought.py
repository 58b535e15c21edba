"""Sensor design for one combination of parts: mirror, aperture and focus."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.files import json_plain
from ...optics.sensor import Sensor
from ..catalogue.catalogue import BallComponent, LensComponent
from ..catalogue.selection import rings_for
from ..catalogue.whole import mass_g, whole_of
from ..criteria.field_angles import counted_field
from ..criteria.ranges import ends, is_free
from ..criteria.requirements import PartsRequirements, Requirements
from ..solve.candidates import Candidate, focusing, make, sketched, viewing
from ..solve.designer import Design, design_of
from ..solve.range_search import RangeSearch
from ..solve.verdict import Judgement, Verdict, evaluations, judge
from .combinations import PartsCombination, asked_of

SCREENED = 31  # mirror points during the choice of the aperture
BLURRED = "more blurred than a cheaper one"
SLACK = 0.02  # relative violation of a limit of blur permitted in the screening
SEARCHED = 181  # field angles of the preliminary requirement check
BEYOND_RIM = 1.2  # relative to the distance of the rim: approximate distance of the virtual images
SETTLED, ROUNDS = 1e-6, 12  # tolerance, iterations of the rim of a ball, which depends on the viewing angle


@dataclass(frozen=True)
class BoughtDesign:
    """Combination of parts with its sensor design.

    Attributes
    ----------
    combination
    design
        Sensor, with one row for each requirement, those of the whole last.
    ring_mm
        Thickness of the extension rings required for the focus.
    price, mass_g
        Price and mass of the whole; None if that of a part is unknown.
    worst_floored_area_deg2
        Worst floored blur area over the evaluated field.
    """

    combination: PartsCombination
    design: Design
    ring_mm: float
    price: float | None
    mass_g: float | None
    worst_floored_area_deg2: float

    @property
    def is_met(self) -> bool:
        """Return whether all requirements are met."""
        return self.design.is_met

    def to_dict(self) -> dict[str, Any]:
        """Return the design as plain data for JSON."""
        parts: dict[str, Any] = {part.KIND: part.name for part in self.combination.parts}
        if extras := self.combination.extras:
            parts["extra"] = [part.name for part in extras]
        numbers = {
            "ring_mm": self.ring_mm, "price": self.price, "mass_g": self.mass_g,
            "worst_floored_area_deg2": self.worst_floored_area_deg2,
        }  # fmt: skip
        data: dict[str, Any] = json_plain({**parts, **numbers, **self.design.to_dict()})
        return data


def design_bought(
    asked: Requirements, combination: PartsCombination, most_area_deg2: float = np.inf
) -> BoughtDesign | str:
    """Return the best sensor of a combination, or the reason for an early rejection.

    Parameters
    ----------
    asked
        Requirements with ``parts``.
    combination
        Combination that satisfies all necessary conditions.
    most_area_deg2
        Worst floored blur area of a cheaper design, an upper limit.
    """
    own = asked_of(asked, combination)
    try:
        made = _made(own, combination, most_area_deg2)
        if isinstance(made, str):
            return made
        found = _judged(asked, own, combination, made.sensor, SEARCHED)
        if not found.is_met:
            return found
        return _judged(asked, own, combination, made.sensor)
    except OmnimirrorError:
        return "no such mirror"


def _judged(
    asked: Requirements, own: Requirements, combination: PartsCombination, sensor: Sensor, angles: int | None = None
) -> BoughtDesign:
    verdict = judge(own, sensor) if angles is None else judge(own, sensor, angles=angles)
    assert asked.parts is not None
    ring, reasons = 0.0, list[str]()
    if isinstance(combination.lens, LensComponent):
        ring, reasons = rings_for(combination.lens, sensor.lens.focus_distance_mm)
    mass = mass_g(sensor, combination.parts)
    rows = [*verdict.rows, *whole_rows(asked.parts, combination, sensor, mass)]
    if reasons:
        nearest = combination.lens.minimum_focus_mm if isinstance(combination.lens, LensComponent) else 0.0
        rows.append(
            Judgement("minimum_focus_mm", "mm", nearest, None, sensor.lens.focus_distance_mm, remarks=tuple(reasons))
        )
    notes = (f"parts: {combination.name}", *((f"extension rings of {ring:g} mm",) if ring else ()))
    design = design_of(Verdict(verdict.requirements, verdict.sensor, tuple(rows)), notes)
    area = worst_area(own, sensor)
    return BoughtDesign(combination, design, ring, combination.price, mass, area)


def worst_area(own: Requirements, sensor: Sensor) -> float:
    """Return the worst floored blur area, deg2, over the evaluated field and objects."""
    low, high, _ = counted_field(own.field, sensor).part()
    results = evaluations(own, sensor, np.linspace(low, high, SEARCHED))
    return max(float(result.floored_area_deg2.max()) for result in results)


def whole_rows(
    parts: PartsRequirements, combination: PartsCombination, sensor: Sensor, mass: float | None
) -> list[Judgement]:
    """Return the requirement rows of the whole sensor."""
    size = whole_of(sensor, combination.parts)
    reached = {
        "price": (parts.most_price, combination.price, ""),
        "mass_g": (parts.most_mass_g, mass, "g"),
        "diameter_mm": (parts.most_diameter_mm, size.diameter_mm, "mm"),
        "height_mm": (parts.most_height_mm, size.height_mm, "mm"),
    }
    return [
        Judgement(f"whole, {name}", unit, None, most, np.nan if value is None else value)
        for name, (most, value, unit) in reached.items()
        if most is not None
    ]


# -- mirror, aperture, focus -----------------------------------------------------------------------


def _made(own: Requirements, combination: PartsCombination, most_area_deg2: float) -> Candidate | str:
    """Return the sensor at the aperture of the largest blur margin, or the reason for rejection."""
    if combination.ball is None and set(RangeSearch(own).free) - {"f_number"}:
        return RangeSearch(own).best().made
    rough, span = _sketched(own, combination), ends(own.lens.f_number)
    if np.isfinite(most_area_deg2):
        sharpest = focusing(replace(own, limits=()), rough, SCREENED).best_aperture(span)[1]
        if sharpest.cost > most_area_deg2 * (1 + SLACK):
            return BLURRED
    f_number, focus = focusing(own, rough, SCREENED).best_aperture(span)
    if focus.cost > SLACK and any(limit.of.is_sharpness for limit in own.limits):
        return "too blurred"
    settled = own.changed(f_number=f_number)
    return make(settled) if combination.ball is None else _of_ball(settled, combination.ball)


def _sketched(own: Requirements, combination: PartsCombination) -> Sensor:
    """Return the sensor before focusing, with the mirror for an approximate focus.

    Two iterations from an initial estimate are sufficient: the residual is small relative to the
    slack.
    """
    settled = own.changed(f_number=ends(own.lens.f_number)[1])
    nearness = 0.0
    if isinstance(combination.lens, LensComponent):
        radius_mm, ball = own.largest_image_px * own.imager.pitch_mm, combination.ball
        beyond = BEYOND_RIM * (ends(own.mirror.rim_radius_mm)[0] if ball is None else _rim_mm(own, 0.0, ball))
        nearness = 1 / combination.lens.focal_length_mm / (1 + beyond / radius_mm)
    for _ in range(2):
        if combination.ball is not None:
            theta = 0.0 if own.lens.is_telecentric else viewing(settled, nearness)[0]
            settled = settled.changed(rim_radius_mm=_rim_mm(own, theta, combination.ball))
        rough = sketched(settled, nearness)
        if own.lens.is_telecentric or not own.lens.fills_imager:
            break
        nearness = 1 / focusing(settled, rough, SCREENED).best_aperture(ends(settled.lens.f_number))[1].focus_mm
    return rough


def _rim_mm(own: Requirements, theta_deg: float, ball: BallComponent) -> float:
    """Return the rim of the cap of a ball: ``M = R sin((Omega_max - Theta)/2)``, Eqs. 2 to 5."""
    return ball.ball_diameter_mm / 2 * float(np.sin(np.radians((own.field.omega_max_deg - theta_deg) / 2)))


def _of_ball(settled: Requirements, ball: BallComponent) -> Candidate | str:
    """Return the sensor with the cap of a ball, with consistent rim and viewing angle."""
    low, high = ends(settled.mirror.rim_radius_mm)
    theta = 0.0
    for _ in range(ROUNDS):
        rim = _rim_mm(settled, theta, ball)
        made = make(settled.changed(rim_radius_mm=rim))
        before, theta = theta, float(np.degrees(made.sensor.meridian.theta_max))
        if abs(theta - before) < SETTLED:
            break
    if not low * (1 - SETTLED) <= rim <= high * (1 + SETTLED):
        return "another rim radius"
    return made


def check_free(asked: Requirements) -> None:
    """Check that no free range conflicts with a mirror ball.

    Raises
    ------
    InvalidParameter
        Conflicting range.
    """
    assert asked.parts is not None
    if asked.parts.mirror == "ball" and is_free(asked.lens.theta_max_deg):
        raise InvalidParameter(
            "theta_max_deg of a bought ball follows from lens and imager; leave it out, or give a number"
        )
