"""Claims about mirrors and their image-forming characteristics: Table 1, Secs. 3.1, 3.2 and 3.4 to 3.6."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from ..analysis.evaluation import evaluate
from ..figures import draw
from ..figures.curves import sphere_for
from ..mirrors import Equidistant
from ..specs import load_sensor
from .claims import Claim
from .paper import OMEGA_MAX, PAPER, TABLE_1, THETA_MAX, M, Paper, change

TAN = float(np.tan(THETA_MAX))
BETA = float(OMEGA_MAX - THETA_MAX) / 2  # slope angle at the rim

EDI = (0.6409, 0.1550, -0.01)  # A, B and C of Table 1
CHOSEN = "one condition for three numbers; which of the mirrors that meet it is the authors' choice"

# -- what the mirrors of Table 1 are by closed forms -------------------------------------------

SPHERE_A = 1 / np.sin(BETA)
SPHERE_M = 1 / TAN - SPHERE_A * (1 - np.cos(BETA))


def _hyperboloid() -> tuple[float, float, float]:
    """A, B and C of the single viewpoint mirror, from ``tan(Omega/2) = K tan(theta/2)``."""
    K = np.tan(OMEGA_MAX / 2) / np.tan(THETA_MAX / 2)
    e = (K + 1) / (K - 1)  # C/B
    rho = 1 / np.sin(THETA_MAX)  # lens to rim; about the lens the surface is rho = (C^2 - B^2)/(C cos theta - B)
    B = rho * (e * np.cos(THETA_MAX) - 1) / (e**2 - 1)
    return float(B * np.sqrt(e**2 - 1)), float(B), float(B * e)


def _slope_law() -> tuple[float, float]:
    """Constant K of ``tan[K x/(m + z)] = dz/dx`` that meets 135 and 12 deg; worst deviation from linear.

    The deviation is that of Omega from proportional to h, as a share of the full scale.
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
    """Parameters as printed give 135 and 12 deg; the same demands in closed form give the parameters."""
    claims = []
    for name in TABLE_1:
        claims += [
            Claim("Table 1", f"{name}: Ω at x = 1", "2 arctan(dz/dx) + arctan[x/(m + z)], Eqs. 1-5", 135, 0.5,
                  lambda p, n=name: np.degrees(p.rim(n).omega[0]), "deg"),  # type: ignore[misc]
            Claim("Table 1", f"{name}: Θ at x = 1", "arctan[x/(m + z)], Eq. 5", 12, 0.5,
                  lambda p, n=name: np.degrees(p.rim(n).theta[0]), "deg"),  # type: ignore[misc]
        ]  # fmt: skip
    closed = "closed form from Ω = 135, Θ = 12 deg: "
    A, B, C = _hyperboloid()
    return [
        *claims,
        Claim("Table 1", "SPH: A", closed + "M / sin β, β = (Ω - Θ)/2", 1.138, 5e-4, lambda p: SPHERE_A, "M"),
        Claim("Table 1", "SPH: m", closed + "M / tan Θ - A (1 - cos β)", 4.110, 5e-4, lambda p: SPHERE_M, "M"),
        Claim("Table 1", "E-DI: A", "(tan β - 4 B - 6 C)/2, the slope at the rim", 0.6409, 5e-5,
              lambda p: (np.tan(BETA) - 4 * EDI[1] - 6 * EDI[2]) / 2, note=CHOSEN),
        Claim("Table 1", "E-DI: B", "(tan β - 2 A - 6 C)/4, the slope at the rim", 0.1550, 5e-5,
              lambda p: (np.tan(BETA) - 2 * EDI[0] - 6 * EDI[2]) / 4, note=CHOSEN),
        Claim("Table 1", "E-DI: C", "(tan β - 2 A - 4 B)/6, the slope at the rim", -0.01, 5e-3,
              lambda p: (np.tan(BETA) - 2 * EDI[0] - 4 * EDI[1]) / 6, note=CHOSEN),
        Claim("Table 1", "E-DI: m", "M / tan Θ - (A + B + C)", 3.919, 5e-4, lambda p: 1 / TAN - sum(EDI), "M"),
        Claim("Table 1", "SVP: A", closed + "tan(Ω/2) = K tan(θ/2)", 0.7407, 5e-5, lambda p: A, "M"),
        Claim("Table 1", "SVP: B", closed + "tan(Ω/2) = K tan(θ/2)", 1.698, 5e-4, lambda p: B, "M"),
        Claim("Table 1", "SVP: C", "sqrt(A² + B²)", 1.852, 5e-4, lambda p: C, "M"),
        Claim("Table 1", "SVP: m = B + C", closed + "tan(Ω/2) = K tan(θ/2)", 3.550, 5e-4, lambda p: B + C, "M"),
        Claim("Table 1", "SVP: sag at x = 1", "z = -B + (B/A) sqrt(A² + x²); printed with a division",
              -1.698 + 1.698 / 0.7407 / np.sqrt(0.7407**2 + 1), 5e-4, lambda p: float(TABLE_1["SVP"][0].sag(1.0)), "M",
              erratum=1, corrected=1.1547918515, corrected_tolerance=5e-11),
    ]  # fmt: skip


