"""Claims of the paper about mirrors, image formation, depth of field, blur, pixels and viewpoints."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from ...analysis.figures.curves import sphere_for
from ...analysis.figures.subjects import EXACT, PAPER
from ...optics.sensor_files import load_sensor
from ._claims import Claim, Compute, formula, identity, ordered, printed, unprinted, worded, zero
from ._paper_sensors import (
    OMEGA_MAX,
    PITCH,
    RADIUS_PX,
    TABLE_1,
    THETA_MAX,
    M,
    Paper,
    change,
    half_range,
    worst_ratio,
)

# -- Mirrors and image formation: Table 1, Secs. 2.3, 3.2 and 3.4 to 3.6 ---------------------------

TAN = float(np.tan(THETA_MAX))
BETA = float(OMEGA_MAX - THETA_MAX) / 2  # slope angle at the rim

EDI = (0.6409, 0.1550, -0.01)  # A, B and C of Table 1

# -- Table 1 in closed form ------------------------------------------------------------------------

SPHERE_A = 1 / np.sin(BETA)
SPHERE_M = 1 / TAN - SPHERE_A * (1 - np.cos(BETA))


def _hyperboloid() -> tuple[float, float, float]:
    """Return A, B and C of the single-viewpoint mirror, from ``tan(Omega/2) = K tan(theta/2)``."""
    K = np.tan(OMEGA_MAX / 2) / np.tan(THETA_MAX / 2)
    e = (K + 1) / (K - 1)  # C/B
    rho = 1 / np.sin(
        THETA_MAX
    )  # lens to rim; about the lens the surface is rho = (C^2 - B^2)/(C cos theta - B)
    B = rho * (e * np.cos(THETA_MAX) - 1) / (e**2 - 1)
    return float(B * np.sqrt(e**2 - 1)), float(B), float(B * e)


def _slope_law() -> tuple[float, float]:
    """Return the constant K of ``tan[K x/(m + z)] = dz/dx`` for 135 and 12 deg, and its worst deviation from linear.

    The deviation is that of Omega from proportionality to h, relative to full scale.
    """
    K = BETA / TAN

    def meridian(m: float) -> tuple[np.ndarray, np.ndarray]:
        x = np.linspace(0.0, 1.0, 501)
        z = solve_ivp(
            lambda x, z: np.tan(K * x / (m + z)), (0, 1), [0.0], t_eval=x, rtol=1e-11, atol=1e-13
        ).y[0]
        return x, x / (m + z)

    m = brentq(lambda m: meridian(m)[1][-1] - TAN, 3.0, 5.0)
    tangent = meridian(m)[1]
    omega = 2 * K * tangent + np.arctan(tangent)
    return K, float(np.abs(omega / omega[-1] - tangent / tangent[-1]).max())


# The following functions are lists of claims, one function per section of the paper; their length is
# the number of its claims.


def _table_1() -> list[Claim]:
    """Return claims of Table 1: printed parameters give 135 and 12 deg; these requirements give the
    parameters in closed form."""
    closed = "closed form from Ω = 135, Θ = 12 deg: "
    A, B, C = _hyperboloid()

    def field(name: str) -> Claim:
        return printed(
            "Table 1",
            f"{name}: Ω at x = 1",
            "2β + θ, Eq. 4",
            "135",
            lambda p: np.degrees(p.rim(name).omega[0]),
            "deg",
        )

    def viewing_angle(name: str) -> Claim:
        return printed(
            "Table 1",
            f"{name}: Θ at x = 1",
            "arctan[x/(m + z)], Eq. 5",
            "12",
            lambda p: np.degrees(p.rim(name).theta[0]),
            "deg",
        )

    def derivative(name: str, order: int) -> Claim:
        title = ("dz/dx", "d²z/dx²")[order - 1]
        return identity(
            "Table 1",
            f"{name}: {title}",
            "mirror / Table 1, worst ratio over x = 0.1 to 1",
            lambda p: _derivative_ratio(name, order),
        )

    return [
        *(claim(name) for name in TABLE_1 for claim in (field, viewing_angle)),
        printed(
            "Table 1",
            "SPH: A",
            closed + "M / sin β, β = (Ω - Θ)/2",
            "1.138",
            lambda p: SPHERE_A,
            "M",
        ),
        printed(
            "Table 1",
            "SPH: m",
            closed + "M / tan Θ - A (1 - cos β)",
            "4.110",
            lambda p: SPHERE_M,
            "M",
        ),
        printed(
            "Table 1",
            "E-DI: A",
            "(tan β - 4 B - 6 C)/2, the slope at the rim",
            "0.6409",
            lambda p: (np.tan(BETA) - 4 * EDI[1] - 6 * EDI[2]) / 2,
            note="one condition for three coefficients; B and C are the authors' choice",
        ),
        printed(
            "Table 1",
            "E-DI: m",
            "M / tan Θ - (A + B + C)",
            "3.919",
            lambda p: 1 / TAN - sum(EDI),
            "M",
        ),
        printed("Table 1", "SVP: A", closed + "tan(Ω/2) = K tan(θ/2)", "0.7407", lambda p: A, "M"),
        printed("Table 1", "SVP: B", closed + "tan(Ω/2) = K tan(θ/2)", "1.698", lambda p: B, "M"),
        printed("Table 1", "SVP: C", "sqrt(A² + B²)", "1.852", lambda p: C, "M"),
        printed(
            "Table 1",
            "SVP: m = B + C",
            closed + "tan(Ω/2) = K tan(θ/2)",
            "3.550",
            lambda p: B + C,
            "M",
        ),
        formula(
            "Table 1",
            "SVP: sag at x = 1",
            "z = -B + (B/A) sqrt(A² + x²); printed with a division",
            -1.698 + 1.698 / 0.7407 / np.sqrt(0.7407**2 + 1),
            lambda p: float(TABLE_1["SVP"][0].sag(1.0)),
            "M",
            erratum=1,
            correct="1.1547918515",
        ),
        *(derivative(name, order) for name in TABLE_1 for order in (1, 2)),
    ]


def _derivative_ratio(name: str, order: int) -> float:
    """Return the worst ratio of a mirror's derivative to the formula printed in Table 1."""
    x, mirror = np.linspace(0.1, 1.0, 91), TABLE_1[name][0]
    if name == "SPH":
        root = np.sqrt(1.138**2 - x**2)
        formulas = x / root, 1.138**2 / root**3
    elif name == "E-DI":
        A, B, C = EDI
        formulas = 2 * A * x + 4 * B * x**3 + 6 * C * x**5, 2 * A + 12 * B * x**2 + 30 * C * x**4
    else:
        A, B = 0.7407, 1.698
        root = np.sqrt(A**2 + x**2)
        formulas = B / A * x / root, A * B / root**3
    values = mirror.slope(x) if order == 1 else mirror.curvature(x)
    return worst_ratio(values, formulas[order - 1])


