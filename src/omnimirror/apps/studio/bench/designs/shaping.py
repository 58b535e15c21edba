"""Manual shape editing: moves one point of a profile or mapping and deforms its neighbourhood
smoothly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .....analysis.evaluation import evaluate
from .....base.errors import InvalidParameter
from .....base.typing import Array
from .....optics.mirrors import SlopeSpline
from .....optics.mirrors.slope_spline import spline_of_slopes
from .....optics.sensor import Sensor
from ..messages import Bend
from .sensors import mapping_like, rim_of, spline_like, why_not_optimised

CLEAR = 0.02
"""Minimum distance from fixed curve ends, relative to the rim radius or the field."""


def bent(sensor: Sensor, bend: Bend) -> Sensor:
    """Deform the mirror so that its profile or mapping passes through a given point.

    Deformations minimise curvature: the profile bends as a rod clamped at the vertex, the mapping
    as a beam supported at the image centre and the rim. The result is a freeform mirror or a
    tabulated mapping.

    Raises
    ------
    InvalidParameter
        A sensor with two mirrors or a misaligned mirror, a point too close to a fixed end, or no
        feasible mirror.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> flatter = bent(sphere, Bend(of="profile", at=30.0, to=9.9))
    >>> round(float(flatter.mirror.sag(30.0)), 9), round(float(sphere.mirror.sag(30.0)), 3)
    (9.9, 10.01)
    """
    if (reason := why_not_optimised(sensor)) is not None:
        raise InvalidParameter(reason)
    return (_profile if bend.of == "profile" else _mapping)(sensor, bend.at, bend.to)


def _profile(sensor: Sensor, x_mm: float, z_mm: float) -> Sensor:
    rim = sensor.mirror.rim_radius_mm
    if not CLEAR * rim <= x_mm <= rim * (1 + 1e-9):
        raise InvalidParameter(
            f"the profile is held {x_mm:g} mm from the axis; it can be held from {CLEAR * rim:.4g} to {rim:g} mm"
        )
    before = spline_like(sensor)
    slopes, held = np.array(before.slopes), min(x_mm / rim, 1.0)
    rod = _rod_slope(np.linspace(0.0, 1.0, len(slopes)), held)
    unit = _sag(slopes + rod, held) - _sag(slopes, held)  # the sag is linear in the slopes
    pulled = z_mm / rim - _sag(slopes, held)
    return replace(sensor, mirror=SlopeSpline(tuple(slopes + pulled / unit * rod), rim))


def _rod_slope(u: Array, held: float) -> Array:
    """Return the slope (n,), up to a factor, of a rod clamped at 0 and loaded at ``held``; straight
    beyond."""
    return np.where(u < held, u * (2 * held - u), held**2)


def _sag(slopes: Array, u: float) -> float:
    """Return the sag of the slope spline at u, in rim radii."""
    sag = spline_of_slopes(slopes).antiderivative()
    return float(sag(u) - sag(0.0))


def _mapping(sensor: Sensor, omega_deg: float, height_px: float) -> Sensor:
    low, high = sensor.field_deg
    first, last = (low + share * (high - low) for share in (CLEAR, 1 - CLEAR))
    if not first <= omega_deg <= last:
        raise InvalidParameter(
            f"the mapping is held at {omega_deg:g} deg; it can be held from {first:.4g} to {last:.4g} deg"
        )
    rim_px = sensor.rim_radius_px
    if not 0 < height_px < rim_px:
        raise InvalidParameter(f"the mapping is pulled to {height_px:.4g} px; it can be pulled to 0 to {rim_px:.4g} px")
    table = mapping_like(sensor)
    omega, tau = np.array(table.omega_deg), np.array(table.height) / table.height[-1]
    beam = _beam(omega - low, omega_deg - low, high - low)
    x = [evaluate(sensor, [omega_deg]).x_mm[0], sensor.x_from_height_px(np.array([height_px]))[0]]
    now, wanted = _shares(sensor, np.array(x))
    _check_grows(np.diff(tau), np.diff(beam), wanted - now, omega_deg)
    mirror = replace(table, height=tuple(tau + (wanted - now) * beam))
    return replace(sensor, mirror=mirror, mirror_distance_mm=mirror.design_distance)


def _beam(x: Array, held: float, length: float) -> Array:
    """Return the deflection (n,) of a beam supported at 0 and ``length``, normalised to 1 at
    ``held``."""
    rest = length - held
    near = rest * x * (length**2 - rest**2 - x**2)
    far = held * (length - x) * (length**2 - held**2 - (length - x) ** 2)
    return np.where(x <= held, near, far) / (2 * held**2 * rest**2)


def _shares(sensor: Sensor, x_mm: Array) -> Array:
    """Return the relative image heights of mirror points (n,) as used by mappings: tan(theta) or x
    over the rim value."""
    if sensor.lens.TELECENTRIC:
        return x_mm / sensor.mirror.rim_radius_mm
    shares: Array = np.tan(sensor.meridian.trace(x_mm).first.theta) / np.tan(np.radians(rim_of(sensor).theta_max_deg))
    return shares


def _check_grows(steps: Array, beam: Array, pulled: float, omega_deg: float) -> None:
    """Reject a deformation after which the image height no longer increases with the field angle."""
    if np.all(steps + pulled * beam > 0):
        return
    side = np.sign(pulled)
    against = side * beam < 0
    most = float(np.min(steps[against] / np.abs(beam[against])))
    raise InvalidParameter(
        f"pulled by {pulled:+.3g} of the rim's image height at {omega_deg:.4g} deg, the mapping would not grow with "
        f"the field angle; it can be pulled by less than {side * most:+.3g}"
    )
