"""Cross-section of a sensor (Fig. 4): mirrors, lens, chief rays, images and depth of field.

All positions are (x, z) in millimetres in the mirror frame: x from the axis, z from the vertex away
from the lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.typing import Array
from ..optics.lenses import GaussianLens
from ..optics.mirrors import Flat
from ..optics.sensor import Sensor
from .evaluation import Evaluation
from .focus import FocusStudy, distance_per_angle, virtual_images

NEAR_OBJECTS = 5.0  # distance of the near objects of a section, in rim radii
# Distance of a drawn telecentric lens from the vertex, in rim radii; its real distance is free
TELECENTRIC_LENS_DISTANCE = 2.5
LENS_HALF_WIDTH = 0.18  # half width of a drawn perspective lens, in rim radii


class SectionCurve(NamedTuple):
    """Positions x and z (n,), mm; NaN for gaps."""

    x: Array
    z: Array


class FocusBand(NamedTuple):
    """Heights z (mm) of the focus and of the limits of the depth of field (Eqs. 30, 31)."""

    focus: float
    near: float
    far: float


def top_height(sensor: Sensor) -> float:
    """Return the maximum z (mm) of the mirror."""
    return sensor.mirror.bounds[1][1]


def lens_height(sensor: Sensor) -> float:
    """Return the height z (mm) of the drawn lens; arbitrary for a telecentric lens."""
    m, second, rim = sensor.meridian.m, sensor.secondary, sensor.mirror.rim_radius_mm
    if second is not None:
        return second.lens_height(m) if np.isfinite(m) else top_height(sensor) + 0.5 * rim
    return -m if np.isfinite(m) else -TELECENTRIC_LENS_DISTANCE * rim


def lens_half_width(sensor: Sensor) -> float:
    """Return half the width (mm) of the drawn lens; the width of its field if telecentric."""
    rim = sensor.mirror.rim_radius_mm
    return (
        float(sensor.meridian.trace(rim).first.x[()])
        if sensor.lens.TELECENTRIC
        else LENS_HALF_WIDTH * rim
    )


def reference_height(sensor: Sensor) -> float:
    """Return the reference height z (mm) of the object distances of the lens."""
    m, second = sensor.meridian.m, sensor.secondary
    if np.isfinite(m):
        return -m
    return -sensor.mirror_pose.displacement_mm if second is None else -second.distance_mm


def focus_band(result: Evaluation) -> FocusBand:
    """Return the depth of field of an evaluation in the mirror frame."""
    zero = reference_height(result.sensor)
    near, far = result.depth_of_field_mm
    return FocusBand(result.focus_mm + zero, near + zero, far + zero)


def is_undistorted(sensor: Sensor) -> bool:
    """Return whether the lens images the mirror undistorted: directly or in a flat mirror."""
    return sensor.secondary is None or isinstance(sensor.secondary.mirror, Flat)


def mirror_curve(sensor: Sensor, nodes: int = 401) -> SectionCurve:
    """Return the mirror profile from rim to rim, without the bore for the camera."""
    rim, second = sensor.mirror.rim_radius_mm, sensor.secondary
    x = np.linspace(-rim, rim, nodes)
    z = sensor.mirror.sag(np.abs(x))
    is_bored = second is not None and lens_height(sensor) > 0
    bore = second.bore_radius_mm if second is not None and is_bored else 0.0
    return SectionCurve(x, np.where(np.abs(x) < bore, np.nan, z))


def secondary_curve(sensor: Sensor, nodes: int = 201) -> SectionCurve | None:
    """Return the profile of the second mirror from rim to rim, or None."""
    second = sensor.secondary
    if second is None:
        return None
    rim = second.mirror.rim_radius_mm
    x = np.linspace(-rim, rim, nodes)
    return SectionCurve(x, second.height(np.abs(x)))


def paths_to_lens(sensor: Sensor, x_mm: Array) -> list[list[tuple[float, float]]]:
    """Return the positions (x, z), mm, of chief rays from mirror points (n,) to the lens."""
    second, lens = sensor.secondary, lens_height(sensor)
    first = sensor.meridian.trace(x_mm).first
    heights = first.x
    if isinstance(sensor.lens, GaussianLens):  # to its entrance pupil; reversed by a second mirror
        towards = 1.0 if second is None else -1.0
        paths = [
            [(0.0, lens + towards * float(z))]
            for z in sensor.lens.pupil.position(np.tan(first.theta))
        ]
    else:
        paths = [[(float(end), lens)] for end in heights]
    if second is None:
        return paths
    return [
        [(float(x), float(z)), *path]
        for x, z, path in zip(heights, second.height(heights), paths, strict=True)
    ]


def image_curves(
    result: Evaluation, object_distance_mm: float | None = None
) -> tuple[SectionCurve, SectionCurve]:
    """Return tangential and sagittal virtual images for the lens (Eqs. 14-21); NaN at infinity.

    They refer to the evaluated objects, or to objects at another distance in mm.
    """
    if object_distance_mm is None:
        return _seen(result, result.distance_t_mm), _seen(result, result.distance_s_mm)
    rays = result.sensor.meridian.trace(result.x_mm)
    images = virtual_images(rays, distance_per_angle(object_distance_mm, result.x_mm))
    t, s = FocusStudy(
        result.sensor, rays, images, result.mode, None, result.wavelength_nm
    ).distances
    return _seen(result, t), _seen(result, s)


def _seen(result: Evaluation, distance: Array) -> SectionCurve:
    """Return the positions of images at axial distances (n,), mm, from the lens on chief rays."""
    if result.sensor.lens.TELECENTRIC:
        x = result.sensor.meridian.trace(result.x_mm).first.x
    else:
        with np.errstate(invalid="ignore"):  # an infinite image exactly on the axis
            tangent = np.tan(np.radians(result.theta_deg))
            x = (distance - result.sensor.lens.pupil.position(tangent)) * tangent
    z = distance + reference_height(result.sensor)
    is_finite = np.isfinite(z)
    return SectionCurve(np.where(is_finite, x, np.nan), np.where(is_finite, z, np.nan))
