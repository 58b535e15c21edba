"""Completion of a partially identified board: predicted corners, verified in the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....base.typing import Array
from ..boards import Board
from .greys import Grey
from .growing import AWAY, CLEARANCE, LIKENESS, MISFIT, likeness
from .local_maps import LocalMaps, maps_about
from .saddles import fit_saddles

Ids = NDArray[np.int_]

SUPPORT = 2.0
"""Minimum total weight of known corners around a predicted one."""
ASTRAY = (0.2, 0.6)


def completed(picture: Grey, board: Board, ids: Ids, pixels: Array) -> tuple[Ids, Array]:
    """Return known and predicted corners, ordered by id.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image.
    board
        Calibration board.
    ids : (k,)
        Ids of known corners.
    pixels : (k, 2)
        Pixels of known corners.
    """
    places = board.points_mm[:, :2] / board.square_mm
    asked: set[int] = set()
    while True:
        missing = np.setdiff1d(np.arange(board.corner_count), ids)
        maps = maps_about(places[ids], pixels, places[missing])
        near = (maps.support > SUPPORT) & ~np.isin(missing, list(asked))
        if not near.any():
            break
        missing = missing[near]
        found, seen = _found(picture, board, missing, LocalMaps(*(field[near] for field in maps)))
        asked |= set(missing[~found].tolist())
        if not found.any():
            break
        ids, pixels = np.concatenate([ids, missing[found]]), np.concatenate([pixels, seen[found]])
    order = np.argsort(ids)
    return ids[order], pixels[order]


def predicted(picture: Grey, board: Board, known_mm: Array, known_px: Array) -> tuple[Ids, Array]:
    """Return the corners of a board predicted from other points on it.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image.
    board
        Calibration board.
    known_mm : (m, 2)
        Known points of the board.
    known_px : (m, 2)
        Pixels of these points.
    """
    places = board.points_mm[:, :2] / board.square_mm
    maps = maps_about(known_mm / board.square_mm, known_px, places)
    near = np.flatnonzero(maps.support > SUPPORT)
    found, pixels = _found(picture, board, near, LocalMaps(*(field[near] for field in maps)))
    return near[found], pixels[found]


def _found(picture: Grey, board: Board, ids: Ids, maps: LocalMaps) -> tuple[NDArray[np.bool_], Array]:
    height, width = picture.shape
    spacing = maps.spacing()
    margin = board.surroundings.half / 2 * spacing[:, None]
    inside = np.all((maps.pixels > margin) & (maps.pixels < np.array([width, height]) - 1 - margin), axis=1)
    # in a mirrored image the board's axes run anticlockwise, but colours do not change
    polarity = board.polarity[ids].astype(float)
    like = likeness(picture, maps, polarity, surroundings=board.surroundings)
    fit = fit_saddles(picture, maps._replace(pixels=like.pixels), board.surroundings, is_quick=True)
    away = np.linalg.norm(fit.pixels - maps.pixels, axis=1) / spacing
    found = inside & (like.correlation > LIKENESS) & (fit.contrast * polarity > 0) & (away < AWAY)
    if not board.has_markers:
        found &= like.clearance > CLEARANCE
    return found & (fit.misfit < MISFIT), fit.pixels


def without_strays(board: Board, ids: Ids, pixels: Array) -> tuple[Ids, Array]:
    """Remove corners that are inconsistent with their neighbours, worst first.

    Each outlier distorts the local maps of the others.
    """
    places = board.points_mm[:, :2] / board.square_mm
    while len(ids) > 8:
        maps = maps_about(places[ids], pixels, places[ids], leave_out=True)
        off = np.linalg.norm(maps.pixels - pixels, axis=1)
        allowed = (ASTRAY[0] * maps.spacing() + ASTRAY[1]) * np.where(maps.support > 4.5, 1.0, 3.0)
        worst = int(np.argmax(off / allowed))
        if off[worst] < allowed[worst]:
            break
        ids, pixels = np.delete(ids, worst), np.delete(pixels, worst, axis=0)
    return ids, pixels