def _mapping() -> list[Claim]:
    """Return claims of Sec. 3.2: Figs. 5 to 7."""

    def smallest_step(name: str, column: str) -> Compute:
        return lambda p: change(getattr(p.field(name), column))[0]

    def largest_step(name: str, column: str) -> Compute:
        return lambda p: change(getattr(p.field(name), column))[1]

    rate, area, aspect = "dh_domega_px_per_deg", "area_px2", "aspect"
    return [
        worded(
            "Sec. 3.2, Fig. 5",
            "E-DI: dh/dΩ is constant",
            "max / mean of the extremes, Eq. 8",
            "constant",
            1.0,
            lambda p: half_range(p.field("E-DI").dh_domega_px_per_deg),
        ),
        ordered(
            "Sec. 3.2, Fig. 5",
            "SPH: dh/dΩ decreases with Ω",
            "largest step of dh/dΩ, Eq. 8",
            "<=",
            0.0,
            largest_step("SPH", rate),
            "px/deg",
        ),
        ordered(
            "Sec. 3.2, Fig. 5",
            "SVP: dh/dΩ increases with Ω",
            "smallest step of dh/dΩ, Eq. 8",
            ">=",
            0.0,
            smallest_step("SVP", rate),
            "px/deg",
        ),
        zero(
            "Sec. 3.2, Fig. 6",
            "SVP: V is constant",
            "spread of z_v, Eq. 6",
            lambda p: p.spread("SVP"),
            "M",
            note="with the exact m = B + C = 3.5505 M",
        ),
        ordered(
            "Sec. 3.2, Fig. 6",
            "SPH: the distribution of viewpoints is the largest",
            "spread of SPH minus that of E-DI, Eq. 6",
            ">=",
            0.0,
            lambda p: p.spread("SPH") - max(p.spread("E-DI"), p.spread("SVP")),
            "M",
        ),
        formula(
            "Sec. 3.2",
            "SPH: Δs at 135 deg",
            "Δs = Δw Δh, Eq. 11; printed as Δw/Δh",
            8.84828139545,
            lambda p: p.at("SPH", 135.0).area_px2[0],
            "px²/deg²",
            erratum=5,
            correct="17.212928414",
        ),
        worded(
            "Sec. 3.2, Fig. 7",
            "SVP: Δw/Δh is constant",
            "max / mean of the extremes, Eq. 12",
            "constant",
            1.0,
            lambda p: half_range(p.field("SVP").aspect),
            note="exactly cos θ: 1 to 0.9782",
        ),
        ordered(
            "Sec. 3.2, Fig. 7",
            "SPH: Δs decreases",
            "largest step of Δs, Eq. 11",
            "<=",
            0.0,
            largest_step("SPH", area),
            "px²/deg²",
        ),
        ordered(
            "Sec. 3.2, Fig. 7",
            "SPH: Δw/Δh increases",
            "smallest step of Δw/Δh, Eq. 12",
            ">=",
            0.0,
            smallest_step("SPH", aspect),
        ),
        ordered(
            "Sec. 3.2, Fig. 7",
            "E-DI: Δs increases",
            "smallest step of Δs, Eq. 11",
            ">=",
            0.0,
            smallest_step("E-DI", area),
            "px²/deg²",
        ),
        ordered(
            "Sec. 3.2, Fig. 7",
            "E-DI: Δw/Δh increases",
            "smallest step of Δw/Δh, Eq. 12",
            ">=",
            0.0,
            smallest_step("E-DI", aspect),
        ),
    ]