def _mapping() -> list[Claim]:
    """Sec. 3.2: Figs. 5 to 8."""

    def steps(p: Paper, name: str, column: str) -> tuple[float, float]:
        return change(getattr(p.field(name), column))

    def wobble(p: Paper) -> float:
        rate = p.field("E-DI").dh_domega_px_per_deg
        return float((rate.max() - rate.min()) / (rate.max() + rate.min()))

    return [
        Claim("Sec. 3.2, Fig. 5", "E-DI: dh/dΩ is constant", "(max - min)/(max + min) of Eq. 8", 0.0, 0.025, wobble,
              reading="'constant' is read as within 2.5 %"),
        Claim("Sec. 3.2, Fig. 5", "SPH: dh/dΩ decreases with Ω", "largest step of dh/dΩ, Eq. 8", 0.0, 0.0,
              lambda p: steps(p, "SPH", "dh_domega_px_per_deg")[1], "px/deg", "<="),
        Claim("Sec. 3.2, Fig. 5", "SVP: dh/dΩ increases with Ω", "smallest step of dh/dΩ, Eq. 8", 0.0, 0.0,
              lambda p: steps(p, "SVP", "dh_domega_px_per_deg")[0], "px/deg", ">="),
        Claim("Sec. 3.2, Fig. 6", "SVP: V is constant", "highest - lowest z_v, Eq. 6", 0.0, 1e-9,
              lambda p: p.spread("SVP"), "M", note="with the exact m = B + C = 3.5505 M"),
        Claim("Sec. 3.2, Fig. 6", "SPH: viewpoints spread farthest", "spread of SPH - that of E-DI, Eq. 6", 0.0, 0.0,
              lambda p: p.spread("SPH") - max(p.spread("E-DI"), p.spread("SVP")), "M", ">="),
        Claim("Sec. 3.2", "SPH: Δs at 135 deg, printed as Δw/Δh", "Δs = Δw Δh, Eq. 11", 8.84828139545, 5e-4,
              lambda p: p.at("SPH", 135.0).area_px2[0], "px²/deg²",
              erratum=5, corrected=17.2129284140, corrected_tolerance=5e-9),
        Claim("Sec. 3.2, Fig. 7", "SVP: Δw/Δh is constant, 1 up to 135 deg", "Δw/Δh = cos θ, Eq. 12", 1.0, 5e-3,
              lambda p: p.field("SVP").aspect[-1], erratum=6, corrected=0.97815, corrected_tolerance=5e-5,
              note="aspect is cos θ exactly: 0.978 at the rim"),
        Claim("Sec. 3.2, Fig. 7", "SPH: Δs decreases", "largest step of Δs, Eq. 11", 0.0, 0.0,
              lambda p: steps(p, "SPH", "area_px2")[1], "px²/deg²", "<="),
        Claim("Sec. 3.2, Fig. 7", "SPH: Δw/Δh increases", "smallest step of Δw/Δh, Eq. 12", 0.0, 0.0,
              lambda p: steps(p, "SPH", "aspect")[0], "", ">="),
        Claim("Sec. 3.2, Fig. 7", "E-DI: Δs increases", "smallest step of Δs, Eq. 11", 0.0, 0.0,
              lambda p: steps(p, "E-DI", "area_px2")[0], "px²/deg²", ">="),
        Claim("Sec. 3.2, Fig. 7", "E-DI: Δw/Δh increases", "smallest step of Δw/Δh, Eq. 12", 0.0, 0.0,
              lambda p: steps(p, "E-DI", "aspect")[0], "", ">="),
        Claim("Fig. 8, caption", "mirrors shown; the caption names two, and (c) by the figure's own title",
              "panels of the figure", 2, 0.5, lambda p: len(draw("fig8", list(p.sensors.values()), PAPER).axes),
              erratum=14, corrected=3, note="(c) is the single viewpoint mirror"),
    ]  # fmt: skip


