"""Camera interface and coordinate frames.

:class:`Camera` converts between pixels and rays in the world. The mirror sensor implements it
(:class:`omnimirror.optics.sensor.Sensor`), as do the models read from files of other programs
(:mod:`omnimirror.cameras.models`). Screens, samplers and viewers depend only on this interface.

Camera frame (OpenCV): X right and Y down in the image, Z the optical axis. For a mirror sensor, a
pixel at azimuth ``phi`` (from image right towards image bottom) has the object azimuth ``phi`` and
the direction ``(sin Omega cos phi, sin Omega sin phi, -cos Omega)``.

World frame (ROS REP-103): x forward, y left, z vertically upwards, origin at the mirror vertex. No
axis is negated "because of the mirror": the raw image is mirrored, and :meth:`Mount.rotation`
corrects this, as well as pitch and roll of the sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import check_fields, number, validate_arguments
from ..base.errors import InvalidParameter
from ..base.numerics import matrix_product
from ..base.typing import Array, Mask


class Rays(NamedTuple):
    """Rays in the world frame, one per pixel."""

    origins: Array
    """(n, 3), mm; NaN if invalid."""
    directions: Array
    """(n, 3) unit vectors from the sensor to the object; NaN if invalid."""
    valid: Mask
    """(n,) False if the pixel is outside the image or the field of view."""


class Projection(NamedTuple):
    """Pixels, one per point or direction."""

    pixels: Array
    """(n, 2), px, (u, v) with integers at pixel centres; NaN if invalid."""
    valid: Mask
    """(n,) False if the point is outside the field of view or the image."""


EDGE_SLACK = 1e-9  # px; tolerance of pixels on the image edge after a round trip


@dataclass(frozen=True)
class AxialSymmetry:
    """Properties of a camera with axial symmetry, for separable panoramas."""

    centre_px: tuple[float, float]
    """Image of the axis, (u, v)."""
    axis: Array
    """(3,) world direction of field angle 0."""
    right: Array
    """(3,) world direction perpendicular to the axis, right of the centre in the delivered
    image.
    """
    down: Array
    """(3,) world direction perpendicular to the axis, below the centre."""
    omega_min: float
    """Smallest field angle, radians from ``axis``."""
    omega_max: float
    """Largest field angle, radians from ``axis``."""
    radius_px: Callable[[Array], Array]
    """Image radius (px) as a function of field angles (radians)."""
    origin_mm: Callable[[Array], tuple[Array, Array]] | None = None
    """Ray origins as a function of field angles (radians); None for rays through the world origin.

    The values are the distance from the axis, towards the object, and the position along ``axis``.
    """


@runtime_checkable
class Camera(Protocol):
    """Conversion between pixels and rays in the world frame."""

    @property
    def image_size(self) -> tuple[int, int]:
        """Image size (width, height), px."""
        ...

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry; None for a camera without one."""
        ...

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (n, 2)."""
        ...

    def project(self, points_mm: ArrayLike) -> Projection:
        """Return the pixels of points (n, 3), mm."""
        ...

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Return the pixels of infinitely distant points in directions (n, 3), of any length."""
        ...


def inside_image(pixels: Array, size: tuple[int, int]) -> Mask:
    """Return which pixels (n, 2) are in the image, including the outer half of the edge pixels."""
    u, v = pixels[..., 0], pixels[..., 1]
    edge = 0.5 + EDGE_SLACK
    with np.errstate(invalid="ignore"):
        return (u >= -edge) & (u <= size[0] - 1 + edge) & (v >= -edge) & (v <= size[1] - 1 + edge)


CameraLooks = Literal["up", "down", "forward"]
FULL_TURN_DEG, MAX_PITCH_DEG, MAX_ROLL_DEG = 360, 90, 180  # magnitudes in files


