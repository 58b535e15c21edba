"""Images of the same objects in all trials, and their blur, by vectorised ray tracing.

The reflection point of an object makes the optical path to the entrance pupil stationary (Fermat).
Newton's method finds it, starting from the point of the nominal sensor. The second derivatives of
the path are also those of the reflected wavefront: with A, the derivatives per unit inverse
distance to the pupil, and B, the contribution of surface and object, virtual images are at
distances q behind the mirror with ``A/q = B``, and the vergence at the lens is

    V = H^-1 B / (rho cos theta),    H = A / rho + B

a matrix over (x, y), whose eigenvalues for the nominal sensor are 1/L_t and 1/L_s of Eqs. 34 and 35.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ...optics.tracing.reflection import REFLECTION_TOLERANCE, RIM_SLACK
from .perturbed_states import MirrorSurfaces, States

STEPS = 8
"""Maximum number of Newton steps; three are sufficient from 0.1 mm and 0.1 deg."""
CLOSE = 1e-13  # convergence limit, in rim radii


class TracedObjects(NamedTuple):
    """Rays from objects (n,) to the lens in trials (t,)."""

    mirror_points: Array
    """Reflection points (t, n, 2) in mm, (x, y) in the mirror frame."""
    tangents: Array
    """Tangents (t, n, 2) of the viewing angle at the lens, right and down in the unmirrored image."""
    vergences: Array
    """Vergence matrices V (t, n, 2, 2) in 1/mm, right and down in the image."""
    by_direction: Array
    """Derivatives (t, n, 2, 3) of tangents with respect to the object direction in the mirror
    frame."""
    lost: NDArray[np.bool_]
    """Rays (t, n) that miss the mirror or do not converge."""


def trace_objects(
    states: States, targets: Array, distant: bool, start: Array, rim_slack: float = RIM_SLACK
) -> TracedObjects:
    """Trace rays from objects to the lens in all trials.

    Parameters
    ----------
    states
        Parameters of t trials.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame with the nominal vertex as origin.
    distant
        Whether targets are directions.
    start : (n, 2)
        Reflection points (x, y) in mm of the nominal sensor.
    rim_slack
        Extension of the mirror beyond its rim, as a fraction of the rim radius.

    Returns
    -------
    TracedObjects
        Reflection points, tangents and vergences.
    """
    with np.errstate(all="ignore"):  # NaN for lost rays
        pupil = np.einsum("tji,tj->ti", states.rotation, states.pupil - states.shift)
        towards = targets if distant else targets - states.shift[:, None, :]
        towards = np.einsum(
            "tji,...nj->tni" if distant else "tji,tnj->tni", states.rotation, towards
        )
        xy = _mirror_points(states.surfaces, pupil, towards, distant, start)
        path = _path(states.surfaces, pupil, towards, distant, xy)
        return _seen(states, path, xy, rim_slack)


class _Path(NamedTuple):
    """Optical path via mirror points and its derivatives with respect to (x, y)."""

    step: Array
    """Vector (t, n, 3) from pupil to mirror, mm."""
    length: Array
    """Length (t, n) of ``step``."""
    gradient: Array
    """Gradient (t, n, 2)."""
    whole: Array
    """Components xx, xy, yy (t, n, 3) of H."""
    without_pupil: Array
    """Components xx, xy, yy (t, n, 3) of B."""
    slopes: Array
    """Slopes (t, n, 2) of the surface."""
    facing: Array
    """Sign (t, n): positive for a reflection, negative for a straight path."""


def _path(
    surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, xy: Array
) -> _Path:
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
    return _Path(
        step, length, gradient, bent + from_pupil, bent, np.stack([h.gx, h.gy], axis=-1), uz + pull
    )


def _end(step: Array, gx: Array, gy: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return the distance of surface points from an end, its x and y derivatives on the surface,
    the z component of the unit vector, and second derivatives (..., 3).
    """
    length = np.sqrt(np.einsum("tni,tni->tn", step, step))
    u = step / length[..., None]
    ux, uy = u[..., 0] + gx * u[..., 2], u[..., 1] + gy * u[..., 2]
    second = np.stack([1 + gx * gx - ux * ux, gx * gy - ux * uy, 1 + gy * gy - uy * uy], axis=-1)
    return length, ux, uy, u[..., 2], second / length[..., None]


def _mirror_points(
    surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, start: Array
) -> Array:
    """Find reflection points (t, n, 2) in mm by Newton's method."""
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


