"""Chessboard detection in distorted images: seeds of four squares, and lattice growth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.linear_algebra import matrix_product
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

BLUR_PX = 1.5  # of the derivatives
MOST = 1500  # maximum number of corner candidates
LEAST_RESPONSE = 0.02  # relative to the strong responses
RING_PX = 4.5
LEAST_RING = 0.6  # minimum correlation of the ring with four alternating quarters
MAX_SEEDS_FOUND = 200
LEAST_OF_SEED = 7  # minimum number of the nine corners that the image confirms


class Crossings(NamedTuple):
    """Crossings of two white and two black quarters."""

    pixels: Array
    """Pixels (m, 2)."""
    angles: Array
    """Angle (m,) of the first edge clockwise from the centre of a white quarter, radians."""


def crossings(picture: Grey) -> Crossings:
    """Return saddle points with four alternating dark and light quarters around them.

    The strength of a saddle is the negative determinant of the second derivatives.
    """
    import cv2

    smooth = np.asarray(cv2.GaussianBlur(picture, (0, 0), BLUR_PX), np.float32)
    xx, yy = cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1)
    strength = xy * xy - xx * yy
    peak = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 0)
    peak[:6], peak[-6:], peak[:, :6], peak[:, -6:] = False, False, False, False
    v, u = np.nonzero(peak)
    if not len(u):
        return Crossings(np.empty((0, 2)), np.empty(0))
    order = np.argsort(-strength[v, u], kind="stable")[:MOST]
    strongest = strength[v, u][order[min(len(order) - 1, 20)]]
    order = order[strength[v, u][order] > LEAST_RESPONSE * strongest]
    pixels = np.stack([u[order], v[order]], axis=1).astype(float)
    angles, likeness = _ring(smooth, pixels)
    kept = likeness > LEAST_RING
    return Crossings(pixels[kept], angles[kept])


def _ring(picture: Grey, pixels: Array) -> tuple[Array, Array]:
    """Return the phase of the second harmonic on a ring around each pixel, and its power fraction."""
    import cv2

    turn = 2 * np.pi * np.arange(24) / 24
    ring = pixels[:, None] + RING_PX * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    at = ring.astype(np.float32)
    values = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(float)
    values -= values.mean(axis=1, keepdims=True)
    even, odd = matrix_product(
        values, np.stack([np.cos(2 * turn), -np.sin(2 * turn)], axis=1)
    ).T / len(turn)
    power = 2 * (even * even + odd * odd)
    # for sharp edges the second harmonic holds 8 / pi^2 of the power
    return -np.arctan2(odd, even) / 2, power / np.maximum(np.mean(values**2, axis=1), 1e-9)


def find_seeds(picture: Grey) -> list[LatticePart]:
    """Find sets of nine crossings in a 3 x 3 arrangement, most regular first."""
    found = crossings(picture)
    if len(found.pixels) < 9:
        return []
    from scipy.spatial import cKDTree

    tree = cKDTree(found.pixels)
    nearest = tree.query(found.pixels, k=min(14, len(found.pixels)))[1]
    nines = [
        nine
        for i in range(len(found.pixels))
        if (nine := _nine(found, tree, nearest[i])) is not None
    ]
    chosen: list[LatticePart] = []
    taken: set[int] = set()
    for _, indices in sorted(nines, key=lambda nine: nine[0]):
        if taken & set(indices.tolist()):
            continue
        taken |= set(indices.tolist())
        places = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2]), axis=-1).reshape(-1, 2)
        part = coloured(picture, places, found.pixels[indices])
        if len(part.places) >= LEAST_OF_SEED:
            chosen.append(part)
        if len(chosen) == MAX_SEEDS_FOUND:
            break
    return chosen


def _nine(
    found: Crossings, tree: Any, near: NDArray[np.int_]
) -> tuple[float, NDArray[np.int_]] | None:
    """Return a crossing and its eight neighbours in board order, and their irregularity."""
    middle, others = near[0], near[1:]
    ways = found.pixels[others] - found.pixels[middle]
    # a neighbour along an edge has exchanged colours: a phase difference of 90 deg
    quarter = np.abs(np.cos(found.angles[others] - found.angles[middle])) < 0.6
    others, ways = others[quarter], ways[quarter]
    if len(others) < 4:
        return None
    heading = np.arctan2(ways[:, 1], ways[:, 0])
    cross = []
    for k in range(4):
        edge = found.angles[middle] + np.pi / 4 + k * np.pi / 2
        off = np.abs(np.angle(np.exp(1j * (heading - edge))))
        along = np.flatnonzero(off < 0.6)
        if not len(along):
            return None
        cross.append(int(others[along[0]]))
    if len(set(cross)) < 4:
        return None
    right, down, left, up = (found.pixels[i] for i in cross)
    centre = found.pixels[middle]
    wanted = np.array(
        [left + up - centre, right + up - centre, left + down - centre, right + down - centre]
    )
    size = min(np.linalg.norm(right - left), np.linalg.norm(down - up)) / 2
    off, diagonal = tree.query(wanted)
    bent = max(np.linalg.norm(right + left - 2 * centre), np.linalg.norm(up + down - 2 * centre))
    if size < 3 or off.max() > 0.4 * size or bent > 0.6 * size:
        return None
    a, b, c, d = (int(i) for i in diagonal)
    indices = np.array([a, cross[3], b, cross[2], int(middle), cross[0], c, cross[1], d])
    if len(set(indices.tolist())) < 9:
        return None
    return float((off.max() + bent) / size), indices


# -- Chessboard detection --------------------------------------------------------------------------

WHOLE = 0.9
"""Minimum fraction of the corners of a lattice."""
MIN_PART = 9  # minimum number of corners of a lattice
MAX_SEEDS_ONE_BOARD, MAX_SEEDS_SEVERAL_BOARDS = (
    12,
    200,
)  # maximum number of seeds to grow, for one board and for several
MOST_REFLECTED = 2  # maximum number of columns or rows that reflections add
LARGEST_FOR_OPENCV = 2_500_000  # px; OpenCV's detectors are slow on larger images


def find_chessboard(picture: Grey, board: Board, *, is_quick: bool = False) -> LatticePart | None:
    """Return the lattice that matches the board, otherwise the one with the most corners.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image, 0 to 255.
    board
        Chessboard.
    is_quick
        Search at one image size only and without OpenCV's detectors.
    """
    best: LatticePart | None = None
    for part in _grown_parts(picture, find_seeds(picture)) if is_quick else _parts(picture, board):
        for candidate in (part, *inner_grids(part, board)):
            if is_whole(candidate, board) and not goes_on(picture, candidate):
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
    for wanted in {board.lattice_size, board.lattice_size[::-1]}:
        spare = size - wanted
        if not (spare.min() >= 0 and 0 < spare.max() <= MOST_REFLECTED):
            continue
        for column, row in np.ndindex(spare[0] + 1, spare[1] + 1):
            first = low + np.array([column, row])
            yield part.only(np.all((part.places >= first) & (part.places < first + wanted), axis=1))


def find_chessboards(picture: Grey, board: Board) -> list[LatticePart]:
    """Return all lattices in the image that match the board.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image, 0 to 255.
    board
        Chessboard.
    """
    for scale in scales(picture.shape):
        smaller = scaled(picture, scale)
        parts = _grown_parts(smaller, find_seeds(smaller), most=MAX_SEEDS_SEVERAL_BOARDS)
        whole = [part for part in parts if is_whole(part, board) and not goes_on(smaller, part)]
        if whole:
            return [_at_full_size(picture, part, scale) for part in whole]
    return []


def is_whole(part: LatticePart, board: Board) -> bool:
    """Return whether a lattice has the size of the board and nearly all of its corners.

    >>> nine = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2]), axis=-1).reshape(-1, 2)
    >>> is_whole(LatticePart(nine, 10.0 * nine, -1), Board("chessboard", 3, 3))
    True
    """
    return (
        sorted(part.size) == sorted(board.lattice_size)
        and len(part.places) >= WHOLE * board.corner_count
    )


def is_larger(part: LatticePart, board: Board) -> bool:
    """Check whether a lattice has more columns or rows than the board."""
    size, wanted = sorted(part.size), sorted(board.lattice_size)
    return size[0] > wanted[0] or size[1] > wanted[1]


def _is_filled(part: LatticePart) -> bool:
    """Check whether a lattice has nearly all corners of its columns and rows."""
    return len(part.places) >= WHOLE * part.size[0] * part.size[1]


def _parts(picture: Grey, board: Board) -> Iterator[LatticePart]:
    """Yield lattices in pixels of the full image.

    Lattices larger than the board are not grown again at other image sizes.
    """
    has_seeds, is_complete, most, other = False, False, 0, np.empty((0, 2))
    for scale in scales(picture.shape):
        smaller = scaled(picture, scale)
        seeds = find_seeds(smaller)
        has_seeds |= bool(seeds)
        for part in _grown_parts(smaller, seeds, taken=(other + 0.5) * scale - 0.5):
            most = max(most, len(part.places))
            found = _at_full_size(picture, part, scale)
            if _is_filled(part) and is_larger(part, board):
                other = np.concatenate([other, found.pixels])
            elif _is_filled(part) and len(part.places) > board.corner_count / 2:
                is_complete |= is_bounded(smaller, part)
            yield found
    # OpenCV is slowest if it finds no board: it runs only for incomplete lattices
    if not has_seeds or most >= WHOLE * board.corner_count or is_complete:
        return
    for scale in scales(picture.shape)[:2]:
        if picture.size * scale**2 <= LARGEST_FOR_OPENCV:
            smaller = scaled(picture, scale)
            for pixels in _opencv_grids(bytes_of(smaller), board):
                part = from_grid(smaller, pixels)
                if len(part.places) >= MIN_PART:
                    yield _at_full_size(picture, trimmed(grown(smaller, part)), scale)


def _grown_parts(
    picture: Grey,
    seeds: Sequence[LatticePart],
    *,
    most: int = MAX_SEEDS_ONE_BOARD,
    taken: Array | None = None,
) -> Iterator[LatticePart]:
    """Yield the lattices grown from seeds outside earlier lattices, up to a maximum number."""
    taken = np.empty((0, 2)) if taken is None else taken
    grows = 0
    for seed in seeds:
        middle = seed.pixels.mean(axis=0)
        size = np.linalg.norm(np.ptp(seed.pixels, axis=0)) / 4
        if len(taken) and np.linalg.norm(taken - middle, axis=1).min() < size:
            continue
        grows += 1
        part = trimmed(grown(picture, seed))
        if len(part.places) >= MIN_PART:
            taken = np.concatenate([taken, part.pixels])
            yield part
        if grows == most:
            return


def _at_full_size(picture: Grey, part: LatticePart, scale: float) -> LatticePart:
    """Refine the corners of a lattice in images of doubling size, up to the full image."""
    places, pixels = part.places.astype(float), unscaled_px(part.pixels, scale)
    for larger in upwards(scale):
        here = (pixels + 0.5) * larger - 0.5
        maps = maps_about(places, here, places)._replace(pixels=here)
        fitted = fit_saddles(scaled(picture, larger), maps, CHECKER, is_quick=True)
        near = np.linalg.norm(fitted.pixels - here, axis=1) < 0.3 * maps.spacing()
        pixels = unscaled_px(np.where(near[:, None], fitted.pixels, here), larger)
    return LatticePart(part.places, pixels, part.polarity)


def _opencv_grids(picture: NDArray[np.uint8], board: Board) -> Iterator[Array]:
    """Yield corners (rows, columns, 2) from OpenCV's detectors, fastest first, partial boards last."""
    import cv2

    size = board.lattice_size
    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    sectors = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    if min(size) >= 3:
        found, corners = cv2.findChessboardCorners(picture, size, flags=classic)
        if found:
            yield corners.reshape(size[1], size[0], 2).astype(float)
    found, corners = cv2.findChessboardCornersSB(picture, size, flags=sectors)
    if found:
        yield corners.reshape(size[1], size[0], 2).astype(float)
    found, corners, cells = cv2.findChessboardCornersSBWithMeta(
        picture, (3, 3), sectors | cv2.CALIB_CB_LARGER
    )
    if found and len(corners) == cells.size:
        yield corners.reshape(*cells.shape, 2).astype(float)


