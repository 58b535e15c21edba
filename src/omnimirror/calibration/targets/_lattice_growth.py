"""Lattice growth and completion: corners predicted from their neighbours, verified in the image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.numerics import matrix_product
from ...base.typing import Array
from ._corner_refinement import LocalMaps, fit_saddles, maps_about
from .boards import Board, CornerWindow

# -- Lattice growth --------------------------------------------------------------------------------
#
# The local map of the known lattice predicts the position of the next corners and the curvature of
# their squares. A corner is accepted if the image, rectified by that map, correlates with four
# squares of the correct colours. This detects boards without a camera model in images too distorted
# for conventional detectors.

Places = NDArray[np.int_]
Grey = NDArray[np.float32]

HALF = 6  # samples from the centre of four squares to the edge of the template
SEARCH = 5  # maximum offset from the prediction, in samples
MIN_CORRELATION = 0.6
"""Minimum correlation with four squares."""
MIN_KNOWN_CORRELATION = 0.45
"""Minimum correlation for known corners."""
MIN_CLEARANCE = 0.25
"""Minimum difference of the darker white and the lighter black square, relative to the contrast.

It is smaller at the boundary of a board.
"""
MAX_OFFSET = 0.35
"""Maximum distance from the prediction, in squares."""
MISFIT = 0.75
MAX_CONTINUATION = 0.2
"""Maximum fraction of corner-like places beyond a board's outer corners.

