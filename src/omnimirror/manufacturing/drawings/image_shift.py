"""Image shift due to assembly errors, by finite differences of the mapping.

For each field angle, the image heights of the nominal sensor and of the sensor with one error are
compared in the meridian of maximum effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.typing import Array
from ...optics.sensor import Sensor
from ...optics.tracing.meridian import ChiefRays

POINTS = 2001
EDGE = 0.01
"""Fraction of the meridian that is omitted at both ends, where a displaced mirror has no points."""


ROUNDING_PX = 1e-9
"""Shifts below this value are rounding errors, for example of a cone with another distance."""


class Moved(NamedTuple):
    """Displaced meridian: distance x (n,) from the lens axis (mm), height (mm) and slope."""

    x: Array
    z: Array
    slope: Array


@dataclass(frozen=True)
class ImageShift:
    """Image shift per unit of one error.

    Attributes
    ----------
    name, unit
        Name and unit of the error.
    px_per_unit
        Maximum shift over the field.
    omega_deg
        Field angle of the maximum.
    """

    name: str
    unit: str
    px_per_unit: float
    omega_deg: float

    def tolerance(self, px: float = 0.5) -> float:
        """Return the error, in :attr:`unit`, with a maximum image shift of ``px``."""
        return px / self.px_per_unit if self.px_per_unit else np.inf


def image_shifts(sensor: Sensor) -> list[ImageShift]:
    """Compute the image shift for errors of distance, centring, tilt, slope and form.

    ``form`` is a bump of one period between axis and rim, ``a (1 - cos(2 pi x/M))/2``, with
    peak-to-valley height a. Errors without an effect on a telecentric lens are omitted. For a folded
    sensor, only axial displacements of lens and mirrors are evaluated.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = {s.name: s for s in image_shifts(om.load_sensor("paper-spherical"))}
    >>> round(found["mirror distance"].px_per_unit, 3), round(found["surface slope"].tolerance(0.5), 2)
    (2.339, 0.87)
    """
    if sensor.secondary is not None:
        return _along_the_axis(sensor)
    M = sensor.mirror.rim_radius_mm
    period = 2 * np.pi / M

    def form(x: Array, z: Array, slope: Array, a: float) -> Moved:
        a *= 1e-3  # um
        return Moved(
            x, z + a * (1 - np.cos(period * x)) / 2, slope + a * period * np.sin(period * x) / 2
        )

    def tilted(x: Array, z: Array, slope: Array, degrees: float) -> Moved:
        angle = np.radians(degrees)
        turned = np.tan(np.arctan(slope) + angle)
        return Moved(
            x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle), turned
        )

    errors: dict[tuple[str, str], tuple[float, Callable[[Array, Array, Array, float], Moved]]] = {
        ("mirror distance", "mm"): (1e-4 * M, lambda x, z, slope, e: Moved(x, z + e, slope)),
        ("mirror decentre", "mm"): (1e-4 * M, lambda x, z, slope, e: Moved(x + e, z, slope)),
        ("mirror tilt", "deg"): (1e-3, tilted),
        ("surface slope", "mrad"): (
            1e-2,
            lambda x, z, slope, e: Moved(x, z, np.tan(np.arctan(slope) + 1e-3 * e)),
        ),
        ("surface form", "um"): (1e-3 * M, form),
    }
    if sensor.lens.TELECENTRIC:
        del errors["mirror distance", "mm"]
    return [_image_shift(sensor, *key, *error) for key, error in errors.items()]


def _along_the_axis(sensor: Sensor) -> list[ImageShift]:
    """Compute the image shift for axial displacements of single components of a folded sensor."""
    second = sensor.secondary
    assert second is not None
    m, s, step = sensor.mirror_distance_mm, second.distance_mm, 1e-4 * sensor.mirror.rim_radius_mm
    # m is the path length from the lens via the secondary to the primary mirror
    moves = {
        "mirror distance": (1.0, 1.0),
        "secondary distance": (2.0, 1.0),
        "lens distance": (1.0, 0.0),
    }
    if sensor.lens.TELECENTRIC:
        moves = {"distance between mirrors": (0.0, 1.0)}
    low, high = np.radians(sensor.field_deg)
    omega = np.linspace(low + 2 * EDGE * (high - low), high - EDGE * (high - low), 201)

    def height(dm: float, ds: float) -> Array:
        displaced = replace(
            sensor, mirror_distance_mm=m + dm, secondary=replace(second, distance_mm=s + ds)
        )
        return displaced.image_height_px(
            displaced.meridian.trace(displaced.meridian.x_from_omega(omega))
        )

    result = []
    for name, (dm, ds) in moves.items():
        motion = np.abs(height(dm * step, ds * step) - height(-dm * step, -ds * step)) / (2 * step)
        worst = int(np.argmax(motion))
        result.append(ImageShift(name, "mm", float(motion[worst]), float(np.degrees(omega[worst]))))
    return result


def _image_shift(
    sensor: Sensor,
    name: str,
    unit: str,
    step: float,
    displaced: Callable[[Array, Array, Array, float], Moved],
) -> ImageShift:
    """Compute the central difference of the image height at constant field angles."""
    mirror, M = sensor.mirror, sensor.mirror.rim_radius_mm
    start = (
        sensor.meridian.x_min
    )  # no rays at smaller radii: they end at the base of a tube in water
    x = np.linspace(start if not mirror.is_pointed else max(start, EDGE * M), M, POINTS)
    z, slope, _ = mirror.profile(x)
    omega = sensor.meridian.trace(
        np.linspace(start + 2 * EDGE * (M - start), M - EDGE * (M - start), 501)
    ).omega
    ahead, behind = (
        _image_height_px(sensor, displaced(x, z, slope, e), omega) for e in (step, -step)
    )
    motion = np.abs(ahead - behind) / (2 * step)
    worst = int(np.argmax(motion))
    rate = float(motion[worst]) if motion[worst] * step > ROUNDING_PX else 0.0
    return ImageShift(name, unit, rate, float(np.degrees(omega[worst])))


def _image_height_px(sensor: Sensor, meridian: Moved, omega: Array) -> Array:
    """Compute image heights of field angles for an arbitrary meridian."""
    from scipy.interpolate import CubicSpline

    w = sensor.lens.pupil.aim(meridian.x, sensor.meridian.m + meridian.z).distance
    beta, theta = np.arctan(meridian.slope), np.arctan2(meridian.x, w)
    result, height = (
        2 * beta + theta,
        sensor.lens.image_height(meridian.x, w) / sensor.imager.pitch_mm,
    )
    if (
        cover := sensor.meridian.cover
    ) is not None:  # the cover is not displaced; only directions matter
        unknown = np.zeros_like(w)
        gamma, path = beta + theta, np.hypot(meridian.x, w)
        rays = ChiefRays(
            meridian.x,
            meridian.z,
            meridian.slope,
            unknown,
            sensor.meridian.m,
            w,
            beta,
            theta,
            gamma,
            result,
            path,
        )
        result = cover.refracted(rays).omega
        visible = np.isfinite(result)
        result, height = result[visible], height[visible]
    heights: Array = CubicSpline(result, height)(omega)
    return heights
