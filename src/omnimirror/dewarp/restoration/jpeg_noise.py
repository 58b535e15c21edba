"""The error that coding as JPEG made, from the decoded picture and the steps of its coefficients.

What was coded is the cosine transform of blocks of 8 x 8, rounded to multiples of a step. A coefficient that is not
zero errs evenly within its step; one that is zero was smaller than half a step, and how much smaller says the law of
Laplace that coefficients follow (Lam and Goodman, 2000), whose width is known from the share of zeros. Where nearly all
are zero the widths of other frequencies tell, which fall by a power of the frequency. Blocks are taken by how much they
hold, since plain and busy ones differ.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...io.pictures.jpeg import BLOCK, JpegCoding

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GROUPS = 6  # of blocks
MOSTLY_ZERO = 0.97  # share from which a frequency tells less of itself than the others do
POWERS, WIDTHS = np.linspace(0.5, 3, 11), np.geomspace(0.02, 400, 60)
SHARED = 0.1  # how much all groups together count in the power of each
SHADES = (1.0, (0.344136**2 + 1.772**2) / 3, (1.402**2 + 0.714136**2) / 3)
"""What a square error of Y, Cb and Cr is worth in the mean of red, green and blue."""
FINE = np.add.outer(np.arange(BLOCK), np.arange(BLOCK)) >= BLOCK  # coefficients of fine detail
PLAINEST, LEAST_PLAIN = 0.05, 10  # share of the blocks, and number, whose fine detail tells of noise
DEVIATIONS, UNLIKELY = np.geomspace(0.3, 40, 80), 2.0  # of noise, 0 to 255; logarithm by which one is less likely
FOLDED = 2.0  # colours coarser than pixels lose what is finer, and as much folds into what is left
HELD = 2.0  # as much detail colours had before they were made coarser, and finer again, as is left of it
WHOLE = 0.999  # mean of a mask where all of it counts

STEPS, LOWEST = np.arange(2, 121), 9  # steps that are looked for in a picture, and up to which frequency
STEPPED, LEAST_COUNT, LEAST_FOUND, MOST_BLOCKS = 0.7, 20, 4, 2000
STANDARD = np.array(
    [
        [[16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55], [14, 13, 16, 24, 40, 57, 69, 56],
         [14, 17, 22, 29, 51, 87, 80, 62], [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
         [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99]],
        [[17, 18, 24, 47, 99, 99, 99, 99], [18, 21, 26, 66, 99, 99, 99, 99], [24, 26, 56, 99, 99, 99, 99, 99],
         [47, 66, 99, 99, 99, 99, 99, 99], *[[99] * 8] * 4],
    ]
)  # fmt: skip
"""Steps of Y, and of Cb and Cr, at quality 50 (T.81, Annex K)."""


def _cosines() -> Array:
    k = np.arange(BLOCK)
    basis = np.sqrt(2 / BLOCK) * np.cos(np.pi * (2 * k[None] + 1) * k[:, None] / (2 * BLOCK))
    basis[0] = np.sqrt(1 / BLOCK)
    return np.asarray(basis)


def _frequencies(side: int) -> Array:
    found = np.hypot(*np.meshgrid(np.arange(side), np.arange(side)))
    found[0, 0] = 0.5
    return np.asarray(found)


COSINES, FREQUENCY, FINER = _cosines(), _frequencies(BLOCK), _frequencies(2 * BLOCK)
FINER = FINER[np.maximum(*np.indices(FINER.shape)) >= BLOCK]


def error_of(colours: Array, coding: JpegCoding, inside: Mask) -> float:
    """Mean square error against what was coded, from 0 to 255 as the picture is.

    Parameters
    ----------
    colours : (h, w, 1 or 3)
        The decoded picture, 0 to 255.
    coding
    inside : (h, w)
        Pixels that count; blocks do that lie wholly among them.
    """
    planes = [colours[..., 0]] if colours.shape[2] == 1 else _shades(colours)
    total = 0.0
    for n, (plane, table) in enumerate(zip(planes, coding.tables, strict=False)):
        coarser = coding.coarser if n else (1, 1)
        held, counted = _binned(plane, coarser), _binned(inside.astype(float), coarser)
        whole = blocks_of(counted > WHOLE).all(axis=(2, 3))
        if whole.any():
            error, folded = _error_of_plane(coefficients_of(held)[whole], table)
            total += SHADES[n] * error
            if coarser != (1, 1):
                total += SHADES[n] * max(folded, _lost_in_coarser(held, counted) * (np.array(coarser) > 1).mean())
    return total


def most_noise(colours: Array, coding: JpegCoding, inside: Mask) -> float:
    """The most variance of white noise that coding can have left, from 0 to 255 as the picture is.

    Fine detail of the plainest blocks tells how much there can have been, by how many coefficients are not zero: what
    looks like noise by the coarser ones, and shows no more than that, is texture. It is left in those not zero alone.

    Parameters
    ----------
    colours : (h, w, 1 or 3)
        The decoded picture, 0 to 255.
    coding
    inside : (h, w)
        Pixels that count; blocks do that lie wholly among them.
    """
    from scipy.special import erfc

    plane = colours[..., 0] if colours.shape[2] == 1 else _shades(colours)[0]
    blocks = coefficients_of(plane)[blocks_of(inside).all(axis=(2, 3))]
    if not len(blocks):
        return np.inf
    held = np.abs(blocks) >= coding.tables[0] / 2
    coarse = (blocks**2)[:, ~FINE][:, 1:].sum(axis=1)  # noise of which is another than that of fine detail
    plainest = np.argsort(coarse, kind="stable")[: max(LEAST_PLAIN, round(PLAINEST * len(blocks)))]
    half, counts = coding.tables[0][FINE] / 2, held[:, FINE][plainest].sum(axis=0)
    likely = np.clip(erfc(half / (np.sqrt(2) * DEVIATIONS[:, None])), 1e-300, 1 - 1e-12)
    likelihood = (counts * np.log(likely) + (len(plainest) - counts) * np.log1p(-likely)).sum(axis=1)
    most = DEVIATIONS[likelihood > likelihood.max() - UNLIKELY].max()
    return float(most**2 * held.mean())


def detected_coding(picture: NDArray[np.uint8], inside: Mask) -> JpegCoding | None:
    """The coding that a picture went through, from the steps of its lowest frequencies; None if it shows none.

    The picture must lie on the grid of its blocks, as whole pictures do. Its quality is that of the standard's tables
    whose steps come nearest, colours being taken for half as fine as pixels.
    """
    colours = picture[..., None] if picture.ndim == 2 else picture[..., :3]
    y = (colours[..., 0] if colours.shape[2] == 1 else _shades(colours)[0]).astype(float)
    if min(y.shape) < BLOCK:
        return None
    blocks = coefficients_of(y)[blocks_of(inside).all(axis=(2, 3))]
    blocks = blocks[:: max(1, len(blocks) // MOST_BLOCKS)]
    found = {}
    for row, column in zip(*np.nonzero(np.add.outer(np.arange(BLOCK), np.arange(BLOCK)) <= LOWEST), strict=True):
        if row + column and (step := _step_of(np.abs(blocks[:, row, column]))):
            found[row, column] = step
    if len(found) < LEAST_FOUND:
        return None
    places, steps = tuple(np.array(list(found)).T), np.array(list(found.values()))
    misses = [np.abs(np.log(standard_tables(q)[0][places] / steps)).mean() for q in range(1, 101)]
    tables = standard_tables(1 + int(np.argmin(misses)))
    return JpegCoding(tables[:1]) if colours.shape[2] == 1 else JpegCoding((*tables, tables[1]), (2, 2))


def standard_tables(quality: int) -> tuple[Array, Array]:
    """Steps of Y, and of Cb and Cr, at a quality of 1 to 100, as the Independent JPEG Group scales the standard's."""
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    y, colours = np.clip((STANDARD * scale + 50) // 100, 1, 255).astype(float)
    return y, colours


def blocks_of(plane: NDArray[Any]) -> NDArray[Any]:
    """The blocks (rows, columns, 8, 8) of a plane; what is left over at its ends is left out."""
    rows, columns = (side // BLOCK for side in plane.shape)
    return plane[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2)


def coefficients_of(plane: Array) -> Array:
    """The cosine transform (rows, columns, 8, 8) of the blocks of a plane."""
    coefficients: Array = COSINES @ blocks_of(plane) @ COSINES.T
    return coefficients


def _binned(plane: Array, by: tuple[int, int]) -> Array:
    """Means of so many pixels down and right."""
    rows, columns = (side // n for side, n in zip(plane.shape, by, strict=True))
    if by == (1, 1):
        return plane
    means: Array = plane[: rows * by[0], : columns * by[1]].reshape(rows, by[0], columns, by[1]).mean(axis=(1, 3))
    return means


def _shades(colours: NDArray[Any]) -> list[Array]:
    """Y, Cb and Cr (ITU-R BT.601, as JFIF has it)."""
    red, green, blue = np.moveaxis(colours.astype(float), -1, 0)
    y = 0.299 * red + 0.587 * green + 0.114 * blue
    return [y, (blue - y) / 1.772, (red - y) / 1.402]


def _step_of(sizes: Array) -> int:
    """The largest step of which the sizes (n,) of a coefficient are multiples; 0 if there is none."""
    for step in STEPS[::-1]:
        counted = sizes[sizes > step / 2]
        if len(counted) >= LEAST_COUNT and np.cos(2 * np.pi / step * counted).mean() > STEPPED:
            return int(step)
    return 0


def _lost_in_coarser(plane: Array, inside: Array) -> float:
    """Mean square of what is lost of Cb or Cr where they are coarser than pixels, from what is held of them.

    As much as is lost where they are made coarser once more, on the way from there to what is lost the next time: edges
    and textures lose by the same ratio each time.
    """
    lost = []
    for _ in range(2):
        coarser = _binned(plane, (2, 2))
        rows, columns = (2 * side for side in coarser.shape)
        here = inside[:rows, :columns] > WHOLE
        if not here.any():
            return 0.0
        again = cv2.resize(coarser, (columns, rows), interpolation=cv2.INTER_LINEAR)
        lost.append(float(((plane[:rows, :columns] - again)[here] ** 2).mean()))
        plane, inside = coarser, _binned(inside, (2, 2))
    return HELD * lost[0] * min(1.0, lost[0] / max(lost[1], 1e-9))


def _error_of_plane(coefficients: Array, table: Array) -> tuple[float, float]:
    """Mean square errors of Y, Cb or Cr from the coefficients (n, 8, 8) of blocks: of them, and of finer ones."""
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
        # a mean of four has a quarter of their power; Laplace's is twice the width squared
        of_finer = ((WIDTHS[width] * FINER ** -POWERS[power]) ** 2).sum() / (2 * BLOCK) ** 2
        finer += FOLDED * 4 * 2 * of_finer * len(group)
    return float(total / len(zero)), float(finer / len(zero))


def _likelihoods(zero: Mask, table: Array) -> Array:
    """Logarithms (powers, widths) of how likely the zeros (n, 8, 8) of some blocks are; the mean does not count."""
    counted = FREQUENCY >= 1
    zeros = zero.sum(axis=0)[counted]
    found = np.empty((len(POWERS), len(WIDTHS)))
    for i, power in enumerate(POWERS):
        half = np.maximum(table[counted] / 2 * FREQUENCY[counted] ** power / WIDTHS[:, None], 1e-9)
        found[i] = (zeros * np.log(-np.expm1(-half)) - (len(zero) - zeros) * half).sum(axis=1)
    return found


def _error_of_zeros(share: Array, count: int, law: Array, table: Array) -> Array:
    """Mean square errors (8, 8), from the share of zeros of each coefficient in so many blocks."""
    half = table / 2
    own = -half / np.log1p(-np.clip(share, 1e-3, 1 - 0.5 / count))
    width = np.where(share < MOSTLY_ZERO, own, np.minimum(own, law))
    x = half / width
    small = half**2 / 3  # x much below 1: even within the step
    with np.errstate(invalid="ignore", divide="ignore"):
        below = (2 * width**2 - np.exp(-x) * (half**2 + 2 * half * width + 2 * width**2)) / -np.expm1(-x)
    error: Array = (1 - share) * table**2 / 12 + share * np.where(x < 1e-2, small, below)
    return error