It is 0 on a margin and 0.5 on tiles.
"""
CONTRAST_OF_CORNER = 0.7
"""Minimum contrast of a corner beyond a lattice, relative to the nearest corner of the lattice."""
CONTRAST_OF_OUTLINE = (0.25, 0.66)
"""Range of this ratio at the outline of a board; four squares fitted to a T-junction have 0.5."""
MIN_OUTLINE_FRACTION = 0.5
"""Minimum fraction of the places beyond each side of a framed board that show its outline."""
MAX_RINGS = 60
ASTRAY = (0.2, 0.6)  # in squares, plus px; maximum distance from the prediction


CHECKER = CornerWindow()


class LatticePart(NamedTuple):
    """Corners of one lattice."""

    places: Places
    """Column and row (k, 2) with an arbitrary origin."""
    pixels: Array
    """Pixels (k, 2)."""
    polarity: int
    """Sign of the contrast for even column + row: -1 if the upper left square is black."""

    @property
    def size(self) -> tuple[int, int]:
        """Number of columns and rows."""
        extent = np.ptp(self.places, axis=0) + 1
        return int(extent[0]), int(extent[1])

    def subset(self, retained: NDArray[np.bool_]) -> LatticePart:
        """Return a subset of the corners."""
        return LatticePart(self.places[retained], self.pixels[retained], self.polarity)


class Likeness(NamedTuple):
    """Similarity of the image to corners at candidate places."""

    correlation: Array
    """Correlation (m,) with four squares, the first of them white."""
    clearance: Array
    """Difference (m,) of white and black squares, relative to the contrast."""
    pixels: Array
    """Position (m, 2) of maximum correlation."""


def likeness(
    image: Grey,
    maps: LocalMaps,
    polarity: Array,
    search: int = SEARCH,
    window: CornerWindow = CHECKER,
) -> Likeness:
    """Compare the image, rectified by the maps, with four squares.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    maps
        Local maps at m places, in sides of a square.
    polarity : (m,)
        Signs of the expected contrast; 0 for either.
    search
        Search range in samples.
    window
        Region around a corner without other structures.
    """
    import cv2

    reach = HALF + search
    spacing = window.half / (HALF + 0.5)
    steps = spacing * np.arange(-reach, reach + 1)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    positions = maps.at(grid).astype(np.float32)
    sampled = cv2.remap(
        image,
        positions[..., 0],
        positions[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    values = np.asarray(sampled, np.float32)
    side = len(steps)
    windows = np.lib.stride_tricks.sliding_window_view(
        values.reshape(-1, side, side), (2 * HALF + 1, 2 * HALF + 1), axis=(1, 2)
    )
    correlation = _correlation(windows, window.arm / spacing)
    signed = np.where(
        polarity[:, None, None] == 0, np.abs(correlation), correlation * polarity[:, None, None]
    )
    flat = signed.reshape(len(signed), -1)
    best = flat.argmax(axis=1)
    row, column = np.unravel_index(best, signed.shape[1:])
    best_windows = windows[np.arange(len(best)), row, column]
    sign = np.sign(correlation.reshape(len(flat), -1)[np.arange(len(best)), best])
    shift = spacing * (np.stack([column, row], axis=1) - search)
    return Likeness(
        flat[np.arange(len(best)), best],
        _clearance(best_windows, sign),
        maps.at(shift[:, None])[:, 0],
    )


def _correlation(windows: NDArray[np.float32], arm: float) -> NDArray[np.float32]:
    """Return the correlation of windows (..., side, side) with four squares, within a cross."""
    steps = np.arange(-HALF, HALF + 1)
    ramp = np.clip(steps / 1.5, -1, 1)
    free = np.minimum(*np.abs(np.meshgrid(steps, steps))) <= max(arm - 0.5, 1)
    weight = (free / free.sum()).astype(np.float32)
    template = (np.outer(ramp, ramp) * weight).astype(np.float32)
    flat, both = (
        np.ascontiguousarray(windows).reshape(-1, template.size),
        np.stack([template.ravel(), weight.ravel()], 1),
    )
    likeness, mean = matrix_product(flat, both).T
    power = matrix_product(flat * flat, both)[:, 1] - mean**2
    template_power = float(np.sum(np.outer(ramp, ramp) ** 2 * weight))
    return np.asarray(likeness / np.sqrt(np.maximum(power * template_power, 1e-6))).reshape(
        windows.shape[:-2]
    )


def _clearance(windows: NDArray[np.float32], sign: Array) -> Array:
    """Return the relative difference of the darker white and the lighter black square."""
    low, high = slice(0, HALF - 1), slice(HALF + 2, None)
    quarters = np.stack(
        [windows[:, i, j].mean(axis=(1, 2)) for i in (low, high) for j in (low, high)], axis=1
    )
    quarters = quarters * sign[:, None]
    white, black = quarters[:, [0, 3]], quarters[:, [1, 2]]
    between = white.mean(axis=1) - black.mean(axis=1)
    return np.asarray((white.min(axis=1) - black.max(axis=1)) / np.maximum(between, 1e-6))


def grown(
    image: Grey,
    part: LatticePart,
    *,
    largest: tuple[int, int] = (200, 200),
    rings: int = MAX_RINGS,
) -> LatticePart:
    """Extend a lattice by all adjacent corners.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    part
        At least four corners, 2 x 2.
    largest
        Maximum size of the longer and shorter side, in corners.
    rings
        Maximum number of rings.
    """
    rejected: dict[tuple[int, int], int] = {}
    for _ in range(rings):
        candidates = _neighbours(part, largest, rejected)
        if not len(candidates):
            break
        is_confirmed, pixels = _verified_neighbours(image, part, candidates)
        for index in map(tuple, candidates[~is_confirmed]):
            rejected[index] = len(part.places)
        if not is_confirmed.any():
            break
        indices = np.concatenate([part.places, candidates[is_confirmed]])
        part = _without_strays(
            LatticePart(indices, np.concatenate([part.pixels, pixels[is_confirmed]]), part.polarity)
        )
    return part


def _neighbours(
    part: LatticePart, largest: tuple[int, int], rejected: dict[tuple[int, int], int]
) -> Places:
    """Return lattice indices adjacent to known corners, except those recently rejected."""
    occupied = set(map(tuple, part.places))
    low, high = part.places.min(axis=0), part.places.max(axis=0)
    sides = sorted(high - low + 1)
    candidates = set()
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for index in map(tuple, part.places + step):
            if index in occupied or len(occupied) < 1.15 * rejected.get(index, 0):
                continue
            extents = [
                max(last, p) - min(first, p) + 1
                for p, first, last in zip(index, low, high, strict=True)
            ]
            if sorted(extents) == sides or (
                max(extents) <= largest[0] and min(extents) <= largest[1]
            ):
                candidates.add(index)
    return np.array(sorted(candidates), dtype=int).reshape(-1, 2)


def _verified_neighbours(
    image: Grey, part: LatticePart, candidates: Places
) -> tuple[NDArray[np.bool_], Array]:
    """Return which candidates the image confirms, and their pixels."""
    maps = maps_about(part.places.astype(float), part.pixels, candidates.astype(float))
    height, width = image.shape
    spacing = maps.spacing()
    reach = 0.3 * spacing[:, None]
    is_inside = np.all(
        (maps.pixels > reach) & (maps.pixels < np.array([width, height]) - 1 - reach), axis=1
    )
    # neighbours that are far away or coincide result from a poorly supported map
    typical_spacing = np.median(
        np.linalg.norm(
            maps_about(part.places.astype(float), part.pixels, part.places.astype(float)).first,
            axis=1,
        )
    )
    is_plausible = (
        is_inside
        & (spacing > max(2.0, 0.2 * typical_spacing))
        & (np.linalg.norm(maps.first, axis=1).max(axis=1) < 5 * typical_spacing)
    )
    is_confirmed = np.zeros(len(candidates), dtype=bool)
    pixels = np.full((len(candidates), 2), np.nan)
    if not is_plausible.any():
        return is_confirmed, pixels
    maps = LocalMaps(*(field[is_plausible] for field in maps))
    polarity = part.polarity * (1 - 2 * (candidates[is_plausible].sum(axis=1) % 2))
    similarity = likeness(image, maps, polarity)
    fit = fit_saddles(image, maps._replace(pixels=similarity.pixels), CHECKER, is_quick=True)
    prediction_error = np.linalg.norm(fit.pixels - maps.pixels, axis=1) / maps.spacing()
    correction = np.linalg.norm(fit.pixels - similarity.pixels, axis=1) / maps.spacing()
    is_accepted = (
        (similarity.correlation > MIN_CORRELATION)
        & (similarity.clearance > MIN_CLEARANCE)
        & (fit.contrast * polarity > 0)
    )
    is_accepted &= (
        (prediction_error < MAX_OFFSET * 1.5)
        & (correction < MAX_OFFSET / 2)
        & (fit.misfit < MISFIT)
    )
    is_confirmed[is_plausible], pixels[is_plausible] = is_accepted, fit.pixels
    return is_confirmed, pixels


class BoardSurroundings(NamedTuple):
    """Image content one square beyond the outer corners of a lattice, at m places in the image.

    Beyond the outer corners of tiles, a checked cloth or a larger board there are further corners
    of four squares. Beyond those of a board there is its outline, which meets the edges of the
    outer squares in T-junctions: four squares fitted to these have 0.5 of the contrast.
    """

    resembles: NDArray[np.bool_]
    """Similarity (m,) to four squares."""
    contrast: Array
    """Contrast (m,) of four squares fitted to it, relative to the nearest corner of the lattice."""
    sides: NDArray[np.bool_]
    """Side of the lattice (4, m) of each place."""

    @property
    def outlined(self) -> Array:
        """Fraction (4,) of the places on each side that show an outline; NaN if outside the image."""
        is_outline = (self.contrast > CONTRAST_OF_OUTLINE[0]) & (
            self.contrast < CONTRAST_OF_OUTLINE[1]
        )
        count = self.sides.sum(axis=1)
        return np.where(
            count > 0, (self.sides & is_outline).sum(axis=1) / np.maximum(count, 1), np.nan
        )

    @property
    def has_corners(self) -> bool:
        """True if squares of full contrast continue."""
        corners = self.resembles & (self.contrast > CONTRAST_OF_CORNER)
        return bool(corners.size) and bool(corners.mean() > MAX_CONTINUATION)


def goes_on(image: Grey, part: LatticePart) -> bool:
    """Check whether squares continue beyond a lattice, as in tiles or a larger board.

    On a white margin no place resembles a corner. On a narrow frame with textured surroundings some
    places do: then all sides must show the outline, and few places may have corners of full
    contrast.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    part
        Lattice that may be a complete board.
    """
    surroundings_of_part = surroundings(image, part)
    if (
        not surroundings_of_part.resembles.any()
        or surroundings_of_part.resembles.mean() <= MAX_CONTINUATION
    ):
        return False
    return surroundings_of_part.has_corners or bool(
        (surroundings_of_part.outlined < MIN_OUTLINE_FRACTION).any()
    )


def is_bounded(image: Grey, part: LatticePart) -> bool:
    """Check whether the outline of a complete board is visible on all sides of a lattice."""
    surroundings_of_part = surroundings(image, part)
    return not surroundings_of_part.has_corners and bool(
        (surroundings_of_part.outlined >= MIN_OUTLINE_FRACTION).all()
    )


def surroundings(image: Grey, part: LatticePart) -> BoardSurroundings:
    """Evaluate the image one square beyond the outer corners of a lattice."""
    low, high = part.places.min(axis=0), part.places.max(axis=0)
    neighbours = _neighbours(part, (MAX_RINGS, MAX_RINGS), {})
    outer = neighbours[np.any((neighbours < low) | (neighbours > high), axis=1)]
    maps = maps_about(part.places.astype(float), part.pixels, outer.astype(float))
    spacing = maps.spacing()
    reach = 0.3 * spacing[:, None]
    is_inside = np.all(
        (maps.pixels > reach) & (maps.pixels < np.array(image.shape[::-1]) - 1 - reach), axis=1
    )
    is_inside &= spacing > 2.0
    outer, maps = outer[is_inside], LocalMaps(*(field[is_inside] for field in maps))
    sides = np.array(
        [outer[:, 0] < low[0], outer[:, 0] > high[0], outer[:, 1] < low[1], outer[:, 1] > high[1]]
    )
    if not is_inside.any():
        return BoardSurroundings(np.zeros(0, bool), np.zeros(0), sides)
    polarity = part.polarity * (1 - 2 * (outer.sum(axis=1) % 2))
    similarity = likeness(image, maps, polarity)
    contrast = (
        polarity
        * fit_saddles(
            image, maps._replace(pixels=similarity.pixels), CHECKER, is_quick=True
        ).contrast
    )
    resembles = (similarity.correlation > MIN_CORRELATION) & (similarity.clearance > MIN_CLEARANCE)
    return BoardSurroundings(
        resembles, contrast / _contrast_inside(image, part, np.clip(outer, low, high)), sides
    )


def _contrast_inside(image: Grey, part: LatticePart, indices: Places) -> Array:
    """Return the contrast (m,) of the corners of a lattice that are nearest to indices (m, 2)."""
    nearest = np.abs(indices[:, None] - part.places).sum(axis=2).argmin(axis=1)
    places_of_part = part.places.astype(float)
    maps = maps_about(places_of_part, part.pixels, places_of_part[nearest])._replace(
        pixels=part.pixels[nearest]
    )
    return np.asarray(
        np.maximum(np.abs(fit_saddles(image, maps, CHECKER, is_quick=True).contrast), 1e-6)
    )


def _without_strays(part: LatticePart) -> LatticePart:
    """Remove corners that are inconsistent with their neighbours."""
    if len(part.places) < 12:
        return part
    indices = part.places.astype(float)
    maps = maps_about(indices, part.pixels, indices, leave_out=True)
    deviations = np.linalg.norm(maps.pixels - part.pixels, axis=1)
    # at the lattice boundary the map is extrapolated and less accurate
    allowed = (ASTRAY[0] * maps.spacing() + ASTRAY[1]) * np.where(maps.support > 4.5, 1.0, 3.0)
    return part.subset(deviations < allowed)


def trimmed(part: LatticePart, min_fraction: float = 0.5) -> LatticePart:
    """Remove outer columns and rows with less than a given fraction of corners."""
    while len(part.places):
        low, high = part.places.min(axis=0), part.places.max(axis=0)
        lengths = high - low + 1
        for axis in (0, 1):
            for edge in (low[axis], high[axis]):
                is_on_edge = part.places[:, axis] == edge
                if is_on_edge.sum() < min_fraction * lengths[1 - axis]:
                    part = part.subset(~is_on_edge)
                    break
            else:
                continue
            break
        else:
            return part
    return part


def from_grid(image: Grey, pixels: Array) -> LatticePart:
    """Return the lattice of a detector's corners (rows, columns, 2), with colours from the image."""
    rows, columns = pixels.shape[:2]
    indices = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    flat = pixels.reshape(-1, 2).astype(float)
    is_finite = np.isfinite(flat).all(axis=1)
    indices, flat = indices[is_finite], flat[is_finite]
    return coloured(image, indices, flat)


