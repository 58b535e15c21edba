"""What a mirror is in the words of other programs: a conic, a straight line, an asphere or a spline.

Every form states how far it lies from the mirror, along the mirror's normal and in micrometres; a form
that is the mirror itself says 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..mirrors import ConicAsphere, EvenPolynomial, Mirror
from ..mirrors.conics import Conic, conic_profile, conic_reach

Array = NDArray[np.float64]

EXACT_UM = 1e-6
"""A deviation below this is rounding: the form is the mirror. An atom is a hundred times as wide."""
TERMS = 8
"""Even powers r^2 .. r^16 of OpticStudio's even asphere, and powers r^1 .. r^8 of its odd one."""
MORE_TERMS = 16
"""Terms of its extended aspheres, where eight do not do; in double precision more gain little."""
MOST_TERMS = 240
"""What an extended asphere can have."""
GOOD_UM, GOOD_DEG = 0.01, 0.002
"""A fit is good enough when its surface and its reflected rays are as close as this."""
ANGLE_SHARE = 0.05
"""A fit counts an error of angle over this share of the rim radius, and so as one of distance."""


def deviation_um(mirror: Mirror, x: Array, z: Array) -> Array:
    """How far points (x, z) (mm) lie from the mirror, um; positive where they lie inside its material.

    First order: the difference of heights times cos(beta).
    """
    sag, slope, _ = mirror.profile(np.minimum(x, mirror.rim_radius_mm))
    return 1e3 * (z - sag) / np.sqrt(1 + slope**2)


def nodes(mirror: Mirror, count: int = 1001) -> Array:
    """Distances from the axis (mm) where forms are compared with the mirror: denser at both ends."""
    return mirror.rim_radius_mm * (1 - np.cos(np.linspace(0, np.pi, count))) / 2


# -- conics and straight lines ---------------------------------------------------------------------


def conic_of(mirror: Mirror) -> tuple[float, float] | None:
    """Vertex radius R (mm) and conic constant k of a mirror that is a conic exactly, or None.

    >>> conic_of(ConicAsphere(50.0, -0.5, 40.0)), conic_of(EvenPolynomial((0.01,), 40.0))
    ((50.0, -0.5), (50.0, -1.0))
    """
    match mirror:
        case Conic():
            return mirror.vertex_radius, mirror.conic
        case ConicAsphere() if not any(mirror.coefficients):
            return mirror.vertex_radius_mm, mirror.conic
        case EvenPolynomial() if mirror.coefficients[0] > 0 and not any(mirror.coefficients[1:]):
            return mirror.normalization_radius_mm / (2 * mirror.coefficients[0]), -1.0
    return None


def is_straight(mirror: Mirror) -> bool:
    """Whether the meridian is a straight line: a cone, or a plane."""
    return not np.any(mirror.curvature(nodes(mirror, 65)))


# -- aspheres --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Asphere:
    """``c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum a_i (r/N)^p_i``, what lens programs take for a mirror.

    Attributes
    ----------
    kind : "even" or "odd"
        The powers are 2, 4, 6, .., or 1, 2, 3, .. for a mirror with a point.
    curvature : c = 1/R, 1/mm
    conic : k
    coefficients : the a_i, mm; eight, or more of an extended asphere
    normalization_mm : N, 1 mm but for an extended asphere
    deviation_um : largest distance from the mirror
    ray_deg : largest angle between the rays that this surface and the mirror reflect
    """

    kind: str
    curvature: float
    conic: float
    coefficients: tuple[float, ...]
    normalization_mm: float = 1.0
    deviation_um: float = 0.0
    ray_deg: float = 0.0

    @property
    def is_extended(self) -> bool:
        """Whether it takes more terms than OpticStudio's plain aspheres have."""
        return len(self.coefficients) > TERMS

    @property
    def is_good(self) -> bool:
        return self.deviation_um < GOOD_UM and self.ray_deg < GOOD_DEG

    @property
    def powers(self) -> tuple[int, ...]:
        step = 2 if self.kind == "even" else 1
        return tuple(step * (i + 1) for i in range(len(self.coefficients)))

    def profile(self, r: Array) -> tuple[Array, Array]:
        """Height over the vertex plane (mm) and slope."""
        z, slope = np.zeros_like(r), np.zeros_like(r)
        if self.curvature:
            z, slope, _ = conic_profile(r, 1 / self.curvature, self.conic)
        rho = r / self.normalization_mm
        for power, a in zip(self.powers, self.coefficients, strict=True):
            z = z + a * rho**power
            slope = slope + a * power / self.normalization_mm * rho ** (power - 1)
        return z, slope

    def reversed(self) -> Asphere:
        """The same surface with its z the other way."""
        return replace(self, curvature=-self.curvature, coefficients=tuple(-a for a in self.coefficients))

    def words(self) -> str:
        """
        >>> Asphere("even", 0.02, 0.0, (0.0,) * 8).words()
        'even asphere'
        """
        return f"extended {self.kind} asphere of {len(self.coefficients)} terms" if self.is_extended else (
            f"{self.kind} asphere"
        )  # fmt: skip


