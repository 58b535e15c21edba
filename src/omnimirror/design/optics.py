"""The optics of a mirror point in closed form, for arrays of any shape and for complex steps.

The same equations as :mod:`omnimirror.tracing` and :mod:`omnimirror.analysis`, written so that nothing
but sums, products, roots and one kind of arctangent occurs. Two things need that: an optimiser takes
exact derivatives by adding an imaginary step to an input, and blocks of thousands of designs are quick.
On the axis no limit has to be taken: z'/x stands for itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lenses import BlurMode

Array = NDArray[Any]
"""Real numbers, or complex ones while derivatives are taken."""

DEGREE = np.pi / 180


class NodeOptics(NamedTuple):
    """What a mirror point does, whatever the camera; arrays of the shape of x, lengths in mm, radians."""

    omega: Array
    """Field angle (Eq. 4)."""
    tangent: Array
    """tan(theta) of the lens's viewing angle (Eq. 5)."""
    radial: Array
    """d tan(theta) / d Omega: Dh per radian and unit of tan(theta) (Eqs. 8, 9)."""
    around: Array
    """tan(theta) / sin(Omega): Dw in the same units (Eq. 10)."""
    near_t: Array
    """1/L_t (Eq. 34)."""
    near_s: Array
    """1/L_s (Eq. 35)."""
    viewpoint_z: Array
    """Where the chief ray meets the axis (Eq. 6)."""
    turning: Array
    """dOmega/dx, 1/mm; above 0 where the mapping is one to one."""
    facing: Array
    """w - x z', mm; above 0 where the lens sees the mirror's front."""


def node_optics(
    x: Array, z: Array, slope: Array, curvature: Array, slope_over_x: Array, m: Array, inverse_distance: float = 0.0
) -> NodeOptics:
    """The optics of mirror points seen by a perspective lens at distance m from the vertex.

    Parameters
    ----------
    slope_over_x
        z'/x, and on the axis its limit z''.
    inverse_distance : 1/mm
        1/p of the object; 0 for one at infinity.
    """
    w = m + z
    steep = 1 + slope * slope
    root = np.sqrt(steep)
    to_lens = w * w + x * x
    rho = np.sqrt(to_lens)
    facing = w - x * slope
    cos_gamma = facing / (root * rho)
    sine = 2 * w * slope_over_x + 1 - slope * slope  # sin(Omega) steep rho / x
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + inverse_distance)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + inverse_distance)
    turning = 2 * curvature / steep + facing / to_lens
    return NodeOptics(
        omega=2 * np.arctan(slope) + np.arctan(x / w),
        tangent=x / w,
        radial=facing / (w * w * turning),
        around=rho * steep / (w * sine),
        near_t=1 / (w * (1 + q_t / rho)),
        near_s=1 / (w * (1 + q_s / rho)),
        viewpoint_z=z + (w * (1 - slope * slope) - 2 * slope * x) / sine,
        turning=turning,
        facing=facing,
    )


@dataclass(frozen=True)
class Camera:
    """A perspective lens and its pixels, as functions of the vergence v = 1/L0 (1/mm) that it is focused at.

    Attributes
    ----------
    focal_length_mm, f_number, rim_tangent
        Numbers, or arrays with one entry per design; ``rim_tangent`` is tan(Theta).
    image_radius_px
        Scales the image so that the rim has this radius; None for the real one.
    """

    focal_length_mm: Any
    f_number: Any
    rim_tangent: Any
    pitch_mm: float
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        """b0, mm (Eq. 25)."""
        b: Array = 1 / (1 / self.focal_length_mm - v)
        return b

    def px_per_tangent(self, v: Array) -> Array:
        """Image height over tan(theta), px (Eq. 7)."""
        if self.image_radius_px is None:
            return self.image_distance(v) / self.pitch_mm
        scaled: Array = self.image_radius_px / self.rim_tangent + 0 * v
        return scaled

    def px_per_vergence(self, v: Array) -> Array:
        """Blur over (1/L0 - 1/L), px mm (Eqs. 28, 29)."""
        b = self.image_distance(v) if self.mode == "exact" else self.focal_length_mm + 0 * v
        blur: Array = self.focal_length_mm * b / (self.f_number * self.pitch_mm)
        return blur

    def airy_px(self, v: Array) -> Array:
        """Diameter of the Airy disk, px."""
        working = self.f_number * self.image_distance(v) / self.focal_length_mm
        airy: Array = 2.44e-6 * self.wavelength_nm * working / self.pitch_mm
        return airy
