"""Corner refinement: local maps, saddle model, and scale of the standard deviations.

The saddle model is fitted to the pixels of the distorted image and is accurate to a few 0.01 px.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from ...base.arguments import integer, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ._image_preparation import grey
from .boards import Board, CornerWindow, Detection

# -- Local maps ------------------------------------------------------------------------------------
#
# No camera model is required. Over two or three squares, the image of a plane in any mirror is
# quadratic within a few 0.01 px, which suffices to predict the next corner and the curvature of its
# edges.

REACH = 1.3
"""Standard deviation of the Gaussian weights of neighbouring corners, in board units."""
STIFFNESS = np.array([0.0, 1e-6, 1e-6, 4e-3, 4e-3, 4e-3])
"""Regularisation of the second derivatives for few corners."""


class LocalMaps(NamedTuple):
    """Second-order Taylor series from the board to the image around m points, in board units."""

    pixels: Array
    """Expansion points (m, 2), px."""
    first: Array
    """Derivatives (m, 2, 2) of the pixel (first axis) along the board's x and y, px per unit."""
    second: Array
    """Second derivatives (m, 2, 2, 2) of the pixel (first axis)."""
    support: Array
    """Sum (m,) of the weights of the fitted corners."""

    def at(self, offsets: Array) -> Array:
        """Return pixels (m, n, 2) of board points relative to each expansion point.

        Points have the shape (n, 2) or (m, n, 2).
        """
        bend = np.einsum(
            "maij,...ni,...nj->mna" if offsets.ndim == 2 else "maij,mni,mnj->mna",
            self.second,
            offsets,
            offsets,
            optimize=True,
        )
        straight = np.einsum(
            "mai,...ni->mna" if offsets.ndim == 2 else "mai,mni->mna", self.first, offsets
        )
        return np.asarray(self.pixels[:, None] + straight + bend / 2)

    def spacing(self) -> Array:
        """Return the smaller side (m,) of the board unit in the image, px."""
        return np.asarray(np.linalg.norm(self.first, axis=1).min(axis=1))


def maps_about(
    positions: Array,
    pixels: Array,
    centres: Array,
    *,
    leave_out: bool = False,
    reach: float = REACH,
) -> LocalMaps:
    """Fit local maps around points of the board by weighted least squares.

    Parameters
    ----------
    positions : (k, 2)
        Known corners on the board, in units of about their spacing.
    pixels : (k, 2)
        Known corners in the image.
    centres : (m, 2)
        Expansion points on the board.
    leave_out
        Whether a corner at an expansion point is excluded from its own map, for checks.
    reach
        Standard deviation of the weights, in the same units.
    """
    offsets = positions[None] - centres[:, None]
    squares = np.sum(offsets**2, axis=2)
    weights = np.exp(-squares / (2 * reach**2))
    weights[squares > (3.2 * reach) ** 2] = 0.0
    if leave_out:
        weights[squares < 1e-9] = 0.0
    x, y = offsets[..., 0], offsets[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2], axis=2)
    weighted = basis * weights[..., None]
    normal = np.einsum("mki,mkj->mij", weighted, basis, optimize=True)
    support = weights.sum(axis=1)
    normal += (support[:, None, None] + 1e-12) * np.diag(STIFFNESS + 1e-9)
    mean_pixel = pixels.mean(axis=0)
    terms = np.linalg.solve(
        normal, np.einsum("mki,ka->mia", weighted, pixels - mean_pixel, optimize=True)
    )
    second = terms[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 2).transpose(0, 3, 1, 2)
    return LocalMaps(terms[:, 0] + mean_pixel, terms[:, 1:3].transpose(0, 2, 1), second, support)


