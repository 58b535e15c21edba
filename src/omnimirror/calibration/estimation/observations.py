"""Observations: pixels with known points or directions, survey files, simulated detections, and
residuals with their derivatives with respect to camera, poses and board shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import finite, integer, number, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array, Mask
from ...cameras.camera import Camera
from ...cameras.models.camera_model import CameraModel
from ..straight_edges import IMAGE_COLUMN, TableRow, read_point_table
from ..targets import Board, Detection

# -- Observations ----------------------------------------------------------------------------------
#
# One form serves all kinds. A :class:`Observation` holds the observations of one rigid target in one
# image: corners of a board with unknown pose, surveyed points, stars, edges. Points are given in
# the target frame; a known or estimated :class:`RigidTransform` transforms them to the camera frame.


class RigidTransform(NamedTuple):
    """Rigid transform from a target frame to the camera frame: ``X = rotation @ p + shift_mm``.

    Examples
    --------
    >>> turned = RigidTransform(rotation_of(np.array([0.0, 0.0, np.pi / 2])), np.array([0.0, 0.0, 500.0]))
    >>> turned(np.array([[10.0, 0.0, 0.0]])).round(6) + 0.0
    array([[  0.,  10., 500.]])
    """

    rotation: Array
    """Rotation matrix (3, 3)."""
    translation_mm: Array
    """Translation (3,)."""

    @classmethod
    def identity(cls) -> RigidTransform:
        """Return the identity transform.

        Returns
        -------
        RigidTransform
            Identity.
        """
        return cls(np.eye(3), np.zeros(3))

    def __call__(self, points_mm: Array) -> Array:
        """Return points (n, 3) in the camera frame."""
        points: Array = points_mm @ self.rotation.T + self.translation_mm
        return points


def moved(poses: Sequence[RigidTransform], steps: Array) -> tuple[RigidTransform, ...]:
    """Apply steps (m, 6), rotation vectors and translations, to rigid transforms."""
    initial_rotations = np.array([m.rotation for m in poses])
    rotations = rotations_of(steps[:, :3]) @ initial_rotations
    # orthonormalise: rounding of many steps does not accumulate
    rotations = rotations @ (1.5 * np.eye(3) - 0.5 * rotations.transpose(0, 2, 1) @ rotations)
    shifts = np.array([m.translation_mm for m in poses]) + steps[:, 3:]
    return tuple(RigidTransform(r, t) for r, t in zip(rotations, shifts, strict=True))


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
    first, second = (
        np.sinc(angle / np.pi),
        np.sinc(angle / (2 * np.pi)) ** 2 / 2,
    )  # sin(a) / a, (1 - cos(a)) / a^2
    # Rodrigues: R = I + sin(a) / a K + (1 - cos(a)) / a^2 K^2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


@dataclass(frozen=True)
class Observation:
    """Observations of one target in one image.

    Parameters
    ----------
    name
        Name of the image.
    pixels : (n, 2)
        Observed pixels, px.
    points : (n, 3)
        Observed points in the target frame in mm, or directions where ``is_distant``.
    pose
        Known or initial pose of the target; None: unknown, without an initial value (boards only).
    is_known
        Whether ``pose`` is known and not estimated.
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
    >>> pose = RigidTransform.identity()
    >>> pixels, directions = [[400.0, 300.0]], [[0.0, 0.0, -1.0]]
    >>> sun = Observation("noon", pixels, directions, pose, is_known=True, is_distant=True)
    >>> len(sun)
    1
    """

    name: str
    pixels: Array
    points: Array
    pose: RigidTransform | None = None
    is_known: bool = False
    is_distant: bool | Mask = False
    along: Array | None = None
    normals: Array | None = None
    ids: NDArray[np.int64] | None = None
    is_surveyed: bool = False

    def __post_init__(self) -> None:
        pixels, points = (
            finite("pixels", self.pixels, last=2),
            finite("points", self.points, last=3),
        )
        if pixels.ndim != 2 or len(pixels) != len(points):
            raise InvalidParameter(
                f"{self.name}: pixels (n, 2) and points (n, 3) must have the same length; "
                f"got {pixels.shape} and {points.shape}"
            )
        if self.is_known and self.pose is None:
            raise InvalidParameter(f"{self.name}: a known pose must be specified; got None")
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "points", points)
        ids = np.arange(len(pixels)) if self.ids is None else np.asarray(self.ids, dtype=np.int64)
        object.__setattr__(self, "ids", ids)
        if np.ndim(self.is_distant) and np.shape(self.is_distant) != (len(pixels),):
            raise InvalidParameter(
                f"{self.name}: is_distant must be one truth value, or one for each of "
                f"{len(pixels)} points; got shape {np.shape(self.is_distant)}"
            )
        for name in ("along", "normals"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._directions(name, len(pixels)))
        if self.normals is not None and (self.along is not None or self.distant.any()):
            raise InvalidParameter(
                f"{self.name}: normals must not be combined with lines or distant points"
            )

    def _directions(self, name: str, count: int) -> Array:
        """Return unit vectors (n, 3), one per point."""
        directions = finite(name, getattr(self, name), last=3)
        lengths = np.linalg.norm(directions, axis=-1, keepdims=True)
        if directions.shape != (count, 3) or not (lengths > 0).all():
            raise InvalidParameter(
                f"{self.name}: {name} must be {count} nonzero directions ({count}, 3), one "
                f"per point; got shape {directions.shape}"
            )
        return np.asarray(directions / lengths)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def distant(self) -> Mask:
        """Mask (n,) of points that are directions."""
        return np.broadcast_to(np.asarray(self.is_distant, dtype=bool), len(self.pixels))

    def in_camera_frame(self, pose: RigidTransform) -> Array:
        """Return the observed targets in the camera frame for a given pose.

        Parameters
        ----------
        pose
            Transform from the target frame to the camera frame.

        Returns
        -------
        (n, 3) array
            Points in mm, and directions of distant targets.
        """
        rotated: Array = self.points @ pose.rotation.T
        return rotated + np.where(self.distant[:, None], 0.0, pose.translation_mm)

    def subset(self, selected: Mask | NDArray[np.int64]) -> Observation:
        """Return the observation with a subset of its points.

        Parameters
        ----------
        selected : (n,) or (k,)
            Mask or indices of the retained points.

        Returns
        -------
        Observation
            Observation with k points.
        """
        assert self.ids is not None
        along, normals = (None if d is None else d[selected] for d in (self.along, self.normals))
        distant = self.distant[selected] if np.ndim(self.is_distant) else self.is_distant
        return replace(
            self,
            pixels=self.pixels[selected],
            points=self.points[selected],
            along=along,
            normals=normals,
            ids=self.ids[selected],
            is_distant=distant,
        )

    def with_pose(self, pose: RigidTransform | None) -> Observation:
        """Return the observation with another pose.

        Parameters
        ----------
        pose
            Transform from the target frame to the camera frame; None: unknown.

        Returns
        -------
        Observation
            Observation with the same pixels.
        """
        return replace(self, pose=pose)


class Marks(NamedTuple):
    """Marks at unknown positions on planes, each observed in several images."""

    ids: NDArray[np.int64]
    """Mark numbers (k,)."""
    number: NDArray[np.int64]
    """Index of the mark of each point (n,); -1 without a mark."""
    axes: Array
    """Two directions in the plane of each mark (n, 3, 2); 0 without a mark."""

    def derivatives(self) -> Array:
        """Return derivatives (n, 3, 2k) of the points with respect to the marks."""
        change = np.zeros((len(self.number), 3, 2 * len(self.ids)))
        marked = np.flatnonzero(self.number >= 0)
        for axis in (0, 1):
            change[marked, :, 2 * self.number[marked] + axis] = self.axes[marked, :, axis]
        return change


class Stack(NamedTuple):
    """Concatenated points of several observations."""

    pixels: Array
    """Pixels (n, 2)."""
    points: Array
    """Points (n, 3)."""
    owner: NDArray[np.int64]
    """Index of the observation (n,)."""
    distant: Mask
    """Mask of directions (n,)."""
    shaped: Mask
    """Mask of points that follow the board shape (n,)."""
    along: Array | None
    """Line directions (n, 3), 0 for points; None without lines."""
    slices: tuple[slice, ...]
    """Range of points of each observation."""
    ids: NDArray[np.int64]
    """Point numbers (n,)."""
    marks: Marks | None
    """Marks on planes; None if there are none."""


def stacked(observations: Sequence[Observation]) -> Stack:
    """Return the concatenation of observations."""
    if not observations:
        raise InvalidParameter("observations must contain at least one image; got none")
    counts = [len(s) for s in observations]
    ends = np.cumsum(counts)
    along = None
    if any(s.along is not None for s in observations):
        along = np.concatenate(
            [np.zeros((len(s), 3)) if s.along is None else s.along for s in observations]
        )
    return Stack(
        np.concatenate([s.pixels for s in observations]),
        np.concatenate([s.points for s in observations]),
        np.repeat(np.arange(len(observations)), counts),
        np.concatenate([s.distant for s in observations]),
        np.concatenate([~s.distant & (not s.is_surveyed) for s in observations]),
        along,
        tuple(slice(int(e) - c, int(e)) for e, c in zip(ends, counts, strict=True)),
        np.concatenate([s.ids for s in observations if s.ids is not None]),
        _marks(observations) if any(s.normals is not None for s in observations) else None,
    )


def _marks(observations: Sequence[Observation]) -> Marks:
    """Return the marks on planes by their numbers.

    Raises
    ------
    InvalidParameter
        If only one image observes a mark, or a mark belongs to two planes.
    """
    ids = np.concatenate([s.ids for s in observations if s.ids is not None])
    points = np.concatenate([s.points for s in observations])
    normals = np.concatenate(
        [np.zeros((len(s), 3)) if s.normals is None else s.normals for s in observations]
    )
    at = np.flatnonzero(np.any(normals != 0, axis=1))
    mark_ids, first, number, count = np.unique(
        ids[at], return_index=True, return_inverse=True, return_counts=True
    )
    if (unmatched := mark_ids[count < 2]).size:
        raise InvalidParameter(
            f"mark {unmatched[0]} on a plane must be observed in at least two images with "
            "the same number (ids); got one image"
        )
    first_points, other = at[first][number], at
    distances = np.abs(
        np.sum(normals[first_points] * (points[other] - points[first_points]), axis=1)
    )
    size = 1e-6 * (
        np.linalg.norm(points[other], axis=1) + np.linalg.norm(points[first_points], axis=1)
    )
    if (
        is_inconsistent := (distances > size)
        | (np.abs(np.sum(normals[first_points] * normals[other], axis=1)) < 1 - 1e-9)
    ).any():
        raise InvalidParameter(
            f"mark {ids[at][is_inconsistent][0]} must be on one plane; got two planes"
        )
    axes = np.zeros((len(ids), 3, 2))
    axes[at] = np.linalg.svd(normals[first_points][:, None])[2][:, 1:].transpose(0, 2, 1)
    numbers = np.full(len(ids), -1)
    numbers[at] = number
    return Marks(mark_ids, numbers, axes)


def rms_px(residuals: ArrayLike) -> float:
    """Return ``sqrt(mean |e|^2)`` of residuals (n, 2): per point in two dimensions, as in OpenCV.

    >>> rms_px([[3.0, 4.0], [0.0, 0.0]])  # sqrt((25 + 0) / 2)
    3.5355339059327378
    """
    e = np.asarray(residuals, dtype=float).reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum(e * e, axis=1)))) if len(e) else float("nan")


# -- Corner numbering of mirror-symmetric boards ---------------------------------------------------


def from_the_front(observations: Sequence[Observation]) -> tuple[Observation, ...]:
    """Return boards that equal their mirror image with corners numbered as seen from the front.

    The image of a mirror is reversed, and a detector numbers the corners in image order: the board
    appears as seen from behind. This has no effect on a flat board, but inverts the sign of a
    bulge.
    """
    ends_mm = board_ends(observations)
    return tuple(_reversed_columns(s, ends_mm) if _faces_away(s) else s for s in observations)


def flipped_observations(observation: Observation, ends_mm: float, width: int) -> Observation:
    """Return the observation in the image flipped left to right.

    In a flipped image a detector numbers the columns from the other end.

    Parameters
    ----------
    observation
        Observation with a pose, from which the initial pose of the flipped board follows.
    ends_mm : mm
        Result of :func:`board_ends`.
    width
        Width of the image, px.
    """
    board = _reversed_columns(observation, ends_mm)
    assert board.pose is not None
    across = np.array([-1.0, 1.0, 1.0])
    pose = RigidTransform(
        across[:, None] * board.pose.rotation * [1.0, 1.0, -1.0], across * board.pose.translation_mm
    )
    return replace(board, pixels=board.pixels * across[:2] + [width - 1.0, 0.0], pose=pose)


def board_ends(observations: Sequence[Observation]) -> float:
    """Return the sum of the minimum and maximum X of all boards, mm.

    It equals the sum of the X coordinates of a column and its mirror image.
    """
    x = np.concatenate([np.zeros(0), *(s.points[:, 0] for s in observations if not s.is_surveyed)])
    return float(x.min() + x.max()) if len(x) else 0.0


def _reversed_columns(observation: Observation, ends_mm: float) -> Observation:
    """Return a board at its pose with reversed column numbers, read from the other side."""
    assert observation.pose is not None
    rotation, shift = observation.pose
    points = observation.points * [-1.0, 1.0, 1.0] + [ends_mm, 0.0, 0.0]
    return replace(
        observation,
        points=points,
        pose=RigidTransform(rotation * [-1.0, 1.0, -1.0], shift + rotation[:, 0] * ends_mm),
    )


def _faces_away(observation: Observation) -> bool:
    """Return whether a board's Z axis, which points away from the viewer, points at the camera."""
    if observation.is_surveyed or observation.pose is None:
        return False
    return (
        float(observation.pose.rotation[:, 2] @ observation.pose(observation.points).mean(axis=0))
        < 0
    )


