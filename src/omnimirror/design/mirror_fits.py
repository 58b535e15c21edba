"""Mirrors fitted to a target mirror: polynomials and conic aspheres, and mirrors of any class.

The rim radius and its viewing angle are preserved. A least-squares solution is the initial value of
Lawson's algorithm, which reweights each point by its previous deviation to minimise the largest
deviation of the image height. The rim then has the field angle of the target or slightly more.
Derivatives are complex steps.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from ..base.caching import cached_property
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.optimisation import LinearisedValues, ObjectiveValues, solve_minimax
from ..base.typing import Array
from ..optics.mirrors import ConicAsphere, EvenPolynomial, Mirror
from ..optics.mirrors.mirror import conic_profile
from ..optics.tracing.meridian import Meridian
from .mirror_construction import MountedMirror, RimRay

Curve = Callable[[Array], Array]

Aim = Literal["worst-mapping", "mean-mapping", "sag"]
"""Objective of a fit: largest or RMS deviation of the mapping, or RMS deviation of the sag."""

NODES, TABLE = 400, 2001
STEPS = 60  # maximum steps of least squares
SETTLED = 1e-4  # relative decrease of the largest deviation that ends the search
EXACT, RIM_TOLERANCE = (
    1e-12,
    1e-13,
)  # deviations that are not reduced further; deviation of the rim after a correction
CLOSE = 1e-12  # relative tolerance of least squares
MAX_TERMS = 12
STEP = 1e-30  # step of complex-step derivatives


class FitForm(NamedTuple):
    """Even powers of ``polynomial:N`` (from x^2) or ``asphere:N`` (conic, and powers from x^4)."""

    kind: Literal["polynomial", "asphere"]
    terms: int

    @classmethod
    def parse(cls, text: str) -> FitForm:
        """Parse a form such as ``polynomial:4`` or ``asphere:3``.

        >>> FitForm.parse("polynomial:4")
        FitForm(kind='polynomial', terms=4)
        """
        match = re.fullmatch(r"(polynomial|asphere):(\d{1,3})", text.strip())
        minimum = 1 if match and match[1] == "polynomial" else 0
        if not match or not minimum <= int(match[2]) <= MAX_TERMS:
            raise InvalidParameter(
                f"fit must be polynomial:N with 1 to {MAX_TERMS} terms, or asphere:N with "
                f"0 to {MAX_TERMS} terms in addition to the conic; got {text!r}"
            )
        return cls("polynomial" if match[1] == "polynomial" else "asphere", int(match[2]))


@dataclass(frozen=True)
class FittedMirror:
    """Fitted mirror with its deviations from the target.

    Attributes
    ----------
    mounted
        Mirror at the distance of equal viewing angle of the rim.
    mapping
        Largest deviation of the image height at equal field angle, relative to the rim height
        (beyond the rim of the target, from the linear extrapolation of its mapping).
    sag_um
        Largest difference of the sag at equal x, with coincident vertices.
    slope_mrad
        Largest difference of the slope angle at equal x.
    """

    mounted: MountedMirror
    mapping: float
    sag_um: float
    slope_mrad: float


def fit_mirror(
    target: MountedMirror, form: FitForm | str, aim: Aim = "worst-mapping"
) -> FittedMirror:
    """Fit an even-power mirror, with or without a conic, to a target mirror.

    Parameters
    ----------
    target
        Smooth mirror with its lens distance.
    form
        Form of the fit, for example ``"polynomial:4"`` or ``"asphere:3"``.
    aim
        Objective of the fit.

    Raises
    ------
    InvalidParameter
        If form or aim are unknown, the mirror is pointed, or the form has too few terms.

    Examples
    --------
    The equidistant mirror of the paper has three terms and departs from linearity by 0.49 %:

    >>> from omnimirror.design import RimRay, generated_mirror
    >>> exact = generated_mirror("equidistant", RimRay(135.0, 12.0, 43.9))
    >>> [f"{fit_mirror(exact, f'polynomial:{n}').mapping:.4%}" for n in (3, 4)]
    ['0.0624%', '0.0055%']
    """
    if aim not in get_args(Aim):
        raise InvalidParameter(f"aim must be one of {', '.join(get_args(Aim))}; got {aim!r}")
    form = FitForm.parse(form) if isinstance(form, str) else form
    if target.mirror.is_pointed:
        raise InvalidParameter(
            f"the {target.mirror.KIND} mirror must be smooth at the apex for a fit of even powers; it is pointed"
        )
    problem = _Problem(Meridian(target.mirror, target.distance_mm), form)
    try:
        unknowns = problem.settle(problem.start(), problem.sag)
        if aim != "sag":
            unknowns = problem.settle(unknowns, problem.deviation)
        if aim == "worst-mapping":
            unknowns = problem.level(unknowns)
        return problem.fitted_mirror(unknowns)
    except OmnimirrorError:
        raise InvalidParameter(
            f"no {form.kind} of {form.terms} terms approximates this {target.mirror.KIND} mirror; use more terms"
        ) from None


class _Linear(NamedTuple):
    """Values (n,) with their derivatives (n, p)."""

    value: Array
    jacobian: Array


@dataclass(frozen=True)
class _Problem:
    """Fit problem with lengths in rim radii. Unknowns: (R and k of an asphere,) coefficients."""

    target: Meridian
    form: FitForm

    @property
    def rim(self) -> float:
        return self.target.mirror.rim_radius_mm

    @cached_property
    def nodes(self) -> Array:
        """Mirror points (n,) without the axis, denser near the rim, the region of steep mapping."""
        return np.sin(np.pi / 2 * np.linspace(0, 1, NODES + 1)[1:])

    @cached_property
    def target_sag(self) -> Array:
        return self.target.mirror.sag(self.nodes * self.rim) / self.rim

    @cached_property
    def _powers(self) -> tuple[Array, Array]:
        """Even powers of the form and their derivatives (n, terms) at the nodes."""
        n = 2 * (np.arange(self.form.terms) + self._first_power)
        x = self.nodes[:, None]
        return x**n, np.asarray(n * x ** (n - 1.0), dtype=float)

    @property
    def _first_power(self) -> int:
        """Half the exponent of the first power."""
        return 1 if self.form.kind == "polynomial" else 2

    def profile(self, p: Array) -> tuple[_Linear, _Linear]:
        """Return sag and slope at the nodes with their derivatives.

        Both are linear in the coefficients; the derivatives with respect to R and k of an asphere
        are complex steps.
        """
        powers, rates = self._powers
        if self.form.kind == "polynomial":
            return _Linear(powers @ p, powers), _Linear(rates @ p, rates)
        z, slope, _ = conic_profile(self.nodes, p[0], p[1])
        bent = [
            conic_profile(self.nodes, p[0] + a, p[1] + b)
            for a, b in ((1j * STEP, 0.0), (0.0, 1j * STEP))
        ]
        dz, dslope = (np.stack([step[i].imag for step in bent], axis=-1) / STEP for i in (0, 1))
        return (
            _Linear(z + powers @ p[2:], np.hstack([dz, powers])),
            _Linear(slope + rates @ p[2:], np.hstack([dslope, rates])),
        )

    def start(self) -> Array:
        """Return the initial value from the target's vertex radius and rim slope."""
        curvature = float(self.target.mirror.curvature(0.0)) * self.rim
        if self.form.kind == "polynomial":
            return np.array([curvature / 2] + [0.0] * (self.form.terms - 1))
        slope = float(self.target.mirror.slope(self.rim))
        return np.array(
            [1 / curvature, 1 / curvature**2 - 1 / slope**2 - 1] + [0.0] * self.form.terms
        )

    def sag(self, p: Array) -> _Linear:
        z, _ = self.profile(p)
        return _Linear(z.value - self.target_sag, z.jacobian)

    def deviation(self, p: Array) -> _Linear:
        """Return the first-order deviation of the image height, in rim heights."""
        x, (z, slope) = self.nodes, self.profile(p)  # the last node is the rim
        dbeta = slope.jacobian / (1 + slope.value**2)[:, None]
        if np.isinf(self.target.m):
            theta, tau, dtheta, dtau = 0.0, x, 0.0, np.zeros_like(z.jacobian)
        else:
            tangent = np.tan(self.target.theta_max)
            w = 1 / tangent - z.value[-1] + z.value
            dw = z.jacobian - z.jacobian[-1]
            theta, tau = np.arctan2(x, w), x / w / tangent
            dtheta, dtau = -(x / (w**2 + x**2))[:, None] * dw, -(x / w**2 / tangent)[:, None] * dw
        omega, rate = self._target_at(tau)
        # Omega = 2 beta + theta (Eqs. 2-5). The difference from the target at equal image height,
        # divided by dOmega/dtau, is to first order the deviation of the height at equal Omega.
        value = (omega - 2 * np.arctan(slope.value) - theta) / rate
        return _Linear(value, dtau - (2 * dbeta + dtheta) / rate[:, None])

    @cached_property
    def _target_mapping(self) -> tuple[Curve, Curve]:
        """Field angle of the target and dOmega/dtau as functions of the image height tau."""
        from scipy.interpolate import CubicHermiteSpline

        rays = self.target.trace(np.sin(np.pi / 2 * np.linspace(0, 1, TABLE)) * self.rim)
        rate = rays.domega_dx()
        if np.isinf(self.target.m):
            tau, rate = rays.x / self.rim, rate * self.rim
        else:
            tangent = np.tan(self.target.theta_max)
            tau, rate = (
                rays.x / rays.w / tangent,
                rate * rays.w**2 / (rays.w - rays.x * rays.slope) * tangent,
            )
        spline = CubicHermiteSpline(tau, rays.omega, rate)
        return spline, spline.derivative()

    def _target_at(self, tau: Array) -> tuple[Array, Array]:
        """Return the field angle of the target and dOmega/dtau at image heights tau."""
        omega, rate = (curve(np.minimum(tau, 1.0)) for curve in self._target_mapping)
        return omega, rate

    def settle(self, p: Array, residual: Callable[[Array], _Linear]) -> Array:
        """Solve least squares, for a conic with one term more at a time."""
        for count in range(2 if self.form.kind == "asphere" else p.size, p.size + 1):
            p = np.append(self._least_squares(p[:count], p[count:], residual), p[count:])
        return p

    def _least_squares(
        self, head: Array, tail: Array, residual: Callable[[Array], _Linear]
    ) -> Array:
        """Solve for the first unknowns by a trust-region method; the others are fixed."""
        from scipy.optimize import least_squares

        cache = dict[
            bytes, _Linear | None
        ]()  # the solver requests derivatives at points of known values

        def linear(h: Array) -> _Linear | None:
            if (key := h.tobytes()) not in cache:
                cache[key] = self._safely(residual, np.append(h, tail))
            return cache[key]

        def value(h: Array) -> Array:
            fit = linear(h)
            return np.full(NODES, np.nan) if fit is None else fit.value

        def jacobian(h: Array) -> Array:
            fit = linear(h)
            assert fit is not None  # the solver rejects steps to points without values
            return fit.jacobian[:, : h.size]

        tight = {"xtol": CLOSE, "ftol": CLOSE, "gtol": 1e-15, "max_nfev": STEPS}
        solution: Array = least_squares(value, head, jac=jacobian, x_scale="jac", **tight).x
        return solution

    def level(self, p: Array) -> Array:
        """Minimise the largest deviation, starting from least squares, with the rim at the target's
        field angle or beyond.

        The coordinates make the columns of the initial Jacobian orthogonal, and a deviation of the
        size of the initial one is 1.
        """
        first = self.deviation(p)
        scale = self._worst(first)
        if scale <= EXACT:
            return self._with_rim(p)
        back = np.linalg.inv(np.linalg.qr(first.jacobian)[1]) * scale * np.sqrt(NODES)

        def at(y: Array) -> _Linear | None:
            return self._safely(self.deviation, p + back @ y)

        def values(y: Array) -> ObjectiveValues:
            solution = at(y)
            value = np.full(NODES, np.nan) if solution is None else solution.value / scale
            return ObjectiveValues(np.concatenate([value, -value]), value[-1:])

        def rows(y: Array) -> LinearisedValues:
            solution = at(y)
            assert solution is not None  # the solver rejects steps to points without values
            jacobian = solution.jacobian @ back / scale
            return LinearisedValues(
                *values(y), np.concatenate([jacobian, -jacobian]), jacobian[-1:]
            )

        free = np.full(p.size, np.inf)
        solution = solve_minimax(
            values,
            rows,
            np.zeros(p.size),
            (-free, free),
            tolerance=SETTLED,
            initial_trust_radius=1.0,
        )
        return self._with_rim(p + back @ solution.y)

    def _with_rim(self, p: Array) -> Array:
        """Apply the smallest change that gives the rim at least the target's field angle."""
        for _ in range(5):  # Newton iterations
            linear = self.deviation(p)
            if linear.value[-1] <= 0:
                break
            row = linear.jacobian[-1]
            p = p - row * (linear.value[-1] + RIM_TOLERANCE) / (row @ row)
        return p

    @staticmethod
    def _worst(linear: _Linear) -> float:
        return float(np.abs(linear.value).max())

    @staticmethod
    def _safely(residual: Callable[[Array], _Linear], p: Array) -> _Linear | None:
        """Return the residual, or None if the unknowns define no valid mirror."""
        try:
            with np.errstate(all="ignore"):
                residuals = residual(p)
        except OmnimirrorError:
            return None
        return (
            residuals
            if np.isfinite(residuals.value).all() and np.isfinite(residuals.jacobian).all()
            else None
        )

    def mirror(self, p: Array) -> Mirror:
        if self.form.kind == "polynomial":
            return EvenPolynomial(tuple(p), self.rim, self.rim)
        return ConicAsphere(float(p[0]) * self.rim, float(p[1]), self.rim, tuple(p[2:]), self.rim)

    def fitted_mirror(self, p: Array) -> FittedMirror:
        """Return the mirror with its deviations, computed from its own chief rays."""
        mirror, target = self.mirror(p), self.target
        theta = float(np.degrees(target.theta_max))
        mounted = RimRay(float(np.degrees(target.omega_max)), theta, self.rim).place(mirror)
        x = np.linspace(0, 1, 4 * NODES)[1:] * self.rim
        rays = Meridian(mirror, mounted.distance_mm).trace(x)
        inside = np.minimum(rays.omega, target.omega_max)
        expected = target.trace(target.x_from_omega(inside))
        height, aim = (
            r.x / (self.rim if np.isinf(r.m) else r.w * np.tan(target.theta_max))
            for r in (rays, expected)
        )
        _, rate = self._target_at(np.ones(1))
        aim = aim + (rays.omega - inside) / rate
        z, slope, _ = target.mirror.profile(x)
        return FittedMirror(
            mounted,
            float(np.abs(height - aim).max()),
            float(np.abs(rays.z - z).max()) * 1e3,
            float(np.abs(rays.beta - np.arctan(slope)).max()) * 1e3,
        )