def _sphere() -> list[Claim]:
    """Return claims of Secs. 2.3 and 3.4."""

    def relative_area(p: Paper, theta_deg: float) -> float:
        """Return Δs(135)/Δs(0) of the spherical mirror for a lens viewing angle at the rim."""
        sensor = sphere_for(p.sensors["SPH"], 135.0, theta_deg, 500.0)
        x = np.array([1e-6, sensor.mirror.rim_radius_mm])
        rays = sensor.meridian.trace(x)
        area = sensor.image_height_px(rays) * sensor.image_height_rate_px(rays) / np.sin(rays.omega)
        return float(area[1] / area[0])

    def figure_12(theta_deg: float, value: str) -> Claim:
        return unprinted(
            "Sec. 3.4, Fig. 12",
            f"SPH with Θ = {theta_deg:g} deg: Δs(135)/Δs(0)",
            "Eq. 11",
            value,
            lambda p: relative_area(p, theta_deg),
        )

    def at_right_angle(p: Paper) -> float:
        return float(p.at("SPH", 90.0).area_px2[0] / p.at("SPH", 0.0).area_px2[0])

    return [
        worded(
            "Sec. 3.4",
            "SPH: square objects below 90 deg appear almost as such: Δw/Δh at 90",
            "Eq. 12",
            "almost",
            1.0,
            lambda p: p.at("SPH", 90.0).aspect[0],
            erratum=19,
            correct="2.136",
            note="1.19 at 45 deg, 1.37 at 60 deg",
        ),
        worded(
            "Sec. 3.4",
            "SPH: with approximately equal area: Δs(90)/Δs(0)",
            "Eq. 11",
            "almost",
            1.0,
            at_right_angle,
        ),
        printed(
            "Sec. 3.4, Fig. 12",
            "SPH: Δs(135)/Δs(0)",
            "Eq. 11",
            "70",
            lambda p: 100 * p.field("SPH").area_px2[-1] / p.field("SPH").area_px2[0],
            "%",
        ),
        worded(
            "Sec. 3.4, Fig. 12",
            "SPH with Θ = 2 deg: almost equiareal",
            "Δs(135)/Δs(0), Eq. 11",
            "almost",
            1.0,
            lambda p: relative_area(p, 2.0),
        ),
        figure_12(2, "0.937"),
        figure_12(4, "0.880"),
        figure_12(6, "0.827"),
        figure_12(8, "0.778"),
        figure_12(10, "0.733"),
        figure_12(12, "0.691"),
        zero(
            "Sec. 3.4",
            "sphere, orthographic lens: equiareal",
            "largest / smallest Δs - 1, Eq. 11",
            lambda p: p.telecentric_sphere.area_px2.max() / p.telecentric_sphere.area_px2.min() - 1,
        ),
        worded(
            "Sec. 2.3",
            "sphere: R_t is constant",
            "max / mean of the extremes, Eq. 14",
            "constant",
            1.0,
            lambda p: half_range(p.field("SPH").radius_t_mm),
        ),
        worded(
            "Sec. 2.3",
            "sphere: R_s is constant",
            "max / mean of the extremes, Eq. 18",
            "constant",
            1.0,
            lambda p: half_range(p.field("SPH").radius_s_mm),
        ),
    ]