# -- Survey files ----------------------------------------------------------------------------------

PIXEL_COLUMNS = ("u_px", "v_px")
POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")
DIRECTION_COLUMNS = ("x", "y", "z")
ANGLE_COLUMNS = ("azimuth_deg", "elevation_deg")
DEFAULT_IMAGE_NAME = "survey"  # if no column names images


class SurveyData(NamedTuple):
    """Contents of survey files."""

    observations: tuple[Observation, ...]
    """One observation per image."""
    places: dict[str, tuple[str, ...]]
    """File and line of each point, by image."""


class _Row(NamedTuple):
    """Line of a survey file."""

    place: str
    """File and line number."""
    image: str
    pixel: tuple[float, float]
    target: tuple[float, float, float]
    is_distant: bool


@validate_arguments
def read_observations(
    points: Sequence[str | Path] = (), directions: Sequence[str | Path] = ()
) -> SurveyData:
    """Read surveyed points and directions with their pixels from CSV tables with a header line.

    Lines with the same image name, in all files, belong to one camera pose: a camera that did not
    move between images has one name for all of them. All files of an image share one right-handed
    coordinate system with arbitrary origin. The camera pose in it is not required.

    Parameters
    ----------
    points
        CSV files with the columns ``u_px``, ``v_px``, ``x_mm``, ``y_mm``, ``z_mm``, and ``image``
        for several images.
    directions
        CSV files with ``u_px``, ``v_px`` and either ``x``, ``y``, ``z`` of any length, or
        ``azimuth_deg`` (clockwise from above, for example from north) and ``elevation_deg``. X has
        azimuth 0, Y points to its left, and Z up.

    Returns
    -------
    SurveyData
        One observation per image, with the file and line of each point.

    Raises
    ------
    InvalidParameter
        If a column is missing or unknown, or a value is not a number; the message names the line.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/stars.csv", "w") as file:
    ...         _ = file.write("u_px,v_px,azimuth_deg,elevation_deg\\n412.5,88.25,90,0\\n310.0,95.5,120,30\\n")
    ...     observations, places = om.read_observations(directions=[f"{folder}/stars.csv"])
    >>> (observations[0].points.round(3)[0] + 0.0).tolist(), places["survey"]
    ([0.0, -1.0, 0.0], ('stars.csv line 2', 'stars.csv line 3'))
    """
    rows = [row for path in points for row in _rows(Path(path), (POINT_COLUMNS,), is_distant=False)]
    rows += [
        row
        for path in directions
        for row in _rows(Path(path), (DIRECTION_COLUMNS, ANGLE_COLUMNS), is_distant=True)
    ]
    observations, locations = [], {}
    for name in dict.fromkeys(row.image for row in rows):
        image_rows = [row for row in rows if row.image == name]
        pixels, targets = (
            np.array([row.pixel for row in image_rows]),
            np.array([row.target for row in image_rows]),
        )
        distant = np.array([row.is_distant for row in image_rows])
        observations.append(
            Observation(name, pixels, targets, is_distant=distant, is_surveyed=True)
        )
        locations[name] = tuple(row.place for row in image_rows)
    return SurveyData(tuple(observations), locations)