def _sphere() -> list[Claim]:
    """Sec. 3.4."""

    def kept(p: Paper) -> float:
        area = p.field("SPH").area_px2
        return float(area[-1] / area[0])

    def long_lens(p: Paper) -> float:
        sensor = sphere_for(p.sensors["SPH"], 135.0, 2.0, 500.0)
        x = np.array([1e-6, sensor.mirror.rim_radius_mm])
        rays = sensor.meridian.trace(x)
        area = sensor.image_height_px(rays) * sensor.image_height_rate_px(rays) / np.sin(rays.omega)
        return float(area[1] / area[0])

    return [
        Claim("Sec. 3.4", "SPH: square objects below 90 deg appear almost as such: Δw/Δh at 90", "Eq. 12", 1.0, 0.10,
              lambda p: p.at("SPH", 90.0).aspect[0], erratum=19, corrected=2.136, corrected_tolerance=5e-4,
              reading="'almost' is read as 10 %", note="1.19 at 45 deg, 1.37 at 60 deg"),
        Claim("Sec. 3.4", "SPH: with approximately equal area: Δs(90)/Δs(0)", "Eq. 11", 1.0, 0.15,
              lambda p: p.at("SPH", 90.0).area_px2[0] / p.at("SPH", 0.0).area_px2[0],
              reading="'approximately' is read as 15 %"),
        Claim("Sec. 3.4, Fig. 12", "SPH: Δs(135) / Δs(0)", "Eq. 11", 0.70, 0.05, kept,
              reading="'70 %' is read as one significant digit"),
        Claim("Sec. 3.4, Fig. 12", "SPH with Θ = 2 deg: almost equiareal", "Δs(135)/Δs(0), Eq. 11", 1.0, 0.10,
              long_lens, reading="'almost' is read as 10 %"),
        Claim("Sec. 3.4", "sphere, orthographic lens: equiareal", "largest / smallest Δs, Eq. 11", 1.0, 1e-9,
              lambda p: p.telecentric_sphere.area_px2.max() / p.telecentric_sphere.area_px2.min()),
        Claim("Sec. 2.3", "sphere: R_t is constant", "largest / smallest, Eq. 14", 1.0, 1e-9,
              lambda p: p.field("SPH").radius_t_mm.max() / p.field("SPH").radius_t_mm.min()),
        Claim("Sec. 2.3", "sphere: R_s is constant", "largest / smallest, Eq. 18", 1.0, 1e-9,
              lambda p: p.field("SPH").radius_s_mm.max() / p.field("SPH").radius_s_mm.min()),
    ]  # fmt: skip


