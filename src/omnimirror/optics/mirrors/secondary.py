"""A second mirror between the curved one and the lens: its shape and its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from .base import Array, Mirror


@dataclass(frozen=True)
class Secondary:
    """A mirror that faces the primary one and sends its light back to a camera behind it or before it.

    Parameters
    ----------
    mirror
        Its shape, as the camera sees it: convex towards the camera where the sag grows outwards, concave
        where it falls, flat where it does not change. Its rim hides the middle of the field.
    distance_mm : mm
        From the vertex of the primary to its own (s). The lens stands ``m - s`` from it, back towards the
        primary, where m is the way from lens to primary by way of the secondary.
    bore_radius_mm : mm
        Radius of the hole in the primary through which the camera looks; where the lens stands before
        the primary, radius of the camera's front.

    Raises
    ------
    InvalidParameter
        A place or a bore outside its range.

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
        """Height z (mm) of the lens over the primary's vertex, for a way m from lens to primary."""
        return mirror_distance_mm - 2 * self.distance_mm

    def height(self, x_mm: Array) -> Array:
        """Height z (mm) of its surface over the primary's vertex, at distances x from the axis (n,)."""
        return -self.distance_mm - self.mirror.sag(x_mm)

    def check_before(self, primary: Mirror, mirror_distance_mm: float) -> None:
        """Raise InvalidParameter unless it stands between the lens and the primary without touching that."""
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