def _rows(path: Path, valid: Sequence[tuple[str, ...]], *, is_distant: bool) -> list[_Row]:
    """Return the lines of a file with pixel columns and one of several sets of target columns."""
    columns, rows = read_point_table(
        path, "points and directions", [(*PIXEL_COLUMNS, *names) for names in valid]
    )
    target = columns[len(PIXEL_COLUMNS) :]
    return [_row(row, target, is_distant) for row in rows]


def _row(row: TableRow, target: tuple[str, ...], is_distant: bool) -> _Row:
    location = row.location
    u, v = map(row.number, PIXEL_COLUMNS)
    numbers = [row.number(name) for name in target]
    if target == ANGLE_COLUMNS:
        azimuth, elevation = np.radians(numbers)
        if abs(elevation) > np.pi / 2:
            raise InvalidParameter(
                f"{location}: elevation_deg must be -90 to 90 deg; got {numbers[1]:g}"
            )
        horizontal = np.cos(elevation)
        numbers = [horizontal * np.cos(azimuth), -horizontal * np.sin(azimuth), np.sin(elevation)]
    if is_distant and not np.linalg.norm(numbers) > 0:
        raise InvalidParameter(f"{location}: the direction must not be zero; got 0, 0, 0")
    x, y, z = numbers
    return _Row(
        location,
        row.cells.get(IMAGE_COLUMN) or DEFAULT_IMAGE_NAME,
        (u, v),
        (float(x), float(y), float(z)),
        is_distant,
    )