def _seen(states: States, path: _Path, xy: Array, rim_slack: float) -> TracedObjects:
    turn = states.rotation
    towards = np.einsum("tij,tnj->tni", turn, path.step)
    tangents = towards[..., :2] / towards[..., 2:]
    sideways = np.zeros((*xy.shape, 3))  # tangent vectors along x and y in the mirror frame
    sideways[..., 0, 0] = sideways[..., 1, 1] = 1.0
    sideways[..., 2] = path.slopes
    displaced = np.einsum("tij,tnkj->tnik", turn, sideways)
    spread = (displaced[..., :2, :] - tangents[..., None] * displaced[..., 2:, :]) / towards[
        ..., 2, None, None
    ]
    inverse = _inverse(_square(path.whole))
    cosine = towards[..., 2] / path.length
    vergence = inverse @ _square(path.without_pupil) / (path.length * cosine)[..., None, None]
    miss = np.hypot(*np.moveaxis(path.gradient, -1, 0)) / np.sqrt(1 + (path.slopes**2).sum(axis=-1))
    rim = states.surfaces.rim_radius_mm
    on_mirror = (miss <= REFLECTION_TOLERANCE) & (
        np.hypot(xy[..., 0], xy[..., 1]) <= rim * (1 + rim_slack)
    )
    on_mirror &= (path.facing > 0) & (towards[..., 2] > 0)
    return TracedObjects(
        xy,
        tangents,
        spread @ vergence @ _inverse(spread),
        spread @ inverse @ sideways,
        ~on_mirror,
    )


def _inverse(matrices: Array) -> Array:
    """Invert matrices (..., 2, 2); NaN for singular ones, which occur for rays that miss the
    mirror.
    """
    determinant = np.linalg.det(matrices)
    is_singular = ~np.isfinite(determinant) | (determinant == 0)
    inverse = np.linalg.inv(np.where(is_singular[..., None, None], np.eye(2), matrices))
    return np.where(is_singular[..., None, None], np.nan, inverse)


def _square(second: Array) -> Array:
    """Return symmetric matrices (..., 2, 2) from components xx, xy, yy."""
    return second[..., [[0, 1], [1, 2]]]


Refocus = Literal["none", "rms", "worst"]
"""Refocusing of each sensor: none, for minimum RMS blur, or for minimum worst-case blur."""
REFOCUS: tuple[Refocus, ...] = ("none", "rms", "worst")

HALVINGS = 32
"""Iterations of the golden-section search; relative accuracy 2e-7."""
GOLDEN = (np.sqrt(5.0) - 1) / 2


class TrialImages(NamedTuple):
    """Images of objects (n,) in trials (t,)."""

    offsets_px: Array
    """Offsets (t, n, 2) from the optical axis, right and down in the unmirrored image; NaN if lost."""
    blur_px: Array
    """Matrices (t, n, 2, 2) that map the unit circle of the aperture to the blur ellipse of
    diameters."""
    by_direction: Array
    """Derivatives (t, n, 2, 3) in px per rad of the object direction in the mirror frame."""
    vergence: Array
    """Vergence (t,) in focus at the entrance pupil, 1/mm."""


def form_images(states: States, result: TracedObjects, refocus: Refocus = "none") -> TrialImages:
    """Compute the images of traced objects.

    Parameters
    ----------
    states
        Parameters of t trials.
    result
        Traced objects.
    refocus
        Refocusing mode; focus breathing is included.

    Returns
    -------
    TrialImages
        Positions and blur.
    """
    with np.errstate(all="ignore"):
        tangents = np.where(result.lost[..., None], np.nan, result.tangents)
        widen, _, depth = _imaged(states, tangents)
        spread = widen @ _less(result.vergences, _tilt_vergence(states, depth))
        vergence = states.vergence if refocus == "none" else focus_vergences(widen, spread, refocus)
        f = states.breathing_mm
        breath = (1 - f * states.vergence) / (1 - f * vergence)
        widen, offsets, depth = _imaged(states, tangents, breath)
        vergences = _less(result.vergences, _tilt_vergence(states, depth))
        blur = states.aperture_mm[:, None, None, None] * (
            vergence[:, None, None, None] * widen - widen @ vergences
        )
        return TrialImages(offsets, blur, widen @ result.by_direction, vergence)


def imaged_at(states: States, tangents: Array, vergence: Array) -> Array:
    """Return image positions (t, n, 2) in px of viewing tangents (t, n, 2) at focus vergences (t,)."""
    f = states.breathing_mm
    return _imaged(states, tangents, (1 - f * states.vergence) / (1 - f * vergence))[1]


def _less(vergences: Array, part: Array) -> Array:
    """Subtract isotropic vergences (t, n) from vergence matrices (t, n, 2, 2)."""
    less: Array = vergences - part[..., None, None] * np.eye(2)
    return less


def _tilt_vergence(states: States, depth: Array) -> Array:
    """Return the difference (t, n) in 1/mm of the vergence in focus on a tilted imager from its centre.

    The depth of the image point behind the lens and the lens equation determine the focus distance.
    """
    tilted = (states.imager[:, 2, :2] != 0).any(axis=1)
    if not tilted.any():
        return np.zeros_like(depth)
    f, v = states.focal_mm[:, None], states.vergence[:, None]
    breathing = states.breathing_mm[:, None]
    middle = f / (1 - breathing * v)
    behind = middle * (1 + (f - breathing) * v) + depth - middle
    part = 1 / (f * behind / (behind - f) - (f - breathing)) - v
    return np.where(tilted[:, None], part, 0.0)


