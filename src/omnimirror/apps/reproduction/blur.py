"""Claims about depth of field, blur, pixels and viewpoints: Secs. 1, 3.3, 3.4, 4.2, 5.1 and the Appendix."""

from __future__ import annotations

import numpy as np

from ...optics.sensor_files import load_sensor
from .claims import Claim, formula, identity, ordered, printed, unprinted, worded, zero
from .paper import EXACT, PAPER, PITCH, RADIUS_PX, THETA_MAX, M, Paper, worst_ratio

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
        printed("Sec. 3.3", "pixels of the image circle, in millions", "π N²", "0.785",
                lambda p: np.pi * RADIUS_PX**2 / 1e6),
        printed("Sec. 3.3", "image circle 2H", "2 N δ", "5.2", lambda p: 2 * RADIUS_PX * PITCH, "mm"),
        printed("Sec. 3.3", "focal length f", "1/f = 1/b0 + 1/L0, b0 = N δ / tan Θ", "11.6", focal_length, "mm"),
        printed("Sec. 3.3", "hyperfocal distance L_∞", "f²/(F δ)", "6412",
                lambda p: p.lens.hyperfocal_distance(PITCH), "mm", erratum=13, correct="6469",
                note="6412 mm implies f = 11.549 mm"),
        printed("Sec. 3.3", "SPH: depth of field", depth, "13.7", lambda p: _printed_depth("SPH") * M, "mm",
                erratum=12, correct="14.019", exact=lambda p: p.depth_of_field("SPH", EXACT),
                note="the four printed depths imply L_∞ = 6561 mm"),
        printed("Sec. 3.3", "SPH: depth of field", depth, "0.31", lambda p: _printed_depth("SPH"), "M",
                erratum=12, correct="0.3193", exact=lambda p: p.depth_of_field("SPH", EXACT) / M),
        printed("Sec. 3.3", "E-DI: depth of field", depth, "0.3", lambda p: _printed_depth("E-DI"), "M",
                exact=lambda p: p.depth_of_field("E-DI", EXACT) / M),
        printed("Sec. 3.3", "SVP: depth of field", depth, "0.25", lambda p: _printed_depth("SVP"), "M",
                erratum=12, correct="0.2565", exact=lambda p: p.depth_of_field("SVP", EXACT) / M),
    ]  # fmt: skip


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
        identity("Eq. 24", "F = f/D", "F × aperture diameter of the traced edge rays / f",
                 lambda p: p.lens.f_number * p.aperture_diameter_mm / p.lens.focal_length_mm),
        identity("Eq. 25", "1/L0 + 1/b0 = 1/f", "f (1/L0 + 1/b0), b0 of the lens", thin_lens),
        identity("Eqs. 26, 27", "Δ/D = (b0 - b)/b", "worst ratio over 0 to 135 deg, SPH", blur_by_triangles),
        identity("Eq. 28", "Δ in closed form", "worst ratio over 0 to 135 deg, SPH", blur_in_closed_form),
        unprinted("Eq. 30", "far limit of the depth of field, SPH", "f² L0/(f² - δ F L0)", "219.18",
                  lambda p: p.field("SPH").depth_of_field_mm.far, "mm",
                  exact=lambda p: p.field("SPH", EXACT).depth_of_field_mm.far,
                  note="exact: f² L0/[f² - δ F (L0 - f)]"),
        unprinted("Eq. 31", "near limit of the depth of field, SPH", "f² L0/(f² + δ F L0)", "205.27",
                  lambda p: p.field("SPH").depth_of_field_mm.near, "mm",
                  exact=lambda p: p.field("SPH", EXACT).depth_of_field_mm.near),
        identity("Eq. 32", "L_f - L_r", "depth of field / difference of Eqs. 30 and 31",
                 lambda p: p.depth_of_field("SPH") / (limit(p, 1) - limit(p, -1))),
        worded("Eq. 33", "2 L0²/L_∞ approximates Eq. 32", "ratio of the two at L0 = 212 mm", "almost", 1.0,
               lambda p: 2 * p.lens.focus_distance_mm**2 / p.lens.hyperfocal_distance(PITCH)
               / p.depth_of_field("SPH"), note="'≈' for L_∞ ≫ L0"),
        identity("Eq. 34", "L_t = m + z_qt", "worst ratio over 0 to 135 deg, SPH", lambda p: distance(p, "t")),
        identity("Eq. 35", "L_s = m + z_qs", "worst ratio over 0 to 135 deg, SPH", lambda p: distance(p, "s")),
        identity("Eq. 36", "Δ_t/Δh", "worst ratio over 0 to 135 deg, SPH, Eq. 29", angular_blur),
        formula("Eq. 37", "SPH: Δ_s/Δw at 135 deg", "Eq. 37 with L_s; printed with L_t", 0.0172399853,
                lambda p: p.at("SPH", 135.0).blur_s_deg[0], "deg", erratum=7, correct="0.680977331",
                exact=lambda p: p.at("SPH", 135.0, EXACT).blur_s_deg[0]),
    ]  # fmt: skip


