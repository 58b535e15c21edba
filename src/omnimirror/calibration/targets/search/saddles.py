"""Saddle model of a corner, fitted to the pixels of the distorted image.

The model is a linear background plus a contrast times erf(p / (sqrt 2 s)) erf(q / (sqrt 2 s)).
Here p and q are the distances to the two edges, and s is the blur, including the pixel width.
The edges are curved by the quadratic map between board and image. Parameters are corner position,
blur, background, contrast and two small rotations of the edges. All corners of an image are
fitted simultaneously by Gauss-Newton iteration.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.typing import Array
from ..boards import CornerWindow
from .local_maps import LocalMaps, inverted

LARGEST_WINDOW_PX = 14.0
SMALLEST_WINDOW_PX = 2.5
NOISE = 0.02
"""Noise relative to the contrast, which weights the priors."""
ANGLE_PRIOR = 0.03  # rad
BLUR_PRIOR = (0.9, 0.6)  # px, and standard deviation of its logarithm
PIXEL_VARIANCE = 1 / 12
"""Variance of the pixel aperture, px^2; it limits the localisation of sharper edges."""
STEPS = 12
SIZES = (3, 4, 5, 7, 9, 11, 14)  # window sizes, px from the centre; one fit per size
MARGIN_PX = 1.5  # range of blur from structures next to the edges
CLOSE_PX = 2e-3
CLOSE_BLUR = 0.02  # relative to the median blur; convergence is slow in dark images
AT_ONCE = 400_000  # pixels


class Saddles(NamedTuple):
    """Corners fitted to an image."""

    pixels: Array
    """Pixels (m, 2)."""
    sigma_px: Array
    """Standard deviation (m,) of a coordinate, from the residuals of the fit."""
    blur_px: Array
    """Standard deviation (m,) of the edge blur."""
    contrast: Array
    """Contrast (m,): 0.5 times white minus black; negative if the first quadrant is black."""
    misfit: Array
    """RMS residual (m,) relative to the contrast."""


def fit_saddles(
    picture: NDArray[np.float32], maps: LocalMaps, surroundings: CornerWindow, *, is_quick: bool = False
) -> Saddles:
    """Fit the corners at the centres of the maps.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image.
    maps
        Maps from the board, in sides of a square, to the image around each corner;
        :attr:`~LocalMaps.pixels` are the initial values.
    surroundings
        Region around a corner without other structures.
    is_quick
        Whether an accuracy of 0.1 px suffices.
    """
    count = len(maps.pixels)
    found = Saddles(maps.pixels.copy(), *(np.full(count, np.nan) for _ in range(4)))
    for group, reach in _alike(maps, surroundings.half):
        part = _fit(picture, LocalMaps(*(field[group] for field in maps)), surroundings, reach, is_quick)
        for whole, piece in zip(found, part, strict=True):
            whole[group] = piece
    return found


def _alike(maps: LocalMaps, half: float) -> Iterator[tuple[NDArray[np.int_], int]]:
    """Yield corners with windows of similar size, and the window reach from the centre in px."""
    reach = half * np.abs(maps.first).sum(axis=2).max(axis=1) + 0.5
    reach = np.array(SIZES)[np.searchsorted(SIZES[:-1], reach)]
    for size in np.unique(reach):
        alike = np.flatnonzero(reach == size)
        each = max(1, AT_ONCE // (2 * int(size) + 1) ** 2)
        for start in range(0, len(alike), each):
            yield alike[start : start + each], int(size)


def _fit(
    picture: NDArray[np.float32], maps: LocalMaps, surroundings: CornerWindow, reach: int, is_quick: bool
) -> Saddles:
    height, width = picture.shape
    steps = np.arange(-reach, reach + 1)
    right, down = (axis.ravel() for axis in np.meshgrid(steps, steps))
    middle = np.rint(maps.pixels).astype(int)
    u, v = middle[:, :1] + right, middle[:, 1:] + down
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    values = picture[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    pixels = maps.pixels.copy()
    for _ in range(1 if is_quick else 2):  # second pass centred on the fitted corner
        places, back = inverted(maps._replace(pixels=pixels), u.astype(float), v.astype(float))
        offsets = np.stack([u - pixels[:, :1], v - pixels[:, 1:]])
        used = inside & _in_window(places, offsets, surroundings, maps.spacing()[:, None])
        fit = _Fit(*_packed(used, places, back, offsets, values))
        terms, sigma, rms = fit.run(STEPS // 2 if is_quick else STEPS)
        pixels = pixels + terms[:, 4:6]
    contrast = terms[:, 3]
    size = np.abs(contrast)
    blur = np.sqrt(np.exp(2 * terms[:, 6]) + PIXEL_VARIANCE)
    return Saddles(pixels, sigma, blur, contrast, rms / np.where(size > 0, size, 1.0))


def _in_window(places: Array, offsets: Array, surroundings: CornerWindow, spacing: Array) -> NDArray[np.bool_]:
    """Return the mask of pixels within the square of the board and a distance limit.

    For tiny squares, a minimum number of pixels is included.
    """
    far = offsets[0] ** 2 + offsets[1] ** 2
    x, y = np.abs(places)
    near = (np.maximum(x, y) < surroundings.half) & (far < LARGEST_WINDOW_PX**2)
    if np.isfinite(surroundings.arm):
        near &= np.minimum(x, y) < np.maximum(surroundings.arm - MARGIN_PX / spacing, surroundings.arm / 3)
    return np.asarray(near | (far < SMALLEST_WINDOW_PX**2))


def _packed(used: NDArray[np.bool_], *fields: Array) -> Iterator[Array]:
    """Yield fields (..., m, n) with the used pixels of each corner first, then their weights."""
    order = np.argsort(~used, axis=1, kind="stable")[:, : used.sum(axis=1).max()]
    for field in (*fields, used.astype(float)):
        yield np.take_along_axis(field, order[(None,) * (field.ndim - 2)], axis=-1)


class _Fit:
    """Least squares for many corners.

    Terms are background (3), contrast, shift (2), logarithm of blur, angles (2).
    """

    def __init__(self, places: Array, back: Array, offsets: Array, values: Array, weights: Array) -> None:
        lengths = np.hypot(back[:, 0], back[:, 1])
        self.distances = places / lengths  # (2, m, n): from both edges, px
        self.normals = back / lengths[:, None]  # (2, 2, m, n)
        self.offsets, self.values, self.weights = offsets, values, weights
        self.count = weights.sum(axis=1)

    def run(self, steps: int) -> tuple[Array, Array, Array]:
        """Return terms (m, 9), standard deviations (m,) in px, and rms residuals (m,)."""
        terms = self._start()
        scale = np.abs(terms[:, 3]) + 1e-6
        prior = np.zeros((len(terms), 9))
        prior[:, 6] = (1 / BLUR_PRIOR[1]) ** 2
        prior[:, 7:] = (1 / ANGLE_PRIOR) ** 2
        prior *= (NOISE * scale[:, None]) ** 2
        prior[:, 4:6] = (NOISE * scale[:, None] / 2.0) ** 2
        wanted = np.array([0, 0, 0, 0, 0, 0, np.log(BLUR_PRIOR[0]), 0, 0])
        limits = np.array([np.inf, np.inf, np.inf, np.inf, 0.6, 0.6, 0.4, 0.1, 0.1])
        for _ in range(steps):
            model, derivatives = self._model(terms)
            residual = (self.values - model) * self.weights
            derivatives *= self.weights[:, None]
            square = derivatives @ derivatives.transpose(0, 2, 1)
            right = (derivatives @ residual[..., None])[..., 0] + prior * (wanted - terms)
            diagonal = np.einsum("mii->mi", square) + prior
            whole = square + np.eye(9) * (prior + 1e-4 * diagonal + 1e-12)[:, None, :]
            step = np.linalg.solve(whole, right[..., None])[..., 0]
            terms = terms + np.clip(step, -limits, limits)
            if np.abs(step[:, 4:6]).max(initial=0) < CLOSE_PX and np.median(np.abs(step[:, 6])) < CLOSE_BLUR:
                break
        variance = np.sum(residual**2, axis=1) / np.maximum(self.count - 9, 1)
        noise = np.linalg.inv(whole)[:, 4:6, 4:6]
        sigma = np.sqrt(np.einsum("mii->m", noise) / 2 * variance)
        return terms, sigma, np.sqrt(variance)

    def _start(self) -> Array:
        """Return initial background and contrast, for a standard corner at the centre."""
        terms = np.zeros((len(self.values), 9))
        terms[:, 6] = np.log(BLUR_PRIOR[0])
        terms[:, 3] = 1.0
        basis = self._model(terms)[1][:, :4] * self.weights[:, None]
        square = basis @ basis.transpose(0, 2, 1) + 1e-6 * np.eye(4)
        right = (basis @ self.values[..., None])[..., 0]
        terms[:, :4] = np.linalg.solve(square, right[..., None])[..., 0]
        return terms

    def _model(self, terms: Array) -> tuple[Array, Array]:
        """Return values (m, n) and derivatives (m, 9, n)."""
        from scipy.special import erf

        constant, right, down, contrast, u, v, blur, *angles = terms.T[..., None]
        variance = np.exp(2 * blur)
        spread = variance + PIXEL_VARIANCE
        root = np.sqrt(2.0 * spread)
        straight = self.distances - self.normals[:, 0] * u - self.normals[:, 1] * v
        turned = straight + np.stack(angles) * straight[::-1]
        z = turned / root
        soft = erf(z)
        both = soft[0] * soft[1]
        # derivatives of the product with respect to each distance
        slopes = contrast * (2 / np.sqrt(np.pi)) / root * np.exp(-(z**2)) * soft[::-1]
        derivatives = np.empty((len(terms), 9, both.shape[1]))
        derivatives[:, 0] = 1.0
        derivatives[:, 1], derivatives[:, 2] = self.offsets
        derivatives[:, 3] = both
        derivatives[:, 4] = -(slopes * self.normals[:, 0]).sum(axis=0)
        derivatives[:, 5] = -(slopes * self.normals[:, 1]).sum(axis=0)
        derivatives[:, 6] = -(slopes * turned).sum(axis=0) * variance / spread
        derivatives[:, 7], derivatives[:, 8] = slopes * straight[::-1]
        background = constant + right * self.offsets[0] + down * self.offsets[1]
        return background + contrast * both, derivatives
