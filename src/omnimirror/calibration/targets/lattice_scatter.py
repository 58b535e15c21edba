"""Scatter of a board's corners around a smooth mapping: scale of their standard deviations.

The pixel residuals of a corner fit are a poor measure of the corner error. Compression,
saturation, sharpening and filtered noise are correlated between pixels and contribute little to
them, whereas the shape of motion blur or defocus contributes but does not shift the corner. Any
camera maps a board smoothly: the error of a corner is its deviation from its neighbours.
Therefore corners are fitted by polynomials of their board positions, and the standard deviations
are scaled to a reduced chi-square of 1.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.polynomial.chebyshev import chebvander

from ...base.typing import Array

DEGREES = range(3, 9)
"""Degrees of the polynomials.

A quadratic does not describe a board in a mirror; one of these does for 35 corners or more.
"""
MOST_COEFFICIENTS = 0.75  # maximum ratio of coefficients to corners; more leave no residuals
DOUBT = 2.0  # prior weight of the expected scale 1, in degrees of freedom
OUTLYING = 5.0  # standard deviations (of a coordinate) above which a corner is excluded
PASSES = 3


def lattice_scale(places: Array, pixels: Array, sigma_px: Array) -> float:
    """Return the scale factor for standard deviations of corners.

    Parameters
    ----------
    places : (n, 2)
        Corner positions on the board, in any unit.
    pixels : (n, 2)
        Corner positions in the image.
    sigma_px : (n,)
        Standard deviations of a coordinate, up to a common factor.

    Returns
    -------
    float
        Scale factor; 1 if there are too few corners.

    Examples
    --------
    >>> places = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    >>> noise = np.random.default_rng(0).normal(0, 0.05, places.shape)
    >>> scale = lattice_scale(places, 30 * places + 0.2 * places**2 + noise, np.full(len(places), 0.01))
    >>> 4 < scale < 6
    True
    """
    kept = np.ones(len(places), dtype=bool)
    scale = 1.0
    for _ in range(PASSES):
        found = _best_fit(places[kept], pixels[kept], sigma_px[kept])
        if found is None:
            break
        scale, residuals = found
        inside = np.hypot(*residuals.T) <= OUTLYING * scale * sigma_px[kept]
        if inside.all():
            break
        kept[kept] = inside
    return scale


def _best_fit(places: Array, pixels: Array, sigma_px: Array) -> tuple[float, Array] | None:
    """Return scale and residuals (n, 2) of the best degree; None for too few corners."""
    best: tuple[float, Array] | None = None
    base = _in_perspective(places, pixels)
    weights = 1 / sigma_px[:, None]
    for degree in DEGREES:
        basis = _polynomials(base, degree)
        count, unknowns = basis.shape
        if unknowns > MOST_COEFFICIENTS * count:
            break
        coefficients = np.linalg.lstsq(basis * weights, pixels * weights, rcond=None)[0]
        residuals = pixels - basis @ coefficients
        freedom = 2 * (count - unknowns)
        chi_square = max(float(np.sum((residuals * weights) ** 2)) / freedom, np.finfo(float).tiny)
        scale = float(chi_square ** (freedom / (freedom + DOUBT) / 2))
        if best is None or scale < best[0]:
            best = scale, residuals
    return best


def _in_perspective(places: Array, pixels: Array) -> Array:
    """Return places (n, 2) after a homography to the image; unchanged if it is degenerate."""
    matrix: Any = cv2.findHomography(places, pixels)[0]
    if matrix is None:  # for collinear corners, despite OpenCV's stubs
        return places
    mapped = np.column_stack([places, np.ones(len(places))]) @ matrix.T
    depths = mapped[:, 2:]
    return np.asarray(mapped[:, :2] / depths) if depths.min() > 0 or depths.max() < 0 else places


def _polynomials(points: Array, degree: int) -> Array:
    """Return products of Chebyshev polynomials (n, k) of two coordinates, up to a total degree."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = (2 * (points - low) / np.where(high > low, high - low, 1.0) - 1).T
    across, down = chebvander(x, degree), chebvander(y, degree)
    return np.stack([across[:, i] * down[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
