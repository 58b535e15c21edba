"""What a mirror is in the words of other programs: a conic, a straight line, an asphere or a spline.

Every form states how far it lies from the mirror, along the mirror's normal and in micrometres; a form
that is the mirror itself says 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...mirrors.conics import Conic, conic_profile, conic_reach

Array = NDArray[np.float64]

EXACT_UM = 1e-6
"""A deviation below this is rounding: the form is the mirror. An atom is a hundred times as wide."""
TERMS = 8
"""Even powers r^2 .. r^16 of OpticStudio's even asphere, and powers r^1 .. r^8 of its odd one."""


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
    """``c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum a_i r^p_i``, what lens programs take for a mirror.

    Attributes
    ----------
    kind : "even" or "odd"
        The powers are 2, 4, .. 16, or 1, 2, .. 8 for a mirror with a point.
    curvature : c = 1/R, 1/mm
    conic : k
    coefficients : the eight a_i, mm^(1 - p_i)
    deviation_um : largest distance from the mirror
    """

    kind: str
    curvature: float
    conic: float
    coefficients: tuple[float, ...]
    deviation_um: float = 0.0

    @property
    def powers(self) -> tuple[int, ...]:
        step = 2 if self.kind == "even" else 1
        return tuple(step * (i + 1) for i in range(TERMS))

    def sag(self, r: Array) -> Array:
        """Height over the vertex plane, mm."""
        z = np.zeros_like(r)
        if self.curvature:
            z = conic_profile(r, 1 / self.curvature, self.conic)[0]
        for power, a in zip(self.powers, self.coefficients, strict=True):
            z = z + a * r**power
        return z


def asphere_of(mirror: Mirror) -> Asphere:
    """The mirror as an asphere of eight terms: exact where it is one, else the closest by least squares.

    Examples
    --------
    >>> from omnimirror.mirrors import Cone, Equidistant
    >>> asphere_of(Cone(45.0, 20.0)).coefficients[0].__round__(12)
    1.0
    >>> asphere_of(Equidistant(135.0, 12.0, 43.9)).deviation_um < 0.5
    True
    """
    form = _exact_asphere(mirror) or _fitted_asphere(mirror)
    x = nodes(mirror)
    worst = float(np.abs(deviation_um(mirror, x, form.sag(x))).max())
    return Asphere(form.kind, form.curvature, form.conic, form.coefficients, worst if worst > EXACT_UM else 0.0)


def _exact_asphere(mirror: Mirror) -> Asphere | None:
    if conic := conic_of(mirror):
        return Asphere("even", 1 / conic[0], conic[1], (0.0,) * TERMS)
    if is_straight(mirror):
        return Asphere("odd", 0.0, 0.0, (float(mirror.slope(0.0)), *(0.0,) * (TERMS - 1)))
    if not isinstance(mirror, EvenPolynomial | ConicAsphere):
        return None
    N = mirror.normalization_radius_mm
    if isinstance(mirror, EvenPolynomial):  # the r^2 term is a paraboloid, which gives the vertex radius its place
        first, c, k = 2 * mirror.coefficients[0] / N, mirror.coefficients[1:], -1.0
    else:
        first, c, k = 1 / mirror.vertex_radius_mm, mirror.coefficients, mirror.conic
    if any(c[TERMS - 1 :]):
        return None
    terms = [a * N ** (1 - 2 * i) for i, a in enumerate(c[: TERMS - 1], start=2)]
    return Asphere("even", first, k, (0.0, *terms, *(0.0,) * (TERMS - 1 - len(terms))))