def _equidistant() -> list[Claim]:
    """Sec. 3.5."""

    def exact_deviation() -> float:
        rays = Equidistant(135.0, 12.0, M)
        sensor = replace(load_sensor("paper-equidistant"), mirror=rays, mirror_distance_mm=rays.design_distance)
        result = evaluate(sensor, np.arange(0, 135.25, 0.5), image_radius_px=500.0)
        return float(np.abs(result.h_px / 500 - result.omega_deg / 135).max())

    half = float(OMEGA_MAX) / 2  # A of Eq. 22, per M
    return [
        Claim("Eq. 22", "equidistant, orthographic lens: sag at x = M", "∫ tan(A x) dx = -(1/A) ln cos(A x)",
              float(np.log(np.cos(half)) / half), 5e-4, lambda p: quad(lambda x: np.tan(half * x), 0, 1)[0], "M",
              erratum=2, corrected=0.8153377685, corrected_tolerance=5e-10,
              note="the sign is wrong and A x is printed as a subscript"),
        Claim("Sec. 3.5", "constant in tan[K x/(m + z)] = dz/dx", "K = β_max / tan Θ", 1.0, 0.5,
              lambda p: _slope_law()[0], erratum=3, corrected=5.0498, corrected_tolerance=5e-5,
              note="printed without K, that is with K = 1"),
        Claim("Sec. 3.5", "that mirror is equidistant: deviation from linear", "quadrature of the printed "
              "equation with K", 0.0, 0.0001, lambda p: _slope_law()[1], erratum=3, corrected=0.0005,
              corrected_tolerance=5e-5, note="0.05 % of full scale; exact: β = (k tan θ - θ)/2"),
        Claim("Sec. 3.5", "E-DI: an almost equidistant mirror", "worst |h/N - Ω/135|, Eq. 7", 0.0, 0.005,
              lambda p: float(np.abs(p.field("E-DI").h_px / 500 - p.field("E-DI").omega_deg / 135).max()),
              reading="'almost' is read as 0.5 % of full scale"),
        Claim("Sec. 3.5", "equidistant mirror, 'difficult to obtain': deviation from linear of what can be obtained",
              "worst |h/N - Ω/135| of the exact mirror by quadrature, d ln ρ/dθ = tan[(Ω + θ)/2]", 0.0049, 5e-5,
              lambda p: exact_deviation(), erratum=4, corrected=0.0, corrected_tolerance=1e-12,
              note="its m is 3.92427 M; the polynomial stands in for it"),
        Claim("Sec. 3.5", "E-DI: F-number with which the whole field is sharp to 1 pixel, larger than 4",
              "4 × worst single blur at its best focus, Eq. 29", 4.0, 0.0, lambda p: 4 * p.worst_at_best("E-DI"), "",
              ">=", note="diffraction left out; at F/24 the Airy disk is 6.5 px"),
    ]  # fmt: skip


def _single_viewpoint() -> list[Claim]:
    """Sec. 3.6."""
    return [
        Claim("Sec. 3.6", "paraboloid, orthographic lens: Δw/Δh is 1", "worst |Δw/Δh - 1|, Eq. 12", 0.0, 1e-9,
              lambda p: np.abs(p.telecentric_paraboloid.aspect - 1).max()),
        Claim("Sec. 3.6", "paraboloid, orthographic lens: V is constant", "spread of z_v, Eq. 6", 0.0, 1e-9,
              lambda p: np.ptp(p.telecentric_paraboloid.viewpoint_z_mm), "mm"),
        Claim("Sec. 3.6", "SVP: a small square remains almost a square", "worst |Δw/Δh - 1|, Eq. 12", 0.0, 0.05,
              lambda p: np.abs(p.field("SVP").aspect - 1).max(), reading="'almost' is read as 5 %"),
        Claim("Sec. 3.6", "SVP: T and S images coincide", "worst |L_t - L_s|, Eqs. 34, 35", 0.0, 1e-9,
              lambda p: np.abs(p.field("SVP").distance_t_mm - p.field("SVP").distance_s_mm).max() / M, "M"),
    ]  # fmt: skip


def claims() -> list[Claim]:
    return [*_table_1(), *_mapping(), *_sphere(), *_equidistant(), *_single_viewpoint()]
