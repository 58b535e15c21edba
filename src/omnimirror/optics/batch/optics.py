"""The optics of a mirror point in closed form, for arrays of any shape and for complex steps.

The same equations as :mod:`omnimirror.optics.tracing` and :mod:`omnimirror.analysis`, written so that nothing
but sums, products, roots and one kind of arctangent occurs. Two things need that: an optimiser takes
exact derivatives by adding an imaginary step to an input, and blocks of thousands of designs are quick.
On the axis no limit has to be taken: z'/x stands for itself.

Both kinds of lens are written alike. The *vergence* of an image is the coordinate in which blur is linear: 1/L under
a perspective lens (Eq. 28 is ``(f b0/F)(1/L0 - 1/L)``), and -L in its stead under a telecentric one, whose blur is
``mu^2 (L - L0)/F_w``. The *ray coordinate* is what the image height is proportional to: tan(theta) (Eq. 7), and x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

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
    ray: Array
    """tan(theta) of the lens's viewing angle (Eq. 5); x under a telecentric lens."""
    magnification_t: Array
    """Tangential angular magnification, d ray per radian of object as seen from the mirror point at its distance: Dh
    per radian and unit of the ray coordinate (Eqs. 8, 9)."""
    magnification_s: Array
    """Sagittal angular magnification ray / (sin(Omega) + x/p): Dw in the same units (Eq. 10)."""
    vergence_t: Array
    """1/L_t (Eq. 34); -L_t under a telecentric lens."""
    vergence_s: Array
    """1/L_s (Eq. 35); -L_s under a telecentric lens."""
    viewpoint_z: Array
    """Where the chief ray meets the axis (Eq. 6)."""
    domega_dx: Array
    """dOmega/dx, 1/mm (Eq. 8); above 0 where the mapping is one to one."""
    cos_incidence: Array
    """Cosine of the angle of incidence gamma (Eq. 3); above 0 where the lens sees the mirror's front."""
    seen: Any = True
    """Whether what is outside is seen there at all; not by way of the base of a tube before another medium."""
    near: Any = 0.0
    """1 over the distance of the objects from the mirror points, 1/mm."""


class Look(NamedTuple):
    """What a focused camera makes of mirror points; arrays (.., k), or (.., 1) where one number holds for all."""

    t_px: Array
    """Signed tangential blur (Eq. 28)."""
    s_px: Array
    dh: Array
    """px per degree along the radius (Eq. 9)."""
    dw: Array
    """px per degree around the circle (Eq. 10)."""
    airy_px: Array
    own_t_px: Array
    """Blur of the lens alone; 0 of an ideal one."""
    own_s_px: Array
    light: Array
    """Illumination of the imager by the lens, over that on the axis."""


def node_optics(
    x: Array, z: Array, slope: Array, curvature: Array, slope_over_x: Array, m: Array, inverse_distance: Any = 0.0
) -> NodeOptics:
    """The optics of mirror points seen by a perspective lens at distance m from the vertex.

    Parameters
    ----------
    slope_over_x
        z'/x, and on the axis its limit z''.
    inverse_distance : 1/mm
        1/p of the object, 0 for one at infinity; or a function of x, z and field angle (radians) that returns it.
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
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + near)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + near)
    domega_dx = 2 * curvature / steep + front / to_lens
    return NodeOptics(
        omega=omega,
        ray=x / w,
        # the object moves by p domega_dx + cos(gamma)/cos(beta) across the ray, and by x + p sin(Omega) around the axis
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
    """As :func:`node_optics` under a telecentric lens: the limit of a lens infinitely far away."""
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
    """Lens and pixels as functions of the vergence v that is in focus."""

    def image_distance(self, v: Array) -> Array:
        """From the lens to the imager, mm; 0 of a telecentric lens, whose length is its maker's affair."""
        ...

    def height_px(self, ray: Array, v: Array) -> Array:
        """Image heights of ray coordinates, px (Eq. 7)."""
        ...

    def at(self, o: NodeOptics, v: Array) -> Look:
        """What it makes of mirror points (.., k) when focused at vergences (.., 1)."""
        ...

    def focus_mm(self, v: float) -> float:
        """The object distance in focus at a vergence."""
        ...

    def vergence(self, focus_mm: float) -> float:
        """The way back."""
        ...

    def airy_px(self, v: Array) -> Array:
        """Diameter of the Airy disk, px."""
        ...


class IdealCamera:
    """What ideal lenses have in common: one scale of the image and one of blur, wherever a ray comes from."""

    def px_per_ray(self, v: Array) -> Array:
        """Image height over the ray coordinate, px (Eq. 7)."""
        raise NotImplementedError

    def px_per_vergence(self, v: Array) -> Array:
        """Blur over the difference of two vergences, px (Eqs. 28, 29)."""
        raise NotImplementedError

    def airy_px(self, v: Array) -> Array:
        raise NotImplementedError

    def light(self, ray: Array) -> Array:
        """Natural vignetting of rays: cos^4."""
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
    """A perspective lens and its pixels; vergences are v = 1/L0 (1/mm).

    Attributes
    ----------
    focal_length_mm, f_number, rim_ray
        Numbers, or arrays with one entry per design; ``rim_ray`` is tan(Theta).
    image_radius_px
        Scales the image so that the rim has this radius; None for the real one.
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
    """A telecentric lens and its pixels; in the stead of vergences stand -L0 (mm), L0 from the mirror vertex.

    Attributes
    ----------
    magnification, f_number, rim_ray
        Numbers, or arrays with one entry per design; the F-number is the image's, ``rim_ray`` the rim radius.
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
    """cos^4 of viewing angles, by their tangents."""
    squared: Array = tangent * tangent
    return 1 / (1 + squared) ** 2
