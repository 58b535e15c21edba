"""Equivalent surfaces for other programs: conics, aspheres, CAD curves and the best-fit sphere.

Every approximation reports its deviation from the mirror along the mirror's normal in
micrometres. The deviation of an exact representation is 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import InvalidParameter
from ..base.typing import Array
from ..optics.mirrors import ConicAsphere, EvenPolynomial, Mirror
from ..optics.mirrors.mirror import Conic, conic_profile, conic_reach

EXACT_UM = 1e-6
"""Deviations below this value are rounding errors; the representation counts as exact, um."""
TERMS = 8
"""Number of terms of the even asphere (r^2 to r^16) and the odd asphere (r^1 to r^8) of
OpticStudio."""
MORE_TERMS = 16
"""Number of terms of an extended asphere; more terms improve little in double precision."""
MAX_TERMS = 240
"""Maximum number of terms of an extended asphere."""
GOOD_UM, GOOD_DEG = 0.01, 0.002
"""Limits of surface deviation (um) and ray deviation (deg) of an acceptable fit."""
ANGLE_SHARE = 0.05
"""Lever arm that converts angle errors to distances in a fit, as a fraction of the rim radius."""


def deviation_um(mirror: Mirror, x: Array, z: Array) -> Array:
    """Compute the distances of points (x, z) in mm from the mirror, positive inside its material, um.

    To first order, the distance is the height difference times cos(beta).
    """
    sag, slope, _ = mirror.profile(np.minimum(x, mirror.rim_radius_mm))
    return 1e3 * (z - sag) / np.sqrt(1 + slope**2)


def nodes(mirror: Mirror, count: int = 1001) -> Array:
    """Return radii (mm) at which an approximation is compared with the mirror, denser at both ends."""
    return mirror.rim_radius_mm * (1 - np.cos(np.linspace(0, np.pi, count))) / 2


# -- conics and straight lines ---------------------------------------------------------------------


def conic_parameters(mirror: Mirror) -> tuple[float, float] | None:
    """Return vertex radius R (mm) and conic constant k of an exact conic; otherwise None.

    >>> conic_parameters(ConicAsphere(50.0, -0.5, 40.0)), conic_parameters(EvenPolynomial((0.01,), 40.0))
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
    """Return whether the meridian is a straight line, as for a cone or a plane."""
    return not np.any(mirror.curvature(nodes(mirror, 65)))


# -- aspheres --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Asphere:
    """Asphere of lens design programs: ``c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum a_i (r/N)^p_i``.

    Attributes
    ----------
    kind : "even" or "odd"
        Powers 2, 4, 6, ..., or 1, 2, 3, ... for a pointed mirror.
    curvature
        c = 1/R, 1/mm.
    conic
        Conic constant k.
    coefficients
        Coefficients a_i in mm: eight, or more for an extended asphere.
    normalization_mm
        Normalisation radius N, 1 mm except for an extended asphere.
    deviation_um
        Maximum distance from the mirror.
    ray_deg
        Maximum angle between rays reflected by this surface and by the mirror.
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
        """True if the surface needs more terms than a plain asphere."""
        return len(self.coefficients) > TERMS

    @property
    def is_good(self) -> bool:
        """True if surface and ray deviations are within the limits of an acceptable fit."""
        return self.deviation_um < GOOD_UM and self.ray_deg < GOOD_DEG

    @property
    def powers(self) -> tuple[int, ...]:
        """Exponents p_i of the coefficients."""
        step = 2 if self.kind == "even" else 1
        return tuple(step * (i + 1) for i in range(len(self.coefficients)))

    def profile(self, r: Array) -> tuple[Array, Array]:
        """Compute height above the vertex plane (mm) and slope."""
        z, slope = np.zeros_like(r), np.zeros_like(r)
        if self.curvature:
            z, slope, _ = conic_profile(r, 1 / self.curvature, self.conic)
        rho = r / self.normalization_mm
        for power, a in zip(self.powers, self.coefficients, strict=True):
            z = z + a * rho**power
            slope = slope + a * power / self.normalization_mm * rho ** (power - 1)
        return z, slope

    def reversed(self) -> Asphere:
        """Return the surface with the direction of z inverted."""
        return replace(
            self, curvature=-self.curvature, coefficients=tuple(-a for a in self.coefficients)
        )

    def words(self) -> str:
        """Describe the surface type.

        >>> Asphere("even", 0.02, 0.0, (0.0,) * 8).words()
        'even asphere'
        """
        return (
            f"extended {self.kind} asphere of {len(self.coefficients)} terms"
            if self.is_extended
            else (f"{self.kind} asphere")
        )


def fit_asphere(mirror: Mirror) -> Asphere:
    """Represent a mirror as an asphere: exact if possible, otherwise a least-squares fit.

    The fit minimises normal distance and slope error with eight terms, or 16 if eight are not
    sufficient.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Cone, Equidistant
    >>> fit_asphere(Cone(45.0, 20.0)).coefficients[0].__round__(12)
    1.0
    >>> fit_asphere(Equidistant(135.0, 12.0, 43.9)).deviation_um < 0.001
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
    """Return the approximation with its deviations from the mirror; 0 if they are rounding errors."""
    x = nodes(mirror)
    z, slope = form.profile(x)
    worst = float(np.abs(deviation_um(mirror, x, z)).max())
    if worst <= EXACT_UM:
        return form
    turned = 2 * np.abs(np.arctan(slope) - np.arctan(mirror.slope(x)))
    return replace(form, deviation_um=worst, ray_deg=float(np.degrees(turned.max())))


