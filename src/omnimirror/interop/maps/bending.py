"""From a picture back into a view: where on a screen the ray of each pixel of the picture ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...cameras import Camera
from ...dewarp.screens import Screen, View, parts_of
from ...dewarp.viewpoints import Viewpoint, centre_of_projection

Array = NDArray[np.float64]

NODES = 160  # of a screen, along its longer side, from which Newton's method starts
STEPS = 8  # of it; each squares what is left
CLOSE_PX = 1e-6
NUDGE_PX = 1e-3  # over which a screen is taken for flat
AT_ONCE = 1 << 16  # rays


def bent_pixels(camera: Camera, view: View, viewpoint: Viewpoint) -> Array:
    """Pixels of a view (height, width, 2) at which the rays of a camera's picture end; NaN where at none."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    bent = np.full_like(pixels, np.nan)
    for left, top, screen in parts_of(view):
        centre = centre_of_projection(camera, screen, viewpoint)
        for first in range(0, len(pixels), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            rays = camera.backproject(pixels[part])
            origins = rays.origins if centre is None else np.broadcast_to(centre, rays.origins.shape)
            found = np.full((len(rays.valid), 2), np.nan)
            found[rays.valid] = ends_of(screen, origins[rays.valid], rays.directions[rays.valid])
            ends = np.isfinite(found[:, 0])
            bent[part][ends] = found[ends] + (left, top)
    return bent.reshape(height, width, 2)


def ends_of(screen: Screen, origins: Array, directions: Array) -> Array:
    """Pixels (n, 2) of a screen at which rays (n, 3), (n, 3) end; NaN for those that miss it.

    By Newton's method on the screen's own formula, from the node of a coarse grid that is seen nearest to the ray. A
    panorama all around goes on past its ends: what comes out beyond one is tried again beside the other.
    """
    width, height = screen.size
    if not len(directions):
        return np.empty((0, 2))
    starts, near = _nearest_nodes(screen, origins, directions)
    pixels = np.full_like(starts, np.nan)
    pixels[near] = _solved(screen, starts[near], origins[near], directions[near])
    for axis, side in enumerate((width, height)):
        beyond = np.isfinite(pixels[:, axis]) & ((pixels[:, axis] < -0.5) | (pixels[:, axis] > side - 0.5))
        if beyond.any():
            other = pixels[beyond]
            other[:, axis] += np.where(other[:, axis] < 0, side, -side)
            pixels[beyond] = _solved(screen, other, origins[beyond], directions[beyond])
    inside = (pixels >= -0.5).all(-1) & (pixels <= np.array([width, height]) - 0.5).all(-1)
    pixels[~inside] = np.nan
    return pixels


def _nearest_nodes(screen: Screen, origins: Array, directions: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The nodes (n, 2) of a coarse grid that are seen nearest to rays, from a common place amid their origins.

    And which rays may end on the screen at all: those that pass a node no farther than its cells, and the places of
    their origins, reach.
    """
    width, height = screen.size
    step = max(width, height) / NODES
    u, v = np.meshgrid(*(np.linspace(0, side - 1, int(np.ceil((side - 1) / step)) + 1) for side in (width, height)))
    nodes = np.stack([u.ravel(), v.ravel()], axis=-1)
    targets, middle = _targets(screen, nodes), origins.mean(axis=0)
    if not screen.is_distant:
        targets = targets - middle
    length = np.linalg.norm(targets, axis=-1)
    there = np.isfinite(length) & (length > 0)
    towards = np.where(there, targets.T / np.where(there, length, 1.0), np.nan).T
    grid = towards.reshape(*u.shape, 3)
    sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1) for axis in (0, 1)]
    reach = sum(float(np.nanmax(side, initial=0.0)) for side in sides)
    if not screen.is_distant:
        reach += 2 * float(np.linalg.norm(origins - middle, axis=-1).max() / length[there].min())
    _, nearest = cKDTree(towards[there]).query(directions, distance_upper_bound=reach)
    near = np.asarray(nearest < there.sum())
    return nodes[there][np.where(near, nearest, 0)], near


def _targets(screen: Screen, pixels: Array) -> Array:
    """What pixels (n, 2) of a screen look at, (n, 3)."""
    return np.asarray(screen.targets_at(pixels[:, 0], pixels[:, 1])).reshape(len(pixels), 3)


def _solved(screen: Screen, pixels: Array, origins: Array, directions: Array) -> Array:
    """Newton's method from pixels (n, 2) to where the screen is seen along rays; NaN where it does not get there."""
    across = np.cross(directions, np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    axes = np.stack([across, np.cross(directions, across)], axis=1)  # square to the ray
    pixels, ends = pixels.copy(), np.full_like(pixels, np.nan)
    left = np.arange(len(pixels))  # those that are still on their way
    with np.errstate(all="ignore"):  # of rays that meet nothing
        for _ in range(STEPS):
            bundle = origins[left], axes[left], directions[left]
            move, ahead = _step(screen, pixels[left], *bundle)
            pixels[left] -= move
            size = np.linalg.norm(move, axis=-1)
            arrived = ahead & (size < CLOSE_PX)
            ends[left[arrived]] = pixels[left[arrived]]
            left = left[~arrived & (size < 2 * max(screen.size))]
            if not len(left):
                break
    return ends


def _step(
    screen: Screen, pixels: Array, origins: Array, axes: Array, directions: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """A step of Newton's method (n, 2), and whether the screen is seen ahead on the ray."""

    def beside(places: Array) -> tuple[Array, Array]:
        """How far beside the rays places of the screen are seen, (n, 2), and how far ahead."""
        towards = _targets(screen, places) - (0.0 if screen.is_distant else origins)
        towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        return np.einsum("nij,nj->ni", axes, towards), np.einsum("nj,nj->n", towards, directions)

    off, ahead = beside(pixels)
    (a, c), (b, d) = (((beside(pixels + nudge)[0] - off) / NUDGE_PX).T for nudge in NUDGE_PX * np.eye(2))
    move = np.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], axis=-1)
    return move / (a * d - b * c)[:, None], np.asarray(ahead > 0)
