"""Polynomial and conic-asphere mirrors fitted to another one by what matters: where the image lands.

The rim keeps its radius and its viewing angle. Least squares lead near, and from there Lawson's rule, which
weighs each point by what it deviated the time before, to the least largest deviation of the image
height; the rim then shows the target's field angle or a little more. Derivatives are complex steps.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.numerics.lazy import cached_property
from ...optics.mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...optics.mirrors.aspheres import even_polynomial
from ...optics.mirrors.conics import conic_profile
from ...optics.tracing.meridian import Meridian
from .rim import MountedMirror, RimRay

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

Aim = Literal["worst-mapping", "mean-mapping", "sag"]
"""What a fit makes least: the largest deviation of the mapping, its root mean square, or that of the sag."""

NODES, TABLE = 400, 2001
STEPS, ROUNDS, MODELS = 60, 500, 8  # of least squares, of Lawson for one linear model, of such models
SETTLED = 1e-3  # relative; Lawson's rule converges slowly at the end
MOST_TERMS = 12
STEP = 1e-30  # of complex-step derivatives


class FitForm(NamedTuple):
    """``polynomial:N`` or ``asphere:N``: N even powers, from x^2, or from x^4 beside a conic."""

    kind: Literal["polynomial", "asphere"]
    terms: int

    @classmethod
    def parse(cls, text: str) -> FitForm:
        """
        >>> FitForm.parse("polynomial:4")
        FitForm(kind='polynomial', terms=4)
        """
        match = re.fullmatch(r"(polynomial|asphere):(\d{1,3})", text.strip())
        least = 1 if match and match[1] == "polynomial" else 0
        if not match or not least <= int(match[2]) <= MOST_TERMS:
            raise InvalidParameter(
                f"{text!r} is not a form to fit; valid are polynomial:N with 1 to {MOST_TERMS} terms, and asphere:N "
                f"with 0 to {MOST_TERMS} beside the conic"
            )
        return cls("polynomial" if match[1] == "polynomial" else "asphere", int(match[2]))


@dataclass(frozen=True)
class FittedMirror:
    """A fitted mirror and what it lacks of its target.

    Attributes
    ----------
    mounted
        The mirror, and the distance at which its lens sees the rim as the target's does.
    mapping
        Largest deviation of the image height at the same field angle, as a share of the rim's height
        (beyond the target's rim from the straight continuation of its mapping).
    sag_um
        Largest difference of the sags at the same x, vertices together.
    slope_mrad
        Largest difference of the slope angles at the same x.
    """

    mounted: MountedMirror
    mapping: float
    sag_um: float
    slope_mrad: float


def fit_mirror(target: MountedMirror, form: FitForm | str, aim: Aim = "worst-mapping") -> FittedMirror:
    """Fit a mirror of even powers, with or without a conic, to another one.

    Parameters
    ----------
    target
        A smooth mirror with its lens.
    form
        ``"polynomial:4"``, ``"asphere:3"`` and so on.
    aim
        What is made least.

    Raises
    ------
    InvalidParameter
        A form or aim that is not known; a pointed mirror; a form with too few terms to be found.

    Examples
    --------
    The paper's equidistant mirror has three terms and misses the line from centre to rim by .49 %:

    >>> from omnimirror.design import RimRay, generated_mirror
    >>> exact = generated_mirror("equidistant", RimRay(135.0, 12.0, 43.9))
    >>> [f"{fit_mirror(exact, f'polynomial:{n}').mapping:.4%}" for n in (3, 4)]
    ['0.0624%', '0.0055%']
    """
    if aim not in get_args(Aim):
        raise InvalidParameter(f"aim = {aim!r} is not known; valid are {', '.join(get_args(Aim))}")
    form = FitForm.parse(form) if isinstance(form, str) else form
    if target.mirror.is_pointed:
        raise InvalidParameter(
            f"the {target.mirror.KIND} mirror ends in a point, where even powers of x are smooth; fit a smooth mirror"
        )
    problem = _Problem(Meridian(target.mirror, target.distance_mm), form)
    try:
        unknowns = problem.settle(problem.start(), problem.sag)
        if aim != "sag":
            unknowns = problem.settle(unknowns, problem.deviation)
        if aim == "worst-mapping":
            unknowns = problem.level(unknowns)
        return problem.judged(unknowns)
    except OmnimirrorError:
        raise InvalidParameter(
            f"no {form.kind} of {form.terms} terms comes near this {target.mirror.KIND} mirror; take more terms"
        ) from None


class _Linear(NamedTuple):
    """Values (n,) and their derivatives (n, p)."""

    value: Array
    jacobian: Array


@dataclass(frozen=True)
class _Problem:
    """Lengths in rim radii. Unknowns: coefficients, after R and k for an asphere."""

    target: Meridian
    form: FitForm

    @property
    def rim(self) -> float:
        return self.target.mirror.rim_radius_mm

    @cached_property
    def nodes(self) -> Array:
        """Mirror points (n,), denser at the rim, where the mapping is steep; without the axis."""
        return np.sin(np.pi / 2 * np.linspace(0, 1, NODES + 1)[1:])

    @cached_property
    def target_sag(self) -> Array:
        return self.target.mirror.sag(self.nodes * self.rim) / self.rim

    def profile(self, p: Array, x: Array) -> tuple[_Linear, _Linear]:
        """Sag and slope with their derivatives by complex steps."""

        def of(p: Any) -> tuple[Any, Any]:
            if self.form.kind == "polynomial":
                z, slope, _ = even_polynomial(x, tuple(p), first=1)
                return z, slope
            z, slope, _ = conic_profile(x, p[0], p[1])
            dz, dslope, _ = even_polynomial(x, tuple(p[2:]), first=2) if p.size > 2 else (0.0, 0.0, 0.0)
            return z + dz, slope + dslope

        z, slope = of(p)
        bent = [of(p + 1j * STEP * unit) for unit in np.eye(p.size)]
        return (
            _Linear(z, np.stack([b[0].imag for b in bent], axis=-1) / STEP),
            _Linear(slope, np.stack([b[1].imag for b in bent], axis=-1) / STEP),
        )

    def start(self) -> Array:
        """The target's vertex radius, with the conic constant that has its slope at the rim."""
        curvature = float(self.target.mirror.curvature(0.0)) * self.rim
        if self.form.kind == "polynomial":
            return np.array([curvature / 2] + [0.0] * (self.form.terms - 1))
        slope = float(self.target.mirror.slope(self.rim))
        return np.array([1 / curvature, 1 / curvature**2 - 1 / slope**2 - 1] + [0.0] * self.form.terms)

    def sag(self, p: Array) -> _Linear:
        z, _ = self.profile(p, self.nodes)
        return _Linear(z.value - self.target_sag, z.jacobian)

    def deviation(self, p: Array) -> _Linear:
        """Image height less that of the target at the same field angle, to first order, in rim heights."""
        x, (z, slope), (end, _) = self.nodes, self.profile(p, self.nodes), self.profile(p, np.ones(1))
        dbeta = slope.jacobian / (1 + slope.value**2)[:, None]
        if np.isinf(self.target.m):
            theta, tau, dtheta, dtau = 0.0, x, 0.0, np.zeros_like(z.jacobian)
        else:
            tangent = np.tan(self.target.theta_max)
            w = 1 / tangent - end.value + z.value
            dw = z.jacobian - end.jacobian
            theta, tau = np.arctan2(x, w), x / w / tangent
            dtheta, dtau = -(x / (w**2 + x**2))[:, None] * dw, -(x / w**2 / tangent)[:, None] * dw
        omega, rate = self._target_at(tau)
        value = (omega - 2 * np.arctan(slope.value) - theta) / rate
        return _Linear(value, dtau - (2 * dbeta + dtheta) / rate[:, None])

    @cached_property
    def _target_mapping(self) -> tuple[Curve, Curve]:
        """Field angle of the target and dOmega/dtau against image height tau, from a fine table."""
        from scipy.interpolate import CubicHermiteSpline

        rays = self.target.trace(np.sin(np.pi / 2 * np.linspace(0, 1, TABLE)) * self.rim)
        rate = rays.domega_dx()
        if np.isinf(self.target.m):
            tau, rate = rays.x / self.rim, rate * self.rim
        else:
            tangent = np.tan(self.target.theta_max)
            tau, rate = rays.x / rays.w / tangent, rate * rays.w**2 / (rays.w - rays.x * rays.slope) * tangent
        spline = CubicHermiteSpline(tau, rays.omega, rate)
        return spline, spline.derivative()

    def _target_at(self, tau: Array) -> tuple[Array, Array]:
        """Field angle of the target and dOmega/dtau at image heights tau."""
        omega, rate = (curve(np.minimum(tau, 1.0)) for curve in self._target_mapping)
        return omega, rate

    def settle(self, p: Array, residual: Callable[[Array], _Linear]) -> Array:
        """Least squares; beside a conic each time from the solution with a term less, as they trade widely."""
        for count in range(2 if self.form.kind == "asphere" else p.size, p.size + 1):
            p = np.append(self._least_squares(p[:count], p[count:], residual), p[count:])
        return p

    def _least_squares(self, head: Array, tail: Array, residual: Callable[[Array], _Linear]) -> Array:
        """The first unknowns by a trust-region method, the others held."""
        from scipy.optimize import least_squares

        def value(h: Array) -> Array:
            found = self._safely(residual, np.append(h, tail))
            return np.full(NODES, np.nan) if found is None else found.value

        def jacobian(h: Array) -> Array:
            return residual(np.append(h, tail)).jacobian[:, : h.size]

        tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": STEPS}
        solution: Array = least_squares(value, head, jac=jacobian, x_scale="jac", **tight).x
        return solution

    def level(self, p: Array) -> Array:
        """The largest deviation made least, from the least squares; the best met on the way."""
        q = self._levelled(p, hold=False)
        return q if self.deviation(q).value[-1] <= 0 else self._with_rim(self._levelled(p, hold=True))

    def _with_rim(self, p: Array) -> Array:
        """The least change after which the rim shows what the target's does, and a rounding more."""
        for _ in range(5):  # by Newton's rule
            linear = self.deviation(p)
            row = linear.jacobian[-1]
            p = p - row * (linear.value[-1] + 1e-13) / (row @ row)
        return p

    def _levelled(self, p: Array, hold: bool) -> Array:
        """By linear models, each followed as far as it holds; ``hold`` makes the rim show what the target's does."""
        worst = np.inf if hold else self._worst(self.deviation(p))  # holding the rim may cost something
        for _ in range(MODELS):
            aim = self._lawson(p, self.deviation(p), hold)
            for share in (1.0, 0.5, 0.25, 0.1) if worst < np.inf else (1.0,):
                there = self._safely(self.deviation, p + share * (aim - p))
                if there is not None and self._worst(there) < worst:
                    break
            else:
                return p
            gain = worst - self._worst(there)
            p, worst = p + share * (aim - p), self._worst(there)
            if gain < SETTLED * worst:
                return p
        return p

    def _lawson(self, p: Array, linear: _Linear, hold: bool) -> Array:
        """Where the largest deviation of a linear model is least; with ``hold``, 0 at the rim."""
        value, J = linear.value, linear.jacobian / (size := np.linalg.norm(linear.jacobian, axis=0))
        onto, free = np.zeros(p.size), np.eye(p.size)
        if hold:
            row = J[-1]
            onto = -row * value[-1] / (row @ row)
            free = np.linalg.svd(row[None, :])[2][1:].T  # directions that leave the rim alone
        value, J = value + J @ onto, np.linalg.qr(J @ free)[0]
        weights, best, least = np.full(NODES, 1 / NODES), value, np.inf
        for _ in range(ROUNDS):
            root = np.sqrt(weights)
            rest = value - J @ np.linalg.lstsq(root[:, None] * J, root * value, rcond=None)[0]
            distance = np.abs(rest)
            if distance.max() < least:
                best, least = rest, float(distance.max())
            if distance.max() <= (1 + SETTLED) * float(weights @ distance):  # the mean is a lower bound
                break
            weights = weights * distance / float(weights @ distance)
        y = np.linalg.lstsq(linear.jacobian / size @ free, best - value, rcond=None)[0]
        found: Array = p + (onto + free @ y) / size
        return found

    @staticmethod
    def _worst(linear: _Linear) -> float:
        return float(np.abs(linear.value).max())

    @staticmethod
    def _safely(residual: Callable[[Array], _Linear], p: Array) -> _Linear | None:
        """The residual, or None where the unknowns make no mirror."""
        try:
            with np.errstate(all="ignore"):
                found = residual(p)
        except OmnimirrorError:
            return None
        return found if np.isfinite(found.value).all() and np.isfinite(found.jacobian).all() else None

    def mirror(self, p: Array) -> Mirror:
        if self.form.kind == "polynomial":
            return EvenPolynomial(tuple(p), self.rim, self.rim)
        return ConicAsphere(float(p[0]) * self.rim, float(p[1]), self.rim, tuple(p[2:]), self.rim)

    def judged(self, p: Array) -> FittedMirror:
        """The mirror with its deviations, from its own chief rays."""
        mirror, target = self.mirror(p), self.target
        theta = float(np.degrees(target.theta_max))
        mounted = RimRay(float(np.degrees(target.omega_max)), theta, self.rim).place(mirror)
        x = np.linspace(0, 1, 4 * NODES)[1:] * self.rim
        rays = Meridian(mirror, mounted.distance_mm).trace(x)
        inside = np.minimum(rays.omega, target.omega_max)
        wanted = target.trace(target.x_from_omega(inside))
        height, aim = (r.x / (self.rim if np.isinf(r.m) else r.w * np.tan(target.theta_max)) for r in (rays, wanted))
        _, rate = self._target_at(np.ones(1))
        aim = aim + (rays.omega - inside) / rate
        z, slope, _ = target.mirror.profile(x)
        return FittedMirror(
            mounted,
            float(np.abs(height - aim).max()),
            float(np.abs(rays.z - z).max()) * 1e3,
            float(np.abs(rays.beta - np.arctan(slope)).max()) * 1e3,
        )