def ordered(part: LatticePart, board: Board) -> tuple[NDArray[np.int_], Array, bool]:
    """Return ids (k,), pixels (k, 2) and the colour of the first square of a complete board.

    Columns and rows run clockwise in the image. If the colours of the board determine its first
    corner, the square before it is black; otherwise the first corner is the one nearest to the
    upper left of the image.
    """
    columns, rows = board.lattice_size
    places = part.places - part.places.min(axis=0)
    extent = places.max(axis=0)
    options = []
    for turn in range(4):
        x, y = places[:, 0], places[:, 1]
        turned = [(x, y), (y, extent[0] - x), (extent[0] - x, extent[1] - y), (extent[1] - y, x)][
            turn
        ]
        if turned[0].max() + 1 != columns or turned[1].max() + 1 != rows:
            continue
        ids = turned[1] * columns + turned[0]
        start = int(np.argmin(turned[0] + turned[1]))
        # a rotation by 90 deg exchanges the colours of a corner's first and second square
        parity = int(part.places[start].sum() + turned[0][start] + turned[1][start]) + turn
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
    places = part.places - part.places.min(axis=0)
    width, height = part.size
    is_turned = width > columns or height > rows
    if is_turned:  # rotation by 90 deg, still clockwise
        places = np.stack([places[:, 1], width - 1 - places[:, 0]], axis=1)
        width, height = height, width
    if width > columns or height > rows or min(width, height) < 3:
        return None
    corner = np.array([(columns - width) // 2, (rows - height) // 2])
    places = places + corner
    first = part.polarity * (1 - 2 * (int(part.places[0].sum() + places[0].sum() + is_turned) % 2))
    if first > 0 and not board.is_symmetric:  # black square first
        places = np.array([columns - 1, rows - 1]) - places
    ids = places[:, 1] * columns + places[:, 0]
    order = np.argsort(ids)
    return ids[order], part.pixels[order]
