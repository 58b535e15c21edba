"""First-order propagation of parameter covariance to viewing directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.typing import Array
from .base import CameraModel

FIELD_ROUNDING_DEG = 1e-6  # tolerance of the outermost measured direction, which defines the field


def direction_spread(model: CameraModel, covariance: Array, directions: Array) -> Array:
    """Compute the covariance (n, 2, 2), rad^2, of directions (n, 3).

    The axes are two perpendicular to each direction. With a fixed pixel, parameters of covariance
    (p, p) give ``0 = (du/dd) dd + (du/dp) dp``, therefore ``dd = -(du/dd)^-1 (du/dp) dp`` in the
    plane across d. NaN outside the field of view.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return spread_at(model, covariance, unit, _across(unit), distant=True)


def spread_at(model: CameraModel, covariance: Array, targets: Array, axes: Array, *, distant: bool) -> Array:
    """Compute the covariance (n, 2, 2) of targets (n, 3) with fixed pixels, along axes (n, 3, 2).

    Targets are in the camera frame.
    """
    spread = np.full((len(targets), 2, 2), np.nan)
    asked = np.flatnonzero(np.isfinite(targets).all(axis=1))
    image = model.image(targets[asked], distant=distant)
    moves = image.d_points @ axes[asked]
    kept = image.valid & np.isfinite(moves).all(axis=(1, 2)) & np.isfinite(image.d_parameters).all(axis=(1, 2))
    kept[kept] = np.abs(np.linalg.det(moves[kept])) > 0
    change = -np.linalg.solve(moves[kept], image.d_parameters[kept])
    spread[asked[kept]] = change @ covariance @ change.transpose(0, 2, 1)
    return spread


def field_angles(model: CameraModel, directions: Array) -> Array:
    """Return angles (n,), deg, of directions (n, 3) from the image centre."""
    forward = -1.0 if model.looks_back else 1.0
    return np.degrees(np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), forward * directions[:, 2]))


def within_field(model: CameraModel, directions: Array, field_deg: float | None) -> NDArray[np.bool_]:
    """Return which directions (n, 3) are in a calibrated field; all if it is None."""
    if field_deg is None:
        return np.ones(len(directions), dtype=bool)
    return field_angles(model, directions) <= field_deg + FIELD_ROUNDING_DEG


def direction_sigma_deg(
    model: CameraModel, covariance: Array, directions: ArrayLike, field_deg: float | None = None
) -> Array:
    """Return the standard deviation (n,), deg, of directions, along the larger axis.

    Parameters
    ----------
    model
        Calibrated model.
    covariance : (p, p)
        Covariance of its parameters.
    directions : (n, 3)
        Directions in the camera frame, of any length.
    field_deg : deg, optional
        Calibrated field; directions outside have an unknown uncertainty.

    Returns
    -------
    (n,) array
        NaN outside the field of view or the calibrated field.
    """
    given = np.asarray(directions, dtype=float)
    sigma = np.degrees(larger_sigma(direction_spread(model, covariance, given)))
    return np.where(within_field(model, given, field_deg), sigma, np.nan)


def larger_sigma(spread: Array) -> Array:
    """Return the larger standard deviation (n,), along the major axis, of covariances (n, 2, 2).

    >>> larger_sigma(np.array([[[4.0, 0.0], [0.0, 9.0]]]))
    array([3.])
    """
    a, b, c = spread[:, 0, 0], (spread[:, 0, 1] + spread[:, 1, 0]) / 2, spread[:, 1, 1]
    larger: Array = np.sqrt(np.maximum((a + c) / 2 + np.hypot((a - c) / 2, b), 0.0))
    return larger


def _across(directions: Array) -> Array:
    """Return two unit vectors (n, 3, 2) orthogonal to unit vectors (n, 3)."""
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=2)