def _spots() -> list[Claim]:
    """Return claims of Secs. 3.3 and 3.4, Figs. 4 and 9 to 11: virtual images, blur and best focus."""

    def leaves(name: str, kind: str, word: str) -> Claim:
        return ordered("Sec. 3.3, Fig. 4", f"{name}: {word} images leave the depth of field",
                       "largest |Δ| for p = ∞, Eq. 29", ">=", 1.0, lambda p: p.worst_blur_px(name, kind), "px",
                       exact=lambda p: p.worst_blur_px(name, kind, EXACT))  # fmt: skip

    def best_focus(name: str, **more: str) -> Claim:
        return printed("Sec. 3.3, Fig. 9", f"{name}: best L0", "minimises the largest |Δ_t Δ_s/(Δh Δw)|, Eq. 29",
                       f"{PRINTED_FOCUS[name]:g}", lambda p: p.best_focus(name).focus_mm, "mm", **more)  # fmt: skip

    return [
        ordered("Sec. 3.3, Fig. 4", "SPH: tangential images within the depth of field, p = ∞", "largest |Δ_t|, Eq. 29",
                "<=", 1.0, lambda p: p.worst_blur_px("SPH", "t"), "px",
                exact=lambda p: p.worst_blur_px("SPH", "t", EXACT),
                note="holds with the approximation of Eq. 29, not with Eq. 28"),
        ordered("Sec. 3.4, Fig. 4", "SPH: tangential images within the depth of field, p = 5 M",
                "largest |Δ_t|, Eq. 29", "<=", 1.0, lambda p: p.worst_blur_px("SPH", "t", PAPER, 5 * M), "px",
                erratum=11, correct="1.376", exact=lambda p: p.worst_blur_px("SPH", "t", EXACT, 5 * M)),
        leaves("E-DI", "t", "tangential"), leaves("SVP", "t", "tangential"),
        leaves("SPH", "s", "sagittal"), leaves("E-DI", "s", "sagittal"), leaves("SVP", "s", "sagittal"),
        best_focus("SPH"),
        best_focus("E-DI", correct="206.0",
                   note="'by trial and error'; no merit tried yields 212, 205 and 190 mm together"),
        best_focus("SVP", correct="172.5", note="see the next row"),
        Claim("Secs. 3.3, 3.6", "SVP: L0 that focuses the peripheral area", "L_t = L_s at 105 deg, the field of the "
              "hyperboloidal prototype", lambda p: p.at("SVP", 105.0).distance_t_mm[0], "190", 190.0, 5.0, unit="mm",
              is_assumed=True, note="105 deg was chosen because it yields 190 mm; the paper states no angle"),
        printed("Sec. 3.4", "SPH: tangential blur at the best L0, 'almost' less than", "largest |Δ_t|, Eq. 28", "1",
                lambda p: p.worst_blur_px("SPH", "t", EXACT), "px"),
        ordered("Sec. 3.5", "E-DI: F-number for which the whole field is sharp to 1 px, 'larger'",
                "4 × largest single blur at its best focus, Eq. 29", ">=", 4.0, lambda p: 4 * p.worst_at_best("E-DI"),
                note="diffraction neglected; at F/24 the Airy disk is 6.5 px"),
    ]  # fmt: skip


