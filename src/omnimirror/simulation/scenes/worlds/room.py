"""Furnished room: the main bundled scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import checked, finite
from ....base.colour import Light
from ....base.errors import InvalidParameter
from ....base.native import backend
from ....base.numerics.lazy import cached_property
from ....base.parameters import Parameter
from ....base.typing import Array
from ..boxes import FACES, Face, face_of, meet, rays_inside
from ..canvas import Canvas, Extent
from ..lighting import light_on
from .decor import PIECES, ROOM, paint_room
from .landscape import landscape_light
from .painted import Landscape, Surroundings, finished, outsides, surfaces_of

TEXEL = Parameter("mm", 1.0, 100.0, "fineness of what is painted")
AHEAD = 1  # face of the wall ahead
PLAIN_MM = 25.0  # sufficient for faces with shading only
SOLIDS = tuple(piece.box for piece in PIECES)
SIDES = ("wall behind", "wall ahead", "wall right", "wall left", "floor", "ceiling")
FURNITURE = tuple(dict.fromkeys(piece.name for piece in PIECES))
LABELS = np.array(
    [*range(1, 1 + len(SIDES)), *(1 + len(SIDES) + FURNITURE.index(p.name) for p in PIECES for _ in SIDES)], np.int64
)
"""Label of each face, from 1 on: the sides of the room individually, then one label per solid."""


@dataclass(frozen=True)
class Room:
    """Room of 6 x 5 x 3 m around the sensor, which is 1.2 m high and off-centre.

    OMNIMIRROR is written on the wall ahead, GARDEN over the windows to the left, LIBRARY behind and
    EXIT over the door to the right. The walls are at finite distances and rays are intersected
    exactly; images therefore include the parallax of the actual viewpoints of the mirror. The
    landscape outside the windows is at infinity.

    Parameters
    ----------
    texel_mm : mm
        Texel size of the walls. The room is painted and lit at the first use, once for all equal
        rooms.
    elsewhere_mm : mm
        Texel size of all faces except the wall ahead; ``texel_mm`` if None. At 2 mm the whole room
        takes 0.5 GB, and three times as much during painting; the wall ahead alone 1/8 of it.

    Raises
    ------
    InvalidParameter
        If the texel size is out of range.

    Examples
    --------
    >>> room = Room(texel_mm=40.0)
    >>> wall, sky = room.radiance(np.zeros((2, 3)), [[1.0, 0.0, 0.1], [1.5, 2.3, 0.8]])
    >>> bool(sky[2] > 1.2 * sky[0])
    True
    >>> room.sign_corners_mm("OMNIMIRROR").round()  # on the wall x = 3400, as one reads it
    array([[ 3400.,  1620.,   920.],
           [ 3400., -2020.,   920.],
           [ 3400., -2020.,   520.],
           [ 3400.,  1620.,   520.]])
    """

    texel_mm: float = 5.0
    elsewhere_mm: float | None = None

    def __post_init__(self) -> None:
        TEXEL.check("texel_mm", self.texel_mm)
        if self.elsewhere_mm is not None:
            TEXEL.check("elsewhere_mm", self.elsewhere_mm)

    @property
    def _faces(self) -> _Painted:
        return _painted(self.texel_mm, self.texel_mm if self.elsewhere_mm is None else self.elsewhere_mm)

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        length but 0.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.

        Raises
        ------
        InvalidParameter
            If a ray starts outside the room, or a direction is zero or not finite.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        painted = self._faces
        if backend.is_compiled:
            return painted.surroundings.radiance(origins, towards)
        hits = meet(ROOM, SOLIDS, origins, towards)  # boxes are faster than surfaces in NumPy
        light, clear = painted.look_up(hits.face, origins + hits.distance[:, None] * towards)
        outside = np.flatnonzero(clear)
        light[outside] += clear[outside, None] * landscape_light(towards[outside])
        return light

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between two corners.

        Parameters
        ----------
        low_mm, high_mm : (3,)
            Corners of the box, mm.

        Returns
        -------
        Surroundings
            Surfaces of the room; None if the box is not inside it.

        Raises
        ------
        InvalidParameter
            If the corners are not points.
        """
        low_mm, high_mm = (finite(name, v, last=3) for name, v in (("low_mm", low_mm), ("high_mm", high_mm)))
        inside = (np.array(ROOM.low) <= low_mm).all() and (np.array(ROOM.high) >= high_mm).all()
        return self._faces.surroundings if inside else None

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays to a wall or a piece of furniture; window panes count as
        walls.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Distances, mm; infinite without a surface.

        Raises
        ------
        InvalidParameter
            As in :meth:`radiance`.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        length: Array = np.linalg.norm(towards, axis=1)
        return meet(ROOM, SOLIDS, origins, towards).distance * length

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the labels of :meth:`labels`, from 1 on: the sides of the room, and the objects
        in it.
        """
        return SIDES + FURNITURE

    def labels(self, origins_mm: ArrayLike, directions: ArrayLike) -> NDArray[np.int64]:
        """Return the labels of rays.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Indices in :attr:`label_names`, from 1 on.

        Raises
        ------
        InvalidParameter
            As in :meth:`radiance`.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        found: NDArray[np.int64] = LABELS[meet(ROOM, SOLIDS, origins, towards).face]
        return found

    @property
    def words(self) -> tuple[str, ...]:
        """Words on the walls."""
        return tuple(self._faces.signs)

    @checked
    def sign_corners_mm(self, word: str) -> Array:
        """Return the corners (4, 3) mm of the ink of a word: top left, top right, bottom right,
        bottom left.

        Parameters
        ----------
        word
            Word in :attr:`words`.

        Returns
        -------
        (4, 3) array
            Corners, mm.

        Raises
        ------
        InvalidParameter
            If the word is not on a wall.
        """
        signs = self._faces.signs
        if word not in signs:
            raise InvalidParameter(f"there is no word {word!r} in the room; there are {', '.join(signs)}")
        return signs[word].copy()


