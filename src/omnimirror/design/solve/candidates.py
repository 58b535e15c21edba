"""From numbers to a sensor: every way of making the mirror, the lens that fits it, and its best focus.

What is to be chosen stands in a :class:`Choice`; what is given in the requirements. A way of making the
mirror is a function of the rim and the choice: :data:`WAYS`, by the entry of ``[mirror]`` that asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...lenses import Orthographic, Perspective
from ...sensor import Sensor
from ..construct.families import FAMILIES
from ..construct.fits import fit_mirror
from ..construct.mappings import generated_mirror
from ..construct.rim import MountedMirror, Rim
from ..criteria.consistency import OF_MAPPINGS
from ..criteria.field_angles import Counted, counted_field
from ..criteria.ranges import ends, ends_or_none
from ..criteria.requirements import MirrorRequirements, Requirements
from ..optimise.problem import imager_radius_px
from .focusing import POINTS, Focusing

Array = NDArray[np.float64]

FREE_CONIC = (-0.9, 4.0)  # of an ellipsoid whose constant is left to the design
SETTLED, MOST_ROUNDS = 1e-5, 30  # of lens and focus, which depend on each other


@dataclass(frozen=True)
class Choice:
    """One design by its numbers. Of focal length and Theta, None stands for what makes the rim fill the imager."""

    omega_max_deg: float
    omega_min_deg: float
    rim_radius_mm: float
    theta_max_deg: float | None
    focal_length_mm: float | None
    f_number: float
    conic: float | None


@dataclass(frozen=True)
class Made:
    """A sensor, and what to know of how it was made."""

    sensor: Sensor
    notes: tuple[str, ...]
    counted: Counted


def given(requirements: Requirements) -> dict[str, tuple[float, float] | None]:
    """The entries of a choice as the requirements allow them: (low, high), or None where they follow."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    conic = ends_or_none(mirror.conic)
    if mirror.family == "ellipsoid" and conic is None:
        conic = FREE_CONIC
    theta = (0.0, 0.0) if lens.is_telecentric else ends_or_none(lens.theta_max_deg)
    focal = ends_or_none(lens.focal_length_mm)
    if theta and focal and theta[0] < theta[1] and focal[0] == focal[1]:
        theta = None  # follows from the focal length; that it stays in its range is a requirement
    elif theta and focal and focal[0] < focal[1]:
        focal = None
    return {
        "omega_max_deg": (field.omega_max_deg, field.omega_max_deg),
        "omega_min_deg": (field.omega_min_deg, field.omega_min_deg),
        "rim_radius_mm": ends(mirror.rim_radius_mm),
        "theta_max_deg": theta,
        "focal_length_mm": focal,
        "f_number": ends(lens.f_number),
        "conic": conic,
    }


def make(requirements: Requirements, choice: Choice) -> Made:
    """The sensor of a choice, focused at its best unless the requirements say where.

    Raises
    ------
    OmnimirrorError
        There is no such mirror, or it cannot be used.
    """
    if requirements.lens.is_telecentric:
        return _orthographic(requirements, choice)
    return _perspective(requirements, choice)


# -- mirrors ---------------------------------------------------------------------------------------


def _by_mapping(table: MirrorRequirements, rim: Rim, omega_min_deg: float, conic: float | None) -> MountedMirror:
    entries = {name: v for name in OF_MAPPINGS if (v := getattr(table, name)) is not None}
    assert table.mapping is not None
    return generated_mirror(table.mapping, rim, omega_min_deg if table.is_pointed else 0.0, **entries)


def _by_family(table: MirrorRequirements, rim: Rim, omega_min_deg: float, conic: float | None) -> MountedMirror:
    assert table.family is not None
    if table.family in FAMILIES:
        return FAMILIES[table.family](rim, conic)
    equidistant = generated_mirror("equidistant", rim)
    return fit_mirror(equidistant, table.family).mounted


WAYS: dict[str, Callable[[MirrorRequirements, Rim, float, float | None], MountedMirror]] = {
    "mapping": _by_mapping,
    "family": _by_family,
}
"""How a mirror is made, by the entry of ``[mirror]`` that asks for it."""


def wanted_mirror(table: MirrorRequirements, rim: Rim, choice: Choice) -> MountedMirror:
    """The mirror before it is fitted."""
    return _kept(replace(table, fit=None), rim, choice.omega_min_deg, choice.conic)


def _fitted(table: MirrorRequirements, rim: Rim, choice: Choice) -> MountedMirror:
    """The mirror, fitted if it is to be."""
    return _kept(table, rim, choice.omega_min_deg, choice.conic)


@lru_cache(maxsize=128)
def _kept(table: MirrorRequirements, rim: Rim, omega_min_deg: float, conic: float | None) -> MountedMirror:
    """A mirror, kept: a search asks for the same one before many lenses."""
    if table.fit is not None:
        return fit_mirror(_kept(replace(table, fit=None), rim, omega_min_deg, conic), table.fit).mounted
    way = next(name for name in WAYS if getattr(table, name) is not None)
    return WAYS[way](table, rim, omega_min_deg, conic)