def _exact_asphere(mirror: Mirror) -> Asphere | None:
    """Return the exact asphere of a mirror, or None."""
    if conic := conic_parameters(mirror):
        return Asphere("even", 1 / conic[0], conic[1], (0.0,) * TERMS)
    if is_straight(mirror):
        if not mirror.is_pointed:
            return Asphere("even", 0.0, 0.0, (0.0,) * TERMS)
        return Asphere("odd", 0.0, 0.0, (float(mirror.slope(0.0)), *(0.0,) * (TERMS - 1)))
    if not isinstance(mirror, EvenPolynomial | ConicAsphere):
        return None
    N = mirror.normalization_radius_mm
    if isinstance(mirror, EvenPolynomial):  # the r^2 term is a paraboloid with the vertex radius
        first, c, k = 2 * mirror.coefficients[0] / N, mirror.coefficients[1:], -1.0
    else:
        first, c, k = 1 / mirror.vertex_radius_mm, mirror.coefficients, mirror.conic
    while c and not c[-1]:
        c = c[:-1]
    if len(c) > MAX_TERMS - 1:
        return None
    if (
        len(c) > TERMS - 1
    ):  # mirror coefficients are heights over N, asphere coefficients are heights
        return Asphere("even", first, k, (0.0, *(N * a for a in c)), N)
    terms = [a * N ** (1 - 2 * i) for i, a in enumerate(c, start=2)]
    return Asphere("even", first, k, (0.0, *terms, *(0.0,) * (TERMS - 1 - len(terms))))


def _fitted_asphere(mirror: Mirror, terms: int) -> Asphere:
    """Fit an asphere to normal distance and angle; optimise the conic constant of smooth mirrors.

    A fit of the distance alone oscillates near the rim, where rays depend on the slope. The vertex
    radius is that of the mirror or, if better (a measured profile may have a local bump at the
    vertex), that of the even polynomial fitted to the whole mirror.
    """
    N = mirror.rim_radius_mm if terms > TERMS else 1.0
    if mirror.is_pointed:
        fit = _Fit(mirror, tuple(range(1, terms + 1)))
        return Asphere("odd", 0.0, 0.0, fit.coefficients(0.0, 0.0, N), N)
    fit = _Fit(mirror, tuple(2 * i for i in range(2, terms + 1)))
    whole = _Fit(mirror, tuple(2 * i for i in range(1, terms + 1))).coefficients(0.0, 0.0, 1.0)
    vertex = [float(mirror.curvature(0.0)), 2 * whole[0]]
    shapes = [(c, _best_conic(partial(fit.worst, c), c, fit.M) if c > 0 else 0.0) for c in vertex]
    c, k = min(shapes, key=lambda shape: fit.worst(*shape))
    return Asphere("even", c, k, (0.0, *fit.coefficients(c, k, N)), N)


