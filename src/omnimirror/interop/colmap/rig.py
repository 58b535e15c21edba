"""The cameras that a mirror's picture becomes: pinholes all around, where they miss the rays least, or one sphere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import instance, number, whole
from ...cameras import Camera
from ...dewarp import Dewarper, views
from ...dewarp.screens import Plane, Sphere
from ...frames import view_axes
from ...sensor import Sensor
from ..hiding import hidden_pixels
from ..pinholes import nearest_point, pinhole_of, view_rays

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_VIEWS = 36
DISTANCES_MM = (1000.0, 3000.0, 10000.0)
"""At which the loss is told."""
EDGE_PX = 2
"""How far masks reach over the edge of what is seen: blur and sampling mix both sides there."""


class RigView(NamedTuple):
    """One camera of a rig, in the frame of the mirror: x forward, y left, z up."""

    name: str
    screen: Plane | Sphere
    model: str
    """COLMAP's word for it."""
    parameters: tuple[float, ...]
    """As COLMAP has them: its pixel centres are at halves."""
    rotation: Array
    """(3, 3) whose columns are the camera's axes: right, down, and where it looks."""
    position_mm: Array
    """(3,) where it stands."""
    errors_px: dict[float, float]
    """How far off at most it looks for what the view shows of things at distances, mm."""


def rig_of(
    camera: Camera,
    views_around: int = 6,
    *,
    hfov_deg: float = 75.0,
    tilt_deg: float = 0.0,
    size: int | None = None,
    distance_mm: float = np.inf,
    is_panorama: bool = False,
) -> tuple[RigView, ...]:
    """The cameras of a rig.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    views_around
        Square perspective views, evenly about the upright axis.
    hfov_deg, tilt_deg
        Their field, and how far up they look.
    size
        Of a view's sides, or a panorama's width, px; the picture's resolution by default.
    distance_mm
        Where perspective views are exact, all from one point; by default far away.
    is_panorama
        One equirectangular camera instead.

    Returns
    -------
    tuple of RigView
        The first is the one that the others are placed against.

    Raises
    ------
    InvalidParameter
        A number out of its range.
    OutsideField
        A view sees nothing.

    Examples
    --------
    >>> import omnimirror as om
    >>> rig = rig_of(om.load_sensor("paper-spherical"), 4, size=320)
    >>> [view.name for view in rig], rig[0].position_mm.round(1) + 0.0
    (['view-000', 'view-090', 'view-180', 'view-270'], array([8.3, 0. , 9.9]))
    >>> {mm: round(px, 2) for mm, px in rig[0].errors_px.items()}
    {1000.0: 2.61, 3000.0: 0.87, 10000.0: 0.26}
    """
    instance("camera", camera, Camera, "a camera, such as om.load_sensor gives")
    if is_panorama:
        return (_panorama(camera, size),)
    count = whole("views_around", views_around, 1, MOST_VIEWS)
    number("hfov_deg", hfov_deg, low=5.0, high=150.0)
    number("tilt_deg", tilt_deg, low=-90.0, high=90.0)
    side = _natural_size(camera, hfov_deg, tilt_deg) if size is None else whole("size", size, 16, 20_000)
    found = []
    for k in range(count):
        pan = 360.0 * k / count
        screen = views.perspective(
            (side, side), pan_deg=pan, tilt_deg=tilt_deg, hfov_deg=hfov_deg, distance_mm=distance_mm
        )
        pinhole = pinhole_of(camera, screen)
        focal, middle = float(pinhole.matrix[0, 0]), side / 2
        errors = {at: pinhole.error_px(at) for at in DISTANCES_MM}
        parameters = (focal, focal, middle, middle)
        found.append(
            RigView(f"view-{pan:03.0f}", screen, "PINHOLE", parameters, pinhole.rotation, pinhole.position_mm, errors)
        )
    return tuple(found)


def _natural_size(camera: Camera, hfov_deg: float, tilt_deg: float) -> int:
    """The side of a view in whose middle a pixel is as wide as one of the picture."""
    small = views.perspective((64, 64), tilt_deg=tilt_deg, hfov_deg=hfov_deg)
    pixels = Dewarper(camera, small).coordinates()
    steps = np.linalg.norm(np.diff(pixels, axis=1), axis=-1)
    return max(16, int(2 * np.ceil(64 * float(np.nanmedian(steps)) / 2)))


def _panorama(camera: Camera, width: int | None) -> RigView:
    screen = views.sphere(camera) if width is None else views.sphere(camera, (width, None))
    _, origins, directions = view_rays(camera, screen)
    position = nearest_point(origins, directions)
    errors = {}
    for distance in DISTANCES_MM:
        start = origins - position
        along = np.einsum("ni,ni->n", start, directions)
        reach = np.sqrt(along**2 - (start**2).sum(axis=1) + distance**2) - along
        seen = (start + reach[:, None] * directions) / distance
        angle = np.arctan2(np.linalg.norm(np.cross(seen, directions), axis=1), (seen * directions).sum(axis=1))
        errors[distance] = float(angle.max() * screen.size[0] / (2 * np.pi))
    forward, right, down = view_axes(0.0, 0.0)
    size = tuple(map(float, screen.size))
    return RigView("panorama", screen, "EQUIRECTANGULAR", size, np.stack([right, down, forward], 1), position, errors)


def mask_of(camera: Camera, dewarp: Dewarper) -> NDArray[np.uint8]:
    """255 where a view shows the world, and 0 at the rim, on the camera's own image and on supports."""
    import cv2

    pixels = dewarp.coordinates()
    seen = np.isfinite(pixels[..., 0])
    if isinstance(camera, Sensor):
        flat = pixels[seen]
        rays = camera.backproject(flat)
        seen[seen] = ~hidden_pixels(camera, flat, rays) & rays.valid
    kernel = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.erode(seen.astype(np.uint8) * 255, kernel, borderValue=255), np.uint8)


def sensor_from_rig(view: RigView, first: RigView) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) m from the frame of the first camera to that of a view's."""
    turn = view.rotation.T @ first.rotation
    return turn, view.rotation.T @ (first.position_mm - view.position_mm) / 1000.0