def asphere_of(mirror: Mirror) -> Asphere:
    """The mirror as an asphere: exact where it is one, else the closest in distance and slope by least squares.

    It has eight terms, or sixteen where eight are not good enough.

    Examples
    --------
    >>> from omnimirror.mirrors import Cone, Equidistant
    >>> asphere_of(Cone(45.0, 20.0)).coefficients[0].__round__(12)
    1.0
    >>> asphere_of(Equidistant(135.0, 12.0, 43.9)).deviation_um < 0.001
    True
    """
    if form := _exact_asphere(mirror):
        return _compared(mirror, form)
    plain = _compared(mirror, _fitted_asphere(mirror, TERMS))
    if plain.is_good:
        return plain
    extended = _compared(mirror, _fitted_asphere(mirror, MORE_TERMS))
    return min(plain, extended, key=lambda form: form.ray_deg)


def _compared(mirror: Mirror, form: Asphere) -> Asphere:
    """The form with what it leaves: 0 where that is rounding."""
    x = nodes(mirror)
    z, slope = form.profile(x)
    worst = float(np.abs(deviation_um(mirror, x, z)).max())
    if worst <= EXACT_UM:
        return form
    turned = 2 * np.abs(np.arctan(slope) - np.arctan(mirror.slope(x)))
    return replace(form, deviation_um=worst, ray_deg=float(np.degrees(turned.max())))


def _exact_asphere(mirror: Mirror) -> Asphere | None:
    if conic := conic_of(mirror):
        return Asphere("even", 1 / conic[0], conic[1], (0.0,) * TERMS)
    if is_straight(mirror):
        if not mirror.is_pointed:
            return Asphere("even", 0.0, 0.0, (0.0,) * TERMS)
        return Asphere("odd", 0.0, 0.0, (float(mirror.slope(0.0)), *(0.0,) * (TERMS - 1)))
    if not isinstance(mirror, EvenPolynomial | ConicAsphere):
        return None
    N = mirror.normalization_radius_mm
    if isinstance(mirror, EvenPolynomial):  # the r^2 term is a paraboloid, which gives the vertex radius its place
        first, c, k = 2 * mirror.coefficients[0] / N, mirror.coefficients[1:], -1.0
    else:
        first, c, k = 1 / mirror.vertex_radius_mm, mirror.coefficients, mirror.conic
    while c and not c[-1]:
        c = c[:-1]
    if len(c) > MOST_TERMS - 1:
        return None
    if len(c) > TERMS - 1:  # their coefficients are heights over N, ours heights
        return Asphere("even", first, k, (0.0, *(N * a for a in c)), N)
    terms = [a * N ** (1 - 2 * i) for i, a in enumerate(c, start=2)]
    return Asphere("even", first, k, (0.0, *terms, *(0.0,) * (TERMS - 1 - len(terms))))


def _fitted_asphere(mirror: Mirror, terms: int) -> Asphere:
    """Least squares of normal distance and angle; of a smooth mirror the vertex radius is given and k searched.

    A fit of the distance alone ripples towards the rim, and rays feel slopes. The vertex radius is the mirror's
    own, or, where it does better (a measured profile may have a bump there), that of the even polynomial through
    the whole mirror.
    """
    N = mirror.rim_radius_mm if terms > TERMS else 1.0
    if mirror.is_pointed:
        fit = _Fit(mirror, tuple(range(1, terms + 1)))
        return Asphere("odd", 0.0, 0.0, fit.coefficients(0.0, 0.0, N), N)
    fit = _Fit(mirror, tuple(2 * i for i in range(2, terms + 1)))
    whole = _Fit(mirror, tuple(2 * i for i in range(1, terms + 1))).coefficients(0.0, 0.0, 1.0)
    vertex = [float(mirror.curvature(0.0)), 2 * whole[0]]
    shapes = [(c, _best_conic(lambda k, c=c: fit.worst(c, k), c, fit.M) if c > 0 else 0.0) for c in vertex]  # type: ignore[misc]
    c, k = min(shapes, key=lambda shape: fit.worst(*shape))
    return Asphere("even", c, k, (0.0, *fit.coefficients(c, k, N)), N)


