"""A part of a board made whole: its neighbours predicted ring by ring, and taken where the picture shows them.

What is known of the lattice says by its local map where the next corners must be and how their squares are bent. A
corner is taken where the picture, straightened by that map, correlates with four squares of the right colours. So
boards are found that no straight detector sees, without any model of the camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.numerics.products import product
from ..boards import CornerWindow
from .local_maps import LocalMaps, maps_about
from .saddles import fit_saddles

Array = NDArray[np.float64]
Places = NDArray[np.int_]
Grey = NDArray[np.float32]

HALF = 6  # samples from the middle of four squares to the edge of what is compared
SEARCH = 5  # samples by which a corner may lie elsewhere than predicted
LIKENESS = 0.6
"""Least correlation with four squares."""
SEEN = 0.45
"""The same, where the corner is known rather than predicted."""
CLEARANCE = 0.25
"""Least difference between the darker white and the lighter black square, in contrasts: not so at a board's rim."""
AWAY = 0.35
"""How far from its prediction a corner may be, in squares."""
MISFIT = 0.75
GOES_ON = 0.2
"""Share of the places past a board's outer corners that look like corners: on a margin none does, on tiles half."""
CONTRAST_OF_CORNER = 0.7
"""Least contrast of a corner past a lattice, as a ratio to the nearest corner of the lattice."""
CONTRAST_OF_OUTLINE = (0.25, 0.66)
"""The same ratio where the board's outline lies: four squares fitted to a T have half of its contrast."""
OUTLINED = 0.5
"""Least share of the places past every side of a framed board that show its outline."""
MOST_RINGS = 60
ASTRAY = (0.2, 0.6)  # in squares, and px more: what lies farther from what its neighbours say is no corner of theirs


CHECKER = CornerWindow()


