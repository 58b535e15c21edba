"""Estimation of image noise from the image alone, including the coding error of JPEG images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.arguments import validate_arguments
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.results import Result
from ...base.typing import Array, Mask
from ...io.images import BLOCK, JpegCoding, read_jpeg_coding

# -- JPEG coding error, estimated from the decoded image and the quantisation steps ----------------
#
# JPEG rounds the cosine transform of 8 x 8 blocks to multiples of a step. The error of a non-zero
# coefficient is uniform within its step; a zero coefficient was smaller than half a step, with a
# Laplace distribution (Lam and Goodman, 2000) whose width follows from the fraction of zeros. If
# nearly all coefficients are zero, the width is extrapolated from other frequencies by a power law.
# Blocks are grouped by their energy, because uniform and detailed blocks differ.

GROUPS = 6  # number of groups of blocks
MOSTLY_ZERO = 0.97  # fraction from which a frequency is less informative than the others
POWERS, WIDTHS = np.linspace(0.5, 3, 11), np.geomspace(0.02, 400, 60)
SHARED = 0.1  # weight of all groups together in the power of each
SHADES = (1.0, (0.344136**2 + 1.772**2) / 3, (1.402**2 + 0.714136**2) / 3)
"""Weight of a squared error of Y, Cb and Cr in the mean of red, green and blue."""
FINE = np.add.outer(np.arange(BLOCK), np.arange(BLOCK)) >= BLOCK  # coefficients of fine detail
# Fraction and number of the blocks whose fine detail measures noise
UNIFORM_FRACTION_OF_JPEG, MIN_UNIFORM_BLOCKS = 0.05, 10
# Candidate noise levels, 0 to 255; decrease of the log-likelihood that excludes a level
DEVIATIONS, UNLIKELY = np.geomspace(0.3, 40, 80), 2.0
FOLDED = 2.0  # subsampled chroma loses fine detail and gains as much by aliasing
HELD = (
    2.0  # ratio of the detail of chroma before subsampling and upsampling to the remaining detail
)
WHOLE = 0.999  # mean of a mask that is entirely valid

STEPS, MAX_FREQUENCY = (
    np.arange(2, 121),
    9,
)  # candidate steps, and maximum frequency for their detection
STEPPED, MIN_COUNT, MIN_FOUND, MAX_BLOCKS = 0.7, 20, 4, 2000
STANDARD = np.array(
    [
        [[16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55], [14, 13, 16, 24, 40, 57, 69, 56],
         [14, 17, 22, 29, 51, 87, 80, 62], [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
         [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99]],
        [[17, 18, 24, 47, 99, 99, 99, 99], [18, 21, 26, 66, 99, 99, 99, 99], [24, 26, 56, 99, 99, 99, 99, 99],
         [47, 66, 99, 99, 99, 99, 99, 99], *[[99] * 8] * 4],
    ]
)  # fmt: skip
"""Quantisation steps of Y, and of Cb and Cr, at quality 50 (T.81, Annex K)."""


def _cosines() -> Array:
    k = np.arange(BLOCK)
    basis = np.sqrt(2 / BLOCK) * np.cos(np.pi * (2 * k[None] + 1) * k[:, None] / (2 * BLOCK))
    basis[0] = np.sqrt(1 / BLOCK)
    return np.asarray(basis)


def _frequencies(side: int) -> Array:
    frequencies = np.hypot(*np.meshgrid(np.arange(side), np.arange(side)))
    frequencies[0, 0] = 0.5
    return np.asarray(frequencies)


COSINES, FREQUENCY, FINE_FREQUENCY = _cosines(), _frequencies(BLOCK), _frequencies(2 * BLOCK)
FINE_FREQUENCY = FINE_FREQUENCY[np.maximum(*np.indices(FINE_FREQUENCY.shape)) >= BLOCK]


def error_of(colours: Array, coding: JpegCoding, inside: Mask) -> float:
    """Estimate the mean squared coding error, on the scale 0 to 255 of the image.

    Parameters
    ----------
    colours : (h, w, 1 or 3)
        Decoded image, 0 to 255.
    coding
    inside : (h, w)
        Mask of valid pixels; blocks must be entirely inside.
    """
    planes = [colours[..., 0]] if colours.shape[2] == 1 else _shades(colours)
    total = 0.0
    for n, (plane, table) in enumerate(zip(planes, coding.tables, strict=False)):
        coarser = coding.subsampling if n else (1, 1)
        held, counted = _binned(plane, coarser), _binned(inside.astype(float), coarser)
        whole = blocks_of(counted > WHOLE).all(axis=(2, 3))
        if whole.any():
            error, folded = _error_of_plane(coefficients_of(held)[whole], table)
            total += SHADES[n] * error
            if coarser != (1, 1):
                total += SHADES[n] * max(
                    folded, _lost_in_coarser(held, counted) * (np.array(coarser) > 1).mean()
                )
    return total


def max_noise(colours: Array, coding: JpegCoding, inside: Mask) -> float:
    """Return the maximum variance of white noise that is consistent with the coding, on the scale 0
    to 255.

    The number of non-zero coefficients of fine detail in the most uniform blocks limits the noise:
    apparent noise in coarser coefficients above this limit is texture. Noise remains in the
    non-zero coefficients only.

    Parameters
    ----------
    colours : (h, w, 1 or 3)
        Decoded image, 0 to 255.
    coding
    inside : (h, w)
        Mask of valid pixels; blocks must be entirely inside.
    """
    from scipy.special import erfc

    plane = colours[..., 0] if colours.shape[2] == 1 else _shades(colours)[0]
    blocks = coefficients_of(plane)[blocks_of(inside).all(axis=(2, 3))]
    if not len(blocks):
        return np.inf
    held = np.abs(blocks) >= coding.tables[0] / 2
    # The noise of coarse coefficients differs from that of fine detail
    coarse = (blocks**2)[:, ~FINE][:, 1:].sum(axis=1)
    plainest = np.argsort(coarse, kind="stable")[
        : max(MIN_UNIFORM_BLOCKS, round(UNIFORM_FRACTION_OF_JPEG * len(blocks)))
    ]
    half, counts = coding.tables[0][FINE] / 2, held[:, FINE][plainest].sum(axis=0)
    likely = np.clip(erfc(half / (np.sqrt(2) * DEVIATIONS[:, None])), 1e-300, 1 - 1e-12)
    likelihood = (counts * np.log(likely) + (len(plainest) - counts) * np.log1p(-likely)).sum(
        axis=1
    )
    maximum = DEVIATIONS[likelihood > likelihood.max() - UNLIKELY].max()
    return float(maximum**2 * held.mean())


def detected_coding(image: NDArray[np.uint8], inside: Mask) -> JpegCoding | None:
    """Detect the JPEG coding of an image from the steps of its lowest frequencies; None without
    traces of coding.

    The image must be aligned with the block grid, as complete images are. The quality is that of
    the standard tables with the nearest steps; chroma is assumed to be subsampled by 2.
    """
    colours = image[..., None] if image.ndim == 2 else image[..., :3]
    y = (colours[..., 0] if colours.shape[2] == 1 else _shades(colours)[0]).astype(float)
    if min(y.shape) < BLOCK:
        return None
    blocks = coefficients_of(y)[blocks_of(inside).all(axis=(2, 3))]
    blocks = blocks[:: max(1, len(blocks) // MAX_BLOCKS)]
    matches = {}
    for row, column in zip(
        *np.nonzero(np.add.outer(np.arange(BLOCK), np.arange(BLOCK)) <= MAX_FREQUENCY), strict=True
    ):
        if row + column and (step := _step_of(np.abs(blocks[:, row, column]))):
            matches[row, column] = step
    if len(matches) < MIN_FOUND:
        return None
    positions, steps = tuple(np.array(list(matches)).T), np.array(list(matches.values()))
    misses = [
        np.abs(np.log(standard_tables(q)[0][positions] / steps)).mean() for q in range(1, 101)
    ]
    tables = standard_tables(1 + int(np.argmin(misses)))
    return (
        JpegCoding(tables[:1])
        if colours.shape[2] == 1
        else JpegCoding((*tables, tables[1]), (2, 2))
    )


def standard_tables(quality: int) -> tuple[Array, Array]:
    """Return the steps of Y, and of Cb and Cr, at a quality of 1 to 100 with the scaling of the
    Independent JPEG Group.
    """
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    y, colours = np.clip((STANDARD * scale + 50) // 100, 1, 255).astype(float)
    return y, colours


def blocks_of(plane: NDArray[Any]) -> NDArray[Any]:
    """Return the complete blocks (rows, columns, 8, 8) of a plane."""
    rows, columns = (side // BLOCK for side in plane.shape)
    return (
        plane[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2)
    )


def coefficients_of(plane: Array) -> Array:
    """Return the cosine transform (rows, columns, 8, 8) of the blocks of a plane."""
    coefficients: Array = COSINES @ blocks_of(plane) @ COSINES.T
    return coefficients


def _binned(plane: Array, by: tuple[int, int]) -> Array:
    """Return means over blocks of pixels, down and right."""
    rows, columns = (side // n for side, n in zip(plane.shape, by, strict=True))
    if by == (1, 1):
        return plane
    means: Array = (
        plane[: rows * by[0], : columns * by[1]]
        .reshape(rows, by[0], columns, by[1])
        .mean(axis=(1, 3))
    )
    return means


def _shades(colours: NDArray[Any]) -> list[Array]:
    """Return Y, Cb and Cr (ITU-R BT.601, as in JFIF)."""
    red, green, blue = np.moveaxis(colours.astype(float), -1, 0)
    y = 0.299 * red + 0.587 * green + 0.114 * blue
    return [y, (blue - y) / 1.772, (red - y) / 1.402]


def _step_of(sizes: Array) -> int:
    """Return the largest step that divides the magnitudes (n,) of a coefficient; 0 if there is
    none.
    """
    for step in STEPS[::-1]:
        counted = sizes[sizes > step / 2]
        if len(counted) >= MIN_COUNT and np.cos(2 * np.pi / step * counted).mean() > STEPPED:
            return int(step)
    return 0


def _lost_in_coarser(plane: Array, inside: Array) -> float:
    """Estimate the mean square of the subsampling loss of Cb or Cr from the remaining chroma.

    The loss is extrapolated from a second subsampling: edges and textures lose by the same ratio in
    each subsampling.
    """
    losses = []
    for _ in range(2):
        coarser = _binned(plane, (2, 2))
        rows, columns = (2 * side for side in coarser.shape)
        here = inside[:rows, :columns] > WHOLE
        if not here.any():
            return 0.0
        again = cv2.resize(coarser, (columns, rows), interpolation=cv2.INTER_LINEAR)
        losses.append(float(((plane[:rows, :columns] - again)[here] ** 2).mean()))
        plane, inside = coarser, _binned(inside, (2, 2))
    return HELD * losses[0] * min(1.0, losses[0] / max(losses[1], 1e-9))


def _error_of_plane(coefficients: Array, table: Array) -> tuple[float, float]:
    """Return mean squared errors of Y, Cb or Cr from block coefficients (n, 8, 8): total, and in
    fine detail.
    """
    zero = np.abs(coefficients) < table / 2
    order = np.argsort((~zero).sum(axis=(1, 2)), kind="stable")
    groups = [zero[part] for part in np.array_split(order, GROUPS) if len(part)]
    likelihoods = [_likelihoods(group, table) for group in groups]
    of_power = SHARED * np.sum([one.max(axis=1) for one in likelihoods], axis=0)
    total = finer = 0.0
    for group, likelihood in zip(groups, likelihoods, strict=True):
        power, width = np.unravel_index((likelihood + of_power[:, None]).argmax(), likelihood.shape)
        law = WIDTHS[width] * FREQUENCY ** -POWERS[power]
        total += _error_of_zeros(group.mean(axis=0), len(group), law, table).mean() * len(group)
        # A mean of four has 1/4 of the power; the Laplace variance is twice the squared width
        of_finer = ((WIDTHS[width] * FINE_FREQUENCY ** -POWERS[power]) ** 2).sum() / (
            2 * BLOCK
        ) ** 2
        finer += FOLDED * 4 * 2 * of_finer * len(group)
    return float(total / len(zero)), float(finer / len(zero))


def _likelihoods(zero: Mask, table: Array) -> Array:
    """Return log-likelihoods (powers, widths) of the zeros (n, 8, 8) of blocks, excluding the mean."""
    counted = FREQUENCY >= 1
    zeros = zero.sum(axis=0)[counted]
    likelihoods = np.empty((len(POWERS), len(WIDTHS)))
    for i, power in enumerate(POWERS):
        half = np.maximum(table[counted] / 2 * FREQUENCY[counted] ** power / WIDTHS[:, None], 1e-9)
        likelihoods[i] = (zeros * np.log(-np.expm1(-half)) - (len(zero) - zeros) * half).sum(axis=1)
    return likelihoods


def _error_of_zeros(fraction: Array, count: int, law: Array, table: Array) -> Array:
    """Return mean squared errors (8, 8) from the fraction of zeros of each coefficient in a number
    of blocks.
    """
    half = table / 2
    own = -half / np.log1p(-np.clip(fraction, 1e-3, 1 - 0.5 / count))
    width = np.where(fraction < MOSTLY_ZERO, own, np.minimum(own, law))
    x = half / width
    small = half**2 / 3  # for x much below 1: uniform within the step
    with np.errstate(invalid="ignore", divide="ignore"):
        below = (
            2 * width**2 - np.exp(-x) * (half**2 + 2 * half * width + 2 * width**2)
        ) / -np.expm1(-x)
    error: Array = (1 - fraction) * table**2 / 12 + fraction * np.where(x < 1e-2, small, below)
    return error


# -- Estimation of image noise from the image alone ------------------------------------------------
#
# Noise is the residual of small blocks after removal of their slope, in the most uniform blocks: the
# smallest variances of white noise follow from the chi-square distribution. JPEG images have little
# noise in these blocks but contain coding errors, which are estimated above. The noise of
# linear light increases with the light.

ImageArray = NDArray[Any]

FULL = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
MIN_NOISE, MAX_NOISE = 1e-3, 0.2
MIN_NOISE_OF_CODED = 5e-3  # JPEG images were often coded or scaled before
BLACK, WHITE = 0.03, 0.97  # levels beyond them have clipped noise
UNIFORM_FRACTION, PURE_NOISE_FRACTION = (
    0.05,
    0.02,
)  # fraction of uniform blocks, and fraction with pure noise in fine detail
LEVELS, UNIFORM_FRACTION_OF_LEVEL, MIN_BLOCKS = 8, 0.1, 20
RAMP = np.broadcast_to(
    (np.arange(BLOCK) - 3.5) / np.sqrt(42 * BLOCK), (BLOCK, BLOCK)
)  # slope 1, normalised
PLANE_FREEDOM, FINE_FREEDOM = BLOCK**2 - 3, int(FINE.sum())
SITES = 1.15  # noise ratio of the 2 x 2 colour-filter sites: measured or interpolated
VISIBLE_OF_CODED = 0.25  # visible fraction of the standard deviation due to coding
SURVIVING = 0.8  # ratio of the noise that survives coding in uniform blocks to that in all blocks


@dataclass(frozen=True)
class Noise(Result):
    """Noise of an image."""

    fraction: float
    """Standard deviation in sRGB as a fraction of full scale: RMS over the image."""
    by_pixel: Light
    """Standard deviations (h, w) of the square root of the light, which is close to sRGB values."""
    kind: str
    """Kind of noise: ``white``, ``demosaiced``, ``JPEG``, ``linear`` or ``specified``."""
    coding_fraction: float = 0.0
    """Fraction of its power due to coding, which is mostly invisible because texture was removed.
    """

    @property
    def visible_fraction(self) -> float:
        """Visible fraction of the standard deviation."""
        return float(np.sqrt(1 - self.coding_fraction * (1 - VISIBLE_OF_CODED**2)))

    def at_least(self, by_pixel: Light | np.float32) -> Noise:
        """Return the noise with a lower bound for each pixel (h, w)."""
        return replace(self, by_pixel=np.maximum(self.by_pixel, by_pixel))

    def window(self, rows: slice, columns: slice) -> Noise:
        """Return the noise of an image window."""
        return replace(self, by_pixel=self.by_pixel[rows, columns])


@validate_arguments
def estimate_noise(
    image: ImageArray, file: str | Path | None = None, *, where: Mask | None = None
) -> Noise:
    """Estimate the noise of an image, or its coding error if that is larger.

    Parameters
    ----------
    image : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB.
    file
        Source file: a JPEG file contains its quantisation steps. By default they are detected in
        the image.
    where : (h, w)
        Mask of valid pixels, which image the mirror.

    Returns
    -------
    Noise
        Fraction of full scale, and kind of noise.

    Raises
    ------
    InvalidParameter
        If the array is not such an image, or contains non-finite values.
    MediaError
        If the file cannot be read.

    Notes
    -----
    The error is some 10 to 25 % if 5 % of the image is uniform; for images with detail everywhere
    the estimate is too high. The coding error follows from the statistics of the coefficients, and
    that of subsampled chroma from its remaining frequencies.

    Examples
    --------
    >>> slope = np.linspace(0.2, 0.8, 256) + 0.01 * np.random.default_rng(0).standard_normal((256, 256))
    >>> round(estimate_noise((255 * slope).astype(np.uint8)).fraction, 3)
    0.01
    """
    check_restorable(image)
    inside = np.ones(image.shape[:2], bool) if where is None else where
    if inside.shape != image.shape[:2]:
        raise InvalidParameter(
            f"where must have the shape {image.shape[:2]} of the image; got {inside.shape}"
        )
    colours = image[..., None] if image.ndim == 2 else image[..., :3]
    colours = (colours / FULL[image.dtype.name]).astype(np.float32)
    if image.dtype == np.float32:
        return _of_light(np.maximum(colours, 0), inside)
    if image.dtype == np.uint8:
        coding = read_jpeg_coding(file) if file is not None else None
        if coding := coding or detected_coding(image, inside):
            values = 255 * colours.astype(float)
            like_noise = SURVIVING**2 * _white(colours, inside, True)
            remainder = min(like_noise, max_noise(values, coding, inside) / 255**2)
            level = error_of(values, coding, inside) / 255**2 + remainder
            # If most of the apparent noise is texture, the remainder may be texture, too
            visible = remainder * (remainder / max(like_noise, MIN_NOISE**2)) ** 2
            variance = max(level, MIN_NOISE_OF_CODED**2)
            return replace(
                _even(variance, inside.shape, "JPEG"), coding_fraction=(level - visible) / variance
            )
    demosaiced = _is_demosaiced(colours, inside)
    return _even(
        _white(colours, inside, demosaiced), inside.shape, "demosaiced" if demosaiced else "white"
    )


def check_restorable(image: ImageArray) -> None:
    """Raise an error unless an image can be restored."""
    if not isinstance(image, np.ndarray) or image.dtype.name not in FULL:
        kind = getattr(image, "dtype", type(image).__name__)
        raise InvalidParameter(f"the image must be an array of {', '.join(FULL)}; got {kind}")
    if 0 in image.shape or (
        image.ndim != 2 and (image.ndim != 3 or image.shape[2] not in (1, 3, 4))
    ):
        raise InvalidParameter(f"the image must have 1, 3 or 4 channels; got shape {image.shape}")
    if image.dtype == np.float32 and (count := int((~np.isfinite(image)).sum())):
        raise InvalidParameter(
            f"the image must contain finite values; got {count} that are NaN or infinite"
        )


def specified_noise(fraction: float, shape: tuple[int, ...]) -> Noise:
    """Return uniform noise for all pixels of an image.

    Raises
    ------
    InvalidParameter
        If the fraction is not a number from 0 to 0.2.
    """
    if not 0 <= fraction <= MAX_NOISE:
        raise InvalidParameter(
            f"noise must be between 0 and {MAX_NOISE} of full scale; got {fraction:g}"
        )
    return _even(fraction**2, shape, "specified")


def _even(variance: float, shape: tuple[int, ...], kind: str) -> Noise:
    fraction = float(np.clip(np.sqrt(variance), MIN_NOISE, MAX_NOISE))
    return Noise(fraction, np.full(shape[:2], fraction, np.float32), kind)


def _of_light(light: Light, inside: Mask) -> Noise:
    """Estimate the variance of light as a linear function of the light, from the most uniform
    blocks of several levels.
    """
    from scipy.optimize import nnls

    level, plane, fine = _variances(light, inside)
    points = []
    for part in np.array_split(np.argsort(level), LEVELS):
        if len(part) >= MIN_BLOCKS and WHITE > level[part].mean() > 0:
            plainest = part[
                np.argsort(plane[part])[: int(2 * UNIFORM_FRACTION_OF_LEVEL * len(part))]
            ]
            points.append(
                (
                    level[plainest].mean(),
                    _smallest(plane[part], fine[part], UNIFORM_FRACTION_OF_LEVEL),
                )
            )
    bright = light.mean(axis=2, dtype=float)
    even, growing = MIN_NOISE**2, 0.0
    if points:
        at, variances = np.array(points).T
        weighed = np.stack([np.ones_like(at), at], axis=-1) / np.maximum(variances, 1e-12)[:, None]
        (even, growing), _ = nnls(weighed, np.ones_like(at))
    spread = np.sqrt(even + growing * bright)
    # Standard deviation of the square root
    deviation = spread / (2 * np.sqrt(np.maximum(bright, np.maximum(spread, 1e-9))))
    clipped = np.clip(deviation, MIN_NOISE, MAX_NOISE)
    return Noise(
        float(np.sqrt((clipped[inside] ** 2).mean())), clipped.astype(np.float32), "linear"
    )


def _white(colours: Light, inside: Mask, is_correlated: bool) -> float:
    """Estimate the variance of sRGB noise (h, w, n), mainly from fine detail unless neighbours are
    correlated.
    """
    level, plane, fine = _variances(colours, inside)
    usable = (level > BLACK) & (level < WHITE)
    if not usable.any():
        return MIN_NOISE**2
    return _smallest(plane[usable], np.inf if is_correlated else fine[usable], UNIFORM_FRACTION)


def _variances(colours: Light, inside: Mask) -> tuple[Array, Array, Array]:
    """Return level, variance without slope, and variance of fine detail for all blocks and colours
    in the mask.
    """
    variances = []
    whole = blocks_of(inside).all(axis=(2, 3))
    for plane in np.moveaxis(colours, -1, 0):
        blocks = blocks_of(plane.astype(float))[whole]
        fine = (coefficients_of(plane.astype(float))[whole][:, FINE] ** 2).mean(axis=1)
        squares = (blocks**2).sum(axis=(1, 2)) - blocks.sum(axis=(1, 2)) ** 2 / BLOCK**2
        slopes = (blocks * RAMP).sum(axis=(1, 2)) ** 2 + (blocks * RAMP.T).sum(axis=(1, 2)) ** 2
        variances.append(
            (blocks.mean(axis=(1, 2)), np.maximum(squares - slopes, 0) / PLANE_FREEDOM, fine)
        )
    level, plane, fine = (np.concatenate(parts) for parts in zip(*variances, strict=True))
    return level, plane, fine


def _smallest(plane: Array, fine: Array | float, plainest: float) -> float:
    """Return the variance of white noise that has the variances of the most uniform blocks."""
    from scipy.stats import chi2

    variance = np.quantile(plane, plainest) * PLANE_FREEDOM / chi2.ppf(plainest, PLANE_FREEDOM)
    if isinstance(fine, np.ndarray):
        finest = plainest * PURE_NOISE_FRACTION / UNIFORM_FRACTION
        variance = min(
            variance, np.quantile(fine, finest) * FINE_FREEDOM / chi2.ppf(finest, FINE_FREEDOM)
        )
    return float(variance)


def _is_demosaiced(colours: Light, inside: Mask) -> bool:
    """Return True if one colour-filter site is smoother than the others in uniform blocks."""
    if colours.shape[2] == 1:
        return False
    whole = blocks_of(inside).all(axis=(2, 3))
    for plane in np.moveaxis(colours, -1, 0):
        detail = plane - cv2.blur(plane, (3, 3))
        size = (blocks_of(detail)[whole] ** 2).reshape(-1, BLOCK // 2, 2, BLOCK // 2, 2)
        if len(size) < MIN_BLOCKS:
            return False
        total = size.sum(axis=(1, 2, 3, 4))
        sites = size[total <= np.quantile(total, 0.25)].mean(axis=(0, 1, 3))
        if sites.max() <= SITES**2 * sites.min():
            return False
    return True
