"""Lenses: how a virtual image behind the mirror becomes a height and a blur on the imager.

A lens is told by what it does in front of it: chief rays aim at its entrance pupil (:mod:`.pupil`), a flat disk;
then the blur needs no obliquity factor. Focusing changes the image distance b0 only (internal focusing, as in the
paper) and leaves principal point and pupil where they are.

Object distances ``L`` count from the lens's reference point along the axis: the principal point of a
perspective lens (Eqs. 34, 35), the mirror vertex under an orthographic one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from .pupil import IN_REFERENCE_POINT, EntrancePupil

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
    """What the evaluation asks of a lens. ``w`` is the axial distance from its entrance pupil to a mirror point."""

    KIND: ClassVar[str]
    PARAMETERS: ClassVar[dict[str, Parameter]]
    TELECENTRIC: ClassVar[bool]
    IS_THIN: ClassVar[bool] = True
    """Whether one entrance pupil and one plane in focus say all of it."""

    focus_distance_mm: float

    @property
    def pupil(self) -> EntrancePupil:
        """What chief rays aim at; it stays where it is while the lens is focused."""
        return IN_REFERENCE_POINT

    @property
    def nearest_focus_mm(self) -> float:
        """Object distance (mm) beyond which it could be focused at all."""
        return 0.0

    @abstractmethod
    def ideal_height(self, x: Array, w: Array) -> Array:
        """Image height (mm) of the mirror point at distance x from the axis under a lens without distortion (Eq. 7)."""

    @abstractmethod
    def ideal_height_rate(self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0) -> Array:
        """Its derivative by x along the meridian, dimensionless; ``drift`` is the pupil's, mm per radian."""

    def image_height(self, x: Array, w: Array) -> Array:
        """Image height h (mm) of the mirror point at distance x from the axis: Eq. 7, and radial distortion."""
        return self.distorted_height(self.ideal_height(x, w))

    def image_height_rate(self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0) -> Array:
        """dh/dx along the meridian, dimensionless."""
        return self.stretch(self.ideal_height(x, w))[0] * self.ideal_height_rate(x, w, slope, drift)

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

    def blur_stretch(self, ideal: Array) -> tuple[Array, Array]:
        """By how much (n,), (n,) a blur at ideal heights (n,) mm is wider than on the axis, out of focus by as much."""
        return self.stretch(ideal)

    def image_coordinates(self, L_t: Array, L_s: Array, ideal: Array) -> tuple[Array, Array]:
        """Focus coordinates (n,), (n,) of tangential and sagittal images at L (mm) seen at ideal heights (n,) mm.

        Those at which the lens would have to be focused: what curvature of the field and astigmatism do is in them.
        """
        return self.focus_coordinate(L_t), self.focus_coordinate(L_s)

    def own_blur(self, ideal: Array) -> tuple[Array, Array]:
        """Blur (n,), (n,) mm of the lens alone in its own tangential and sagittal focus."""
        return np.zeros_like(ideal), np.zeros_like(ideal)

    @abstractmethod
    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        """Points (n, 3) mm of the entrance pupil that belong to points (n, 2) of the unit disk of the aperture.

        ``chief`` are the slopes (n, 2) of the chief rays; without them that of rays near the axis.

        In the frame of the lens's reference point, X and Y as in the unflipped picture, Z towards the
        mirror. Under a telecentric lens, which sees from infinitely far away: unit vectors towards it.
        """

    @abstractmethod
    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        """Derivatives (n, 2, 3) of :meth:`entrance_pupil_points` by the two coordinates of the aperture."""

    @abstractmethod
    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        """Origins and directions (n, 3) of rays from image points (n, 2) mm through aperture points to the mirror.

        An ideal thin lens: all rays of an image point meet in the plane in focus. Origins lie in the
        plane of the lens; under a telecentric one, in the plane in focus.
        """

    @abstractmethod
    def image_of(self, points: Array, directions: Array) -> Array:
        """Image points (n, 2) mm of rays from the mirror, given by points and directions (n, 3) on them."""

    def clearances(self, points: Array, directions: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at the edges of the lens, by name; below 0 where these block them.

        Rays are given by points and directions (n, 3) on them, in the frame of the lens's reference point. The stop is
        not among the edges: rays are sampled within it. An ideal lens has no others.
        """
        return {}

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """Return the relative illumination (n,) at image points (n, 2) mm under a uniform radiance, against the axis.

        With points (n, 2) of the unit disk of the aperture, return the natural falloff (cos^4) of light by way of
        these, without the vignetting that :meth:`clearances` describes.
        """
        tangent = np.zeros_like(image) if pupil is None else pupil / (2 * self.image_f_number())
        return cos4(tangent)

    @abstractmethod
    def focus_coordinate(self, L: ArrayLike) -> Array:
        """The place of object distances L (mm) on the scale on which blur is linear."""

    @abstractmethod
    def distance_of(self, coordinate: ArrayLike) -> Array:
        """Object distances L (mm) of places on that scale."""

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

    @property
    @abstractmethod
    def stop_number(self) -> float:
        """F-number that the lens is set to: f/D focused at infinity; of a telecentric lens that towards the imager."""

    def image_f_number(self) -> float:
        """Working F-number F_w of the cone of light that reaches the imager; sets the Airy disk."""
        return float(self.through_focus(self.focus_coordinate(self.focus_distance_mm)).f_number)

    def focused_at(self, focus_distance_mm: float) -> Self:
        """The same lens focused elsewhere."""
        return replace(self, focus_distance_mm=focus_distance_mm)  # type: ignore[type-var]

    def at_wavelength(self, wavelength_nm: float) -> Self:
        """The lens as it is for light of a wavelength, its imager where it is; an ideal one is the same for all."""
        return self

    def airy_diameter(self, wavelength_nm: float = 550.0) -> float:
        """Diameter of the Airy disk on the imager, mm: 2.44 lambda F_w."""
        if not 100.0 <= number("wavelength_nm", wavelength_nm) <= 20000.0:
            raise InvalidParameter(f"wavelength_nm = {wavelength_nm:g} is outside 100 to 20000 nm")
        return 2.44 * wavelength_nm * 1e-6 * self.image_f_number()

    @classmethod
    def from_spec(cls, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """The lens table of a sensor file, files that it names followed; without a folder it may name none."""
        return data

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the parameters alone; what was computed from them is computed again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def _check(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]
            self.PARAMETERS[f.name].check(f.name, number(f.name, getattr(self, f.name)))


def cos4(tangent: Array) -> Array:
    """Fourth power (n,) of the cosine of angles whose tangents are (n, 2)."""
    power: Array = (1 + (tangent**2).sum(axis=-1)) ** -2
    return power


def crossing(points: Array, directions: Array, z: float) -> Array:
    """(x, y) (n, 2) at which rays (n, 3), (n, 3) cross the plane at z."""
    steps = (z - points[..., 2]) / directions[..., 2]
    met: Array = points[..., :2] + steps[..., None] * directions[..., :2]
    return met
