"""Lens interface, entrance pupil, and ideal lenses: image height and blur of the virtual image.

A lens is described in object space: chief rays pass through its entrance pupil, a flat disc; blur
then needs no obliquity factor. Focusing changes only the image distance b0 (internal focusing, as in
the paper); principal point and pupil are fixed. Object distances ``L`` are measured along the axis
from the lens's reference point: the principal point of a perspective lens (Eqs. 34, 35), the mirror
vertex for an orthographic one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import choice, coordinates, number
from ...base.caching import cached_property
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

    def offset(self, mirror_distance_mm: float, secondary_distance_mm: float = 0.0) -> Array:
        """Return the reference point (3,) of the lens, mm from the nominal mirror vertex.

        That of an orthographic lens is the vertex of the mirror that faces it.
        """
        z = -secondary_distance_mm if self.TELECENTRIC else -mirror_distance_mm
        return np.array([0.0, 0.0, z])

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
        return replace(self, focus_distance_mm=focus_distance_mm)  # type: ignore[type-var]  # all implementations are dataclasses

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

    @classmethod
    def file_entries(cls) -> dict[str, tuple[str, ...]]:
        """Return the entries of a lens table that name a file, with the entries that it provides."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the parameters only; cached results are recomputed."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]  # subclasses are dataclasses

    def _check(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]  # subclasses are dataclasses
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


# -- Gaussian optics relative to the entrance pupil ------------------------------------------------
#
# Let e be the distance of the entrance pupil from the principal point towards the mirror. Relative to
# the pupil, a thick lens is equivalent to a thin one of principal distance
# ``c = f / (1 - (f - e) v)``, with the vergence ``v = 1/s0`` of the plane in focus, and its blur is
# ``(f/F) c (v - 1/s)``. For e = 0 these are Eqs. 25 and 28. Both follow from the lens equation at the
# principal planes: the ray from the pupil centre meets the plane in focus at ``s0 tan(theta)``,
# imaged with the magnification ``b0/L0``.


