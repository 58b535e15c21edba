"""The sphere closest to a mirror, and how far the mirror departs from it: what a workshop starts from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..mirrors import Mirror
from .forms import nodes

Array = NDArray[np.float64]
Merit = Literal["least-squares", "least-departure"]
FITS = ("least-squares", "least-departure")


@dataclass(frozen=True)
class BestSphere:
    """A sphere about (0, centre_z_mm), and the mirror's departure from it; a radius below 0 is hollow, inf a plane.

    Departures are measured along the sphere's normal and are positive where a spherical blank has
    material to be removed. The RMS is the mean over the aperture, weighted by projected area.

    Attributes
    ----------
    radius_mm, centre_z_mm
    peak_to_valley_um, rms_um : departure
    slope_mrad : largest angle between mirror and sphere
    """

    merit: str
    radius_mm: float
    centre_z_mm: float
    peak_to_valley_um: float
    rms_um: float
    slope_mrad: float

    def departure_um(self, mirror: Mirror, x_mm: ArrayLike) -> Array:
        """Departure (n,) of the mirror at distances x from the axis, um."""
        x = np.asarray(x_mm, dtype=float)
        if np.isinf(self.radius_mm):
            return np.zeros_like(x)
        away = np.sign(self.radius_mm) * np.hypot(x, self.centre_z_mm - mirror.sag(x))
        departure: Array = 1e3 * (self.radius_mm - away)
        return departure


def best_sphere(mirror: Mirror, merit: Merit = "least-squares") -> BestSphere:
    """The closest sphere, by the mean square of the departure or by its peak to valley.

    Raises
    ------
    InvalidParameter
        A merit that is not known, or a mirror that no sphere comes near (flat, but not a plane).

    Examples
    --------
    >>> from omnimirror.mirrors import Paraboloid, Sphere
    >>> best_sphere(Sphere(50.0, 40.0)).radius_mm.__round__(9)
    50.0
    >>> sphere = best_sphere(Paraboloid(100.0, 20.0), "least-departure")
    >>> round(sphere.radius_mm, 2), round(sphere.peak_to_valley_um, 1)
    (101.0, 5.0)
    """
    if merit not in FITS:
        raise InvalidParameter(f"merit = {merit!r} is not one of {', '.join(FITS)}")
    x = nodes(mirror, 2001)
    z, slope, _ = mirror.profile(x)
    if not np.any(z):
        return BestSphere(merit, np.inf, np.inf, 0.0, 0.0, 0.0)
    sense = float(np.sign(z[-1]))
    z, slope = sense * z, sense * slope  # a hollow mirror from behind
    chord = 2 * z[-1] / (x[-1] ** 2 + z[-1] ** 2)  # 1/R of the sphere through vertex and rim
    if chord < 1e-9:
        raise InvalidParameter("the mirror is nearly flat: there is no sphere near it")
    area = x * np.gradient(x)
    area /= area.sum()
    centre = _least_squares_centre(x, z, area, float(1 / chord))
    if merit == "least-departure":
        centre = _least_departure_centre(x, z, centre)
    d = np.hypot(x, centre - z) - centre
    offset = float(area @ d) if merit == "least-squares" else float(d.max() + d.min()) / 2
    departure = offset - d
    angle = np.arctan(slope) - np.arctan2(x, centre - z)
    return BestSphere(
        merit,
        radius_mm=sense * (centre + offset),
        centre_z_mm=sense * centre,
        peak_to_valley_um=float(1e3 * np.ptp(departure)),
        rms_um=float(1e3 * np.sqrt(area @ departure**2)),
        slope_mrad=float(1e3 * np.abs(angle[1:] if mirror.is_pointed else angle).max()),
    )


def _least_squares_centre(x: Array, z: Array, weight: Array, centre: float) -> float:
    """Gauss and Newton's rule for the height of the centre; the radius is the mean distance from it."""
    for _ in range(100):
        d = np.hypot(x, centre - z)
        rate = (centre - z) / d
        d, rate = d - weight @ d, rate - weight @ rate
        step = float((weight * rate) @ d / ((weight * rate) @ rate))
        centre -= step
        if abs(step) <= 1e-15 * abs(centre):
            break
    return float(centre)


def _least_departure_centre(x: Array, z: Array, start: float) -> float:
    """Where the distances differ least: the spread is a convex function with a kink at its minimum."""
    from scipy.optimize import minimize_scalar

    def spread(bow: float) -> float:
        return float(np.ptp(np.hypot(x, 1 / bow - z) - 1 / bow))

    bounds = (0.3 / start, 3 / start)
    return 1 / float(minimize_scalar(spread, bounds=bounds, method="bounded", options={"xatol": 1e-13 / start}).x)
