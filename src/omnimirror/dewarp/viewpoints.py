"""From where a screen is seen: by the true reflection of each of its points, or from one viewpoint.

A mirror sees every point from a place of its own. The paper's virtual projector stands in a single
viewpoint V0 instead (its section 4.2): harmless for distant things, some pixels wrong for near ones.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import number, shown
from ..base.errors import InvalidParameter, OutsideField
from ..cameras.camera import Camera, Projection
from .screens import Screen

Array = NDArray[np.float64]
Viewpoint: TypeAlias = float | Literal["exact", "single"]

PLACES = 16  # rows, and columns, of a screen at which its distance is measured
AZIMUTHS, ANGLES = 8, 257  # of the rays on which a single viewpoint is judged; the picture may cut off some azimuths
PRECISION = 1e-7  # of the range in which it is sought
SIDEWAYS = 1e-6  # sine of the angle from the axis below which a ray does not tell where it meets the axis


def check_viewpoint(viewpoint: Viewpoint) -> None:
    """Refuse what is neither a word that is known nor a height."""
    if isinstance(viewpoint, str):
        if viewpoint in ("exact", "single"):
            return
    else:
        number("viewpoint", viewpoint, unit="mm")
        return
    raise InvalidParameter(f"viewpoint = {shown(viewpoint)} is not 'exact', 'single' or a height over the vertex in mm")


def projection_of(camera: Camera, screen: Screen, viewpoint: Viewpoint) -> Callable[[Array], Projection]:
    """The camera's projection of a screen's targets (n, 3)."""
    centre = centre_of_projection(camera, screen, viewpoint)
    if centre is None:
        return camera.project
    return lambda targets: camera.project_directions(targets - centre)


def centre_of_projection(camera: Camera, screen: Screen, viewpoint: Viewpoint) -> Array | None:
    """The place (3,) mm from which all of a screen is seen; None where each point is seen from a place of its own."""
    if screen.is_distant:
        return np.zeros(3)  # from infinitely far away all viewpoints are one
    if viewpoint == "exact":
        return None
    if viewpoint == "single":
        viewpoint = single_viewpoint(camera, middle_distance(screen))
    return place_on_axis(camera, float(viewpoint))


def place_on_axis(camera: Camera, height_mm: float) -> Array:
    """World point (3,) mm on the camera's axis, at a height over the mirror vertex.

    Raises
    ------
    InvalidParameter
        If the camera has no axis.
    """
    if height_mm == 0:
        return np.zeros(3)
    if camera.symmetry is None:
        raise InvalidParameter(
            f"viewpoint = {height_mm:g} mm is nowhere: the camera is not symmetric about an axis; 'exact' is valid"
        )
    place: Array = -height_mm * camera.symmetry.axis  # the axis is the direction seen at field angle 0
    return place


def middle_distance(screen: Screen) -> float:
    """Median distance (mm) of a screen's points from the mirror vertex.

    >>> from omnimirror.dewarp.screens import Sphere
    >>> round(middle_distance(Sphere((40, 20), distance_mm=300.0)), 9)
    300.0
    """
    width, height = screen.size
    columns = np.unique(np.linspace(0, width - 1, min(width, PLACES)).round().astype(int))
    rows = np.unique(np.linspace(0, height - 1, min(height, PLACES)).round().astype(int))
    points = screen.targets_at(columns.astype(float), rows[:, None].astype(float)).reshape(-1, 3)
    distances = np.linalg.norm(points[~np.isnan(points[:, 0])], axis=1)
    return float(np.median(distances)) if len(distances) else np.inf


def single_viewpoint(camera: Camera, distance_mm: float) -> float:
    """Height V0 (mm over the mirror vertex) of the viewpoint whose largest error in the picture is least.

    The paper's choice: for things at a distance from where they are reflected, over the whole field. It
    belongs to camera and distance, so that it stays where it is when a view moves. The error is counted
    where the picture shows it; the paper's Eq. 23 multiplies the angle with dh/dOmega instead, which at
    7 mirror radii is 5 % too little at the rim.

    Raises
    ------
    OutsideField
        If the camera sees nothing.
    InvalidParameter
        If its viewpoints lie about no axis.

    Examples
    --------
    At 7 mirror radii from the paper's sphere (Fig. 15), in mirror radii:

    >>> import omnimirror as om
    >>> round(single_viewpoint(om.load_sensor("paper-spherical"), 7 * 43.9) / 43.9, 3)
    0.255
    """
    pixels = _pixels_of_the_field(camera)
    origins, directions, seen = camera.backproject(pixels)
    if not seen.any():
        raise OutsideField("the camera sees nothing, so no viewpoint of it is best")
    pixels, origins, directions = pixels[seen], origins[seen], directions[seen]
    heights = _heights_on_axis(camera, origins, directions)
    low, high = float(heights.min()), float(heights.max())
    if np.isinf(distance_mm) or high - low <= PRECISION * max(abs(low), abs(high)):
        return low
    points = origins + distance_mm * directions

    def worst_px(height: float) -> float:
        apparent = points - place_on_axis(camera, height)
        return float(np.nanmax(np.hypot(*(_seen_in(camera, apparent, directions) - pixels).T)))

    from scipy.optimize import minimize_scalar

    best = minimize_scalar(worst_px, bounds=(low, high), method="bounded", options={"xatol": PRECISION * (high - low)})
    return float(best.x)


def _pixels_of_the_field(camera: Camera) -> Array:
    """Pixels (n, 2) from the centre to the rim; without an axis, the corners and the middle of the picture."""
    s = camera.symmetry
    if s is None:
        width, height = camera.image_size
        return np.stack(np.meshgrid([0.0, (width - 1) / 2, width - 1.0], [0.0, (height - 1) / 2]), -1).reshape(-1, 2)
    phi = np.linspace(0, 2 * np.pi, AZIMUTHS, endpoint=False)
    across = np.outer(np.cos(phi), s.right) + np.outer(np.sin(phi), s.down)
    omega = np.linspace(s.omega_min, s.omega_max, ANGLES)[:, None, None]
    pixels, seen = camera.project_directions((np.cos(omega) * s.axis + np.sin(omega) * across).reshape(-1, 3))
    return pixels[seen]


def _seen_in(camera: Camera, apparent: Array, true: Array) -> Array:
    """Pixels (n, 2) of apparent directions (n, 3).

    Those beyond the edge of the field are turned to the other side of the true direction, where their
    error is of the same size: left out, they would make viewpoints look good that push the edge out.
    """
    pixels, seen = camera.project_directions(apparent)
    unit = apparent[~seen] / np.linalg.norm(apparent[~seen], axis=1, keepdims=True)
    axis = true[~seen]
    pixels[~seen] = camera.project_directions(2 * (unit * axis).sum(axis=1, keepdims=True) * axis - unit).pixels
    return pixels


def _heights_on_axis(camera: Camera, origins: Array, directions: Array) -> Array:
    """Heights (k,) mm over the vertex at which rays (n, 3) pass the camera's axis; (1,) for a single viewpoint."""
    if np.ptp(origins, axis=0).max() == 0 and not origins[0].any():
        return np.zeros(1)
    if camera.symmetry is None:
        raise InvalidParameter("the camera's viewpoints lie about no axis, so none of them is best; use 'exact'")
    up = -camera.symmetry.axis
    along, sideways = directions @ up, directions - np.outer(directions @ up, up)
    tilted = np.linalg.norm(sideways, axis=1) > SIDEWAYS
    if not tilted.any():
        return np.zeros(1)
    steps = -(origins * sideways).sum(axis=1)[tilted] / (sideways**2).sum(axis=1)[tilted]
    heights: Array = (origins @ up)[tilted] + steps * along[tilted]
    return heights