def _fitted_asphere(mirror: Mirror) -> Asphere:
    """Least squares of the normal distance; of a smooth mirror the vertex radius is given and k searched.

    The vertex radius is the mirror's own, or, where it does better (a measured profile may have a bump there),
    that of the even polynomial through the whole mirror.
    """
    M, x = mirror.rim_radius_mm, nodes(mirror, 401)
    z, slope, curvature = mirror.profile(x)
    weight = 1 / np.sqrt(1 + slope**2)

    def solve(rest: Array, powers: tuple[int, ...]) -> tuple[Array, float]:
        matrix = weight[:, None] * (x[:, None] / M) ** np.array(powers)
        scaled = np.linalg.lstsq(matrix, weight * rest, rcond=None)[0]
        return scaled / M ** np.array(powers, float), float(np.abs(matrix @ scaled - weight * rest).max())

    if mirror.is_pointed:
        return Asphere("odd", 0.0, 0.0, tuple(map(float, solve(z, tuple(range(1, TERMS + 1)))[0])))
    powers = tuple(2 * i for i in range(2, TERMS + 1))

    def fitted(c: float, k: float) -> tuple[Array, float]:
        return solve(z - (conic_profile(x, 1 / c, k)[0] if c else 0.0), powers)

    curvatures = [float(curvature[0]), float(2 * solve(z, (2, *powers))[0][0])]
    shapes = [(c, _best_conic(lambda k, c=c: fitted(c, k)[1], c, M) if c > 0 else 0.0) for c in curvatures]  # type: ignore[misc]
    c, k = min(shapes, key=lambda shape: fitted(*shape)[1])
    return Asphere("even", c, k, (0.0, *map(float, fitted(c, k)[0])))


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
class Curve:
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


def curve_of(mirror: Mirror, start_mm: float = 0.0, tolerance_um: float = 0.01) -> Curve:
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
        return Curve("line", ends, words="straight line")
    conic = conic_of(mirror)
    if conic and conic[1] == 0.0:
        return Curve("arc", ends, radius_mm=conic[0], words=f"arc of {conic[0]:.9g} mm")
    if conic:
        return _conic_arc(mirror, ends, conic)
    return _spline(mirror, ends, tolerance_um)


def _conic_arc(mirror: Mirror, ends: Ends, conic: tuple[float, float]) -> Curve:
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
    return Curve("spline", ends, 0.0, 2, knots, poles, (1.0, weight, 1.0), 0.0, "conic")


def _spline(mirror: Mirror, ends: Ends, tolerance_um: float) -> Curve:
    """A quintic spline by arc length, doubled in points until it is close enough or gains nothing more."""
    from scipy.integrate import cumulative_simpson
    from scipy.interpolate import PchipInterpolator, make_interp_spline

    start, rim = ends[0][0], ends[1][0]
    fine = np.linspace(start, rim, 4097)
    length = cumulative_simpson(np.sqrt(1 + mirror.slope(fine) ** 2), x=fine, initial=0.0)
    x_of_length = PchipInterpolator(length, fine)
    best: Curve | None = None
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
            best = Curve("spline", ends, 0.0, 5, tuple(map(float, spline.t)), poles, None, worst, words)
        if worst <= tolerance_um:
            break
    assert best is not None
    return best


def chords(mirror: Mirror, tolerance_um: float, start_mm: float = 0.0) -> Array:
    """Distances from the axis (mm) of points whose chords stay within a tolerance of the meridian.

    Steps follow the curvature: a chord c of a curve of radius R_t lies c^2 / (8 R_t) from it. A tenth of
    the tolerance is left for the change of curvature along a step.
    """
    fine = np.linspace(start_mm, mirror.rim_radius_mm, 8193)
    _, slope, curvature = mirror.profile(fine)
    kappa = np.abs(curvature) / (1 + slope**2) ** 1.5
    # points per mm of arc, from the local curvature; at least eight in all, for nearly straight meridians
    density = np.sqrt(1 + slope**2) * np.sqrt(kappa / (8 * 0.9e-3 * tolerance_um))
    count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
    total = int(np.ceil(count[-1]))
    if total <= 1 and not np.any(curvature):
        return fine[[0, -1]]
    total = max(total, 8)
    floor = np.linspace(0.0, 1e-3 * max(count[-1], 1.0), fine.size)  # keeps the count growing where it is flat
    points: Array = np.interp(np.linspace(0.0, 1.0, total + 1), (count + floor) / (count + floor)[-1], fine)
    return points
