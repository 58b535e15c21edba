"""Viewpoint of a screen: true reflection for each of its points, or a single viewpoint.

A mirror has a different viewpoint for every point. The virtual projector of the paper has a single
viewpoint V0 instead (section 4.2): exact for distant objects, with errors of a few pixels for
nearby objects.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from ..base.arguments import format_value, number
from ..base.errors import InvalidParameter, OutsideField
from ..base.typing import Array
from ..cameras.camera import Camera, Projection
from .screens import Screen

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