@dataclass(frozen=True)
class Mount:
    """Orientation of a camera in the world.

    Parameters
    ----------
    camera_looks
        Direction of the optical axis: ``"up"`` (mirror above the camera), ``"down"``, or
        ``"forward"`` (horizontal, for example a mirror ball photographed from a tripod).
    forward_azimuth_deg : deg
        Image azimuth, from image right towards image bottom, of the world's forward direction (for
        ``"forward"``: of its upward direction). The default -90 is the top of the image.
    image_flipped
        True if the delivered image is flipped left to right. The ``centre_px`` of a sensor's imager
        refers to the image before the flip; the centre of a calibrated camera model to the
        delivered image.
    pitch_deg, roll_deg : deg
        Tilt of the sensor about the mirror vertex: pitch is the elevation of its forward direction,
        -90 to 90; roll is the clockwise rotation about it, as seen from behind, -180 to 180.

    Raises
    ------
    InvalidParameter
        If ``camera_looks`` is unknown, the azimuth is not finite, or pitch or roll is outside its
        range.

    Examples
    --------
    The point at the top of the image is forward for each orientation of the axis:

    >>> Mount("up").rotation() @ [0, -1, 0]
    array([1., 0., 0.])
    >>> Mount("down").rotation() @ [0, -1, 0]
    array([1., 0., 0.])

    With a pitch of 30 deg, it is 30 deg above the horizon:

    >>> (Mount("down", pitch_deg=30.0).rotation() @ [0, -1, 0]).round(3) + 0.0
    array([0.866, 0.   , 0.5  ])
    """

    camera_looks: CameraLooks = "up"
    forward_azimuth_deg: float = -90.0
    image_flipped: bool = False
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        number("forward_azimuth_deg", self.forward_azimuth_deg)
        for name, value, limit in (
            ("pitch_deg", self.pitch_deg, 90),
            ("roll_deg", self.roll_deg, 180),
        ):
            if not abs(value) <= limit:
                raise InvalidParameter(
                    f"{name} must be between -{limit} and {limit} deg; got {value:g}"
                )

    @validate_arguments
    def field_angles_deg(self, elevation_deg: tuple[float, float]) -> tuple[float, float]:
        """Convert an elevation range (low, high), deg above the horizon, to field angles (deg).

        Raises
        ------
        InvalidParameter
            If an elevation does not correspond to one field angle under this mount.

        Examples
        --------
        >>> Mount("up").field_angles_deg((-60.0, 20.0)), Mount("down").field_angles_deg((-60.0, 20.0))
        ((30.0, 110.0), (70.0, 150.0))
        """
        if self.camera_looks == "forward" or self.is_tilted:
            raise InvalidParameter(
                'camera_looks must be "up" or "down", and pitch_deg and roll_deg must be 0 for elevations; got '
                f'"{self.camera_looks}", {self.pitch_deg:g} and {self.roll_deg:g} deg; specify field angles instead'
            )
        low, high = elevation_deg
        return (90.0 + low, 90.0 + high) if self.camera_looks == "up" else (90.0 - high, 90.0 - low)

    @validate_arguments
    def elevations_deg(self, omega_deg: tuple[float, float]) -> tuple[float, float]:
        """Convert a range of field angles to elevations, deg.

        >>> Mount("down").elevations_deg((70.0, 150.0))
        (-60.0, 20.0)
        """
        low, high = self.field_angles_deg((0.0, 0.0))
        if self.camera_looks == "up":
            return omega_deg[0] - low, omega_deg[1] - high
        return low - omega_deg[1], high - omega_deg[0]

    @property
    def levelled(self) -> Mount:
        """Mount without pitch and roll."""
        return replace(self, pitch_deg=0.0, roll_deg=0.0)

    @property
    def is_tilted(self) -> bool:
        """True if pitch or roll is not 0."""
        return bool(self.pitch_deg or self.roll_deg)

    @validate_arguments
    def view_tilt_deg(self, pan_deg: float) -> tuple[float, float]:
        """Return pitch and roll (deg) of a view panned in the sensor's frame without levelling.

        >>> [round(angle) + 0 for angle in Mount(pitch_deg=20.0).view_tilt_deg(90.0)]
        [0, 20]
        """
        number("pan_deg", pan_deg)
        forward, left, up = (
            pan_tilt_rotation(0.0, self.pitch_deg, self.roll_deg)
            @ pan_tilt_rotation(pan_deg, 0.0, 0.0)
        ).T
        pitch, roll = np.arcsin(np.clip(forward[2], -1, 1)), np.arctan2(left[2], up[2])
        return float(np.degrees(pitch)), float(np.degrees(roll))

    def rotation(self) -> Array:
        """Return the rotation (3, 3) from camera to world frame, with determinant +1."""
        levelled = self._levelled_rotation()
        if not self.is_tilted:
            return levelled
        return pan_tilt_rotation(0.0, self.pitch_deg, self.roll_deg) @ levelled

    def _levelled_rotation(self) -> Array:
        c, s = _cos_sin_deg(self.forward_azimuth_deg)
        if self.camera_looks == "up":
            return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        if self.camera_looks == "down":
            return np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        return np.array([[0.0, 0.0, 1.0], [s, -c, 0.0], [c, s, 0.0]])


