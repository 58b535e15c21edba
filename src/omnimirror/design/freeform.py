"""Freeform mirrors for requirements: constrained optimum, or minimum violation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.caching import cached_property
from ..base.optimisation import MinimaxResult
from ..base.typing import Array
from ..optics.batch.families import FreeformFamily
from ..optics.lenses import BlurMode, GaussianLens
from ..optics.sensor import Sensor
from ._design_problem import DesignProblem, DesignSpace
from ._design_space import (
    BestDesign,
    Point,
    Reached,
    is_more_met,
    meet_other_requirements,
    priority_note,
)
from .merits import merit_named
from .optimiser import (
    CLOSE,
    FEASIBILITY_TOLERANCE,
    FINE,
    POLISH_TRUST,
    Key,
    Objective,
    Optimum,
    Slack,
    coarse_nodes,
    follow,
    optimised,
    start,
)
from .requirement_check import check_requirements
from .requirements import OF_OPTICS, Requirements, ends

SHAPE = "spline"  # default shape
NUMBERS = (
    "omega_max_deg",
    "theta_max_deg",
    "rim_radius_mm",
    "focal_length_mm",
    "magnification",
    "f_number",
)


def problem_of(
    requirements: Requirements, mode: BlurMode = "exact", image_radius_px: float | None = None
) -> DesignProblem:
    """Return the optimisation problem of requirements; ranges become free variables."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    shape, largest = FreeformFamily.parse(mirror.shape or SHAPE), requirements.largest_image_px
    return DesignProblem(
        omega_max_deg=field.omega_max_deg,
        theta_max_deg=lens.theta_max_deg,
        rim_radius_mm=mirror.rim_radius_mm,
        focal_length_mm=lens.focal_length_mm,
        magnification=lens.magnification,
        f_number=lens.f_number,
        imager=requirements.imager,
        largest_image_px=None if largest == requirements.imager.inscribed_radius_px else largest,
        lens=lens.kind,
        omega_min_deg=field.omega_min_deg,
        housing=requirements.housing,
        object_distance_mm=field.object_distance_mm,
        focus_mm=lens.focus_mm,
        family=shape.name,
        terms=shape.terms,
        limits=requirements.limits,
        mode=mode,
        image_radius_px=image_radius_px,
        mirror_material=None
        if requirements.thermal is None
        else requirements.thermal.mirror_material,
        optics=lens.optics,
    )


@dataclass(frozen=True)
class FreeformDesignSpace:
    """Design space of freeform mirrors for a problem."""

    requirements: Requirements
    problem: DesignProblem

    @cached_property
    def designs(self) -> DesignSpace:
        return DesignSpace(self.problem)

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Fixed numbers of the problem."""
        own = () if self.problem.optics is None else OF_OPTICS
        specified = {
            name: getattr(self.problem, name)
            for name in NUMBERS
            if name not in (*self.problem.free, *own)
        }
        return {name: ends(value)[0] for name, value in specified.items() if value is not None}

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Limits, and the imager and camera requirements that a design can violate."""
        return self._objective(()).requested

    def freed(self, ranges: dict[str, tuple[float, float]]) -> FreeformDesignSpace:
        """Return the space with additional free numbers."""
        return replace(self, problem=replace(self.problem, **ranges))  # type: ignore[arg-type]  # types of the keywords depend on their names

    def point(self, y: Array) -> Point:
        """Return a design as a point, including fixed numbers."""
        requested = {name: float(np.log(value)) for name, value in self.numbers.items()}
        return requested | dict(zip(self.designs.names, y.tolist(), strict=True))

    def value(self, point: Point, name: str) -> float:
        """Return a number at a point."""
        return float(np.exp(point[name]))

    def towards(self, point: Point, name: str, way: int, span: tuple[float, float]) -> Point:
        """Return the point itself; every number reaches the feasible region from there."""
        return point

    def reach(self, point: Point, slack: Slack) -> Reached | None:
        """Return the point of minimum slack near a point; None if infeasible."""
        result = follow(replace(self._objective(()), goal=slack), self.y(point), tolerance=CLOSE)
        return (
            Reached(point | self.point(result.y), result.value)
            if result.violation < FEASIBILITY_TOLERANCE
            else None
        )

    def missed(self, point: Point) -> dict[Key, float]:
        """Return the relative violation of each requirement at a point."""
        return self._objective(()).missed(self.y(point))

    def search_design(
        self, requirements: Requirements, point: Point, is_local: bool = False
    ) -> Point | None:
        """Return the nearby mirror of minimum violation of other requirements, if feasible."""
        problem = problem_of(requirements, self.problem.mode, self.problem.image_radius_px)
        space = FreeformDesignSpace(requirements, problem)
        y = follow(space._objective(space.keys), space.y(point), tolerance=CLOSE).y
        return (
            space.point(y)
            if check_requirements(requirements, space.designs.sensor(y)).is_met
            else None
        )

    def y(self, point: Point) -> Array:
        """Return a point as a vector of the optimiser."""
        return np.array([point.get(name, 0.0) for name in self.designs.names])

    def _objective(self, keys: tuple[Key, ...]) -> Objective:
        return Objective(self.designs, Slack(keys), coarse_nodes(self.problem))


