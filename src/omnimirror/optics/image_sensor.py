"""Image sensor: pixel count, pixel pitch, principal point and pose."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from ..base.arguments import numbers
from ..base.errors import InvalidParameter
from ..base.parameters import Parameter
from ..base.typing import Array


@dataclass(frozen=True)
class Imager:
    """Rectangular array of square pixels.

    Parameters
    ----------
    width_px, height_px
    pixel_pitch_um : micrometres
    centre_px : (u, v), optional
        Intersection of the optical axis with the array; integers are pixel centres. The centre of
        the array by default. It refers to the image before a flip: with ``image_flipped`` the axis
        is at ``width_px - 1 - u`` in the delivered image.

    Raises
    ------
    InvalidParameter
        If a size or pitch is outside its range.

    Examples
    --------
    >>> Imager(1024, 1024, 5.2).centre
    (511.5, 511.5)
    """

    width_px: int
    height_px: int
    pixel_pitch_um: float
    centre_px: tuple[float, float] | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "width_px": Parameter("px", 1, 100_000, "number of columns"),
        "height_px": Parameter("px", 1, 100_000, "number of rows"),
        "pixel_pitch_um": Parameter("um", 0.01, 1e4, "pixel pitch"),
        "centre_px": Parameter(
            "px", -1e6, 1e6, "principal point (u, v) on the array, before a flip"
        ),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None or f.name != "centre_px":
                self.PARAMETERS[f.name].check(f.name, value)
        for name in ("width_px", "height_px"):
            value = numbers(name, getattr(self, name), "a number")
            if value.ndim or int(value) != value:
                raise InvalidParameter(
                    f"{name} must be an integer number of pixels; got {getattr(self, name)}"
                )
        if self.centre_px is not None:
            if len(self.centre_px) != 2:
                raise InvalidParameter(
                    f"centre_px must be a pair (u, v); got {len(self.centre_px)} numbers"
                )
            object.__setattr__(
                self, "centre_px", (float(self.centre_px[0]), float(self.centre_px[1]))
            )

    @property
    def pitch_mm(self) -> float:
        return self.pixel_pitch_um * 1e-3

    @property
    def size(self) -> tuple[int, int]:
        """Array size (width, height), px."""
        return self.width_px, self.height_px

    @property
    def centre(self) -> tuple[float, float]:
        """Intersection of the optical axis with the array, (u, v), px."""
        return self.centre_px or ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

    @property
    def inscribed_radius_px(self) -> float:
        """Radius of the largest circle about the optical axis within the array, px.

        >>> Imager(1280, 1024, 4.8).inscribed_radius_px
        512.0
        """
        u, v = self.centre
        return min(u, v, self.width_px - 1 - u, self.height_px - 1 - v) + 0.5

    @property
    def long_radius_px(self) -> float:
        """Radius of the largest circle about the optical axis within the array's long side, px.

        >>> Imager(1920, 1080, 3.0).long_radius_px
        960.0
        """
        u, v = self.centre
        return max(min(u, self.width_px - 1 - u), min(v, self.height_px - 1 - v)) + 0.5


@dataclass(frozen=True)
class ImagerPose:
    """Tilt and rotation of an imager against the lens; perpendicular to the axis by default.

    The imager is rotated by ``rotation_deg`` in its plane, then tilted about the image X and then
    the image Y axis, by the right-hand rule, all about its intersection with the optical axis.

    Parameters
    ----------
    tilt_x_deg, tilt_y_deg
        Rotation about the image X axis, then about its Y axis.
    rotation_deg
        Rotation in its plane, from image right towards image bottom.

    Raises
    ------
    InvalidParameter
        If a number is outside its range.

    Examples
    --------
    >>> pose = ImagerPose(tilt_y_deg=1.0)
    >>> flat, depth = pose.flat(np.array([[3.0, 0.0]]), 12.0)  # mm, of a lens whose principal distance is 12 mm
    >>> flat.round(4), depth.round(4), pose.tilted(flat, 12.0).round(9)
    (array([[3.0127, 0.    ]]), array([-0.0524]), array([[3., 0.]]))
    """

    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    rotation_deg: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "tilt_x_deg": Parameter(
            "deg", -20.0, 20.0, "tilt of the imager about the X axis of the image"
        ),
        "tilt_y_deg": Parameter(
            "deg", -20.0, 20.0, "tilt of the imager about the Y axis of the image"
        ),
        "rotation_deg": Parameter(
            "deg", -360.0, 360.0, "rotation of the imager in its plane; applied first"
        ),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))

    @property
    def is_perpendicular(self) -> bool:
        """True if the imager is perpendicular to the optical axis."""
        return not (self.tilt_x_deg or self.tilt_y_deg)

    def _plane(self) -> Array:
        """Return the directions (3, 2) of the imager's right and down axes."""
        x, y, turn = np.radians([self.tilt_x_deg, self.tilt_y_deg, self.rotation_deg])
        about_x = np.array(
            [[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]]
        )
        about_y = np.array(
            [[np.cos(y), 0.0, np.sin(y)], [0.0, 1.0, 0.0], [-np.sin(y), 0.0, np.cos(y)]]
        )
        within = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)], [0.0, 0.0]])
        plane: Array = about_y @ about_x @ within
        return plane

    def flat(self, offsets: Array, principal_distance: float) -> tuple[Array, Array]:
        """Return points (n, 2) on an untilted imager, and pixel depths (n,) behind it.

        Arguments share one unit. An untilted imager does not depend on the principal distance.
        """
        moved = offsets @ self._plane().T
        if self.is_perpendicular:
            return moved[..., :2], np.zeros(moved.shape[:-1])
        # central projection from the exit pupil, at the principal distance, to the untilted plane
        depth = 1 + moved[..., 2] / principal_distance
        return moved[..., :2] / depth[..., None], moved[..., 2]

    def tilted(self, flat: Array, principal_distance: float) -> Array:
        """Return offsets (n, 2) on the tilted imager for points (n, 2) of an untilted one."""
        plane = self._plane()
        if self.is_perpendicular:
            rotated: Array = flat @ plane[:2]
            return rotated
        # inverse: (flat, c) is proportional to plane @ offsets + (0, 0, c), a linear system
        basis = np.concatenate([plane, [[0.0], [0.0], [principal_distance]]], axis=1)
        ahead = np.concatenate([flat, np.full((*flat.shape[:-1], 1), principal_distance)], axis=-1)
        points = ahead @ np.linalg.inv(basis).T
        offsets: Array = points[..., :2] / points[..., 2:]
        return offsets


