"""Deconvolution: the sharp image that explains a blurred one within its noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.native import backend, kernel_array
from .blur_model import Blur, IndexArray, whole_groups

# -- Sharp image under reconstruction: its values on a fine grid, and one round of improvement -----
#
# Compiled if available, otherwise with sparse matrices, which is slower; both perform the same steps.

Values = NDArray[np.float32]

EDGE = np.float32(
    0.005
)  # smaller differences of roots have a quadratic cost, which avoids staircasing
DARK = np.float32(1e-4)  # lower bound of light for the weights
# Square root of light relative to white: brighter points would explain white surfaces with black
# gaps
MAX_VALUE = np.float32(2)
SATURATED = np.float32(0.995)  # such a pixel may be clipped


class SharpImage(Protocol):
    """Square roots u of the light; the fine values that influence known pixels are unknowns."""

    def improve(self, costs: Values, steps: IndexArray) -> None:
        """Reduce ``|sqrt(A u^2) - y|^2 / 2 + sum costs |grad u|``, with the blur operator A.

        Both terms are approximated by quadratic ones at u, and the given number of conjugate
        gradient steps is performed independently in each tile.

        Parameters
        ----------
        costs : (h, w)
        steps : (tiles,)
            Number of steps; a tile with 0 steps is unchanged.
        """

    def log_steepness(self) -> Values:
        """Return the mean logarithm (h, w) of the gradient magnitudes in each pixel over all
        channels, clipped at white.
        """

    def blurred(self) -> Values:
        """Return the light (h, w, channels) of the blurred image, 0 in unknown pixels."""

    def light(self) -> Values:
        """Return the light (h, w, channels)."""


class Deblurring(Protocol):
    """Data prepared once for a blur."""

    tiles: IndexArray
    """Independently improved tiles (n, 2, 4), as in :attr:`Blur.tiles`."""

    def start(self, roots: Values, guess: Values) -> SharpImage:
        """Return a sharp image for blurred light with given square roots (h, w, 1 or 3) and an
        initial value (h, w, 1 or 3).
        """


def deblurring_of(blur: Blur) -> Deblurring:
    """Return the compiled implementation if available."""
    return CompiledDeblurring(blur) if backend.is_compiled else SparseDeblurring(blur)


class CompiledDeblurring:
    """Multithreaded implementation in C++."""

    def __init__(self, blur: Blur) -> None:
        self.tiles = blur.tiles
        self._kernels = backend.kernels.BlurKernels(
            *blur.size,
            blur.fineness,
            blur.firsts,
            blur.offsets,
            blur.weights,
            blur.pixels,
            blur.block_px,
            blur.kernels,
            self.tiles,
            blur.concentration,
        )

    def start(self, roots: Values, guess: Values) -> SharpImage:
        return CompiledImage(self._kernels, roots, guess)


class CompiledImage:
    """Multithreaded implementation in C++."""

    def __init__(self, kernels: object, roots: Values, guess: Values) -> None:
        self._sharp = backend.kernels.Deconvolution(
            kernels, kernel_array(roots), kernel_array(guess)
        )
        self._shape = roots.shape

    def improve(self, costs: Values, steps: IndexArray) -> None:
        self._sharp.improve(kernel_array(costs), kernel_array(steps, np.int32))

    def log_steepness(self) -> Values:
        logarithms = np.empty(self._shape[:2], np.float32)
        self._sharp.log_steepness(logarithms)
        return logarithms

    def blurred(self) -> Values:
        light = np.zeros(self._shape, np.float32)
        self._sharp.blurred(light)
        return light

    def light(self) -> Values:
        light = np.empty(self._shape, np.float32)
        self._sharp.light(light)
        return light


class Tile(NamedTuple):
    """Image tile that is reconstructed independently."""

    pixels: tuple[slice, slice]
    """Pixels that contain its values."""
    values: tuple[slice, slice]
    """Value ranges on the fine grid."""
    kept: tuple[slice, slice]
    """Kept values on the fine grid."""
    kept_of_values: tuple[slice, slice]
    """Kept values relative to the first value of the tile."""
    seen: NDArray[np.intp]
    """Indices (n,) of the known pixels that it explains."""
    matrix: Any
    """Blur matrix."""
    back: Any
    """Transpose of the matrix."""


def _tile(blur: Blur, matrix: Any, retained: IndexArray, explained: IndexArray) -> Tile:
    f, reach = blur.fineness, (blur.reach, whole_groups(blur.reach))
    sides = blur.size[::-1]
    reached = [
        (max(begin - beyond, 0), min(end + beyond, side))
        for (begin, end), beyond, side in zip(explained.reshape(2, 2), reach, sides, strict=True)
    ]
    inner = [
        (max(begin, first), min(end, last))
        for (begin, end), (first, last) in zip(retained.reshape(2, 2), reached, strict=True)
    ]
    rows, columns = np.divmod(blur.pixels, blur.size[0])
    top, bottom, left, right = explained
    visible = np.flatnonzero(
        (top <= rows) & (rows < bottom) & (left <= columns) & (columns < right)
    )
    fine_rows, fine_columns = (np.arange(f * begin, f * end) for begin, end in reached)
    part = matrix[visible][:, np.add.outer(fine_rows * f * blur.size[0], fine_columns).ravel()]
    return Tile(
        _slices(reached, 1),
        _slices(reached, f),
        _slices(inner, f),
        _slices(
            [(b - first, e - first) for (b, e), (first, _) in zip(inner, reached, strict=True)], f
        ),
        visible,
        part,
        part.T.tocsr(),
    )


def _slices(ranges: Sequence[tuple[int, int]], times: int) -> tuple[slice, slice]:
    rows, columns = (slice(times * begin, times * end) for begin, end in ranges)
    return rows, columns


class SparseDeblurring:
    """Single-threaded implementation with SciPy sparse matrices and NumPy."""

    def __init__(self, blur: Blur) -> None:
        self._blur, self._matrix, self._concentration = blur, blur.matrix(), blur.concentration
        self.tiles = blur.tiles
        self._tiles = [_tile(blur, self._matrix, *boxes) for boxes in self.tiles]

    def start(self, roots: Values, guess: Values) -> SharpImage:
        return SparseImage(self._blur, self._matrix, self._concentration, self._tiles, roots, guess)


class SparseImage:
    """Single-threaded implementation with SciPy sparse matrices and NumPy."""

    def __init__(
        self,
        blur: Blur,
        matrix: Any,
        concentration: Values,
        tiles: Sequence[Tile],
        roots: Values,
        guess: Values,
    ) -> None:
        self._blur, self._matrix, self._concentration, self._tiles = (
            blur,
            matrix,
            concentration,
            tiles,
        )
        self._shape = roots.shape
        self._seen = roots.reshape(-1, roots.shape[2])[blur.pixels]
        self._fine = _refined(guess, blur.fineness)

    def improve(self, costs: Values, steps: IndexArray) -> None:
        improved = self._fine.copy()
        for tile, own_steps in zip(self._tiles, steps, strict=True):
            if own_steps == 0:
                continue
            fine, visible = self._fine[tile.values], self._seen[tile.seen]
            of_pixels = costs[tile.pixels], self._concentration[tile.pixels]
            own = _Quadratic(
                tile,
                fine,
                visible,
                *(_repeated(values, self._blur.fineness) for values in of_pixels),
            )
            improved[tile.kept] = own.improved(own_steps)[tile.kept_of_values]
        self._fine = improved

    def log_steepness(self) -> Values:
        return _binned(_log_steepness(np.minimum(self._fine, 1))[..., None], self._blur.fineness)[
            ..., 0
        ]

    def blurred(self) -> Values:
        light = np.zeros((self._shape[0] * self._shape[1], self._shape[2]), np.float32)
        light[self._blur.pixels] = self._matrix @ (self._fine**2).reshape(-1, self._shape[2])
        return light.reshape(self._shape)

    def light(self) -> Values:
        return _binned(self._fine**2, self._blur.fineness)


class _Quadratic:
    """Quadratic approximation of both terms for the values of a tile."""

    def __init__(
        self, tile: Tile, fine: Values, visible: Values, costs: Values, concentration: Values
    ) -> None:
        self._tile, self._fine = tile, fine
        steepness = np.exp(_log_steepness(fine))
        self._stiffness = np.asarray(costs / steepness, np.float32)
        # With s = sqrt(A u^2), ds = A (u du) / s. The negative gradient is u A^T((y - s) / s) minus the
        # variation term; the Gauss-Newton second derivative is u A^T(s^-2 A (u d)) plus its smoothness
        level = np.sqrt(np.maximum(self._blurred(fine**2), DARK))
        counted = (visible < SATURATED) | (level < visible)
        slope = (counted / level).astype(
            np.float32
        )  # derivative of sqrt(A u^2), without the factors A and u
        self._slope2 = slope**2
        self._pull = fine * self._spread(slope * (visible - level)) - smoothness(
            fine, self._stiffness
        )
        self._scale = np.reciprocal(4 * self._stiffness + concentration)[
            ..., None
        ]  # see Blur.concentration

    def improved(self, steps: int) -> Values:
        """Return the values after a number of conjugate gradient steps towards zero gradient."""
        residual = self._pull
        x = np.zeros_like(residual)
        d = self._scale * residual
        power = np.vdot(residual, d)
        for _ in range(steps):
            if power <= 0:  # already solved
                break
            product = self._times(d)
            step = power / np.vdot(d, product)
            x += step * d
            residual = residual - step * product
            power, before = np.vdot(residual, self._scale * residual), power
            d = self._scale * residual + power / before * d
        return np.clip(self._fine + x, 0, MAX_VALUE)

    def _times(self, d: Values) -> Values:
        """Return the product of the second derivative with d."""
        return self._fine * self._spread(self._slope2 * self._blurred(self._fine * d)) + smoothness(
            d, self._stiffness
        )

    def _blurred(self, fine: Values) -> Values:
        return np.asarray(self._tile.matrix @ fine.reshape(-1, fine.shape[2]))

    def _spread(self, blurred: Values) -> Values:
        return np.asarray(self._tile.back @ blurred).reshape(self._fine.shape)


def smoothness(d: Values, stiffness: Values) -> Values:
    """Return the transposed differences of stiffness (rows, columns) times the differences of d
    (rows, columns, n).
    """
    right, down = differences(d)
    right *= stiffness[..., None]
    down *= stiffness[..., None]
    back = -right - down
    back[:, 1:] += right[:, :-1]
    back[1:] += down[:-1]
    return back


def differences(image: Values) -> tuple[Values, Values]:
    """Return differences to the next pixel on the right and below; 0 at the end."""
    right, down = np.zeros_like(image), np.zeros_like(image)
    np.subtract(image[:, 1:], image[:, :-1], out=right[:, :-1])
    np.subtract(image[1:], image[:-1], out=down[:-1])
    return right, down


def _log_steepness(fine: Values) -> Values:
    """Return logarithms (rows, columns) of the gradient magnitudes over all channels."""
    right, down = differences(fine)
    squares = (right**2 + down**2).sum(axis=2)
    return np.asarray(np.log(squares + EDGE**2) / 2, np.float32)


def _refined(roots: Values, fineness: int) -> Values:
    """Return initial values on a finer grid, smoothed to avoid pixel stairs that would be treated
    as edges.
    """
    fine = _repeated(roots, fineness)
    return np.asarray(cv2.blur(fine, (fineness, fineness)), np.float32).reshape(fine.shape)


def _repeated(values: Values, fineness: int) -> Values:
    """Repeat every value of an image in all of its fine pixels."""
    return np.repeat(np.repeat(values, fineness, axis=0), fineness, axis=1)


def _binned(fine: Values, fineness: int) -> Values:
    """Return means (h, w, channels) of the fine values in each pixel."""
    rows, columns, channels = fine.shape
    means: Values = fine.reshape(
        rows // fineness, fineness, columns // fineness, fineness, channels
    ).mean(axis=(1, 3))
    return means


# -- Estimation of the sharp image that explains a blurred one within its noise --------------------
#
# On a grid finer than the pixels, the sharp image explains the blurred image and has small total
# variation (Rudin, Osher and Fatemi, 1992). Blur adds light, and noise is uniform in gamma-coded
# images; the unknown u is therefore the square root of the light, which is close to the coded values,
# and
#
#     |sqrt(A u^2) - y|^2 / 2 + sum weight |grad u|
#
# is minimised, with the blur operator A. Both terms are approximated by quadratic ones a few times
# (Gauss-Newton, and lagged diffusivity: Vogel and Oman, 1996), each solved by conjugate gradients.
#
# For large blur, most rounds are performed on the pixel grid, at 1/4 of the cost, and the fine grid
# only restores the aliased components: one round fewer for tiles with large blur throughout.
#
# The weight is adaptive in the Bayesian sense: lower in textured regions, because variation is
# likely, and higher in uniform regions. It decreases with the blur, which damps noise itself.

# Tuned on the scenes of `benchmarks/restoration_gain.py --tuning` (room, street, noise clouds)
# only, except for the maximum brightness, which was chosen for lamps among leaves and windows in a
# photograph.
REGULARITY = 1.5  # weight relative to the noise, without blur and texture
# Weight of :func:`fit`: the residual is then unexplained by the blur rather than a cost of the variation
FIT_REGULARITY = 0.5
BLUR_PX = 0.7  # widening of pixels that halves it
TEXTURE = 2.0  # differences that halve it, relative to the noise

LARGE_PX = 3.0  # median widening of pixels from which the blur is large
UNEVEN_PX = 3.0  # widening anywhere that requires more steps
SPARED_PX = 4.0  # minimum widening of a tile for which the last round on the fine grid has no visible effect
COARSE = 3.0  # weight factor on the pixel grid: 2 to 4 differ by 0.2 dB; rooms and streets gain most with 2
WINDOW_PX = 16  # window of the texture measure
INITIAL_TEXTURE = np.float32(0.7)  # assumed texture in the first round


class Effort(NamedTuple):
    """Numbers of quadratic approximations on the pixel grid and on the fine grid, and of steps in
    each.
    """

    coarse_rounds: int
    rounds: int
    steps: int
    """Conjugate gradient steps."""


# By blur. An initial estimate on the pixel grid costs the equidistant sensor 0.5 dB for small blur.
SMALL_BLUR_EFFORT, VARYING_BLUR_EFFORT, LARGE_BLUR_EFFORT = (
    Effort(0, 4, 4),
    Effort(0, 5, 5),
    Effort(coarse_rounds=6, rounds=2, steps=6),
)


def solve(
    deblurrings: tuple[Deblurring | None, Deblurring],
    widening_px: Values,
    roots: Values,
    noise: Values,
    visible: Values,
    effort: Effort,
) -> SharpImage:
    """Compute the sharp image.

    Parameters
    ----------
    deblurrings
        Deblurring operators on the pixel grid, if rounds are performed on it, and on the fine grid.
    widening_px : (h, w)
        Widening of a pixel by the blur, mean of both directions.
    roots : (h, w, 1 or 3)
        Square roots of the light of the blurred image.
    noise : (h, w)
        Standard deviation of the roots.
    visible : (h, w)
        Visible part of the standard deviation: larger differences are texture.
    effort
        Rounds and steps.
    """
    costs = (REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32)
    coarse, fine = deblurrings
    guess = (
        roots
        if coarse is None
        else _initial_estimate(coarse, np.float32(COARSE) * costs, roots, visible, effort)
    )
    sharp = fine.start(roots, guess)
    steps = np.full(len(fine.tiles), effort.steps, np.int32)
    for n in range(effort.rounds):
        is_evaluated = n > 0 or coarse is not None
        if coarse is not None and n == effort.rounds - 1:
            steps[_least(fine.tiles, widening_px) > SPARED_PX] = 0
        sharp.improve(costs * (_plain(sharp, visible) if is_evaluated else INITIAL_TEXTURE), steps)
    return sharp


def _least(tiles: IndexArray, values: Values) -> Values:
    """Return the minima (n,) of values (h, w) over the kept pixels of each tile."""
    return np.array(
        [values[top:bottom, left:right].min() for top, bottom, left, right in tiles[:, 0]],
        np.float32,
    )


def _initial_estimate(
    coarse: Deblurring, costs: Values, roots: Values, visible: Values, effort: Effort
) -> Values:
    """Return the square roots (h, w, channels) of the light of the sharp image at the resolution of
    the pixel grid.
    """
    return np.sqrt(_improved(coarse, costs, roots, visible, effort).light())


def _improved(
    coarse: Deblurring, costs: Values, roots: Values, visible: Values, effort: Effort
) -> SharpImage:
    sharp = coarse.start(roots, roots)
    steps = np.full(len(coarse.tiles), effort.steps, np.int32)
    for n in range(effort.coarse_rounds):
        sharp.improve(costs * (_plain(sharp, visible) if n else INITIAL_TEXTURE), steps)
    return sharp


def fit(
    coarse: Deblurring,
    widening_px: Values,
    roots: Values,
    noise: Values,
    visible: Values,
    effort: Effort,
) -> SharpImage:
    """Return a weakly regularised sharp image on the pixel grid that explains as much as the blur
    permits.

    Parameters are as in :func:`solve`.
    """
    costs = (FIT_REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32)
    return _improved(coarse, costs, roots, visible, effort)


def texture_of(sharp: SharpImage, noise: Values) -> Values:
    """Return the texture measure (h, w) of a sharp image, 0 to 1.

    It is 0.5 for differences that halve the weight, relative to the noise (h, w) of the root of the
    blurred image.
    """
    return np.asarray(1 - _plain(sharp, noise), np.float32)


def _plain(sharp: SharpImage, noise: Values) -> Values:
    """Return a value near 1 for uniform regions, and 0.5 or less for textured ones.

    Texture is measured with the geometric mean of the differences, which is insensitive to single
    edges. Saturated pixels are far brighter than their surroundings, which are not counted as
    textured.
    """
    texture = np.exp(cv2.boxFilter(sharp.log_steepness(), cv2.CV_32F, (WINDOW_PX, WINDOW_PX)))
    return np.asarray(1 / (1 + texture / (np.float32(TEXTURE) * noise)), np.float32)
