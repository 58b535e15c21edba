"""Lenses: how a virtual image behind the mirror becomes a height and a blur on the imager.

The stop lies at the lens, a thin one; then the blur needs no obliquity factor. Focusing changes the
image distance b0 only (internal focusing, as in the paper) and leaves the principal point where it is.

Object distances ``L`` count from the lens's reference point along the axis: the principal point of a
perspective lens (Eqs. 34, 35), the mirror vertex under an orthographic one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arguments import choice, number
from .distortion import Coefficients, distorted, distorted_radius, fold, shrinkage, undistorted, undistorted_radius
from .errors import InvalidParameter
from .parameters import Parameter

Array = NDArray[np.float64]
BlurMode = Literal["exact", "paper"]
"""``"exact"`` is Eq. 28; ``"paper"`` Eq. 29, which drops f against L0 and is 5.5-6.1 % too small here."""

BLUR_MODES: tuple[BlurMode, ...] = ("exact", "paper")

FOCUS = Parameter("mm", 1e-3, 1e7, "object distance in focus (L0), from the lens's reference point")
F_NUMBER = Parameter("", 0.1, 1e3, "F-number")


class DepthOfField(NamedTuple):
    """Nearest and farthest object distance (mm) whose blur stays within a tolerance; far may be inf."""

    near: float
    far: float

    @property
    def depth(self) -> float:
        return self.far - self.near


class ThroughFocus(NamedTuple):
    """All of a lens that changes with its focus; numbers, or arrays of several focuses."""

    blur_rate: Any
    """Blur diameter (mm) per step of :meth:`Lens.focus_coordinate` between image and focus."""
    image_scale: Any
    """What image heights are proportional to."""
    f_number: Any
    """Working F-number F_w of the cone of light that reaches the imager."""


class Lens(ABC):
    """What the evaluation asks of a lens. ``w`` is the axial distance m + z from lens to mirror point."""

    KIND: ClassVar[str]
    PARAMETERS: ClassVar[dict[str, Parameter]]
    TELECENTRIC: ClassVar[bool]

    focus_distance_mm: float

    @abstractmethod
    def ideal_height(self, x: Array, w: Array) -> Array:
        """Image height (mm) of the mirror point at distance x from the axis under a lens without distortion (Eq. 7)."""

    @abstractmethod
    def ideal_height_rate(self, x: Array, w: Array, slope: Array) -> Array:
        """Its derivative by x along the meridian, dimensionless."""

    def image_height(self, x: Array, w: Array) -> Array:
        """Image height h (mm) of the mirror point at distance x from the axis: Eq. 7, and radial distortion."""
        return self.distorted_height(self.ideal_height(x, w))

    def image_height_rate(self, x: Array, w: Array, slope: Array) -> Array:
        """dh/dx along the meridian, dimensionless."""
        return self.stretch(self.ideal_height(x, w))[0] * self.ideal_height_rate(x, w, slope)

    @property
    def is_symmetric(self) -> bool:
        """Whether its picture is the same all about the axis."""
        return True

    def distorted(self, ideal: Array) -> Array:
        """Where (.., 2) mm image points (.., 2) of a lens without distortion really are; NaN where they are not."""
        return ideal

    def undistorted(self, image: Array) -> Array:
        """Where (.., 2) mm image points (.., 2) would be without distortion; NaN where nothing is sent."""
        return image

    def distorted_height(self, ideal: Array) -> Array:
        """Image heights (n,) mm of those without distortion; radial distortion alone."""
        return ideal

    def undistorted_height(self, h: Array) -> Array:
        """The inverse of :meth:`distorted_height`; NaN where nothing is sent."""
        return h

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        """By how much distortion widens the picture tangentially and sagittally at ideal heights (n,) mm."""
        return np.ones_like(ideal), np.ones_like(ideal)

    @abstractmethod
    def eyes(self, pupil: Array) -> Array:
        """Where (n, 3) mm points (n, 2) of the unit disk of the aperture stand.

        In the frame of the lens's reference point, X and Y as in the unflipped picture, Z towards the
        mirror. Under a telecentric lens, which sees from infinitely far away: unit vectors towards it.
        """

    @abstractmethod
    def eyes_motion(self, pupil: Array) -> Array:
        """Derivatives (n, 2, 3) of :meth:`eyes` by the two coordinates of the aperture."""

    @abstractmethod
    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        """Origins and directions (n, 3) of rays from image points (n, 2) mm through aperture points to the mirror.

        An ideal thin lens: all rays of an image point meet in the plane in focus. Origins lie in the
        plane of the lens; under a telecentric one, in the plane in focus.
        """

    @abstractmethod
    def image_of(self, points: Array, directions: Array) -> Array:
        """Image points (n, 2) mm of rays from the mirror, given by points and directions (n, 3) on them."""

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """Natural vignetting (n,) at image points (n, 2) mm, against the axis, of an even light.

        What arrives by way of points (n, 2) of the unit disk of the aperture; of its centre by default.
        """
        tangent = np.zeros_like(image) if pupil is None else pupil / (2 * self.image_f_number())
        return _cos4(tangent)

    @abstractmethod
    def focus_coordinate(self, L: ArrayLike) -> Array:
        """The place of object distances L (mm) on the scale on which blur is linear; its own inverse."""

    @abstractmethod
    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        """What the lens is when focused at coordinates; analytic in them, so that complex ones have derivatives."""

    def blur(self, L: ArrayLike, focus: ArrayLike | None = None, mode: BlurMode = "exact") -> Array:
        """Blur diameter (mm) on the imager of a point at L; positive beyond the focus (Eqs. 27-29)."""
        focused = self.focus_coordinate(self.focus_distance_mm if focus is None else focus)
        beyond = focused - self.focus_coordinate(L)
        return np.asarray(self.through_focus(focused, mode).blur_rate * beyond)

    @abstractmethod
    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        """Object distances (mm) whose blur is at most ``tolerance`` (mm) (Eqs. 30, 31)."""

    def image_f_number(self) -> float:
        """Working F-number F_w of the cone of light that reaches the imager; sets the Airy disk."""
        return float(self.through_focus(self.focus_coordinate(self.focus_distance_mm)).f_number)

    def focused_at(self, focus_distance_mm: float) -> Self:
        """The same lens focused elsewhere."""
        return replace(self, focus_distance_mm=focus_distance_mm)  # type: ignore[type-var]

    def airy_diameter(self, wavelength_nm: float = 550.0) -> float:
        """Diameter of the Airy disk on the imager, mm: 2.44 lambda F_w."""
        if not 100.0 <= number("wavelength_nm", wavelength_nm) <= 20000.0:
            raise InvalidParameter(f"wavelength_nm = {wavelength_nm:g} is outside 100 to 20000 nm")
        return 2.44 * wavelength_nm * 1e-6 * self.image_f_number()

    def _check(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))


@dataclass(frozen=True)
class Perspective(Lens):
    """An ordinary lens: ``h = b0 tan(theta)``, ``1/b0 = 1/f - 1/L0``; distorted, if it is, as OpenCV states it.

    Distortion moves what an ideal thin lens shows, whole cones of light at a time
    (:mod:`omnimirror.distortion`); a blur grows and shrinks with the picture about it.

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

    KIND: ClassVar[str] = "perspective"
    TELECENTRIC: ClassVar[bool] = False
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 1e-2, 1e5, "focal length (f)"),
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        "k1": Parameter("", -100.0, 100.0, "radial distortion as in OpenCV, none by default: r^2 of the tangent"),
        "k2": Parameter("", -1e4, 1e4, "radial distortion, r^4"),
        "k3": Parameter("", -1e6, 1e6, "radial distortion, r^6"),
        "p1": Parameter("", -1.0, 1.0, "tangential distortion"),
        "p2": Parameter("", -1.0, 1.0, "tangential distortion"),
    }

    def __post_init__(self) -> None:
        self._check()
        if self.focus_distance_mm <= self.focal_length_mm:
            raise InvalidParameter(
                f"focus_distance_mm = {self.focus_distance_mm:g} is not beyond the focal length; "
                f"it is valid above focal_length_mm = {self.focal_length_mm:g}"
            )

    @property
    def image_distance(self) -> float:
        """Distance b0 (mm) from lens to imager when focused (Eq. 25)."""
        return float(self.through_focus(1 / self.focus_distance_mm).image_scale)

    def hyperfocal_distance(self, tolerance: float) -> float:
        """L_inf = f^2 / (delta F), mm, for a permissible blur delta in mm."""
        return self.focal_length_mm**2 / (tolerance * self.f_number)

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.image_distance * x / w

    def ideal_height_rate(self, x: Array, w: Array, slope: Array) -> Array:
        return self.image_distance * (w - x * slope) / w**2

    @property
    def brown(self) -> Coefficients:
        """Its distortion."""
        return self.k1, self.k2, self.k3, self.p1, self.p2

    @property
    def is_symmetric(self) -> bool:
        return not (self.p1 or self.p2)

    def distorted(self, ideal: Array) -> Array:
        return self.image_distance * distorted(ideal / self.image_distance, self.brown) if any(self.brown) else ideal

    def undistorted(self, image: Array) -> Array:
        return self.image_distance * undistorted(image / self.image_distance, self.brown) if any(self.brown) else image

    def distorted_height(self, ideal: Array) -> Array:
        k, b0 = self.brown[:3], self.image_distance
        if not any(k):
            return ideal
        tangent, last = ideal / b0, fold(k)
        if (tangent > last).any():
            raise InvalidParameter(
                f"k1, k2, k3 = {k[0]:g}, {k[1]:g}, {k[2]:g} fold the picture over at {np.degrees(np.arctan(last)):.4g} "
                f"deg from the lens's axis, and the mirror reaches {np.degrees(np.arctan(np.max(tangent))):.4g} deg; "
                "distortion is valid if the picture grows up to there"
            )
        return b0 * distorted_radius(tangent, k)[0]

    def undistorted_height(self, h: Array) -> Array:
        return self.image_distance * undistorted_radius(h / self.image_distance, self.brown[:3])

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        tangent = ideal / self.image_distance
        radius, rate = distorted_radius(tangent, self.brown[:3])
        with np.errstate(invalid="ignore"):
            return rate, np.where(tangent == 0.0, 1.0, radius / tangent)

    @property
    def aperture_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length_mm / self.f_number / 2

    def eyes(self, pupil: Array) -> Array:
        return np.concatenate([self.aperture_radius * pupil, np.zeros((len(pupil), 1))], axis=1)

    def eyes_motion(self, pupil: Array) -> Array:
        return np.broadcast_to(self.aperture_radius * np.eye(2, 3), (len(pupil), 2, 3))

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        origins, ideal = self.eyes(pupil), self.undistorted(image)
        in_focus = np.concatenate([ideal / self.image_distance, np.ones((len(ideal), 1))], axis=1)
        return origins, in_focus - origins / self.focus_distance_mm

    def image_of(self, points: Array, directions: Array) -> Array:
        L0 = self.focus_distance_mm
        return self.distorted(self.image_distance / L0 * _crossing(points, directions, L0))

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """cos^4 of the angle at the imager, and more where distortion packs more of the world into an area of it."""
        ideal = self.undistorted(image) / self.image_distance
        tangent = ideal if pupil is None else ideal + pupil / (2 * self.image_f_number())
        return _cos4(tangent) * shrinkage(ideal, self.brown)

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """The vergence 1/L; its inverse is the same."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / np.asarray(L, dtype=float))

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        f, F = self.focal_length_mm, self.f_number
        b0 = f / (1 - f * coordinate)  # Eq. 25
        return ThroughFocus(f * (b0 if mode == "exact" else f) / F, b0, F * b0 / f)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        f, L0 = self.focal_length_mm, self.focus_distance_mm
        dropped = f if mode == "exact" else 0.0
        spread = tolerance * self.f_number * (L0 - dropped)
        far = f**2 * L0 / (f**2 - spread) if spread < f**2 else np.inf
        return DepthOfField(f**2 * L0 / (f**2 + spread), far)


@dataclass(frozen=True)
class Orthographic(Lens):
    """A telecentric lens: all chief rays parallel to the axis, ``h = mu x``; as wide as the mirror.

    ``working_f_number`` is the image-side F-number, as makers of telecentric lenses state it.

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
        "magnification": Parameter("", 1e-5, 1e3, "image size over object size (mu)"),
        "working_f_number": F_NUMBER,
        "focus_distance_mm": Parameter("mm", -1e6, 1e6, "object plane in focus (L0), from the mirror vertex"),
    }

    def __post_init__(self) -> None:
        self._check()

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.magnification * x

    def ideal_height_rate(self, x: Array, w: Array, slope: Array) -> Array:
        return np.full_like(x, self.magnification)

    @property
    def aperture_slope(self) -> float:
        """Slope of the outermost rays on the side of the mirror, against the axis."""
        return self.magnification / self.working_f_number / 2

    def eyes(self, pupil: Array) -> Array:
        slopes = self.aperture_slope * pupil
        towards = np.concatenate([slopes, -np.ones((len(pupil), 1))], axis=1)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        return towards

    def eyes_motion(self, pupil: Array) -> Array:
        towards = self.eyes(pupil)
        turn = np.eye(2, 3) - towards[:, None, :] * towards[:, :2, None]
        motion: Array = -self.aperture_slope * towards[:, 2:, None] * turn
        return motion

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        in_focus = np.concatenate([image / self.magnification, np.full((len(image), 1), self.focus_distance_mm)], 1)
        return in_focus, -self.eyes(pupil)

    def image_of(self, points: Array, directions: Array) -> Array:
        return self.magnification * _crossing(points, directions, self.focus_distance_mm)

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """The distance L itself."""
        return np.asarray(L, dtype=float)

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        F = self.working_f_number
        return ThroughFocus(-(self.magnification**2) / F, 1.0, F)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        reach = tolerance * self.working_f_number / self.magnification**2
        return DepthOfField(self.focus_distance_mm - reach, self.focus_distance_mm + reach)


def _cos4(tangent: Array) -> Array:
    """Fourth power (n,) of the cosine of angles whose tangents are (n, 2)."""
    cos4: Array = (1 + (tangent**2).sum(axis=-1)) ** -2
    return cos4


def _crossing(points: Array, directions: Array, z: float) -> Array:
    """(x, y) (n, 2) at which rays (n, 3), (n, 3) cross the plane at z."""
    steps = (z - points[..., 2]) / directions[..., 2]
    crossing: Array = points[..., :2] + steps[..., None] * directions[..., :2]
    return crossing


LENSES: dict[str, type[Lens]] = {cls.KIND: cls for cls in (Perspective, Orthographic)}
"""Every lens by the word that names it in a sensor file."""