# -- Simulated detections --------------------------------------------------------------------------

MAX_IMAGES = 10_000
MAX_TRIES = 200  # attempts per pose before an error is raised
MIN_VISIBLE = 0.8  # minimum fraction of visible corners
MAX_TILT = np.radians(45.0)
BOARD_DISTANCES = (0.9, 2.5)  # multiples of the board's diagonal


@validate_arguments
def simulate_detections(
    camera: Camera,
    board: Board,
    count: int = 12,
    *,
    noise_px: float = 0.1,
    seed: int = 0,
    points_mm: Array | None = None,
) -> list[Detection]:
    """Simulate corners of a board at random poses around a camera, with normal noise.

    Parameters
    ----------
    camera
        Camera of any type.
    board
        Target, placed 0.9 to 2.5 times its diagonal from the camera and tilted by up to 45 deg.
    count
        Number of images.
    noise_px
        Standard deviation of each coordinate.
    seed
        Random seed of poses and noise.
    points_mm : (n, 3), optional
        True positions of the board's corners, for a board that is not flat.

    Returns
    -------
    list of Detection
        Simulated detections.

    Raises
    ------
    InvalidParameter
        If the board is outside the field of the camera at all poses.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> [len(d.ids) > 50 for d in om.simulate_detections(camera, om.Board("chessboard", 11, 7, 30.0), 3)]
    [True, True, True]
    """
    integer("count", count, 1, MAX_IMAGES)
    number("noise_px", noise_px, low=0.0, unit="px")
    random = np.random.default_rng(integer("seed", seed))
    points = board.points_mm if points_mm is None else finite("points_mm", points_mm, last=3)
    detections = []
    for i in range(count):
        for _ in range(MAX_TRIES):
            projection = camera.project(_random_board(camera, points, random))
            if projection.valid.mean() >= MIN_VISIBLE:
                break
        else:
            raise InvalidParameter(
                f"camera must observe a board of {board} with squares of "
                f"{board.square_mm:g} mm; got no visible pose in {MAX_TRIES} attempts"
            )
        ids = np.flatnonzero(projection.valid)
        corners = projection.pixels[ids] + random.normal(0.0, noise_px, (len(ids), 2))
        detections.append(Detection(f"image {i + 1}", camera.image_size, ids, corners))
    return detections


