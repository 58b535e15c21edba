"""How a mirror's meridian changes with its own parameters.

The formulas of conics and polynomials are analytic, so that a step into the complex plane gives their derivatives
without any loss (Squire and Trapp, 1998). A spline of slopes is linear in them, and what is left, mirrors that are
generated or sampled, has differences.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...optics.mirrors import ConicAsphere, EvenPolynomial, Mirror, SlopeSpline
from ...optics.mirrors.conics import Conic
from ...optics.mirrors.slope_spline import spline_of_slopes
from .names import NamedNumber

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Array = NDArray[np.float64]

ANALYTIC = (Conic, EvenPolynomial, ConicAsphere)
"""Mirrors whose profile is analytic in their parameters and computed so."""
COMPLEX_STEP = 1e-30
STEP = 1e-5
"""Of a parameter, or of 1 if that is larger, for differences."""


def profile_rates(mirror: Mirror, x: Array, places: tuple[NamedNumber, ...]) -> Array:
    """Derivatives (3, n, k) of sag, slope and curvature at x (n,) by k parameters of the mirror.

    Beyond the rim, those of the parabola that continues it
    (:func:`omnimirror.optics.tracing.reflection.continued_profile`).

    >>> from omnimirror.optics.mirrors import Sphere
    >>> radius = NamedNumber("mirror", "radius_mm")
    >>> profile_rates(Sphere(50.0, 40.0), np.array([30.0]), (radius,))[0].round(9)  # 1 - 50 / 40
    array([[-0.25]])
    """
    rates = np.empty((3, len(x), len(places)))
    inside = np.minimum(x, mirror.rim_radius_mm)
    if isinstance(mirror, SlopeSpline):
        rates[:] = _of_slopes(mirror, inside)[:, :, [place.item or 0 for place in places]]
    else:
        for column, place in enumerate(places):
            rates[:, :, column] = _rates(mirror, inside, place)
    beyond = (x - inside)[:, None]
    if beyond.any():
        curvature = mirror.curvature(inside)[:, None]
        bend = np.where((beyond > 0) & (curvature < 0), 0.0, rates[2])
        sag, slope = rates[0], rates[1]
        rates = np.stack([sag + slope * beyond + bend * beyond**2 / 2, slope + bend * beyond, bend])
    return rates


def _rates(mirror: Mirror, x: Array, place: NamedNumber) -> Array:
    """Derivatives (3, n) by one parameter."""
    if isinstance(mirror, ANALYTIC):
        moved = _unchecked(mirror, place, place.of(mirror) + 1j * COMPLEX_STEP)
        return np.imag(np.stack([np.asarray(a) for a in moved.profile(x)])) / COMPLEX_STEP
    value = place.of(mirror)
    step = STEP * max(abs(value), 1.0)
    ends = []
    for sign in (1.0, -1.0):
        try:
            other: Mirror = replace(mirror, **place.change(mirror, value + sign * step))  # type: ignore[type-var]
            ends.append((sign, np.stack(other.profile(x))))
        except OmnimirrorError:  # at the end of its range: one side has to do
            ends.append((0.0, np.stack(mirror.profile(x))))
    (after, high), (before, low) = ends
    rates: Array = (high - low) / ((after - before) * step)
    return rates


def _of_slopes(mirror: SlopeSpline, x: Array) -> Array:
    """Derivatives (3, n, m) by all m slopes, in which the profile is linear."""
    splines = _unit_splines(len(mirror.slopes), mirror.is_pointed)
    u, rim = x / mirror.rim_radius_mm, mirror.rim_radius_mm
    sag, slope, bend = (np.asarray(spline(u)) for spline in splines)
    rates: Array = np.stack([(sag - splines[0](0.0)) * rim, slope, bend / rim])
    return rates


@lru_cache(maxsize=8)
def _unit_splines(count: int, pointed: bool) -> tuple[BSpline, BSpline, BSpline]:
    """Integral, value and derivative of the splines of which one slope is 1 and the others 0."""
    unit = np.eye(count)
    if not pointed:
        unit[0] = 0.0
    slope = spline_of_slopes(unit)
    return slope.antiderivative(), slope, slope.derivative()


def _unchecked(mirror: Mirror, place: NamedNumber, value: complex) -> Mirror:
    """The same mirror with a complex parameter, which no constructor would take."""
    moved: Mirror = object.__new__(type(mirror))
    moved.__dict__.update(mirror.__getstate__() | place.change(mirror, value))
    return moved
