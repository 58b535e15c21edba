"""Field of view and mean resolution of a camera, as required by views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..base.arguments import instance
from ..base.errors import OutsideField
from ..base.typing import Array, Mask
from ..cameras.camera import EDGE_SLACK, AxialSymmetry, Camera, inside_image
from .interfaces import Annulus
from .screens import Pole

SAMPLES = 20_000  # directions on the sphere, and pixels of the image
ANNULUS_SLACK_PX = 1e-3  # the rim itself is inside the field
EDGE_SAMPLES = 1440  # points along the rim and along each side of the image


@dataclass(frozen=True)
class FieldOfView:
    """Field of view and mean resolution of a camera."""

    tilt_min_deg: float
    """Minimum elevation in the field."""
    tilt_max_deg: float
    """Maximum elevation in the field."""
    pixels_per_degree: float
    """Square root of the mean number of source pixels per square degree of the field."""
    pole: Pole
    """Pole nearest to the camera's axis of symmetry, or to its mean direction without such an axis.
    """


def field_of(camera: Camera) -> FieldOfView:
    """Return the elevation range, mean resolution and pole of a camera.

    Elevations are exact for a camera that is symmetric about a vertical axis and images its full
    field; otherwise they are sampled at pixels along the rim, along the image boundary and on a
    regular grid, with an accuracy of about the sample spacing.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.

    Returns
    -------
    FieldOfView
        Elevations in deg, mean resolution and nearest pole.

    Raises
    ------
    OutsideField
        If no pixel images the scene.

    Examples
    --------
    The mean resolution in the paper, 0.0448 square degrees per pixel, for a rim at 500 px:

    >>> import omnimirror as om
    >>> field = field_of(om.load_sensor("paper-spherical"))
    >>> round(field.tilt_min_deg, 2), round(field.tilt_max_deg, 2), round(field.pixels_per_degree, 1)
    (-90.0, 45.0, 4.7)
    """
    instance("camera", camera, Camera, "a camera, for example from om.load_sensor")
    pixels = _pixels_all_over(camera.image_size)
    circular = _circular_field(camera, pixels)
    if circular is not None:
        return circular
    rays = camera.backproject(pixels)
    if not rays.valid.any():
        raise OutsideField("at least one pixel of the camera must observe the scene; got none")
    low, high = _visible_tilts(camera, rays.directions[rays.valid])
    sphere = _directions_all_over()
    width, height = camera.image_size
    visible_pixels = rays.valid.mean() * width * height
    resolution = _resolution(visible_pixels, camera.project_directions(sphere).valid)
    return FieldOfView(low, high, resolution, _pole(camera, rays.directions))


def _circular_field(camera: Camera, pixels: Array) -> FieldOfView | None:
    """Return the field of a camera with a vertical axis that images its full field, without
    tracing; None for others.
    """
    symmetry = camera.symmetry
    if symmetry is None or not is_vertical(symmetry):
        return None
    ends = np.array([symmetry.omega_min, symmetry.omega_max])
    inner, outer = np.sort(symmetry.radius_px(ends))
    corners = np.add(symmetry.centre_px, outer * np.array([[-1.0, -1.0], [1.0, 1.0]]))
    if not inside_image(corners, camera.image_size).all():
        return None
    radius = np.hypot(*(pixels - symmetry.centre_px).T)
    visible = (radius >= inner - EDGE_SLACK) & (radius <= outer + EDGE_SLACK)
    if not visible.any():
        return None  # the field is smaller than the spacing of the sampled pixels
    omega = np.arccos(np.clip(_directions_all_over() @ symmetry.axis, -1, 1))
    width, height = camera.image_size
    resolution = _resolution(
        visible.mean() * width * height, (omega >= ends[0]) & (omega <= ends[1])
    )
    tilts = _sorted_degrees(symmetry.axis[2] * (np.pi / 2 - ends))
    return FieldOfView(*tilts, resolution, _towards(symmetry.axis[2]))


def _resolution(visible_pixels: float, visible_directions: Mask) -> float:
    """Return the resolution (px/deg) from the number of pixels and the fraction of directions in
    the field.
    """
    square_degrees = max(visible_directions.mean(), 1 / SAMPLES) * 4 * np.pi * np.degrees(1) ** 2
    return float(np.sqrt(visible_pixels / square_degrees))


def pole_of(camera: Camera) -> Pole:
    """Return the pole nearest to the camera's axis of symmetry, or to its mean direction without
    such an axis.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.

    Returns
    -------
    str
        ``"nadir"`` or ``"zenith"``.
    """
    if camera.symmetry is not None:
        return _towards(camera.symmetry.axis[2])
    return _pole(camera, camera.backproject(_pixels_all_over(camera.image_size)).directions)


def _pole(camera: Camera, directions: Array) -> Pole:
    """Return the pole for given directions (n, 3) of image pixels; NaN outside the field."""
    symmetry = camera.symmetry
    return _towards(float(np.nanmean(directions[:, 2])) if symmetry is None else symmetry.axis[2])


def _towards(up: float) -> Pole:
    return "zenith" if up > 1e-9 else "nadir"


def is_vertical(symmetry: AxialSymmetry) -> bool:
    """Return True if the axis is vertical."""
    return bool(np.hypot(*symmetry.axis[:2]) < 1e-12)


def annulus_of(camera: Camera) -> Annulus | None:
    """Return the image annulus filled by the field of a symmetric camera; None for other cameras."""
    return None if camera.symmetry is None else _image_annulus(camera)  # type: ignore[arg-type]  # the cache requires Hashable


@lru_cache(maxsize=32)
def _image_annulus(camera: Camera) -> Annulus:
    symmetry = camera.symmetry
    assert symmetry is not None
    ends = symmetry.radius_px(np.array([symmetry.omega_min, symmetry.omega_max]))
    inner, outer = float(ends.min()) - ANNULUS_SLACK_PX, float(ends.max()) + ANNULUS_SLACK_PX
    return Annulus(*symmetry.centre_px, max(inner, 0.0), outer)


def _visible_tilts(camera: Camera, directions: Array) -> tuple[float, float]:
    """Return the minimum and maximum elevation (deg) of the field from directions (n, 3) inside it."""
    symmetry = camera.symmetry
    edge = [camera.backproject(_pixels_along_the_edge(camera.image_size)).directions]
    if symmetry is not None:
        rim = _circle(symmetry.axis, symmetry.omega_max)
        visible = camera.project_directions(rim).valid
        if is_vertical(symmetry) and visible.any():
            return _sorted_degrees(
                symmetry.axis[2] * (np.pi / 2 - np.array([symmetry.omega_min, symmetry.omega_max]))
            )
        edge.append(rim[visible])
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    edge.append(poles[camera.project_directions(poles).valid])
    heights = np.concatenate([directions, *edge])[:, 2]
    return _sorted_degrees(np.arcsin(np.clip([np.nanmin(heights), np.nanmax(heights)], -1, 1)))


def _sorted_degrees(angles: Array) -> tuple[float, float]:
    low, high = sorted(float(a) for a in np.degrees(angles))
    return low, high


def _circle(axis: Array, omega: float) -> Array:
    """Return unit vectors (EDGE_SAMPLES, 3) at the angle omega (radians) from an axis."""
    helper = np.eye(3)[np.argmin(abs(axis))]
    e1 = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    e2 = np.cross(axis, e1)
    phi = np.linspace(0, 2 * np.pi, EDGE_SAMPLES, endpoint=False)[:, None]
    circle: Array = np.cos(omega) * axis + np.sin(omega) * (np.cos(phi) * e1 + np.sin(phi) * e2)
    return circle


def _directions_all_over() -> Array:
    """Return unit vectors (SAMPLES, 3) uniform on the sphere (Fibonacci lattice)."""
    i = np.arange(SAMPLES) + 0.5
    z = 1 - 2 * i / SAMPLES
    phi = i * np.pi * (1 + 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


def _pixels_all_over(size: tuple[int, int]) -> Array:
    """Return pixels (about SAMPLES, 2) on a regular grid."""
    width, height = size
    step = np.sqrt(width * height / SAMPLES)
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _pixels_along_the_edge(size: tuple[int, int]) -> Array:
    """Return points (4 EDGE_SAMPLES, 2) along the image boundary."""
    right, bottom = size[0] - 0.5, size[1] - 0.5
    u, v = np.linspace(-0.5, right, EDGE_SAMPLES), np.linspace(-0.5, bottom, EDGE_SAMPLES)
    sides = [(u, np.full_like(u, -0.5)), (u, np.full_like(u, bottom)), (np.full_like(v, -0.5), v)]
    return np.concatenate(
        [np.stack(side, axis=-1) for side in [*sides, (np.full_like(v, right), v)]]
    )
