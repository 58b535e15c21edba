"""What one viewpoint costs: a central camera is right at the distances of its boards, and elsewhere a mirror is not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...cameras.frames import turned
from .bundle.adjustment import Adjustment
from .bundle.observations import Motion

Array = NDArray[np.float64]

MOST_PIXELS = 1000
CERTAIN = 5.0  # squares of the noise that each parameter more must gain; chance gains one


class ViewpointCost(NamedTuple):
    """How far off a camera of one viewpoint is at a distance."""

    distance_mm: float
    rms_px: float
    rms_deg: float


class ViewpointCosts(NamedTuple):
    """At the distances of boards it was made right; not so at others."""

    boards_mm: tuple[float, float]
    """the nearest and the farthest corner"""
    near: ViewpointCost
    """at half of the least distance"""
    far: ViewpointCost
    """infinitely far away"""


def viewpoint_costs(central: Adjustment, other: Adjustment) -> ViewpointCosts:
    """What a camera of one viewpoint costs near and far, by a model of several viewpoints fitted to the same boards.

    Each pixel that saw a corner sees something else at another distance, where the other model says. Both models have
    placed the same boards, which tells how their frames lie to each other.

    Parameters
    ----------
    central
        Of one viewpoint.
    other
        Of several.
    """
    ours, theirs = _corners(central, central), _corners(other, central)
    move = _between(theirs, ours)
    pixels = np.concatenate([s.pixels for s in central.sightings])
    pixels = pixels[:: -(-len(pixels) // MOST_PIXELS)]
    lengths = np.linalg.norm(theirs, axis=1)
    nearest, farthest = float(lengths.min()), float(lengths.max())
    near, far = (_cost(central, other, pixels, move, d) for d in (nearest / 2, np.inf))
    return ViewpointCosts((nearest, farthest), near, far)


def has_several(central: Adjustment, other: Adjustment) -> bool:
    """Whether pictures show that their camera has several viewpoints: whether a model of several fits them better.

    Parameters
    ----------
    central, other
        Of one viewpoint and of several, by least squares on the same corners.
    """
    gain = float(np.sum(central.residuals**2) - np.sum(other.residuals**2)) / other.noise_px**2
    more = int(other.question.free.sum()) - int(central.question.free.sum())
    return gain > CERTAIN * max(more, 1)


def _corners(fit: Adjustment, of: Adjustment) -> Array:
    """Corners (n, 3) of all boards of one fit, where another has them."""
    motions = {s.name: s.motion for s in fit.sightings}
    return np.concatenate([m(s.points[~s.distant]) for s in of.sightings if (m := motions.get(s.name)) is not None])


def _between(points: Array, others: Array) -> Motion:
    """The motion that takes points (n, 3) onto others, by Kabsch's method."""
    middle, other_middle = points.mean(axis=0), others.mean(axis=0)
    u, _, vt = np.linalg.svd((others - other_middle).T @ (points - middle))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return Motion(rotation, other_middle - rotation @ middle)


def _cost(central: Adjustment, other: Adjustment, pixels: Array, move: Motion, distance_mm: float) -> ViewpointCost:
    rays, world = other.model.backproject(pixels), other.model.mount.rotation()
    starts, ways = (turned(a[rays.valid], world) for a in (rays.origins, rays.directions))
    is_far = np.isinf(distance_mm)
    seen = ways @ move.rotation.T if is_far else move(starts + distance_mm * ways)
    image = central.model.image(seen, distant=bool(is_far))
    off_px = np.linalg.norm((image.pixels - pixels[rays.valid])[image.valid], axis=1)
    looks = turned(central.model.backproject(pixels[rays.valid]).directions, central.model.mount.rotation())
    off = np.linalg.norm(looks - seen / np.linalg.norm(seen, axis=1)[:, None], axis=1)
    rms_px, rms = (float(np.sqrt(np.nanmean(e**2))) if np.isfinite(e).any() else np.nan for e in (off_px, off))
    return ViewpointCost(distance_mm, rms_px, float(np.degrees(rms)))
