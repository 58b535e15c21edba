"""A fixed view of a camera as a map, as other programs take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arguments import instance
from ...cameras import Camera
from ...dewarp import Dewarper
from ...dewarp.screens import View
from ...dewarp.viewpoints import Viewpoint
from ...errors import InvalidParameter
from ...numerics.lazy import cached_property
from .bending import bent_pixels

Array = NDArray[np.float64]

LARGEST_PX = 65534


@dataclass(frozen=True, eq=False)
class ViewMap:
    """Where each pixel of a view lies in a camera's picture, and where each of the picture lies in the view.

    Attributes
    ----------
    camera, view, viewpoint
        As :class:`omnimirror.Dewarper` takes them.
    name
        Of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> ahead = om.view_map(sensor, om.screens.Plane((320, 240), hfov_deg=80.0))
    >>> ahead.straighten.shape, ahead.straighten[120, 160].round(1)
    ((240, 320, 2), array([510.5, 115.9]))
    >>> ahead.bend[116, 510].round(1)  # back again
    array([160.2, 120.1])
    """

    camera: Camera
    view: View
    viewpoint: Viewpoint = "exact"
    name: str = "camera"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the view, px."""
        return self.view.size

    @property
    def source_size(self) -> tuple[int, int]:
        """(width, height) of the camera's pictures, px."""
        return self.camera.image_size

    @property
    def sizes(self) -> str:
        """Those of view and picture, for people."""
        return "{} x {} px of {} x {}".format(*self.size, *self.source_size)

    @property
    def words(self) -> dict[str, object]:
        """What every script is filled with."""
        (width, height), (source_width, source_height) = self.size, self.source_size
        return {
            "camera": self.name, "view": self.view, "width": width, "height": height,
            "source_width": source_width, "source_height": source_height,
        }  # fmt: skip

    @cached_property
    def straighten(self) -> Array:
        """(height, width, 2): where in the picture each pixel of the view lies, (u, v) px; NaN outside the field."""
        return Dewarper(self.camera, self.view, viewpoint=self.viewpoint).coordinates()

    @cached_property
    def bend(self) -> Array:
        """(height, width, 2): where in the view each pixel of the picture lies, px; NaN where that does not show it."""
        return bent_pixels(self.camera, self.view, self.viewpoint)


def check_small(size: tuple[int, int], what: str) -> None:
    """Refuse pictures and views in which 16 bits do not count places, with a number left for nowhere."""
    if max(size) > LARGEST_PX:
        raise InvalidParameter(f"{what} of {max(size)} px are too large; valid are up to {LARGEST_PX} px")


def view_map(camera: Camera, view: View, viewpoint: Viewpoint = "exact") -> ViewMap:
    """The map of a fixed view, for programs that remap pictures by themselves.

    Parameters
    ----------
    camera
        A sensor, aligned or not, or a calibrated camera.
    view
        A screen of :mod:`omnimirror.screens`, or a view of :mod:`omnimirror.views`.
    viewpoint
        As for :class:`omnimirror.Dewarper`.

    Returns
    -------
    ViewMap
        Both ways; each is worked out when it is asked for.

    Raises
    ------
    InvalidParameter
        What is no camera, no view or no viewpoint.
    OutsideField
        The view sees nothing of the camera's field.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> around = om.view_map(sensor, om.views.panorama(sensor, (720, None)))
    >>> around.size, f"{np.isfinite(around.straighten).all(-1).mean():.3f}"
    ((720, 270), '1.000')
    """
    instance("camera", camera, Camera, "a camera, such as om.load_sensor gives")
    Dewarper(camera, view, viewpoint=viewpoint)  # says what is wrong with view or viewpoint
    found = ViewMap(camera, view, viewpoint, getattr(camera, "name", "camera"))
    found.straighten  # noqa: B018 - a view that sees nothing is refused now
    return found
