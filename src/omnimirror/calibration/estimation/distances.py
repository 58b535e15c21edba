"""Parallax error of single-viewpoint models at object distances other than the boards'."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.typing import Array
from ...cameras.frames import turned
from .bundle.adjustment import Adjustment
from .bundle.observations import Motion

MOST_PIXELS = 1000
CERTAIN = 5.0  # minimum gain in squared noise per additional parameter; chance gains 1


class ViewpointCost(NamedTuple):
    """Parallax error of a single-viewpoint camera at one object distance."""

    distance_mm: float
    rms_px: float
    rms_deg: float


class ViewpointCosts(NamedTuple):
    """Parallax errors at object distances other than those of the boards."""

    boards_mm: tuple[float, float]
    """Distances of the nearest and the farthest corner."""
    near: ViewpointCost
    """Error at 0.5 times the minimum board distance."""
    far: ViewpointCost
    """Error at infinity."""


def viewpoint_costs(central: Adjustment, other: Adjustment) -> ViewpointCosts:
    """Estimate the parallax error of a single-viewpoint camera near and far.

    A model with several viewpoints, fitted to the same boards, is the reference: for each pixel of
    a corner it gives the object point at another distance. The common boards determine the rigid
    transform between the frames of both models.

    Parameters
    ----------
    central
        Fit with one viewpoint.
    other
        Fit with several viewpoints.
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
    """Return whether a model with several viewpoints fits the images significantly better.

    Parameters
    ----------
    central, other
        Least-squares fits with one viewpoint and with several, on the same corners.
    """
    gain = float(np.sum(central.residuals**2) - np.sum(other.residuals**2)) / other.noise_px**2
    more = int(other.question.free.sum()) - int(central.question.free.sum())
    return gain > CERTAIN * max(more, 1)


def _corners(fit: Adjustment, of: Adjustment) -> Array:
    """Return the corners (n, 3) of all boards in one fit, limited to those of another fit."""
    motions = {s.name: s.motion for s in fit.sightings}
    return np.concatenate([m(s.points[~s.distant]) for s in of.sightings if (m := motions.get(s.name)) is not None])


def _between(points: Array, others: Array) -> Motion:
    """Return the rigid transform between point sets (n, 3) by Kabsch's method."""
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
