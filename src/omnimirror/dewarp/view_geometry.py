"""View geometry of a camera: its field of view and resolution, and the viewpoint of a screen.

A mirror has a different viewpoint for every point. A screen is dewarped with the true reflection for
each of its points, or with a single viewpoint V0, the virtual projector of the paper (section 4.2):
exact for distant objects, with errors of a few pixels for nearby objects.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from ..base.arguments import format_value, instance, number
from ..base.errors import InvalidParameter, OutsideField
from ..base.typing import Array, Mask
from ..cameras.camera import EDGE_SLACK, AxialSymmetry, Camera, Projection, inside_image
from .interfaces import Annulus
from .screens import Pole, Screen

# -- Field of view and mean resolution -------------------------------------------------------------

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


# -- Viewpoint of a screen -------------------------------------------------------------------------

Viewpoint: TypeAlias = float | Literal["exact", "single"]

SAMPLES_PER_SIDE = 16  # sampled rows and columns of a screen for its distance
AZIMUTHS, ANGLES = (
    8,
    257,
)  # rays for the evaluation of a single viewpoint; some azimuths may be outside the image
RELATIVE_PRECISION = 1e-7  # relative to the search range
MIN_AXIS_SINE = 1e-6  # minimum sine of the angle from the axis for an intersection with the axis


def check_viewpoint(viewpoint: Viewpoint) -> None:
    """Raise an error unless the viewpoint is a known name or a height."""
    if isinstance(viewpoint, str):
        if viewpoint in ("exact", "single"):
            return
    else:
        number("viewpoint", viewpoint, unit="mm")
        return
    raise InvalidParameter(
        f"viewpoint must be 'exact', 'single' or a height above the vertex in mm; got {format_value(viewpoint)}"
    )


def projection_of(
    camera: Camera, screen: Screen, viewpoint: Viewpoint
) -> Callable[[Array], Projection]:
    """Return the projection of screen targets (n, 3) by a camera."""
    centre = centre_of_projection(camera, screen, viewpoint)
    if centre is None:
        return camera.project
    return lambda targets: camera.project_directions(targets - centre)


def centre_of_projection(camera: Camera, screen: Screen, viewpoint: Viewpoint) -> Array | None:
    """Return the common viewpoint (3,) mm of a screen; None if each point has its own viewpoint."""
    if screen.is_distant:
        return np.zeros(3)  # at infinity all viewpoints are equivalent
    if viewpoint == "exact":
        return None
    if viewpoint == "single":
        viewpoint = single_viewpoint(camera, middle_distance(screen))
    return point_on_axis(camera, float(viewpoint))


def point_on_axis(camera: Camera, height_mm: float) -> Array:
    """Return the world point (3,) mm on the camera axis at a height over the mirror vertex.

    Raises
    ------
    InvalidParameter
        If the camera has no axis.
    """
    if height_mm == 0:
        return np.zeros(3)
    if camera.symmetry is None:
        raise InvalidParameter(
            f"viewpoint must be 'exact' for a camera without axial symmetry; got {height_mm:g} mm"
        )
    point: Array = -height_mm * camera.symmetry.axis  # the axis is the direction at field angle 0
    return point


def middle_distance(screen: Screen) -> float:
    """Return the median distance (mm) of the points of a screen from the mirror vertex.

    >>> from omnimirror.dewarp.screens import Equirectangular
    >>> round(middle_distance(Equirectangular((40, 20), distance_mm=300.0)), 9)
    300.0
    """
    width, height = screen.size
    columns = np.unique(np.linspace(0, width - 1, min(width, SAMPLES_PER_SIDE)).round().astype(int))
    rows = np.unique(np.linspace(0, height - 1, min(height, SAMPLES_PER_SIDE)).round().astype(int))
    points = screen.targets_at(columns.astype(float), rows[:, None].astype(float)).reshape(-1, 3)
    distances = np.linalg.norm(points[~np.isnan(points[:, 0])], axis=1)
    return float(np.median(distances)) if len(distances) else np.inf


def single_viewpoint(camera: Camera, distance_mm: float) -> float:
    """Return the height V0 (mm over the mirror vertex) of the viewpoint with the smallest maximum
    image error.

    This is the choice of the paper: for objects at a distance from their reflection points, over
    the whole field. It depends on the camera and the distance and is unchanged when a view moves.
    The error is evaluated in the image; Eq. 23 of the paper multiplies the angle by dh/dOmega
    instead, which is 5 % too small at the rim for 7 mirror radii.

    Raises
    ------
    OutsideField
        If no pixel of the camera images the scene.
    InvalidParameter
        If its viewpoints are not symmetric about an axis.

    Examples
    --------
    For 7 mirror radii from the sphere of the paper (Fig. 15), in mirror radii:

    >>> import omnimirror as om
    >>> round(single_viewpoint(om.load_sensor("paper-spherical"), 7 * 43.9) / 43.9, 3)
    0.255
    """
    pixels = _pixels_of_the_field(camera)
    origins, directions, visible = camera.backproject(pixels)
    if not visible.any():
        raise OutsideField("at least one pixel of the camera must observe the scene; got none")
    pixels, origins, directions = pixels[visible], origins[visible], directions[visible]
    heights = _heights_on_axis(camera, origins, directions)
    low, high = float(heights.min()), float(heights.max())
    if np.isinf(distance_mm) or high - low <= RELATIVE_PRECISION * max(abs(low), abs(high)):
        return low
    points = origins + distance_mm * directions

    def max_error_px(height: float) -> float:
        apparent = points - point_on_axis(camera, height)
        return float(
            np.nanmax(np.hypot(*(_projected_apparent(camera, apparent, directions) - pixels).T))
        )

    from scipy.optimize import minimize_scalar

    optimum = minimize_scalar(
        max_error_px,
        bounds=(low, high),
        method="bounded",
        options={"xatol": RELATIVE_PRECISION * (high - low)},
    )
    return float(optimum.x)


def _pixels_of_the_field(camera: Camera) -> Array:
    """Return pixels (n, 2) from the centre to the rim; without an axis, the corners and the centre
    of the image.
    """
    s = camera.symmetry
    if s is None:
        width, height = camera.image_size
        return np.stack(
            np.meshgrid([0.0, (width - 1) / 2, width - 1.0], [0.0, (height - 1) / 2]), -1
        ).reshape(-1, 2)
    phi = np.linspace(0, 2 * np.pi, AZIMUTHS, endpoint=False)
    across = np.outer(np.cos(phi), s.right) + np.outer(np.sin(phi), s.down)
    omega = np.linspace(s.omega_min, s.omega_max, ANGLES)[:, None, None]
    pixels, visible = camera.project_directions(
        (np.cos(omega) * s.axis + np.sin(omega) * across).reshape(-1, 3)
    )
    return pixels[visible]


def _projected_apparent(camera: Camera, apparent: Array, true: Array) -> Array:
    """Return pixels (n, 2) of apparent directions (n, 3).

    Directions outside the field are mirrored at the true direction, which preserves the magnitude
    of the error: without them, viewpoints that move the edge out of the field would be preferred.
    """
    pixels, visible = camera.project_directions(apparent)
    unit = apparent[~visible] / np.linalg.norm(apparent[~visible], axis=1, keepdims=True)
    axis = true[~visible]
    pixels[~visible] = camera.project_directions(
        2 * (unit * axis).sum(axis=1, keepdims=True) * axis - unit
    ).pixels
    return pixels


def _heights_on_axis(camera: Camera, origins: Array, directions: Array) -> Array:
    """Return heights (k,) mm over the vertex of the intersections of rays (n, 3) with the camera
    axis; (1,) for a single viewpoint.
    """
    if np.ptp(origins, axis=0).max() == 0 and not origins[0].any():
        return np.zeros(1)
    if camera.symmetry is None:
        raise InvalidParameter(
            "viewpoint must be 'exact' for a camera without axial symmetry; got 'single'"
        )
    up = -camera.symmetry.axis
    along, across = directions @ up, directions - np.outer(directions @ up, up)
    tilted = np.linalg.norm(across, axis=1) > MIN_AXIS_SINE
    if not tilted.any():
        return np.zeros(1)
    # Closest approach to the axis: the component s of the ray perpendicular to the axis satisfies
    # (o + t s) . s = 0, therefore t = -(o . s) / (s . s)
    steps = -(origins * across).sum(axis=1)[tilted] / (across**2).sum(axis=1)[tilted]
    heights: Array = (origins @ up)[tilted] + steps * along[tilted]
    return heights
