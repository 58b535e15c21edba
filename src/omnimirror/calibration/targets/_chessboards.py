"""Chessboard detection in distorted images: seeds of four squares, lattice growth and completion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.numerics import matrix_product
from ...base.typing import Array
from ._corner_refinement import LocalMaps, fit_saddles, maps_about
from ._image_preparation import Grey, bytes_of, scaled, scales, unscaled_px, upwards
from .boards import Board, CornerWindow

# -- Lattice growth --------------------------------------------------------------------------------
#
# The local map of the known lattice predicts the position of the next corners and the curvature of
# their squares. A corner is accepted if the image, rectified by that map, correlates with four
# squares of the correct colours. This detects boards without a camera model in images too distorted
# for conventional detectors.

Places = NDArray[np.int_]

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


# -- Seeds -----------------------------------------------------------------------------------------


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