class _Fit:
    """Least-squares fit of the difference between mirror and conic in powers of r/M."""

    def __init__(self, mirror: Mirror, powers: tuple[int, ...]) -> None:
        self.M, self.x, self.powers = mirror.rim_radius_mm, nodes(mirror, 801), np.array(powers)
        self.z, self.slope, _ = mirror.profile(self.x)
        self.weight = 1 / np.sqrt(1 + self.slope**2)
        self.rate = ANGLE_SHARE * self.M * self.weight**2  # conversion of slope to angle
        rho = self.x[:, None] / self.M
        rates = self.powers / self.M * rho ** (self.powers - 1)
        self.q, self.r = np.linalg.qr(
            np.concatenate([self.weight[:, None] * rho**self.powers, self.rate[:, None] * rates])
        )

    def _rest(self, c: float, k: float) -> Array:
        """Return weighted residuals of height and slope for a conic."""
        z, slope = self.z, self.slope
        if c:
            base = conic_profile(self.x, 1 / c, k)
            z, slope = z - base[0], slope - base[1]
        return np.concatenate([self.weight * z, self.rate * slope])

    def worst(self, c: float, k: float) -> float:
        """Return the maximum residual of the fit for a conic, mm."""
        rest = self._rest(c, k)
        return float(np.abs(rest - self.q @ (self.q.T @ rest)).max())

    def coefficients(self, c: float, k: float, N: float) -> tuple[float, ...]:
        """Return the coefficients of the powers of r/N, mm."""
        from scipy.linalg import solve_triangular

        scaled = solve_triangular(self.r, self.q.T @ self._rest(c, k))
        return tuple(map(float, scaled * (N / self.M) ** self.powers))


def _best_conic(worst: Callable[[float], float], c: float, M: float) -> float:
    """Find the conic constant with the smallest maximum residual among those that reach the rim."""
    from scipy.optimize import minimize_scalar

    tries = [k for k in np.linspace(-6.0, 6.0, 97) if conic_reach(1 / c, float(k)) > 1.001 * M]
    middle = min(tries, key=worst)
    high = min(middle + 0.125, (1 / (1.001 * M * c)) ** 2 - 1)
    return float(
        minimize_scalar(
            worst, bounds=(middle - 0.125, high), method="bounded", options={"xatol": 1e-9}
        ).x
    )


# -- CAD curves ------------------------------------------------------------------------------------


Ends: TypeAlias = "tuple[tuple[float, float], tuple[float, float]]"


@dataclass(frozen=True)
class ProfileCurve:
    """Meridian as a CAD curve: a line, an arc about the axis, or a (rational) B-spline.

    Attributes
    ----------
    kind : "line", "arc" or "spline"
    ends : ((x, z), (x, z))
        End points in mm, from the axis to the rim.
    radius_mm
        Radius of an arc, whose centre is (0, radius).
    degree, knots, poles, weights
        B-spline data: knots with multiplicity, poles (n, 2) in mm, and weights (n,) if rational.
    deviation_um
        Maximum distance from the mirror; 0 for an exact curve.
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
    """Description of the curve."""


def profile_curve(
    mirror: Mirror, start_mm: float = 0.0, tolerance_um: float = 0.01
) -> ProfileCurve:
    """Convert the meridian from ``start_mm`` to the rim to a CAD curve.

    Conics and straight lines are exact. Other meridians become a quintic spline with as many points
    as the tolerance requires.

    >>> profile_curve(ConicAsphere(50.0, 0.0, 30.0)).words
    'arc of 50 mm'
    >>> profile_curve(EvenPolynomial((0.01,), 30.0)).words
    'conic'
    """
    rim = mirror.rim_radius_mm
    ends = (start_mm, float(mirror.sag(start_mm))), (rim, float(mirror.sag(rim)))
    if is_straight(mirror):
        return ProfileCurve("line", ends, words="straight line")
    conic = conic_parameters(mirror)
    if conic and conic[1] == 0.0:
        return ProfileCurve("arc", ends, radius_mm=conic[0], words=f"arc of {conic[0]:.9g} mm")
    if conic:
        return _conic_arc(mirror, ends, conic)
    return _spline(mirror, ends, tolerance_um)


def _conic_arc(mirror: Mirror, ends: Ends, conic: tuple[float, float]) -> ProfileCurve:
    """Represent a conic arc as a rational quadratic: end points, intersection of tangents, one weight.

    The weight follows from the shoulder point, at which the line from the middle of the chord to the
    intersection of the tangents meets the conic ``x^2 - 2 R z + (1 + k) z^2 = 0`` (parameter 1/2).
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
    """Fit a quintic spline over arc length; double the number of points until it is accurate."""
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
        first = (
            np.stack([np.ones(2), slope[last]], axis=-1) / np.sqrt(1 + slope[last] ** 2)[:, None]
        )
        second = (
            np.stack([-slope[last], np.ones(2)], axis=-1)
            * (curvature / (1 + slope**2) ** 2)[last][:, None]
        )
        conditions = [[(1, first[i]), (2, second[i])] for i in (0, 1)]
        spline = make_interp_spline(s, points, k=5, bc_type=tuple(conditions))
        x_on, z_on = spline(np.linspace(0.0, length[-1], 32 * spans + 1)).T
        worst = float(np.abs(deviation_um(mirror, np.clip(x_on, start, rim), z_on)).max())
        if best is None or worst < best.deviation_um:
            poles = tuple((float(px), float(pz)) for px, pz in spline.c)
            description = f"quintic spline of {len(poles)} poles"
            best = ProfileCurve(
                "spline", ends, 0.0, 5, tuple(map(float, spline.t)), poles, None, worst, description
            )
        if worst <= tolerance_um:
            break
    assert best is not None
    return best


