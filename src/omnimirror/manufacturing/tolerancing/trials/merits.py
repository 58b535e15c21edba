"""What a trial is judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .compensation import CALIBRATIONS, Calibration, Compensators, motion
from .field import Field
from .picture import Picture, Refocus, largest_diameter
from .states import Values

Array = NDArray[np.float64]

OF_MOTION = ("motion_rms_px", "motion_px", "direction_error_rms_deg", "direction_error_deg")
OF_BLUR = ("blur_px", "floored_area_deg2", "focus_distance_mm")
LOST = "lost_rays"
MERITS = 4 * len(CALIBRATIONS) + len(OF_BLUR) + 1


def merit_names() -> tuple[str, ...]:
    """Names of what a trial is judged by; those of motions are followed by the calibration after which they are left.

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
    """What trials of a sensor are judged against, worked out once.

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


def judged(reference: Reference, values: Values) -> tuple[Array, Array]:
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
