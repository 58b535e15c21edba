"""How the covariance of a model's parameters spreads what its pixels see, to first order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .base import CameraModel

Array = NDArray[np.float64]

FIELD_ROUNDING_DEG = 1e-6  # by which the outermost measured direction may exceed the field that it defines


def direction_spread(model: CameraModel, covariance: Array, directions: Array) -> Array:
    """Covariance (n, 2, 2) in rad^2 of directions (n, 3) of the camera frame, of any length, along two axes across.

    A pixel stays while the parameters, whose covariance is (p, p), move: ``0 = (du/dd) dd + (du/dp) dp``, so that
    ``dd = -(du/dd)^-1 (du/dp) dp`` in the plane across d. NaN where nothing is seen.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return spread_at(model, covariance, unit, _across(unit), distant=True)


def spread_at(model: CameraModel, covariance: Array, targets: Array, axes: Array, *, distant: bool) -> Array:
    """Covariance (n, 2, 2) of targets (n, 3) of the camera frame that stay at their pixels, along axes (n, 3, 2)."""
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
    """Return angles (n,) in deg of directions (n, 3) of the camera frame from what the centre of the image sees."""
    forward = -1.0 if model.looks_back else 1.0
    return np.degrees(np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), forward * directions[:, 2]))


def within_field(model: CameraModel, directions: Array, field_deg: float | None) -> NDArray[np.bool_]:
    """Return which directions (n, 3) of the camera frame lie in a calibrated field; all where None is known."""
    if field_deg is None:
        return np.ones(len(directions), dtype=bool)
    return field_angles(model, directions) <= field_deg + FIELD_ROUNDING_DEG


def direction_sigma_deg(
    model: CameraModel, covariance: Array, directions: ArrayLike, field_deg: float | None = None
) -> Array:
    """Return the standard deviation (n,) in deg of directions, along the larger axis: used by all tables of errors.

    Parameters
    ----------
    model
        The camera.
    covariance : (p, p)
        Of its parameters.
    directions : (n, 3)
        In the camera frame, of any length.
    field_deg : deg, optional
        Calibrated field, beyond which nothing is known.

    Returns
    -------
    (n,) array
        NaN where the model sees nothing, and outside of the calibrated field.
    """
    given = np.asarray(directions, dtype=float)
    sigma = np.degrees(larger_sigma(direction_spread(model, covariance, given)))
    return np.where(within_field(model, given, field_deg), sigma, np.nan)


def larger_sigma(spread: Array) -> Array:
    """Larger standard deviations (n,) of covariances (n, 2, 2): of the two axes of an ellipse the longer.

    >>> larger_sigma(np.array([[[4.0, 0.0], [0.0, 9.0]]]))
    array([3.])
    """
    a, b, c = spread[:, 0, 0], (spread[:, 0, 1] + spread[:, 1, 0]) / 2, spread[:, 1, 1]
    larger: Array = np.sqrt(np.maximum((a + c) / 2 + np.hypot((a - c) / 2, b), 0.0))
    return larger


def _across(directions: Array) -> Array:
    """Two unit vectors (n, 3, 2) across unit vectors (n, 3)."""
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=2)
