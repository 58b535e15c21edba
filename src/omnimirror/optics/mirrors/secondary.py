"""Secondary mirror between primary mirror and lens: shape and position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import Mirror


@dataclass(frozen=True)
class Secondary:
    """Mirror that faces the primary and reflects its light to the camera.

    Parameters
    ----------
    mirror
        Shape as seen from the camera: convex for a sag increasing outwards, concave for a
        decreasing one, or flat. Its rim obscures the centre of the field.
    distance_mm : mm
        Distance s from the vertex of the primary to that of the secondary. The lens is at ``m - s``
        from the secondary, towards the primary; m is the path from lens to primary over the
        secondary.
    bore_radius_mm : mm
        Radius of the bore in the primary for the camera; for a lens in front of the primary, radius
        of the camera's front.

    Raises
    ------
    InvalidParameter
        If the position or the bore is outside its range.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Flat
    >>> Secondary(Flat(22.0), distance_mm=90.0, bore_radius_mm=5.0).lens_height(180.0)
    0.0
    """

    mirror: Mirror
    distance_mm: float
    bore_radius_mm: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "distance_mm": Parameter("mm", 1e-3, 1e7, "from the primary's vertex to the secondary's (s)"),
        "bore_radius_mm": Parameter("mm", 0.0, 1e5, "radius of the bore in the primary, or of the camera's front"),
    }

    def __post_init__(self) -> None:
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))

    def lens_height(self, mirror_distance_mm: float) -> float:
        """Return the height z (mm) of the lens above the primary's vertex."""
        return mirror_distance_mm - 2 * self.distance_mm

    def height(self, x_mm: Array) -> Array:
        """Return heights z (mm) above the primary's vertex, at distances x (n,)."""
        return -self.distance_mm - self.mirror.sag(x_mm)

    def check_before(self, primary: Mirror, mirror_distance_mm: float) -> None:
        """Check that the secondary is between lens and primary without contact to the primary."""
        if not self.distance_mm < mirror_distance_mm:
            raise InvalidParameter(
                f"distance_mm = {self.distance_mm:g} puts the secondary behind the lens; it is valid below "
                f"mirror_distance_mm = {mirror_distance_mm:g}, the way from lens to primary by way of the secondary"
            )
        x = np.linspace(0.0, min(primary.rim_radius_mm, self.mirror.rim_radius_mm), 513)
        gap = primary.sag(x) - self.height(x)
        if not (gap > 0).all():
            raise InvalidParameter(
                f"distance_mm = {self.distance_mm:g} lets both mirrors touch; it is valid above "
                f"{self.distance_mm - gap.min():.6g}"
            )