def inverted(maps: LocalMaps, u: Array, v: Array) -> tuple[Array, Array]:
    """Return board places (2, m, n) of pixels (m, n), and their derivatives (2, 2, m, n).

    The first axis of the derivatives is that of the places. Newton's method from the linear part of
    the map converges to rounding over a square in three steps. Components are separate arrays
    because sums over axes of length 2 are slow.
    """
    (a, b), (c, d) = maps.first.transpose(1, 2, 0)[..., None]
    (aa, ab), (_, bb) = maps.second[:, 0].transpose(1, 2, 0)[..., None]
    (cc, cd), (_, dd) = maps.second[:, 1].transpose(1, 2, 0)[..., None]
    u, v = u - maps.pixels[:, :1], v - maps.pixels[:, 1:]
    determinant = a * d - b * c
    x, y = (d * u - b * v) / determinant, (a * v - c * u) / determinant
    for step in range(4):
        ux, uy = aa * x + ab * y, ab * x + bb * y
        vx, vy = cc * x + cd * y, cd * x + dd * y
        a1, b1, c1, d1 = a + ux, b + uy, c + vx, d + vy
        determinant = a1 * d1 - b1 * c1
        determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
        if step == 3:
            break
        du = u - (a * x + b * y) - (ux * x + uy * y) / 2
        dv = v - (c * x + d * y) - (vx * x + vy * y) / 2
        x = x + np.clip((d1 * du - b1 * dv) / determinant, -1, 1)
        y = y + np.clip((a1 * dv - c1 * du) / determinant, -1, 1)
    return np.stack([x, y]), np.array([[d1, -b1], [-c1, a1]]) / determinant


# -- Saddle model ----------------------------------------------------------------------------------
#
# The model is a linear background plus a contrast times erf(p / (sqrt 2 s)) erf(q / (sqrt 2 s)).
# Here p and q are the distances to the two edges, and s is the blur, including the pixel width.
# The edges are curved by the quadratic map between board and image. Parameters are corner position,
# blur, background, contrast and two small rotations of the edges. All corners of an image are
# fitted simultaneously by Gauss-Newton iteration.

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
    image: NDArray[np.float32], maps: LocalMaps, window: CornerWindow, *, is_quick: bool = False
) -> Saddles:
    """Fit the corners at the centres of the maps.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    maps
        Maps from the board, in sides of a square, to the image around each corner;
        :attr:`~LocalMaps.pixels` are the initial values.
    window
        Region around a corner without other structures.
    is_quick
        Whether an accuracy of 0.1 px suffices.
    """
    count = len(maps.pixels)
    saddles = Saddles(maps.pixels.copy(), *(np.full(count, np.nan) for _ in range(4)))
    for group, reach in _equal_windows(maps, window.half):
        part = _fit(image, LocalMaps(*(field[group] for field in maps)), window, reach, is_quick)
        for values, piece in zip(saddles, part, strict=True):
            values[group] = piece
    return saddles


