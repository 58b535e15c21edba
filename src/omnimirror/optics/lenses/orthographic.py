"""Telecentric lens: all chief rays are parallel to its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import choice, coordinates, number
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import BLUR_MODES, F_NUMBER, BlurMode, DepthOfField, Lens, ThroughFocus, crossing


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
        "magnification": Parameter("", 1e-5, 1e3, "image size over object size (mu)"),
        "working_f_number": F_NUMBER,
        "focus_distance_mm": Parameter("mm", -1e6, 1e6, "object plane in focus (L0), from the mirror vertex"),
    }

    def __post_init__(self) -> None:
        self._check()

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.magnification * x

    def ideal_height_rate(self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0) -> Array:
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
        in_focus = np.concatenate([image / self.magnification, np.full((len(image), 1), self.focus_distance_mm)], 1)
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
        reach = number("tolerance", tolerance, low=0, unit="mm") * self.working_f_number / self.magnification**2
        return DepthOfField(self.focus_distance_mm - reach, self.focus_distance_mm + reach)