def _equidistant() -> list[Claim]:
    """Return claims of Sec. 3.5."""
    half = float(OMEGA_MAX) / 2  # A of Eq. 22, per M
    return [
        formula(
            "Eq. 22",
            "equidistant, orthographic lens: sag at x = M",
            "∫ tan(A x) dx = -(1/A) ln cos(A x)",
            float(np.log(np.cos(half)) / half),
            lambda p: quad(lambda x: np.tan(half * x), 0, 1)[0],
            "M",
            erratum=2,
            correct="0.8153377685",
            note="the sign is wrong, and A x is printed as a subscript",
        ),
        formula(
            "Sec. 3.5",
            "constant K in tan[K x/(m + z)] = dz/dx",
            "K = β_max / tan Θ; printed without K",
            1.0,
            lambda p: _slope_law()[0],
            erratum=3,
            correct="5.0498",
        ),
        worded(
            "Sec. 3.5",
            "that mirror with K: h is proportional to Ω",
            "1 + worst |h/N - Ω/135|, quadrature",
            "proportional",
            1.0,
            lambda p: 1 + _slope_law()[1],
            note="exactly proportional: β = (k tan θ - θ)/2",
        ),
        worded(
            "Sec. 3.5",
            "E-DI: an almost equidistant mirror",
            "1 + worst |h/N - Ω/135|, Eq. 7",
            "almost",
            1.0,
            lambda p: (
                1 + np.abs(p.field("E-DI").h_px / 500 - p.field("E-DI").omega_deg / 135).max()
            ),
        ),
    ]


def _single_viewpoint() -> list[Claim]:
    """Return claims of Sec. 3.6."""
    return [
        zero(
            "Sec. 3.6",
            "paraboloid, orthographic lens: Δw/Δh is 1",
            "worst |Δw/Δh - 1|, Eq. 12",
            lambda p: np.abs(p.telecentric_paraboloid.aspect - 1).max(),
        ),
        zero(
            "Sec. 3.6",
            "paraboloid, orthographic lens: V is constant",
            "spread of z_v, Eq. 6",
            lambda p: np.ptp(p.telecentric_paraboloid.viewpoint_z_mm),
            "mm",
        ),
        worded(
            "Sec. 3.6",
            "SVP: a small square remains almost a square",
            "Δw/Δh at 135 deg, Eq. 12",
            "almost",
            1.0,
            lambda p: p.field("SVP").aspect[-1],
        ),
        zero(
            "Sec. 3.6",
            "SVP: T and S images coincide",
            "worst |L_t - L_s|, Eqs. 34, 35",
            lambda p: np.abs(p.field("SVP").distance_t_mm - p.field("SVP").distance_s_mm).max() / M,
            "M",
        ),
    ]


def mirror_claims() -> list[Claim]:
    return [*_table_1(), *_mapping(), *_sphere(), *_equidistant(), *_single_viewpoint()]


# -- Depth of field, blur, pixels and viewpoints: Secs. 1, 3.3, 3.4, 4.2, 5.1, Appendix ------------

