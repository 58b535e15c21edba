"""Maps between a fixed view and the source image of a camera, in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.arguments import instance
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, pixel_grid
from ...base.typing import Array
from ...cameras.camera import Camera
from ...dewarp import Dewarper
from ...dewarp.screens import View
from ...dewarp.view_geometry import Viewpoint
from ._inverse_mapping import view_pixels

MAX_SIDE_PX = 65534
"""Maximum image side of formats with 16-bit coordinates; 65535 marks missing pixels."""


@dataclass(frozen=True, eq=False, repr=False)
class ViewMap(Result):
    """Map between the pixels of a view and the pixels of the source image.

    Attributes
    ----------
    camera, view, viewpoint
        Camera, view and viewpoint mode, as for :class:`omnimirror.Dewarper`.
    name
        Name of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> ahead = om.view_map(sensor, om.screens.Plane((320, 240), hfov_deg=80.0))
    >>> ahead.dewarp_map.shape, ahead.dewarp_map[120, 160].round(1)
    ((240, 320, 2), array([510.5, 115.9]))
    >>> ahead.warp_map[116, 510].round(1)  # inverse
    array([160.2, 120.1])
    """

    camera: Camera
    view: View
    viewpoint: Viewpoint = "exact"
    name: str = "camera"

    def _table(self) -> Columns:
        width, height = self.size
        view = {f"view_{k}": v for k, v in pixel_grid(np.arange(width), np.arange(height)).items()}
        u, v = self.dewarp_map.reshape(-1, 2).T
        return {**view, "source_u_px": u, "source_v_px": v}

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the view, px."""
        return self.view.size

    @property
    def source_size(self) -> tuple[int, int]:
        """(width, height) of the source image, px."""
        return self.camera.image_size

    @property
    def sizes(self) -> str:
        """Sizes of the view and the source image as text."""
        return "{} x {} px of {} x {}".format(*self.size, *self.source_size)

    @property
    def template_values(self) -> dict[str, object]:
        """Values common to all script templates."""
        (width, height), (source_width, source_height) = self.size, self.source_size
        return {
            "camera": self.name,
            "view": self.view,
            "width": width,
            "height": height,
            "source_width": source_width,
            "source_height": source_height,
        }

    @cached_property
    def dewarp_map(self) -> Array:
        """(height, width, 2) source pixel (u, v) of each pixel of the view; NaN outside the
        field."""
        return Dewarper(self.camera, self.view, viewpoint=self.viewpoint).coordinates()

    @property
    def border_clamped_dewarp_map(self) -> Array:
        """:attr:`dewarp_map` with coordinates clamped to the centres of the border pixels.

        Bilinear sampling at clamped coordinates equals the replication of border pixels in
        :class:`omnimirror.Dewarper`, also in programs that continue images with a constant.
        """
        return np.clip(self.dewarp_map, 0.0, np.array(self.source_size) - 1.0)

    @cached_property
    def warp_map(self) -> Array:
        """(height, width, 2) pixel (u, v) of the view of each source pixel; NaN outside the
        view."""
        return view_pixels(self.camera, self.view, self.viewpoint)

    def __repr__(self) -> str:
        return f"ViewMap({self.name}, {self.view}, {self.sizes})"


def check_16_bit_size(size: tuple[int, int], name: str) -> None:
    """Raise InvalidParameter if 16-bit coordinates cannot represent all pixels of an image."""
    if max(size) > MAX_SIDE_PX:
        raise InvalidParameter(
            f"the sides of the {name} must be at most {MAX_SIDE_PX} px; got {max(size)} px"
        )


def view_map(camera: Camera, view: View, viewpoint: Viewpoint = "exact") -> ViewMap:
    """Return the map of a fixed view for programs that resample images themselves.

    Parameters
    ----------
    camera
        Sensor, aligned or misaligned, or calibrated camera.
    view
        Screen of :mod:`omnimirror.screens` or view of :mod:`omnimirror.views`.
    viewpoint
        Viewpoint mode, as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    ViewMap
        Maps in both directions, computed on first access.

    Raises
    ------
    InvalidParameter
        If the camera, view or viewpoint is invalid.
    OutsideField
        If no pixel of the view is inside the field of the camera.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> panorama = om.view_map(sensor, om.views.panorama(sensor, (720, None)))
    >>> panorama.size, f"{np.isfinite(panorama.dewarp_map).all(-1).mean():.3f}"
    ((720, 270), '1.000')
    """
    instance("camera", camera, Camera, "a camera (see om.load_sensor)")
    Dewarper(camera, view, viewpoint=viewpoint)  # validates view and viewpoint
    mapping = ViewMap(camera, view, viewpoint, getattr(camera, "name", "camera"))
    mapping.dewarp_map  # noqa: B018 - raises OutsideField now rather than on first access
    return mapping
