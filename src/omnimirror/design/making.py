"""From numbers to a sensor: every way of making the mirror, the lens that fits it, and its best focus.

What is to be chosen stands in a :class:`Choice`; what is given in the requirements. A way of making the
mirror is a function of the rim and the choice: :data:`WAYS`, by the entry of ``[mirror]`` that asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..analysis import best_focus
from ..lenses import Orthographic, Perspective
from ..sensor import Sensor
from .families import FAMILIES
from .fits import fit_mirror
from .mappings import generated_mirror
from .placed import PlacedMirror, Rim
from .problem import imager_radius_px
from .requirements import MirrorTable, Requirements

Array = NDArray[np.float64]

ANGLES = 181  # of the field, for the focus
MERIT = "floored-area"
FREE_CONIC = (-0.9, 4.0)  # of an ellipsoid whose constant is left to the design
POINTED_CENTRE = 0.1  # of the image radius; around a point a degree of azimuth shrinks to nothing
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
    field_from_deg: float
    """Where the field begins that is judged: beyond what the camera hides, and not at a mirror's point."""
    hidden_deg: float
    """Up to where the camera hides the view; 0 where nothing is known of its size."""


def given(requirements: Requirements) -> dict[str, tuple[float, float] | None]:
    """The entries of a choice as the requirements allow them: (low, high), or None where they follow."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    conic = mirror.conic
    if mirror.family == "ellipsoid" and conic is None:
        conic = FREE_CONIC
    theta = (0.0, 0.0) if lens.kind == "orthographic" else lens.theta_max_deg
    focal = lens.focal_length_mm
    if theta and focal and theta[0] < theta[1] and focal[0] == focal[1]:
        theta = None  # follows from the focal length; that it stays in its range is a requirement
    elif theta and focal and focal[0] < focal[1]:
        focal = None
    return {
        "omega_max_deg": (field.omega_max_deg, field.omega_max_deg),
        "omega_min_deg": (field.omega_min_deg, field.omega_min_deg),
        "rim_radius_mm": mirror.rim_radius_mm,
        "theta_max_deg": theta,
        "focal_length_mm": focal,
        "f_number": lens.f_number,
        "conic": conic,
    }


def make(requirements: Requirements, choice: Choice) -> Made:
    """The sensor of a choice, focused at its best unless the requirements say where.

    Raises
    ------
    OmnimirrorError
        There is no such mirror, or it cannot be used.
    """
    if requirements.lens.kind == "orthographic":
        return _orthographic(requirements, choice)
    return _perspective(requirements, choice)


# -- mirrors ---------------------------------------------------------------------------------------


def _by_mapping(table: MirrorTable, rim: Rim, choice: Choice) -> PlacedMirror:
    lists = {name: tuple(v) for name in ("omega_deg", "height") if (v := getattr(table, name)) is not None}
    distances = {name: getattr(table, name) for name in ("plane_distance_mm", "cylinder_radius_mm")}
    entries = lists | {name: v for name, v in distances.items() if v is not None}
    is_pointed = table.apex == "pointed" or table.mapping == "cylinder"
    assert table.mapping is not None
    return generated_mirror(table.mapping, rim, choice.omega_min_deg if is_pointed else 0.0, **entries)


def _by_family(table: MirrorTable, rim: Rim, choice: Choice) -> PlacedMirror:
    assert table.family is not None
    if table.family in FAMILIES:
        return FAMILIES[table.family](rim, choice.conic)
    equidistant = generated_mirror("equidistant", rim)
    return fit_mirror(equidistant, table.family).placed


WAYS: dict[str, Callable[[MirrorTable, Rim, Choice], PlacedMirror]] = {"mapping": _by_mapping, "family": _by_family}
"""How a mirror is made, by the entry of ``[mirror]`` that asks for it."""


def wanted_mirror(table: MirrorTable, rim: Rim, choice: Choice) -> PlacedMirror:
    """The mirror before it is fitted."""
    way = next(name for name in WAYS if getattr(table, name) is not None)
    return WAYS[way](table, rim, choice)


def _fitted(table: MirrorTable, placed: PlacedMirror) -> PlacedMirror:
    return placed if table.fit is None else fit_mirror(placed, table.fit).placed


# -- lens and focus --------------------------------------------------------------------------------


def imager_radius_mm(requirements: Requirements) -> float:
    """Radius of the largest circle about the optical axis that the imager holds."""
    return imager_radius_px(requirements.imager) * requirements.imager.pitch_mm


def _orthographic(requirements: Requirements, choice: Choice) -> Made:
    rim = Rim(choice.omega_max_deg, 0.0, choice.rim_radius_mm)
    placed = _fitted(requirements.mirror, wanted_mirror(requirements.mirror, rim, choice))
    magnification = imager_radius_mm(requirements) / choice.rim_radius_mm
    focus = requirements.lens.focus_mm
    sensor = Sensor(
        placed.mirror,
        Orthographic(magnification, choice.f_number, 0.0 if focus is None else focus),
        requirements.imager,
        requirements.mount,
        name=requirements.name,
        notes=requirements.notes,
    )
    made = judged(requirements, sensor, placed)
    return made if focus is not None else replace(made, sensor=_focused(requirements, made))


def _perspective(requirements: Requirements, choice: Choice) -> Made:
    """Lens and focus follow from each other: in rounds until nothing moves; a fit, which moves little, comes last."""
    wanted: PlacedMirror | None = None
    focus: float | None = None
    for _ in range(MOST_ROUNDS):
        theta, focal = _viewing(requirements, choice, focus)
        if wanted is None or choice.theta_max_deg is None:
            rim = Rim(choice.omega_max_deg, theta, choice.rim_radius_mm)
            wanted = wanted_mirror(requirements.mirror, rim, choice)
        made = _placed_before(requirements, choice, wanted, focal)
        before, focus = focus, made.sensor.lens.focus_distance_mm
        if before is not None and abs(focus - before) <= SETTLED * focus:
            break
        if choice.focal_length_mm is not None and choice.theta_max_deg is not None:
            break
    if requirements.mirror.fit is None:
        return made
    # the fit moves the focus by little, and that the lens by less
    theta, focal = _viewing(requirements, choice, made.sensor.lens.focus_distance_mm)
    wanted = wanted_mirror(requirements.mirror, Rim(choice.omega_max_deg, theta, choice.rim_radius_mm), choice)
    return _placed_before(requirements, choice, _fitted(requirements.mirror, wanted), focal)


def _viewing(requirements: Requirements, choice: Choice, focus_mm: float | None) -> tuple[float, float]:
    """Theta (deg) and focal length (mm): as chosen, or so that the rim fills the imager at a focus (None: infinite)."""
    radius = imager_radius_mm(requirements)
    nearness = 0.0 if focus_mm is None else 1 / focus_mm
    if choice.focal_length_mm is None:
        assert choice.theta_max_deg is not None
        tangent = np.tan(np.radians(choice.theta_max_deg))
        focal = float(radius / (tangent + radius * nearness))
    else:
        focal = choice.focal_length_mm
    if choice.theta_max_deg is not None:
        return choice.theta_max_deg, focal
    return float(np.degrees(np.arctan(radius * (1 / focal - nearness)))), focal


def _placed_before(requirements: Requirements, choice: Choice, placed: PlacedMirror, focal_mm: float) -> Made:
    """The mirror before a lens of that focal length, focused as asked or at its best."""
    fixed = requirements.lens.focus_mm
    focus = max(placed.distance_mm, 1.001 * focal_mm) if fixed is None else fixed
    sensor = Sensor(
        placed.mirror,
        Perspective(focal_mm, choice.f_number, focus),
        requirements.imager,
        requirements.mount,
        placed.distance_mm,
        requirements.name,
        requirements.notes,
    )
    made = judged(requirements, sensor, placed)
    return made if fixed is not None else replace(made, sensor=_focused(requirements, made))


def _focused(requirements: Requirements, made: Made) -> Sensor:
    """The sensor at its best focus, over the field that counts and from the nearest to the farthest object."""
    angles = np.linspace(made.field_from_deg, made.sensor.field_deg[1], ANGLES)
    distances = sorted(set(requirements.field.object_distance_mm))
    best = best_focus(made.sensor, MERIT, np.tile(angles, len(distances)), np.repeat(np.array(distances), ANGLES))
    return replace(made.sensor, lens=made.sensor.lens.focused_at(best.focus_mm))


def judged(requirements: Requirements, sensor: Sensor, placed: PlacedMirror) -> Made:
    """A sensor with the part of its field that is judged."""
    low, high = sensor.field_deg
    radius = requirements.field.camera_radius_mm
    hidden = 0.0 if radius is None else hidden_deg(sensor, radius)
    start = max(low, requirements.field.omega_min_deg, hidden)
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px]))
        start = max(start, float(np.degrees(edge.omega[0])))
    return Made(sensor, placed.notes, min(start, high), hidden)


def hidden_deg(sensor: Sensor, camera_radius_mm: float) -> float:
    """Field angle up to which a round camera at the lens hides the view.

    The chief ray of mirror point x goes through the plane of the lens at ``x + (m + z) tan(Omega)``.

    >>> from omnimirror.specs import load_sensor
    >>> round(hidden_deg(load_sensor("paper-spherical"), 30.0), 2)
    8.43
    """
    rays = sensor.meridian.trace(np.linspace(0.0, sensor.mirror.rim_radius_mm, 1025))
    with np.errstate(invalid="ignore"):
        radius = np.where(np.cos(rays.omega) > 0, rays.x + rays.w * np.tan(rays.omega), np.inf)
    clear = int(np.argmax(radius >= camera_radius_mm))
    if clear == 0:
        return 0.0
    a, b = radius[clear - 1], radius[clear]
    share = (camera_radius_mm - a) / (b - a) if np.isfinite(b) else 1.0
    omega = rays.omega[clear - 1] + share * (rays.omega[clear] - rays.omega[clear - 1])
    return float(np.degrees(omega))
