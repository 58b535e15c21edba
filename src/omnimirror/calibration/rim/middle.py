"""Detection of the camera's own image at the centre of the mirror: a disc with little texture."""

from __future__ import annotations

from itertools import islice

import numpy as np

from .cues import ring_of
from .edges import EdgePoints, Working
from .ellipses import Ellipse, laid_through
from .votes import circles_between

LEAST, LARGEST = 0.04, 0.6  # fractions of the rim's radius
LEAST_PX = 5.0
RADIUS_STEP = 1.06
OFFSET, VOTED_OFFSET = 0.12, 0.15  # fractions of the rim's radius, for disc and circle
TRIED = 20  # circles
SUPPORT, CALM = 0.45, 0.4  # fraction of the circumference with an edge; ratio of texture
BUSY = 0.08  # texture of a scene
STRETCH_COST = 4.0  # fraction of the circumference that a stretch must gain
REACHES_PX = (2.0, 1.2)


def camera_image(working: Working, edges: EdgePoints, rim: Ellipse) -> Ellipse | None:
    """Return the clearest disc at the centre of a rim, both at working size; None if there is none."""
    away = np.linalg.norm(edges.points - np.asarray(rim.centre), axis=1) / rim.radius
    inner = edges.among(away < LARGEST + OFFSET)
    if not len(inner.points):
        return None
    radii = max(LEAST * rim.radius, LEAST_PX), LARGEST * rim.radius
    voted = circles_between(inner, working.size, radii, RADIUS_STEP)
    best, most = None, SUPPORT
    for circle in islice((one for one in voted if rim.offset_share(one) < VOTED_OFFSET), TRIED):
        disc = laid_through(inner, circle, REACHES_PX)
        if rim.offset_share(disc) < OFFSET and (clear := _clear(working, inner, disc)) > most:
            best, most = disc, clear
    return best


def _clear(working: Working, edges: EdgePoints, disc: Ellipse) -> float:
    """Return the edge clarity of a round disc with little texture inside and much outside, else 0."""
    ring = ring_of(working, edges, disc)
    if ring is None:
        return 0.0
    inside, outside = ring.band(0.2, 0.9), ring.band(1.06, 1.4)
    if not inside < CALM * outside:
        return 0.0
    edge = (ring.support + ring.close - ring.chance) / 2 - STRETCH_COST * float(np.hypot(*disc.stretch))
    return edge * min(1.0, outside / BUSY)