def chords(mirror: Mirror, tolerance_um: float, start_mm: float = 0.0) -> Array:
    """Return radii (mm) of points whose chords stay within a tolerance of the meridian.

    The step size follows the curvature: a chord of length c deviates by c^2 / (8 R_t) from a curve of
    radius R_t. 10 % of the tolerance is reserved for the variation of the curvature along a step;
    steps that still exceed the tolerance are refined.
    """
    fine = np.linspace(start_mm, mirror.rim_radius_mm, 8193)
    _, slope, curvature = mirror.profile(fine)
    kappa = np.abs(curvature) / (1 + slope**2) ** 1.5
    # steps per mm of arc from the local curvature; at least eight for nearly straight meridians
    total, share = step_density(
        fine, np.sqrt(1 + slope**2) * np.sqrt(kappa / (8 * 0.9e-3 * tolerance_um))
    )
    if total <= 1 and not np.any(curvature):
        return fine[[0, -1]]
    total = max(total, 8)
    while True:
        points: Array = np.interp(np.linspace(0.0, 1.0, total + 1), share, fine)
        worst = _worst_chord_um(mirror, points)
        if worst <= tolerance_um or total >= fine.size:
            return points
        total = int(
            np.ceil(1.01 * total * np.sqrt(worst / tolerance_um))
        )  # a long step next to an inflection


def step_density(x: Array, density: Array) -> tuple[int, Array]:
    """Return the number of steps for a density (n,) along x, and the normalised cumulative count."""
    count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    floor = np.linspace(
        0.0, 1e-3 * max(count[-1], 1.0), x.size
    )  # keeps the count strictly increasing
    return int(np.ceil(count[-1])), (count + floor) / (count + floor)[-1]


def _worst_chord_um(mirror: Mirror, points: Array) -> float:
    """Return the maximum distance of chords between points (mm) from the meridian, um."""
    ends, share = mirror.sag(points), np.linspace(0.0, 1.0, 17)[1:-1, None]
    between = np.minimum(points[:-1] + share * np.diff(points), mirror.rim_radius_mm)
    return float(np.abs(deviation_um(mirror, between, ends[:-1] + share * np.diff(ends))).max())


SphereCriterion = Literal["least-squares", "min-departure"]
SPHERE_CRITERIA = ("least-squares", "min-departure")


