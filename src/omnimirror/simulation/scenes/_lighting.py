"""Illumination of surfaces: lamps and windows with soft shadows, and indirect light.

Light is computed once on a coarse grid over each face, and baked into its texture. The result is
plausible rather than radiometric: a single diffuse reflection, plus uniform ambient light with
ambient occlusion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light, hex_colour
from ...base.typing import Array
from ._painting import CLEAR, EMISSION, EMITTED, Canvas
from .surfaces import Box, Face, are_blocked, intersect_boxes

GRID_MM = 100.0  # grid spacing of the light on a face: shadows are softer than this
SOURCE_MM = 400.0  # patch size of lamps and windows
SAMPLE_OFFSET_MM = 1.0  # offset of sample points from the face, which avoids self-shadowing
DAYLIGHT = 2.0 * hex_colour("#e8f1fb")
LAMPLIGHT = 10.0  # ratio of emitted to visible light of lamps, as glare is dimmed in photographs
GLOW = 0.55 * hex_colour("#fff8ee")
SUNLIGHT = 0.85 * hex_colour("#fff3dc")
SKYLIGHT, EARTHLIGHT = 0.55 * hex_colour("#e2e9f2"), 0.35 * hex_colour("#e8ddc8")
SHADOW_RANGE_MM = 1e6  # maximum range of shadows
OCCLUSION_RANGE_MM = 1500.0  # maximum distance of ambient occlusion
OCCLUSION_DIRECTIONS = 40  # number of directions for ambient occlusion


class LightSources(NamedTuple):
    """Lamps and windows, divided into patches."""

    points: Array
    """Positions (n, 3), mm."""
    normals: Array
    """Normals (n, 3) into the room."""
    strength: Array
    """Radiance times area (n, 3), mm^2."""


def find_sources(painted: Iterable[tuple[Face, Canvas]]) -> LightSources:
    """Return the patches of all light sources: emitting faces, and faces that transmit daylight."""
    points, normals, strength = [], [], []
    for face, canvas in painted:
        if not canvas.emits:
            continue
        x, y = canvas.grid()
        rows, columns = (
            max(1, round(size / SOURCE_MM)) for size in (face.height_mm, face.width_mm)
        )
        for down in _parts(y.size, rows):
            for across in _parts(x.size, columns):
                texels = canvas.texels[down, across]
                if texels[..., EMITTED].any():  # the patch is at the centroid of its light
                    patch = LAMPLIGHT * texels[..., EMISSION] + texels[..., CLEAR, None] * DAYLIGHT
                    weight = patch.sum(axis=2)
                    points.append(face.point(*_centroid(weight, x[across], y[down])))
                    normals.append(face.normal)
                    strength.append(patch.sum(axis=(0, 1)) * np.prod(canvas.texel))
    return LightSources(
        *(np.array(part, dtype=float).reshape(-1, 3) for part in (points, normals, strength))
    )


def _parts(size: int, count: int) -> list[slice]:
    """Divide a row of a given size into about equal slices."""
    return [slice(p[0], p[-1] + 1) for p in np.array_split(np.arange(size), count) if p.size]


def _centroid(weight: Light, x: Array, y: Array) -> tuple[float, float]:
    total = weight.sum()
    return float(weight.sum(axis=0) @ x / total), float(weight.sum(axis=1) @ y / total)


def light_on(
    painted: Sequence[tuple[Face, Canvas]], room: Box, solids: Sequence[Box]
) -> Iterator[Light]:
    """Yield for each face the light (rows, columns, 3) that perfectly white texels would reflect."""
    sources = find_sources(painted)
    points = [_grid_points(face, room) for face, _ in painted]
    normals = [
        np.tile(face.normal, (len(p), 1)) for (face, _), p in zip(painted, points, strict=True)
    ]
    from_sources = direct(np.concatenate(points), np.concatenate(normals), solids, sources)
    shares = np.split(from_sources, np.cumsum([len(p) for p in points])[:-1])
    for (face, canvas), p, share in zip(painted, points, shares, strict=True):
        visibility = ambient_fraction(p, face, room, solids)
        yield _spread(share + visibility[:, None] * GLOW, visibility > 0, face, canvas, GRID_MM)


def under_sky(
    painted: Iterable[tuple[Face, Canvas]], solids: Sequence[Box], sun: Array, grid_mm: float
) -> Iterator[Light]:
    """Yield for each face the light (rows, columns, 3) that white would reflect under the sun and a
    uniform sky.

    Parameters
    ----------
    painted
        Painted faces, processed one by one without keeping the canvases.
    solids
        Solids that cast shadows.
    sun : (3,) unit vector towards it
    grid_mm
        Grid spacing of the light, if texels are not coarser.
    """
    import cv2

    for face, canvas in painted:
        step = max(grid_mm, 2 * float(canvas.texel.max()))
        points = _points_before(face, step)
        towards = float(face.normal @ sun)
        lit: Array = np.zeros(len(points))
        if towards > 0:
            in_sun = ~are_blocked(solids, points, np.tile(SHADOW_RANGE_MM * sun, (len(points), 1)))
            grid = in_sun.astype(float).reshape(_grid_shape(face, step))
            lit = np.asarray(
                towards * cv2.GaussianBlur(grid, (0, 0), 1.0).ravel(), dtype=float
            )  # avoids steps in shadows
        open_sky = 0.5 + 0.5 * face.normal[2]
        light = lit[:, None] * SUNLIGHT + open_sky * SKYLIGHT + (1 - open_sky) * EARTHLIGHT
        yield _spread(light, np.ones(len(points), dtype=bool), face, canvas, step)


def _grid_points(face: Face, room: Box) -> Array:
    """Return points (n, 3) mm just in front of a face and inside the room, in rows from its top."""
    inside: Array = np.clip(
        _points_before(face, GRID_MM),
        np.array(room.low) + SAMPLE_OFFSET_MM,
        np.array(room.high) - SAMPLE_OFFSET_MM,
    )
    return inside


def _points_before(face: Face, grid_mm: float) -> Array:
    rows, columns = _grid_shape(face, grid_mm)
    x = (np.arange(columns) + 0.5) * face.width_mm / columns
    y = face.height_mm - (np.arange(rows) + 0.5) * face.height_mm / rows
    xs, ys = np.meshgrid(x, y)
    return face.point(xs.ravel(), ys.ravel()) + SAMPLE_OFFSET_MM * face.normal


def _grid_shape(face: Face, grid_mm: float) -> tuple[int, int]:
    return max(1, round(face.height_mm / grid_mm)), max(1, round(face.width_mm / grid_mm))


def _spread(
    light: Array, free: NDArray[np.bool_], face: Face, canvas: Canvas, grid_mm: float
) -> Light:
    """Interpolate light to texels between grid points that are not covered by solids; dim ambient
    light if all are covered.
    """
    import cv2

    weight = np.where(free, 1.0, 1e-3)[:, None]
    weighted = np.hstack([weight * np.where(free[:, None], light, GLOW / 2), weight])
    grid = weighted.reshape(*_grid_shape(face, grid_mm), 4).astype(np.float32)
    rows, columns, _ = canvas.texels.shape
    smooth = cv2.resize(grid, (columns, rows), interpolation=cv2.INTER_LINEAR).reshape(
        rows, columns, 4
    )
    spread: Light = np.divide(smooth[..., :3], smooth[..., 3:], dtype=np.float32)
    return spread


def direct(points: Array, normals: Array, solids: Sequence[Box], sources: LightSources) -> Array:
    """Return light (n, 3) of lamps and windows reflected by white at points (n, 3) mm with normals
    (n, 3).

    Each patch adds radiance x area x cos x cos / (pi distance^2) unless a solid occludes it.

    >>> lamp = LightSources(np.array([[0.0, 0.0, 1000.0]]), np.array([[0.0, 0.0, -1.0]]), np.full((1, 3), 1e6 * np.pi))
    >>> points, up = np.array([[0.0, 0.0, 0.0], [0.0, 1000.0, 0.0]]), np.array([[0.0, 0.0, 1.0]] * 2)
    >>> direct(points, up, [], lamp)[:, 0].round(6)  # 45 deg aside: cos^4
    array([1.  , 0.25])
    """
    light = np.zeros_like(points)
    for point, towards, strength in zip(*sources, strict=True):
        vectors = point - points
        square, facing = (np.einsum("ij,ij->i", vectors, other) for other in (vectors, normals))
        # A patch is not a point source: limits the singularity
        square = np.maximum(square, SOURCE_MM**2 / 16)
        share = np.maximum(facing, 0) * np.maximum(-vectors @ towards, 0) / (np.pi * square**2)
        lit = np.flatnonzero(share)
        lit = lit[~are_blocked(solids, points[lit], vectors[lit])]
        light[lit] += share[lit, None] * strength
    return light


def ambient_fraction(points: Array, face: Face, room: Box, solids: Sequence[Box]) -> Array:
    """Return the fraction (n,) of ambient light at points (n, 3) mm of a face: 1 far from all
    objects.
    """
    vectors = _hemisphere() @ np.stack([face.right, face.up, face.normal])
    low, high = points.min(axis=0), points.max(axis=0)
    near = [solid for solid in solids if _may_dim(solid, low, high, face)]
    distance = intersect_boxes(
        room,
        near,
        np.repeat(points, OCCLUSION_DIRECTIONS, axis=0),
        np.tile(vectors, (len(points), 1)),
    ).distance
    return np.asarray(
        np.minimum(np.sqrt(distance / OCCLUSION_RANGE_MM), 1)
        .reshape(-1, OCCLUSION_DIRECTIONS)
        .mean(axis=1)
    )


def _may_dim(solid: Box, low: Array, high: Array, face: Face) -> bool:
    """Return True if a solid may be within range of points of a face between corners (3,) mm, and
    not entirely behind it.
    """
    ends = np.array([solid.low, solid.high])
    gap = np.maximum(0, np.maximum(ends[0] - high, low - ends[1]))
    nearest_to_normal = np.where(face.normal > 0, ends[1], ends[0])
    return bool(
        gap @ gap < OCCLUSION_RANGE_MM**2 and face.normal @ nearest_to_normal >= face.normal @ low
    )


def _hemisphere() -> Array:
    """Return cosine-weighted directions (WAYS, 3) about z on a golden spiral."""
    i = np.arange(OCCLUSION_DIRECTIONS) + 0.5
    radius, turn = np.sqrt(i / OCCLUSION_DIRECTIONS), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)], axis=1)
