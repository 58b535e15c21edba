"""The paper's placings of the virtual screen (Fig. 13)."""

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
    """A placing of the paper's virtual screen before the virtual projector (Fig. 13)."""

    widths_away: float
    """Distance of the screen from the projector, in widths of the screen."""
    is_bent: bool
    """Whether it is bent about the projector, or flat."""
    description: str


PRESETS: dict[str, Preset] = {
    "distant": Preset(2.0, False, "flat, two widths away: 28 deg wide, as through a telephoto lens"),
    "wide": Preset(0.5, False, "the same screen moved up to half a width: 90 deg wide, still in perspective"),
    "super-wide": Preset(1 / np.pi, True, "the same screen bent half round the projector: 180 deg wide"),
}
"""The paper's distant, wide-angle and super-wide-angle views: one screen, three places.

The screen keeps its size and proportions; it is moved towards the projector, and then bent about it,
since a flat screen never reaches 180 deg. Bent, its columns are linear in pan and its rows in height.
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
    """One of the paper's effects, of :data:`PRESETS`; a bent screen is not tilted but moved up.

    Parameters
    ----------
    name
        One of :data:`PRESETS`.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    tilt_deg
        Where the middle looks, deg above the horizon.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane or Cylinder
        The screen.

    Raises
    ------
    InvalidParameter
        For an unknown name, or a screen that would reach the zenith.

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
