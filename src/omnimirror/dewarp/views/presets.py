"""Placements of the virtual screen in the paper (Fig. 13)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arguments import checked
from ...base.errors import InvalidParameter
from ..screens import (
    Cylinder,
    Plane,
)
from ..screens.base import NOT_MOVED, Offset
from .makers import PERSPECTIVE_SIZE
from .sizes import UNKNOWN_SIZE, PartialSize, completed


class Preset(NamedTuple):
    """Placement of the virtual screen of the paper in front of the virtual projector (Fig. 13)."""

    widths_away: float
    """Distance of the screen from the projector in screen widths."""
    is_bent: bool
    """True for a screen bent about the projector, False for a flat one."""
    description: str


PRESETS: dict[str, Preset] = {
    "distant": Preset(2.0, False, "flat, two widths away: 28 deg wide, as through a telephoto lens"),
    "wide": Preset(0.5, False, "the same screen moved up to half a width: 90 deg wide, still in perspective"),
    "super-wide": Preset(1 / np.pi, True, "the same screen bent half round the projector: 180 deg wide"),
}
"""Distant, wide-angle and super-wide-angle views of the paper: one screen at three positions.

The screen keeps its size and aspect; it is moved towards the projector, and then bent about it,
because a flat screen cannot cover 180 deg. On the bent screen, columns are linear in pan and rows
in height.
"""


@checked
def preset(
    name: str,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Plane | Cylinder:
    """Create one of the views of :data:`PRESETS`; a bent screen is moved up instead of tilted.

    Parameters
    ----------
    name
        Name in :data:`PRESETS`.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    tilt_deg
        Direction of the image centre, deg above the horizon.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane or Cylinder
        Screen.

    Raises
    ------
    InvalidParameter
        If the name is unknown, or the screen would reach the zenith.

    Examples
    --------
    >>> for name in PRESETS:
    ...     print(preset(name))
    perspective view (pan 0, tilt 0, hfov 28.0725 deg)
    perspective view (pan 0, tilt 0, hfov 90 deg)
    panorama (180 deg around pan 0, elevation -41.4629 to 41.4629 deg)
    """
    if name not in PRESETS:
        raise InvalidParameter(f"there is no preset {name!r}; there are {', '.join(PRESETS)}")
    away, is_bent, _ = PRESETS[name]
    width, height = completed(size, PERSPECTIVE_SIZE)
    if not is_bent:
        hfov = float(2 * np.degrees(np.arctan(0.5 / away)))
        return Plane((width, height), pan_deg, tilt_deg, 0.0, hfov, distance_mm, offset_mm)
    end = float(np.degrees(np.arctan(height / width / 2 / away)))
    around = float(np.degrees(1 / away))
    bent = Cylinder((width, height), -end, end, pan_deg, around, "height", distance_mm, offset_mm)
    return bent.panned(0.0, tilt_deg)