PRINTED_HYPERFOCAL = 6412.0  # mm
PRINTED_FOCUS = {"SPH": 212.0, "E-DI": 205.0, "SVP": 190.0}  # mm
PRINTED_PIXELS = 0.735e6  # Sec. 3.3; correct: 0.785e6


def _printed_depth(name: str) -> float:
    """Return the depth of field as computed in the paper, 2 L0^2/L_inf with the printed numbers, in
    M."""
    return 2 * PRINTED_FOCUS[name] ** 2 / PRINTED_HYPERFOCAL / M


def _optics() -> list[Claim]:
    """Return claims of Sec. 3.3: imager, lens and depth of field."""

    def focal_length(p: Paper) -> float:
        b0 = RADIUS_PX * PITCH / np.tan(THETA_MAX)
        return float(1 / (1 / b0 + 1 / p.lens.focus_distance_mm))

    depth = "2 L0²/L_∞ with the printed L0 and L_∞"
    return [
        printed(
            "Sec. 3.3",
            "pixels of the image circle, in millions",
            "π N²",
            "0.785",
            lambda p: np.pi * RADIUS_PX**2 / 1e6,
        ),
        printed(
            "Sec. 3.3", "image circle 2H", "2 N δ", "5.2", lambda p: 2 * RADIUS_PX * PITCH, "mm"
        ),
        printed(
            "Sec. 3.3",
            "focal length f",
            "1/f = 1/b0 + 1/L0, b0 = N δ / tan Θ",
            "11.6",
            focal_length,
            "mm",
        ),
        printed(
            "Sec. 3.3",
            "hyperfocal distance L_∞",
            "f²/(F δ)",
            "6412",
            lambda p: p.lens.hyperfocal_distance(PITCH),
            "mm",
            erratum=13,
            correct="6469",
            note="6412 mm implies f = 11.549 mm",
        ),
        printed(
            "Sec. 3.3",
            "SPH: depth of field",
            depth,
            "13.7",
            lambda p: _printed_depth("SPH") * M,
            "mm",
            erratum=12,
            correct="14.019",
            exact=lambda p: p.depth_of_field("SPH", EXACT),
            note="the four printed depths imply L_∞ = 6561 mm",
        ),
        printed(
            "Sec. 3.3",
            "SPH: depth of field",
            depth,
            "0.31",
            lambda p: _printed_depth("SPH"),
            "M",
            erratum=12,
            correct="0.3193",
            exact=lambda p: p.depth_of_field("SPH", EXACT) / M,
        ),
        printed(
            "Sec. 3.3",
            "E-DI: depth of field",
            depth,
            "0.3",
            lambda p: _printed_depth("E-DI"),
            "M",
            exact=lambda p: p.depth_of_field("E-DI", EXACT) / M,
        ),
        printed(
            "Sec. 3.3",
            "SVP: depth of field",
            depth,
            "0.25",
            lambda p: _printed_depth("SVP"),
            "M",
            erratum=12,
            correct="0.2565",
            exact=lambda p: p.depth_of_field("SVP", EXACT) / M,
        ),
    ]