def _pixels() -> list[Claim]:
    """Return claims of Secs. 1 and 3.3: coverage, and the solid angle of a pixel."""
    return [
        printed("Sec. 3.3", "whole sphere", "4π (180/π)²", "41253", lambda p: p.square_degrees, "deg²"),
        printed("Sec. 3.3", "coverage of 0 to 135 deg", "(1 - cos Ω)/2", "0.8356", lambda p: p.coverage,
                erratum=9, correct="0.8536", note="digits exchanged"),
        printed("Sec. 1", "observed share of the sphere, 'almost'", "(1 - cos Ω)/2", "80",
                lambda p: 100 * p.coverage, "%", erratum=17, correct="85.36"),
        printed("Sec. 3.3", "π × 500², in millions", "π N²", "0.735", lambda p: np.pi * RADIUS_PX**2 / 1e6,
                erratum=8, correct="0.785", note="given correctly earlier in the section"),
        printed("Sec. 3.3", "41253 × 0.8356/0.735e6", "the printed arithmetic", "0.048",
                lambda p: 41253 * 0.8356 / PRINTED_PIXELS, "deg²", erratum=9, correct="0.0469",
                note="0.048 follows from the coverage 0.8536 that erratum 9 restores; see the next row"),
        printed("Sec. 3.3", "mean solid angle of a pixel, with the printed number of pixels",
                "41253 × (1 - cos Ω)/2 / 0.735e6", "0.048",
                lambda p: p.square_degrees * p.coverage / PRINTED_PIXELS, "deg²",
                exact=lambda p: p.mean_pixel_deg2, note="erratum 8 makes it too large"),
        printed("Sec. 3.3, Fig. 11", "side of the mean pixel", "square root, with the correct number of pixels", "0.21",
                lambda p: np.sqrt(p.mean_pixel_deg2), "deg", note="(0.21 deg)² is 0.044 deg², not 0.048"),
    ]  # fmt: skip


def _viewpoints() -> list[Claim]:
    """Return claims of Sec. 4.2, Fig. 15."""
    return [
        printed("Sec. 4.2, Fig. 15", "SPH: error of a single viewpoint at 40 M, ±", "minimised largest error in the "
                "image", "1", lambda p: p.one_viewpoint(40).worst_px, "px"),
        printed("Sec. 4.2, Fig. 15", "SPH: error of a single viewpoint at 7 M, ±", "minimised largest error in the "
                "image", "5", lambda p: p.one_viewpoint(7).worst_px, "px"),
        ordered("Sec. 4.2", "SPH has the largest influence of viewpoints: error at 7 M minus that of E-DI",
                "minimised largest |ε|, Eq. 23", ">=", 0.0,
                lambda p: p.viewpoint_error_deg(7, "SPH") - p.viewpoint_error_deg(7, "E-DI"), "deg",
                note="2.35 and 1.50 deg; in pixels E-DI is worse (5.58 against 4.93 px), since dh/dΩ is larger there"),
        printed("Sec. 4.2", "distance of 40 M", "40 × 43.9 mm", "180", lambda p: 40 * M / 10, "cm"),
        printed("Sec. 4.2", "distance of 7 M, 'about'", "7 × 43.9 mm", "30", lambda p: 7 * M / 10, "cm"),
        zero("Sec. 4.2", "SVP: no error at any distance", "minimised largest error at 7 M",
               lambda p: p.one_viewpoint(7, "SVP").worst_px, "px"),
    ]  # fmt: skip


def _prototypes() -> list[Claim]:
    """Return claims of Sec. 5.1: consistency of the prototypes with the theory."""
    beta = np.radians(135.0 - 12.0) / 2
    return [
        printed("Sec. 5.1", "spherical prototype: diameter that observes 135 deg", "2 A sin β, A = 50 mm, Θ = 12 deg",
                "88", lambda p: 2 * 50.0 * np.sin(beta), "mm"),
        printed("Secs. 3.3, 5.1", "M of a hemisphere of 100 mm diameter", "A sin β, Θ = 12 deg", "43.9",
                lambda p: 50.0 * np.sin(beta), "mm"),
        printed("Sec. 5.1", "hyperboloidal prototype: largest field angle at 60 mm diameter",
                "field of the bundled sensor of that rim", "105",
                lambda p: load_sensor("prototype-hyperboloidal").field_deg[1], "deg", is_assumed=True,
                note="its parameters are not printed; the bundled sensor is designed for this field and Θ = 12 deg"),
    ]  # fmt: skip


def claims() -> list[Claim]:
    return [*_optics(), *_appendix(), *_spots(), *_pixels(), *_viewpoints(), *_prototypes()]
