"""What pictures saw: pixels, and the points, directions, lines or planes that they are known to show.

One form serves all kinds. A :class:`Sighting` is what one picture shows of things that stand still together: corners
of a board whose place is unknown, points of a room that was surveyed, stars, edges. Its points are in a frame of their
own, and a :class:`Motion` takes them into the camera frame, known or to be found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import finite
from ....base.errors import InvalidParameter

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Motion(NamedTuple):
    """From a target's frame to the camera frame: ``X = rotation @ p + shift_mm``.

    Examples
    --------
    >>> turned = Motion(rotation_of(np.array([0.0, 0.0, np.pi / 2])), np.array([0.0, 0.0, 500.0]))
    >>> turned(np.array([[10.0, 0.0, 0.0]])).round(6) + 0.0
    array([[  0.,  10., 500.]])
    """

    rotation: Array
    """(3, 3)"""
    shift_mm: Array
    """(3,)"""

    @classmethod
    def none(cls) -> Motion:
        """The target's frame is the camera frame.

        Returns
        -------
        Motion
            That moves nothing.
        """
        return cls(np.eye(3), np.zeros(3))

    def __call__(self, points_mm: Array) -> Array:
        """Points (n, 3) in the camera frame."""
        moved: Array = points_mm @ self.rotation.T + self.shift_mm
        return moved


def moved(motions: Sequence[Motion], steps: Array) -> tuple[Motion, ...]:
    """Motions after small rotation vectors, applied after their rotations, and shifts: steps (m, 6)."""
    before = np.array([m.rotation for m in motions])
    rotations = rotations_of(steps[:, :3]) @ before
    # rounding of many steps does not add up
    rotations = rotations @ (1.5 * np.eye(3) - 0.5 * rotations.transpose(0, 2, 1) @ rotations)
    shifts = np.array([m.shift_mm for m in motions]) + steps[:, 3:]
    return tuple(Motion(r, t) for r, t in zip(rotations, shifts, strict=True))


def rotation_of(vector: Array) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (3,) in radians.

    >>> rotation_of(np.array([0.0, 0.0, np.pi / 2])).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    matrix: Array = rotations_of(np.asarray(vector, dtype=float)[None])[0]
    return matrix


def rotations_of(vectors: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3) in radians, by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = z, -y, x
    first, second = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2  # sin(a) / a, (1 - cos(a)) / a^2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


@dataclass(frozen=True)
class Sighting:
    """What one picture saw of one target.

    Parameters
    ----------
    name
        Of the picture.
    pixels : (n, 2)
        Where the points were seen, px.
    points : (n, 3)
        What was seen: points in the target's frame in mm, or directions in it where ``is_distant``.
    motion
        Where the target stands, known or as a start; None: unknown, and to be found from nothing (boards alone).
    is_known
        Whether ``motion`` is known, and is not estimated.
    is_distant
        Whether what was seen is so far away that directions are all that counts, as stars and the sun; of each (n,)
        where a picture shows both.
    along : (n, 3), optional
        Where lines were seen: the directions of the lines through ``points``, on which the point that was seen may lie
        anywhere.
    normals : (n, 3), optional
        Where marks on planes were seen: normals of the planes through ``points``, on which the mark may lie anywhere.
        Somewhere on a plane any pixel looks: a mark says something where several pictures see it, under the same number
        in ``ids``.
    ids : (n,), optional
        Numbers of the points, such as those of a board's corners; 0, 1, .. by default.
    is_surveyed
        Whether the points are where they are said to be, whatever the shape of the board that other pictures show.

    Raises
    ------
    InvalidParameter
        Not as many of one as of the other, or a motion that is said to be known and is not given.

    Examples
    --------
    >>> sun = Sighting("noon", [[400.0, 300.0]], [[0.0, 0.0, -1.0]], Motion.none(), is_known=True, is_distant=True)
    >>> len(sun)
    1
    """

    name: str
    pixels: Array
    points: Array
    motion: Motion | None = None
    is_known: bool = False
    is_distant: bool | Mask = False
    along: Array | None = None
    normals: Array | None = None
    ids: NDArray[np.int64] | None = None
    is_surveyed: bool = False

    def __post_init__(self) -> None:
        pixels, points = finite("pixels", self.pixels, last=2), finite("points", self.points, last=3)
        if pixels.ndim != 2 or len(pixels) != len(points):
            raise InvalidParameter(
                f"{self.name}: pixels {pixels.shape} and points {points.shape} are not as many; valid: (n, 2), (n, 3)"
            )
        if self.is_known and self.motion is None:
            raise InvalidParameter(f"{self.name}: its motion is said to be known and not given")
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "points", points)
        ids = np.arange(len(pixels)) if self.ids is None else np.asarray(self.ids, dtype=np.int64)
        object.__setattr__(self, "ids", ids)
        if np.ndim(self.is_distant) and np.shape(self.is_distant) != (len(pixels),):
            raise InvalidParameter(
                f"{self.name}: is_distant is one truth value, or one for each of {len(pixels)} points"
            )
        for name in ("along", "normals"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._directions(name, len(pixels)))
        if self.normals is not None and (self.along is not None or self.distant.any()):
            raise InvalidParameter(f"{self.name}: normals belong to planes, not to lines or to what is far away")

    def _directions(self, name: str, count: int) -> Array:
        """Unit vectors (n, 3), one for each point."""
        given = finite(name, getattr(self, name), last=3)
        lengths = np.linalg.norm(given, axis=-1, keepdims=True)
        if given.shape != (count, 3) or not (lengths > 0).all():
            raise InvalidParameter(f"{self.name}: {name} {given.shape} are not ({count}, 3) directions, one a point")
        return np.asarray(given / lengths)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def distant(self) -> Mask:
        """Which of the points (n,) are directions."""
        return np.broadcast_to(np.asarray(self.is_distant, dtype=bool), len(self.pixels))

    def before(self, motion: Motion) -> Array:
        """What was seen, in the camera frame, if the target stands where a motion takes it.

        Parameters
        ----------
        motion
            From the target's frame to the camera's.

        Returns
        -------
        (n, 3) array
            Points, mm, and directions where they are distant.
        """
        turned: Array = self.points @ motion.rotation.T
        return turned + np.where(self.distant[:, None], 0.0, motion.shift_mm)

    def only(self, kept: Mask | NDArray[np.int64]) -> Sighting:
        """The same with some of its points.

        Parameters
        ----------
        kept : (n,) or (k,)
            Which, as truth values or indices.

        Returns
        -------
        Sighting
            With k points.
        """
        assert self.ids is not None
        along, normals = (None if d is None else d[kept] for d in (self.along, self.normals))
        distant = self.distant[kept] if np.ndim(self.is_distant) else self.is_distant
        return replace(
            self, pixels=self.pixels[kept], points=self.points[kept], along=along, normals=normals, ids=self.ids[kept],
            is_distant=distant,
        )  # fmt: skip

    def moved(self, motion: Motion | None) -> Sighting:
        """The same with another motion.

        Parameters
        ----------
        motion
            From the target's frame to the camera's; None: unknown.

        Returns
        -------
        Sighting
            Of the same pixels.
        """
        return replace(self, motion=motion)


class Marks(NamedTuple):
    """Marks somewhere on planes, each seen in several pictures, that find out together where it lies."""

    ids: NDArray[np.int64]
    """(k,)"""
    number: NDArray[np.int64]
    """(n,) which mark each point is; -1 where it is none"""
    axes: Array
    """(n, 3, 2) two directions of its plane; 0 where it is none"""

    def changes(self) -> Array:
        """How points move with the marks: (n, 3, 2k)."""
        change = np.zeros((len(self.number), 3, 2 * len(self.ids)))
        at = np.flatnonzero(self.number >= 0)
        for axis in (0, 1):
            change[at, :, 2 * self.number[at] + axis] = self.axes[at, :, axis]
        return change


class Stack(NamedTuple):
    """All points of several sightings in one row, for arithmetic."""

    pixels: Array
    """(n, 2)"""
    points: Array
    """(n, 3)"""
    owner: NDArray[np.int64]
    """(n,) number of the sighting"""
    distant: Mask
    """(n,)"""
    shaped: Mask
    """(n,) which move with the board's shape"""
    along: Array | None
    """(n, 3); 0 where a point was seen; None where no line was"""
    slices: tuple[slice, ...]
    """where each sighting's points are"""
    ids: NDArray[np.int64]
    """(n,)"""
    marks: Marks | None
    """on planes; None where there are none"""


