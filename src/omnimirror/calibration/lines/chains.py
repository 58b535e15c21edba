"""Edge chains with subpixel accuracy, long and smooth enough to be images of straight edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import number
from ...base.typing import Array, Mask
from ..rim.edges import levels_of

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
BLUR_PX = 1.2
LEAST_CONTRAST = 2.5  # grey levels per px; minimum contrast of traced edges
BAND = 1 << 22  # pixels that are filtered at once
HALO, BESIDE = 16, 2  # rows around a band for filters, and around a pixel along its gradient
STRONG = 2.0  # multiple of that, required at one point of each edge
DEGREE = 5  # of the reference curves; the image of a straight edge is not more complex
ROUGH_PX, WORST_PX = 0.35, 1.2  # rms and maximum distance of a chain from its curve
STEP_PX = 2.0  # between retained points: neighbouring points are redundant
LEAST_SHARE = 0.06  # fraction of the field's radius; minimum length of a chain
EDGE_PX = 4.0  # minimum distance from the rim, whose edge does not belong to the scene
NEIGHBOURS = [(-1, 0), (0, -1), (0, 1), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)]  # 4-connected first
FORK = 5  # neighbours of a pixel at a junction; on stairs each has four
REACH, CORNER_DEG = 6, 25.0  # edge points to either side, and change of direction at a corner


def edge_chains(
    picture: NDArray[Any],
    *,
    centre_px: tuple[float, float] | None = None,
    radius_px: float | None = None,
    inner_radius_px: float = 0.0,
    least_length_px: float | None = None,
) -> list[Array]:
    """Return chains of edge points (n, 2) px of an image.

    Parameters
    ----------
    picture : (height, width, 3) or (height, width)
        RGB image of any depth; opacity is ignored.
    centre_px, radius_px
        Circle of the field; edges at its rim and outside are ignored. By default the largest circle
        in the image.
    inner_radius_px
        Radius of the camera's own image.
    least_length_px
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
    levels = levels_of(picture)
    height, width = levels.shape[:2]
    u, v = centre_px or ((width - 1) / 2, (height - 1) / 2)
    radius = min(width, height) / 2 if radius_px is None else number("radius_px", radius_px, above=0.0)
    least = max(LEAST_SHARE * radius, 12.0) if least_length_px is None else least_length_px
    is_edge, points = _edges(levels)
    rows, columns = np.nonzero(is_edge)
    places = rows * width + columns
    away = np.hypot(columns - u, rows - v)
    outside = (away > radius - EDGE_PX) | (away < inner_radius_px + EDGE_PX)
    is_edge[rows[outside], columns[outside]] = False
    found: list[Array] = []
    for path in _paths(is_edge):
        for piece in _between_corners(points[np.searchsorted(places, path[:, 0] * width + path[:, 1])]):
            found += _smooth_parts(piece, least)
    return sorted((_thinned(chain) for chain in found), key=len, reverse=True)


def _edges(levels: NDArray[Any]) -> tuple[Mask, Array]:
    """Return the mask (h, w) of thin edges, and their subpixel positions (n, 2).

    Positions are in row order. Processing in bands of rows limits memory use for large images.
    """
    import cv2

    height, width = levels.shape[:2]
    tall = max(BAND // width, HALO)
    bands = [slice(first, min(first + tall, height)) for first in range(0, height, tall)]
    steps = [np.empty((height, width), np.int16) for _ in range(2)]
    for band in bands:
        for step, slope in zip(steps, _slopes(levels, band), strict=True):
            step[band] = np.clip(16 * slope, -32767, 32767)
    low, high = 16 * LEAST_CONTRAST, 16 * LEAST_CONTRAST * STRONG
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
    return dx[inside], dy[inside]  # type: ignore[return-value]  # OpenCV does not say of what


def _ridge(levels: NDArray[Any], is_edge: Mask, band: slice) -> Array:
    """Return the subpixel positions (n, 2) px of edges in a range of rows."""
    first = max(band.start - BESIDE, 0)
    dx, dy = _slopes(levels, slice(first, min(band.stop + BESIDE, len(levels))))
    size = np.hypot(dx, dy)
    rows, columns = np.nonzero(is_edge[band])
    rows = rows + band.start - first
    here = size[rows, columns]
    along = np.stack([dx[rows, columns], dy[rows, columns]]) / np.where(here > 0, here, 1.0)
    before, after = (_between(size, columns + s * along[0], rows + s * along[1]) for s in (-1.0, 1.0))
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
    between: Array = upper * (1 - fy) + lower * fy
    return between


def _paths(is_edge: Mask) -> list[NDArray[np.int64]]:
    """Return edge pixels (n, 2), row and column, in order along lines that end at junctions."""
    height, width = is_edge.shape
    padded = np.pad(is_edge, 1).astype(np.int8)
    count = sum(padded[1 + r : 1 + r + height, 1 + c : 1 + c + width] for r, c in NEIGHBOURS)
    left = {(int(r), int(c)) for r, c in np.argwhere(is_edge & (count < FORK))}
    paths = []
    while left:
        start = left.pop()
        ends = []
        for _ in range(2):  # in one direction, then in the other
            way, at = [], start
            while True:
                near = ((at[0] + r, at[1] + c) for r, c in NEIGHBOURS)
                following = next((p for p in near if p in left), None)
                if following is None:
                    break
                left.discard(following)
                way.append(following)
                at = following
            ends.append(way)
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
    for begin, end in edges.reshape(-1, 2):
        cuts.append(int(begin + turn[begin:end].argmax()) + REACH)
    return [points[a + (a > 0) : b] for a, b in zip(cuts, [*cuts[1:], len(points)], strict=True)]


def _smooth_parts(points: Array, least: float) -> list[Array]:
    """Return the pieces of a chain that are smooth curves, split at corners; others are dropped."""
    if len(points) < least / np.sqrt(2):
        return []
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    if length[-1] < least:
        return []
    t = 2 * length / length[-1] - 1
    basis = np.polynomial.legendre.legvander(t, DEGREE)
    coefficients, *_ = np.linalg.lstsq(basis, points, rcond=None)
    off = np.hypot(*(basis @ coefficients - points).T)
    if np.sqrt((off**2).mean()) <= ROUGH_PX and off.max() <= WORST_PX:
        return [points]
    margin = max(3, len(points) // 10)
    cut = margin + int(off[margin:-margin].argmax()) if len(points) > 2 * margin else len(points) // 2
    return _smooth_parts(points[:cut], least) + _smooth_parts(points[cut + 1 :], least)


def _thinned(points: Array) -> Array:
    """Return points at a spacing of about two pixels."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    kept: Array = points[np.unique(np.searchsorted(length, np.arange(0.0, length[-1], STEP_PX)))]
    return kept
