"""Observations: pixels with their known points, directions, lines or planes.

One form serves all kinds. A :class:`Sighting` holds the observations of one rigid target in one
image: corners of a board with unknown pose, surveyed points, stars, edges. Points are given in
the target frame; a known or estimated :class:`Motion` transforms them to the camera frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import finite
from ....base.errors import InvalidParameter
from ....base.typing import Array, Mask


class Motion(NamedTuple):
    """Rigid transform from a target frame to the camera frame: ``X = rotation @ p + shift_mm``.

    Examples
    --------
    >>> turned = Motion(rotation_of(np.array([0.0, 0.0, np.pi / 2])), np.array([0.0, 0.0, 500.0]))
    >>> turned(np.array([[10.0, 0.0, 0.0]])).round(6) + 0.0
    array([[  0.,  10., 500.]])
    """

    rotation: Array
    """Rotation matrix (3, 3)."""
    shift_mm: Array
    """Translation (3,)."""

    @classmethod
    def none(cls) -> Motion:
        """Return the identity transform.

        Returns
        -------
        Motion
            Identity.
        """
        return cls(np.eye(3), np.zeros(3))

    def __call__(self, points_mm: Array) -> Array:
        """Return points (n, 3) in the camera frame."""
        moved: Array = points_mm @ self.rotation.T + self.shift_mm
        return moved


def moved(motions: Sequence[Motion], steps: Array) -> tuple[Motion, ...]:
    """Apply steps (m, 6), rotation vectors and translations, to rigid transforms."""
    before = np.array([m.rotation for m in motions])
    rotations = rotations_of(steps[:, :3]) @ before
    # orthonormalise: rounding of many steps does not accumulate
    rotations = rotations @ (1.5 * np.eye(3) - 0.5 * rotations.transpose(0, 2, 1) @ rotations)
    shifts = np.array([m.shift_mm for m in motions]) + steps[:, 3:]
    return tuple(Motion(r, t) for r, t in zip(rotations, shifts, strict=True))


def rotation_of(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) in radians.

    >>> rotation_of(np.array([0.0, 0.0, np.pi / 2])).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    matrix: Array = rotations_of(np.asarray(vector, dtype=float)[None])[0]
    return matrix


def rotations_of(vectors: Array) -> Array:
    """Return rotation matrices (n, 3, 3) of rotation vectors (n, 3) in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = z, -y, x
    first, second = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2  # sin(a) / a, (1 - cos(a)) / a^2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


@dataclass(frozen=True)
class Sighting:
    """Observations of one target in one image.

    Parameters
    ----------
    name
        Name of the image.
    pixels : (n, 2)
        Observed pixels, px.
    points : (n, 3)
        Observed points in the target frame in mm, or directions where ``is_distant``.
    motion
        Known or initial pose of the target; None: unknown, without an initial value (boards only).
    is_known
        Whether ``motion`` is known and not estimated.
    is_distant
        Whether the targets are at infinity, such as stars and the sun; one value, or one per point
        (n,) if an image contains both.
    along : (n, 3), optional
        For observed lines: directions of the lines through ``points``. The observed point may be
        anywhere on its line.
    normals : (n, 3), optional
        For marks on planes: normals of the planes through ``points``. The mark may be anywhere on
        its plane. A single observation of a mark gives no constraint; several images must observe
        it under the same number in ``ids``.
    ids : (n,), optional
        Numbers of the points, such as corner numbers of a board; 0, 1, ... by default.
    is_surveyed
        Whether the points are exact, independent of the board shape in other images.

    Raises
    ------
    InvalidParameter
        If the numbers of pixels and points differ, or a known pose is missing.

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
        """Return unit vectors (n, 3), one per point."""
        given = finite(name, getattr(self, name), last=3)
        lengths = np.linalg.norm(given, axis=-1, keepdims=True)
        if given.shape != (count, 3) or not (lengths > 0).all():
            raise InvalidParameter(f"{self.name}: {name} {given.shape} are not ({count}, 3) directions, one a point")
        return np.asarray(given / lengths)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def distant(self) -> Mask:
        """Mask (n,) of points that are directions."""
        return np.broadcast_to(np.asarray(self.is_distant, dtype=bool), len(self.pixels))

    def before(self, motion: Motion) -> Array:
        """Return the observed targets in the camera frame for a given pose.

        Parameters
        ----------
        motion
            Transform from the target frame to the camera frame.

        Returns
        -------
        (n, 3) array
            Points in mm, and directions of distant targets.
        """
        turned: Array = self.points @ motion.rotation.T
        return turned + np.where(self.distant[:, None], 0.0, motion.shift_mm)

    def only(self, kept: Mask | NDArray[np.int64]) -> Sighting:
        """Return the sighting with a subset of its points.

        Parameters
        ----------
        kept : (n,) or (k,)
            Mask or indices of the retained points.

        Returns
        -------
        Sighting
            Sighting with k points.
        """
        assert self.ids is not None
        along, normals = (None if d is None else d[kept] for d in (self.along, self.normals))
        distant = self.distant[kept] if np.ndim(self.is_distant) else self.is_distant
        return replace(
            self, pixels=self.pixels[kept], points=self.points[kept], along=along, normals=normals, ids=self.ids[kept],
            is_distant=distant,
        )  # fmt: skip

    def moved(self, motion: Motion | None) -> Sighting:
        """Return the sighting with another pose.

        Parameters
        ----------
        motion
            Transform from the target frame to the camera frame; None: unknown.

        Returns
        -------
        Sighting
            Sighting with the same pixels.
        """
        return replace(self, motion=motion)


class Marks(NamedTuple):
    """Marks at unknown positions on planes, each observed in several images."""

    ids: NDArray[np.int64]
    """Mark numbers (k,)."""
    number: NDArray[np.int64]
    """Index of the mark of each point (n,); -1 without a mark."""
    axes: Array
    """Two directions in the plane of each mark (n, 3, 2); 0 without a mark."""

    def changes(self) -> Array:
        """Return derivatives (n, 3, 2k) of the points with respect to the marks."""
        change = np.zeros((len(self.number), 3, 2 * len(self.ids)))
        at = np.flatnonzero(self.number >= 0)
        for axis in (0, 1):
            change[at, :, 2 * self.number[at] + axis] = self.axes[at, :, axis]
        return change


class Stack(NamedTuple):
    """Concatenated points of several sightings."""

    pixels: Array
    """Pixels (n, 2)."""
    points: Array
    """Points (n, 3)."""
    owner: NDArray[np.int64]
    """Index of the sighting (n,)."""
    distant: Mask
    """Mask of directions (n,)."""
    shaped: Mask
    """Mask of points that follow the board shape (n,)."""
    along: Array | None
    """Line directions (n, 3), 0 for points; None without lines."""
    slices: tuple[slice, ...]
    """Range of points of each sighting."""
    ids: NDArray[np.int64]
    """Point numbers (n,)."""
    marks: Marks | None
    """Marks on planes; None if there are none."""


def stacked(sightings: Sequence[Sighting]) -> Stack:
    """Return the concatenation of sightings."""
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
    """Return the marks on planes by their numbers.

    Raises
    ------
    InvalidParameter
        If only one image observes a mark, or a mark belongs to two planes.
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
    """Return ``sqrt(mean |e|^2)`` of residuals (n, 2): per point in two dimensions, as in OpenCV.

    >>> rms_px([[3.0, 4.0], [0.0, 0.0]])  # sqrt((25 + 0) / 2)
    3.5355339059327378
    """
    e = np.asarray(residuals, dtype=float).reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum(e * e, axis=1)))) if len(e) else float("nan")
