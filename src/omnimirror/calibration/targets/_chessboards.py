"""Chessboard detection in distorted images: seeds of four squares, and lattice growth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.numerics import matrix_product
from ...base.typing import Array
from ._corner_refinement import fit_saddles, maps_about
from ._image_preparation import bytes_of, scaled, scales, unscaled_px, upwards
from ._lattice_growth import (
    CHECKER,
    LatticePart,
    coloured,
    from_grid,
    goes_on,
    grown,
    is_bounded,
    trimmed,
)
from .boards import Board

# -- Seeds -----------------------------------------------------------------------------------------

Grey = NDArray[np.float32]

BLUR_PX = 1.5  # blur before the derivatives
MAX_CANDIDATES = 1500  # maximum number of corner candidates
MIN_RESPONSE = 0.02  # relative to the strong responses
RING_PX = 4.5
MIN_RING = 0.6  # minimum correlation of the ring with four alternating quarters
MAX_SEEDS_FOUND = 200
MIN_OF_SEED = 7  # minimum number of the nine corners that the image confirms


class Crossings(NamedTuple):
    """Crossings of two white and two black quarters."""

    pixels: Array
    """Pixels (m, 2)."""
    angles: Array
    """Angle (m,) of the first edge clockwise from the centre of a white quarter, radians."""


def crossings(image: Grey) -> Crossings:
    """Return saddle points with four alternating dark and light quarters around them.

    The strength of a saddle is the negative determinant of the second derivatives.
    """
    import cv2

    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_PX), np.float32)
    xx, yy = cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1)
    strength = xy * xy - xx * yy
    peak = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 0)
    peak[:6], peak[-6:], peak[:, :6], peak[:, -6:] = False, False, False, False
    v, u = np.nonzero(peak)
    if not len(u):
        return Crossings(np.empty((0, 2)), np.empty(0))
    order = np.argsort(-strength[v, u], kind="stable")[:MAX_CANDIDATES]
    strongest = strength[v, u][order[min(len(order) - 1, 20)]]
    order = order[strength[v, u][order] > MIN_RESPONSE * strongest]
    pixels = np.stack([u[order], v[order]], axis=1).astype(float)
    angles, likeness = _ring(smooth, pixels)
    is_corner = likeness > MIN_RING
    return Crossings(pixels[is_corner], angles[is_corner])


def _ring(image: Grey, pixels: Array) -> tuple[Array, Array]:
    """Return the phase of the second harmonic on a ring around each pixel, and its power fraction."""
    import cv2

    azimuth = 2 * np.pi * np.arange(24) / 24
    ring = pixels[:, None] + RING_PX * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    positions = ring.astype(np.float32)
    values = cv2.remap(image, positions[..., 0], positions[..., 1], cv2.INTER_LINEAR).astype(float)
    values -= values.mean(axis=1, keepdims=True)
    even, odd = matrix_product(
        values, np.stack([np.cos(2 * azimuth), -np.sin(2 * azimuth)], axis=1)
    ).T / len(azimuth)
    power = 2 * (even * even + odd * odd)
    # for sharp edges the second harmonic holds 8 / pi^2 of the power
    return -np.arctan2(odd, even) / 2, power / np.maximum(np.mean(values**2, axis=1), 1e-9)


def find_seeds(image: Grey) -> list[LatticePart]:
    """Find sets of nine crossings in a 3 x 3 arrangement, most regular first."""
    corners = crossings(image)
    if len(corners.pixels) < 9:
        return []
    from scipy.spatial import cKDTree

    tree = cKDTree(corners.pixels)
    nearest = tree.query(corners.pixels, k=min(14, len(corners.pixels)))[1]
    nines = [
        nine
        for i in range(len(corners.pixels))
        if (nine := _nine(corners, tree, nearest[i])) is not None
    ]
    seeds: list[LatticePart] = []
    used_indices: set[int] = set()
    for _, indices in sorted(nines, key=lambda nine: nine[0]):
        if used_indices & set(indices.tolist()):
            continue
        used_indices |= set(indices.tolist())
        grid = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2]), axis=-1).reshape(-1, 2)
        part = coloured(image, grid, corners.pixels[indices])
        if len(part.places) >= MIN_OF_SEED:
            seeds.append(part)
        if len(seeds) == MAX_SEEDS_FOUND:
            break
    return seeds


def _nine(
    corners: Crossings, tree: Any, neighbours: NDArray[np.int_]
) -> tuple[float, NDArray[np.int_]] | None:
    """Return a crossing and its eight neighbours in board order, and their irregularity."""
    middle, others = neighbours[0], neighbours[1:]
    offsets = corners.pixels[others] - corners.pixels[middle]
    # a neighbour along an edge has exchanged colours: a phase difference of 90 deg
    quarter = np.abs(np.cos(corners.angles[others] - corners.angles[middle])) < 0.6
    others, offsets = others[quarter], offsets[quarter]
    if len(others) < 4:
        return None
    azimuth = np.arctan2(offsets[:, 1], offsets[:, 0])
    cross = []
    for k in range(4):
        edge = corners.angles[middle] + np.pi / 4 + k * np.pi / 2
        off = np.abs(np.angle(np.exp(1j * (azimuth - edge))))
        along = np.flatnonzero(off < 0.6)
        if not len(along):
            return None
        cross.append(int(others[along[0]]))
    if len(set(cross)) < 4:
        return None
    right, down, left, up = (corners.pixels[i] for i in cross)
    centre = corners.pixels[middle]
    expected = np.array(
        [left + up - centre, right + up - centre, left + down - centre, right + down - centre]
    )
    size = min(np.linalg.norm(right - left), np.linalg.norm(down - up)) / 2
    off, diagonal = tree.query(expected)
    asymmetry = max(
        np.linalg.norm(right + left - 2 * centre), np.linalg.norm(up + down - 2 * centre)
    )
    if size < 3 or off.max() > 0.4 * size or asymmetry > 0.6 * size:
        return None
    a, b, c, d = (int(i) for i in diagonal)
    indices = np.array([a, cross[3], b, cross[2], int(middle), cross[0], c, cross[1], d])
    if len(set(indices.tolist())) < 9:
        return None
    return float((off.max() + asymmetry) / size), indices


# -- Chessboard detection --------------------------------------------------------------------------

MIN_COMPLETE_FRACTION = 0.9
"""Minimum fraction of the corners of a lattice."""
MIN_PART = 9  # minimum number of corners of a lattice
MAX_SEEDS_ONE_BOARD, MAX_SEEDS_SEVERAL_BOARDS = (
    12,
    200,
)  # maximum number of seeds to grow, for one board and for several
MAX_REFLECTED = 2  # maximum number of columns or rows that reflections add
LARGEST_FOR_OPENCV = 2_500_000  # px; OpenCV's detectors are slow on larger images


def find_chessboard(image: Grey, board: Board, *, is_quick: bool = False) -> LatticePart | None:
    """Return the lattice that matches the board, otherwise the one with the most corners.

    Parameters
    ----------
    image : (height, width)
        Greyscale image, 0 to 255.
    board
        Chessboard.
    is_quick
        Search at one image size only and without OpenCV's detectors.
    """
    best: LatticePart | None = None
    for part in _grown_parts(image, find_seeds(image)) if is_quick else _parts(image, board):
        for candidate in (part, *inner_grids(part, board)):
            if is_whole(candidate, board) and not goes_on(image, candidate):
                return candidate
        if best is None or _merit(part, board) > _merit(best, board):
            best = part
    return best


def _merit(part: LatticePart, board: Board) -> tuple[bool, int]:
    """Return a sort key of lattices.

    Those that cover at least 0.5 of the board without excess are preferred, then larger ones.
    """
    is_half = not is_larger(part, board) and 2 * len(part.places) >= board.corner_count
    return is_half, len(part.places)


def inner_grids(part: LatticePart, board: Board) -> Iterator[LatticePart]:
    """Yield subgrids of the board's size in a lattice with up to two additional columns or rows.

    Reflections in a frame may continue the squares by a row, which then joins the lattice.
    """
    low, size = part.places.min(axis=0), np.array(part.size)
    for grid_size in {board.lattice_size, board.lattice_size[::-1]}:
        excess = size - grid_size
        if not (excess.min() >= 0 and 0 < excess.max() <= MAX_REFLECTED):
            continue
        for column, row in np.ndindex(excess[0] + 1, excess[1] + 1):
            first = low + np.array([column, row])
            yield part.subset(
                np.all((part.places >= first) & (part.places < first + grid_size), axis=1)
            )


def find_chessboards(image: Grey, board: Board) -> list[LatticePart]:
    """Return all lattices in the image that match the board.

    Parameters
    ----------
    image : (height, width)
        Greyscale image, 0 to 255.
    board
        Chessboard.
    """
    for scale in scales(image.shape):
        smaller = scaled(image, scale)
        parts = _grown_parts(smaller, find_seeds(smaller), max_seeds=MAX_SEEDS_SEVERAL_BOARDS)
        complete = [part for part in parts if is_whole(part, board) and not goes_on(smaller, part)]
        if complete:
            return [_at_full_size(image, part, scale) for part in complete]
    return []


def is_whole(part: LatticePart, board: Board) -> bool:
    """Return whether a lattice has the size of the board and nearly all of its corners.

    >>> nine = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2]), axis=-1).reshape(-1, 2)
    >>> is_whole(LatticePart(nine, 10.0 * nine, -1), Board("chessboard", 3, 3))
    True
    """
    return (
        sorted(part.size) == sorted(board.lattice_size)
        and len(part.places) >= MIN_COMPLETE_FRACTION * board.corner_count
    )


def is_larger(part: LatticePart, board: Board) -> bool:
    """Check whether a lattice has more columns or rows than the board."""
    size, board_size = sorted(part.size), sorted(board.lattice_size)
    return size[0] > board_size[0] or size[1] > board_size[1]


def _is_filled(part: LatticePart) -> bool:
    """Check whether a lattice has nearly all corners of its columns and rows."""
    return len(part.places) >= MIN_COMPLETE_FRACTION * part.size[0] * part.size[1]


def _parts(image: Grey, board: Board) -> Iterator[LatticePart]:
    """Yield lattices in pixels of the full image.

    Lattices larger than the board are not grown again at other image sizes.
    """
    has_seeds, is_complete, max_corners, other_corners = False, False, 0, np.empty((0, 2))
    for scale in scales(image.shape):
        smaller = scaled(image, scale)
        seeds = find_seeds(smaller)
        has_seeds |= bool(seeds)
        for part in _grown_parts(smaller, seeds, used_corners=(other_corners + 0.5) * scale - 0.5):
            max_corners = max(max_corners, len(part.places))
            full_size_part = _at_full_size(image, part, scale)
            if _is_filled(part) and is_larger(part, board):
                other_corners = np.concatenate([other_corners, full_size_part.pixels])
            elif _is_filled(part) and len(part.places) > board.corner_count / 2:
                is_complete |= is_bounded(smaller, part)
            yield full_size_part
    # OpenCV is slowest if it finds no board: it runs only for incomplete lattices
    if not has_seeds or max_corners >= MIN_COMPLETE_FRACTION * board.corner_count or is_complete:
        return
    for scale in scales(image.shape)[:2]:
        if image.size * scale**2 <= LARGEST_FOR_OPENCV:
            smaller = scaled(image, scale)
            for pixels in _opencv_grids(bytes_of(smaller), board):
                part = from_grid(smaller, pixels)
                if len(part.places) >= MIN_PART:
                    yield _at_full_size(image, trimmed(grown(smaller, part)), scale)


def _grown_parts(
    image: Grey,
    seeds: Sequence[LatticePart],
    *,
    max_seeds: int = MAX_SEEDS_ONE_BOARD,
    used_corners: Array | None = None,
) -> Iterator[LatticePart]:
    """Yield the lattices grown from seeds outside earlier lattices, up to a maximum number."""
    used_corners = np.empty((0, 2)) if used_corners is None else used_corners
    seed_count = 0
    for seed in seeds:
        centre = seed.pixels.mean(axis=0)
        size = np.linalg.norm(np.ptp(seed.pixels, axis=0)) / 4
        if len(used_corners) and np.linalg.norm(used_corners - centre, axis=1).min() < size:
            continue
        seed_count += 1
        part = trimmed(grown(image, seed))
        if len(part.places) >= MIN_PART:
            used_corners = np.concatenate([used_corners, part.pixels])
            yield part
        if seed_count == max_seeds:
            return


def _at_full_size(image: Grey, part: LatticePart, scale: float) -> LatticePart:
    """Refine the corners of a lattice in images of doubling size, up to the full image."""
    indices, pixels = part.places.astype(float), unscaled_px(part.pixels, scale)
    for larger in upwards(scale):
        scaled_pixels = (pixels + 0.5) * larger - 0.5
        maps = maps_about(indices, scaled_pixels, indices)._replace(pixels=scaled_pixels)
        fitted = fit_saddles(scaled(image, larger), maps, CHECKER, is_quick=True)
        is_near = np.linalg.norm(fitted.pixels - scaled_pixels, axis=1) < 0.3 * maps.spacing()
        pixels = unscaled_px(np.where(is_near[:, None], fitted.pixels, scaled_pixels), larger)
    return LatticePart(part.places, pixels, part.polarity)


def _opencv_grids(image: NDArray[np.uint8], board: Board) -> Iterator[Array]:
    """Yield corners (rows, columns, 2) from OpenCV's detectors, fastest first, partial boards last."""
    import cv2

    size = board.lattice_size
    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    sectors = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    if min(size) >= 3:
        is_found, corners = cv2.findChessboardCorners(image, size, flags=classic)
        if is_found:
            yield corners.reshape(size[1], size[0], 2).astype(float)
    is_found, corners = cv2.findChessboardCornersSB(image, size, flags=sectors)
    if is_found:
        yield corners.reshape(size[1], size[0], 2).astype(float)
    is_found, corners, cells = cv2.findChessboardCornersSBWithMeta(
        image, (3, 3), sectors | cv2.CALIB_CB_LARGER
    )
    if is_found and len(corners) == cells.size:
        yield corners.reshape(*cells.shape, 2).astype(float)


