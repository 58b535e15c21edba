"""Painted scenes: canvas with lettering, painted faces as surfaces, illumination, and a landscape."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.caching import cached_property
from ...base.colour import Light, hex_colour
from ...base.errors import InvalidParameter
from ...base.typing import Array
from .scene import Box, Face, Scene, Surfaces, Texture, are_blocked, face_of, intersect_boxes

# -- Lettering -------------------------------------------------------------------------------------

OVERSAMPLING = 8  # oversampling of letters before averaging, for edges with 65 grey levels
FONT = "DejaVu Sans"


@cache
def lettering(text: str, cap_height_px: float) -> Light:
    """Return the coverage (h, w) of a word in bold letters, 1 inside and 0 outside, cropped to the
    ink.

    Row 0 is the top of the letters and column 0 their left, in reading direction.

    Parameters
    ----------
    text
    cap_height_px : px
        Height of a capital H.

    Raises
    ------
    InvalidParameter
        If the text has no ink.

    Examples
    --------
    >>> bitmap = lettering("H", 20.0)
    >>> bitmap.shape[0], float(bitmap[10].max()), float(bitmap[2, bitmap.shape[1] // 2])
    (20, 1.0, 0.0)
    """
    import cv2
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        raise InvalidParameter(f"text must contain at least one visible letter; got {text!r}")
    font = FontProperties(family=FONT, weight="bold")
    capital = TextPath((0, 0), "H", size=100, prop=font).get_extents().height
    scale = cap_height_px * OVERSAMPLING / capital
    outlines = [
        np.asarray(p) * scale for p in TextPath((0, 0), text, size=100, prop=font).to_polygons()
    ]
    points = np.concatenate(outlines)
    left, top = points[:, 0].min(), points[:, 1].max()
    width, height = np.ceil((np.ptp(points, axis=0) - 1e-6) / OVERSAMPLING).astype(int)
    fine = np.zeros((height * OVERSAMPLING, width * OVERSAMPLING), dtype=np.float32)
    shapes = [
        np.rint(np.column_stack([p[:, 0] - left, top - p[:, 1]])).astype(np.int32) for p in outlines
    ]
    # Even-odd filling of all shapes at once keeps holes open, as in an O
    cv2.fillPoly(fine, shapes, 1.0)
    ink: Light = fine.reshape(height, OVERSAMPLING, width, OVERSAMPLING).mean(axis=(1, 3))
    return ink


# -- Canvas ----------------------------------------------------------------------------------------
#
# Shapes are painted with the covered fraction of each texel (antialiasing); edges are smooth and
# unbiased at any resolution.

ALBEDO, EMISSION, CLEAR, EMITTED = slice(0, 3), slice(3, 6), 6, slice(3, 7)
"""Channels of a canvas: albedo, emitted light, transmitted fraction of outside light, and the last
two combined.
"""


class Extent(NamedTuple):
    """Rectangle on a canvas, mm from its lower left corner."""

    left: float
    bottom: float
    right: float
    top: float


@dataclass(frozen=True)
class Paint:
    """Surface properties: a reflecting colour, an emitting colour, or clear glass."""

    colour: str = "#000000"
    glow: float = 0.0
    """Emitted light in its colour; white paper in the room is about 0.7."""
    clear: float = 0.0
    """Transmitted fraction of outside light."""

    @property
    def emits(self) -> bool:
        """True if it emits or transmits light."""
        return self.glow != 0 or self.clear != 0

    @cached_property
    def channels(self) -> Light:
        """All seven channels."""
        colour = hex_colour(self.colour)
        lit = colour * (self.glow == 0) * (1 - self.clear)
        return np.concatenate([lit, colour * self.glow, [self.clear]]).astype(np.float32)


class Canvas:
    """Rectangular canvas.

    Parameters
    ----------
    width_mm, height_mm : mm
    texel_mm : mm
        Texel size; rounded to fit a whole number of texels.
    ground
        Initial paint.

    Examples
    --------
    >>> canvas = Canvas(40.0, 20.0, 10.0, Paint("#000000"))
    >>> canvas.rectangle(15.0, 10.0, 40.0, 20.0, Paint("#ffffff"))
    >>> canvas.texels[:, :, 0]  # row 0 is the top
    array([[0. , 0.5, 1. , 1. ],
           [0. , 0. , 0. , 0. ]], dtype=float32)
    """

    def __init__(self, width_mm: float, height_mm: float, texel_mm: float, ground: Paint) -> None:
        columns, rows = (max(1, round(size / texel_mm)) for size in (width_mm, height_mm))
        self.width_mm, self.height_mm = width_mm, height_mm
        self.texel = np.array([width_mm / columns, height_mm / rows])
        self.texels: Light = np.empty((rows, columns, 7), np.float32)
        self.texels[:] = ground.channels
        self.emits = ground.emits
        """True if any texel may emit or transmit light."""

    def rectangle(self, left: float, bottom: float, right: float, top: float, paint: Paint) -> None:
        """Paint a rectangle between two corners, mm."""
        rows, columns, _ = self.texels.shape
        across = _covered(left / self.texel[0], right / self.texel[0], columns)
        down = _covered(rows - top / self.texel[1], rows - bottom / self.texel[1], rows)
        for rows_of, high in down:
            for columns_of, wide in across:
                self._cover(rows_of, columns_of, high * wide, paint)

    def frame(
        self, left: float, bottom: float, right: float, top: float, thickness: float, paint: Paint
    ) -> None:
        """Paint the border of a rectangle, within it, mm."""
        t = thickness
        self.rectangle(left, bottom, right, bottom + t, paint)
        self.rectangle(left, top - t, right, top, paint)
        self.rectangle(left, bottom + t, left + t, top - t, paint)
        self.rectangle(right - t, bottom + t, right, top - t, paint)

    def disc(self, x: float, y: float, radius: float, paint: Paint) -> None:
        """Paint a disc about (x, y), mm."""
        (dx, dy), (rows, columns, _) = self.texel, self.texels.shape
        reach = radius + dx + dy
        across = _touched((x - reach) / dx, (x + reach) / dx, columns)
        down = _touched(rows - (y + reach) / dy, rows - (y - reach) / dy, rows)
        xs, ys = self.grid()
        distance = np.hypot(xs[across] - x, (ys[down] - y)[:, None])
        self._cover(
            down, across, np.clip((radius - distance) / self.texel.mean() + 0.5, 0, 1), paint
        )

    def checkerboard(self, x: float, y: float, tile: float, paint: Paint) -> None:
        """Paint every other square tile, one with its corner at (x, y), mm."""
        xs, ys = self.grid()
        across = _square_wave((xs - x) / tile, self.texel[0] / tile)
        up = _square_wave((ys - y) / tile, self.texel[1] / tile)
        self._cover(slice(None), slice(None), (1 + up[:, None] * across) / 2, paint)

    def text(self, word: str, x: float, y: float, cap_height: float, paint: Paint) -> Extent:
        """Paint a word centred on (x, y), mm, to the nearest texel; return the extent of its ink."""
        ink = lettering(word, cap_height / float(self.texel[1]))
        rows, columns = ink.shape
        left = round(x / self.texel[0] - columns / 2)
        top = round((self.height_mm - y) / self.texel[1] - rows / 2)
        self._cover(slice(top, top + rows), slice(left, left + columns), ink, paint)
        dx, dy = map(float, self.texel)
        return Extent(
            left * dx,
            self.height_mm - (top + rows) * dy,
            (left + columns) * dx,
            self.height_mm - top * dy,
        )

    def grid(self) -> tuple[Array, Array]:
        """Return the texel centres, mm: x of the columns from the left, y of the rows from the
        bottom.
        """
        rows, columns, _ = self.texels.shape
        return (np.arange(columns) + 0.5) * self.texel[0], self.height_mm - (
            np.arange(rows) + 0.5
        ) * self.texel[1]

    def _cover(
        self, down: slice, across: slice, coverage: Array | Light | float, paint: Paint
    ) -> None:
        self.emits |= paint.emits
        window = self.texels[down, across]
        if isinstance(coverage, float) and coverage == 1.0:
            window[:] = paint.channels
        else:
            window += np.asarray(coverage, np.float32)[..., None] * (paint.channels - window)


def _touched(start: float, stop: float, count: int) -> slice:
    """Return the slice of ``count`` cells that an interval overlaps, in cells from the first edge."""
    first = max(0, int(np.floor(start)))
    return slice(first, max(first, min(count, int(np.ceil(stop)))))


def _covered(start: float, stop: float, count: int) -> list[tuple[slice, float]]:
    """Return the cells overlapped by an interval, separately at its ends, with the covered fraction
    of each.

    >>> _covered(0.5, 4.25, 9)
    [(slice(0, 1, None), 0.5), (slice(1, 4, None), 1.0), (slice(4, 5, None), 0.25)]
    """
    cells = _touched(start, stop, count)
    edges = sorted(
        {
            cells.start,
            min(cells.start + 1, cells.stop),
            max(cells.stop - 1, cells.start),
            cells.stop,
        }
    )
    shares = [float(np.clip(min(stop, cell + 1) - max(start, cell), 0, 1)) for cell in edges[:-1]]
    return [(slice(*ends), share) for ends, share in zip(pairwise(edges), shares, strict=True)]


def _square_wave(x: Array, width: float) -> Array:
    """Return a square wave of +1 on [0, 1) and -1 on [1, 2), averaged over ``width`` about each x."""

    low, high = (
        1 - np.abs(np.mod(x + shift, 2) - 1) for shift in (-width / 2, width / 2)
    )  # its integral: a triangle
    return np.asarray((high - low) / width)


# -- Landscape at infinity -------------------------------------------------------------------------

ZENITH, HAZE = hex_colour("#4f86c6"), hex_colour("#e6edf2")
SOFTNESS_DEG = 0.15  # edge width of the ridges

RIDGES = (
    ("#8fa6b8", 7.0, ((1.6, 5, 0.4), (0.9, 13, 1.9), (0.3, 41, 0.0))),
    ("#6f8f74", 3.2, ((1.3, 4, 2.2), (0.6, 17, 0.7), (0.2, 59, 1.0))),
    ("#4d6b45", -1.0, ((0.9, 6, 5.1), (0.4, 23, 0.2), (0.25, 97, 2.0))),
)
"""Ridges from far to near: colour, height (deg), and the waves of their outline
(deg, per turn, phase).
"""


def landscape_light(directions: Array) -> Light:
    """Return linear RGB (n, 3) of the landscape in non-zero directions (n, 3).

    >>> blue_sky, meadow = landscape_light(np.array([[0.0, 1.0, 2.0], [0.0, 1.0, -0.2]]))
    >>> bool(blue_sky[2] > blue_sky[0]), bool(meadow[1] > meadow[2])
    (True, True)
    """
    x, y, z = directions.T
    azimuth, elevation = np.arctan2(y, x), np.degrees(np.arctan2(z, np.hypot(x, y)))
    haze = np.exp(-np.clip(elevation, 0, None) / 14.0)[:, None].astype(np.float32)
    light: Light = ZENITH + haze * (HAZE - ZENITH)
    for colour, height, waves in RIDGES:
        line = height + sum(size * np.sin(turns * azimuth + phase) for size, turns, phase in waves)
        covered = np.clip((line - elevation) / SOFTNESS_DEG + 0.5, 0, 1)[:, None].astype(np.float32)
        light += covered * (hex_colour(colour) - light)
    return light


# -- Painted faces as surfaces ---------------------------------------------------------------------


def illuminated_texels(canvas: Canvas, light: Light) -> Light:
    """Return light emitted and reflected by a face, and its transmittance: (rows, columns, 4)."""
    texels: Light = np.empty((*light.shape[:2], 4), np.float32)
    np.multiply(canvas.texels[..., ALBEDO], light, out=texels[..., :3])
    if canvas.emits:
        texels[..., :3] += canvas.texels[..., EMISSION]
    texels[..., 3] = canvas.texels[..., CLEAR]
    return texels


def surfaces_of_faces(faces: Sequence[Face], textures_of_faces: Sequence[Light]) -> Surfaces:
    """Return surfaces from faces with their images (rows, columns, 4), whose first row is the top."""
    corners = np.array(
        [(f.point(0.0, f.height_mm), f.width_mm * f.right, -f.height_mm * f.up) for f in faces]
    )
    texels = np.array(
        [((-0.5, -0.5), (p.shape[1], 0), (0, p.shape[0])) for p in textures_of_faces], dtype=float
    )
    count = len(faces)
    textures = tuple(Texture(np.ascontiguousarray(p, np.float32)) for p in textures_of_faces)
    return Surfaces.of(corners.reshape(-1, 3, 3), texels, np.arange(count), False, textures)


def outer_faces(boxes: Sequence[Box]) -> list[Face]:
    """Return the six faces of each box, seen from outside."""
    return [face_of(box, i, inside=False) for box in boxes for i in range(6)]


class Surroundings:
    """Surfaces, and their background at infinity.

    Parameters
    ----------
    surfaces
    background
        Background of rays that meet no surface or a transparent one; black if None.
    """

    def __init__(self, surfaces: Surfaces, background: Scene | None = None) -> None:
        self.surfaces, self.background = surfaces, background

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        non-zero length.
        """
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        light, clear, distance = self.surfaces.first_hits(origins, towards)
        if self.background is not None:
            share = np.where(np.isinf(distance), np.float32(1), clear)
            background_rays = np.flatnonzero(share)
            light[background_rays] += share[background_rays, None] * self.background.radiance(
                origins[background_rays], towards[background_rays]
            )
        return light

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays to the first surface; infinite without intersection."""
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        length = np.linalg.norm(towards, axis=1)
        # Unit directions preserve full single precision
        distance: Array = self.surfaces.first_hits(
            origins, towards / length[:, None]
        ).distance.astype(float)
        return distance

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings:
        """Return itself for rays from any box (3,), (3,) mm."""
        return self


@runtime_checkable
class PaintedScene(Protocol):
    """Scene that consists of surfaces and a background only, and is supported by the kernels."""

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between corners (3,), (3,) mm; None if
        the box is not permitted.
        """
        ...


class Landscape:
    """Sky and hills at infinity."""

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) in directions (n, 3)."""

        return landscape_light(directions)


# -- Illumination: lamps and windows with soft shadows, and indirect light -------------------------
#
# Light is computed once on a coarse grid over each face, and baked into its texture. The result is
# plausible rather than radiometric: a single diffuse reflection, plus uniform ambient light with
# ambient occlusion.

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
        visibility = openness(p, face, room, solids)
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


def openness(points: Array, face: Face, room: Box, solids: Sequence[Box]) -> Array:
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