def _random_board(camera: Camera, points: Array, random: np.random.Generator) -> Array:
    """Return the corners (n, 3) of a board at a random pose in the world frame."""
    size = np.array(camera.image_size)
    while True:
        rays = camera.backproject(random.uniform(0, 1, (1, 2)) * size - 0.5)
        if rays.valid[0]:
            break
    direction = rays.directions[0]
    centroid = points.mean(axis=0)
    diagonal = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    across = np.cross(direction, random.normal(size=3))
    x = across / np.linalg.norm(across)
    facing = np.stack(
        [x, np.cross(direction, x), direction], axis=1
    )  # Z points away from the viewer
    tilt = random.normal(size=3)
    rotation = rotation_of(random.uniform(0, MAX_TILT) * tilt / np.linalg.norm(tilt)) @ facing
    position = rays.origins[0] + random.uniform(*BOARD_DISTANCES) * diagonal * direction
    return np.asarray((points - centroid) @ rotation.T + position)


# -- Board shape -----------------------------------------------------------------------------------
#
# A printed board is stretched slightly and bends and twists by 1 to 2 mm. With corners accurate to
# 0.1 px, this limits the calibration rather than the camera. Five parameters describe the shape.
# All are even under rotation by 180 deg, and therefore independent of the end at which a detector
# starts numbering. They are regularised: without evidence in the images, the board is flat.