def _equal_windows(maps: LocalMaps, half: float) -> Iterator[tuple[NDArray[np.int_], int]]:
    """Yield corners with windows of similar size, and the window reach from the centre in px."""
    reach = half * np.abs(maps.first).sum(axis=2).max(axis=1) + 0.5
    reach = np.array(SIZES)[np.searchsorted(SIZES[:-1], reach)]
    for size in np.unique(reach):
        members = np.flatnonzero(reach == size)
        batch = max(1, AT_ONCE // (2 * int(size) + 1) ** 2)
        for start in range(0, len(members), batch):
            yield members[start : start + batch], int(size)


def _fit(
    image: NDArray[np.float32], maps: LocalMaps, window: CornerWindow, reach: int, is_quick: bool
) -> Saddles:
    height, width = image.shape
    steps = np.arange(-reach, reach + 1)
    right, down = (axis.ravel() for axis in np.meshgrid(steps, steps))
    centre_pixels = np.rint(maps.pixels).astype(int)
    u, v = centre_pixels[:, :1] + right, centre_pixels[:, 1:] + down
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    values = image[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    pixels = maps.pixels.copy()
    for _ in range(1 if is_quick else 2):  # second pass centred on the fitted corner
        positions, inverse = inverted(
            maps._replace(pixels=pixels), u.astype(float), v.astype(float)
        )
        offsets = np.stack([u - pixels[:, :1], v - pixels[:, 1:]])
        is_used = inside & _in_window(positions, offsets, window, maps.spacing()[:, None])
        fit = _Fit(*_packed(is_used, positions, inverse, offsets, values))
        terms, sigma, rms = fit.run(STEPS // 2 if is_quick else STEPS)
        pixels = pixels + terms[:, 4:6]
    contrast = terms[:, 3]
    size = np.abs(contrast)
    blur = np.sqrt(np.exp(2 * terms[:, 6]) + PIXEL_VARIANCE)
    return Saddles(pixels, sigma, blur, contrast, rms / np.where(size > 0, size, 1.0))


def _in_window(
    positions: Array, offsets: Array, window: CornerWindow, spacing: Array
) -> NDArray[np.bool_]:
    """Return the mask of pixels within the square of the board and a distance limit.

    For tiny squares, a minimum number of pixels is included.
    """
    squared_distances = offsets[0] ** 2 + offsets[1] ** 2
    x, y = np.abs(positions)
    is_inside = (np.maximum(x, y) < window.half) & (squared_distances < LARGEST_WINDOW_PX**2)
    if np.isfinite(window.arm):
        is_inside &= np.minimum(x, y) < np.maximum(window.arm - MARGIN_PX / spacing, window.arm / 3)
    return np.asarray(is_inside | (squared_distances < SMALLEST_WINDOW_PX**2))


def _packed(used: NDArray[np.bool_], *fields: Array) -> Iterator[Array]:
    """Yield fields (..., m, n) with the used pixels of each corner first, then their weights."""
    order = np.argsort(~used, axis=1, kind="stable")[:, : used.sum(axis=1).max()]
    for field in (*fields, used.astype(float)):
        yield np.take_along_axis(field, order[(None,) * (field.ndim - 2)], axis=-1)


class _Fit:
    """Least squares for many corners.

    Terms are background (3), contrast, shift (2), logarithm of blur, angles (2).
    """

    def __init__(
        self, positions: Array, back: Array, offsets: Array, values: Array, weights: Array
    ) -> None:
        lengths = np.hypot(back[:, 0], back[:, 1])
        self.distances = positions / lengths  # (2, m, n): from both edges, px
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
        expected = np.array([0, 0, 0, 0, 0, 0, np.log(BLUR_PRIOR[0]), 0, 0])
        limits = np.array([np.inf, np.inf, np.inf, np.inf, 0.6, 0.6, 0.4, 0.1, 0.1])
        for _ in range(steps):
            model, derivatives = self._model(terms)
            residual = (self.values - model) * self.weights
            derivatives *= self.weights[:, None]
            square = derivatives @ derivatives.transpose(0, 2, 1)
            right = (derivatives @ residual[..., None])[..., 0] + prior * (expected - terms)
            diagonal = np.einsum("mii->mi", square) + prior
            matrix = square + np.eye(9) * (prior + 1e-4 * diagonal + 1e-12)[:, None, :]
            step = np.linalg.solve(matrix, right[..., None])[..., 0]
            terms = terms + np.clip(step, -limits, limits)
            if (
                np.abs(step[:, 4:6]).max(initial=0) < CLOSE_PX
                and np.median(np.abs(step[:, 6])) < CLOSE_BLUR
            ):
                break
        variance = np.sum(residual**2, axis=1) / np.maximum(self.count - 9, 1)
        noise = np.linalg.inv(matrix)[:, 4:6, 4:6]
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
        rotated = straight + np.stack(angles) * straight[::-1]
        z = rotated / root
        soft = erf(z)
        product = soft[0] * soft[1]
        # derivatives of the product with respect to each distance
        slopes = contrast * (2 / np.sqrt(np.pi)) / root * np.exp(-(z**2)) * soft[::-1]
        derivatives = np.empty((len(terms), 9, product.shape[1]))
        derivatives[:, 0] = 1.0
        derivatives[:, 1], derivatives[:, 2] = self.offsets
        derivatives[:, 3] = product
        derivatives[:, 4] = -(slopes * self.normals[:, 0]).sum(axis=0)
        derivatives[:, 5] = -(slopes * self.normals[:, 1]).sum(axis=0)
        derivatives[:, 6] = -(slopes * rotated).sum(axis=0) * variance / spread
        derivatives[:, 7], derivatives[:, 8] = slopes * straight[::-1]
        background = constant + right * self.offsets[0] + down * self.offsets[1]
        return background + contrast * product, derivatives


# -- Scale of the standard deviations --------------------------------------------------------------
#
# The pixel residuals of a corner fit are a poor measure of the corner error. Compression,
# saturation, sharpening and filtered noise are correlated between pixels and contribute little to
# them, whereas the shape of motion blur or defocus contributes but does not shift the corner. Any
# camera maps a board smoothly: the error of a corner is its deviation from its neighbours.
# Therefore corners are fitted by polynomials of their board positions, and the standard deviations
# are scaled to a reduced chi-square of 1.

DEGREES = range(3, 9)
"""Degrees of the polynomials.

A quadratic does not describe a board in a mirror; one of these does for 35 corners or more.
"""
MAX_COEFFICIENTS = 0.75  # maximum ratio of coefficients to corners; more leave no residuals
DOUBT = 2.0  # prior weight of the expected scale 1, in degrees of freedom
OUTLYING = 5.0  # standard deviations (of a coordinate) above which a corner is excluded
SCATTER_PASSES = 3


def lattice_scale(positions: Array, pixels: Array, sigma_px: Array) -> float:
    """Return the scale factor for standard deviations of corners.

    Parameters
    ----------
    positions : (n, 2)
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
    >>> positions = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    >>> noise = np.random.default_rng(0).normal(0, 0.05, positions.shape)
    >>> pixels = 30 * positions + 0.2 * positions**2 + noise
    >>> scale = lattice_scale(positions, pixels, np.full(len(positions), 0.01))
    >>> 4 < scale < 6
    True
    """
    is_inlier = np.ones(len(positions), dtype=bool)
    scale = 1.0
    for _ in range(SCATTER_PASSES):
        fitted = _best_fit(positions[is_inlier], pixels[is_inlier], sigma_px[is_inlier])
        if fitted is None:
            break
        scale, residuals = fitted
        inside = np.hypot(*residuals.T) <= OUTLYING * scale * sigma_px[is_inlier]
        if inside.all():
            break
        is_inlier[is_inlier] = inside
    return scale


def _best_fit(positions: Array, pixels: Array, sigma_px: Array) -> tuple[float, Array] | None:
    """Return scale and residuals (n, 2) of the best degree; None for too few corners."""
    best: tuple[float, Array] | None = None
    base = _in_perspective(positions, pixels)
    weights = 1 / sigma_px[:, None]
    for degree in DEGREES:
        basis = _polynomials(base, degree)
        count, unknowns = basis.shape
        if unknowns > MAX_COEFFICIENTS * count:
            break
        coefficients = np.linalg.lstsq(basis * weights, pixels * weights, rcond=None)[0]
        residuals = pixels - basis @ coefficients
        freedom = 2 * (count - unknowns)
        chi_square = max(float(np.sum((residuals * weights) ** 2)) / freedom, np.finfo(float).tiny)
        scale = float(chi_square ** (freedom / (freedom + DOUBT) / 2))
        if best is None or scale < best[0]:
            best = scale, residuals
    return best


def _in_perspective(positions: Array, pixels: Array) -> Array:
    """Return positions (n, 2) after a homography to the image; unchanged if it is degenerate."""
    matrix: Any = cv2.findHomography(positions, pixels)[0]
    if matrix is None:  # for collinear corners, despite OpenCV's stubs
        return positions
    mapped = np.column_stack([positions, np.ones(len(positions))]) @ matrix.T
    depths = mapped[:, 2:]
    return np.asarray(mapped[:, :2] / depths) if depths.min() > 0 or depths.max() < 0 else positions


def _polynomials(points: Array, degree: int) -> Array:
    """Return products of Chebyshev polynomials (n, k) of two coordinates, up to a total degree."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = (2 * (points - low) / np.where(high > low, high - low, 1.0) - 1).T
    across, down = chebvander(x, degree), chebvander(y, degree)
    return np.stack(
        [across[:, i] * down[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)],
        axis=1,
    )


# -- Corner refinement -----------------------------------------------------------------------------

REFINEMENT_PASSES = 2
MAX_REFINEMENT_PASSES = 100
"""Number of passes; edge curvature is more accurate in the second."""
MAX_DISPLACEMENT = 0.3  # maximum motion of a corner, in squares
WORST_FIT = 0.9  # maximum rms residual in contrasts
ODD_FIT, MIN_ODD_FIT = 4.0, 0.15
"""Limit on the residual relative to its median over the board.

Larger values indicate occlusion or highlights.
"""
WORST_SIGMA_PX = 0.75
MODEL_PX = 0.01
"""Error caused by edge curvature besides noise: 0.01 px on rendered images.

The image as a whole scales it.
"""
SMOOTH_PX, BLUR_BIAS = 0.004, 1.2
"""Common bias of neighbouring corners in px, and its growth with blur.

The growth is the ratio of bias over side to (blur over side)^4: 0.03 px at a blur of 3 px and
squares of 16 px, on rendered mirror images.
"""


@validate_arguments
def refine_corners(
    image: NDArray[Any], detection: Detection, board: Board, *, passes: int = REFINEMENT_PASSES
) -> Detection:
    """Refine corners by fitting the surrounding pixels, with edges curved by the local mapping.

    Parameters
    ----------
    image : (height, width) or (height, width, 3)
        RGB or greyscale image.
    detection
        Corners accurate to about 1 px or 0.1 squares.
    board
        Calibration board.
    passes
        Number of passes.

    Returns
    -------
    Detection
        Detection with corners (k, 2), their standard deviations and edge blur; corners without a
        valid fit are removed. The standard deviations follow from the pixel residuals. For 14
        corners or more they are scaled to the scatter of the corners around a smooth mapping, which
        includes the effects of blur, saturation and compression.

    Raises
    ------
    InvalidParameter
        If the image is invalid, or its size differs from that of the detection.

    Notes
    -----
    On images of boards in mirrors, rendered with blur, noise and JPEG compression, the error is
    0.01 to 0.03 px without bias. The usual iteration over gradients (OpenCV's cornerSubPix) assumes
    straight edges: its error is 3 times as large, one third of it in the radial direction.

    Examples
    --------
    >>> board = Board("chessboard", 3, 3)
    >>> v, u = np.mgrid[:60, :60]  # squares of 15 px about (22, 22), edges between two pixels
    >>> picture = np.where((u // 15 + v // 15) % 2, 200, 40).astype(np.uint8)
    >>> start = np.stack(np.meshgrid([15, 30, 45], [15, 30, 45]), axis=-1).reshape(-1, 2) - 0.3
    >>> found = refine_corners(picture, Detection("a", (60, 60), np.arange(9), start), board)
    >>> found.corners_px.round(2).tolist()[:2]
    [[14.5, 14.5], [29.5, 14.5]]
    """
    integer("passes", passes, 1, MAX_REFINEMENT_PASSES)
    values = grey(image)
    height, width = values.shape
    if (width, height) != tuple(detection.image_size):
        raise InvalidParameter(
            f"the image must have the size of {detection.name}, {detection.image_size[0]} "
            f"x {detection.image_size[1]} px; got {width} x {height} px"
        )
    if not detection.found:
        return detection
    ids, pixels = detection.ids, detection.corners_px.astype(float)
    positions = board.points_mm[:, :2] / board.square_mm
    for _ in range(passes):
        maps = maps_about(positions[ids], pixels, positions[ids])
        fit = fit_saddles(values, maps._replace(pixels=pixels), board.surroundings)
        displacement = np.linalg.norm(fit.pixels - pixels, axis=1)
        worst_fit = min(WORST_FIT, max(ODD_FIT * float(np.median(fit.misfit)), MIN_ODD_FIT))
        is_valid = (
            (displacement < MAX_DISPLACEMENT * maps.spacing() + 0.3)
            & (fit.misfit < worst_fit)
            & (fit.sigma_px < WORST_SIGMA_PX)
        )
        is_valid &= np.all((fit.pixels > 1) & (fit.pixels < np.array([width, height]) - 2), axis=1)
        ids, pixels = ids[is_valid], fit.pixels[is_valid]
        if len(ids) < 4:
            return replace(
                detection,
                ids=ids[:0],
                corners_px=pixels[:0],
                reason="the contrast of its corners is too low",
            )
    sigma, blur = (
        np.hypot(fit.sigma_px[is_valid], MODEL_PX),
        float(np.median(fit.blur_px[is_valid])),
    )
    sigma = sigma * lattice_scale(positions[ids], pixels, sigma)
    side = maps.spacing()[is_valid]  # large blur shifts neighbouring corners equally
    sigma = np.hypot(sigma, SMOOTH_PX + BLUR_BIAS * side * (fit.blur_px[is_valid] / side) ** 4)
    return replace(detection, ids=ids, corners_px=pixels, sigma_px=sigma, blur_px=blur)