class _Fit:
    """Least squares of what a conic leaves of a mirror, in given powers of r/M; the conic may change."""

    def __init__(self, mirror: Mirror, powers: tuple[int, ...]) -> None:
        self.M, self.x, self.powers = mirror.rim_radius_mm, nodes(mirror, 801), np.array(powers)
        self.z, self.slope, _ = mirror.profile(self.x)
        self.weight = 1 / np.sqrt(1 + self.slope**2)
        self.rate = ANGLE_SHARE * self.M * self.weight**2  # of slope into angle
        rho = self.x[:, None] / self.M
        rates = self.powers / self.M * rho ** (self.powers - 1)
        self.q, self.r = np.linalg.qr(
            np.concatenate([self.weight[:, None] * rho**self.powers, self.rate[:, None] * rates])
        )

    def _rest(self, c: float, k: float) -> Array:
        z, slope = self.z, self.slope
        if c:
            base = conic_profile(self.x, 1 / c, k)
            z, slope = z - base[0], slope - base[1]
        return np.concatenate([self.weight * z, self.rate * slope])

    def worst(self, c: float, k: float) -> float:
        """Largest residual beside a conic, mm."""
        rest = self._rest(c, k)
        return float(np.abs(rest - self.q @ (self.q.T @ rest)).max())

    def coefficients(self, c: float, k: float, N: float) -> tuple[float, ...]:
        """Of the powers of r/N, mm."""
        from scipy.linalg import solve_triangular

        scaled = solve_triangular(self.r, self.q.T @ self._rest(c, k))
        return tuple(map(float, scaled * (N / self.M) ** self.powers))


def _best_conic(worst: Callable[[float], float], c: float, M: float) -> float:
    """The conic constant that leaves the polynomial least to do, among those that reach the rim."""
    from scipy.optimize import minimize_scalar

    tries = [k for k in np.linspace(-6.0, 6.0, 97) if conic_reach(1 / c, float(k)) > 1.001 * M]
    middle = min(tries, key=worst)
    high = min(middle + 0.125, (1 / (1.001 * M * c)) ** 2 - 1)
    return float(minimize_scalar(worst, bounds=(middle - 0.125, high), method="bounded", options={"xatol": 1e-9}).x)


# -- curves for CAD --------------------------------------------------------------------------------


Ends: TypeAlias = "tuple[tuple[float, float], tuple[float, float]]"


@dataclass(frozen=True)
class ProfileCurve:
    """The meridian as CAD programs draw one: a line, an arc about the axis, or a (rational) B-spline.

    Attributes
    ----------
    kind : "line", "arc" or "spline"
    ends : ((x, z), (x, z)) mm, from the axis to the rim
    radius_mm : of an arc; its centre is (0, radius)
    degree, knots, poles, weights
        Of a spline: knots with their multiplicity, poles (n, 2) in mm, and weights (n,) where it is rational.
    deviation_um : largest distance from the mirror, 0 where the curve is the mirror's own
    """

    kind: str
    ends: Ends
    radius_mm: float = 0.0
    degree: int = 0
    knots: tuple[float, ...] = ()
    poles: tuple[tuple[float, float], ...] = ()
    weights: tuple[float, ...] | None = None
    deviation_um: float = 0.0
    words: str = ""
    """What it is, for people."""


def curve_of(mirror: Mirror, start_mm: float = 0.0, tolerance_um: float = 0.01) -> ProfileCurve:
    """The meridian from ``start_mm`` to the rim as a CAD curve, exact where the mirror is a conic or straight.

    Others become a quintic spline through as many points as it takes to stay within the tolerance.

    >>> curve_of(ConicAsphere(50.0, 0.0, 30.0)).words
    'arc of 50 mm'
    >>> curve_of(EvenPolynomial((0.01,), 30.0)).words
    'conic'
    """
    rim = mirror.rim_radius_mm
    ends = (start_mm, float(mirror.sag(start_mm))), (rim, float(mirror.sag(rim)))
    if is_straight(mirror):
        return ProfileCurve("line", ends, words="straight line")
    conic = conic_of(mirror)
    if conic and conic[1] == 0.0:
        return ProfileCurve("arc", ends, radius_mm=conic[0], words=f"arc of {conic[0]:.9g} mm")
    if conic:
        return _conic_arc(mirror, ends, conic)
    return _spline(mirror, ends, tolerance_um)


def _conic_arc(mirror: Mirror, ends: Ends, conic: tuple[float, float]) -> ProfileCurve:
    """A piece of a conic is one rational quadratic: its ends, where their tangents meet, and one weight.

    The weight is that of the point where the line from the middle of the chord to the tangents' meeting
    crosses the conic ``x^2 - 2 R z + (1 + k) z^2 = 0``: there the curve has its parameter 1/2.
    """
    (x0, z0), (x2, z2) = ends
    s0, s2 = float(mirror.slope(x0)), float(mirror.slope(x2))
    x1 = (z2 - z0 - s2 * x2 + s0 * x0) / (s0 - s2)
    corner, middle = np.array([x1, z0 + s0 * (x1 - x0)]), np.array([(x0 + x2) / 2, (z0 + z2) / 2])
    R, k = conic
    form = np.diag([1.0, 1.0 + k])

    def value(p: Array) -> float:
        return float(p @ form @ p - 2 * R * p[1])

    # along middle + t (corner - middle) the conic is a t^2 + b t + c, inside (negative) at 0 and outside at 1
    step = corner - middle
    a, c = float(step @ form @ step), value(middle)
    b = value(corner) - a - c
    t = -2 * c / (b + float(np.sqrt(b * b - 4 * a * c)))
    weight = t / (1 - t)
    poles = ((x0, z0), (float(corner[0]), float(corner[1])), (x2, z2))
    knots = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    return ProfileCurve("spline", ends, 0.0, 2, knots, poles, (1.0, weight, 1.0), 0.0, "conic")