# -- lens and focus --------------------------------------------------------------------------------


def imager_radius_mm(requirements: Requirements) -> float:
    """Radius of the largest circle about the optical axis that the imager holds."""
    return imager_radius_px(requirements.imager) * requirements.imager.pitch_mm


def _orthographic(requirements: Requirements, choice: Choice) -> Made:
    rim = Rim(choice.omega_max_deg, 0.0, choice.rim_radius_mm)
    placed = _fitted(requirements.mirror, rim, choice)
    magnification = imager_radius_mm(requirements) / choice.rim_radius_mm
    span = ends_or_none(requirements.lens.focus_mm)
    sensor = Sensor(
        placed.mirror,
        Orthographic(magnification, choice.f_number, 0.0 if span is None else span[0]),
        requirements.imager,
        requirements.mount,
        name=requirements.name,
        notes=requirements.notes,
    )
    return _focused(requirements, choice, judged(requirements, sensor, placed))


def _perspective(requirements: Requirements, choice: Choice) -> Made:
    """Lens and focus follow from each other: settled first; a fit, which moves little, comes last."""
    span = ends_or_none(requirements.lens.focus_mm)
    nearness, steps = 0.0 if span is None else 1 / span[1], list[tuple[float, float]]()
    for _ in range(MOST_ROUNDS):
        made = _before_lens(requirements, choice, nearness, wanted_mirror)
        found = 1 / made.sensor.lens.focus_distance_mm
        steps.append((nearness, found - nearness))
        if abs(steps[-1][1]) <= SETTLED * found or None not in (choice.focal_length_mm, choice.theta_max_deg):
            break
        nearness = _next(steps)
    return made if requirements.mirror.fit is None else _before_lens(requirements, choice, found, _fitted)


def _next(steps: list[tuple[float, float]]) -> float:
    """Where to try next, from numbers and by how much each was off: by a secant, or simply what was found."""
    (x, off) = steps[-1]
    if len(steps) > 1 and (bent := off - steps[-2][1]):
        secant = x - off * (x - steps[-2][0]) / bent
        if abs(secant - x) <= 2 * abs(off):
            return max(secant, 0.0)
    return x + off


def _viewing(requirements: Requirements, choice: Choice, nearness: float) -> tuple[float, float]:
    """Theta (deg) and focal length (mm): as chosen, or so that the rim fills the imager at a focus 1/L0."""
    radius = imager_radius_mm(requirements)
    if choice.focal_length_mm is None:
        assert choice.theta_max_deg is not None
        tangent = np.tan(np.radians(choice.theta_max_deg))
        focal = float(radius / (tangent + radius * nearness))
    else:
        focal = choice.focal_length_mm
    if choice.theta_max_deg is not None:
        return choice.theta_max_deg, focal
    return float(np.degrees(np.arctan(radius * (1 / focal - nearness)))), focal


def _before_lens(
    requirements: Requirements,
    choice: Choice,
    nearness: float,
    mirror: Callable[[MirrorRequirements, Rim, Choice], MountedMirror],
) -> Made:
    """The mirror before the lens that it has if it is focused at 1/L0; focused as asked, or at its best."""
    theta, focal = _viewing(requirements, choice, nearness)
    placed = mirror(requirements.mirror, Rim(choice.omega_max_deg, theta, choice.rim_radius_mm), choice)
    span = ends_or_none(requirements.lens.focus_mm)
    sensor = Sensor(
        placed.mirror,
        Perspective(focal, choice.f_number, max(placed.distance_mm, 1.001 * focal) if span is None else span[1]),
        requirements.imager,
        requirements.mount,
        placed.distance_mm,
        requirements.name,
        requirements.notes,
    )
    return _focused(requirements, choice, judged(requirements, sensor, placed))


def focusing(requirements: Requirements, choice: Choice, made: Made, points: int = POINTS) -> Focusing:
    """What a made sensor does, wherever it is focused."""
    fits = None in (choice.theta_max_deg, choice.focal_length_mm)  # the rim fills the imager, whatever the focus
    radius = np.inf if fits else imager_radius_px(requirements.imager)
    distances = tuple(sorted(set(ends(requirements.field.object_distance_mm))))
    span = ends_or_none(requirements.lens.focus_mm)
    return Focusing(made.sensor, made.counted, requirements.limits, distances, radius, span, points)


def _focused(requirements: Requirements, choice: Choice, made: Made) -> Made:
    """The sensor at its best focus, where the requirements leave one."""
    span = ends_or_none(requirements.lens.focus_mm)
    if span is not None and span[0] == span[1]:
        return made
    focus = focusing(requirements, choice, made).best().focus_mm
    return replace(made, sensor=made.sensor.with_lens(made.sensor.lens.focused_at(focus)))


def judged(requirements: Requirements, sensor: Sensor, placed: MountedMirror) -> Made:
    """A sensor with what counts of its field."""
    return Made(sensor, placed.notes, counted_field(requirements.field, sensor))
