"""Notebook card of a mirror sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..base.errors import OmnimirrorError
from ..base.html_card import Line, card, field_range, line_drawing, origin
from ..base.typing import Array
from .lenses import GaussianLens, Lens

if TYPE_CHECKING:
    from .sensor import Sensor


PROFILE_POINTS = 61
CHIEF_RAYS = 7
TELECENTRIC_LENS_RADII = 2.5  # distance of a drawn telecentric lens from the vertex, in rim radii
OBJECT_RAY_RADII = 0.8  # length of rays in object space, in rim radii


def sensor_card(sensor: Sensor) -> str:
    """Return an HTML card with cross-section, chief rays and properties."""
    nominal = sensor.aligned()
    try:
        drawing, field = (
            line_drawing(list(_section(nominal)), f"Cross-section of {sensor.name}"),
            _field_properties(nominal),
        )
    except OmnimirrorError as e:
        drawing, field = "", {"Invalid": str(e)}
    lens, imager, mount = sensor.lens, sensor.imager, sensor.mount
    distance = {} if lens.TELECENTRIC else {"Distance": f"{sensor.mirror_distance_mm:.4g} mm from lens to mirror"}
    parts = {
        "Mirror": f"{sensor.mirror.KIND}, rim radius {sensor.mirror.rim_radius_mm:.4g} mm{_secondary(sensor)}",
        "Lens": f"{lens.KIND}, {_focal(lens)}F/{lens.image_f_number():.3g} at the image",
        **distance,
        "Imager": f"{imager.width_px} × {imager.height_px} px of {imager.pitch_mm * 1e3:.4g} µm",
        "Camera looks": mount.camera_looks + (", image flipped" if mount.image_flipped else ""),
    }
    return card(
        sensor.name,
        "mirror sensor",
        drawing,
        {**field, **parts, **_misalignment(sensor)},
        origin(getattr(sensor, "notes", ""), len(sensor.uncertainty.names) if sensor.uncertainty else 0),
    )


def _section(sensor: Sensor) -> Iterator[Line]:
    """Yield mirrors, lens and chief rays in the meridional plane, vertical direction up."""
    is_level = abs(sensor.axis[2]) < np.sqrt(0.5)
    sign = 1.0 if is_level or sensor.axis[2] < 0 else -1.0

    def line(x: Array, z: Array, style: str) -> Line:
        return Line(sign * z, x, style) if is_level else Line(x, sign * z, style)

    meridian, second, rim = sensor.meridian, sensor.secondary, sensor.mirror.rim_radius_mm
    x = np.linspace(-rim, rim, PROFILE_POINTS)
    yield line(x, sensor.mirror.sag(np.abs(x)), "strong")
    lens = -meridian.m if np.isfinite(meridian.m) else -TELECENTRIC_LENS_RADII * rim
    if second is not None:
        wide = np.linspace(-second.mirror.rim_radius_mm, second.mirror.rim_radius_mm, PROFILE_POINTS)
        yield line(wide, second.height(np.abs(wide)), "strong")
        lens = second.lens_height(meridian.m) if np.isfinite(meridian.m) else rim
    rays = meridian.trace(meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, CHIEF_RAYS)))
    first = rays.first.x
    end = first if sensor.lens.TELECENTRIC else np.zeros_like(first)
    half = float(end.max()) or 0.12 * rim
    yield line(np.array([-half, half]), np.full(2, lens), "plain")
    path = np.array([rays.x + OBJECT_RAY_RADII * rim * np.sin(rays.omega), rays.x, end])
    heights = np.array([rays.z - OBJECT_RAY_RADII * rim * np.cos(rays.omega), rays.z, np.full_like(end, lens)])
    if second is not None:
        path, heights = np.insert(path, 2, first, axis=0), np.insert(heights, 2, second.height(first), axis=0)
    for k in range(CHIEF_RAYS):
        for side in (-1, 1):
            yield line(side * path[:, k], heights[:, k], "fine")


def _field_properties(sensor: Sensor) -> dict[str, str]:
    """Return field, image size, resolution and obscuration."""
    meridian = sensor.meridian
    rays = meridian.trace(meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, PROFILE_POINTS)))
    rate = np.abs(sensor.image_height_rate_px(rays)) * np.pi / 180
    rate = rate[np.isfinite(rate)]
    properties = {
        "Field": field_range(meridian.omega_min, meridian.omega_max),
        "Image of the rim": f"{sensor.rim_radius_px:.4g} px radius",
        "Resolution": f"{rate.min():.3g} to {rate.max():.3g} px/° radial",
    }
    return (
        {**properties, "Obscuration": f"{sensor.hidden_percent:.3g} % of the image"} if sensor.obscured else properties
    )


def _secondary(sensor: Sensor) -> str:
    return f", with secondary ({sensor.secondary.mirror.KIND})" if sensor.secondary else ""


def _misalignment(sensor: Sensor) -> dict[str, str]:
    """Describe the misalignment of a sensor; the drawing is aligned."""
    if sensor.is_axial:
        return {}
    pose = sensor.mirror_pose
    if pose.is_axial:
        return {"Misaligned": "cover, imager or form of the mirror"}
    shift, tilt = (pose.decentre_x_mm, pose.decentre_y_mm), (pose.tilt_x_deg, pose.tilt_y_deg)
    return {"Misaligned": "mirror decentred by {:g} and {:g} mm, tilted by {:g} and {:g}°".format(*shift, *tilt)}


def _focal(lens: Lens) -> str:
    return f"{lens.focal_length_mm:.4g} mm, " if isinstance(lens, GaussianLens) else ""
