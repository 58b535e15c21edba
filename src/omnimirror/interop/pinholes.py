"""Pinhole cameras equivalent to dewarped views, for programs without a model of mirror cameras.

The rays of a mirror do not meet in one point. A distant view is exact for objects at infinity; its
pinhole is at the point with the least sum of squared distances from the rays. A view at a finite
distance is exact at that distance. The remaining parallax is reported in pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import instance, integer, number
from ..base.errors import OutsideField
from ..base.typing import Array
from ..cameras.camera import Camera, view_axes
from ..dewarp import Dewarper, views
from ..dewarp.screens import Equirectangular, Plane, Screen
from ..dewarp.view_geometry import Viewpoint, projection_of
from ..optics.sensor import Sensor
from .ray_tables import obscured_pixels

SAMPLES_PER_SIDE = 25
"""Rays along each side of a view for position and parallax."""
MAX_RIG_VIEWS = 36
DISTANCES_MM = (1000.0, 3000.0, 10000.0)
"""Object distances at which the parallax of a rig is reported."""
MASK_MARGIN_PX = 2
"""Erosion of masks at the field edge, where blur and resampling mix both sides."""


class EquivalentPinhole(NamedTuple):
    """Pinhole camera equivalent to a perspective view, in the mirror frame (x forward, z up)."""

    size: tuple[int, int]
    """(width, height) px."""
    matrix: Array
    """(3, 3) camera matrix K, px; integers at pixel centres, as in OpenCV and ROS."""
    rotation: Array
    """(3, 3) rotation; the columns are the camera axes right, down and forward."""
    position_mm: Array
    """(3,) centre of projection."""
    rays: tuple[Array, Array, Array]
    """Sampled pixels (n, 2) of the view and the origins (n, 3), mm, and directions (n, 3) of
    their rays."""

    def error_px(self, distance_mm: float) -> float:
        """Compute the maximum reprojection error for objects at a distance.

        Parameters
        ----------
        distance_mm
            Depth along the optical axis of the pinhole, mm.

        Returns
        -------
        float
            Maximum error over the view, px.

        Examples
        --------
        >>> import omnimirror as om
        >>> wall = om.screens.Plane((640, 480), distance_mm=1000.0)
        >>> pinhole = equivalent_pinhole(om.load_sensor("paper-spherical"), wall)
        >>> f"{pinhole.error_px(1000.0):.3f} {pinhole.error_px(5000.0):.1f}"  # on and behind it
        '0.000 4.9'
        """
        # Intersect each ray with the plane at the distance and project the point with K.
        pixels, origins, directions = self.rays
        start = (origins - self.position_mm) @ self.rotation
        heading = directions @ self.rotation
        reach = (distance_mm - start[:, 2]) / heading[:, 2]
        projected = (start + reach[:, None] * heading) @ self.matrix.T / distance_mm
        return float(np.linalg.norm(projected[:, :2] - pixels, axis=1).max())


def equivalent_pinhole(
    camera: Camera, view: Plane, viewpoint: Viewpoint = "exact"
) -> EquivalentPinhole:
    """Return the pinhole camera that best approximates a perspective view.

    Parameters
    ----------
    camera
        Camera of the source images.
    view
        Perspective view, distant or at a finite distance.
    viewpoint
        Viewpoint mode, as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    EquivalentPinhole
        For a view at a finite distance, the pinhole at the offset of the view; for a distant
        view, the pinhole with the least sum of squared distances from the rays.

    Raises
    ------
    OutsideField
        If no pixel of the view is inside the field of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> view = om.screens.Plane((640, 480))
    >>> pinhole = equivalent_pinhole(om.load_sensor("paper-spherical"), view)
    >>> pinhole.matrix[0], np.abs(pinhole.position_mm).round(1)  # inside the mirror
    (array([320. ,   0. , 319.5]), array([ 6. ,  0. , 10.1]))
    """
    width, height = view.size
    forward, right, down = view_axes(view.pan_deg, view.tilt_deg, view.roll_deg)
    focal = view.focal_px
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    rays = _sampled_rays(camera, view, viewpoint)
    position = nearest_point(*rays[1:]) if view.is_distant else np.array(view.offset_mm)
    rotation = np.stack([right, down, forward], axis=1)
    return EquivalentPinhole(view.size, matrix, rotation, position, rays)


def _sampled_rays(
    camera: Camera, view: Screen, viewpoint: Viewpoint = "exact"
) -> tuple[Array, Array, Array]:
    """Sample pixels of a view and their rays; see :attr:`EquivalentPinhole.rays`."""
    width, height = view.size
    grid = np.meshgrid(*(np.linspace(0, n - 1, SAMPLES_PER_SIDE) for n in (width, height)))
    u, v = (side.ravel() for side in grid)
    image = projection_of(camera, view, viewpoint)(view.targets_at(u, v))
    rays = camera.backproject(image.pixels)
    if not rays.valid.any():
        raise OutsideField(f"the {view} is outside the field of the camera")
    pixels = np.stack([u, v], axis=1)
    return pixels[rays.valid], rays.origins[rays.valid], rays.directions[rays.valid]


def nearest_point(origins: Array, directions: Array) -> Array:
    """Return the point (3,) with the least sum of squared distances from lines.

    With P = I - d d^T, the projection perpendicular to a line, the normal equations are
    sum(P) x = sum(P o).
    """
    projections = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    left, right = projections.sum(axis=0), np.einsum("nij,nj->i", projections, origins)
    point: Array = np.linalg.lstsq(left, right, rcond=None)[0]
    return point


# -- rigs ----------------------------------------------------------------------------------------


class RigCamera(NamedTuple):
    """Virtual camera of a rig, in the mirror frame (x forward, y left, z up)."""

    name: str
    screen: Plane | Equirectangular
    model: str
    """COLMAP camera model, ``PINHOLE`` or ``EQUIRECTANGULAR``."""
    parameters: tuple[float, ...]
    """COLMAP camera parameters; pixel centres are at half-integers."""
    rotation: Array
    """(3, 3) rotation; the columns are the camera axes right, down and forward."""
    position_mm: Array
    """(3,) centre of projection."""
    errors_px: dict[float, float]
    """Maximum reprojection error, px, by object distance, mm."""

    def from_reference(self, reference: RigCamera) -> tuple[Array, Array]:
        """Return rotation (3, 3) and translation (3,), m, from the frame of a reference camera."""
        rotation = self.rotation.T @ reference.rotation
        shift_mm = self.rotation.T @ (reference.position_mm - self.position_mm)
        return rotation, shift_mm / 1000.0


def camera_rig(
    camera: Camera,
    views_around: int = 6,
    *,
    hfov_deg: float = 75.0,
    tilt_deg: float = 0.0,
    size: int | None = None,
    distance_mm: float = np.inf,
    panorama: bool = False,
) -> tuple[RigCamera, ...]:
    """Return a rig of virtual cameras that covers the field of a mirror camera.

    Parameters
    ----------
    camera
        Sensor or calibrated camera.
    views_around
        Number of square perspective views, equally spaced in azimuth.
    hfov_deg, tilt_deg
        Field of view and elevation of the optical axis of each view.
    size
        Side of a view or width of the panorama, px; default: resolution of the source image.
    distance_mm
        Object distance at which perspective views are exact; default: infinity.
    panorama
        Return one equirectangular camera instead of perspective views.

    Returns
    -------
    tuple of RigCamera
        Cameras; the first is the reference of the rig.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range.
    OutsideField
        If a view is outside the field of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> rig = camera_rig(om.load_sensor("paper-spherical"), 4, size=320)
    >>> [view.name for view in rig], rig[0].position_mm.round(1) + 0.0
    (['view-000', 'view-090', 'view-180', 'view-270'], array([8.3, 0. , 9.9]))
    >>> {mm: round(px, 2) for mm, px in rig[0].errors_px.items()}
    {1000.0: 2.61, 3000.0: 0.87, 10000.0: 0.26}
    """
    instance("camera", camera, Camera, "a camera (see om.load_sensor)")
    if panorama:
        return (_panorama_camera(camera, size),)
    count = integer("views_around", views_around, 1, MAX_RIG_VIEWS)
    number("hfov_deg", hfov_deg, low=5.0, high=150.0)
    number("tilt_deg", tilt_deg, low=-90.0, high=90.0)
    if size is None:
        size = _native_size(camera, hfov_deg, tilt_deg)
    side = integer("size", size, 16, 20_000)
    cameras = []
    for pan_deg in 360.0 * np.arange(count) / count:
        screen = views.perspective(
            (side, side),
            pan_deg=float(pan_deg),
            tilt_deg=tilt_deg,
            hfov_deg=hfov_deg,
            distance_mm=distance_mm,
        )
        pinhole = equivalent_pinhole(camera, screen)
        focal = float(pinhole.matrix[0, 0])
        cameras.append(
            RigCamera(
                name=f"view-{pan_deg:03.0f}",
                screen=screen,
                model="PINHOLE",
                parameters=(focal, focal, side / 2, side / 2),
                rotation=pinhole.rotation,
                position_mm=pinhole.position_mm,
                errors_px={distance: pinhole.error_px(distance) for distance in DISTANCES_MM},
            )
        )
    return tuple(cameras)


def _native_size(camera: Camera, hfov_deg: float, tilt_deg: float) -> int:
    """Return the side of a view with the median resolution of the source image, px."""
    small = views.perspective((64, 64), tilt_deg=tilt_deg, hfov_deg=hfov_deg)
    pixels = Dewarper(camera, small).coordinates()
    steps = np.linalg.norm(np.diff(pixels, axis=1), axis=-1)
    return max(16, int(2 * np.ceil(64 * float(np.nanmedian(steps)) / 2)))


def _panorama_camera(camera: Camera, width: int | None) -> RigCamera:
    """Return an equirectangular camera at the point nearest to all rays."""
    screen = views.sphere(camera) if width is None else views.sphere(camera, (width, None))
    _, origins, directions = _sampled_rays(camera, screen)
    position = nearest_point(origins, directions)
    errors = {}
    for distance in DISTANCES_MM:
        # Intersect each ray with a sphere of this radius about the position: |s + t d| = distance.
        start = origins - position
        along = np.einsum("ni,ni->n", start, directions)
        reach = np.sqrt(along**2 - (start**2).sum(axis=1) + distance**2) - along
        apparent = (start + reach[:, None] * directions) / distance
        sine = np.linalg.norm(np.cross(apparent, directions), axis=1)
        angle = np.arctan2(sine, (apparent * directions).sum(axis=1))
        errors[distance] = float(angle.max() * screen.size[0] / (2 * np.pi))
    forward, right, down = view_axes(0.0, 0.0)
    size = tuple(map(float, screen.size))
    rotation = np.stack([right, down, forward], 1)
    return RigCamera("panorama", screen, "EQUIRECTANGULAR", size, rotation, position, errors)


def view_mask(camera: Camera, dewarper: Dewarper) -> NDArray[np.uint8]:
    """Return the mask of a view: 255 for the scene, 0 outside the field and for obscurations.

    Parameters
    ----------
    camera
        Camera of the source images.
    dewarper
        Dewarper of the view.

    Returns
    -------
    (height, width) array
        Mask, eroded by :data:`MASK_MARGIN_PX`.
    """
    import cv2

    pixels = dewarper.coordinates()
    visible = np.isfinite(pixels[..., 0])
    if isinstance(camera, Sensor):
        inside = pixels[visible]
        rays = camera.backproject(inside)
        visible[visible] = ~obscured_pixels(camera, inside, rays) & rays.valid
    kernel = np.ones((2 * MASK_MARGIN_PX + 1,) * 2, np.uint8)
    eroded = cv2.erode(visible.astype(np.uint8) * 255, kernel, borderValue=255)
    return np.asarray(eroded, np.uint8)
