"""Where thousands of sensors with errors show the same objects, and how they blur them.

The mirror point in which an entrance pupil sees an object makes the path of light stationary (Fermat). Newton's rule
finds it from the point of the sensor without errors, and the second derivatives of that path are also those of the
reflected wavefront: with A what a unit distance to the pupil adds to them, and B what surface and object do, the
virtual images lie at distances q behind the mirror where ``A/q = B``, and the lens sees their vergence

    V = H^-1 B / (rho cos theta),    H = A / rho + B

as a matrix over (x, y), whose eigenvalues on a sensor without errors are 1/L_t and 1/L_s of Eqs. 34 and 35.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....tracing.reflection import REFLECTS, RIM_SLACK
from .surface import MirrorSurfaces

Array = NDArray[np.float64]

STEPS = 8
"""Most steps of Newton's rule; from .1 mm and .1 deg three are enough."""
CLOSE = 1e-13  # of the rim radius; a step that short is rounding


@dataclass(frozen=True)
class States:
    """Sensors of trials (t,), each with errors of its own, in numbers that rays are traced with.

    Attributes
    ----------
    surfaces
        Their mirrors.
    rotation : (t, 3, 3)
        From the mirror's frame to the camera's.
    shift : (t, 3)
        Vertex in the camera frame, mm.
    pupil : (t, 3)
        Centre of the entrance pupil in the camera frame, mm.
    aperture_mm : (t,)
        Its diameter.
    vergence : (t,)
        In focus, at the entrance pupil, 1/mm.
    brown : (t, 5)
        Distortion k1, k2, k3, p1, p2 of the lens.
    imager : (t, 3, 3)
        From tangents of the viewing angle (x, y, 1) to offsets in px, of a plane that may be shifted, turned and
        tilted; the principal distance is in it.
    breathing_mm : (t,)
        f - e, of focal length and entrance pupil: the principal distance is ``f / (1 - (f - e) v)``.
    focal_mm : (t,)
        f.
    pitch_mm : (t,)
        Of the pixels.
    """

    surfaces: MirrorSurfaces
    rotation: Array
    shift: Array
    pupil: Array
    aperture_mm: Array
    vergence: Array
    brown: Array
    imager: Array
    breathing_mm: Array
    focal_mm: Array
    pitch_mm: Array

    def __len__(self) -> int:
        return len(self.shift)


class SeenObjects(NamedTuple):
    """What trials (t,) show of objects (n,)."""

    mirror_points: Array
    """(t, n, 2) mm, (x, y) in the mirror's frame."""
    tangents: Array
    """(t, n, 2) of the viewing angle at the lens, right and down in the unflipped picture."""
    vergences: Array
    """(t, n, 2, 2), 1/mm: V over image right and down."""
    by_direction: Array
    """(t, n, 2, 3): how fast tangents turn with the object's direction in the mirror's frame."""
    lost: NDArray[np.bool_]
    """(t, n): not on the mirror, or not found."""


def seen(states: States, targets: Array, distant: bool, start: Array, rim_slack: float = RIM_SLACK) -> SeenObjects:
    """Trace objects into all trials.

    Parameters
    ----------
    states
        Of t trials.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame, whose origin is the vertex without errors.
    distant
        Whether they are directions.
    start : (n, 2)
        Mirror points (x, y) mm in which a sensor without errors shows them.
    rim_slack
        By which share of its radius a mirror goes on beyond the rim.

    Returns
    -------
    SeenObjects
        Where and how.
    """
    with np.errstate(all="ignore"):  # what has no mirror is lost
        pupil = np.einsum("tji,tj->ti", states.rotation, states.pupil - states.shift)
        towards = targets if distant else targets - states.shift[:, None, :]
        towards = np.einsum("tji,...nj->tni" if distant else "tji,tnj->tni", states.rotation, towards)
        xy = _mirror_points(states.surfaces, pupil, towards, distant, start)
        path = _path(states.surfaces, pupil, towards, distant, xy)
        return _seen(states, path, xy, rim_slack)


class _Path(NamedTuple):
    """The path of light by way of mirror points, and its derivatives over (x, y)."""

    step: Array
    """(t, n, 3) from pupil to mirror, mm."""
    length: Array
    """(t, n) of that."""
    gradient: Array
    """(t, n, 2)"""
    whole: Array
    """(t, n, 3): xx, xy, yy of H."""
    without_pupil: Array
    """(t, n, 3) of B."""
    slopes: Array
    """(t, n, 2) of the surface."""
    facing: Array
    """(t, n): above 0 where light is reflected, and does not go straight through."""