@dataclass(frozen=True)
class BestFitSphere:
    """Sphere with centre (0, centre_z_mm) and the departure of the mirror from it.

    A negative radius denotes a concave mirror and an infinite one a plane. Departures are measured
    along the normal of the sphere and are positive if material has to be removed from a spherical
    blank. The RMS is the mean over the aperture, weighted by projected area.

    Attributes
    ----------
    radius_mm, centre_z_mm
        Radius and height of the centre.
    peak_to_valley_um, rms_um
        Departure of the mirror.
    slope_mrad
        Maximum angle between mirror and sphere.
    """

    criterion: str
    radius_mm: float
    centre_z_mm: float
    peak_to_valley_um: float
    rms_um: float
    slope_mrad: float

    def departure_um(self, mirror: Mirror, x_mm: ArrayLike) -> Array:
        """Compute the departure (n,) of the mirror at radii x, um."""
        x = np.asarray(x_mm, dtype=float)
        if np.isinf(self.radius_mm):
            return np.zeros_like(x)
        away = np.sign(self.radius_mm) * np.hypot(x, self.centre_z_mm - mirror.sag(x))
        departure: Array = 1e3 * (self.radius_mm - away)
        return departure


def best_fit_sphere(mirror: Mirror, criterion: SphereCriterion = "least-squares") -> BestFitSphere:
    """Fit a sphere that minimises the RMS or the peak-to-valley departure of a mirror.

    Raises
    ------
    InvalidParameter
        If the criterion is unknown or the mirror is nearly flat.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Paraboloid, Sphere
    >>> best_fit_sphere(Sphere(50.0, 40.0)).radius_mm.__round__(9)
    50.0
    >>> sphere = best_fit_sphere(Paraboloid(100.0, 20.0), "min-departure")
    >>> round(sphere.radius_mm, 2), round(sphere.peak_to_valley_um, 1)
    (101.0, 5.0)
    """
    if criterion not in SPHERE_CRITERIA:
        raise InvalidParameter(
            f"criterion must be one of {', '.join(SPHERE_CRITERIA)}; got {criterion!r}"
        )
    x = nodes(mirror, 2001)
    z, slope, _ = mirror.profile(x)
    if not np.any(z):
        return BestFitSphere(criterion, np.inf, np.inf, 0.0, 0.0, 0.0)
    sense = float(np.sign(z[-1]))
    z, slope = sense * z, sense * slope  # mirror image of a concave mirror
    chord = 2 * z[-1] / (x[-1] ** 2 + z[-1] ** 2)  # 1/R of the sphere through vertex and rim
    if chord < 1e-9:
        raise InvalidParameter("the mirror must not be nearly flat; it has no best-fit sphere")
    area = x * np.gradient(x)
    area /= area.sum()
    centre = _least_squares_centre(x, z, area, float(1 / chord))
    if criterion == "min-departure":
        centre = _min_departure_centre(x, z, centre)
    d = np.hypot(x, centre - z) - centre
    offset = float(area @ d) if criterion == "least-squares" else float(d.max() + d.min()) / 2
    departure = offset - d
    angle = np.arctan(slope) - np.arctan2(x, centre - z)
    return BestFitSphere(
        criterion,
        radius_mm=sense * (centre + offset),
        centre_z_mm=sense * centre,
        peak_to_valley_um=float(1e3 * np.ptp(departure)),
        rms_um=float(1e3 * np.sqrt(area @ departure**2)),
        slope_mrad=float(1e3 * np.abs(angle[1:] if mirror.is_pointed else angle).max()),
    )


def _least_squares_centre(x: Array, z: Array, weight: Array, centre: float) -> float:
    """Find the height of the centre by the Gauss-Newton method; the radius is the mean distance."""
    for _ in range(100):
        d = np.hypot(x, centre - z)
        rate = (centre - z) / d
        d, rate = d - weight @ d, rate - weight @ rate
        step = float((weight * rate) @ d / ((weight * rate) @ rate))
        centre -= step
        if abs(step) <= 1e-15 * abs(centre):
            break
    return float(centre)


def _min_departure_centre(x: Array, z: Array, start: float) -> float:
    """Minimise the spread of distances, a convex function with a kink at its minimum."""
    from scipy.optimize import minimize_scalar

    def spread(bow: float) -> float:
        return float(np.ptp(np.hypot(x, 1 / bow - z) - 1 / bow))

    bounds = (0.3 / start, 3 / start)
    return 1 / float(
        minimize_scalar(spread, bounds=bounds, method="bounded", options={"xatol": 1e-13 / start}).x
    )
