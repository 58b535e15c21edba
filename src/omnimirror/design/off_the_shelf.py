"""Design with off-the-shelf parts: search among their combinations, and a mirror for each."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..base.arguments import instance, integer, validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import json_plain
from ..base.logs import OnProgress
from ..base.results import Columns, Result, record_of, table_of
from ..base.worker_processes import WorkerPool
from ..optics.sensor import Sensor
from ._candidates import Candidate, focusing, make, sketched, viewing
from ._parameter_search import RangeSearch
from ._part_combinations import PartsCombination, combinations_of, cut, requirements_with_parts
from .catalogue import BallComponent, Catalogue, LensComponent, read_catalogue
from .component_selection import rings_for
from .designer import Design, design_of
from .merits import mass_g, outer_size
from .requirement_check import (
    RequirementCheck,
    Verdict,
    check_requirements,
    evaluable_field,
    evaluations,
)
from .requirements import PartsRequirements, Requirements, ends, is_free

LOGGER = logging.getLogger(__name__)

# -- Sensor design for one combination of parts: mirror, aperture and focus ------------------------

SCREENED = 31  # mirror points during the choice of the aperture
BLURRED = "more blur than a cheaper combination"
SLACK = 0.02  # relative violation of a limit of blur permitted in the screening
SEARCHED = 181  # field angles of the preliminary requirement check
BEYOND_RIM = 1.2  # relative to the distance of the rim: approximate distance of the virtual images
SETTLED, ROUNDS = (
    1e-6,
    12,
)  # tolerance, iterations of the rim of a ball, which depends on the viewing angle


@dataclass(frozen=True)
class PartsDesign(Result):
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

    def _table(self) -> Columns:
        return table_of([self._record()])

    def _record(self) -> dict[str, Any]:
        """Return parts and properties of the whole as a row of the table."""
        parts = {part.KIND: part.name for part in self.combination.parts}
        return {**parts, **record_of(self), "is_met": self.is_met}

    @property
    def is_met(self) -> bool:
        """True if all requirements are met."""
        return self.design.is_met

    def to_dict(self) -> dict[str, Any]:
        """Return the design as plain data for JSON."""
        parts: dict[str, Any] = {part.KIND: part.name for part in self.combination.parts}
        if extras := self.combination.extras:
            parts["extra"] = [part.name for part in extras]
        numbers = {
            "ring_mm": self.ring_mm,
            "price": self.price,
            "mass_g": self.mass_g,
            "worst_floored_area_deg2": self.worst_floored_area_deg2,
        }
        data: dict[str, Any] = json_plain({**parts, **numbers, **self.design.to_dict()})
        return data


def design_combination(
    requested: Requirements, combination: PartsCombination, max_area_deg2: float = np.inf
) -> PartsDesign | str:
    """Return the best sensor of a combination, or the reason for an early rejection.

    Parameters
    ----------
    requested
        Requirements with ``parts``.
    combination
        Combination that satisfies all necessary conditions.
    max_area_deg2
        Worst floored blur area of a cheaper design, an upper limit.
    """
    own = requirements_with_parts(requested, combination)
    try:
        solution = _made(own, combination, max_area_deg2)
        if isinstance(solution, str):
            return solution
        result = _evaluated(requested, own, combination, solution.sensor, SEARCHED)
        if not result.is_met:
            return result
        return _evaluated(requested, own, combination, solution.sensor)
    except OmnimirrorError:
        return "no feasible mirror"


def _evaluated(
    requested: Requirements,
    own: Requirements,
    combination: PartsCombination,
    sensor: Sensor,
    angles: int | None = None,
) -> PartsDesign:
    verdict = (
        check_requirements(own, sensor)
        if angles is None
        else check_requirements(own, sensor, angles=angles)
    )
    assert requested.parts is not None
    ring, reasons = 0.0, list[str]()
    if isinstance(combination.lens, LensComponent):
        ring, reasons = rings_for(combination.lens, sensor.lens.focus_distance_mm)
    mass = mass_g(sensor, combination.parts)
    rows = [*verdict.rows, *whole_rows(requested.parts, combination, sensor, mass)]
    if reasons:
        nearest = (
            combination.lens.minimum_focus_mm
            if isinstance(combination.lens, LensComponent)
            else 0.0
        )
        rows.append(
            RequirementCheck(
                "minimum_focus_mm",
                "mm",
                nearest,
                None,
                sensor.lens.focus_distance_mm,
                remarks=tuple(reasons),
            )
        )
    notes = (f"parts: {combination.name}", *((f"extension rings of {ring:g} mm",) if ring else ()))
    design = design_of(Verdict(verdict.requirements, verdict.sensor, tuple(rows)), notes)
    area = worst_area(own, sensor)
    return PartsDesign(combination, design, ring, combination.price, mass, area)


def worst_area(own: Requirements, sensor: Sensor) -> float:
    """Return the worst floored blur area, deg2, over the evaluated field and objects."""
    low, high, _ = evaluable_field(own.field, sensor).part()
    results = evaluations(own, sensor, np.linspace(low, high, SEARCHED))
    return max(float(result.floored_area_deg2.max()) for result in results)


def whole_rows(
    parts: PartsRequirements, combination: PartsCombination, sensor: Sensor, mass: float | None
) -> list[RequirementCheck]:
    """Return the requirement rows of the whole sensor."""
    size = outer_size(sensor, combination.parts)
    reached = {
        "price": (parts.max_price, combination.price, ""),
        "mass_g": (parts.max_mass_g, mass, "g"),
        "diameter_mm": (parts.max_diameter_mm, size.diameter_mm, "mm"),
        "height_mm": (parts.max_height_mm, size.height_mm, "mm"),
    }
    return [
        RequirementCheck(f"whole, {name}", unit, None, maximum, np.nan if value is None else value)
        for name, (maximum, value, unit) in reached.items()
        if maximum is not None
    ]


# -- mirror, aperture, focus -----------------------------------------------------------------------


def _made(
    own: Requirements, combination: PartsCombination, max_area_deg2: float
) -> Candidate | str:
    """Return the sensor at the aperture of the largest blur margin, or the reason for rejection."""
    if combination.ball is None and set(RangeSearch(own).free) - {"f_number"}:
        return RangeSearch(own).best().made
    rough, span = _sketched(own, combination), ends(own.lens.f_number)
    if np.isfinite(max_area_deg2):
        sharpest = focusing(replace(own, limits=()), rough, SCREENED).best_aperture(span)[1]
        if sharpest.cost > max_area_deg2 * (1 + SLACK):
            return BLURRED
    f_number, focus = focusing(own, rough, SCREENED).best_aperture(span)
    if focus.cost > SLACK and any(limit.of.is_sharpness for limit in own.limits):
        return "too much blur"
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
        beyond = BEYOND_RIM * (
            ends(own.mirror.rim_radius_mm)[0] if ball is None else _rim_mm(own, 0.0, ball)
        )
        nearness = 1 / combination.lens.focal_length_mm / (1 + beyond / radius_mm)
    for _ in range(2):
        if combination.ball is not None:
            theta = 0.0 if own.lens.is_telecentric else viewing(settled, nearness)[0]
            settled = settled.changed(rim_radius_mm=_rim_mm(own, theta, combination.ball))
        rough = sketched(settled, nearness)
        if own.lens.is_telecentric or not own.lens.fills_imager:
            break
        nearness = (
            1
            / focusing(settled, rough, SCREENED)
            .best_aperture(ends(settled.lens.f_number))[1]
            .focus_mm
        )
    return rough


def _rim_mm(own: Requirements, theta_deg: float, ball: BallComponent) -> float:
    """Return the rim of the cap of a ball: ``M = R sin((Omega_max - Theta)/2)``, Eqs. 2 to 5."""
    return (
        ball.ball_diameter_mm
        / 2
        * float(np.sin(np.radians((own.field.omega_max_deg - theta_deg) / 2)))
    )


def _of_ball(settled: Requirements, ball: BallComponent) -> Candidate | str:
    """Return the sensor with the cap of a ball, with consistent rim and viewing angle."""
    low, high = ends(settled.mirror.rim_radius_mm)
    theta = 0.0
    for _ in range(ROUNDS):
        rim = _rim_mm(settled, theta, ball)
        candidate = make(settled.changed(rim_radius_mm=rim))
        before, theta = theta, float(np.degrees(candidate.sensor.meridian.theta_max))
        if abs(theta - before) < SETTLED:
            break
    if not low * (1 - SETTLED) <= rim <= high * (1 + SETTLED):
        return "different rim radius"
    return candidate


def check_free(requested: Requirements) -> None:
    """Check that no free range conflicts with a mirror ball.

    Raises
    ------
    InvalidParameter
        If a range conflicts with the parts.
    """
    assert requested.parts is not None
    if requested.parts.mirror == "ball" and is_free(requested.lens.theta_max_deg):
        raise InvalidParameter(
            "theta_max_deg must be omitted or a number for a mirror ball from a catalogue, not a range"
        )


# -- Search among combinations of parts: necessary conditions, then designs in order of price ------
#
# Combinations that violate a necessary condition (:mod:`.combinations`) are not designed. The others
# are designed in order of price until the requested number of feasible designs is reached; or all of
# them for the front of price and blur, which retains those sharper than every cheaper one.

BLOCK = 32  # combinations per process with the same limit of the blur
MAX_SERIAL_COMBINATIONS = 64  # up to this number, no other processes are used


@dataclass(frozen=True)
class PartsSearch(Result):
    """Result of :func:`omnimirror.design_from_parts`.

    Attributes
    ----------
    found
        Feasible designs, cheapest first; for a front those sharper than every cheaper one.
    nearest
        Without a feasible design: the one with the smallest violation, if a design exists.
    combinations
        Number of combinations.
    cut
        Number of combinations rejected before the mirror design, by reason.
    missed
        Number of infeasible designs, by the first missed requirement.
    left
        Number of combinations not evaluated, all of them more expensive.
    """

    requirements: Requirements
    found: tuple[PartsDesign, ...]
    nearest: PartsDesign | None
    combinations: int
    cut: dict[str, int]
    missed: dict[str, int]
    left: int

    def _table(self) -> Columns:
        nearest = () if self.nearest is None else (self.nearest,)
        return table_of(design._record() for design in self.found or nearest)

    @property
    def is_met(self) -> bool:
        """True if a combination meets all requirements."""
        return bool(self.found)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""
        counts = {
            "combinations": self.combinations,
            "cut": self.cut,
            "missed": self.missed,
            "left": self.left,
        }
        nearest = None if self.nearest is None else self.nearest.to_dict()
        data: dict[str, Any] = json_plain(
            {"found": [design.to_dict() for design in self.found], "nearest": nearest, **counts}
        )
        return data


@validate_arguments
def design_from_parts(
    requirements: Requirements,
    catalogue: Catalogue | None = None,
    *,
    max_designs: int = 10,
    front: bool = False,
    processes: int = 1,
    on_progress: OnProgress | None = None,
) -> PartsSearch:
    """Design a mirror for each combination of catalogue parts that may meet the requirements.

    Each combination of lens and imager and, if required, mirror ball and dome has its own mirror,
    distance, aperture and focus; lens entries of the requirements (focal length, F-number, focus)
    restrict the choice of lenses.

    Parameters
    ----------
    requirements
        Requirements with ``parts``.
    catalogue
        Catalogue from :func:`omnimirror.read_catalogue`; by default that of the requirements.
    max_designs
        Stop after this number of feasible combinations; cheapest first.
    front
        Alternatively, return all designs sharper than every cheaper one, by worst floored blur
        area.
    processes
        Number of parallel processes.
    on_progress
        Callback of the number of designed combinations and their total number.

    Returns
    -------
    PartsSearch
        Designs, and the number of rejected combinations by reason.

    Raises
    ------
    InvalidParameter
        If the requirements have no parts, a count is below 1, or the catalogue lacks a required
        ball or dome.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=100),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=30),
    ...     lens=om.LensRequirements(f_number=(1, 16)),
    ...     limits=[om.Limit("total_blur_deg", at_most=1.0)],
    ...     parts=om.PartsRequirements(max_price=300),
    ... )
    >>> search = om.design_from_parts(requirements, max_designs=2)
    >>> [round(design.price) for design in search.found]
    [33, 33]
    """
    instance("requirements", requirements, Requirements, "requirements")
    if requirements.parts is None:
        raise InvalidParameter(
            "the requirements must contain parts; use design_sensor for a design without parts"
        )
    integer("max_designs", max_designs, 1)
    integer("processes", processes, 1)
    check_free(requirements)
    catalogue = read_catalogue(*requirements.parts.catalogue) if catalogue is None else catalogue
    for name, requested, there in (
        ("ball", requirements.parts.mirror == "ball", catalogue.balls),
        ("dome", requirements.parts.dome, catalogue.domes),
    ):
        if requested and not there:
            raise InvalidParameter(f"the catalogue must contain a {name}, required by parts")
    everything = combinations_of(catalogue, requirements)
    reasons = [cut(requirements, combination) for combination in everything]
    tally = _Tally(
        requirements,
        front,
        max_designs,
        len(everything),
        Counter(r for r in reasons if r is not None),
    )
    remaining = [c for c, reason in zip(everything, reasons, strict=True) if reason is None]
    # Closed at a signal too: otherwise the worker processes would outlive the command
    with closing(_designed(requirements, remaining, processes, tally)) as answers:
        for i, answer in enumerate(answers):
            tally.take(answer)
            LOGGER.info(
                "%d of %d combinations, %d feasible", i + 1, len(remaining), len(tally.found)
            )
            if on_progress is not None:
                on_progress(i + 1, len(remaining))
            if tally.is_full:
                break
    return tally.result()


def _designed(
    requirements: Requirements, combinations: list[PartsCombination], processes: int, tally: _Tally
) -> Generator[PartsDesign | str, None, None]:
    """Yield the results of the combinations in their order."""
    if processes == 1 or len(combinations) <= MAX_SERIAL_COMBINATIONS:
        for combination in combinations:
            yield design_combination(requirements, combination, tally.max_area_deg2)
        return
    with WorkerPool(processes - 1) as pool:
        for first in range(0, len(combinations), BLOCK * processes):
            block, limit = combinations[first : first + BLOCK * processes], tally.max_area_deg2
            yield from pool.starmap(design_combination, [(requirements, c, limit) for c in block])


@dataclass
class _Tally:
    """State of the search."""

    requirements: Requirements
    front: bool
    max_designs: int
    combinations: int
    cut: Counter[str]
    found: list[PartsDesign] = field(default_factory=list)
    nearest: PartsDesign | None = None
    missed: Counter[str] = field(default_factory=Counter)
    taken: int = 0

    def take(self, answer: PartsDesign | str) -> None:
        """Record the result of the next combination."""
        self.taken += 1
        if isinstance(answer, str):
            self.missed[answer] += 1
        elif not answer.is_met:
            self.missed[answer.design.verdict.missed[0]] += 1
            if (
                self.nearest is None
                or answer.design.verdict.worst < self.nearest.design.verdict.worst
            ):
                self.nearest = answer
        elif answer.worst_floored_area_deg2 < self.max_area_deg2:
            self.found.append(answer)
        else:
            self.missed[BLURRED] += 1

    @property
    def max_area_deg2(self) -> float:
        """Upper limit, for a front, of the blur area of the next design."""
        areas = [design.worst_floored_area_deg2 for design in self.found] if self.front else []
        return min(areas, default=np.inf)

    @property
    def is_full(self) -> bool:
        return not self.front and len(self.found) >= self.max_designs

    def result(self) -> PartsSearch:
        remaining = self.combinations - self.cut.total() - self.taken
        nearest = None if self.found else self.nearest
        return PartsSearch(
            self.requirements,
            tuple(self.found),
            nearest,
            self.combinations,
            dict(self.cut),
            dict(self.missed),
            remaining,
        )
