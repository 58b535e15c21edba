"""Lens interface and entrance pupil: image height and blur of the virtual image behind the mirror.

A lens is described in object space: chief rays pass through its entrance pupil, a flat disc; blur
then needs no obliquity factor. Focusing changes only the image distance b0 (internal focusing, as in
the paper); principal point and pupil are fixed. Object distances ``L`` are measured along the axis
from the lens's reference point: the principal point of a perspective lens (Eqs. 34, 35), the mirror
vertex for an orthographic one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array

# -- Entrance pupil --------------------------------------------------------------------------------


class ChiefAim(NamedTuple):
    """Distance and motion of the entrance pupil for chief rays, (n,) each."""

    distance: Array
    """Axial distance w from the entrance pupil to the mirror point, mm."""
    drift: Array | float
    """Motion of the entrance pupil towards the mirror per radian of the viewing angle, mm."""


@dataclass(frozen=True)
class EntrancePupil:
    """Fixed entrance pupil, at a distance from the lens's reference point.

    >>> EntrancePupil(5.0).aim(np.array([10.0]), np.array([180.0])).distance
    array([175.])
    """

    at_mm: float = 0.0

    @property
    def moves(self) -> bool:
        """True if its position depends on the viewing angle."""
        return False

    def position(self, tangent: Array) -> Array:
        """Return the positions (n,), mm, at viewing angles given by their tangents."""
        return np.full_like(tangent, self.at_mm)

    def aim(self, x: Array, depth: Array) -> ChiefAim:
        """Return the chief rays of points at distances x (n,) from the axis and depths (n,), mm.

        Depths are measured from the reference point.
        """
        return ChiefAim(depth - self.at_mm, 0.0)


IN_REFERENCE_POINT = EntrancePupil()


# -- Lens interface --------------------------------------------------------------------------------
#
# A lens is described in object space: chief rays pass through its entrance pupil,
# a flat disc; blur then needs no obliquity factor.

BlurMode = Literal["exact", "paper"]
"""``"exact"`` is Eq. 28; ``"paper"`` Eq. 29, which neglects f against L0 (5.5-6.1 % less)."""

BLUR_MODES: tuple[BlurMode, ...] = ("exact", "paper")

FOCUS = Parameter(
    "mm", 1e-3, 1e7, "object distance in focus (L0), from the reference point of the lens"
)
F_NUMBER = Parameter("", 0.1, 1e3, "F-number")


class DepthOfField(NamedTuple):
    """Nearest and farthest object distance (mm) with blur within a tolerance; far may be inf."""

    near: float
    far: float

    @property
    def depth(self) -> float:
        return self.far - self.near


class ThroughFocus(NamedTuple):
    """Focus-dependent properties of a lens; numbers, or arrays over focus settings."""

    blur_rate: Any
    """Blur diameter (mm) per unit of :meth:`Lens.focus_coordinate` between image and focus."""
    image_scale: Any
    """Factor of proportionality of image heights."""
    f_number: Any
    """Working F-number F_w of the cone of light at the imager."""


class Lens(ABC):
    """Base class of lenses. ``w`` is the axial distance from pupil to mirror point."""

    KIND: ClassVar[str]
    PARAMETERS: ClassVar[dict[str, Parameter]]
    TELECENTRIC: ClassVar[bool]
    IS_THIN: ClassVar[bool] = True
    """True if one entrance pupil and one plane in focus describe the lens completely."""

    focus_distance_mm: float

    @property
    def pupil(self) -> EntrancePupil:
        """Entrance pupil; it is fixed while the lens is focused."""
        return IN_REFERENCE_POINT

    @property
    def nearest_focus_mm(self) -> float:
        """Smallest object distance (mm) of the focus range."""
        return 0.0

    @abstractmethod
    def ideal_height(self, x: Array, w: Array) -> Array:
        """Compute the undistorted image height (mm) of a mirror point at distance x (Eq. 7)."""

    @abstractmethod
    def ideal_height_rate(
        self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0
    ) -> Array:
        """Compute its derivative with respect to x; ``drift`` is the pupil's motion, mm per
        radian.
        """

    def image_height(self, x: Array, w: Array) -> Array:
        """Compute the image height (mm) of a mirror point: Eq. 7 with distortion."""
        return self.distorted_height(self.ideal_height(x, w))

    def image_height_rate(
        self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0
    ) -> Array:
        """Compute dh/dx along the meridian, dimensionless."""
        return self.stretch(self.ideal_height(x, w))[0] * self.ideal_height_rate(x, w, slope, drift)

    @property
    def is_symmetric(self) -> bool:
        """True if the image is rotationally symmetric about the axis."""
        return True

    def distorted(self, ideal: Array) -> Array:
        """Apply distortion to image points (..., 2), mm; NaN outside the image."""
        return ideal

    def undistorted(self, image: Array) -> Array:
        """Remove distortion from image points (..., 2), mm; NaN if no undistorted point exists."""
        return image

    def distorted_height(self, ideal: Array) -> Array:
        """Apply radial distortion to image heights (n,), mm."""
        return ideal

    def undistorted_height(self, h: Array) -> Array:
        """Invert :meth:`distorted_height`; NaN if no undistorted height exists."""
        return h

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        """Return tangential and sagittal magnification by distortion at heights (n,), mm."""
        return np.ones_like(ideal), np.ones_like(ideal)

    def blur_stretch(self, ideal: Array) -> tuple[Array, Array]:
        """Return blur (n,), (n,) at ideal heights (n,), mm, relative to the axis."""
        return self.stretch(ideal)

    def image_coordinates(self, L_t: Array, L_s: Array, ideal: Array) -> tuple[Array, Array]:
        """Return the focus coordinates (n,), (n,) of tangential and sagittal images.

        These are the coordinates to focus at, including field curvature and astigmatism.
        """
        return self.focus_coordinate(L_t), self.focus_coordinate(L_s)

    def own_blur(self, ideal: Array) -> tuple[Array, Array]:
        """Return the lens's own blur (n,), (n,), mm, in its tangential and sagittal focus."""
        return np.zeros_like(ideal), np.zeros_like(ideal)

    @abstractmethod
    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        """Return entrance-pupil points (n, 3), mm, for points (n, 2) of the unit disc.

        ``chief`` are the slopes (n, 2) of the chief rays; paraxial by default.

        In the frame of the lens's reference point, X and Y as in the unflipped image, Z towards the
        mirror. For a telecentric lens, with its pupil at infinity: unit vectors towards the pupil.
        """

    @abstractmethod
    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        """Return derivatives (n, 2, 3) of :meth:`entrance_pupil_points` by ``pupil``."""

    @abstractmethod
    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        """Return origins and directions (n, 3) of rays from image points (n, 2), mm.

        For an ideal thin lens, all rays of an image point meet in the plane in focus. Origins are
        in the plane of the lens; for a telecentric lens, in the plane in focus.
        """

    @abstractmethod
    def image_of(self, points: Array, directions: Array) -> Array:
        """Return image points (n, 2), mm, of rays with points and directions (n, 3)."""

    def clearances(self, points: Array, directions: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at the edges of the lens, by name.

        Rays are given by points and directions (n, 3), in the frame of the lens's reference point.
        The stop is not included: rays are sampled within it. An ideal lens has no other edges.
        """
        return {}

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """Return the relative illumination (n,) at image points (n, 2), mm, for uniform radiance.

        It is 1 on the axis. With points (n, 2) of the unit disc of the aperture, return the natural
        falloff (cos^4) of rays through these, without the vignetting described by
        :meth:`clearances`.
        """
        tangent = np.zeros_like(image) if pupil is None else pupil / (2 * self.image_f_number())
        return cos4(tangent)

    @abstractmethod
    def focus_coordinate(self, L: ArrayLike) -> Array:
        """Convert object distances L (mm) to the focus coordinate, in which blur is linear."""

    @abstractmethod
    def distance_of(self, coordinate: ArrayLike) -> Array:
        """Convert focus coordinates to object distances L (mm)."""

    @abstractmethod
    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        """Return the lens properties at focus coordinates, which may be complex."""

    def blur(self, L: ArrayLike, focus: ArrayLike | None = None, mode: BlurMode = "exact") -> Array:
        """Compute the blur diameter (mm) of a point at L; positive beyond focus."""
        focused = self.focus_coordinate(self.focus_distance_mm if focus is None else focus)
        beyond = focused - self.focus_coordinate(L)
        return np.asarray(self.through_focus(focused, mode).blur_rate * beyond)

    @abstractmethod
    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        """Compute the object distances (mm) with a blur up to a tolerance (Eqs. 30, 31)."""

    @property
    @abstractmethod
    def stop_number(self) -> float:
        """F-number setting: f/D focused at infinity; on the image side for a telecentric lens."""

    def image_f_number(self) -> float:
        """Compute the working F-number F_w of the cone of light at the imager."""
        return float(self.through_focus(self.focus_coordinate(self.focus_distance_mm)).f_number)

    def focused_at(self, focus_distance_mm: float) -> Self:
        """Return the lens focused at another distance."""
        return replace(self, focus_distance_mm=focus_distance_mm)  # type: ignore[type-var]

    def at_wavelength(self, wavelength_nm: float) -> Self:
        """Return the lens at a wavelength, with a fixed imager; ideal lenses are achromatic."""
        return self

    def airy_diameter(self, wavelength_nm: float = 550.0) -> float:
        """Compute the diameter of the Airy disc on the imager, mm: 2.44 lambda F_w."""
        if not 100.0 <= number("wavelength_nm", wavelength_nm) <= 20000.0:
            raise InvalidParameter(f"wavelength_nm must be 100 to 20000 nm; got {wavelength_nm:g}")
        return 2.44 * wavelength_nm * 1e-6 * self.image_f_number()

    @classmethod
    def from_spec(cls, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Load the files that a lens table names; a folder of None forbids files."""
        return data

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the parameters only; cached results are recomputed."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def _check(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]
            self.PARAMETERS[f.name].check(f.name, number(f.name, getattr(self, f.name)))


def cos4(tangent: Array) -> Array:
    """Compute the fourth power (n,) of the cosine of angles with tangents (n, 2)."""
    power: Array = (1 + (tangent**2).sum(axis=-1)) ** -2
    return power


def crossing(points: Array, directions: Array, z: float) -> Array:
    """Return the intersections (x, y) (n, 2) of rays (n, 3), (n, 3) with the plane at z."""
    steps = (z - points[..., 2]) / directions[..., 2]
    points_in_plane: Array = points[..., :2] + steps[..., None] * directions[..., :2]
    return points_in_plane
