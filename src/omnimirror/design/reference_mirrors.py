"""Reference mirrors for the field and lens of a problem, for comparison with optimised ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..analysis.evaluation import evaluate
from ..analysis.focus import best_focus
from ..base.errors import OmnimirrorError
from ..base.typing import Array
from ..optics.sensor import Sensor
from ..optics.sensor_files import load_sensor
from ._design_problem import DesignProblem, DesignSpace
from .merits import merit_named, values_of_evaluation
from .mirror_construction import FAMILIES, MountedMirror, RimRay, generated_mirror
from .optimiser import start

PAPER = {"SPH": "paper-spherical", "E-DI": "paper-equidistant", "SVP": "paper-hyperboloidal"}
PAPER_FIELD, PAPER_THETA, PAPER_TOLERANCE = (
    135.0,
    12.0,
    0.02,
)  # deg; and tolerance for the rounded mirrors of the paper
EXACTLY = "exactly "  # prefix of the names of exact mappings
EXACT = ("equidistant", "equiangular", "unit-aspect", "equiareal", "rectifying")
TELECENTRIC = (
    "equidistant",
    "rectifying",
)  # the others are the paraboloid, the sphere and the equidistant mirror


def known_sensors(problem: DesignProblem) -> dict[str, Sensor]:
    """Return reference sensors by name: the three of the paper, then those of exact mappings.

    Sphere and single-viewpoint mirror are solved for any field; the polynomial of the paper is
    included for its own field only. All have the lens of the problem, at the centre of each range.
    """
    space = DesignSpace(problem)
    first = space.sensor(start(space, 0, 0)[1])
    theta = 0.0 if problem.is_telecentric else float(np.degrees(first.meridian.theta_max))
    rim = RimRay(first.field_deg[1], theta, first.mirror.rim_radius_mm)
    sensors = {}
    for name, make in _makers(rim):
        with suppress(OmnimirrorError):  # a mapping that is impossible for this field
            mounted = make()
            position = (
                0.0
                if problem.is_telecentric
                else float(first.lens.pupil.position(np.array([np.tan(np.radians(theta))]))[0])
            )
            sensors[name] = replace(
                first,
                mirror=mounted.mirror,
                mirror_distance_mm=mounted.distance_mm + position,
                name=name,
            )
    return sensors


def _makers(rim: RimRay) -> Iterator[tuple[str, Callable[[], MountedMirror]]]:
    if (
        abs(rim.omega_max_deg - PAPER_FIELD) < PAPER_TOLERANCE
        and abs(rim.theta_max_deg - PAPER_THETA) < PAPER_TOLERANCE
    ):
        for name, file in PAPER.items():
            yield name, lambda file=file: _scaled(load_sensor(file), rim.rim_radius_mm)  # type: ignore[misc]  # type of the default is not inferred
    else:
        single = "paraboloid" if rim.theta_max_deg == 0 else "hyperboloid"
        yield "sphere", lambda: FAMILIES["sphere"](rim, None)
        yield f"{single}, single viewpoint", lambda: FAMILIES[single](rim, None)
    for mapping in EXACT if rim.theta_max_deg else TELECENTRIC:
        yield (EXACTLY + mapping.replace("-", " "), partial(generated_mirror, mapping, rim))


def _scaled(sensor: Sensor, rim_radius_mm: float) -> MountedMirror:
    """Return a mirror of the paper at another size."""
    ratio = rim_radius_mm / sensor.mirror.rim_radius_mm
    mirror = sensor.mirror
    lengths = {
        n: getattr(mirror, n) * ratio for n, p in mirror.PARAMETERS.items() if p.unit == "mm"
    }
    return MountedMirror(replace(mirror, **lengths), sensor.mirror_distance_mm * ratio)  # type: ignore[type-var]  # all implementations are dataclasses


def merit_values(
    sensor: Sensor,
    merits: Sequence[str],
    problem: DesignProblem,
    focus_by: str | None = "worst_floored_area_deg2",
) -> Array:
    """Compute the merits (n,) of a sensor with the settings of a problem.

    ``focus_by`` is a merit of :func:`omnimirror.best_focus`, or None for the focus of the sensor.
    """
    sensor.check("the comparison with a Pareto front", "single mirror")
    rim = sensor.mirror.rim_radius_mm
    minimum = float(
        sensor.meridian.x_from_omega(np.radians(max(problem.omega_min_deg, sensor.field_deg[0])))
    )
    common: dict[str, Any] = {
        "mode": problem.mode,
        "image_radius_px": problem.image_radius_px,
        "wavelength_nm": problem.wavelength_nm,
    }
    x, distances = np.linspace(minimum, rim, 1001), np.array(problem.distances_mm)
    if focus_by is not None:
        omega = np.degrees(sensor.meridian.trace(x).omega)
        angles, far = np.tile(omega, distances.size), np.repeat(distances, omega.size)
        best = best_focus(sensor, focus_by, omega_deg=angles, object_distance_mm=far, **common)
        sensor = replace(sensor, lens=sensor.lens.focused_at(best.focus_mm))
    results = [evaluate(sensor, x_mm=x, object_distance_mm=d, **common) for d in distances]
    values = np.array(
        [[merit_named(m).value(values_of_evaluation(r)) for m in merits] for r in results]
    )
    means = np.array([merit_named(m).is_mean for m in merits])
    joined: Array = np.where(means, values.mean(axis=0), values.max(axis=0))
    return joined
