"""Scatter of a board's corners about a smooth mapping: the scale of their standard deviations.

What the fit of a corner leaves in its pixels is a poor measure of how far off the corner is. Compression, saturation,
sharpening and noise that was filtered are correlated between pixels and hardly show in it; the shape of motion blur or
defocus shows, and does not move the corner. But any camera maps a board smoothly, so that a corner's error is what it
does not share with its neighbours: corners are fitted by polynomials of their places, and the standard deviations are
scaled until the reduced chi-square of the residuals is 1.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEGREES = range(3, 9)
"""Of the polynomials: a quadratic does not follow a board in a mirror, and from 35 corners on one of these does."""
MOST_COEFFICIENTS = 0.75  # of the corners; more leave nothing to measure the scatter by
DOUBT = 2.0  # degrees of freedom as many as which the scale that is expected, 1, counts
OUTLYING = 5.0  # standard deviations (of a coordinate) from which on a corner is left out
PASSES = 3


def lattice_scale(places: Array, pixels: Array, sigma_px: Array) -> float:
    """Return the factor by which standard deviations of corners are to be multiplied.

    Parameters
    ----------
    places : (n, 2)
        Corners on the board, in any unit.
    pixels : (n, 2)
        Where they are in the image.
    sigma_px : (n,)
        Standard deviations of a coordinate, right but for a factor.

    Returns
    -------
    float
        1 where there are too few corners to measure it.

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
    """Return scale and residuals (n, 2) of the degree that leaves the least scatter; None of too few corners."""
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
    """Return places (n, 2) as a pinhole camera maps them, or themselves where it cannot: the start of the fit."""
    matrix: Any = cv2.findHomography(places, pixels)[0]
    if matrix is None:  # of corners on a line, whatever OpenCV's stubs promise
        return places
    mapped = np.column_stack([places, np.ones(len(places))]) @ matrix.T
    depths = mapped[:, 2:]
    return np.asarray(mapped[:, :2] / depths) if depths.min() > 0 or depths.max() < 0 else places


def _polynomials(points: Array, degree: int) -> Array:
    """Return products of Chebyshev polynomials (n, k) of two coordinates, to a total degree."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = (2 * (points - low) / np.where(high > low, high - low, 1.0) - 1).T
    across, down = chebvander(x, degree), chebvander(y, degree)
    return np.stack([across[:, i] * down[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