def coloured(image: Grey, indices: Places, pixels: Array) -> LatticePart:
    """Return a lattice with colours from the image, in clockwise order.

    Only corners that the image confirms are retained.
    """
    maps = maps_about(indices.astype(float), pixels, indices.astype(float))
    if np.median(np.linalg.det(maps.first)) < 0:
        indices = indices[:, ::-1].copy()
        maps = maps_about(indices.astype(float), pixels, indices.astype(float))
    parity = 1.0 - 2 * (indices.sum(axis=1) % 2)
    similarity = likeness(image, maps, parity, search=1)
    opposite_similarity = likeness(image, maps, -parity, search=1)
    polarity = 1 if similarity.correlation.sum() >= opposite_similarity.correlation.sum() else -1
    similarity = similarity if polarity > 0 else opposite_similarity
    return LatticePart(indices, pixels, polarity).subset(
        (similarity.correlation > MIN_KNOWN_CORRELATION) & (similarity.clearance > MIN_CLEARANCE)
    )


# -- Completion of partially identified boards -----------------------------------------------------

Ids = NDArray[np.int_]

SUPPORT = 2.0
"""Minimum total weight of known corners around a predicted one."""
MAX_STRAY = (0.2, 0.6)


def completed(image: Grey, board: Board, ids: Ids, pixels: Array) -> tuple[Ids, Array]:
    """Return known and predicted corners, ordered by id.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    board
        Calibration board.
    ids : (k,)
        Ids of known corners.
    pixels : (k, 2)
        Pixels of known corners.
    """
    positions = board.points_mm[:, :2] / board.square_mm
    rejected: set[int] = set()
    while True:
        missing = np.setdiff1d(np.arange(board.corner_count), ids)
        maps = maps_about(positions[ids], pixels, positions[missing])
        is_supported = (maps.support > SUPPORT) & ~np.isin(missing, list(rejected))
        if not is_supported.any():
            break
        missing = missing[is_supported]
        is_confirmed, confirmed_pixels = _verified_corners(
            image, board, missing, LocalMaps(*(field[is_supported] for field in maps))
        )
        rejected |= set(missing[~is_confirmed].tolist())
        if not is_confirmed.any():
            break
        ids, pixels = (
            np.concatenate([ids, missing[is_confirmed]]),
            np.concatenate([pixels, confirmed_pixels[is_confirmed]]),
        )
    order = np.argsort(ids)
    return ids[order], pixels[order]


