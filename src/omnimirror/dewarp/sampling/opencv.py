"""The samplers without anything compiled: OpenCV's, held to the rule of :mod:`omnimirror.dewarp.sampling.remapping`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...cameras import Mask, inside_image
from .footprints import JUMP2, JUMP2_PX, Averages, Ring

Image = NDArray[Any]
Coordinates = NDArray[np.float32] | NDArray[np.float64]
Pixels = NDArray[Any]

FLAGS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
LONGEST_SIDE_PX = 32_766  # cv2.remap counts pixels in 16 bits
BAND_PX = 1 << 17  # output pixels averaged at a time
LIST_WIDTH_PX = 1024  # in which samples in no order are laid out for OpenCV


def remap_opencv(
    image: Image, coordinates: Coordinates, kind: str, border: tuple[float, ...], averages: Averages | None = None
) -> Image:
    """Values (rows, columns, channels) of a picture (h, w, channels) at coordinates, all checked before."""
    if averages is not None:
        return _averaged(image, coordinates, averages, border)
    rows, columns = coordinates.shape[:2]
    out = np.empty((rows, columns, image.shape[2]), image.dtype)
    for top in range(0, rows, LONGEST_SIDE_PX):
        for left in range(0, columns, LONGEST_SIDE_PX):
            tile = slice(top, top + LONGEST_SIDE_PX), slice(left, left + LONGEST_SIDE_PX)
            pixels: Pixels = coordinates[tile].astype(np.float32)
            inside: Mask = inside_image(pixels, (image.shape[1], image.shape[0]))
            pixels[~inside] = 0
            taken = _values(image, pixels, kind)
            taken[~inside] = border
            out[tile] = taken
    return out


def _values(image: Image, pixels: Pixels, kind: str) -> Image:
    """At pixels (rows, columns, 2) on the picture."""
    height, width, channels = image.shape
    if channels == 2:  # of these OpenCV takes fractions to 1/32 only
        return np.concatenate([_values(part, pixels, kind) for part in np.split(image, 2, axis=2)], axis=2)
    x, y = pixels[..., 0].clip(0, width - 1), pixels[..., 1].clip(0, height - 1)
    if kind == "nearest":  # OpenCV's versions differ in what they make of halves
        x, y = np.floor(x + 0.5), np.floor(y + 0.5)
    taken = cv2.remap(image, x, y, FLAGS[kind], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken).reshape(*x.shape, channels)


# -- averages --------------------------------------------------------------------------------------


def _averaged(image: Image, coordinates: Coordinates, averages: Averages, border: tuple[float, ...]) -> Image:
    """Means over footprints, some rows at a time; see native/src/footprint.hpp, which this follows."""
    picture = image.astype(np.float32)
    rows, columns = coordinates.shape[:2]
    out = np.empty((rows, columns, image.shape[2]), image.dtype)
    step = averages.step
    band = max(step, BAND_PX // columns // step * step)
    for top in range(0, rows, band):
        bottom = min(top + band, rows)
        around = _neighbourhood(coordinates, (image.shape[1], image.shape[0]), top, bottom)
        cells = averages.taps[top // step : -(-bottom // step)]
        taps = cells.repeat(step, axis=0).repeat(step, axis=1)[: bottom - top, :columns]
        out[top:bottom] = _band(picture, around, taps, averages, border, image.dtype)
    return out


def _neighbourhood(coordinates: Coordinates, size: tuple[int, int], top: int, bottom: int) -> Pixels:
    """Coordinates of some rows, and of one pixel more on all sides; NaN outside the picture."""
    first, last = max(top - 1, 0), min(bottom + 1, len(coordinates))
    pixels: Pixels = coordinates[first:last].astype(np.float32)
    pixels[~inside_image(pixels, size)] = np.nan
    return _continued(_continued(pixels, 1, True, True), 0, first == top, last == bottom)


def _continued(pixels: Pixels, axis: int, before: bool, behind: bool) -> Pixels:
    """With one more at the ends of an axis, in a straight line."""
    ends = []
    for end, next_one, wanted in ((0, 1, before), (-1, -2, behind)):
        last = pixels.take([end], axis)
        ends.append([2 * last - pixels.take([next_one], axis) if pixels.shape[axis] > 1 else last] * wanted)
    return np.concatenate([*ends[0], pixels, *ends[1]], axis)


def _band(
    picture: Image,
    around: Pixels,
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
        out[chosen] = _means(picture, middle[chosen], places, averages.ring)
    if dtype == np.float32:
        return out
    return np.floor(out + np.float32(0.5)).clip(0, np.iinfo(dtype).max).astype(dtype)


def _sides(middle: Pixels, before: Pixels, behind: Pixels, averages: Averages) -> list[Pixels]:
    """Ways (.., 2) to the neighbours on one axis, shortened as :class:`~.footprints.Rule` says."""
    ways = before - middle, behind - middle
    squares = [(way**2).sum(axis=-1) for way in ways]
    with np.errstate(invalid="ignore"):
        missing = [np.isnan(s) | (s > JUMP2 * o + JUMP2_PX) for s, o in (squares, squares[::-1])]
    none = missing[0] & missing[1]
    if averages.ring is None:
        none |= np.isnan(squares[0]) | np.isnan(squares[1])
    sides = []
    for is_missing, way, opposite in zip(missing, ways, ways[::-1], strict=True):
        side = np.where(is_missing[..., None], -opposite, way)
        side[none] = 0
        sides.append(side * _share((side**2).sum(axis=-1), averages.sharp_px)[..., None])
    return sides


def _share(square: Pixels, sharp_px: float) -> Pixels:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(square > sharp_px**2, 1 - (sharp_px**2 / square) ** 4, 0).astype(np.float32)


def _part(i: int, count: int, sides: list[Pixels]) -> Pixels:
    """Of the way to the neighbour before or behind."""
    t = np.float32((i + 0.5) / count - 0.5)
    return abs(t) * sides[0 if t < 0 else 1]


def _means(picture: Image, middle: Pixels, places: Iterable[Pixels], ring: Ring | None) -> Image:
    """Means (n, channels) of the taps that are inside; where there are none, the value in the middle (n, 2)."""
    sums, counts = np.zeros((len(middle), picture.shape[2]), np.float32), np.zeros(len(middle), np.float32)
    for pixels in places:
        if ring is not None:
            square = ((pixels - np.array(ring[:2], np.float32)) ** 2).sum(axis=-1)
            pixels[~((square >= ring.least**2) & (square <= ring.most**2))] = np.nan
        values, seen = _listed(picture, pixels)
        sums += values
        counts += seen
    lonely = counts == 0
    sums[lonely] = _listed(picture, middle[lonely])[0]
    means: Image = sums / np.maximum(counts, 1)[:, None]
    return means


def _listed(picture: Image, pixels: Pixels) -> tuple[Image, Mask]:
    """Cubic samples (n, channels) at pixels (n, 2) in no order, 0 outside; and which are inside."""
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