def _imaged(
    states: States, tangents: Array, breath: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return derivatives (t, n, 2, 2) in px per tangent, offsets (t, n, 2) in px, and depths (t, n)
    in mm.
    """
    displaced, (xx, xy, yy) = _distorted(tangents, states.brown)
    if breath is not None:
        displaced, xx, xy, yy = (
            displaced * breath[:, None, None],
            *(d * breath[:, None] for d in (xx, xy, yy)),
        )
    h = states.imager[:, None]
    flat = np.concatenate([displaced, np.ones((*displaced.shape[:-1], 1))], axis=-1)
    u, v, w = np.moveaxis(
        np.einsum("tnij,tnj->tni", np.broadcast_to(h, (*flat.shape, 3)), flat), -1, 0
    )
    offsets = np.stack([u, v], axis=-1) / w[..., None]
    plane = (h[..., :2, :2] - offsets[..., None] * h[..., 2:, :2]) / w[..., None, None]
    lens = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    return plane @ lens, offsets, 1 / w


def _distorted(tangents: Array, brown: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Apply the distortion of :mod:`omnimirror.optics.lenses.lens` per trial; also return xx, xy,
    yy.
    """
    x, y = tangents[..., 0], tangents[..., 1]
    k1, k2, k3, p1, p2 = brown.T[..., None]
    s = x * x + y * y
    radial, rate = 1 + s * (k1 + s * (k2 + s * k3)), 2 * (k1 + s * (2 * k2 + 3 * s * k3))
    displaced = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = radial + x * x * rate + 2 * p1 * y + 6 * p2 * x
    xy = x * y * rate + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * rate + 6 * p1 * y + 2 * p2 * x
    return displaced, (xx, xy, yy)


def focus_vergences(widen: Array, spread: Array, refocus: Refocus) -> Array:
    """Return vergences (t,) of best focus from matrices W and W V (t, n, 2, 2).

    The blur ``v W - W V`` is linear in the vergence v: its sum of squares is a parabola, and the
    worst-case blur is a convex function.
    """
    squares, mixed = np.nansum(widen**2, axis=(1, 2, 3)), np.nansum(widen * spread, axis=(1, 2, 3))
    middle: Array = mixed / squares
    if refocus == "rms":
        return middle
    size, turned = _squared_blur(widen, spread)
    half, product = turned[1] / turned[2] / -2, turned[0] / turned[2]
    apart = np.sqrt(np.abs(half**2 - product))
    low, high = np.nanmin(half - apart, axis=1), np.nanmax(half + apart, axis=1)

    def worst(v: Array) -> Array:
        v = v[:, None]
        square, det = (
            size[0] + v * (size[1] + v * size[2]),
            turned[0] + v * (turned[1] + v * turned[2]),
        )
        return np.asarray(
            np.nanmax(square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0.0)), axis=1)
        )

    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a, at_b = worst(a), worst(b)
    for _ in range(HALVINGS):
        is_left = at_a < at_b
        low, high = np.where(is_left, low, a), np.where(is_left, b, high)
        new = np.where(is_left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_new = worst(new)
        a, b = np.where(is_left, new, b), np.where(is_left, a, new)
        at_a, at_b = np.where(is_left, at_new, at_b), np.where(is_left, at_a, at_new)
    return np.asarray((low + high) / 2)


def _squared_blur(widen: Array, spread: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return coefficients of 1, v and v^2 of the sum of squares and the determinant of ``v W - S``."""
    w, s = widen.reshape(*widen.shape[:-2], 4), spread.reshape(*spread.shape[:-2], 4)
    size = (s * s).sum(axis=-1), -2 * (w * s).sum(axis=-1), (w * w).sum(axis=-1)
    crossed = (
        w[..., 0] * s[..., 3]
        + s[..., 0] * w[..., 3]
        - w[..., 1] * s[..., 2]
        - s[..., 1] * w[..., 2]
    )
    return size, (s[..., 0] * s[..., 3] - s[..., 1] * s[..., 2], -crossed, np.linalg.det(widen))


def largest_diameter(blur: Array) -> Array:
    """Compute the major diameters (...) of ellipses given by matrices (..., 2, 2).

    >>> float(largest_diameter(np.array([[3.0, 0.0], [0.0, -4.0]])))
    4.0
    """
    (p, s), (q, r) = diameter_components(blur)
    diameter: Array = np.hypot(p, s) + np.hypot(q, r)
    return diameter


def diameter_components(blur: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return two vectors whose lengths add up to the major diameter: rotation-scaling and shear
    parts.
    """
    p, q = (blur[..., 0, 0] + blur[..., 1, 1]) / 2, (blur[..., 0, 0] - blur[..., 1, 1]) / 2
    r, s = (blur[..., 1, 0] + blur[..., 0, 1]) / 2, (blur[..., 1, 0] - blur[..., 0, 1]) / 2
    return (p, s), (q, r)