def predicted(image: Grey, board: Board, known_mm: Array, known_px: Array) -> tuple[Ids, Array]:
    """Return the corners of a board predicted from other points on it.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    board
        Calibration board.
    known_mm : (m, 2)
        Known points of the board.
    known_px : (m, 2)
        Pixels of these points.
    """
    positions = board.points_mm[:, :2] / board.square_mm
    maps = maps_about(known_mm / board.square_mm, known_px, positions)
    supported = np.flatnonzero(maps.support > SUPPORT)
    is_confirmed, pixels = _verified_corners(
        image, board, supported, LocalMaps(*(field[supported] for field in maps))
    )
    return supported[is_confirmed], pixels[is_confirmed]


def _verified_corners(
    image: Grey, board: Board, ids: Ids, maps: LocalMaps
) -> tuple[NDArray[np.bool_], Array]:
    height, width = image.shape
    spacing = maps.spacing()
    margin = board.surroundings.half / 2 * spacing[:, None]
    is_inside = np.all(
        (maps.pixels > margin) & (maps.pixels < np.array([width, height]) - 1 - margin), axis=1
    )
    # in a mirrored image the board's axes run anticlockwise, but colours do not change
    polarity = board.polarity[ids].astype(float)
    similarity = likeness(image, maps, polarity, window=board.surroundings)
    fit = fit_saddles(
        image, maps._replace(pixels=similarity.pixels), board.surroundings, is_quick=True
    )
    prediction_error = np.linalg.norm(fit.pixels - maps.pixels, axis=1) / spacing
    is_confirmed = (
        is_inside
        & (similarity.correlation > MIN_CORRELATION)
        & (fit.contrast * polarity > 0)
        & (prediction_error < MAX_OFFSET)
    )
    if not board.has_markers:
        is_confirmed &= similarity.clearance > MIN_CLEARANCE
    return is_confirmed & (fit.misfit < MISFIT), fit.pixels


def without_strays(board: Board, ids: Ids, pixels: Array) -> tuple[Ids, Array]:
    """Remove corners that are inconsistent with their neighbours, worst first.

    Each outlier distorts the local maps of the others.
    """
    positions = board.points_mm[:, :2] / board.square_mm
    while len(ids) > 8:
        maps = maps_about(positions[ids], pixels, positions[ids], leave_out=True)
        deviations = np.linalg.norm(maps.pixels - pixels, axis=1)
        allowed = (MAX_STRAY[0] * maps.spacing() + MAX_STRAY[1]) * np.where(
            maps.support > 4.5, 1.0, 3.0
        )
        index = int(np.argmax(deviations / allowed))
        if deviations[index] < allowed[index]:
            break
        ids, pixels = np.delete(ids, index), np.delete(pixels, index, axis=0)
    return ids, pixels
