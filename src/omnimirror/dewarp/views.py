"""Sensible screens for a camera: they cover what it sees, at the resolution that its picture has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cameras import AxialSymmetry, Camera
from ..errors import OutsideField
from .screens import Cylinder, Dome, Plane, Pole

Array = NDArray[np.float64]
PartialSize = tuple[int | None, int | None]

SAMPLES = 20_000  # directions all over the sphere, and pixels all over the picture
EDGE_SAMPLES = 1440  # points along the rim and along each side of the picture
PERSPECTIVE_SIZE = (1280, 720)
UNKNOWN_SIZE: PartialSize = (None, None)


@dataclass(frozen=True)
class Field:
    """What a camera sees, as far as views need to know."""

    tilt_min_deg: float
    """Lowest elevation seen."""
    tilt_max_deg: float
    """Highest elevation seen."""
    pixels_per_degree: float
    """Square root of the mean number of source pixels per square degree seen."""


def field_of(camera: Camera) -> Field:
    """The camera's elevations and mean resolution.

    Elevations are exact for a camera that is symmetric about a vertical axis and reaches its full field
    inside the picture; otherwise they come from the pixels along the rim, along the edge of the
    picture and all over it, and are good to about the distance of these.

    Raises
    ------
    OutsideField
        If no pixel sees anything.

    Examples
    --------
    The paper's mean resolution, .0448 square degrees per pixel, for a rim at 500 px:

    >>> import omnimirror as om
    >>> field = field_of(om.load_sensor("paper-spherical"))
    >>> round(field.tilt_min_deg, 2), round(field.tilt_max_deg, 2), round(field.pixels_per_degree, 1)
    (-90.0, 45.0, 4.7)
    """
    pixels = _pixels_all_over(camera.image_size)
    rays = camera.backproject(pixels)
    if not rays.valid.any():
        raise OutsideField("no pixel of the camera's picture sees anything of the scene")
    low, high = _tilts_seen(camera, rays.directions[rays.valid])
    sphere = _directions_all_over()
    width, height = camera.image_size
    pixels_seen = rays.valid.mean() * width * height
    square_degrees = max(camera.project_directions(sphere).valid.mean(), 1 / SAMPLES) * 4 * np.pi * np.degrees(1) ** 2
    return Field(low, high, float(np.sqrt(pixels_seen / square_degrees)))


def panorama(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    pan_deg: float = 0.0,
    span_deg: float = 360.0,
    elevation_deg: tuple[float, float] | None = None,
) -> Cylinder:
    """A panorama that covers the camera's elevations, or those given, at its mean resolution.

    >>> import omnimirror as om
    >>> panorama(om.load_sensor("paper-spherical")).size  # .21 deg per pixel
    (1706, 640)
    """
    seen = field_of(camera)
    low, high = elevation_deg or (seen.tilt_min_deg, seen.tilt_max_deg)
    natural = span_deg * seen.pixels_per_degree, (high - low) * seen.pixels_per_degree
    return Cylinder(_completed(size, natural), low, high, pan_deg, span_deg)


def perspective(
    size: PartialSize = UNKNOWN_SIZE,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    roll_deg: float = 0.0,
    hfov_deg: float = 90.0,
) -> Plane:
    """A perspective view, 1280 x 720 unless said otherwise."""
    return Plane(_completed(size, PERSPECTIVE_SIZE), pan_deg, tilt_deg, roll_deg, hfov_deg)


def dome(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    pan_deg: float = 0.0,
    omega_deg: tuple[float, float] | None = None,
) -> Dome:
    """A dome about the pole nearer to the centre of the camera's field, reaching to the end of it."""
    seen = field_of(camera)
    pole = pole_of(camera)
    end = 90 - seen.tilt_min_deg if pole == "zenith" else 90 + seen.tilt_max_deg
    first, last = omega_deg or (0.0, end)
    diameter = 2 * last * seen.pixels_per_degree
    return Dome(_completed(size, (diameter, diameter)), last, pole, pan_deg, first)