def _appendix() -> list[Claim]:
    """Return Eqs. 24 to 36 as identities between quantities that omnimirror computes separately."""

    def thin_lens(p: Paper) -> float:
        return p.lens.focal_length_mm * (1 / p.lens.focus_distance_mm + 1 / p.lens.image_distance)

    def conjugate(p: Paper, distance: np.ndarray) -> np.ndarray:
        """Return the image distance b of Eq. 26."""
        return 1 / (1 / p.lens.focal_length_mm - 1 / distance)

    def blur_by_triangles(p: Paper) -> float:
        """Return Eq. 27 with the diameter D of Eq. 24."""
        e, lens = p.field("SPH", EXACT), p.lens
        b = conjugate(p, e.distance_t_mm)
        delta = lens.focal_length_mm / lens.f_number * (lens.image_distance - b) / b
        return worst_ratio(e.blur_t_px, delta / PITCH)

    def blur_in_closed_form(p: Paper) -> float:
        e, lens = p.field("SPH", EXACT), p.lens
        f, L0, L = lens.focal_length_mm, lens.focus_distance_mm, e.distance_t_mm
        return worst_ratio(e.blur_t_px, f**2 / lens.f_number * (L - L0) / ((L0 - f) * L) / PITCH)

    def limit(p: Paper, sign: int) -> float:
        f, L0 = p.lens.focal_length_mm, p.lens.focus_distance_mm
        return f**2 * L0 / (f**2 - sign * PITCH * p.lens.f_number * L0)

    def distance(p: Paper, kind: str) -> float:
        e = p.field("SPH")
        L = p.sensors["SPH"].meridian.m + getattr(e, f"image_{kind}_z_mm")
        return worst_ratio(getattr(e, f"distance_{kind}_mm"), L)

    def angular_blur(p: Paper) -> float:
        e, lens = p.field("SPH"), p.lens
        L0, L = lens.focus_distance_mm, e.distance_t_mm
        delta_px = lens.focal_length_mm**2 / lens.f_number * (L - L0) / (L * L0) / PITCH
        return worst_ratio(e.blur_t_deg, delta_px / e.dh_domega_px_per_deg)

    return [
        identity(
            "Eq. 24",
            "F = f/D",
            "F × aperture diameter of the traced edge rays / f",
            lambda p: p.lens.f_number * p.aperture_diameter_mm / p.lens.focal_length_mm,
        ),
        identity("Eq. 25", "1/L0 + 1/b0 = 1/f", "f (1/L0 + 1/b0), b0 of the lens", thin_lens),
        identity(
            "Eqs. 26, 27",
            "Δ/D = (b0 - b)/b",
            "worst ratio over 0 to 135 deg, SPH",
            blur_by_triangles,
        ),
        identity(
            "Eq. 28", "Δ in closed form", "worst ratio over 0 to 135 deg, SPH", blur_in_closed_form
        ),
        unprinted(
            "Eq. 30",
            "far limit of the depth of field, SPH",
            "f² L0/(f² - δ F L0)",
            "219.18",
            lambda p: p.field("SPH").depth_of_field_mm.far,
            "mm",
            exact=lambda p: p.field("SPH", EXACT).depth_of_field_mm.far,
            note="exact: f² L0/[f² - δ F (L0 - f)]",
        ),
        unprinted(
            "Eq. 31",
            "near limit of the depth of field, SPH",
            "f² L0/(f² + δ F L0)",
            "205.27",
            lambda p: p.field("SPH").depth_of_field_mm.near,
            "mm",
            exact=lambda p: p.field("SPH", EXACT).depth_of_field_mm.near,
        ),
        identity(
            "Eq. 32",
            "L_f - L_r",
            "depth of field / difference of Eqs. 30 and 31",
            lambda p: p.depth_of_field("SPH") / (limit(p, 1) - limit(p, -1)),
        ),
        worded(
            "Eq. 33",
            "2 L0²/L_∞ approximates Eq. 32",
            "ratio of the two at L0 = 212 mm",
            "almost",
            1.0,
            lambda p: (
                2
                * p.lens.focus_distance_mm**2
                / p.lens.hyperfocal_distance(PITCH)
                / p.depth_of_field("SPH")
            ),
            note="'≈' for L_∞ ≫ L0",
        ),
        identity(
            "Eq. 34",
            "L_t = m + z_qt",
            "worst ratio over 0 to 135 deg, SPH",
            lambda p: distance(p, "t"),
        ),
        identity(
            "Eq. 35",
            "L_s = m + z_qs",
            "worst ratio over 0 to 135 deg, SPH",
            lambda p: distance(p, "s"),
        ),
        identity("Eq. 36", "Δ_t/Δh", "worst ratio over 0 to 135 deg, SPH, Eq. 29", angular_blur),
        formula(
            "Eq. 37",
            "SPH: Δ_s/Δw at 135 deg",
            "Eq. 37 with L_s; printed with L_t",
            0.0172399853,
            lambda p: p.at("SPH", 135.0).blur_s_deg[0],
            "deg",
            erratum=7,
            correct="0.680977331",
            exact=lambda p: p.at("SPH", 135.0, EXACT).blur_s_deg[0],
        ),
    ]


