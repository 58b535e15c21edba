"""Edge detection with subpixel accuracy and direction, and chains of edge points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import number
from ..base.typing import Array, Mask

# -- Edge points -----------------------------------------------------------------------------------

Image = NDArray[np.float32]

SHORT_SIDE_PX, FINER_PX = 360, 800
SMOOTHING_PX = 1.0
MIN_STEP = 3.0  # levels of 255 per px; minimum step of an edge
NOISE_TIMES, NOISE_ROWS = 4.0, 3  # multiple of the noise, estimated from every third row
FULL_WEIGHT_STEP = 15.0  # levels per px; edges with larger steps have full weight
MAX_EDGES, CROWD_PX = 16_000, 25  # maximum number; excess edges are removed where they are dense


@dataclass(frozen=True)
class EdgePoints:
    """Edges of an image at working size."""

    points: Array
    """Edge positions (n, 2) px, (u, v)."""
    normals: Array
    """Unit normals (n, 2) towards the brighter side."""
    steps: Array
    """Steps (n,) in levels per px, of the steepest channel."""
    weights: Array
    """Weights (n,) from 0 to 1."""

    def subset(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> EdgePoints:
        """Return the edges selected by a mask (n,) or by indices."""
        return EdgePoints(
            self.points[chosen], self.normals[chosen], self.steps[chosen], self.weights[chosen]
        )


@dataclass(frozen=True)
class WorkingImage:
    """Image at working size."""

    image: Image
    """Levels (rows, columns, channels) from 0 to 255."""
    scale: float
    """Number of pixels of the original image per pixel; at least 1."""
    noise: float
    """Standard deviation of the gradient in uniform regions, levels per px."""

    @property
    def size(self) -> tuple[int, int]:
        """Image size (width, height)."""
        return self.image.shape[1], self.image.shape[0]


def at_working_size(source: NDArray[Any], short_side_px: int = SHORT_SIDE_PX) -> WorkingImage:
    """Return an image (rows, columns[, channels]) of any type, with a limit on its short side."""
    import cv2

    levels = levels_of(source)
    height, width = levels.shape[:2]
    scale = max(1.0, min(height, width) / short_side_px)
    if scale > 1:
        size = max(1, round(width / scale)), max(1, round(height / scale))
        levels = cv2.resize(levels, size, interpolation=cv2.INTER_AREA)
    image = levels.astype(np.float32).reshape(*levels.shape[:2], -1)
    smooth: Image = cv2.GaussianBlur(image, (0, 0), SMOOTHING_PX).reshape(image.shape)  # type: ignore[assignment]  # stub of cv2 returns any dtype
    return WorkingImage(smooth, scale, _noise(smooth))


def edges_of(working: WorkingImage) -> EdgePoints:
    """Return the edges of an image at working size: maxima of the gradient of the steepest channel."""
    import cv2

    gx, gy, step = steepest(working.image)
    rows, columns = np.indices(step.shape, dtype=np.float32)
    safe = np.maximum(step, 1e-6)
    nx, ny = gx / safe, gy / safe
    ahead = cv2.remap(step, columns + nx, rows + ny, cv2.INTER_LINEAR)
    behind = cv2.remap(step, columns - nx, rows - ny, cv2.INTER_LINEAR)
    min_step = max(MIN_STEP, NOISE_TIMES * working.noise)
    is_edge = (step > min_step) & (step >= ahead) & (step > behind)
    is_edge[:2], is_edge[-2:], is_edge[:, :2], is_edge[:, -2:] = False, False, False, False
    if is_edge.sum() > MAX_EDGES:
        # relative to nearby edges: a strong pattern in one region must not suppress the rim in
        # another
        relative_step = step / (
            cv2.blur(np.where(is_edge, step, np.float32(0.0)), (CROWD_PX, CROWD_PX))
            + np.float32(MIN_STEP)
        )
        is_edge &= relative_step >= np.partition(relative_step[is_edge], -MAX_EDGES)[-MAX_EDGES]
    v, u = np.nonzero(is_edge)
    before, here, after = behind[v, u], step[v, u], ahead[v, u]
    offset = np.clip(
        (after - before) / np.maximum(2 * (2 * here - before - after), 1e-6), -0.5, 0.5
    )
    normals = np.stack([nx[v, u], ny[v, u]], axis=1).astype(float)
    points = np.stack([u, v], axis=1) + offset[:, None] * normals
    return EdgePoints(
        points, normals, here.astype(float), np.minimum(here / FULL_WEIGHT_STEP, 1.0).astype(float)
    )


def steepest(image: Image) -> tuple[Image, Image, Image]:
    """Return the gradient (right, down) and its length in levels per px, from the steepest channel."""
    import cv2

    gx: Any = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32).reshape(image.shape)
    gy: Any = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32).reshape(image.shape)
    length = gx * gx + gy * gy
    max_square, x, y = length[..., 0], gx[..., 0], gy[..., 0]
    for k in range(1, image.shape[2]):
        is_steeper = length[..., k] > max_square
        max_square, x, y = (
            np.where(is_steeper, a[..., k], b) for a, b in ((length, max_square), (gx, x), (gy, y))
        )
    return x, y, np.sqrt(max_square)


def strongest(channels: Image) -> Image:
    """Return the maximum (rows, columns) over the channels of each pixel (rows, columns, channels)."""
    maximum = channels[..., 0]
    for k in range(1, channels.shape[-1]):
        maximum = np.maximum(maximum, channels[..., k])
    return maximum


def levels_of(source: NDArray[Any]) -> NDArray[Any]:
    """Return an image with 255 levels without opacity.

    The brightest 1 % of linear light is clipped.
    """
    if source.ndim == 3 and source.shape[2] in (2, 4):
        source = source[..., :-1]
    if source.dtype == np.uint8:
        return source
    if source.dtype == np.uint16:
        return (source / 257.0).astype(np.float32)
    values: Image = np.nan_to_num(source.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(values, 99)), 1e-12)
    levels: Image = 255 * np.sqrt(np.clip(values / white, 0, 1))
    return levels


def _noise(smooth: Image) -> float:
    """Return the noise from second differences, whose median is insensitive to edges."""
    if min(smooth.shape[:2]) < 5:
        return 0.0
    rows = smooth[2:-2:NOISE_ROWS]
    second = rows[:, 4:] - 2 * rows[:, 2:-2] + rows[:, :-4]
    deviation = float(np.median(np.abs(second), axis=(0, 1)).max()) / 0.6745  # robust estimate
    return deviation / float(np.sqrt(6)) / 2


@lru_cache(maxsize=8)
def revolution_angles(count: int) -> Array:
    """Return angles (count,) over one revolution."""
    angles: Array = np.arange(float(count)) * (2 * np.pi / count)
    return angles


# -- Edge chains -----------------------------------------------------------------------------------

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
BLUR_PX = 1.2
MIN_CONTRAST = 2.5  # grey levels per px; minimum contrast of traced edges
BAND = 1 << 22  # pixels that are filtered at once
HALO, BESIDE = 16, 2  # rows around a band for filters, and around a pixel along its gradient
STRONG = 2.0  # multiple of MIN_CONTRAST, required at one point of each edge
DEGREE = 5  # degree of the reference curves; the image of a straight edge is not more complex
ROUGH_PX, WORST_PX = 0.35, 1.2  # rms and maximum distance of a chain from its curve
STEP_PX = 2.0  # between retained points: neighbouring points are redundant
MIN_LENGTH = 0.06  # fraction of the field's radius; minimum length of a chain
EDGE_PX = 4.0  # minimum distance from the rim, whose edge does not belong to the scene
NEIGHBOURS = [
    (-1, 0),
    (0, -1),
    (0, 1),
    (1, 0),
    (-1, -1),
    (-1, 1),
    (1, -1),
    (1, 1),
]  # 4-connected first
FORK = 5  # neighbours of a pixel at a junction; on stairs each has four
REACH, CORNER_DEG = 6, 25.0  # edge points to either side, and change of direction at a corner


def edge_chains(
    image: NDArray[Any],
    *,
    centre_px: tuple[float, float] | None = None,
    radius_px: float | None = None,
    inner_radius_px: float = 0.0,
    min_length_px: float | None = None,
) -> list[Array]:
    """Return chains of edge points (n, 2) px of an image.

    Parameters
    ----------
    image : (height, width, 3) or (height, width)
        RGB image of any depth; opacity is ignored.
    centre_px, radius_px
        Circle of the field; edges at its rim and outside are ignored. By default the largest circle
        in the image.
    inner_radius_px
        Radius of the camera's own image.
    min_length_px
        Minimum length of a chain; by default 6 % of the radius.

    Returns
    -------
    list of (n, 2) arrays
        Chains, longest first.

    Examples
    --------
    >>> picture = np.zeros((200, 200), np.uint8)
    >>> picture[:, 90:] = 200
    >>> (chain,) = edge_chains(picture)
    >>> float(chain[:, 0].round(1).min()), float(chain[:, 0].round(1).max())
    (89.5, 89.5)
    """
    levels = levels_of(image)
    height, width = levels.shape[:2]
    u, v = centre_px or ((width - 1) / 2, (height - 1) / 2)
    radius = (
        min(width, height) / 2 if radius_px is None else number("radius_px", radius_px, above=0.0)
    )
    min_length = max(MIN_LENGTH * radius, 12.0) if min_length_px is None else min_length_px
    is_edge, points = _traced_edges(levels)
    rows, columns = np.nonzero(is_edge)
    indices = rows * width + columns
    distances = np.hypot(columns - u, rows - v)
    outside = (distances > radius - EDGE_PX) | (distances < inner_radius_px + EDGE_PX)
    is_edge[rows[outside], columns[outside]] = False
    chains: list[Array] = []
    for path in _paths(is_edge):
        for piece in _between_corners(
            points[np.searchsorted(indices, path[:, 0] * width + path[:, 1])]
        ):
            chains += _smooth_parts(piece, min_length)
    return sorted((_thinned(chain) for chain in chains), key=len, reverse=True)


def _traced_edges(levels: NDArray[Any]) -> tuple[Mask, Array]:
    """Return the mask (h, w) of thin edges, and their subpixel positions (n, 2).

    Positions are in row order. Processing in bands of rows limits memory use for large images.
    """
    import cv2

    height, width = levels.shape[:2]
    band_height = max(BAND // width, HALO)
    bands = [
        slice(first, min(first + band_height, height)) for first in range(0, height, band_height)
    ]
    steps = [np.empty((height, width), np.int16) for _ in range(2)]
    for band in bands:
        for step, slope in zip(steps, _slopes(levels, band), strict=True):
            step[band] = np.clip(16 * slope, -32767, 32767)
    low, high = 16 * MIN_CONTRAST, 16 * MIN_CONTRAST * STRONG
    is_edge: Mask = cv2.Canny(steps[0], steps[1], low, high, L2gradient=True) > 0
    return is_edge, np.concatenate([_ridge(levels, is_edge, band) for band in bands])


def _slopes(levels: NDArray[Any], rows: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the gradient (right, down) of smoothed grey levels in a range of rows.

    The result equals that for the whole image.
    """
    import cv2

    first = max(rows.start - HALO, 0)
    part = levels[first : rows.stop + HALO].astype(np.float32)
    grey = part @ LUMA if part.ndim == 3 and part.shape[2] == 3 else part.reshape(part.shape[:2])
    smooth = cv2.GaussianBlur(grey, (0, 0), BLUR_PX)
    dx, dy = (cv2.Scharr(smooth, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
    inside = slice(rows.start - first, rows.stop - first)
    return dx[inside], dy[inside]  # type: ignore[return-value]  # the stubs of OpenCV do not specify the type


def _ridge(levels: NDArray[Any], is_edge: Mask, band: slice) -> Array:
    """Return the subpixel positions (n, 2) px of edges in a range of rows."""
    first = max(band.start - BESIDE, 0)
    dx, dy = _slopes(levels, slice(first, min(band.stop + BESIDE, len(levels))))
    size = np.hypot(dx, dy)
    rows, columns = np.nonzero(is_edge[band])
    rows = rows + band.start - first
    here = size[rows, columns]
    along = np.stack([dx[rows, columns], dy[rows, columns]]) / np.where(here > 0, here, 1.0)
    before, after = (
        _between(size, columns + s * along[0], rows + s * along[1]) for s in (-1.0, 1.0)
    )
    bend = before - 2 * here + after
    offset = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1.0), 0.0)
    offset = np.clip(offset, -0.7, 0.7)
    return np.stack([columns + offset * along[0], rows + first + offset * along[1]], axis=-1)