def stacked(sightings: Sequence[Sighting]) -> Stack:
    """Sightings one behind the other."""
    if not sightings:
        raise InvalidParameter("there is nothing to adjust: no picture saw anything")
    counts = [len(s) for s in sightings]
    ends = np.cumsum(counts)
    along = None
    if any(s.along is not None for s in sightings):
        along = np.concatenate([np.zeros((len(s), 3)) if s.along is None else s.along for s in sightings])
    return Stack(
        np.concatenate([s.pixels for s in sightings]),
        np.concatenate([s.points for s in sightings]),
        np.repeat(np.arange(len(sightings)), counts),
        np.concatenate([s.distant for s in sightings]),
        np.concatenate([~s.distant & (not s.is_surveyed) for s in sightings]),
        along,
        tuple(slice(int(e) - c, int(e)) for e, c in zip(ends, counts, strict=True)),
        np.concatenate([s.ids for s in sightings if s.ids is not None]),
        _marks(sightings) if any(s.normals is not None for s in sightings) else None,
    )


def _marks(sightings: Sequence[Sighting]) -> Marks:
    """Marks on planes, by their numbers.

    Raises
    ------
    InvalidParameter
        One that a single picture shows, or on two planes.
    """
    ids = np.concatenate([s.ids for s in sightings if s.ids is not None])
    points = np.concatenate([s.points for s in sightings])
    normals = np.concatenate([np.zeros((len(s), 3)) if s.normals is None else s.normals for s in sightings])
    at = np.flatnonzero(np.any(normals != 0, axis=1))
    known, first, number, count = np.unique(ids[at], return_index=True, return_inverse=True, return_counts=True)
    if (alone := known[count < 2]).size:
        raise InvalidParameter(
            f"mark {alone[0]} on a plane is seen once, which says nothing: somewhere on it every pixel looks; it is "
            "valid with the same number (ids) in several pictures"
        )
    one, other = at[first][number], at
    off = np.abs(np.sum(normals[one] * (points[other] - points[one]), axis=1))
    size = 1e-6 * (np.linalg.norm(points[other], axis=1) + np.linalg.norm(points[one], axis=1))
    if (apart := (off > size) | (np.abs(np.sum(normals[one] * normals[other], axis=1)) < 1 - 1e-9)).any():
        raise InvalidParameter(f"mark {ids[at][apart][0]} is said to lie on two planes; it is valid on one")
    axes = np.zeros((len(ids), 3, 2))
    axes[at] = np.linalg.svd(normals[one][:, None])[2][:, 1:].transpose(0, 2, 1)
    numbers = np.full(len(ids), -1)
    numbers[at] = number
    return Marks(known, numbers, axes)


def rms_px(residuals: ArrayLike) -> float:
    """``sqrt(mean |e|^2)`` of residuals (n, 2): per point in two dimensions, as OpenCV reports it.

    >>> rms_px([[3.0, 4.0], [0.0, 0.0]])  # sqrt((25 + 0) / 2)
    3.5355339059327378
    """
    e = np.asarray(residuals, dtype=float).reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum(e * e, axis=1)))) if len(e) else float("nan")
