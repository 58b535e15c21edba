"""Compensation: residual image motion after calibrations of increasing depth, and merits of trials.

A calibration fits a sensor model to the images of the as-built sensor. It can remove, one model
after another: a shift of the principal point; an affine transformation of the image; decentre,
displacement and tilt of the mirror with their squares and products, because a linear model leaves
spurious residuals of up to 1 px; and a radial mapping. All sums over the field are precomputed: a
trial requires about thirty scalar products.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Literal, get_args

import numpy as np

from ...base.typing import Array
from .perturbed_states import Values
from .tolerances import error_sources
from .trial_images import RIM_MARGIN, Field, Refocus, TrialImages, largest_diameter

Calibration = Literal["none", "principal-point", "affine", "pose", "radial"]
CALIBRATIONS: tuple[Calibration, ...] = get_args(Calibration)
"""Calibration models, each including those before it."""
POSE = (
    "mirror.decentre_x_mm",
    "mirror.decentre_y_mm",
    "mirror.displacement_mm",
    "mirror.tilt_x_deg",
    "mirror.tilt_y_deg",
)

STEP = 0.02  # step of differences, mm and deg; truncation and rounding errors below 1e-6
OUTSIDE = 1e-6  # relative residual below which a column is linearly dependent
RADIAL_POWERS = (2, 3, 4, 5, 6, 7)
ROUNDS = 3
"""Gauss-Newton iterations for the pose; from 0.5 mm and 0.5 deg, the fourth has no effect."""


@dataclass(frozen=True)
class Compensators:
    """Compensable image motions, as vectors (2 n,): x of all objects, then y.

    Attributes
    ----------
    affine : (k, 2 n)
        Orthonormal rows; the first two are shifts.
    basis : (e, 2 n)
        Orthonormal rows of pose motions, orthogonal to ``affine``.
    linear : (e, p)
        First-order coefficients of the pose parameters.
    quadratic : (e, p (p + 1) / 2)
        Second-order coefficients, in the order of ``combinations_with_replacement``.
    radial : (k, 2 n)
        Orthonormal rows of a radial mapping, orthogonal to all first-order motions.
    """

    affine: Array
    basis: Array
    linear: Array
    quadratic: Array
    radial: Array

    def left(self, motion: Array) -> Array:
        """Return residuals (calibrations, t, 2 n) of motions (t, 2 n)."""
        shifted = motion - (motion @ self.affine[:2].T) @ self.affine[:2]
        stretched = motion - (motion @ self.affine.T) @ self.affine
        posed = stretched - self.moved(self.pose(motion))[0] @ self.basis
        return np.stack(
            [motion, shifted, stretched, posed, posed - (posed @ self.radial.T) @ self.radial]
        )

    def pose(self, motion: Array) -> Array:
        """Fit poses (t, p) to motions by the Gauss-Newton method, after the affine part."""
        projected = motion @ self.basis.T
        pose = np.zeros((len(motion), self.linear.shape[1]))
        for _ in range(ROUNDS):
            moved, rate = self.moved(pose)
            normal = rate.swapaxes(1, 2) @ rate
            pose = (
                pose
                + np.linalg.solve(
                    normal, np.einsum("tep,te->tp", rate, projected - moved)[..., None]
                )[..., 0]
            )
        return pose

    def moved(self, pose: Array) -> tuple[Array, Array]:
        """Return motions (t, e) of poses (t, p) and their derivatives (t, e, p)."""
        pairs = list(combinations_with_replacement(range(pose.shape[1]), 2))
        moved = pose @ self.linear.T
        rate = np.broadcast_to(self.linear, (len(pose), *self.linear.shape)).copy()
        for (i, j), column in zip(pairs, self.quadratic.T, strict=True):
            moved += (pose[:, i] * pose[:, j])[:, None] * column
            rate[:, :, i] += pose[:, j, None] * column
            rate[:, :, j] += pose[:, i, None] * column
        return moved, rate


def fit_compensators(field: Field) -> Compensators:
    """Compute the compensable motions of a sensor.

    Pose parameters with the effect of other ones are omitted: a tilted sphere is a decentred sphere.

    Parameters
    ----------
    field
        Objects over the field.

    Returns
    -------
    Compensators
        Motions of all calibration models.
    """
    n = len(field)
    x, y = (field.offsets_px / np.abs(field.offsets_px).max()).T
    zero, one = np.zeros(n), np.ones(n)
    shift = [np.append(one, zero), np.append(zero, one)]
    stretch = [np.append(c, zero) for c in (x, y)] + [np.append(zero, c) for c in (x, y)]
    r = np.hypot(x, y)
    linear, quadratic = _by_pose(field)
    affine = _orthonormal(np.zeros((0, 2 * n)), shift + stretch)
    orthonormal, retained = affine, []
    for i, column in enumerate(linear):
        before = len(orthonormal)
        orthonormal = _orthonormal(orthonormal, [column])
        if len(orthonormal) > before:
            retained.append(i)
    pairs = list(combinations_with_replacement(retained, 2))
    basis = _orthonormal(orthonormal, [quadratic[pair] for pair in pairs])[len(affine) :]
    lines = np.stack([basis @ linear[i] for i in retained], axis=-1)
    curves = np.stack([basis @ quadratic[pair] for pair in pairs], axis=-1)
    mapping = [np.append(x * r ** (p - 1), y * r ** (p - 1)) for p in RADIAL_POWERS]
    return Compensators(
        affine, basis, lines, curves, _orthonormal(orthonormal, mapping)[len(orthonormal) :]
    )


def _orthonormal(rows: Array, more: list[Array]) -> Array:
    """Extend orthonormal rows (k, 2 n) by vectors that are not in their span."""
    for vector in more:
        rest = _outside(rows, vector)
        if np.linalg.norm(rest) > OUTSIDE * np.linalg.norm(vector):
            rows = np.vstack([rows, rest / np.linalg.norm(rest)])
    return rows


def _outside(rows: Array, vector: Array) -> Array:
    """Subtract the projection onto rows, twice to reduce rounding errors."""
    for _ in range(2):
        vector = vector - (rows @ vector) @ rows
    return vector


def _by_pose(field: Field) -> tuple[list[Array], dict[tuple[int, int], Array]]:
    """Compute first derivatives of motion with respect to each pose parameter, and second-order
    terms of pairs.
    """
    pose = [
        name for name in POSE if name in error_sources(field.sensor)
    ]  # folded sensors: axial displacement only
    pairs = list(combinations_with_replacement(range(len(pose)), 2))
    steps = []
    for i, j in pairs:
        for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
            step = np.zeros(len(pose))
            step[i] += a * STEP
            step[j] += b * STEP
            steps.append(step)
    poses = np.array(steps)
    moved = motion(
        field.images(dict(zip(pose, poses.T, strict=True)), rim_slack=RIM_MARGIN).offsets_px,
        field.offsets_px,
    )
    quadratic: dict[tuple[int, int], Array] = {}
    linear: list[Array] = []
    for k, (i, j) in enumerate(pairs):
        both, neither, first, second = moved[4 * k : 4 * k + 4]
        if i == j:  # two steps of one parameter: first and second are 0
            linear.append((both - neither) / (4 * STEP))
            quadratic[i, j] = (both + neither) / (8 * STEP**2)
        else:
            quadratic[i, j] = (both + neither - first - second) / (4 * STEP**2)
    return linear, quadratic


def motion(offsets_px: Array, reference_px: Array) -> Array:
    """Return image motions (t, 2 n) in px of images (t, n, 2) relative to reference positions (n,
    2).
    """
    moved = offsets_px - reference_px
    return np.concatenate([moved[..., 0], moved[..., 1]], axis=-1)


OF_MOTION = ("motion_rms_px", "motion_px", "direction_error_rms_deg", "direction_error_deg")
OF_BLUR = ("blur_px", "floored_area_deg2", "focus_distance_mm")
LOST = "lost_rays"
MERITS = 4 * len(CALIBRATIONS) + len(OF_BLUR) + 1


def merit_names() -> tuple[str, ...]:
    """Return the names of trial merits; names of motions end in their calibration.

    >>> merit_names()[:2], merit_names()[-4:]
    (('motion_rms_px', 'motion_px'), ('blur_px', 'floored_area_deg2', 'focus_distance_mm', 'lost_rays'))
    """
    of_motion = (after(name, depth) for depth in CALIBRATIONS for name in OF_MOTION)
    return (*of_motion, *OF_BLUR, LOST)


def after(name: str, calibration: Calibration) -> str:
    """Return the name of a motion merit after a calibration.

    >>> after("motion_px", "none"), after("motion_px", "affine")
    ('motion_px', 'motion_px after affine')
    """
    return name if calibration == "none" else f"{name} after {calibration}"


@dataclass(frozen=True)
class Reference:
    """Precomputed reference data of a sensor for the evaluation of trials.

    Attributes
    ----------
    field
        Objects over the field.
    compensators
        Compensable motions.
    reference_px : (n, 2)
        Nominal image positions with the focus of the trials.
    refocus
        Refocusing mode.
    floor_px2
        Contribution of pixel and Airy disc to the squared blur.
    """

    field: Field
    compensators: Compensators
    reference_px: Array
    refocus: Refocus
    floor_px2: float


def evaluate_numpy(reference: Reference, values: Values) -> tuple[Array, Array]:
    """Compute merits (t, m) and motions (t, 2 n) in px of trials; NaN if rays are lost."""
    with np.errstate(all="ignore"):
        images, are_lost, focus_mm = reference.field.images_and_focus(
            values, refocus=reference.refocus
        )
        lost_count = are_lost.sum(axis=1)
        merits = np.full((len(lost_count), MERITS), np.nan)
        merits[:, -1] = lost_count
        moved = motion(images.offsets_px, reference.reference_px)
        deg_per_px = np.asarray(np.linalg.inv(reference.field.px_per_deg), dtype=float)
        for k, residuals in enumerate(reference.compensators.left(np.nan_to_num(moved))):
            merits[:, 4 * k : 4 * k + 4] = _motion_merits(residuals, deg_per_px)
        at = 4 * len(CALIBRATIONS)
        merits[:, at : at + 3] = _blur_merits(reference, images, focus_mm)
        merits[lost_count > 0, :-1], moved[lost_count > 0] = np.nan, np.nan
    return merits, moved


def _blur_merits(reference: Reference, images: TrialImages, focus_mm: Array) -> Array:
    blur, floor = images.blur_px, reference.floor_px2
    squares = (blur**2).sum(axis=(-2, -1))
    area_px2 = np.sqrt(np.linalg.det(blur) ** 2 + floor * squares + floor**2)
    area = area_px2 / np.abs(np.linalg.det(reference.field.px_per_deg))
    return np.stack([largest_diameter(blur).max(axis=1), area.max(axis=1), focus_mm], axis=-1)


def _motion_merits(residuals: Array, deg_per_px: Array) -> Array:
    """Return RMS and maximum (t, 4) of residuals (t, 2 n), in px and in deg."""
    vectors = np.stack(np.split(residuals, 2, axis=-1), axis=-1)
    turned = np.einsum("nij,tnj->tni", deg_per_px, vectors)
    squares = [(v**2).sum(axis=-1) for v in (vectors, turned)]
    return np.stack([f(s) for s in squares for f in (_rms, _worst)], axis=-1)


def _rms(squares: Array) -> Array:
    return np.asarray(np.sqrt(squares.mean(axis=-1)))


def _worst(squares: Array) -> Array:
    return np.asarray(np.sqrt(squares.max(axis=-1)))
