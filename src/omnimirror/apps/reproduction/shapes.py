"""Claims about mirrors and their image-forming characteristics: Table 1, Secs. 3.1, 3.2 and 3.4 to 3.6."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from ...analysis.figures.curves import sphere_for
from .claims import Claim, Compute, formula, identity, ordered, printed, unprinted, worded, zero
from .paper import OMEGA_MAX, TABLE_1, THETA_MAX, M, Paper, change, half_range, worst_ratio

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
    rho = 1 / np.sin(THETA_MAX)  # lens to rim; about the lens the surface is rho = (C^2 - B^2)/(C cos theta - B)
    B = rho * (e * np.cos(THETA_MAX) - 1) / (e**2 - 1)
    return float(B * np.sqrt(e**2 - 1)), float(B), float(B * e)


def _slope_law() -> tuple[float, float]:
    """Return the constant K of ``tan[K x/(m + z)] = dz/dx`` for 135 and 12 deg, and its worst deviation from linear.

    The deviation is that of Omega from proportionality to h, relative to full scale.
    """
    K = BETA / TAN

    def meridian(m: float) -> tuple[np.ndarray, np.ndarray]:
        x = np.linspace(0.0, 1.0, 501)
        z = solve_ivp(lambda x, z: np.tan(K * x / (m + z)), (0, 1), [0.0], t_eval=x, rtol=1e-11, atol=1e-13).y[0]
        return x, x / (m + z)

    m = brentq(lambda m: meridian(m)[1][-1] - TAN, 3.0, 5.0)
    tangent = meridian(m)[1]
    omega = 2 * K * tangent + np.arctan(tangent)
    return K, float(np.abs(omega / omega[-1] - tangent / tangent[-1]).max())


def _table_1() -> list[Claim]:
    """Return claims of Table 1: printed parameters give 135 and 12 deg; these requirements give the
    parameters in closed form."""
    closed = "closed form from Ω = 135, Θ = 12 deg: "
    A, B, C = _hyperboloid()

    def field(name: str) -> Claim:
        return printed("Table 1", f"{name}: Ω at x = 1", "2β + θ, Eq. 4", "135",
                       lambda p: np.degrees(p.rim(name).omega[0]), "deg")  # fmt: skip

    def viewing_angle(name: str) -> Claim:
        return printed("Table 1", f"{name}: Θ at x = 1", "arctan[x/(m + z)], Eq. 5", "12",
                       lambda p: np.degrees(p.rim(name).theta[0]), "deg")  # fmt: skip

    def derivative(name: str, order: int) -> Claim:
        title = ("dz/dx", "d²z/dx²")[order - 1]
        return identity("Table 1", f"{name}: {title}", "mirror / Table 1, worst ratio over x = 0.1 to 1",
                        lambda p: _derivative_ratio(name, order))  # fmt: skip

    return [
        *(claim(name) for name in TABLE_1 for claim in (field, viewing_angle)),
        printed("Table 1", "SPH: A", closed + "M / sin β, β = (Ω - Θ)/2", "1.138", lambda p: SPHERE_A, "M"),
        printed("Table 1", "SPH: m", closed + "M / tan Θ - A (1 - cos β)", "4.110", lambda p: SPHERE_M, "M"),
        printed("Table 1", "E-DI: A", "(tan β - 4 B - 6 C)/2, the slope at the rim", "0.6409",
                lambda p: (np.tan(BETA) - 4 * EDI[1] - 6 * EDI[2]) / 2,
                note="one condition for three coefficients; B and C are the authors' choice"),
        printed("Table 1", "E-DI: m", "M / tan Θ - (A + B + C)", "3.919", lambda p: 1 / TAN - sum(EDI), "M"),
        printed("Table 1", "SVP: A", closed + "tan(Ω/2) = K tan(θ/2)", "0.7407", lambda p: A, "M"),
        printed("Table 1", "SVP: B", closed + "tan(Ω/2) = K tan(θ/2)", "1.698", lambda p: B, "M"),
        printed("Table 1", "SVP: C", "sqrt(A² + B²)", "1.852", lambda p: C, "M"),
        printed("Table 1", "SVP: m = B + C", closed + "tan(Ω/2) = K tan(θ/2)", "3.550", lambda p: B + C, "M"),
        formula("Table 1", "SVP: sag at x = 1", "z = -B + (B/A) sqrt(A² + x²); printed with a division",
                -1.698 + 1.698 / 0.7407 / np.sqrt(0.7407**2 + 1), lambda p: float(TABLE_1["SVP"][0].sag(1.0)), "M",
                erratum=1, correct="1.1547918515"),
        *(derivative(name, order) for name in TABLE_1 for order in (1, 2)),
    ]  # fmt: skip


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
        worded("Sec. 3.2, Fig. 5", "E-DI: dh/dΩ is constant", "max / mean of the extremes, Eq. 8", "constant", 1.0,
               lambda p: half_range(p.field("E-DI").dh_domega_px_per_deg)),
        ordered("Sec. 3.2, Fig. 5", "SPH: dh/dΩ decreases with Ω", "largest step of dh/dΩ, Eq. 8", "<=", 0.0,
                largest_step("SPH", rate), "px/deg"),
        ordered("Sec. 3.2, Fig. 5", "SVP: dh/dΩ increases with Ω", "smallest step of dh/dΩ, Eq. 8", ">=", 0.0,
                smallest_step("SVP", rate), "px/deg"),
        zero("Sec. 3.2, Fig. 6", "SVP: V is constant", "spread of z_v, Eq. 6",
               lambda p: p.spread("SVP"), "M", note="with the exact m = B + C = 3.5505 M"),
        ordered("Sec. 3.2, Fig. 6", "SPH: the distribution of viewpoints is the largest",
                "spread of SPH minus that of E-DI, Eq. 6", ">=", 0.0,
                lambda p: p.spread("SPH") - max(p.spread("E-DI"), p.spread("SVP")), "M"),
        formula("Sec. 3.2", "SPH: Δs at 135 deg", "Δs = Δw Δh, Eq. 11; printed as Δw/Δh", 8.84828139545,
                lambda p: p.at("SPH", 135.0).area_px2[0], "px²/deg²", erratum=5, correct="17.212928414"),
        worded("Sec. 3.2, Fig. 7", "SVP: Δw/Δh is constant", "max / mean of the extremes, Eq. 12", "constant", 1.0,
               lambda p: half_range(p.field("SVP").aspect), note="exactly cos θ: 1 to 0.9782"),
        ordered("Sec. 3.2, Fig. 7", "SPH: Δs decreases", "largest step of Δs, Eq. 11", "<=", 0.0,
                largest_step("SPH", area), "px²/deg²"),
        ordered("Sec. 3.2, Fig. 7", "SPH: Δw/Δh increases", "smallest step of Δw/Δh, Eq. 12", ">=", 0.0,
                smallest_step("SPH", aspect)),
        ordered("Sec. 3.2, Fig. 7", "E-DI: Δs increases", "smallest step of Δs, Eq. 11", ">=", 0.0,
                smallest_step("E-DI", area), "px²/deg²"),
        ordered("Sec. 3.2, Fig. 7", "E-DI: Δw/Δh increases", "smallest step of Δw/Δh, Eq. 12", ">=", 0.0,
                smallest_step("E-DI", aspect)),
    ]  # fmt: skip


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
        return unprinted("Sec. 3.4, Fig. 12", f"SPH with Θ = {theta_deg:g} deg: Δs(135)/Δs(0)", "Eq. 11", value,
                         lambda p: relative_area(p, theta_deg))  # fmt: skip

    def at_right_angle(p: Paper) -> float:
        return float(p.at("SPH", 90.0).area_px2[0] / p.at("SPH", 0.0).area_px2[0])

    return [
        worded("Sec. 3.4", "SPH: square objects below 90 deg appear almost as such: Δw/Δh at 90", "Eq. 12", "almost",
               1.0, lambda p: p.at("SPH", 90.0).aspect[0], erratum=19, correct="2.136",
               note="1.19 at 45 deg, 1.37 at 60 deg"),
        worded("Sec. 3.4", "SPH: with approximately equal area: Δs(90)/Δs(0)", "Eq. 11", "almost", 1.0,
               at_right_angle),
        printed("Sec. 3.4, Fig. 12", "SPH: Δs(135)/Δs(0)", "Eq. 11", "70",
                lambda p: 100 * p.field("SPH").area_px2[-1] / p.field("SPH").area_px2[0], "%"),
        worded("Sec. 3.4, Fig. 12", "SPH with Θ = 2 deg: almost equiareal", "Δs(135)/Δs(0), Eq. 11", "almost", 1.0,
               lambda p: relative_area(p, 2.0)),
        figure_12(2, "0.937"), figure_12(4, "0.880"), figure_12(6, "0.827"), figure_12(8, "0.778"),
        figure_12(10, "0.733"), figure_12(12, "0.691"),
        zero("Sec. 3.4", "sphere, orthographic lens: equiareal", "largest / smallest Δs - 1, Eq. 11",
               lambda p: p.telecentric_sphere.area_px2.max() / p.telecentric_sphere.area_px2.min() - 1),
        worded("Sec. 2.3", "sphere: R_t is constant", "max / mean of the extremes, Eq. 14", "constant", 1.0,
               lambda p: half_range(p.field("SPH").radius_t_mm)),
        worded("Sec. 2.3", "sphere: R_s is constant", "max / mean of the extremes, Eq. 18", "constant", 1.0,
               lambda p: half_range(p.field("SPH").radius_s_mm)),
    ]  # fmt: skip


def _equidistant() -> list[Claim]:
    """Return claims of Sec. 3.5."""
    half = float(OMEGA_MAX) / 2  # A of Eq. 22, per M
    return [
        formula("Eq. 22", "equidistant, orthographic lens: sag at x = M", "∫ tan(A x) dx = -(1/A) ln cos(A x)",
                float(np.log(np.cos(half)) / half), lambda p: quad(lambda x: np.tan(half * x), 0, 1)[0], "M",
                erratum=2, correct="0.8153377685", note="the sign is wrong, and A x is printed as a subscript"),
        formula("Sec. 3.5", "constant K in tan[K x/(m + z)] = dz/dx", "K = β_max / tan Θ; printed without K", 1.0,
                lambda p: _slope_law()[0], erratum=3, correct="5.0498"),
        worded("Sec. 3.5", "that mirror with K: h is proportional to Ω", "1 + worst |h/N - Ω/135|, quadrature",
               "proportional", 1.0, lambda p: 1 + _slope_law()[1], note="exactly proportional: β = (k tan θ - θ)/2"),
        worded("Sec. 3.5", "E-DI: an almost equidistant mirror", "1 + worst |h/N - Ω/135|, Eq. 7", "almost", 1.0,
               lambda p: 1 + np.abs(p.field("E-DI").h_px / 500 - p.field("E-DI").omega_deg / 135).max()),
    ]  # fmt: skip


def _single_viewpoint() -> list[Claim]:
    """Return claims of Sec. 3.6."""
    return [
        zero("Sec. 3.6", "paraboloid, orthographic lens: Δw/Δh is 1", "worst |Δw/Δh - 1|, Eq. 12",
               lambda p: np.abs(p.telecentric_paraboloid.aspect - 1).max()),
        zero("Sec. 3.6", "paraboloid, orthographic lens: V is constant", "spread of z_v, Eq. 6",
               lambda p: np.ptp(p.telecentric_paraboloid.viewpoint_z_mm), "mm"),
        worded("Sec. 3.6", "SVP: a small square remains almost a square", "Δw/Δh at 135 deg, Eq. 12", "almost", 1.0,
               lambda p: p.field("SVP").aspect[-1]),
        zero("Sec. 3.6", "SVP: T and S images coincide", "worst |L_t - L_s|, Eqs. 34, 35",
               lambda p: np.abs(p.field("SVP").distance_t_mm - p.field("SVP").distance_s_mm).max() / M, "M"),
    ]  # fmt: skip


def claims() -> list[Claim]:
    return [*_table_1(), *_mapping(), *_sphere(), *_equidistant(), *_single_viewpoint()]
