"""Closed-form optics of mirror points, for arrays of any shape and for complex steps.

The equations are those of :mod:`omnimirror.optics.tracing` and :mod:`omnimirror.analysis`,
restricted to sums, products, roots and one form of arctangent. This allows exact complex-step
derivatives in optimisation, and fast evaluation in blocks of thousands of designs. The quotient
z'/x is an input: no limit is required on the axis.

Both kinds of lens share the equations. The *vergence* of an image is the coordinate in which blur
is linear: 1/L for a perspective lens (Eq. 28 is ``(f b0/F)(1/L0 - 1/L)``), and -L for a telecentric
one, whose blur is ``mu^2 (L - L0)/F_w``. The *ray coordinate* is proportional to the image height:
tan(theta) (Eq. 7), or x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..lenses import BlurMode

Array = NDArray[Any]
"""Real numbers, or complex ones for derivatives."""

DEGREE = np.pi / 180


class NodeOptics(NamedTuple):
    """Camera-independent optics of mirror points; arrays like x, in mm and radians."""

    omega: Array
    """Field angle (Eq. 4)."""
    ray: Array
    """tan(theta) of the lens's viewing angle (Eq. 5); x for a telecentric lens."""
    magnification_t: Array
    """Tangential angular magnification: d ray per radian of object as seen from the mirror point.

    It gives Dh per radian and unit of the ray coordinate (Eqs. 8, 9), at the object distance.
    """
    magnification_s: Array
    """Sagittal angular magnification ray / (sin(Omega) + x/p): Dw in the same units (Eq. 10)."""
    vergence_t: Array
    """1/L_t (Eq. 34); -L_t for a telecentric lens."""
    vergence_s: Array
    """1/L_s (Eq. 35); -L_s for a telecentric lens."""
    viewpoint_z: Array
    """Intersection of the chief ray with the axis (Eq. 6)."""
    domega_dx: Array
    """dOmega/dx, 1/mm (Eq. 8); positive for a one-to-one mapping."""
    cos_incidence: Array
    """Cosine of the angle of incidence gamma (Eq. 3); positive on the front of the mirror."""
    seen: Any = True
    """False for points obscured by the base of a tube in another medium."""
    near: Any = 0.0
    """1/distance of the objects from the mirror points, 1/mm."""


class Look(NamedTuple):
    """Images of mirror points by a focused camera; arrays (.., k), or (.., 1) if constant."""

    t_px: Array
    """Signed tangential blur (Eq. 28)."""
    s_px: Array
    dh: Array
    """px per degree in the radial direction (Eq. 9)."""
    dw: Array
    """px per degree in the tangential direction (Eq. 10)."""
    airy_px: Array
    own_t_px: Array
    """Blur of the lens itself; 0 for an ideal one."""
    own_s_px: Array
    light: Array
    """Relative illumination of the imager by the lens."""


def node_optics(
    x: Array, z: Array, slope: Array, curvature: Array, slope_over_x: Array, m: Array, inverse_distance: Any = 0.0
) -> NodeOptics:
    """Compute the optics of mirror points for a perspective lens at distance m from the vertex.

    Parameters
    ----------
    slope_over_x
        z'/x, with the limit z'' on the axis.
    inverse_distance : 1/mm
        1/p of the object, 0 at infinity; or a function of x, z and field angle (radians) that
        returns it.
    """
    w = m + z
    steep = 1 + slope * slope
    root = np.sqrt(steep)
    to_lens = w * w + x * x
    rho = np.sqrt(to_lens)
    front = w - x * slope
    cos_gamma = front / (root * rho)
    sine = 2 * w * slope_over_x + 1 - slope * slope  # sin(Omega) steep rho / x
    omega = 2 * np.arctan(slope) + np.arctan(x / w)
    near = inverse_distance(x, z, omega) if callable(inverse_distance) else inverse_distance
    # Coddington's mirror equations (Eqs. 14, 18):
    # 1/q_t = 2/(R_t cos(gamma)) + 1/p, 1/q_s = 2 cos(gamma)/R_s + 1/p
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + near)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + near)
    # dOmega/dx = 2 dbeta/dx + dtheta/dx (Eq. 8)
    domega_dx = 2 * curvature / steep + front / to_lens
    return NodeOptics(
        omega=omega,
        ray=x / w,
        # object motion across the ray: p domega_dx + cos(gamma)/cos(beta);
        # around the axis: x + p sin(Omega)
        magnification_t=front / (w * w * (domega_dx + near * front / rho)),
        magnification_s=rho * steep / (w * (sine + near * rho * steep)),
        vergence_t=1 / (w * (1 + q_t / rho)),
        vergence_s=1 / (w * (1 + q_s / rho)),
        viewpoint_z=z + (w * (1 - slope * slope) - 2 * slope * x) / sine,
        domega_dx=domega_dx,
        cos_incidence=cos_gamma,
        near=near,
    )


def telecentric_optics(
    x: Array, z: Array, slope: Array, curvature: Array, slope_over_x: Array, inverse_distance: Any = 0.0
) -> NodeOptics:
    """Compute the optics as :func:`node_optics` for a telecentric lens."""
    steep = 1 + slope * slope
    domega_dx = 2 * curvature / steep
    omega = 2 * np.arctan(slope)
    near = inverse_distance(x, z, omega) if callable(inverse_distance) else inverse_distance
    return NodeOptics(
        omega=omega,
        ray=x + 0 * slope,
        magnification_t=1 / (domega_dx + near),
        magnification_s=1 / (2 * slope_over_x / steep + near),
        vergence_t=-(z + 1 / (domega_dx + near)),
        vergence_s=-(z + 1 / (2 * slope_over_x / steep + near)),
        viewpoint_z=z + (1 - slope * slope) / (2 * slope_over_x),
        domega_dx=domega_dx,
        cos_incidence=1 / np.sqrt(steep),
        near=near,
    )


