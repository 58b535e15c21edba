"""What a figure draws: sensors with a colour each, evaluated under the same conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter
from ...base.escaping import plot_text
from ...base.numerics.lazy import cached_property
from ...optics.lenses import BlurMode
from ...optics.sensor import Sensor
from ..evaluation import Evaluation, evaluate, field_angles
from .style import PALETTE

Array = NDArray[np.float64]

NODES = 361  # points of a curve


@dataclass(frozen=True)
class Conditions:
    """Under which conditions quantities are computed: exactly and in the sensor's own pixels, or as the paper does.

    Parameters
    ----------
    mode
        Of the blur: ``"exact"`` (Eq. 28) or ``"paper"`` (Eq. 29).
    image_radius_px
        Radius to which the image of every rim is scaled; None for the real one.
    object_distance_mm
        Distance from mirror to object, of virtual images and blur.
    wavelength_nm, tolerance_px
        Of the Airy disk; permissible blur of the depth of field.
    """

    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    object_distance_mm: float = np.inf
    wavelength_nm: float = 550.0
    tolerance_px: float = 1.0

    @classmethod
    def of(cls, result: Evaluation) -> Conditions:
        """How an evaluation was computed; of several object distances the nearest."""
        p = float(np.min(result.object_distance_mm))
        return cls(result.mode, result.image_radius_px, p, result.wavelength_nm, result.tolerance_px)


EXACT = Conditions()
PAPER = Conditions("paper", 500.0)
"""Eq. 29 for the blur, and an image circle of 2N = 1000 pixels."""


@dataclass(frozen=True)
class Subject:
    """One sensor of a figure."""

    sensor: Sensor
    colour: str
    conditions: Conditions = EXACT

    @property
    def name(self) -> str:
        """Name of the sensor, as a label of a figure."""
        return plot_text(self.sensor.name)

    @property
    def objects(self) -> str:
        """What is said where objects are not distant."""
        p = self.conditions.object_distance_mm
        return "" if np.isinf(p) else f", objects at {p:g} mm"

    @property
    def rim_mm(self) -> float:
        """M."""
        return self.sensor.mirror.rim_radius_mm

    @property
    def radius_px(self) -> float:
        """Radius of the image circle."""
        return self.conditions.image_radius_px or self.sensor.rim_radius_px

    @cached_property
    def curve(self) -> Evaluation:
        """The field from end to end at :data:`NODES` angles."""
        return self.at(np.linspace(*self.sensor.field_deg, NODES))

    @cached_property
    def marks(self) -> Evaluation:
        """Every 15 deg of the field."""
        return self.at(field_angles(self.sensor, 15.0))

    @property
    def hidden_deg(self) -> tuple[tuple[float, float], ...]:
        """Rings of the field that what stands around the mirror hides, from where to where."""
        return tuple(ring.omega_deg for ring in self.sensor.obscured)

    def at(self, omega_deg: ArrayLike) -> Evaluation:
        """Evaluate field angles (n,), deg."""
        return evaluate(
            self.sensor,
            omega_deg,
            object_distance_mm=self.conditions.object_distance_mm,
            mode=self.conditions.mode,
            image_radius_px=self.conditions.image_radius_px,
            wavelength_nm=self.conditions.wavelength_nm,
            tolerance_px=self.conditions.tolerance_px,
        )

    def mean_pixel_deg(self) -> float:
        """Side (deg) of the square that a pixel of the image circle sees on average (Sec. 3.3)."""
        low, high = np.radians(self.sensor.field_deg)
        seen = 2 * np.pi * (np.cos(low) - np.cos(high)) * np.degrees(1.0) ** 2
        inner = float(self.curve.h_px[0])  # a pointed mirror leaves a hole in the image circle
        return float(np.sqrt(seen / (np.pi * (self.radius_px**2 - inner**2))))


def subjects_of(sensors: Sequence[Sensor], conditions: Conditions) -> list[Subject]:
    """One subject per sensor, in its colour.

    Raises
    ------
    InvalidParameter
        No sensor, or more than there are colours.
    """
    if not 1 <= len(sensors) <= len(PALETTE):
        raise InvalidParameter(f"{len(sensors)} sensors do not fit into a figure; it takes 1 to {len(PALETTE)}")
    return [Subject(s, colour, conditions) for s, colour in zip(sensors, PALETTE, strict=False)]


def widest(subjects: Sequence[Subject]) -> float:
    """Largest field angle of all, deg, rounded to what was meant by 135.005."""
    return round(max(s.sensor.field_deg[1] for s in subjects), 1)