def _spots() -> list[Claim]:
    """Return claims of Secs. 3.3 and 3.4, Figs. 4 and 9 to 11: virtual images, blur and best focus."""

    def leaves(name: str, kind: str, word: str) -> Claim:
        return ordered(
            "Sec. 3.3, Fig. 4",
            f"{name}: {word} images leave the depth of field",
            "largest |Δ| for p = ∞, Eq. 29",
            ">=",
            1.0,
            lambda p: p.worst_blur_px(name, kind),
            "px",
            exact=lambda p: p.worst_blur_px(name, kind, EXACT),
        )

    def best_focus(name: str, **more: str) -> Claim:
        return printed(
            "Sec. 3.3, Fig. 9",
            f"{name}: best L0",
            "minimises the largest |Δ_t Δ_s/(Δh Δw)|, Eq. 29",
            f"{PRINTED_FOCUS[name]:g}",
            lambda p: p.best_focus(name).focus_mm,
            "mm",
            **more,
        )

    return [
        ordered(
            "Sec. 3.3, Fig. 4",
            "SPH: tangential images within the depth of field, p = ∞",
            "largest |Δ_t|, Eq. 29",
            "<=",
            1.0,
            lambda p: p.worst_blur_px("SPH", "t"),
            "px",
            exact=lambda p: p.worst_blur_px("SPH", "t", EXACT),
            note="holds with the approximation of Eq. 29, not with Eq. 28",
        ),
        ordered(
            "Sec. 3.4, Fig. 4",
            "SPH: tangential images within the depth of field, p = 5 M",
            "largest |Δ_t|, Eq. 29",
            "<=",
            1.0,
            lambda p: p.worst_blur_px("SPH", "t", PAPER, 5 * M),
            "px",
            erratum=11,
            correct="1.376",
            exact=lambda p: p.worst_blur_px("SPH", "t", EXACT, 5 * M),
        ),
        leaves("E-DI", "t", "tangential"),
        leaves("SVP", "t", "tangential"),
        leaves("SPH", "s", "sagittal"),
        leaves("E-DI", "s", "sagittal"),
        leaves("SVP", "s", "sagittal"),
        best_focus("SPH"),
        best_focus(
            "E-DI",
            correct="206.0",
            note="'by trial and error'; no merit tried yields 212, 205 and 190 mm together",
        ),
        best_focus("SVP", correct="172.5", note="see the next row"),
        Claim(
            "Secs. 3.3, 3.6",
            "SVP: L0 that focuses the peripheral area",
            "L_t = L_s at 105 deg, the field of the hyperboloidal prototype",
            lambda p: p.at("SVP", 105.0).distance_t_mm[0],
            "190",
            190.0,
            5.0,
            unit="mm",
            is_assumed=True,
            note="105 deg was chosen because it yields 190 mm; the paper states no angle",
        ),
        printed(
            "Sec. 3.4",
            "SPH: tangential blur at the best L0, 'almost' less than",
            "largest |Δ_t|, Eq. 28",
            "1",
            lambda p: p.worst_blur_px("SPH", "t", EXACT),
            "px",
        ),
        ordered(
            "Sec. 3.5",
            "E-DI: F-number for which the whole field is sharp to 1 px, 'larger'",
            "4 × largest single blur at its best focus, Eq. 29",
            ">=",
            4.0,
            lambda p: 4 * p.worst_at_best("E-DI"),
            note="diffraction neglected; at F/24 the Airy disc is 6.5 px",
        ),
    ]