STRETCH_SIGMA = 0.003  # typical relative stretch and shear of a print
BEND_SIGMA = 0.01  # typical deviation of corners from the plane, relative to 0.5 times the diagonal
SHAPE_NAMES = ("board_aspect", "board_shear", "board_bend_xx", "board_twist_xy", "board_bend_yy")
SHAPE_UNITS = ("1", "1", "mm", "mm", "mm")


@dataclass(frozen=True)
class BoardShape:
    """Deviation of a board from a flat one with square fields.

    Parameters
    ----------
    centre_mm : (2,)
        Centre of its corners.
    half_diagonal_mm
        Distance from the centre to the farthest corner.
    values : (5,)
        Aspect (relative excess of width over height), shear (radians), and deviations from the
        plane in mm at a distance of 0.5 times the diagonal from the centre: terms in x^2, x y
        (twist) and y^2.

    Examples
    --------
    >>> corners = np.array([[x, y, 0.0] for x in (-40.0, 40.0) for y in (-30.0, 30.0)])
    >>> shape = BoardShape.flat(corners).with_values([0.0, 0.0, 0.0, 2.0, 0.0])
    >>> shape.deformed(corners)[:, 2].round(2)  # twisted: two corners before the plane, two behind it
    array([ 1.92, -1.92, -1.92,  1.92])
    """

    centre_mm: tuple[float, float]
    half_diagonal_mm: float
    values: tuple[float, ...] = (0.0,) * 5

    @classmethod
    def flat(cls, points_mm: ArrayLike) -> BoardShape:
        """Return the nominal shape of a board with corners (n, 3)."""
        points = np.asarray(points_mm, dtype=float)[:, :2]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (low + high) / 2
        return cls((float(x), float(y)), float(np.hypot(*(high - low)) / 2))

    def with_values(self, values: ArrayLike) -> BoardShape:
        """Return the same board with other shape values (5,)."""
        return BoardShape(
            self.centre_mm, self.half_diagonal_mm, tuple(float(v) for v in np.asarray(values))
        )

    def is_flat_within(self, sigmas: Array) -> bool:
        """Return whether all values are zero within three standard deviations (5,)."""
        return bool(np.all(np.abs(self.values) <= 3 * sigmas))

    @property
    def sigmas(self) -> Array:
        """Typical sizes of the values (5,): standard deviations of their prior."""
        bend = BEND_SIGMA * self.half_diagonal_mm
        return np.array([STRETCH_SIGMA, STRETCH_SIGMA, bend, bend, bend])

    def derivatives(self, points_mm: Array) -> Array:
        """Return derivatives (n, 3, 5) of board points (n, 3) with respect to the values."""
        x, y = (points_mm[:, :2] - self.centre_mm).T
        u, v = x / self.half_diagonal_mm, y / self.half_diagonal_mm
        change = np.zeros((len(points_mm), 3, 5))
        change[:, 0, 0], change[:, 1, 0] = x / 2, -y / 2
        change[:, 0, 1], change[:, 1, 1] = y / 2, x / 2
        change[:, 2, 2], change[:, 2, 3], change[:, 2, 4] = u * u, 2 * u * v, v * v
        return change

    def deformed(self, points_mm: Array) -> Array:
        """Return the deformed positions of points (n, 3) of the flat board."""
        points: Array = points_mm + self.derivatives(points_mm) @ np.array(self.values)
        return points