def _between(values: NDArray[np.float32], x: Array, y: Array) -> Array:
    """Return bilinear interpolations (n,) of pixel values."""
    height, width = values.shape
    c, r = (np.clip(np.floor(a).astype(int), 0, size - 2) for a, size in ((x, width), (y, height)))
    fx, fy = x - c, y - r
    upper = values[r, c] * (1 - fx) + values[r, c + 1] * fx
    lower = values[r + 1, c] * (1 - fx) + values[r + 1, c + 1] * fx
    interpolated: Array = upper * (1 - fy) + lower * fy
    return interpolated


def _paths(is_edge: Mask) -> list[NDArray[np.int64]]:
    """Return edge pixels (n, 2), row and column, in order along lines that end at junctions."""
    height, width = is_edge.shape
    padded = np.pad(is_edge, 1).astype(np.int8)
    count = sum(padded[1 + r : 1 + r + height, 1 + c : 1 + c + width] for r, c in NEIGHBOURS)
    unvisited = {(int(r), int(c)) for r, c in np.argwhere(is_edge & (count < FORK))}
    paths = []
    while unvisited:
        start = unvisited.pop()
        ends = []
        for _ in range(2):  # in one direction, then in the other
            pixels_in_direction, at = [], start
            while True:
                neighbours = ((at[0] + r, at[1] + c) for r, c in NEIGHBOURS)
                following = next((p for p in neighbours if p in unvisited), None)
                if following is None:
                    break
                unvisited.discard(following)
                pixels_in_direction.append(following)
                at = following
            ends.append(pixels_in_direction)
        paths.append(np.array([*ends[1][::-1], start, *ends[0]]))
    return paths


