"""OpenCV sampler without compiled module, consistent with :mod:`omnimirror.dewarp.sampling`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.typing import Mask
from ...cameras.camera import inside_image
from ..contracts import Annulus, Averages, Image, Pixels, RemapJob
from .footprints import JUMP2, JUMP2_PX

Values = NDArray[Any]

FLAGS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
LONGEST_SIDE_PX = 32_766  # cv2.remap indexes pixels with 16 bits
BAND_PX = 1 << 17  # output pixels averaged per band
LIST_WIDTH_PX = 1024  # row width of scattered samples arranged for OpenCV


def remap_opencv(job: RemapJob, where: Pixels) -> None:
    """Fill the output of a job with the values at coordinates (rows, columns, 2)."""
    if job.averages is not None:
        _average(job, where, job.averages)
        return
    rows, columns = where.shape[:2]
    for top in range(0, rows, LONGEST_SIDE_PX):
        for left in range(0, columns, LONGEST_SIDE_PX):
            tile = slice(top, top + LONGEST_SIDE_PX), slice(left, left + LONGEST_SIDE_PX)
            pixels: Values = where[tile].astype(np.float32)
            inside: Mask = inside_image(pixels, (job.source.shape[1], job.source.shape[0]))
            pixels[~inside] = 0
            taken = _values(job.source, pixels, job.kernel)
            taken[~inside] = job.border
            job.target[tile] = taken


def _values(image: Image, pixels: Values, kernel: str) -> Image:
    """Return the values at pixels (rows, columns, 2) inside the image."""
    height, width, channels = image.shape
    if channels == 2:  # OpenCV quantises their fractions to 1/32
        return np.concatenate([_values(part, pixels, kernel) for part in np.split(image, 2, axis=2)], axis=2)
    x, y = pixels[..., 0].clip(0, width - 1), pixels[..., 1].clip(0, height - 1)
    if kernel == "nearest":  # OpenCV versions round halves differently
        x, y = np.floor(x + 0.5), np.floor(y + 0.5)
    taken = cv2.remap(image, x, y, FLAGS[kernel], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken).reshape(*x.shape, channels)


# -- averages --------------------------------------------------------------------------------------


def _average(job: RemapJob, where: Pixels, averages: Averages) -> None:
    """Compute means over footprints in bands of rows, identical to
    native/src/sampling/footprint.hpp.
    """
    picture = job.source.astype(np.float32)
    rows, columns = where.shape[:2]
    step = averages.step
    band = max(step, BAND_PX // columns // step * step)
    for top in range(0, rows, band):
        bottom = min(top + band, rows)
        around = _neighbourhood(where, (picture.shape[1], picture.shape[0]), top, bottom)
        cells = averages.taps[top // step : -(-bottom // step)]
        taps = cells.repeat(step, axis=0).repeat(step, axis=1)[: bottom - top, :columns]
        job.target[top:bottom] = _band(picture, around, taps, averages, job.border, job.target.dtype)


def _neighbourhood(where: Pixels, size: tuple[int, int], top: int, bottom: int) -> Values:
    """Return coordinates of some rows with a margin of one pixel; NaN outside the image."""
    first, last = max(top - 1, 0), min(bottom + 1, len(where))
    pixels: Values = where[first:last].astype(np.float32)
    pixels[~inside_image(pixels, size)] = np.nan
    return _continued(_continued(pixels, 1, True, True), 0, first == top, last == bottom)


def _continued(pixels: Values, axis: int, before: bool, behind: bool) -> Values:
    """Extrapolate linearly by one pixel at the ends of an axis."""
    ends = []
    for end, next_one, wanted in ((0, 1, before), (-1, -2, behind)):
        last = pixels.take([end], axis)
        ends.append([2 * last - pixels.take([next_one], axis) if pixels.shape[axis] > 1 else last] * wanted)
    return np.concatenate([*ends[0], pixels, *ends[1]], axis)


def _band(
    picture: Image,
    around: Values,
    taps: NDArray[np.uint8],
    averages: Averages,
    border: tuple[float, ...],
    dtype: Any,
) -> Image:
    middle = around[1:-1, 1:-1]
    out = np.empty((*middle.shape[:2], picture.shape[2]), np.float32)
    out[:] = border
    aside = _sides(middle, around[1:-1, :-2], around[1:-1, 2:], averages)
    upright = _sides(middle, around[:-2, 1:-1], around[2:, 1:-1], averages)
    inside = np.isfinite(middle[..., 0])
    for across, down in np.unique(taps[inside], axis=0):
        chosen = inside & (taps == (across, down)).all(axis=-1)
        places = (
            middle[chosen] + _part(i, across, [s[chosen] for s in aside]) + _part(j, down, [s[chosen] for s in upright])
            for i in range(across)
            for j in range(down)
        )
        out[chosen] = _means(picture, middle[chosen], places, averages.annulus)
    if dtype == np.float32:
        return out
    return np.floor(out + np.float32(0.5)).clip(0, np.iinfo(dtype).max).astype(dtype)


def _sides(middle: Values, before: Values, behind: Values, averages: Averages) -> list[Values]:
    """Return vectors (..., 2) to the neighbours on one axis, shortened as in
    :class:`~.footprints.Rule`.
    """
    ways = before - middle, behind - middle
    squares = [(way**2).sum(axis=-1) for way in ways]
    with np.errstate(invalid="ignore"):
        missing = [np.isnan(s) | (s > JUMP2 * o + JUMP2_PX) for s, o in (squares, squares[::-1])]
    none = missing[0] & missing[1]
    if averages.annulus is None:
        none |= np.isnan(squares[0]) | np.isnan(squares[1])
    sides = []
    for is_missing, way, opposite in zip(missing, ways, ways[::-1], strict=True):
        side = np.where(is_missing[..., None], -opposite, way)
        side[none] = 0
        sides.append(side * _share((side**2).sum(axis=-1), averages.sharp_px)[..., None])
    return sides


def _share(square: Values, sharp_px: float) -> Values:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(square > sharp_px**2, 1 - (sharp_px**2 / square) ** 4, 0).astype(np.float32)


def _part(i: int, count: int, sides: list[Values]) -> Values:
    """Return the offset of sample i as a fraction of the vector to the previous or next neighbour."""
    t = np.float32((i + 0.5) / count - 0.5)
    return abs(t) * sides[0 if t < 0 else 1]


def _means(picture: Image, middle: Values, places: Iterable[Values], annulus: Annulus | None) -> Image:
    """Return means (n, channels) of the samples inside; without any, the value at the centre
    (n, 2).
    """
    sums, counts = np.zeros((len(middle), picture.shape[2]), np.float32), np.zeros(len(middle), np.float32)
    for pixels in places:
        if annulus is not None:
            square = ((pixels - np.array(annulus[:2], np.float32)) ** 2).sum(axis=-1)
            pixels[~((square >= annulus.inner**2) & (square <= annulus.outer**2))] = np.nan
        values, seen = _listed(picture, pixels)
        sums += values
        counts += seen
    lonely = counts == 0
    sums[lonely] = _listed(picture, middle[lonely])[0]
    means: Image = sums / np.maximum(counts, 1)[:, None]
    return means


def _listed(picture: Image, pixels: Values) -> tuple[Image, Mask]:
    """Return cubic samples (n, channels) at scattered pixels (n, 2), 0 outside, and the mask of
    those inside.
    """
    inside: Mask = inside_image(pixels, (picture.shape[1], picture.shape[0]))
    rows = -(-len(pixels) // LIST_WIDTH_PX)
    laid_out = np.zeros((rows * LIST_WIDTH_PX, 2), np.float32)
    laid_out[: len(pixels)][inside] = pixels[inside]
    if not rows:
        return np.zeros((0, picture.shape[2]), np.float32), inside
    values = _values(picture, laid_out.reshape(rows, LIST_WIDTH_PX, 2), "cubic")
    values = values.reshape(-1, picture.shape[2])[: len(pixels)]
    values[~inside] = 0
    return values, inside