def _cos_sin_deg(angle_deg: float) -> tuple[float, float]:
    """Return cosine and sine, exact at multiples of 90 deg to avoid residuals of 6e-17."""
    quarter, rest = divmod(angle_deg, 90.0)
    c, s = float(np.cos(np.radians(rest))), float(np.sin(np.radians(rest)))
    return [(c, s), (-s, c), (-c, -s), (s, -c)][int(quarter) % 4]


def camera_direction(omega: Array, phi: Array) -> Array:
    """Return unit vectors (..., 3) in the camera frame for field angle and azimuth, in radians."""
    s = np.sin(omega)
    return np.stack([s * np.cos(phi), s * np.sin(phi), -np.cos(omega)], axis=-1)


def rotate_vectors(vectors: ArrayLike, matrix: NDArray[np.floating]) -> Array:
    """Compute ``vectors @ matrix`` for vectors (..., d) and a small matrix (d, k).

    >>> rotate_vectors([[1.0, 2.0], [3.0, 4.0]], np.array([[0.0, 1.0], [-1.0, 0.0]]))
    array([[-2.,  1.],
           [-4.,  3.]])
    """
    vectors = np.asarray(vectors, dtype=float)
    return matrix_product(vectors.reshape(-1, vectors.shape[-1]), matrix).reshape(
        *vectors.shape[:-1], matrix.shape[1]
    )


def perpendicular_axes(directions: Array) -> Array:
    """Return two orthogonal unit vectors (n, 3, 2) perpendicular to unit vectors (n, 3).

    >>> perpendicular_axes(np.array([[1.0, 0.0, 0.0]]))[0].T + 0.0
    array([[ 0., -1.,  0.],
           [ 0.,  0., -1.]])
    """
    # any axis not nearly parallel to the direction
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=2)


def pan_tilt_direction(pan: ArrayLike, tilt: ArrayLike) -> Array:
    """Return the world direction (..., 3) of pan (right) and tilt (up), radians.

    >>> pan_tilt_direction(np.radians(90), 0.0).round(12) + 0.0
    array([ 0., -1.,  0.])
    """
    pan, tilt = np.asarray(pan, float), np.asarray(tilt, float)
    c, direction = np.cos(tilt), np.empty((*np.broadcast_shapes(pan.shape, tilt.shape), 3))
    direction[..., 0] = c * np.cos(pan)
    direction[..., 1] = -c * np.sin(pan)
    direction[..., 2] = np.sin(tilt)
    return direction


def view_axes(pan_deg: float, tilt_deg: float, roll_deg: float = 0.0) -> tuple[Array, Array, Array]:
    """Return world axes (3,) forward, right and down of a panned view.

    >>> forward, right, down = view_axes(0.0, 0.0)
    >>> right + 0.0, down + 0.0
    (array([ 0., -1.,  0.]), array([ 0.,  0., -1.]))
    """
    (ca, sa), (ct, st), (cr, sr) = (_cos_sin_deg(d) for d in (pan_deg, tilt_deg, roll_deg))
    forward = np.array([ct * ca, -ct * sa, st])
    right = np.array([-sa, -ca, 0.0])
    down = np.array([st * ca, -st * sa, -ct])  # forward x right
    return forward, cr * right + sr * down, -sr * right + cr * down


def pan_tilt_rotation(pan_deg: float, tilt_deg: float, roll_deg: float) -> Array:
    """Return the rotation (3, 3) of pan, tilt and roll for axes forward, left, up.

    In ROS angles, with opposite signs about left and up: yaw -pan, pitch -tilt and roll.

    >>> pan_tilt_rotation(0.0, 90.0, 0.0)[:, 0]  # the forward axis points up
    array([0., 0., 1.])
    """
    forward, right, down = view_axes(pan_deg, tilt_deg, roll_deg)
    return np.stack([forward, -right, -down], axis=-1) + 0.0