# -- Residuals and derivatives ---------------------------------------------------------------------

UNSEEN_PX = 1e3
"""Residual of a point outside the model's field."""


@dataclass(frozen=True)
class Loss:
    """Loss function: squares, or a robust loss that downweights residuals far above the noise.

    Parameters
    ----------
    kind
        ``"squares"``, ``"huber"`` or ``"cauchy"``.
    scale_px
        Residual above which the weight decreases.
    """

    kind: str = "squares"
    scale_px: float = 1.0

    def weights(self, residuals: Array) -> Array:
        """Return the weights (n,) of squared residuals (n, 2) in reweighted least squares."""
        r = np.hypot(*residuals.T) / self.scale_px
        if self.kind == "cauchy":
            return np.asarray(1 / (1 + r * r))
        if self.kind == "huber":
            return np.asarray(1 / np.maximum(1.0, r))
        return np.ones(len(residuals))

    def sum(self, residuals: Array) -> float:
        """Return the loss that an adjustment minimises; for squares, the sum in px^2."""
        s = self.scale_px**2
        q = np.sum(residuals * residuals, axis=1) / s
        if self.kind == "cauchy":
            q = np.log1p(q)
        elif self.kind == "huber":
            q = np.where(q > 1, 2 * np.sqrt(q) - 1, q)
        return float(s * q.sum())


class Estimate(NamedTuple):
    """Estimated quantities."""

    model: CameraModel
    poses: tuple[RigidTransform, ...]
    shape: BoardShape | None
    line_positions_mm: Array
    """Positions (n,) of points along their lines, mm."""
    marks: Array
    """Offsets (2k,) of marks from the points of their planes along two axes, mm."""


class Linearised(NamedTuple):
    """Residuals of an estimate and their derivatives."""

    residuals: Array
    """Residuals (n, 2) px, image minus pixel; 0 for invisible points."""
    visible: Mask
    """Visibility (n,)."""
    d_shared: Array
    """Derivatives (n, 2, g) with respect to the parameters of model, board and marks, in order."""
    d_pose: Array
    """Derivatives (n, 2, 6) with respect to a rotation in radians and a translation in mm."""
    d_line_position: Array | None
    """Derivatives (n, 2) with respect to positions along lines."""