def ordered(part: LatticePart, board: Board) -> tuple[NDArray[np.int_], Array, bool]:
    """Return ids (k,), pixels (k, 2) and the colour of the first square of a complete board.

    Columns and rows run clockwise in the image. If the colours of the board determine its first
    corner, the square before it is black; otherwise the first corner is the one nearest to the
    upper left of the image.
    """
    columns, rows = board.lattice_size
    indices = part.places - part.places.min(axis=0)
    extent = indices.max(axis=0)
    options = []
    for turn in range(4):
        x, y = indices[:, 0], indices[:, 1]
        rotated = [(x, y), (y, extent[0] - x), (extent[0] - x, extent[1] - y), (extent[1] - y, x)][
            turn
        ]
        if rotated[0].max() + 1 != columns or rotated[1].max() + 1 != rows:
            continue
        ids = rotated[1] * columns + rotated[0]
        start = int(np.argmin(rotated[0] + rotated[1]))
        # a rotation by 90 deg exchanges the colours of a corner's first and second square
        parity = int(part.places[start].sum() + rotated[0][start] + rotated[1][start]) + turn
        first = part.polarity * (1 - 2 * (parity % 2))
        options.append((first > 0, float(part.pixels[start].sum()), ids))
    begins_white, _, ids = min(options, key=lambda option: option[:2])
    order = np.argsort(ids)
    return ids[order], part.pixels[order], bool(begins_white)


def placed(part: LatticePart, board: Board) -> tuple[NDArray[np.int_], Array] | None:
    """Return ids (k,) and pixels (k, 2) of a part of a board as if it were its centre.

    None if it does not fit this board. A chessboard does not identify the part; the estimated pose
    absorbs the difference.
    """
    columns, rows = board.lattice_size
    indices = part.places - part.places.min(axis=0)
    width, height = part.size
    is_rotated = width > columns or height > rows
    if is_rotated:  # rotation by 90 deg, still clockwise
        indices = np.stack([indices[:, 1], width - 1 - indices[:, 0]], axis=1)
        width, height = height, width
    if width > columns or height > rows or min(width, height) < 3:
        return None
    corner = np.array([(columns - width) // 2, (rows - height) // 2])
    indices = indices + corner
    first = part.polarity * (
        1 - 2 * (int(part.places[0].sum() + indices[0].sum() + is_rotated) % 2)
    )
    if first > 0 and not board.is_symmetric:  # black square first
        indices = np.array([columns - 1, rows - 1]) - indices
    ids = indices[:, 1] * columns + indices[:, 0]
    order = np.argsort(ids)
    return ids[order], part.pixels[order]