@dataclass(frozen=True)
class ImagePlane:
    """Imager behind a lens: conversion between pixels and points of an untilted image plane.

    Points are in mm right of and below the optical axis, in the image before a flip (``flipped``).
    The ``principal_distance`` (mm) of the lens is used only for tilted imagers.

    >>> plane = ImagePlane(Imager(1024, 1024, 5.2), ImagerPose(), flipped=True, principal_distance=np.inf)
    >>> plane.flat_mm(np.array([[411.5, 511.5]]))[0].round(3)
    array([[0.52, 0.  ]])
    >>> plane.pixels(np.array([[0.52, 0.0]])).round(9)
    array([[411.5, 511.5]])
    """

    imager: Imager
    pose: ImagerPose
    flipped: bool
    principal_distance: float

    def flat_mm(self, pixels: Array) -> tuple[Array, Array]:
        """Return image points (n, 2) of pixels (n, 2), and pixel depths (n,), mm."""
        points = (self._unflipped(pixels) - self.imager.centre) * self.imager.pitch_mm
        if self.pose == ImagerPose():
            return points, np.zeros(points.shape[:-1])
        return self.pose.flat(points, self.principal_distance)

    def pixels(self, flat_mm: Array) -> Array:
        """Return pixels (n, 2) of image points (n, 2), also outside the array."""
        if self.pose != ImagerPose():
            flat_mm = self.pose.tilted(flat_mm, self.principal_distance)
        return self._unflipped(flat_mm / self.imager.pitch_mm + self.imager.centre)

    def _unflipped(self, pixels: Array) -> Array:
        """Convert pixels (n, 2) between the image before and after a flip, if flipped."""
        if not self.flipped:
            return pixels
        return np.stack([self.imager.width_px - 1 - pixels[..., 0], pixels[..., 1]], axis=-1)