# -- painted and lit faces -----------------------------------------------------------------------------


class _Painted:
    """All faces of the room and of the solids in a single list of texels, indexed by point."""

    def __init__(self, faces: list[Face], pictures: list[Light], signs: dict[str, Array]) -> None:
        self.signs = signs
        self.surroundings = Surroundings(surfaces_of(faces, pictures), Landscape())
        self._sizes = np.array([p.shape[:2] for p in pictures])
        self._starts = np.concatenate([[0], np.cumsum(self._sizes.prod(axis=1))])[:-1]
        self._pictures = pictures
        # Column and row of a point p are A p + b; columns count from the left, rows from the top
        scale = self._sizes[:, ::-1] / np.array([(f.width_mm, f.height_mm) for f in faces])
        axes = np.array([(f.right, -f.up) for f in faces]) * scale[..., None]
        top_left = np.array([f.point(0.0, f.height_mm) for f in faces])
        self._axes, self._shifts = axes, -np.einsum("fij,fj->fi", axes, top_left) - 0.5

    @cached_property
    def _texels(self) -> Light:
        """All texels in a row; unused with the compiled module, which would store them twice."""
        return np.concatenate([p.reshape(-1, 4) for p in self._pictures])

    def look_up(self, face: NDArray[np.int32], points_mm: Array) -> tuple[Light, NDArray[np.float32]]:
        """Return light (n, 3) of points (n, 3) on faces (n,), and the transmitted fraction (n,) of
        the background.
        """
        place = np.einsum("nij,nj->ni", self._axes[face], points_mm) + self._shifts[face]
        last = self._sizes[face] - 1
        rows, columns = last.T
        column = np.clip(place[:, 0], 0, columns)
        row = np.clip(place[:, 1], 0, rows)
        left, top = column.astype(np.int64), row.astype(np.int64)
        fx = (column - left).astype(np.float32)[:, None]
        fy = (row - top).astype(np.float32)[:, None]
        first = self._starts[face] + top * (columns + 1) + left
        right = (left < columns).astype(np.int64)
        below = np.where(top < rows, columns + 1, 0)
        upper = self._mix(first, first + right, fx)
        lower = self._mix(first + below, first + below + right, fx)
        upper += fy * (lower - upper)
        return upper[:, :3], upper[:, 3]

    def _mix(self, one: NDArray[np.int64], other: NDArray[np.int64], share: Light) -> Light:
        texels = self._texels[one]
        texels += share * (self._texels[other] - texels)
        return texels


@lru_cache(maxsize=2)
def _painted(texel_mm: float, elsewhere_mm: float) -> _Painted:
    """Paint and light all faces, and store both in one image per face."""
    faces = [face_of(ROOM, i, inside=True) for i in FACES]
    faces += outsides(SOLIDS)
    canvases: list[Canvas] = []
    signs: dict[str, Array] = {}
    for i in FACES:
        canvas, extents = paint_room(i, texel_mm if i == AHEAD else elsewhere_mm, faces[i].width_mm, faces[i].height_mm)
        canvases.append(canvas)
        signs |= {word: _corners(faces[i], extent) for word, extent in extents.items()}
    for number, face in enumerate(faces[6:]):
        piece = PIECES[number // 6]
        decorate = piece.decorate.get(number % 6)
        fineness = max(elsewhere_mm, PLAIN_MM) if decorate is None else elsewhere_mm
        canvas = Canvas(face.width_mm, face.height_mm, fineness, piece.paint)
        if decorate is not None:
            decorate(canvas)
        canvases.append(canvas)
    lights = light_on(list(zip(faces, canvases, strict=True)), ROOM, SOLIDS)
    pictures = []
    for canvas, light in zip(canvases, lights, strict=True):
        pictures.append(finished(canvas, light))
        # A fine room takes 500 MB, and its paint twice as much
        canvas.texels = canvas.texels[:0].copy()
    return _Painted(faces, pictures, signs)


def _corners(face: Face, extent: Extent) -> Array:
    left, bottom, right, top = extent
    return face.point(np.array([left, right, right, left]), np.array([top, top, bottom, bottom]))