class GaussianLens(Lens):
    """Lens at finite distance, with focal length and F-number f/D."""

    focal_length_mm: float
    f_number: float

    TELECENTRIC: ClassVar[bool] = False

    @property
    def principal_point_mm(self) -> float:
        """Position of the principal point, towards the mirror from the reference point."""
        return 0.0

    @property
    def pupil_from_principal(self) -> float:
        """Distance e (mm) of the entrance pupil from the principal point, towards the mirror."""
        return self.pupil.at_mm - self.principal_point_mm

    def _check_focus(self) -> None:
        if self.focus_distance_mm <= self.principal_point_mm + self.focal_length_mm:
            pupil_mm = self.principal_point_mm
            position_text = f" in front of the principal point at {pupil_mm:g}" if pupil_mm else ""
            raise InvalidParameter(
                "focus_distance_mm must be greater than focal_length_mm = "
                f"{self.focal_length_mm:g}{position_text}; got {self.focus_distance_mm:g}"
            )
        if self.focus_distance_mm <= self.pupil.at_mm:
            raise InvalidParameter(
                f"focus_distance_mm must be greater than {self.pupil.at_mm:g} mm, the position "
                f"of the entrance pupil; got {self.focus_distance_mm:g}"
            )

    @property
    def nearest_focus_mm(self) -> float:
        """Smallest focus distance, slightly beyond focal length and entrance pupil."""
        f = self.focal_length_mm
        return max(self.principal_point_mm + 1.0001 * f, self.pupil.at_mm + 0.0001 * f)

    @property
    def image_distance(self) -> float:
        """Distance b0 (mm) from principal point to imager in focus (Eq. 25)."""
        return 1 / (
            1 / self.focal_length_mm - 1 / (self.focus_distance_mm - self.principal_point_mm)
        )

    @property
    def imager_mm(self) -> float:
        """Distance from the reference point to the imager, mm; by default that of a thin lens."""
        return self.image_distance - self.principal_point_mm

    @cached_property
    def principal_distance(self) -> float:
        """Undistorted image height (mm) per tangent of the viewing angle."""
        return float(self.through_focus(1 / self.from_pupil).image_scale)

    @property
    def from_pupil(self) -> float:
        """Distance (mm) from the entrance pupil to the plane in focus."""
        return self.focus_distance_mm - self.pupil.at_mm

    def hyperfocal_distance(self, tolerance: float) -> float:
        """Compute the hyperfocal distance f^2 / (delta F), mm, for a blur delta in mm."""
        return self.focal_length_mm**2 / (
            number("tolerance", tolerance, above=0, unit="mm") * self.f_number
        )

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.principal_distance * x / w

    def ideal_height_rate(
        self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0
    ) -> Array:
        # h = c tan(theta), tan(theta) = x/w: dh/dx = c (w - x z')/w^2 (Eq. 8), with w changing by the
        # pupil's motion, drift dtheta
        return self.principal_distance * (w - x * slope) / (w * (w - drift * x * w / (x**2 + w**2)))

    @property
    def stop_number(self) -> float:
        return self.f_number

    @property
    def aperture_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length_mm / self.f_number / 2

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        return np.concatenate(
            [self.aperture_radius * pupil, np.full((len(pupil), 1), self.pupil.at_mm)], axis=1
        )

    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        return np.broadcast_to(self.aperture_radius * np.eye(2, 3), (len(pupil), 2, 3))

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """Compute the vergence at the entrance pupil."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (coordinates("L", L) - self.pupil.at_mm))

    def distance_of(self, coordinate: ArrayLike) -> Array:
        with np.errstate(divide="ignore"):
            return np.asarray(1 / coordinates("coordinate", coordinate) + self.pupil.at_mm)

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        f, F = self.focal_length_mm, self.f_number
        c = f / (1 - (f - self.pupil_from_principal) * coordinate)  # Eq. 25
        return ThroughFocus(f * (c if mode == "exact" else f) / F, c, F * c / f)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        f, s0, pupil_mm = self.focal_length_mm, self.from_pupil, self.pupil.at_mm
        # blur (f/F) c |1/s0 - 1/s| = tolerance, solved for s, with c = f s0/(s0 - (f - e)); mode "paper"
        # replaces c by f (Eq. 29)
        dropped = f - self.pupil_from_principal if mode == "exact" else 0.0
        spread = number("tolerance", tolerance, low=0, unit="mm") * self.f_number * (s0 - dropped)
        far = f**2 * s0 / (f**2 - spread) + pupil_mm if spread < f**2 else np.inf
        return DepthOfField(f**2 * s0 / (f**2 + spread) + pupil_mm, far)


# -- Perspective lens ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Perspective(GaussianLens):
    """Perspective lens, ``h = b0 tan(theta)``, with optional OpenCV distortion.

    Distortion displaces the image of an ideal thin lens as a whole, including its blur
    (:mod:`omnimirror.optics.lenses.lens`); blur scales with the local magnification.

    A thick lens has its entrance pupil ``entrance_pupil_mm`` towards the mirror from its principal
    point (:mod:`omnimirror.optics.lenses.lens`).

    >>> lens = Perspective(focal_length_mm=11.6, f_number=4.0, focus_distance_mm=212.0)
    >>> round(lens.image_distance, 4), round(lens.image_f_number(), 4)
    (12.2715, 4.2315)
    """

    focal_length_mm: float
    f_number: float
    focus_distance_mm: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    entrance_pupil_mm: float = 0.0

    KIND: ClassVar[str] = "perspective"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 1e-2, 1e5, "focal length (f)"),
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        "k1": Parameter(
            "", -100.0, 100.0, "radial distortion coefficient of r^2 (OpenCV), 0 by default"
        ),
        "k2": Parameter("", -1e4, 1e4, "radial distortion coefficient of r^4"),
        "k3": Parameter("", -1e6, 1e6, "radial distortion coefficient of r^6"),
        "p1": Parameter("", -1.0, 1.0, "tangential distortion coefficient p1"),
        "p2": Parameter("", -1.0, 1.0, "tangential distortion coefficient p2"),
        "entrance_pupil_mm": Parameter(
            "mm",
            -1e4,
            1e4,
            "position of the entrance pupil, from the principal point towards the mirror",
        ),
    }

    def __post_init__(self) -> None:
        self._check()
        self._check_focus()

    @cached_property
    def pupil(self) -> EntrancePupil:
        return EntrancePupil(self.entrance_pupil_mm)

    @property
    def brown(self) -> Coefficients:
        """Distortion coefficients."""
        return self.k1, self.k2, self.k3, self.p1, self.p2

    @property
    def is_symmetric(self) -> bool:
        return not (self.p1 or self.p2)

    def distorted(self, ideal: Array) -> Array:
        c = self.principal_distance
        return c * distorted(ideal / c, self.brown) if any(self.brown) else ideal

    def undistorted(self, image: Array) -> Array:
        c = self.principal_distance
        return c * undistorted(image / c, self.brown) if any(self.brown) else image

    def distorted_height(self, ideal: Array) -> Array:
        k, c = self.brown[:3], self.principal_distance
        if not any(k):
            return ideal
        tangent, last = ideal / c, fold(k)
        if (tangent > last).any():
            raise InvalidParameter(
                f"the distortion k1, k2, k3 = {k[0]:g}, {k[1]:g}, {k[2]:g} must be monotonic up "
                f"to the edge of the mirror, {np.degrees(np.arctan(np.max(tangent))):.4g} deg "
                "from the axis of the lens; the image folds over at "
                f"{np.degrees(np.arctan(last)):.4g} deg"
            )
        return c * distorted_radius(tangent, k)[0]

    def undistorted_height(self, h: Array) -> Array:
        return self.principal_distance * undistorted_radius(
            h / self.principal_distance, self.brown[:3]
        )

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        if not any(self.brown[:3]):
            return super().stretch(ideal)
        tangent = ideal / self.principal_distance
        radius, rate = distorted_radius(tangent, self.brown[:3])
        with np.errstate(invalid="ignore"):
            return rate, np.where(tangent == 0.0, 1.0, radius / tangent)

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        origins, ideal = self.entrance_pupil_points(pupil), self.undistorted(image)
        slopes = ideal / self.principal_distance - origins[:, :2] / self.from_pupil
        return origins, np.concatenate([slopes, np.ones((len(ideal), 1))], axis=1)

    def image_of(self, points: Array, directions: Array) -> Array:
        scale = self.principal_distance / self.from_pupil
        return self.distorted(scale * crossing(points, directions, self.focus_distance_mm))

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """Return cos^4 at the imager, multiplied by the compression by distortion."""
        ideal = self.undistorted(image) / self.principal_distance
        tangent = ideal if pupil is None else ideal + pupil / (2 * self.image_f_number())
        return cos4(tangent) * shrinkage(ideal, self.brown)


# -- Telecentric lens ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Orthographic(Lens):
    """Telecentric lens: chief rays parallel to the axis, ``h = mu x``.

    ``working_f_number`` is the image-side F-number, as in data sheets of telecentric lenses.

    >>> lens = Orthographic(magnification=0.1, working_f_number=4.0, focus_distance_mm=20.0)
    >>> round(float(lens.blur(24.0)), 12)  # mu^2 (L - L0) / F_w
    0.01
    """

    magnification: float
    working_f_number: float
    focus_distance_mm: float

    KIND: ClassVar[str] = "orthographic"
    TELECENTRIC: ClassVar[bool] = True
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "magnification": Parameter("", 1e-5, 1e3, "image size relative to object size (mu)"),
        "working_f_number": F_NUMBER,
        "focus_distance_mm": Parameter(
            "mm", -1e6, 1e6, "object distance in focus (L0), from the mirror vertex"
        ),
    }

    def __post_init__(self) -> None:
        self._check()

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.magnification * x

    def ideal_height_rate(
        self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0
    ) -> Array:
        return np.full_like(x, self.magnification)

    @property
    def stop_number(self) -> float:
        return self.working_f_number

    @property
    def aperture_slope(self) -> float:
        """Object-side slope of the marginal rays against the axis."""
        return self.magnification / self.working_f_number / 2

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        slopes = self.aperture_slope * pupil
        towards = np.concatenate([slopes, -np.ones((len(pupil), 1))], axis=1)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        return towards

    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        towards = self.entrance_pupil_points(pupil)
        turn = np.eye(2, 3) - towards[:, None, :] * towards[:, :2, None]
        motion: Array = -self.aperture_slope * towards[:, 2:, None] * turn
        return motion

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        in_focus = np.concatenate(
            [image / self.magnification, np.full((len(image), 1), self.focus_distance_mm)], 1
        )
        return in_focus, -self.entrance_pupil_points(pupil)

    def image_of(self, points: Array, directions: Array) -> Array:
        return self.magnification * crossing(points, directions, self.focus_distance_mm)

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """Return the distance L itself."""
        return coordinates("L", L)

    def distance_of(self, coordinate: ArrayLike) -> Array:
        return coordinates("coordinate", coordinate)

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        F = self.working_f_number
        return ThroughFocus(-(self.magnification**2) / F, 1.0, F)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        half_depth = (
            number("tolerance", tolerance, low=0, unit="mm")
            * self.working_f_number
            / self.magnification**2
        )
        return DepthOfField(
            self.focus_distance_mm - half_depth, self.focus_distance_mm + half_depth
        )


# -- Distortion in the OpenCV model (Brown, 1966) --------------------------------------------------
#
# Coordinates are tangents of the viewing angle: x to the right, y down in the image, r^2 = x^2 + y^2;
#
#     x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
#     y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

Coefficients = tuple[float, float, float, float, float]
"""k1, k2, k3, p1, p2."""
TERMS = ("k1", "k2", "k3", "p1", "p2")

MAX_STEPS = 100
TINY = 1e-9  # inverse square of a tangent beyond any field
CLOSE = 1e-14  # relative; convergence of Newton's method is quadratic


def distorted(ideal: Array, brown: Coefficients) -> Array:
    """Apply distortion to ideal image points (..., 2); NaN beyond the fold of the image.

    >>> distorted(np.array([[0.3, 0.4]]), (-0.1, 0.0, 0.0, 0.0, 0.0))
    array([[0.2925, 0.39  ]])
    """
    with np.errstate(invalid="ignore"):
        unfolded = (ideal**2).sum(axis=-1) <= fold(brown[:3]) ** 2
    moved = _brown(ideal[..., 0], ideal[..., 1], brown)[0]
    return np.where(unfolded[..., None], moved, np.nan)


def distorted_rates(ideal: Array, brown: Coefficients) -> tuple[Array, Array, Array]:
    """Distort points (n, 2), with derivatives (n, 2, 2) with respect to these and (n, 2, 5) by the
    coefficients.

    >>> distorted_rates(np.array([[0.3, 0.4]]), (-0.1, 0.0, 0.0, 0.0, 0.0))[2][0, :, 0]  # x r^2, y r^2
    array([0.075, 0.1  ])
    """
    x, y = ideal[:, 0], ideal[:, 1]
    (xx, xy, yy), s = _brown(x, y, brown)[1], x * x + y * y
    by_ideal = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=1)
    right = np.stack([x * s, x * s**2, x * s**3, 2 * x * y, s + 2 * x * x], axis=-1)
    down = np.stack([y * s, y * s**2, y * s**3, s + 2 * y * y, 2 * x * y], axis=-1)
    return distorted(ideal, brown), by_ideal, np.stack([right, down], axis=1)


def undistorted(image: Array, brown: Coefficients) -> Array:
    """Remove distortion from image points (..., 2); NaN if no ideal point exists.

    >>> undistorted(np.array([[0.2925, 0.39]]), (-0.1, 0.0, 0.0, 0.0, 0.0))
    array([[0.3, 0.4]])
    """
    radius = np.hypot(image[..., 0], image[..., 1])
    inner = undistorted_radius(radius, brown[:3])
    ideal: Array = image * (inner / np.maximum(radius, np.finfo(float).tiny))[..., None]
    if not (brown[3] or brown[4]):
        return ideal
    for _ in range(MAX_STEPS):
        moved, (xx, xy, yy) = _brown(ideal[..., 0], ideal[..., 1], brown)
        ex, ey = np.moveaxis(moved - image, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Newton's method with the inverse of the symmetric 2 x 2 Jacobian
            step = (
                np.stack([yy * ex - xy * ey, xx * ey - xy * ex], axis=-1)
                / (xx * yy - xy * xy)[..., None]
            )
        ideal = ideal - step
        if not (np.abs(step) > CLOSE).any():
            break
    with np.errstate(invalid="ignore"):
        solution = np.abs(distorted(ideal, brown) - image).max(axis=-1) < 1e-9
    return np.where(solution[..., None], ideal, np.nan)


def distorted_radius(r: Array, k: tuple[float, ...]) -> tuple[Array, Array]:
    """Compute r (1 + k1 r^2 + k2 r^4 + k3 r^6) for radii (n,), and its derivative."""
    s = r**2
    return (
        r * (1 + s * (k[0] + s * (k[1] + s * k[2]))),
        1 + s * (3 * k[0] + s * (5 * k[1] + s * 7 * k[2])),
    )


def undistorted_radius(radius: Array, k: tuple[float, ...]) -> Array:
    """Invert :func:`distorted_radius` between axis and fold; NaN beyond."""
    if not any(k):
        return radius
    low, high = np.zeros_like(radius), np.minimum(radius, fold(k))
    for _ in range(MAX_STEPS):
        short = (distorted_radius(high, k)[0] < radius) & (high < fold(k))
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, fold(k)), high)
    r = high
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(MAX_STEPS):
            value, rate = distorted_radius(r, k)
            low, high = np.where(value <= radius, r, low), np.where(value >= radius, r, high)
            newton = r - (value - radius) / rate
            last, r = r, np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
            if not (np.abs(r - last) > CLOSE * np.abs(r)).any():
                break
        solution = np.abs(distorted_radius(r, k)[0] - radius) <= 1e-9 * radius
    return np.where(solution, r, np.nan)


@lru_cache(maxsize=64)
def fold(k: tuple[float, ...]) -> float:
    """Return the radius of maximum distorted radius, the fold; infinite if none.

    >>> round(fold((-0.1, 0.0, 0.0)), 6)  # 1/sqrt(3 * 0.1)
    1.825742
    """
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6) = 0, as a polynomial in 1/r^2; the largest root is the
    # first extremum
    inverse_squares = np.roots([1.0, 3 * k[0], 5 * k[1], 7 * k[2]])  # without divisions
    real = inverse_squares[np.abs(inverse_squares.imag) <= 1e-9 * np.abs(inverse_squares)].real
    return float(1 / np.sqrt(real.max())) if (real > TINY).any() else np.inf


def shrinkage(ideal: Array, brown: Coefficients) -> Array:
    """Compute the ideal area (n,) per unit distorted area at ideal points (n, 2)."""
    xx, xy, yy = _brown(ideal[..., 0], ideal[..., 1], brown)[1]
    area: Array = 1 / (xx * yy - xy * xy)
    return area


def _brown(x: Array, y: Array, brown: Coefficients) -> tuple[Array, tuple[Array, Array, Array]]:
    """Evaluate the model, and its derivatives dx'/dx, dx'/dy = dy'/dx and dy'/dy."""
    k1, k2, k3, p1, p2 = brown
    s = x * x + y * y
    bend, rate = 1 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2 * k2 + s * 3 * k3)
    moved = np.stack(
        [
            x * bend + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * bend + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = bend + 2 * x * x * rate + 2 * p1 * y + 6 * p2 * x
    yy = bend + 2 * y * y * rate + 6 * p1 * y + 2 * p2 * x
    return moved, (xx, 2 * x * y * rate + 2 * p1 * x + 2 * p2 * y, yy)