def solve(
    requirements: Requirements, problem: DesignProblem, **search: Any
) -> tuple[FreeformDesignSpace, BestDesign]:
    """Return the best freeform mirror and its design space.

    If no start converges to a feasible mirror, the largest violation is minimised.

    Parameters
    ----------
    problem
        Problem of the requirements, possibly with another blur mode.
    search
        ``starts``, ``seed``, ``resume`` and ``on_progress`` of the optimiser.
    """
    merit = requirements.mirror.optimise
    assert merit is not None
    space = FreeformDesignSpace(requirements, problem)
    result = optimised(problem, merit, **search)
    if isinstance(result, Optimum):
        m, y, sensor, optimum = merit_named(merit), result.y, result.sensor, result
        first = f"{m.quantity.title}: {result.value:.5g} {m.quantity.unit}".rstrip()
    else:
        y, optimum = _minimum_violation(space, result), None
        sensor = space.designs.sensor(y)
        first = f"no mirror of {problem.terms} terms meets all requirements; this one has the smallest violation"
    best = _design(space, y, sensor, optimum, (first,))
    for point in meet_other_requirements(space, best.point, best.verdict):
        y = space.y(point)
        other = _design(space, y, space.designs.sensor(y), None, ())
        if is_more_met(other.verdict, best.verdict):
            return space, replace(
                other, notes=(priority_note(other.verdict, best.verdict), *other.notes)
            )
    return space, best


def _design(
    space: FreeformDesignSpace,
    y: Array,
    sensor: Sensor,
    optimum: Optimum | None,
    first: tuple[str, ...],
) -> BestDesign:
    """Return a checked mirror with its point in the design space."""
    sensor = replace(sensor, name=space.requirements.name)
    notes = (*first, *freeform_notes(space.problem, sensor))
    return BestDesign(
        space.point(y), sensor, check_requirements(space.requirements, sensor), notes, optimum
    )


def _minimum_violation(space: FreeformDesignSpace, starts: list[Array]) -> Array:
    """Minimise the largest violation from the end points of searches, with refinement."""
    coarse = space._objective(space.keys)
    results = [follow(coarse, y, tolerance=CLOSE) for y in [start(space.designs, 0, 0)[1], *starts]]
    best = min(results, key=_cost)
    fine = replace(coarse, u=np.linspace(0.0, 1.0, FINE))
    return follow(fine, best.y, tolerance=CLOSE, initial_trust_radius=POLISH_TRUST).y


def _cost(result: MinimaxResult) -> float:
    return result.value if result.violation < FEASIBILITY_TOLERANCE else np.inf


def freeform_notes(problem: DesignProblem, sensor: Sensor) -> tuple[str, ...]:
    """Return notes on the parameters chosen by the optimiser, except the shape."""
    lens, notes = sensor.lens, []
    reached = {"rim_radius_mm": sensor.mirror.rim_radius_mm, "f_number": lens.stop_number}
    if isinstance(lens, GaussianLens):
        reached |= {
            "focal_length_mm": lens.focal_length_mm,
            "theta_max_deg": float(np.degrees(sensor.meridian.theta_max)),
        }
    for name, value in reached.items():
        requested = getattr(problem, name)
        if requested is None:
            notes.append(f"{name} = {value:.6g}, so that the rim fills the imager")
        elif name in problem.free:
            notes.append(
                "{} = {:.6g}, chosen between {:g} and {:g}".format(name, value, *ends(requested))
            )
    if problem.is_telecentric:
        notes.append(
            f"the diameter of the telecentric lens must be that of the mirror, {2 * reached['rim_radius_mm']:g} mm"
        )
    if not isinstance(problem.focus_mm, float):
        notes.append(f"focused at {lens.focus_distance_mm:.5g} mm")
    return tuple(notes)
