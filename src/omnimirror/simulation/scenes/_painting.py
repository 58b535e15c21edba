"""Painted scenes: canvas with lettering, painted faces as surfaces, and a landscape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ...base.caching import cached_property
from ...base.colour import Light, hex_colour
from ...base.errors import InvalidParameter
from ...base.typing import Array
from .scene import Scene
from .surfaces import Box, Face, Surfaces, Texture, face_of

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
