"""Derivatives of a mirror's meridian with respect to its parameters.

The formulas of conics and polynomials are analytic: complex-step differentiation is exact
(Squire and Trapp, 1998). A spline of slopes is linear in its parameters. Other mirrors, generated
or sampled, use finite differences.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...optics.mirrors import ConicAsphere, EvenPolynomial, Mirror, SlopeSpline
from ...optics.mirrors.conics import Conic
from ...optics.mirrors.slope_spline import spline_of_slopes
from .names import NamedNumber

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


ANALYTIC = (Conic, EvenPolynomial, ConicAsphere)
"""Mirrors whose profile is an analytic function of their parameters and accepts complex values."""
COMPLEX_STEP = 1e-30
STEP = 1e-5
"""Step of finite differences, relative to the parameter or to 1 if larger."""


def profile_rates(mirror: Mirror, x: Array, places: tuple[NamedNumber, ...]) -> Array:
    """Return derivatives (3, n, k) of sag, slope and curvature at x (n,) by k mirror parameters.

    Beyond the rim, they are those of the parabola that continues it
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
    """Return derivatives (3, n) with respect to one parameter."""
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
        except OmnimirrorError:  # at the limit of its range: one-sided difference
            ends.append((0.0, np.stack(mirror.profile(x))))
    (after, high), (before, low) = ends
    rates: Array = (high - low) / ((after - before) * step)
    return rates


def _of_slopes(mirror: SlopeSpline, x: Array) -> Array:
    """Return derivatives (3, n, m) with respect to all m slopes, in which the profile is linear."""
    splines = _unit_splines(len(mirror.slopes), mirror.is_pointed)
    u, rim = x / mirror.rim_radius_mm, mirror.rim_radius_mm
    sag, slope, bend = (np.asarray(spline(u)) for spline in splines)
    rates: Array = np.stack([(sag - splines[0](0.0)) * rim, slope, bend / rim])
    return rates


@lru_cache(maxsize=8)
def _unit_splines(count: int, pointed: bool) -> tuple[BSpline, BSpline, BSpline]:
    """Return integral, value and derivative of the splines with one slope 1 and the others 0."""
    unit = np.eye(count)
    if not pointed:
        unit[0] = 0.0
    slope = spline_of_slopes(unit)
    return slope.antiderivative(), slope, slope.derivative()


def _unchecked(mirror: Mirror, place: NamedNumber, value: complex) -> Mirror:
    """Return the mirror with a complex parameter, bypassing the checks of its constructor."""
    moved: Mirror = object.__new__(type(mirror))
    moved.__dict__.update(mirror.__getstate__() | place.change(mirror, value))
    return moved
