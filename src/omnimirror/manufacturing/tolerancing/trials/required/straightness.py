"""How straight what is straight in the world is, in the straightened view of a built sensor.

A view straightens a picture by the sensor that was meant, or by what a calibration says. What a built sensor shows
elsewhere appears in another direction, and what lies on a straight line of the world, a great circle of directions, on
one no longer. Lines of 60 deg all over the field, along field angles and across them, are looked at; each is as crooked
as its points are apart at most from the great circle that fits them best.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compensation import compensators_of
from ..field import Field, field_at
from ..merits import Reference
from ..picture import Refocus
from ..states import Values

Array = NDArray[np.float64]
Motions = Callable[[Reference, Values], Array]
"""Motions (t, 2 n) px of the objects of a reference."""

LINE_DEG = 60.0
POINTS = 7
CENTRES, AZIMUTHS = 4, 8


@dataclass(frozen=True)
class StraightLines:
    """Lines (l,) of objects (p,), and what takes their departure from a motion.

    Attributes
    ----------
    reference
        Of all objects, line by line.
    across : (l, p, 2)
        Unit vectors across the lines, over field angle and round about.
    rest : (p, p)
        What a fit of a great circle leaves of departures, by points.
    """

    reference: Reference
    across: Array
    rest: Array

    @classmethod
    def of(cls, field: Field, refocus: Refocus, distance_mm: float, floor_px2: float) -> StraightLines:
        """Over the part of the field that is judged."""
        low, high = field.omega_deg.min(), field.omega_deg.max()
        omega, azimuth, across = lines_over(float(low), float(high))
        objects = field_at(field.sensor, omega.ravel(), azimuth.ravel(), distance_mm)
        shown = objects.shown({}, 1, refocus=refocus)[0].offsets_px[0]
        reference = Reference(objects, compensators_of(objects), shown, refocus, floor_px2)
        tau = np.radians(np.linspace(-0.5, 0.5, POINTS) * line_length(low, high))
        fit = np.stack([np.cos(tau), np.sin(tau)], axis=-1)
        return cls(reference, across, np.eye(POINTS) - fit @ np.linalg.pinv(fit))

    def departures(self, moved: Array) -> Array:
        """Departures (calibrations, t, l, p) in deg of motions (t, 2 n) px, and of what calibrations leave."""
        left = self.reference.compensators.left(moved)
        vectors = np.stack(np.split(left, 2, axis=-1), axis=-1)
        turned = np.einsum("nij,ctnj->ctni", np.linalg.inv(self.reference.field.px_per_deg), vectors)
        lines, points, _ = self.across.shape
        across = np.einsum("lpi,ctlpi->ctlp", self.across, turned.reshape(*turned.shape[:2], lines, points, 2))
        departures: Array = across @ self.rest
        return departures


def line_length(low_deg: float, high_deg: float) -> float:
    """Of lines within a field; where it is narrower than they are, as long as it is."""
    return min(LINE_DEG, high_deg - low_deg)


def lines_over(low_deg: float, high_deg: float) -> tuple[Array, Array, Array]:
    """Field angles and azimuths (l, p) of points of lines, and unit vectors (l, p, 2) across them.

    Lines along the field angle first; then those across, as many of them as are within the field.
    """
    length = line_length(low_deg, high_deg)
    tau = np.linspace(-0.5, 0.5, POINTS) * length
    around = np.arange(AZIMUTHS) * (360.0 / AZIMUTHS)
    omega, azimuth, across = [], [], []
    for centre in np.linspace(low_deg + length / 2, high_deg - length / 2, CENTRES):
        for phi in around:
            omega.append(centre + tau)
            azimuth.append(np.full(POINTS, phi))
            across.append(np.tile([0.0, 1.0], (POINTS, 1)))
    for centre in np.linspace(low_deg, high_deg, CENTRES):
        bent, aside, vectors = _across_at(centre, tau)
        if bent.min() < low_deg - 1e-9 or bent.max() > high_deg + 1e-9 or centre == 0:
            continue
        for phi in around:
            omega.append(bent)
            azimuth.append(phi + aside)
            across.append(vectors)
    return np.array(omega), np.array(azimuth), np.array(across)


def _across_at(omega_deg: float, tau_deg: Array) -> tuple[Array, Array, Array]:
    """Field angles, azimuths and unit vectors across, of the great circle that crosses a meridian squarely."""
    middle, tau = np.radians(omega_deg), np.radians(tau_deg)
    towards = np.array([np.sin(middle), 0.0, -np.cos(middle)])
    d = np.cos(tau)[:, None] * towards + np.sin(tau)[:, None] * np.array([0.0, 1.0, 0.0])
    normal = np.cross(towards, [0.0, 1.0, 0.0])
    omega = np.arctan2(np.hypot(d[:, 0], d[:, 1]), -d[:, 2])
    azimuth = np.arctan2(d[:, 1], d[:, 0])
    tangential = np.stack([np.cos(omega) * np.cos(azimuth), np.cos(omega) * np.sin(azimuth), np.sin(omega)], axis=-1)
    sagittal = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
    return np.degrees(omega), np.degrees(azimuth), np.stack([tangential @ normal, sagittal @ normal], axis=-1)
