"""Sharpness of an image: isolated edges and texture, which limit the blur that it can contain."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.colour import linear_from_srgb
from ...base.typing import Array, Mask
from .blur_model import BlurSize, RadialBlur
from .noise import Noise

# -- Isolated edges --------------------------------------------------------------------------------

Values = NDArray[np.float32]

MIN_STEP, MIN_STEP_OF_NOISE = 0.08, 8.0  # between adjacent pixels: of full scale, and of the noise
FLATNESS = 0.08  # range of the values beyond an isolated edge, relative to the step
MIN_EDGE_DISTANCE_PX, MAX_EDGE_DISTANCE_PX = 4, 7  # px from the edge in which they are compared
COMPARED_SAMPLES = slice(MIN_EDGE_DISTANCE_PX - 1, MAX_EDGE_DISTANCE_PX)


class IsolatedEdges(NamedTuple):
    """Isolated edges across the rows of an image."""

    row: NDArray[np.intp]
    """Rows (n,)."""
    column: NDArray[np.intp]
    """Columns (n,) of the pixels before the edges."""
    sign: Values
    """1 for rising edges, -1 for falling edges (n,)."""
    before: Values
    """Values (n, 7) before the edges, outwards, multiplied by the sign."""
    beyond: Values
    """Values (n, 7) beyond the edges, outwards, multiplied by the sign."""

    @property
    def step(self) -> Values:
        """Difference (n,) of the values 3 px from the edge."""
        return np.asarray(np.maximum(self.beyond[:, 2] - self.before[:, 2], np.float32(1e-3)))

    def select(self, mask: Mask) -> IsolatedEdges:
        """Return some of the edges."""
        row, column, sign, before, beyond = self
        return IsolatedEdges(row[mask], column[mask], sign[mask], before[mask], beyond[mask])

    def sides(self, image: Values) -> tuple[Values, Values]:
        """Return the values (n, 7) of an image before and beyond the edges, as above."""
        positions = self.column[:, None] + np.arange(
            1 - MAX_EDGE_DISTANCE_PX, MAX_EDGE_DISTANCE_PX + 1
        )
        profile = self.sign[:, None] * image[self.row[:, None], positions]
        return profile[:, :MAX_EDGE_DISTANCE_PX][:, ::-1], profile[:, MAX_EDGE_DISTANCE_PX:]


def isolated_edges(image: Values, inside: Mask, noise: float = 0.0) -> IsolatedEdges:
    """Return the edges between plateaus across the rows of an image.

    Parameters
    ----------
    image : (h, w)
        sRGB values as a fraction of full scale.
    inside : (h, w)
        Mask of valid pixels.
    noise
        Standard deviation as a fraction of full scale; steps must exceed it.

    Examples
    --------
    >>> image = np.tile(np.repeat(np.float32([0.3, 0.6]), 10), (60, 1))
    >>> edges = isolated_edges(image, np.ones(image.shape, bool))
    >>> len(edges.row), int(edges.column[0]), round(float(edges.step[0]), 2)
    (60, 9, 0.3)
    """
    reach = MAX_EDGE_DISTANCE_PX + 1
    rise = np.ascontiguousarray(np.diff(image, axis=1))
    steep = np.abs(rise)
    is_edge = (steep > max(MIN_STEP, MIN_STEP_OF_NOISE * noise)) & inside[:, 1:]
    is_edge &= steep >= cv2.dilate(steep, np.ones((1, 7), np.uint8))
    is_edge[:, :reach] = is_edge[:, -reach:] = False
    row, column = np.nonzero(is_edge)
    none = np.zeros((0, MAX_EDGE_DISTANCE_PX), np.float32)
    edges = IsolatedEdges(row, column, np.sign(rise[row, column]), none, none)
    edges = IsolatedEdges(*edges[:3], *edges.sides(image))
    ranges = [np.ptp(side[:, COMPARED_SAMPLES], axis=1) for side in (edges.before, edges.beyond)]
    return edges.select(np.maximum(*ranges) < FLATNESS * edges.step)


# -- Overshoot at edges, an indicator of sharpened images ------------------------------------------
#
# Blur makes an isolated edge rise monotonically; an unsharp mask adds a brighter and a darker line
# next to it. Restoration would amplify these lines, and the noise or texture amplified by sharpening.

# Maximum median overshoot of coded images without sharpening, relative to the step. Ringing of the coding adds to it
# in proportion to the coding error: measured are -0.02 to 0.004 at an error of 0.01, and up to 0.03 at 0.07. Images
# sharpened by an amount of 0.3 have 0.009 to 0.015 at 0.01; with a large coding error, sharpening does no harm.
MAX_OVERSHOOT, MAX_OVERSHOOT_OF_ERROR = 0.002, 0.7
# Overshoot above which a coded image was certainly sharpened: absolute, and relative to the maximum
SHARPENED_OVERSHOOT, SHARPENED_RATIO = 0.016, 1.25
MAX_OVERSHOOT_UNCODED = 0.06  # same for uncoded images, which are rarely sharpened
MIN_SIDES = 30


def overshoot(image: Values, inside: Mask, noise: float = 0.0) -> float:
    """Return the median overshoot at isolated edges relative to their step; NaN if there are too
    few.

    Parameters
    ----------
    image, inside, noise
        As for :func:`isolated_edges`.

    Examples
    --------
    >>> edges = np.tile(np.repeat(np.float32([0.3, 0.6]), 10), (60, 4))
    >>> everywhere = np.ones(edges.shape, bool)
    >>> round(overshoot(edges, everywhere), 2)
    0.0
    >>> sharpened = edges + 0.6 * (edges - cv2.GaussianBlur(edges, (0, 0), 1.5))
    >>> overshoot(sharpened, everywhere) > max(overshoot_limits(0.01, is_coded=True))
    True
    """
    values = []
    for turned in ((image, inside), (image.T, inside.T)):
        edges = isolated_edges(*turned, noise)
        before, beyond = edges.before, edges.beyond
        top = np.maximum(beyond[:, 1], beyond[:, 2]) - beyond[:, -2:].mean(axis=1)
        bottom = before[:, -2:].mean(axis=1) - np.minimum(before[:, 1], before[:, 2])
        values += [top / edges.step, bottom / edges.step]
    overshoots = np.concatenate(values)
    return float(np.median(overshoots)) if len(overshoots) >= MIN_SIDES else float("nan")


def overshoot_limits(noise: float, *, is_coded: bool) -> tuple[float, float]:
    """Return the overshoots above which an image may have been sharpened, and was sharpened, from
    its noise or coding error as a fraction of full scale.

    >>> overshoot_limits(0.01, is_coded=True), overshoot_limits(0.01, is_coded=False)
    ((0.009, 0.016), (0.06, 0.06))
    """
    if not is_coded:
        return MAX_OVERSHOOT_UNCODED, MAX_OVERSHOOT_UNCODED
    doubtful = MAX_OVERSHOOT + MAX_OVERSHOOT_OF_ERROR * noise
    return doubtful, max(SHARPENED_OVERSHOOT, SHARPENED_RATIO * doubtful)


# -- Upper limit of the blur from the steepness of edges and from the fineness of texture ----------
#
# Edges: between adjacent pixels, a step edge blurred by a disc of diameter d rises by at most the
# fraction F(d) of its height, the maximum of the line-spread function of disc and pixel:
#   F(d) = int 8 / (pi d^2) sqrt(d^2 / 4 - x^2) max(0, 1 - |x|) dx
# Edges that are steeper than F(d) prove a smaller blur. Edges of the scene may be soft, and most do
# not lie between two pixels; therefore a high quantile of the edges determines the blur.
#
# Texture: for power inversely proportional to the squared frequency, as in most photographs, blur
# reduces the mean squared difference of adjacent pixels, D1, relative to that of second neighbours, D2.

MIN_EDGES = 30
MIN_EDGES_OF_LARGE = 20
ZONES, MIN_EDGES_OF_ZONE = 5, 12  # one near object, in better focus, is not the image
EDGE_QUANTILE = 0.85
MIN_WIDTH_PX, LARGE_WIDTH_PX, MAX_WIDTH_PX = 0.9, 1.5, 8.0  # across edges; the large ones precede
MIN_LIMIT_OF_SMALL = 0.6  # smaller fractions of small blur are indistinguishable from no blur
MAX_RISE = 1.1  # of the step: larger rises belong to lines
MIN_COSINE = 0.9  # cosine of the angle between the edge normal and the row
SATURATED = 0.97
MIN_TEXTURE_WIDTH_PX = 0.8
SECTOR = (
    0.4  # tangent of the half angle about the rows and columns where they are principal directions
)
MIN_TEXTURE_PIXELS = 500
MIN_TEXTURE_OF_NOISE = 0.3  # fraction of the mean squared difference of second neighbours
FRACTIONS = np.arange(0.0, 1.31, 0.05)


def blur_limit(
    image: Values, blur: RadialBlur, sizes: BlurSize, noise: Noise
) -> tuple[float, float]:
    """Return the largest fractions of a known blur that are consistent with the edges and with the
    texture of an image; NaN without edges or texture, and 1.3 if the limit is larger.

    Parameters
    ----------
    image : (h, w) or (h, w, channels)
        sRGB values as a fraction of full scale.
    blur, sizes
        Known blur, and its diameters (h, w).
    noise
        Noise of the image.
    """
    colours = image if image.ndim == 3 else image[..., None]
    grey = np.ascontiguousarray(colours.mean(axis=2), dtype=np.float32)
    light = np.ascontiguousarray(linear_from_srgb(colours).mean(axis=2), dtype=np.float32)
    radius = blur.radius
    inside = (radius < blur.whole_radius_px) & (colours.max(axis=2) < SATURATED)
    deviation = 0.0 if noise.kind == "JPEG" else noise.fraction
    edges = _edge_rises(grey, light, inside, blur, sizes, deviation)
    inside &= radius < blur.whole_radius_px - 2
    variance = deviation**2 / colours.shape[2]
    return _limit_of_edges(*edges), _limit_of_texture(grey, inside, blur, sizes, variance)


def _edge_rises(
    grey: Values, light: Values, inside: Mask, blur: RadialBlur, sizes: BlurSize, noise: float
) -> tuple[Array, Array, Array]:
    """Return the largest relative rises (n,) of edges between adjacent pixels, in linear light, the
    widths (n,) of the known blur across them, px along the row or column, and their radii (n,)
    relative to the image circle.
    """
    radial = blur.offsets / (blur.radius[..., None] + 1e-9)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *order, ksize=5) for order in ((1, 0), (0, 1))]
    selected_edges: list[list[Array]] = []
    radius = blur.radius / blur.whole_radius_px
    for axis in (1, 0):

        def turned(values: NDArray[Any], axis: int = axis) -> NDArray[Any]:
            return values if axis else values.T

        edges = isolated_edges(turned(grey), turned(inside), noise)
        before, beyond = edges.sides(np.asarray(turned(light), np.float32))
        step = beyond[:, COMPARED_SAMPLES].mean(axis=1) - before[:, COMPARED_SAMPLES].mean(axis=1)
        rise = (beyond[:, 0] - before[:, 0]) / np.maximum(step, 1e-4)
        at = edges.row, edges.column
        beside = edges.row, edges.column + 1
        normal = np.stack([turned(slope)[at] + turned(slope)[beside] for slope in slopes])
        normal /= np.hypot(*normal) + 1e-9
        outwards = np.stack([turned(radial[..., k])[at] for k in (0, 1)])
        along = (normal * outwards).sum(axis=0)
        across = normal[1] * outwards[0] - normal[0] * outwards[1]
        tangential, sagittal = (turned(size)[at] for size in sizes)
        cosine = np.abs(normal[0 if axis else 1])
        width = np.hypot(tangential * along, sagittal * across) / np.maximum(cosine, 0.1)
        high = edges.beyond[:, COMPARED_SAMPLES].mean(axis=1) - edges.before[
            :, COMPARED_SAMPLES
        ].mean(axis=1)
        bright = np.maximum(np.abs(edges.before).max(axis=1), np.abs(edges.beyond).max(axis=1))
        usable = (
            (cosine > MIN_COSINE)
            & (rise < MAX_RISE)
            & (bright < SATURATED)
            & (high >= max(MIN_STEP, MIN_STEP_OF_NOISE * noise))
        )
        selected_edges.append([a[usable] for a in (rise, width, turned(radius)[at])])
    rises, widths, radii = (np.concatenate(parts) for parts in zip(*selected_edges, strict=True))
    return rises, widths, radii


def _limit_of_edges(rises: Array, widths: Array, radii: Array) -> float:
    """Return the median limit of the radial zones with enough edges, or that of all edges."""
    usable = (widths >= MIN_WIDTH_PX) & (widths < MAX_WIDTH_PX)
    large = usable & (widths >= LARGE_WIDTH_PX)
    min_limit = 0.0
    if large.sum() >= MIN_EDGES_OF_LARGE:
        usable = large
    elif usable.sum() >= MIN_EDGES:
        min_limit = MIN_LIMIT_OF_SMALL
    else:
        return float("nan")
    diameters, steepest = _steepest_rise()

    def limit_of(edges: Mask) -> float:
        excess = rises[edges] - [
            np.interp(s * widths[edges], diameters, steepest) for s in FRACTIONS
        ]
        return _first_positive(np.quantile(excess, EDGE_QUANTILE, axis=1))

    zone = np.minimum(ZONES * radii, ZONES - 1).astype(int)
    zones = [usable & (zone == k) for k in range(ZONES)]
    zones = [edges for edges in zones if edges.sum() >= MIN_EDGES_OF_ZONE]
    limits = [limit_of(edges) for edges in zones or [usable]]
    limit = float(np.quantile(limits, 0.5, method="higher"))
    return limit if limit >= min_limit else 0.0


@lru_cache(maxsize=1)
def _steepest_rise() -> tuple[Array, Array]:
    """Return diameters (n,) px and the largest rise F of a blurred edge between adjacent pixels.

    >>> diameters, rises = _steepest_rise()
    >>> np.interp([0.0, 2.0, 4.0], diameters, rises).round(2)
    array([1.  , 0.58, 0.31])
    """
    diameters = np.linspace(0, MAX_WIDTH_PX * FRACTIONS[-1], 105)
    x = np.linspace(-1, 1, 2001)[:, None]
    # Fraction of the disc beyond a chord at the distance x: the integral of its line-spread function
    ratio = np.clip(2 * x / np.maximum(diameters, 1e-6), -1, 1)
    spread = 0.5 + (ratio * np.sqrt(1 - ratio**2) + np.arcsin(ratio)) / np.pi
    # Integration by parts: int LSF(x) (1 - |x|) dx = int ESF(x) sign(x) dx over -1 to 1
    return diameters, np.asarray(np.trapezoid(spread * np.sign(x), x, axis=0))


def _limit_of_texture(
    grey: Values, inside: Mask, blur: RadialBlur, sizes: BlurSize, variance: float
) -> float:
    across, down = np.abs(blur.offsets[..., 0]), np.abs(blur.offsets[..., 1])
    columns: list[list[Array]] = []
    for axis in (1, 0):
        mine = [grey, inside, across, down, *sizes]
        image, usable, x, y, tangential, sagittal = mine if axis else [v.T for v in mine]
        if not axis:
            x, y = y, x
        is_radial, is_across = y < SECTOR * x, x < SECTOR * y
        parallel = np.where(is_radial, tangential, np.where(is_across, sagittal, 0.0))[:, 1:-1]
        perpendicular = np.where(is_radial, sagittal, tangential)[:, 1:-1]
        usable = usable[:, 2:] & usable[:, 1:-1] & usable[:, :-2]
        usable &= parallel >= MIN_TEXTURE_WIDTH_PX
        first = (image[:, 2:] - image[:, 1:-1]) ** 2
        second = (image[:, 2:] - image[:, :-2]) ** 2
        columns.append([a[usable] for a in (first, second, parallel, perpendicular)])
    first, second, parallel, perpendicular = (
        np.concatenate(parts) for parts in zip(*columns, strict=True)
    )
    if len(first) < MIN_TEXTURE_PIXELS:
        return float("nan")
    # Sums over classes of equal blur
    steps = round(WIDEST_PX / CLASS_PX)
    index = [
        np.minimum(np.rint(w / CLASS_PX), steps).astype(int) for w in (parallel, perpendicular)
    ]
    label = index[0] * (steps + 1) + index[1]
    noise = 2 * variance * len(first)
    if second.sum() < (1 + MIN_TEXTURE_OF_NOISE) * noise:
        return float("nan")
    sums = [
        np.bincount(label, values - 2 * variance, (steps + 1) ** 2) for values in (first, second)
    ]
    used = np.flatnonzero(np.bincount(label))
    widths = CLASS_PX * np.stack([used // (steps + 1), used % (steps + 1)])
    excess = [
        float((sums[0][used] - _difference_ratio(s * widths) * sums[1][used]).sum())
        for s in FRACTIONS
    ]
    return _first_positive(excess)


CLASS_PX, WIDEST_PX = 0.25, 12.0


def _difference_ratio(widths: Array) -> Array:
    """Return D1 / D2 of texture blurred by ellipses of widths (2, n) px along and across."""
    position = np.minimum(widths, WIDEST_PX) / TABLE_STEP_PX
    low = np.minimum(position.astype(int), len(_ratio_table()) - 2)
    rest = position - low
    table, (i, j), (u, v) = _ratio_table(), low, rest
    ratio: Array = (1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1]) + u * (
        (1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]
    )
    return ratio


TABLE_STEP_PX, FREQUENCIES = 0.5, 48


@lru_cache(maxsize=1)
def _ratio_table() -> Array:
    """Return D1 / D2 (n, n) for widths in steps of 0.5 px, from the spectrum 1 / f^2, the transfer
    functions of pixel and ellipse, and ``D_k = int P(f) (1 - cos 2 pi k f_x) df``.
    """
    from scipy.special import j1

    widths = np.arange(0, WIDEST_PX + TABLE_STEP_PX, TABLE_STEP_PX)
    f = (np.arange(FREQUENCIES) + 0.5) / (2 * FREQUENCIES)
    fx, fy = f[:, None], f[None]
    power = (np.sinc(fx) * np.sinc(fy)) ** 2 / (fx**2 + fy**2)
    z = np.pi * np.hypot(widths[:, None, None, None] * fx, widths[None, :, None, None] * fy) + 1e-9
    blurred = power * (2 * j1(z) / z) ** 2
    first, second = ((blurred * (1 - np.cos(2 * np.pi * k * fx))).sum(axis=(2, 3)) for k in (1, 2))
    ratio: Array = first / second
    return ratio


def _first_positive(excess: Sequence[float] | Array) -> float:
    positive = np.flatnonzero(np.asarray(excess) >= 0)
    return float(FRACTIONS[positive[0]] if len(positive) else FRACTIONS[-1])
