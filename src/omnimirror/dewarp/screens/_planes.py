"""Plane screens: the perspective view, and the ground from above."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import positions, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import view_axes
from ._screen import (
    NO_OFFSET,
    CentredScreen,
    Offset,
    check_angle,
    check_no_tilt,
    check_offset,
    check_range,
    check_size,
    check_zoom,
    offset_text,
    on_plane,
    pixels_of_rows,
)


@dataclass(frozen=True)
class Plane(CentredScreen):
    """Perspective view: the image of an ideal camera without distortion.

    Parameters
    ----------
    size : (width, height)
    pan_deg, tilt_deg : deg
        Direction of the image centre, right of forward and above the horizon.
    roll_deg : deg
        Clockwise rotation of the view about its centre.
    hfov_deg : deg
        Angle from the left edge to the right edge, between 0 and 180.
    distance_mm : mm
        Distance of the plane from its viewpoint, along the viewing direction.
    offset_mm : (x, y, z) mm
        Position of the viewpoint relative to the mirror vertex, in the world frame; for a finite
        plane only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a view.

    Examples
    --------
    >>> view = Plane((3, 3), hfov_deg=90.0)
    >>> view.targets(1, 2)[0, 1] + 0.0  # the centre looks forward
    array([1., 0., 0.])

    A wall at 2 m, with 3 m across 300 pixels:

    >>> wall = Plane((300, 200), hfov_deg=np.degrees(2 * np.arctan(1.5 / 2)), distance_mm=2000.0)
    >>> wall.targets(0, 1)[0, 0]
    array([2000., 1495.,  995.])
    """

    size: tuple[int, int]
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check_placement()
        for name in ("pan_deg", "tilt_deg", "roll_deg"):
            check_angle(name, getattr(self, name))
        check_range("hfov_deg", self.hfov_deg, 0, 180, upper_included=False)

    @property
    def focal_px(self) -> float:
        """Distance of the plane from the viewpoint in pixels."""
        return float(self.size[0] / 2 / np.tan(np.radians(self.hfov_deg / 2)))

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return vectors (..., 3), of length 1 at the centre."""
        width, height = self.size
        forward, right, down = view_axes(self.pan_deg, self.tilt_deg, self.roll_deg)
        x = (positions("u", u) - (width - 1) / 2) / self.focal_px
        y = (positions("v", v) - (height - 1) / 2) / self.focal_px
        return on_plane(forward, x, right, y, down)

    def zoomed(self, factor: float) -> Self:
        """Return the view with its focal length multiplied by a factor."""
        check_zoom(factor)
        return replace(
            self,
            hfov_deg=float(
                2 * np.degrees(np.arctan(np.tan(np.radians(self.hfov_deg / 2)) / factor))
            ),
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the view rotated to the right and up."""
        return replace(self, pan_deg=self.pan_deg + pan_deg, tilt_deg=self.tilt_deg + tilt_deg)

    def __str__(self) -> str:
        roll = f", roll {self.roll_deg:g}" if self.roll_deg else ""
        text = f"pan {self.pan_deg:g}, tilt {self.tilt_deg:g}{roll}, hfov {self.hfov_deg:.6g} deg"
        return f"perspective view ({text}{self._placement})"


@dataclass(frozen=True)
class Ground:
    """Horizontal plane drawn to scale from above: a floor plan.

    A plane over the mirror, such as a ceiling, is also drawn from above, as if through the roof,
    aligned with the plan of the floor.

    Parameters
    ----------
    size : (width, height)
    height_mm : mm
        Height of the mirror vertex over the plane; negative for a plane over the mirror.
    mm_per_px : mm
        Scale of the plan.
    pan_deg : deg
        Direction at the top, right of forward.
    offset_mm : (x, y, z) mm
        Offset of the centre of the plan from the point below the mirror, in the world frame.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a plane.

    Examples
    --------
    >>> Ground((3, 3), height_mm=1200.0, mm_per_px=100.0).targets(0, 1)[0] + 0.0  # forward, from left to right
    array([[  100.,   100., -1200.],
           [  100.,     0., -1200.],
           [  100.,  -100., -1200.]])
    """

    size: tuple[int, int]
    height_mm: float
    mm_per_px: float
    pan_deg: float = 0.0
    offset_mm: Offset = NO_OFFSET
    is_distant = False

    def __post_init__(self) -> None:
        check_size(self.size)
        check_offset(self.offset_mm)
        check_angle("pan_deg", self.pan_deg)
        if not np.isfinite(self.height_mm):
            raise InvalidParameter(f"height_mm must be finite; got {self.height_mm:g}")
        if not (np.isfinite(self.mm_per_px) and self.mm_per_px > 0):
            raise InvalidParameter(f"mm_per_px must be finite and above 0; got {self.mm_per_px:g}")

    @validate_arguments
    def targets(self, first_row: int, last_row: int) -> Array:
        """Return points (rows, width, 3) in mm."""
        return self.targets_at(*pixels_of_rows(self.size, first_row, last_row))

    def targets_at(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return points (..., 3) in mm at columns u and rows v, which may be fractional."""
        width, height = self.size
        _, right, down = view_axes(self.pan_deg, -90.0)
        x = (positions("u", u) - (width - 1) / 2) * self.mm_per_px
        y = (positions("v", v) - (height - 1) / 2) * self.mm_per_px
        centre = np.add(self.offset_mm, (0.0, 0.0, -self.height_mm))
        return on_plane(centre, x, right, y, down)

    def zoomed(self, factor: float) -> Self:
        """Return the plan with its scale divided by a factor."""
        check_zoom(factor)
        return replace(self, mm_per_px=self.mm_per_px / factor)

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated with a direction farther to the right at the top."""
        check_no_tilt(self, tilt_deg)
        return replace(self, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        turned = f", pan {self.pan_deg:g} deg" if self.pan_deg else ""
        side = "below" if self.height_mm >= 0 else "above"
        return (
            f"plan of the ground ({abs(self.height_mm):g} mm {side} the mirror, "
            f"{self.mm_per_px:.4g} mm per pixel{turned}{offset_text(self.offset_mm)})"
        )