def linearise(estimate: Estimate, stack: Stack) -> Linearised:
    """Compute residuals and derivatives of an estimate."""
    rotations = np.array([m.rotation for m in estimate.poses])[stack.owner]
    shifts = np.array([m.translation_mm for m in estimate.poses])[stack.owner]
    rotated = np.einsum("nij,nj->ni", rotations, targets(estimate, stack))
    points = rotated + np.where(stack.distant[:, None], 0.0, shifts)
    pixels, visible, d_points, d_parameters = _images(estimate.model, points, stack.distant)
    residuals = pixels - stack.pixels
    d_shared = d_parameters
    if estimate.shape is not None:
        changes = estimate.shape.derivatives(stack.points)
        changes[~stack.shaped] = 0.0
        d_shared = np.concatenate([d_shared, (d_points @ rotations) @ changes], axis=2)
    if stack.marks is not None:
        d_shared = np.concatenate(
            [d_shared, (d_points @ rotations) @ stack.marks.derivatives()], axis=2
        )
    d_pose = np.empty((len(points), 2, 6))
    # d(turn x X) = -[X]x turn: a row g of d_points becomes X x g
    (x, y, z), (gx, gy, gz) = rotated.T[..., None], np.moveaxis(d_points, 2, 0)
    d_pose[..., 0], d_pose[..., 1], d_pose[..., 2] = (
        y * gz - z * gy,
        z * gx - x * gz,
        x * gy - y * gx,
    )
    d_pose[..., 3:] = np.where(stack.distant[:, None, None], 0.0, d_points)
    d_line_position = None
    if stack.along is not None:
        d_line_position = np.einsum("nki,nij,nj->nk", d_points, rotations, stack.along)
    residuals[~visible] = 0.0
    return Linearised(residuals, visible, d_shared, d_pose, d_line_position)


def residuals_at_poses(model: CameraModel, observations: Sequence[Observation]) -> Linearised:
    """Compute residuals of points and directions at their current poses, without a board shape."""
    stack = stacked(observations)
    poses = tuple(s.pose or RigidTransform.identity() for s in observations)
    return linearise(Estimate(model, poses, None, np.zeros(len(stack.pixels)), np.zeros(0)), stack)


def targets(estimate: Estimate, stack: Stack) -> Array:
    """Return points (n, 3) in target frames, with board shape, lines and planes applied."""
    points = stack.points
    if estimate.shape is not None:
        points = np.where(stack.shaped[:, None], estimate.shape.deformed(points), points)
    if stack.along is not None:
        points = points + estimate.line_positions_mm[:, None] * stack.along
    if stack.marks is not None:
        points = points + stack.marks.derivatives() @ estimate.marks
    return points


def eliminate_line_positions(linearised: Linearised) -> Linearised:
    """Project out positions along lines: residuals remain perpendicular to the image of the line."""
    if linearised.d_line_position is None:
        return linearised
    length = np.sum(linearised.d_line_position**2, axis=1)
    along = linearised.d_line_position / np.sqrt(np.where(length > 0, length, 1.0))[:, None]
    across = np.eye(2) - along[:, :, None] * along[:, None, :]
    return linearised._replace(
        residuals=np.einsum("nij,nj->ni", across, linearised.residuals),
        d_shared=across @ linearised.d_shared,
        d_pose=across @ linearised.d_pose,
    )


def slide_steps(linearised: Linearised, stack: Stack, shared: Array, poses: Array) -> Array:
    """Return steps (n,) along lines for steps of the shared parameters (g,) and poses (m, 6)."""
    assert linearised.d_line_position is not None
    e = (
        linearised.residuals
        + linearised.d_shared @ shared
        + np.einsum("nki,ni->nk", linearised.d_pose, poses[stack.owner])
    )
    length = np.sum(linearised.d_line_position**2, axis=1)
    return np.asarray(
        -np.sum(linearised.d_line_position * e, axis=1) / np.where(length > 0, length, np.inf)
    )


def _images(model: CameraModel, points: Array, distant: Mask) -> tuple[Array, Mask, Array, Array]:
    """Return pixels, validity and derivatives of near and distant points; 0 where invalid."""
    if distant.all() or not distant.any():
        image = model.image_clamped(points, distant=bool(distant.any()))
        visible = image.valid
        if visible.all():
            return image.pixels, visible, image.d_points, image.d_parameters
        d_points, d_parameters = (
            np.where(visible[:, None, None], part, 0.0)
            for part in (image.d_points, image.d_parameters)
        )
        return np.where(visible[:, None], image.pixels, 0.0), visible, d_points, d_parameters
    masks: Sequence[Mask] = (~distant, distant)
    near, far = (_images(model, points[part], distant[part]) for part in masks)
    joined = []
    for a, b in zip(near, far, strict=True):
        combined = np.empty((len(points), *a.shape[1:]), dtype=a.dtype)
        combined[masks[0]], combined[masks[1]] = a, b
        joined.append(combined)
    return joined[0], joined[1], joined[2], joined[3]