def _path(surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, xy: Array) -> _Path:
    x, y = xy[..., 0], xy[..., 1]
    h = surfaces.heights(x, y)
    point = np.stack([x, y, h.z], axis=-1)
    step = point - pupil[:, None, :]
    length, ux, uy, uz, from_pupil = _end(step, h.gx, h.gy)
    if distant:
        tx, ty, tz = np.moveaxis(towards, -1, 0)
        px, py, pull, from_target = -tx - h.gx * tz, -ty - h.gy * tz, -tz, np.zeros(1)
    else:
        _, px, py, pull, from_target = _end(point - towards, h.gx, h.gy)
    gradient = np.stack([ux + px, uy + py], axis=-1)
    bent = (uz + pull)[..., None] * np.stack([h.hxx, h.hxy, h.hyy], axis=-1) + from_target
    return _Path(step, length, gradient, bent + from_pupil, bent, np.stack([h.gx, h.gy], axis=-1), uz + pull)


def _end(step: Array, gx: Array, gy: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Of one end: distance, unit vector along x, y (on the surface) and z, and second derivatives (.., 3)."""
    length = np.sqrt(np.einsum("tni,tni->tn", step, step))
    u = step / length[..., None]
    ux, uy = u[..., 0] + gx * u[..., 2], u[..., 1] + gy * u[..., 2]
    second = np.stack([1 + gx * gx - ux * ux, gx * gy - ux * uy, 1 + gy * gy - uy * uy], axis=-1)
    return length, ux, uy, u[..., 2], second / length[..., None]


def _mirror_points(surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, start: Array) -> Array:
    """(t, n, 2) mm, by Newton's rule."""
    xy = np.broadcast_to(start, (len(pupil), *start.shape)).copy()
    for _ in range(STEPS):
        path = _path(surfaces, pupil, towards, distant, xy)
        a, b, c = np.moveaxis(path.whole, -1, 0)
        gx, gy = np.moveaxis(path.gradient, -1, 0)
        step = np.stack([c * gx - b * gy, a * gy - b * gx], axis=-1) / (a * c - b * b)[..., None]
        xy -= step
        if not np.nanmax(np.abs(step), initial=0.0) > CLOSE * surfaces.rim_radius_mm:
            break
    return xy


def _seen(states: States, path: _Path, xy: Array, rim_slack: float) -> SeenObjects:
    turn = states.rotation
    towards = np.einsum("tij,tnj->tni", turn, path.step)
    tangents = towards[..., :2] / towards[..., 2:]
    sideways = np.zeros((*xy.shape, 3))  # of the mirror point, by x and by y, in the mirror's frame
    sideways[..., 0, 0] = sideways[..., 1, 1] = 1.0
    sideways[..., 2] = path.slopes
    moved = np.einsum("tij,tnkj->tnik", turn, sideways)
    spread = (moved[..., :2, :] - tangents[..., None] * moved[..., 2:, :]) / towards[..., 2, None, None]
    inverse = _inverse(_square(path.whole))
    cosine = towards[..., 2] / path.length
    vergence = inverse @ _square(path.without_pupil) / (path.length * cosine)[..., None, None]
    miss = np.hypot(*np.moveaxis(path.gradient, -1, 0)) / np.sqrt(1 + (path.slopes**2).sum(axis=-1))
    rim = states.surfaces.rim_radius_mm
    on_mirror = (miss <= REFLECTS) & (np.hypot(xy[..., 0], xy[..., 1]) <= rim * (1 + rim_slack))
    on_mirror &= (path.facing > 0) & (towards[..., 2] > 0)
    return SeenObjects(
        xy,
        tangents,
        spread @ vergence @ _inverse(spread),
        spread @ inverse @ sideways,
        ~on_mirror,
    )


def _inverse(matrices: Array) -> Array:
    """Invert matrices (.., 2, 2); NaN for singular ones, of rays beside any mirror."""
    determinant = np.linalg.det(matrices)
    is_singular = ~np.isfinite(determinant) | (determinant == 0)
    inverse = np.linalg.inv(np.where(is_singular[..., None, None], np.eye(2), matrices))
    return np.where(is_singular[..., None, None], np.nan, inverse)


def _square(second: Array) -> Array:
    """Symmetric matrices (.., 2, 2) of xx, xy, yy."""
    return second[..., [[0, 1], [1, 2]]]
