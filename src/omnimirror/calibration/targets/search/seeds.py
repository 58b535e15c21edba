"""Seeds of the board search: corners of four squares, and sets of nine that form a grid."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.numerics.products import product
from ....base.typing import Array
from .growing import LatticePart, coloured

Grey = NDArray[np.float32]

BLUR_PX = 1.5  # of the derivatives
MOST = 1500  # maximum number of corner candidates
LEAST_RESPONSE = 0.02  # relative to the strong responses
RING_PX = 4.5
LEAST_RING = 0.6  # minimum correlation of the ring with four alternating quarters
MOST_SEEDS = 200
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
    even, odd = product(values, np.stack([np.cos(2 * turn), -np.sin(2 * turn)], axis=1)).T / len(turn)
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
    nines = [nine for i in range(len(found.pixels)) if (nine := _nine(found, tree, nearest[i])) is not None]
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
        if len(chosen) == MOST_SEEDS:
            break
    return chosen


def _nine(found: Crossings, tree: Any, near: NDArray[np.int_]) -> tuple[float, NDArray[np.int_]] | None:
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
    wanted = np.array([left + up - centre, right + up - centre, left + down - centre, right + down - centre])
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
