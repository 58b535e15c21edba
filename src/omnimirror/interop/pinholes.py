"""What a flat view is to programs that know pinhole cameras only: its matrix, where it stands, and what that costs.

The rays of a mirror do not meet in one point. A distant view shows what lies along the direction of each of its pixels;
the rays start at the mirror, and the pinhole stands where it misses them least. A view at a distance is exact there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..dewarp.screens import Plane, Screen
from ..dewarp.viewpoints import Viewpoint, projection_of
from ..errors import OutsideField
from ..frames import view_axes

Array = NDArray[np.float64]

SAMPLES = 25
"""Along each side of a view."""


class Pinhole(NamedTuple):
    """A pinhole camera, in the frame of the mirror: x forward, y left, z up."""

    size: tuple[int, int]
    """(width, height) px."""
    matrix: Array
    """(3, 3) K, px; integers are at pixel centres, as in OpenCV and ROS."""
    rotation: Array
    """(3, 3) whose columns are the camera's axes: right, down, and where it looks."""
    position_mm: Array
    """(3,) where it stands."""
    rays: tuple[Array, Array, Array]
    """Pixels (n, 2) all over the view, and where the rays that they show really start (n, 3), mm, and go (n, 3)."""

    def error_px(self, distance_mm: float) -> float:
        """How far off, at most, the pinhole looks for what the view shows of things at a distance; px.

        Parameters
        ----------
        distance_mm
            From the camera, along the direction in which it looks, mm.

        Returns
        -------
        float
            px

        Examples
        --------
        >>> import omnimirror as om
        >>> wall = pinhole_of(om.load_sensor("paper-spherical"), Plane((640, 480), distance_mm=1000.0))
        >>> f"{wall.error_px(1000.0):.3f} {wall.error_px(5000.0):.1f}"  # on the wall, and far behind it
        '0.000 4.9'
        """
        pixels, origins, directions = self.rays
        start, towards = ((vectors @ self.rotation) for vectors in (origins - self.position_mm, directions))
        reach = (distance_mm - start[:, 2]) / towards[:, 2]
        seen = (start + reach[:, None] * towards) @ self.matrix.T / distance_mm
        return float(np.linalg.norm(seen[:, :2] - pixels, axis=1).max())


def pinhole_of(camera: Camera, view: Plane, viewpoint: Viewpoint = "exact") -> Pinhole:
    """The pinhole camera that comes nearest to a perspective view.

    Parameters
    ----------
    camera
        Which draws the view.
    view
        Distant, or at a distance.
    viewpoint
        From where the view is seen; as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    Pinhole
        Of a view at a distance, at the place from which it was asked for; of a distant one, where the sum of the
        squared distances from its rays is least.

    Raises
    ------
    OutsideField
        Nothing of the view is in the camera's field.

    Examples
    --------
    >>> import omnimirror as om
    >>> pinhole = pinhole_of(om.load_sensor("paper-spherical"), Plane((640, 480)))
    >>> pinhole.matrix[0], np.abs(pinhole.position_mm).round(1)  # inside the mirror
    (array([320. ,   0. , 319.5]), array([ 6. ,  0. , 10.1]))
    """
    width, height = view.size
    forward, right, down = view_axes(view.pan_deg, view.tilt_deg, view.roll_deg)
    focal = view.focal_px
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    rays = view_rays(camera, view, viewpoint)
    position = nearest_point(*rays[1:]) if view.is_distant else np.array(view.offset_mm)
    return Pinhole(view.size, matrix, np.stack([right, down, forward], axis=1), position, rays)


def view_rays(camera: Camera, view: Screen, viewpoint: Viewpoint = "exact") -> tuple[Array, Array, Array]:
    """Pixels all over a view, as far as they are seen, and their rays; see :class:`Pinhole`."""
    width, height = view.size
    u, v = (side.ravel() for side in np.meshgrid(*(np.linspace(0, n - 1, SAMPLES) for n in (width, height))))
    seen = projection_of(camera, view, viewpoint)(view.targets_at(u, v))
    rays = camera.backproject(seen.pixels)
    if not rays.valid.any():
        raise OutsideField(f"the {view} sees nothing of the camera's field")
    return np.stack([u, v], axis=1)[rays.valid], rays.origins[rays.valid], rays.directions[rays.valid]


def nearest_point(origins: Array, directions: Array) -> Array:
    """The point (3,) with the least sum of squared distances from lines."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # projections onto what is across each line
    a, b = across.sum(axis=0), np.einsum("nij,nj->i", across, origins)
    point: Array = np.linalg.lstsq(a, b, rcond=None)[0]
    return point