def _spline(mirror: Mirror, ends: Ends, tolerance_um: float) -> ProfileCurve:
    """A quintic spline by arc length, doubled in points until it is close enough or gains nothing more."""
    from scipy.integrate import cumulative_simpson
    from scipy.interpolate import PchipInterpolator, make_interp_spline

    start, rim = ends[0][0], ends[1][0]
    fine = np.linspace(start, rim, 4097)
    length = cumulative_simpson(np.sqrt(1 + mirror.slope(fine) ** 2), x=fine, initial=0.0)
    x_of_length = PchipInterpolator(length, fine)
    best: ProfileCurve | None = None
    for spans in 2 ** np.arange(3, 11):
        s = np.linspace(0.0, length[-1], spans + 1)
        x = np.clip(x_of_length(s), start, rim)
        x[0], x[-1] = start, rim
        z, slope, curvature = mirror.profile(x)
        points, last = np.stack([x, z], axis=-1), slice(None, None, len(x) - 1)
        first = np.stack([np.ones(2), slope[last]], axis=-1) / np.sqrt(1 + slope[last] ** 2)[:, None]
        second = np.stack([-slope[last], np.ones(2)], axis=-1) * (curvature / (1 + slope**2) ** 2)[last][:, None]
        conditions = [[(1, first[i]), (2, second[i])] for i in (0, 1)]
        spline = make_interp_spline(s, points, k=5, bc_type=tuple(conditions))
        x_on, z_on = spline(np.linspace(0.0, length[-1], 32 * spans + 1)).T
        worst = float(np.abs(deviation_um(mirror, np.clip(x_on, start, rim), z_on)).max())
        if best is None or worst < best.deviation_um:
            poles = tuple((float(px), float(pz)) for px, pz in spline.c)
            words = f"quintic spline of {len(poles)} poles"
            best = ProfileCurve("spline", ends, 0.0, 5, tuple(map(float, spline.t)), poles, None, worst, words)
        if worst <= tolerance_um:
            break
    assert best is not None
    return best


def chords(mirror: Mirror, tolerance_um: float, start_mm: float = 0.0) -> Array:
    """Distances from the axis (mm) of points whose chords stay within a tolerance of the meridian.

    Steps follow the curvature: a chord c of a curve of radius R_t lies c^2 / (8 R_t) from it. A tenth of
    the tolerance is left for the change of curvature along a step, and what that does not cover is made finer.
    """
    fine = np.linspace(start_mm, mirror.rim_radius_mm, 8193)
    _, slope, curvature = mirror.profile(fine)
    kappa = np.abs(curvature) / (1 + slope**2) ** 1.5
    # steps per mm of arc, from the local curvature; at least eight in all, for nearly straight meridians
    total, share = steps_of(fine, np.sqrt(1 + slope**2) * np.sqrt(kappa / (8 * 0.9e-3 * tolerance_um)))
    if total <= 1 and not np.any(curvature):
        return fine[[0, -1]]
    total = max(total, 8)
    while True:
        points: Array = np.interp(np.linspace(0.0, 1.0, total + 1), share, fine)
        worst = _worst_chord_um(mirror, points)
        if worst <= tolerance_um or total >= fine.size:
            return points
        total = int(np.ceil(1.01 * total * np.sqrt(worst / tolerance_um)))  # a long step next to an inflection


def steps_of(x: Array, density: Array) -> tuple[int, Array]:
    """How many steps a density (n,) of them along x asks for, and the share of them before each x."""
    count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    floor = np.linspace(0.0, 1e-3 * max(count[-1], 1.0), x.size)  # keeps the count growing where there is none
    return int(np.ceil(count[-1])), (count + floor) / (count + floor)[-1]


def _worst_chord_um(mirror: Mirror, points: Array) -> float:
    """Largest distance of chords between points (mm) of the meridian from it, um."""
    ends, share = mirror.sag(points), np.linspace(0.0, 1.0, 17)[1:-1, None]
    between = np.minimum(points[:-1] + share * np.diff(points), mirror.rim_radius_mm)
    return float(np.abs(deviation_um(mirror, between, ends[:-1] + share * np.diff(ends))).max())


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