def _between_corners(points: Array) -> list[Array]:
    """Return the pieces (n, 2) of a line between sharp corners."""
    if len(points) <= 2 * REACH + 1:
        return [points]
    steps = points[REACH:] - points[:-REACH]
    angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turn = np.degrees(np.abs(angle[REACH:] - angle[:-REACH]))  # for points REACH to -REACH
    cuts, sharp = [0], turn > CORNER_DEG
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sharp, [False]]).astype(int)))
    for start, end in edges.reshape(-1, 2):
        cuts.append(int(start + turn[start:end].argmax()) + REACH)
    return [points[a + (a > 0) : b] for a, b in zip(cuts, [*cuts[1:], len(points)], strict=True)]


def _smooth_parts(points: Array, min_length: float) -> list[Array]:
    """Return the pieces of a chain that are smooth curves, split at corners; others are dropped."""
    if len(points) < min_length / np.sqrt(2):
        return []
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    if length[-1] < min_length:
        return []
    t = 2 * length / length[-1] - 1
    basis = np.polynomial.legendre.legvander(t, DEGREE)
    coefficients, *_ = np.linalg.lstsq(basis, points, rcond=None)
    residuals = np.hypot(*(basis @ coefficients - points).T)
    if np.sqrt((residuals**2).mean()) <= ROUGH_PX and residuals.max() <= WORST_PX:
        return [points]
    margin = max(3, len(points) // 10)
    cut = (
        margin + int(residuals[margin:-margin].argmax())
        if len(points) > 2 * margin
        else len(points) // 2
    )
    return _smooth_parts(points[:cut], min_length) + _smooth_parts(points[cut + 1 :], min_length)


def _thinned(points: Array) -> Array:
    """Return points at a spacing of about two pixels."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    thinned: Array = points[np.unique(np.searchsorted(length, np.arange(0.0, length[-1], STEP_PX)))]
    return thinned