class FocusedCamera(Protocol):
    """Lens and pixels as functions of the vergence v in focus."""

    def image_distance(self, v: Array) -> Array:
        """Return the distance from lens to imager, mm; 0 for a telecentric lens."""
        ...

    def height_px(self, ray: Array, v: Array) -> Array:
        """Compute image heights of ray coordinates, px (Eq. 7)."""
        ...

    def at(self, o: NodeOptics, v: Array) -> Look:
        """Compute the images of mirror points (.., k) at focus vergences (.., 1)."""
        ...

    def focus_mm(self, v: float) -> float:
        """Return the object distance in focus at a vergence."""
        ...

    def vergence(self, focus_mm: float) -> float:
        """Return the vergence of an object distance in focus."""
        ...

    def airy_px(self, v: Array) -> Array:
        """Compute the diameter of the Airy disk, px."""
        ...


class IdealCamera:
    """Base class of ideal cameras: uniform scales of image and blur over the field."""

    def px_per_ray(self, v: Array) -> Array:
        """Compute the image height per unit of the ray coordinate, px (Eq. 7)."""
        raise NotImplementedError

    def px_per_vergence(self, v: Array) -> Array:
        """Compute the blur per difference of vergences, px (Eqs. 28, 29)."""
        raise NotImplementedError

    def airy_px(self, v: Array) -> Array:
        raise NotImplementedError

    def light(self, ray: Array) -> Array:
        """Compute the natural falloff of rays, cos^4."""
        raise NotImplementedError

    def height_px(self, ray: Array, v: Array) -> Array:
        height: Array = ray * self.px_per_ray(v)
        return height

    def at(self, o: NodeOptics, v: Array) -> Look:
        ray_px, blur_px, none = self.px_per_ray(v), self.px_per_vergence(v), 0 * v
        return Look(
            blur_px * (v - o.vergence_t), blur_px * (v - o.vergence_s), o.magnification_t * ray_px * DEGREE,
            o.magnification_s * ray_px * DEGREE, self.airy_px(v), none, none, self.light(o.ray),
        )  # fmt: skip


@dataclass(frozen=True)
class PerspectiveCamera(IdealCamera):
    """Perspective lens and pixels; vergences are v = 1/L0 (1/mm).

    Attributes
    ----------
    focal_length_mm, f_number, rim_ray
        Numbers, or arrays with one entry per design; ``rim_ray`` is tan(Theta).
    image_radius_px
        Scales the image to this rim radius; None for the actual radius.
    """

    focal_length_mm: Any
    f_number: Any
    rim_ray: Any
    pitch_mm: float
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        b: Array = 1 / (1 / self.focal_length_mm - v)  # b0, Eq. 25
        return b

    def px_per_ray(self, v: Array) -> Array:
        if self.image_radius_px is None:
            return self.image_distance(v) / self.pitch_mm
        scaled: Array = self.image_radius_px / self.rim_ray + 0 * v
        return scaled

    def px_per_vergence(self, v: Array) -> Array:
        b = self.image_distance(v) if self.mode == "exact" else self.focal_length_mm + 0 * v
        blur: Array = self.focal_length_mm * b / (self.f_number * self.pitch_mm)
        return blur

    def airy_px(self, v: Array) -> Array:
        working = self.f_number * self.image_distance(v) / self.focal_length_mm
        airy: Array = 2.44e-6 * self.wavelength_nm * working / self.pitch_mm
        return airy

    def light(self, ray: Array) -> Array:
        return light_of(ray)

    def focus_mm(self, v: float) -> float:
        return 1 / v

    def vergence(self, focus_mm: float) -> float:
        return 1 / focus_mm


@dataclass(frozen=True)
class TelecentricCamera(IdealCamera):
    """Telecentric lens and pixels; vergences are replaced by -L0 (mm), L0 from the mirror vertex.

    Attributes
    ----------
    magnification, f_number, rim_ray
        Numbers, or arrays with one entry per design; image-side F-number; ``rim_ray`` is the rim
        radius.
    """

    magnification: Any
    f_number: Any
    rim_ray: Any
    pitch_mm: float
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        return 0 * v

    def px_per_ray(self, v: Array) -> Array:
        if self.image_radius_px is None:
            plain: Array = self.magnification / self.pitch_mm + 0 * v
            return plain
        scaled: Array = self.image_radius_px / self.rim_ray + 0 * v
        return scaled

    def px_per_vergence(self, v: Array) -> Array:
        blur: Array = self.magnification**2 / (self.f_number * self.pitch_mm) + 0 * v
        return blur

    def airy_px(self, v: Array) -> Array:
        airy: Array = 2.44e-6 * self.wavelength_nm * self.f_number / self.pitch_mm + 0 * v
        return airy

    def light(self, ray: Array) -> Array:
        return light_of(0 * ray)

    def focus_mm(self, v: float) -> float:
        return -v

    def vergence(self, focus_mm: float) -> float:
        return -focus_mm


def light_of(tangent: Array) -> Array:
    """Compute cos^4 of viewing angles from their tangents."""
    squared: Array = tangent * tangent
    return 1 / (1 + squared) ** 2
