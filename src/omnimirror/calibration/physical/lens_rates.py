"""Projection from mirror points to pixels, with derivatives by points, lens and imager."""

from __future__ import annotations

import numpy as np

from ...base.typing import Array, Mask
from ...optics.lenses import Perspective
from ...optics.lenses.distortion import TERMS, distorted_rates
from ...optics.sensor import Sensor
from .names import DISTANCE, NamedNumber


def lens_image(sensor: Sensor, seen_at: Array, places: tuple[NamedNumber, ...]) -> tuple[Array, Mask, Array, Array]:
    """Return pixels (n, 2) of points (n, 3) mm in the camera frame, validity and derivatives.

    Returns
    -------
    tuple
        Pixels (n, 2); valid (n,); derivatives (n, 2, 3) in px per mm of the points; derivatives (n,
        2, k) in px per unit of k parameters of lens, imager and distance, for fixed points.
    """
    by_key: dict[str, Array]
    if isinstance(sensor.lens, Perspective):
        image, valid, by_seen, by_key = _perspective(sensor, sensor.lens, seen_at)
    else:
        image, valid, by_seen, by_key = _parallel(sensor, seen_at)
    pitch, flip = sensor.imager.pitch_mm, np.array([-1.0 if sensor.mount.image_flipped else 1.0, 1.0])
    offsets = image / pitch
    by_key["pixel_pitch_um"] = -image / sensor.imager.pixel_pitch_um
    by_key["centre_px"] = np.full_like(image, pitch)
    by_place = np.zeros((*image.shape, len(places)))
    for k, place in enumerate(places):
        if place.section in ("lens", "imager") or place.name == DISTANCE:
            rows = slice(None) if place.item is None else place.item
            by_place[:, rows, k] = by_key[place.key][:, rows] / pitch
    u, v = sensor.imager.centre
    start = np.array([sensor.imager.width_px - 1 - u if flip[0] < 0 else u, v])
    return start + flip * offsets, valid, by_seen / pitch * flip[:, None], by_place * flip[:, None]


def _perspective(sensor: Sensor, lens: Perspective, seen_at: Array) -> tuple[Array, Mask, Array, dict[str, Array]]:
    """Return image points (n, 2) mm, and their derivatives by points and parameters.

    Shapes of the derivatives are (n, 2, 3) and (n, 2).
    """
    c, brown = lens.principal_distance, lens.brown
    depth = seen_at[:, 2] - sensor.optical_train.pupil_offset[2]
    tangent = seen_at[:, :2] / depth[:, None]
    moved, by_tangent, by_term = distorted_rates(tangent, brown)
    lateral = np.zeros((len(tangent), 2, 3))
    lateral[:, 0, 0] = lateral[:, 1, 1] = 1 / depth
    lateral[:, :, 2] = -tangent / depth[:, None]
    by_seen = c * by_tangent @ lateral
    L0, f = lens.focus_distance_mm, lens.focal_length_mm
    by_focal = moved * (lens.from_pupil * L0 / (L0 - f) ** 2)
    by_key = {"focal_length_mm": by_focal, "mirror_distance_mm": by_seen[:, :, 2]}
    by_key |= {name: c * by_term[:, :, i] for i, name in enumerate(TERMS)}
    valid = np.asarray(np.isfinite(moved).all(axis=1) & (depth > 0))
    return c * moved, valid, by_seen, by_key


def _parallel(sensor: Sensor, seen_at: Array) -> tuple[Array, Mask, Array, dict[str, Array]]:
    """Return the same for a telecentric lens."""
    mu = float(sensor.lens.ideal_height(np.ones(1), np.full(1, np.inf))[0])
    by_seen = np.zeros((len(seen_at), 2, 3))
    by_seen[:, 0, 0] = by_seen[:, 1, 1] = mu
    image = mu * seen_at[:, :2]
    return image, np.asarray(np.isfinite(image).all(axis=1)), by_seen, {"magnification": seen_at[:, :2].copy()}
