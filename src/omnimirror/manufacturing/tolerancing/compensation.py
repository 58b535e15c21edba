"""What is left of the motion of a picture after calibrations of stated depth.

A calibration fits a model of the sensor to what the built one shows. What it can take away of a motion is, column by
column: a shift of the principal point; an affine change of the picture; decentre, displacement and tilt of the mirror
with their squares and products, since a straight line in them would leave up to a pixel that is not there; and a radial
mapping of its own. All sums over the field are made once: a trial costs products with some thirty vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .object_field import BEYOND, Field
from .perturbation import errors_of
from .perturbed_states import Values
from .trial_images import Picture, Refocus, largest_diameter

Array = NDArray[np.float64]

Calibration = Literal["none", "principal-point", "affine", "pose", "radial"]
CALIBRATIONS: tuple[Calibration, ...] = get_args(Calibration)
"""Each takes away what those before it do, and more."""
POSE = (
    "mirror.decentre_x_mm",
    "mirror.decentre_y_mm",
    "mirror.displacement_mm",
    "mirror.tilt_x_deg",
    "mirror.tilt_y_deg",
)

STEP = 0.02  # mm and deg, of the differences: third derivatives and rounding stay under 1e-6 of what they measure
OUTSIDE = 1e-6  # share of a column outside the ones before it, below which it is the same once more
RADIAL_POWERS = (2, 3, 4, 5, 6, 7)
ROUNDS = 3
"""Of Gauss and Newton, in the few numbers of a pose; from .5 mm and .5 deg the fourth moves nothing."""


@dataclass(frozen=True)
class Compensators:
    """What calibrations take away, over vectors (2 n,) of motions: x of all objects, then y.

    Attributes
    ----------
    affine : (k, 2 n)
        Orthonormal rows; the first two are the shifts.
    basis : (e, 2 n)
        Orthonormal rows, beside those, in which a pose moves the picture.
    straight : (e, p)
        How, by each number of the pose.
    bent : (e, p (p + 1) / 2)
        And by each product of two of them, in the order of ``combinations_with_replacement``.
    radial : (k, 2 n)
        Orthonormal rows of a radial mapping, beside all others of first order.
    """

    affine: Array
    basis: Array
    straight: Array
    bent: Array
    radial: Array

    def left(self, motion: Array) -> Array:
        """Residuals (calibrations, t, 2 n) of motions (t, 2 n)."""
        shifted = motion - (motion @ self.affine[:2].T) @ self.affine[:2]
        stretched = motion - (motion @ self.affine.T) @ self.affine
        posed = stretched - self.moved(self.pose(motion))[0] @ self.basis
        return np.stack([motion, shifted, stretched, posed, posed - (posed @ self.radial.T) @ self.radial])

    def pose(self, motion: Array) -> Array:
        """Poses (t, p) that explain motions best, beside affine changes."""
        seen = motion @ self.basis.T
        pose = np.zeros((len(motion), self.straight.shape[1]))
        for _ in range(ROUNDS):
            moved, rate = self.moved(pose)
            normal = rate.swapaxes(1, 2) @ rate
            pose = pose + np.linalg.solve(normal, np.einsum("tep,te->tp", rate, seen - moved)[..., None])[..., 0]
        return pose

    def moved(self, pose: Array) -> tuple[Array, Array]:
        """Motion (t, e) by poses (t, p), and its derivatives (t, e, p)."""
        pairs = list(combinations_with_replacement(range(pose.shape[1]), 2))
        moved = pose @ self.straight.T
        rate = np.broadcast_to(self.straight, (len(pose), *self.straight.shape)).copy()
        for (i, j), column in zip(pairs, self.bent.T, strict=True):
            moved += (pose[:, i] * pose[:, j])[:, None] * column
            rate[:, :, i] += pose[:, j, None] * column
            rate[:, :, j] += pose[:, i, None] * column
        return moved, rate


def compensators_of(field: Field) -> Compensators:
    """What calibrations of a sensor take away.

    Numbers of a pose whose effect is that of others are left out: a tilted sphere is a decentred one.

    Parameters
    ----------
    field
        The objects.

    Returns
    -------
    Compensators
        Of all depths.
    """
    n = len(field)
    x, y = (field.offsets_px / np.abs(field.offsets_px).max()).T
    zero, one = np.zeros(n), np.ones(n)
    shift = [np.append(one, zero), np.append(zero, one)]
    stretch = [np.append(c, zero) for c in (x, y)] + [np.append(zero, c) for c in (x, y)]
    r = np.hypot(x, y)
    straight, bent = _by_pose(field)
    affine = _orthonormal(np.zeros((0, 2 * n)), shift + stretch)
    taken, kept = affine, []
    for i, column in enumerate(straight):
        before = len(taken)
        taken = _orthonormal(taken, [column])
        if len(taken) > before:
            kept.append(i)
    pairs = list(combinations_with_replacement(kept, 2))
    basis = _orthonormal(taken, [bent[pair] for pair in pairs])[len(affine) :]
    lines = np.stack([basis @ straight[i] for i in kept], axis=-1)
    curves = np.stack([basis @ bent[pair] for pair in pairs], axis=-1)
    mapping = [np.append(x * r ** (p - 1), y * r ** (p - 1)) for p in RADIAL_POWERS]
    return Compensators(affine, basis, lines, curves, _orthonormal(taken, mapping)[len(taken) :])


def _orthonormal(rows: Array, more: list[Array]) -> Array:
    """Those rows (k, 2 n), and what more vectors add to them."""
    for vector in more:
        rest = _outside(rows, vector)
        if np.linalg.norm(rest) > OUTSIDE * np.linalg.norm(vector):
            rows = np.vstack([rows, rest / np.linalg.norm(rest)])
    return rows


def _outside(rows: Array, vector: Array) -> Array:
    """A vector less what rows have of it; twice, since once leaves rounding."""
    for _ in range(2):
        vector = vector - (rows @ vector) @ rows
    return vector


def _by_pose(field: Field) -> tuple[list[Array], dict[tuple[int, int], Array]]:
    """First derivatives of motion by each number of a pose, and the terms of second order by pairs of them."""
    pose = [name for name in POSE if name in errors_of(field.sensor)]  # two mirrors move along their axis alone
    pairs = list(combinations_with_replacement(range(len(pose)), 2))
    steps = []
    for i, j in pairs:
        for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
            step = np.zeros(len(pose))
            step[i] += a * STEP
            step[j] += b * STEP
            steps.append(step)
    poses = np.array(steps)
    moved = motion(field.picture(dict(zip(pose, poses.T, strict=True)), rim_slack=BEYOND).offsets_px, field.offsets_px)
    bent: dict[tuple[int, int], Array] = {}
    straight: list[Array] = []
    for k, (i, j) in enumerate(pairs):
        both, neither, first, second = moved[4 * k : 4 * k + 4]
        if i == j:  # two steps of one: first and second are 0
            straight.append((both - neither) / (4 * STEP))
            bent[i, j] = (both + neither) / (8 * STEP**2)
        else:
            bent[i, j] = (both + neither - first - second) / (4 * STEP**2)
    return straight, bent


def motion(offsets_px: Array, reference_px: Array) -> Array:
    """Motions (t, 2 n) px of pictures (t, n, 2) against those (n, 2) of a sensor without errors."""
    moved = offsets_px - reference_px
    return np.concatenate([moved[..., 0], moved[..., 1]], axis=-1)


OF_MOTION = ("motion_rms_px", "motion_px", "direction_error_rms_deg", "direction_error_deg")
OF_BLUR = ("blur_px", "floored_area_deg2", "focus_distance_mm")
LOST = "lost_rays"
MERITS = 4 * len(CALIBRATIONS) + len(OF_BLUR) + 1


def merit_names() -> tuple[str, ...]:
    """Names of what a trial is evaluated by; those of motions end in their calibration.

    >>> merit_names()[:2], merit_names()[-4:]
    (('motion_rms_px', 'motion_px'), ('blur_px', 'floored_area_deg2', 'focus_distance_mm', 'lost_rays'))
    """
    of_motion = (after(name, depth) for depth in CALIBRATIONS for name in OF_MOTION)
    return (*of_motion, *OF_BLUR, LOST)


def after(name: str, calibration: Calibration) -> str:
    """Name of a merit of motion after a calibration.

    >>> after("motion_px", "none"), after("motion_px", "affine")
    ('motion_px', 'motion_px after affine')
    """
    return name if calibration == "none" else f"{name} after {calibration}"


@dataclass(frozen=True)
class Reference:
    """What trials of a sensor are evaluated against.

    Attributes
    ----------
    field
        The objects.
    compensators
        What calibrations take away.
    reference_px : (n, 2)
        Where a sensor without errors shows them, focused as trials are: what motions are counted from.
    refocus
        Whether each trial is focused.
    floor_px2
        What a pixel and the Airy disk add to the square of a blur.
    """

    field: Field
    compensators: Compensators
    reference_px: Array
    refocus: Refocus
    floor_px2: float


def evaluate_numpy(reference: Reference, values: Values) -> tuple[Array, Array]:
    """Merits (t, m) of trials, and motions (t, 2 n) px; NaN where rays are lost."""
    with np.errstate(all="ignore"):
        shown, are_lost, focus_mm = reference.field.shown(values, refocus=reference.refocus)
        lost = are_lost.sum(axis=1)
        merits = np.full((len(lost), MERITS), np.nan)
        merits[:, -1] = lost
        moved = motion(shown.offsets_px, reference.reference_px)
        deg_per_px = np.asarray(np.linalg.inv(reference.field.px_per_deg), dtype=float)
        for k, left in enumerate(reference.compensators.left(np.nan_to_num(moved))):
            merits[:, 4 * k : 4 * k + 4] = _of_motion(left, deg_per_px)
        at = 4 * len(CALIBRATIONS)
        merits[:, at : at + 3] = _of_blur(reference, shown, focus_mm)
        merits[lost > 0, :-1], moved[lost > 0] = np.nan, np.nan
    return merits, moved


def _of_blur(reference: Reference, shown: Picture, focus_mm: Array) -> Array:
    blur, floor = shown.blur_px, reference.floor_px2
    squares = (blur**2).sum(axis=(-2, -1))
    area_px2 = np.sqrt(np.linalg.det(blur) ** 2 + floor * squares + floor**2)
    area = area_px2 / np.abs(np.linalg.det(reference.field.px_per_deg))
    return np.stack([largest_diameter(blur).max(axis=1), area.max(axis=1), focus_mm], axis=-1)


def _of_motion(left: Array, deg_per_px: Array) -> Array:
    """rms and worst (t, 4) of residuals (t, 2 n), in px and in deg."""
    vectors = np.stack(np.split(left, 2, axis=-1), axis=-1)
    turned = np.einsum("nij,tnj->tni", deg_per_px, vectors)
    squares = [(v**2).sum(axis=-1) for v in (vectors, turned)]
    return np.stack([f(s) for s in squares for f in (_rms, _worst)], axis=-1)


def _rms(squares: Array) -> Array:
    return np.asarray(np.sqrt(squares.mean(axis=-1)))


def _worst(squares: Array) -> Array:
    return np.asarray(np.sqrt(squares.max(axis=-1)))