def pole_of(camera: Camera) -> Pole:
    """The pole that the camera's axis of symmetry, or else the mean of its directions, is nearer to."""
    if camera.symmetry is not None:
        up = camera.symmetry.axis[2]
    else:
        up = np.nanmean(camera.backproject(_pixels_all_over(camera.image_size)).directions[:, 2])
    return "zenith" if up > 1e-9 else "nadir"


def is_vertical(symmetry: AxialSymmetry) -> bool:
    """Whether the axis points straight up or down."""
    return bool(np.hypot(*symmetry.axis[:2]) < 1e-12)


def _tilts_seen(camera: Camera, directions: Array) -> tuple[float, float]:
    """Lowest and highest elevation (deg) of the camera's field, some of its directions (n, 3) given."""
    symmetry = camera.symmetry
    edge = [camera.backproject(_pixels_along_the_edge(camera.image_size)).directions]
    if symmetry is not None:
        rim = _ring(symmetry.axis, symmetry.omega_max)
        seen = camera.project_directions(rim).valid
        if is_vertical(symmetry) and seen.any():
            return _sorted_degrees(symmetry.axis[2] * (np.pi / 2 - np.array([symmetry.omega_min, symmetry.omega_max])))
        edge.append(rim[seen])
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    edge.append(poles[camera.project_directions(poles).valid])
    heights = np.concatenate([directions, *edge])[:, 2]
    return _sorted_degrees(np.arcsin(np.clip([np.nanmin(heights), np.nanmax(heights)], -1, 1)))


def _sorted_degrees(angles: Array) -> tuple[float, float]:
    low, high = sorted(float(a) for a in np.degrees(angles))
    return low, high


def _ring(axis: Array, omega: float) -> Array:
    """Unit vectors (EDGE_SAMPLES, 3) at the angle omega from an axis."""
    helper = np.eye(3)[np.argmin(abs(axis))]
    e1 = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    e2 = np.cross(axis, e1)
    phi = np.linspace(0, 2 * np.pi, EDGE_SAMPLES, endpoint=False)[:, None]
    ring: Array = np.cos(omega) * axis + np.sin(omega) * (np.cos(phi) * e1 + np.sin(phi) * e2)
    return ring


def _directions_all_over() -> Array:
    """Unit vectors (SAMPLES, 3), each for the same part of the sphere (a Fibonacci lattice)."""
    i = np.arange(SAMPLES) + 0.5
    z = 1 - 2 * i / SAMPLES
    phi = i * np.pi * (1 + 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


def _pixels_all_over(size: tuple[int, int]) -> Array:
    """Pixels (about SAMPLES, 2) in a regular grid."""
    width, height = size
    step = np.sqrt(width * height / SAMPLES)
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _pixels_along_the_edge(size: tuple[int, int]) -> Array:
    """Points (4 EDGE_SAMPLES, 2) along the outline of the picture."""
    right, bottom = size[0] - 0.5, size[1] - 0.5
    u, v = np.linspace(-0.5, right, EDGE_SAMPLES), np.linspace(-0.5, bottom, EDGE_SAMPLES)
    sides = [(u, np.full_like(u, -0.5)), (u, np.full_like(u, bottom)), (np.full_like(v, -0.5), v)]
    return np.concatenate([np.stack(side, axis=-1) for side in [*sides, (np.full_like(v, right), v)]])


def _completed(size: PartialSize, natural: tuple[float, float]) -> tuple[int, int]:
    """The size with what is missing taken from a natural size: all of it, or the proportion."""
    width, height = size
    if width is None and height is None:
        return _even(natural[0]), _even(natural[1])
    if height is None:
        assert width is not None
        return width, max(1, round(width * natural[1] / natural[0]))
    return width if width is not None else max(1, round(height * natural[0] / natural[1])), height


def _even(length: float) -> int:
    """Rounded to an even number, as video wants it."""
    return max(2, 2 * round(length / 2))
