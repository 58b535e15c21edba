"""Projection of points through a tube or dome, with derivatives by points and parameters.

The pixel of a point outside the cover is that of any two points on the inner ray, which the
mirror without a cover projects with known derivatives. These give the motion of the inner ray at
both points for changes of parameters and pixel. The cover maps it to the motion of the outer ray,
which must continue to meet the point.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...base.typing import Array
from ...cameras.models.base import Image
from ...optics.housing import Housing
from ...optics.sensor import Sensor
from ...optics.tracing.covered import CoveredMirror
from ...optics.tracing.reflection import Ends
from .imaging import image_of_points
from .names import NamedNumber

NEAR, FAR = 1.0, 3.0  # rim radii from the mirror point: points that define the inner ray
STEP = 1e-5  # rim radii; central differences with an error quadratic in the step


def image_through_cover(sensor: Sensor, points: Array, distant: bool, places: tuple[NamedNumber, ...]) -> Image:
    """Compute the image of points through a tube or dome, as :func:`.imaging.image_of_points`."""
    covered, rim = sensor.optical_train.seen_mirror, sensor.mirror.rim_radius_mm
    assert isinstance(covered, CoveredMirror)
    bare = replace(sensor, housing=Housing())
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        pupil = sensor.optical_train.entrance_pupil_points(np.zeros((1, 2)))
        found = covered.specular(pupil, Ends.of(points, distant))
        held = [found.points + share * rim * found.to_targets for share in (NEAR, FAR)]
        images = [image_of_points(bare, place, False, places) for place in held]
        wanted = points / np.linalg.norm(points, axis=1, keepdims=True) if distant else points
        across, by_held = _misses(covered, held, wanted, distant, STEP * rim)
        turning = np.zeros((len(points), 2, 2))
        moving = np.zeros((len(points), 2, len(places)))
        for image, by_place in zip(images, by_held, strict=True):
            d = image.d_points
            inverse = d.transpose(0, 2, 1) @ np.linalg.inv(d @ d.transpose(0, 2, 1))  # across the ray
            turning += by_place @ inverse
            moving += by_place @ inverse @ image.d_parameters
        by_target = -across / np.linalg.norm(points, axis=1)[:, None, None] if distant else -across
        valid = found.reflects & images[0].valid & images[1].valid
        valid &= np.isfinite(turning).all(axis=(1, 2))
        back = np.linalg.inv(np.where(valid[:, None, None], turning, np.eye(2)))
        d_points, d_parameters = -back @ by_target, back @ moving
    pixels = images[0].pixels
    for array in (pixels, d_points, d_parameters):
        array[~valid] = np.nan
    return Image(pixels, valid, d_points, d_parameters)


def _misses(
    covered: CoveredMirror, held: list[Array], targets: Array, distant: bool, step: float
) -> tuple[Array, list[Array]]:
    """Return directions (n, 2, 3) perpendicular to the outer rays, and derivatives of their misses.

    The miss is the offset of the ray from its target along these directions. Its derivatives
    (n, 2, 3) are with respect to the two points that define the inner ray.
    """

    def miss(places: list[Array]) -> tuple[Array, Array]:
        points, ways = covered.outside_of(places[0] - (places[1] - places[0]) * NEAR / (FAR - NEAR), places[0])
        if distant:
            return ways - targets, ways
        way = targets - points
        return np.einsum("ni,ni->n", way, ways)[:, None] * ways - way, ways

    _, ways = miss(held)
    helper = np.eye(3)[np.abs(ways).argmin(axis=1)]
    e1 = np.cross(ways, helper)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    across = np.stack([e1, np.cross(ways, e1)], axis=1)
    changes = []
    for k in (0, 1):
        columns = []
        for axis in np.eye(3):
            ends = [[p + (sign * step * axis if i == k else 0.0) for i, p in enumerate(held)] for sign in (1, -1)]
            (up, _), (down, _) = map(miss, ends)
            columns.append(np.einsum("nai,ni->na", across, up - down) / (2 * step))
        changes.append(np.stack(columns, axis=-1))
    return across, changes
