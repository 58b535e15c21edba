"""Subjects of a figure: sensors with their colours, evaluated under common conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.escaping import plot_text
from ...optics.lenses import BlurMode
from ...optics.sensor import Sensor
from ..evaluation import Evaluation, evaluate, field_angles
from .style import PALETTE

NODES = 361  # points of a curve


@dataclass(frozen=True)
class Conditions:
    """Evaluation conditions: exact with the pixels of the sensor, or according to the paper.

    Parameters
    ----------
    mode
        Blur mode: ``"exact"`` (Eq. 28) or ``"paper"`` (Eq. 29).
    image_radius_px
        Radius of the rim image to which all images are scaled; None for the real one.
    object_distance_mm
        Object distance from the mirror, for virtual images and blur.
    wavelength_nm, tolerance_px
        Wavelength of the Airy disc; permissible blur of the depth of field.
    """

    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    object_distance_mm: float = np.inf
    wavelength_nm: float = 550.0
    tolerance_px: float = 1.0

    @classmethod
    def of(cls, result: Evaluation) -> Conditions:
        """Return the conditions of an evaluation, with its nearest object distance."""
        p = float(np.min(result.object_distance_mm))
        return cls(
            result.mode, result.image_radius_px, p, result.wavelength_nm, result.tolerance_px
        )


EXACT = Conditions()
PAPER = Conditions("paper", 500.0)
"""Blur by Eq. 29, and an image circle of 2N = 1000 pixels."""


@dataclass(frozen=True)
class Subject:
    """Sensor of a figure."""

    sensor: Sensor
    colour: str
    conditions: Conditions = EXACT

    @property
    def name(self) -> str:
        """Name of the sensor for labels."""
        return plot_text(self.sensor.name)

    @property
    def objects(self) -> str:
        """Title suffix for finite object distances."""
        p = self.conditions.object_distance_mm
        return "" if np.isinf(p) else f", objects at {p:g} mm"

    @property
    def rim_mm(self) -> float:
        """Rim radius M."""
        return self.sensor.mirror.rim_radius_mm

    @property
    def radius_px(self) -> float:
        """Radius of the image circle."""
        return self.conditions.image_radius_px or self.sensor.rim_radius_px

    @cached_property
    def curve(self) -> Evaluation:
        """Evaluation of the whole field at :data:`NODES` angles."""
        return self.at(np.linspace(*self.sensor.field_deg, NODES))

    @cached_property
    def marks(self) -> Evaluation:
        """Evaluation at every 15 deg of the field."""
        return self.at(field_angles(self.sensor, 15.0))

    @property
    def obscured_deg(self) -> tuple[tuple[float, float], ...]:
        """Angular ranges of the field obscured by the housing."""
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
        """Return the side (deg) of the mean square field of view of a pixel (Sec. 3.3)."""
        low, high = np.radians(self.sensor.field_deg)
        # solid angle of the field, square degrees, per pixel of the image annulus
        field_area = 2 * np.pi * (np.cos(low) - np.cos(high)) * np.degrees(1.0) ** 2
        inner = float(self.curve.h_px[0])  # a pointed mirror has an annular image
        return float(np.sqrt(field_area / (np.pi * (self.radius_px**2 - inner**2))))


def subjects_of(sensors: Sequence[Sensor], conditions: Conditions) -> list[Subject]:
    """Return one subject per sensor, with its colour.

    Raises
    ------
    InvalidParameter
        If there is no sensor, or more sensors than colours.
    """
    if not 1 <= len(sensors) <= len(PALETTE):
        raise InvalidParameter(
            f"the number of sensors in a figure must be 1 to {len(PALETTE)}; got {len(sensors)}"
        )
    return [Subject(s, colour, conditions) for s, colour in zip(sensors, PALETTE, strict=False)]


def widest(subjects: Sequence[Subject]) -> float:
    """Return the largest field angle of all subjects, deg, rounded to 0.1 deg."""
    return round(max(s.sensor.field_deg[1] for s in subjects), 1)