class LatticePart(NamedTuple):
    """Corners of one lattice."""

    places: Places
    """(k, 2): column and row, counted from anywhere."""
    pixels: Array
    """(k, 2)"""
    polarity: int
    """Sign of the contrast where column + row is even: -1 where the square to the upper left is black."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        extent = np.ptp(self.places, axis=0) + 1
        return int(extent[0]), int(extent[1])

    def only(self, kept: NDArray[np.bool_]) -> LatticePart:
        """Some of them."""
        return LatticePart(self.places[kept], self.pixels[kept], self.polarity)


class Likeness(NamedTuple):
    """How a picture looks about places where corners may be."""

    correlation: Array
    """(m,): with four squares, the first of them white."""
    clearance: Array
    """(m,): of white above black squares, in contrasts."""
    pixels: Array
    """(m, 2): where it is most like them."""


def likeness(
    picture: Grey, maps: LocalMaps, polarity: Array, search: int = SEARCH, surroundings: CornerWindow = CHECKER
) -> Likeness:
    """Compare the picture, straightened by the maps, with four squares.

    Parameters
    ----------
    picture : (height, width)
    maps
        About m places, in sides of a square.
    polarity : (m,)
        Signs of the contrast that is looked for; 0 for either.
    search
        Samples to every side at which the corner is looked for.
    surroundings
        What about a corner shows it alone.
    """
    import cv2

    reach = HALF + search
    spacing = surroundings.half / (HALF + 0.5)
    steps = spacing * np.arange(-reach, reach + 1)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    seen = maps.at(grid).astype(np.float32)
    sampled = cv2.remap(picture, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    values = np.asarray(sampled, np.float32)
    side = len(steps)
    windows = np.lib.stride_tricks.sliding_window_view(
        values.reshape(-1, side, side), (2 * HALF + 1, 2 * HALF + 1), axis=(1, 2)
    )
    correlation = _correlation(windows, surroundings.arm / spacing)
    signed = np.where(polarity[:, None, None] == 0, np.abs(correlation), correlation * polarity[:, None, None])
    flat = signed.reshape(len(signed), -1)
    best = flat.argmax(axis=1)
    row, column = np.unravel_index(best, signed.shape[1:])
    chosen = windows[np.arange(len(best)), row, column]
    sign = np.sign(correlation.reshape(len(flat), -1)[np.arange(len(best)), best])
    shift = spacing * (np.stack([column, row], axis=1) - search)
    return Likeness(flat[np.arange(len(best)), best], _clearance(chosen, sign), maps.at(shift[:, None])[:, 0])


def _correlation(windows: NDArray[np.float32], arm: float) -> NDArray[np.float32]:
    """Of windows (.., side, side) with four squares, as far as a cross of a width shows them."""
    steps = np.arange(-HALF, HALF + 1)
    ramp = np.clip(steps / 1.5, -1, 1)
    free = np.minimum(*np.abs(np.meshgrid(steps, steps))) <= max(arm - 0.5, 1)
    weight = (free / free.sum()).astype(np.float32)
    template = (np.outer(ramp, ramp) * weight).astype(np.float32)
    flat, both = (
        np.ascontiguousarray(windows).reshape(-1, template.size),
        np.stack([template.ravel(), weight.ravel()], 1),
    )
    likeness, mean = product(flat, both).T
    power = product(flat * flat, both)[:, 1] - mean**2
    own = float(np.sum(np.outer(ramp, ramp) ** 2 * weight))
    return np.asarray(likeness / np.sqrt(np.maximum(power * own, 1e-6))).reshape(windows.shape[:-2])


def _clearance(windows: NDArray[np.float32], sign: Array) -> Array:
    """Of the darker white above the lighter black square, in differences of their means."""
    low, high = slice(0, HALF - 1), slice(HALF + 2, None)
    quarters = np.stack([windows[:, i, j].mean(axis=(1, 2)) for i in (low, high) for j in (low, high)], axis=1)
    quarters = quarters * sign[:, None]
    white, black = quarters[:, [0, 3]], quarters[:, [1, 2]]
    between = white.mean(axis=1) - black.mean(axis=1)
    return np.asarray((white.min(axis=1) - black.max(axis=1)) / np.maximum(between, 1e-6))


def grown(
    picture: Grey, part: LatticePart, *, largest: tuple[int, int] = (200, 200), rings: int = MOST_RINGS
) -> LatticePart:
    """A part of a lattice and all that joins on to it.

    Parameters
    ----------
    picture : (height, width)
        Grey.
    part
        At least four corners, two by two.
    largest
        Longer and shorter side, in corners, beyond which nothing is looked for.
    rings
        How often neighbours are looked for.
    """
    refused: dict[tuple[int, int], int] = {}
    for _ in range(rings):
        candidates = _neighbours(part, largest, refused)
        if not len(candidates):
            break
        found, pixels = _found(picture, part, candidates)
        for place in map(tuple, candidates[~found]):
            refused[place] = len(part.places)
        if not found.any():
            break
        places = np.concatenate([part.places, candidates[found]])
        part = _without_strays(LatticePart(places, np.concatenate([part.pixels, pixels[found]]), part.polarity))
    return part


def _neighbours(part: LatticePart, largest: tuple[int, int], refused: dict[tuple[int, int], int]) -> Places:
    """Places beside known ones, unless they were refused and little was learnt since."""
    known = set(map(tuple, part.places))
    low, high = part.places.min(axis=0), part.places.max(axis=0)
    sides = sorted(high - low + 1)
    found = set()
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for place in map(tuple, part.places + step):
            if place in known or len(known) < 1.15 * refused.get(place, 0):
                continue
            grows = [max(last, p) - min(first, p) + 1 for p, first, last in zip(place, low, high, strict=True)]
            if sorted(grows) == sides or (max(grows) <= largest[0] and min(grows) <= largest[1]):
                found.add(place)
    return np.array(sorted(found), dtype=int).reshape(-1, 2)


def _found(picture: Grey, part: LatticePart, candidates: Places) -> tuple[NDArray[np.bool_], Array]:
    """Which of the candidates the picture shows, and where."""
    maps = maps_about(part.places.astype(float), part.pixels, candidates.astype(float))
    height, width = picture.shape
    spacing = maps.spacing()
    reach = 0.3 * spacing[:, None]
    within = np.all((maps.pixels > reach) & (maps.pixels < np.array([width, height]) - 1 - reach), axis=1)
    # neighbours that lie far off or on top of each other come from a map that has nothing to stand on
    usual = np.median(
        np.linalg.norm(maps_about(part.places.astype(float), part.pixels, part.places.astype(float)).first, axis=1)
    )
    sane = within & (spacing > max(2.0, 0.2 * usual)) & (np.linalg.norm(maps.first, axis=1).max(axis=1) < 5 * usual)
    found = np.zeros(len(candidates), dtype=bool)
    pixels = np.full((len(candidates), 2), np.nan)
    if not sane.any():
        return found, pixels
    maps = LocalMaps(*(field[sane] for field in maps))
    polarity = part.polarity * (1 - 2 * (candidates[sane].sum(axis=1) % 2))
    like = likeness(picture, maps, polarity)
    fit = fit_saddles(picture, maps._replace(pixels=like.pixels), CHECKER, is_quick=True)
    away = np.linalg.norm(fit.pixels - maps.pixels, axis=1) / maps.spacing()
    moved = np.linalg.norm(fit.pixels - like.pixels, axis=1) / maps.spacing()
    good = (like.correlation > LIKENESS) & (like.clearance > CLEARANCE) & (fit.contrast * polarity > 0)
    good &= (away < AWAY * 1.5) & (moved < AWAY / 2) & (fit.misfit < MISFIT)
    found[sane], pixels[sane] = good, fit.pixels
    return found, pixels


class BoardSurroundings(NamedTuple):
    """What the picture shows one square past the outer corners of a lattice, at the m such places in the picture.

    Past the outer corners of tiles, of a checked cloth and of a larger board lie further corners of four squares. Past
    those of a board lies its outline, which meets the edges of the outer squares in the form of a T: four squares
    fitted to that have half of the contrast.
    """

    resembles: NDArray[np.bool_]
    """(m,): whether it resembles four squares."""
    contrast: Array
    """(m,): of four squares fitted to it, as a ratio to the nearest corner of the lattice."""
    sides: NDArray[np.bool_]
    """(4, m): on which side of the lattice the place lies."""

    @property
    def outlined(self) -> Array:
        """Share (4,) of the places on each side that show an outline; NaN where the picture ends before them."""
        is_outline = (self.contrast > CONTRAST_OF_OUTLINE[0]) & (self.contrast < CONTRAST_OF_OUTLINE[1])
        count = self.sides.sum(axis=1)
        return np.where(count > 0, (self.sides & is_outline).sum(axis=1) / np.maximum(count, 1), np.nan)

    @property
    def has_corners(self) -> bool:
        """Whether squares of full contrast continue."""
        corners = self.resembles & (self.contrast > CONTRAST_OF_CORNER)
        return bool(corners.size) and bool(corners.mean() > GOES_ON)


def goes_on(picture: Grey, part: LatticePart) -> bool:
    """Check whether squares continue past a lattice, as those of tiles, of a checked cloth and of a larger board do.

    On a white margin nothing resembles a corner. On a narrow frame with textured surroundings some places do: then all
    sides must show the outline, and few places corners of full contrast.

    Parameters
    ----------
    picture : (height, width)
        Grey.
    part
        A lattice that may be a whole board: past that is its margin.
    """
    past = surroundings(picture, part)
    if not past.resembles.any() or past.resembles.mean() <= GOES_ON:
        return False
    return past.has_corners or bool((past.outlined < OUTLINED).any())


def is_bounded(picture: Grey, part: LatticePart) -> bool:
    """Check whether the outline of a board is visible on all four sides of a lattice, so that it is complete."""
    past = surroundings(picture, part)
    return not past.has_corners and bool((past.outlined >= OUTLINED).all())


def surroundings(picture: Grey, part: LatticePart) -> BoardSurroundings:
    """Evaluate what the picture shows one square past the outer corners of a lattice."""
    low, high = part.places.min(axis=0), part.places.max(axis=0)
    beside = _neighbours(part, (MOST_RINGS, MOST_RINGS), {})
    past = beside[np.any((beside < low) | (beside > high), axis=1)]
    maps = maps_about(part.places.astype(float), part.pixels, past.astype(float))
    spacing = maps.spacing()
    reach = 0.3 * spacing[:, None]
    within = np.all((maps.pixels > reach) & (maps.pixels < np.array(picture.shape[::-1]) - 1 - reach), axis=1)
    within &= spacing > 2.0
    past, maps = past[within], LocalMaps(*(field[within] for field in maps))
    sides = np.array([past[:, 0] < low[0], past[:, 0] > high[0], past[:, 1] < low[1], past[:, 1] > high[1]])
    if not within.any():
        return BoardSurroundings(np.zeros(0, bool), np.zeros(0), sides)
    polarity = part.polarity * (1 - 2 * (past.sum(axis=1) % 2))
    like = likeness(picture, maps, polarity)
    contrast = polarity * fit_saddles(picture, maps._replace(pixels=like.pixels), CHECKER, is_quick=True).contrast
    resembles = (like.correlation > LIKENESS) & (like.clearance > CLEARANCE)
    return BoardSurroundings(resembles, contrast / _contrast_inside(picture, part, np.clip(past, low, high)), sides)


def _contrast_inside(picture: Grey, part: LatticePart, places: Places) -> Array:
    """Return the contrast (m,) of the corners of a lattice that are nearest to places (m, 2)."""
    nearest = np.abs(places[:, None] - part.places).sum(axis=2).argmin(axis=1)
    known = part.places.astype(float)
    maps = maps_about(known, part.pixels, known[nearest])._replace(pixels=part.pixels[nearest])
    return np.asarray(np.maximum(np.abs(fit_saddles(picture, maps, CHECKER, is_quick=True).contrast), 1e-6))


def _without_strays(part: LatticePart) -> LatticePart:
    """Without corners that are not where those around them say."""
    if len(part.places) < 12:
        return part
    places = part.places.astype(float)
    maps = maps_about(places, part.pixels, places, leave_out=True)
    away = np.linalg.norm(maps.pixels - part.pixels, axis=1)
    # at corners of the known part the map is extrapolated, and has less to say
    allowed = (ASTRAY[0] * maps.spacing() + ASTRAY[1]) * np.where(maps.support > 4.5, 1.0, 3.0)
    return part.only(away < allowed)


def trimmed(part: LatticePart, share: float = 0.5) -> LatticePart:
    """Without outer columns and rows of which less than a share is there."""
    while len(part.places):
        low, high = part.places.min(axis=0), part.places.max(axis=0)
        lengths = high - low + 1
        for axis in (0, 1):
            for edge in (low[axis], high[axis]):
                on = part.places[:, axis] == edge
                if on.sum() < share * lengths[1 - axis]:
                    part = part.only(~on)
                    break
            else:
                continue
            break
        else:
            return part
    return part


def from_grid(picture: Grey, pixels: Array) -> LatticePart:
    """The part that a detector's corners (rows, columns, 2) are, with the colours that the picture shows."""
    rows, columns = pixels.shape[:2]
    places = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    flat = pixels.reshape(-1, 2).astype(float)
    known = np.isfinite(flat).all(axis=1)
    places, flat = places[known], flat[known]
    return coloured(picture, places, flat)


def coloured(picture: Grey, places: Places, pixels: Array) -> LatticePart:
    """A part whose colours are taken from the picture, turned over where it runs anticlockwise; what it shows of it."""
    maps = maps_about(places.astype(float), pixels, places.astype(float))
    if np.median(np.linalg.det(maps.first)) < 0:
        places = places[:, ::-1].copy()
        maps = maps_about(places.astype(float), pixels, places.astype(float))
    parity = 1.0 - 2 * (places.sum(axis=1) % 2)
    like = likeness(picture, maps, parity, search=1)
    against = likeness(picture, maps, -parity, search=1)
    polarity = 1 if like.correlation.sum() >= against.correlation.sum() else -1
    like = like if polarity > 0 else against
    return LatticePart(places, pixels, polarity).only((like.correlation > SEEN) & (like.clearance > CLEARANCE))