# -- Mirrors of any class --------------------------------------------------------------------------

M = TypeVar("M", bound=Mirror)
SAMPLES = 300  # random samples per parameter, of which the best are refined
REFINED = 5
RIM_WEIGHT = 1000.0  # of the slope angle at the rim, which determines the field angle
INVALID_RAD = np.pi  # deviation of parameters without a valid mirror
SMALL = 1e-3  # parameters are searched linearly below and logarithmically above this magnitude


def similar_mirror(cls: type[M], target: Mirror) -> M:
    """Return a mirror of a class with the rim radius and nearly the slope angles of a target.

    The scalar parameters without default minimise the squared deviation of the slope angle, with a
    large weight at the rim: the best of random samples over their ranges are refined by least
    squares. Words have their first valid value, other parameters their defaults.

    Raises
    ------
    InvalidParameter
        If a parameter without default is a list, or no sample is a valid mirror.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Paraboloid, Sphere
    >>> similar_mirror(Paraboloid, Sphere(50.0, 30.0)).vertex_radius_mm  # slope 0.75 at the rim
    40.0...
    """
    from scipy.optimize import least_squares

    rim = target.rim_radius_mm
    fixed, free = _fixed_and_free(cls, rim)
    x = np.linspace(0.0, rim, 41)[1:]
    angles = np.arctan(target.slope(x))
    weights = np.where(x < rim, 1.0, RIM_WEIGHT)
    # Ranges span decades, and some contain 0: asinh is linear near 0 and logarithmic beyond.
    low, high = (
        np.arcsinh([getattr(cls.PARAMETERS[name], end) / SMALL for name in free])
        for end in ("low", "high")
    )

    def mirror(u: Array) -> M:
        values = np.clip(SMALL * np.sinh(low + u * (high - low)), *_ranges(cls, free))
        return cls(**fixed, **dict(zip(free, map(float, values), strict=True)))

    def residual(u: Array) -> Array:
        try:
            with np.errstate(all="ignore"):
                deviation = np.arctan(mirror(u).slope(x)) - angles
        except OmnimirrorError:
            return weights * INVALID_RAD
        return weights * np.where(np.isfinite(deviation), deviation, INVALID_RAD)

    count = len(free)
    starts = np.random.default_rng(0).random((max(1, SAMPLES * count), count))
    errors = np.array([np.sum(residual(u) ** 2) for u in starts])
    best = [starts[i] for i in np.argsort(errors)[:REFINED]]
    if count:
        best = [
            least_squares(residual, u, bounds=(0.0, 1.0), xtol=CLOSE, ftol=CLOSE).x for u in best
        ]
    result = min(best, key=lambda u: float(np.sum(residual(u) ** 2)))
    try:
        return mirror(result)
    except OmnimirrorError as e:
        raise InvalidParameter(
            f"no {cls.KIND} mirror of the rim radius {rim:g} mm is valid: {e}; open a sensor file with one"
        ) from None


def _ranges(cls: type[Mirror], names: list[str]) -> tuple[Array, Array]:
    parameters = [cls.PARAMETERS[name] for name in names]
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def _fixed_and_free(cls: type[Mirror], rim_mm: float) -> tuple[dict[str, Any], list[str]]:
    """Return the fixed arguments and the names of the scalar parameters without default."""
    fixed: dict[str, Any] = {"rim_radius_mm": rim_mm}
    free: list[str] = []
    hints = get_type_hints(cls)
    for f in fields(cls):  # type: ignore[arg-type]  # subclasses of Mirror are dataclasses
        if f.name in fixed or f.default is not MISSING or f.default_factory is not MISSING:
            continue
        if get_origin(hints[f.name]) is tuple:
            raise InvalidParameter(
                f"a {cls.KIND} mirror requires the list {f.name}; open a sensor file with one"
            )
        if choices := cls.PARAMETERS[f.name].choices:
            fixed[f.name] = choices[0]
        else:
            free.append(f.name)
    return fixed, free