def _pixels() -> list[Claim]:
    """Return claims of Secs. 1 and 3.3: coverage, and the solid angle of a pixel."""
    return [
        printed(
            "Sec. 3.3", "whole sphere", "4π (180/π)²", "41253", lambda p: p.square_degrees, "deg²"
        ),
        printed(
            "Sec. 3.3",
            "coverage of 0 to 135 deg",
            "(1 - cos Ω)/2",
            "0.8356",
            lambda p: p.coverage,
            erratum=9,
            correct="0.8536",
            note="digits exchanged",
        ),
        printed(
            "Sec. 1",
            "observed share of the sphere, 'almost'",
            "(1 - cos Ω)/2",
            "80",
            lambda p: 100 * p.coverage,
            "%",
            erratum=17,
            correct="85.36",
        ),
        printed(
            "Sec. 3.3",
            "π × 500², in millions",
            "π N²",
            "0.735",
            lambda p: np.pi * RADIUS_PX**2 / 1e6,
            erratum=8,
            correct="0.785",
            note="given correctly earlier in the section",
        ),
        printed(
            "Sec. 3.3",
            "41253 × 0.8356/0.735e6",
            "the printed arithmetic",
            "0.048",
            lambda p: 41253 * 0.8356 / PRINTED_PIXELS,
            "deg²",
            erratum=9,
            correct="0.0469",
            note="0.048 follows from the coverage 0.8536 that erratum 9 restores; see the next row",
        ),
        printed(
            "Sec. 3.3",
            "mean solid angle of a pixel, with the printed number of pixels",
            "41253 × (1 - cos Ω)/2 / 0.735e6",
            "0.048",
            lambda p: p.square_degrees * p.coverage / PRINTED_PIXELS,
            "deg²",
            exact=lambda p: p.mean_pixel_deg2,
            note="the value is too large because of erratum 8",
        ),
        printed(
            "Sec. 3.3, Fig. 11",
            "side of the mean pixel",
            "square root, with the correct number of pixels",
            "0.21",
            lambda p: np.sqrt(p.mean_pixel_deg2),
            "deg",
            note="(0.21 deg)² is 0.044 deg², not 0.048",
        ),
    ]


def _viewpoints() -> list[Claim]:
    """Return claims of Sec. 4.2, Fig. 15."""
    return [
        printed(
            "Sec. 4.2, Fig. 15",
            "SPH: error of a single viewpoint at 40 M, ±",
            "minimised largest error in the image",
            "1",
            lambda p: p.one_viewpoint(40).worst_px,
            "px",
        ),
        printed(
            "Sec. 4.2, Fig. 15",
            "SPH: error of a single viewpoint at 7 M, ±",
            "minimised largest error in the image",
            "5",
            lambda p: p.one_viewpoint(7).worst_px,
            "px",
        ),
        ordered(
            "Sec. 4.2",
            "SPH has the largest influence of viewpoints: error at 7 M minus that of E-DI",
            "minimised largest |ε|, Eq. 23",
            ">=",
            0.0,
            lambda p: p.viewpoint_error_deg(7, "SPH") - p.viewpoint_error_deg(7, "E-DI"),
            "deg",
            note="2.35 and 1.50 deg; in pixels E-DI is worse (5.58 against 4.93 px), since dh/dΩ is larger there",
        ),
        printed("Sec. 4.2", "distance of 40 M", "40 × 43.9 mm", "180", lambda p: 40 * M / 10, "cm"),
        printed(
            "Sec. 4.2", "distance of 7 M, 'about'", "7 × 43.9 mm", "30", lambda p: 7 * M / 10, "cm"
        ),
        zero(
            "Sec. 4.2",
            "SVP: no error at any distance",
            "minimised largest error at 7 M",
            lambda p: p.one_viewpoint(7, "SVP").worst_px,
            "px",
        ),
    ]


def _prototypes() -> list[Claim]:
    """Return claims of Sec. 5.1: consistency of the prototypes with the theory."""
    beta = np.radians(135.0 - 12.0) / 2
    return [
        printed(
            "Sec. 5.1",
            "spherical prototype: diameter that observes 135 deg",
            "2 A sin β, A = 50 mm, Θ = 12 deg",
            "88",
            lambda p: 2 * 50.0 * np.sin(beta),
            "mm",
        ),
        printed(
            "Secs. 3.3, 5.1",
            "M of a hemisphere of 100 mm diameter",
            "A sin β, Θ = 12 deg",
            "43.9",
            lambda p: 50.0 * np.sin(beta),
            "mm",
        ),
        printed(
            "Sec. 5.1",
            "hyperboloidal prototype: largest field angle at 60 mm diameter",
            "field of the bundled sensor of that rim",
            "105",
            lambda p: load_sensor("prototype-hyperboloidal").field_deg[1],
            "deg",
            is_assumed=True,
            note="its parameters are not printed; the bundled sensor is designed for this field and Θ = 12 deg",
        ),
    ]


def image_claims() -> list[Claim]:
    return [*_optics(), *_appendix(), *_spots(), *_pixels(), *_viewpoints(), *_prototypes()]
