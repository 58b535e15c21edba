"""Lens distortion in the OpenCV model (Brown, 1966): radial k1, k2, k3 and tangential p1, p2.

Coordinates are tangents of the viewing angle: x to the right, y down in the image, r^2 = x^2 + y^2;

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...base.typing import Array

Coefficients = tuple[float, float, float, float, float]
"""k1, k2, k3, p1, p2."""
TERMS = ("k1", "k2", "k3", "p1", "p2")

MAX_STEPS = 100
TINY = 1e-9  # inverse square of a tangent beyond any field
CLOSE = 1e-14  # relative; convergence of Newton's method is quadratic


def distorted(ideal: Array, brown: Coefficients) -> Array:
    """Apply distortion to ideal image points (..., 2); NaN beyond the fold of the image.

    >>> distorted(np.array([[0.3, 0.4]]), (-0.1, 0.0, 0.0, 0.0, 0.0))
    array([[0.2925, 0.39  ]])
    """
    with np.errstate(invalid="ignore"):
        unfolded = (ideal**2).sum(axis=-1) <= fold(brown[:3]) ** 2
    moved = _brown(ideal[..., 0], ideal[..., 1], brown)[0]
    return np.where(unfolded[..., None], moved, np.nan)


def distorted_rates(ideal: Array, brown: Coefficients) -> tuple[Array, Array, Array]:
    """Distort points (n, 2), with derivatives (n, 2, 2) with respect to these and (n, 2, 5) by the
    coefficients.

    >>> distorted_rates(np.array([[0.3, 0.4]]), (-0.1, 0.0, 0.0, 0.0, 0.0))[2][0, :, 0]  # x r^2, y r^2
    array([0.075, 0.1  ])
    """
    x, y = ideal[:, 0], ideal[:, 1]
    (xx, xy, yy), s = _brown(x, y, brown)[1], x * x + y * y
    by_ideal = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=1)
    right = np.stack([x * s, x * s**2, x * s**3, 2 * x * y, s + 2 * x * x], axis=-1)
    down = np.stack([y * s, y * s**2, y * s**3, s + 2 * y * y, 2 * x * y], axis=-1)
    return distorted(ideal, brown), by_ideal, np.stack([right, down], axis=1)


def undistorted(image: Array, brown: Coefficients) -> Array:
    """Remove distortion from image points (..., 2); NaN if no ideal point exists.

    >>> undistorted(np.array([[0.2925, 0.39]]), (-0.1, 0.0, 0.0, 0.0, 0.0))
    array([[0.3, 0.4]])
    """
    radius = np.hypot(image[..., 0], image[..., 1])
    inner = undistorted_radius(radius, brown[:3])
    ideal: Array = image * (inner / np.maximum(radius, np.finfo(float).tiny))[..., None]
    if not (brown[3] or brown[4]):
        return ideal
    for _ in range(MAX_STEPS):
        moved, (xx, xy, yy) = _brown(ideal[..., 0], ideal[..., 1], brown)
        ex, ey = np.moveaxis(moved - image, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Newton's method with the inverse of the symmetric 2 x 2 Jacobian
            step = (
                np.stack([yy * ex - xy * ey, xx * ey - xy * ex], axis=-1)
                / (xx * yy - xy * xy)[..., None]
            )
        ideal = ideal - step
        if not (np.abs(step) > CLOSE).any():
            break
    with np.errstate(invalid="ignore"):
        solution = np.abs(distorted(ideal, brown) - image).max(axis=-1) < 1e-9
    return np.where(solution[..., None], ideal, np.nan)


def distorted_radius(r: Array, k: tuple[float, ...]) -> tuple[Array, Array]:
    """Compute r (1 + k1 r^2 + k2 r^4 + k3 r^6) for radii (n,), and its derivative."""
    s = r**2
    return (
        r * (1 + s * (k[0] + s * (k[1] + s * k[2]))),
        1 + s * (3 * k[0] + s * (5 * k[1] + s * 7 * k[2])),
    )


def undistorted_radius(radius: Array, k: tuple[float, ...]) -> Array:
    """Invert :func:`distorted_radius` between axis and fold; NaN beyond."""
    if not any(k):
        return radius
    low, high = np.zeros_like(radius), np.minimum(radius, fold(k))
    for _ in range(MAX_STEPS):
        short = (distorted_radius(high, k)[0] < radius) & (high < fold(k))
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, fold(k)), high)
    r = high
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(MAX_STEPS):
            value, rate = distorted_radius(r, k)
            low, high = np.where(value <= radius, r, low), np.where(value >= radius, r, high)
            newton = r - (value - radius) / rate
            last, r = r, np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
            if not (np.abs(r - last) > CLOSE * np.abs(r)).any():
                break
        solution = np.abs(distorted_radius(r, k)[0] - radius) <= 1e-9 * radius
    return np.where(solution, r, np.nan)


@lru_cache(maxsize=64)
def fold(k: tuple[float, ...]) -> float:
    """Return the radius of maximum distorted radius, the fold; infinite if none.

    >>> round(fold((-0.1, 0.0, 0.0)), 6)  # 1/sqrt(3 * 0.1)
    1.825742
    """
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6) = 0, as a polynomial in 1/r^2; the largest root is the
    # first extremum
    inverse_squares = np.roots([1.0, 3 * k[0], 5 * k[1], 7 * k[2]])  # without divisions
    real = inverse_squares[np.abs(inverse_squares.imag) <= 1e-9 * np.abs(inverse_squares)].real
    return float(1 / np.sqrt(real.max())) if (real > TINY).any() else np.inf


def shrinkage(ideal: Array, brown: Coefficients) -> Array:
    """Compute the ideal area (n,) per unit distorted area at ideal points (n, 2)."""
    xx, xy, yy = _brown(ideal[..., 0], ideal[..., 1], brown)[1]
    area: Array = 1 / (xx * yy - xy * xy)
    return area


def _brown(x: Array, y: Array, brown: Coefficients) -> tuple[Array, tuple[Array, Array, Array]]:
    """Evaluate the model, and its derivatives dx'/dx, dx'/dy = dy'/dx and dy'/dy."""
    k1, k2, k3, p1, p2 = brown
    s = x * x + y * y
    bend, rate = 1 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2 * k2 + s * 3 * k3)
    moved = np.stack(
        [
            x * bend + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * bend + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = bend + 2 * x * x * rate + 2 * p1 * y + 6 * p2 * x
    yy = bend + 2 * y * y * rate + 6 * p1 * y + 2 * p2 * x
    return moved, (xx, 2 * x * y * rate + 2 * p1 * x + 2 * p2 * y, yy)
