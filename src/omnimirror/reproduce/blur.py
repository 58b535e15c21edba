"""Claims about depth of field, blur, pixels and viewpoints: Secs. 1, 3.3, 4.2, 5.1 and the Appendix."""

from __future__ import annotations

import time
from functools import cache

import numpy as np

from ..dewarp import Dewarper, views
from ..specs import load_sensor
from .claims import Claim
from .paper import EXACT, PAPER, PITCH, RADIUS_PX, THETA_MAX, M, Paper

PRINTED_HYPERFOCAL = 6412.0  # mm


def _optics() -> list[Claim]:
    """Sec. 3.3: imager, lens and depth of field."""

    def focal_length(p: Paper) -> float:
        b0 = RADIUS_PX * PITCH / np.tan(THETA_MAX)
        return float(1 / (1 / b0 + 1 / p.lens.focus_distance_mm))

    def approximation(p: Paper) -> float:
        full = p.depth_of_field("SPH")
        return 2 * p.lens.focus_distance_mm**2 / p.lens.hyperfocal_distance(PITCH) / full

    return [
        Claim("Sec. 3.3", "pixels of the image circle, in millions", "π N²", 0.785, 5e-4,
              lambda p: np.pi * RADIUS_PX**2 / 1e6),
        Claim("Sec. 3.3", "image circle 2H", "2 N δ", 5.2, 0.05, lambda p: 2 * RADIUS_PX * PITCH, "mm"),
        Claim("Sec. 3.3", "focal length f", "1/f = 1/b0 + 1/L0, b0 = N δ / tan Θ", 11.6, 0.05, focal_length, "mm"),
        Claim("Sec. 3.3", "image circle 2N with f = 11.6 mm", "2 b0 tan Θ / δ", 1000, 5,
              lambda p: 2 * p.lens.image_distance * np.tan(THETA_MAX) / PITCH, "px",
              reading="read as three significant digits"),
        Claim("Sec. 3.3", "hyperfocal distance L_∞", "f²/(F δ)", 6412, 0.5,
              lambda p: p.lens.hyperfocal_distance(PITCH), "mm", erratum=13, corrected=6469, corrected_tolerance=0.5,
              note="6412 mm implies f = 11.549 mm"),
        Claim("Sec. 3.3", "SPH: depth of field", "2 L0²/L_∞ with the printed L_∞", 13.7, 0.05,
              lambda p: 2 * p.lens.focus_distance_mm**2 / PRINTED_HYPERFOCAL, "mm",
              erratum=12, corrected=14.0187, corrected_tolerance=5e-5,
              exact=lambda p: p.depth_of_field("SPH", EXACT)),
        Claim("Sec. 3.3", "SPH: depth of field, f = 11.6 mm", "Eq. 32", 13.7, 0.05,
              lambda p: p.depth_of_field("SPH"), "mm", erratum=12, corrected=13.9096, corrected_tolerance=5e-5,
              exact=lambda p: p.depth_of_field("SPH", EXACT)),
        Claim("Sec. 3.3", "SPH: depth of field", "Eq. 32, f = 11.6 mm", 0.31, 0.005,
              lambda p: p.depth_of_field("SPH") / M, "M", erratum=12, corrected=0.317, corrected_tolerance=5e-4,
              exact=lambda p: p.depth_of_field("SPH", EXACT) / M, note="13.7 / 43.9 is 0.31"),
        Claim("Sec. 3.3", "E-DI: depth of field", "Eq. 32, f = 11.6 mm", 0.30, 0.005,
              lambda p: p.depth_of_field("E-DI") / M, "M", exact=lambda p: p.depth_of_field("E-DI", EXACT) / M),
        Claim("Sec. 3.3", "SVP: depth of field", "Eq. 32, f = 11.6 mm", 0.25, 0.005,
              lambda p: p.depth_of_field("SVP") / M, "M", exact=lambda p: p.depth_of_field("SVP", EXACT) / M),
        Claim("Eq. 33", "2 L0²/L_∞ stands for Eq. 32", "ratio of the two at L0 = 212 mm", 1.0, 0.005, approximation),
    ]  # fmt: skip


def _spots() -> list[Claim]:
    """Sec. 3.3, Figs. 4 and 9 to 11: virtual images, blur and best focus."""
    spread = [
        Claim("Sec. 3.3, Fig. 4", f"{name}: {long} images leave the depth of field", "worst |Δ| for p = ∞, Eq. 29",
              1.0, 0.0, lambda p, n=name, w=way: p.worst_blur_px(n, w), "px", ">=",  # type: ignore[misc]
              exact=lambda p, n=name, w=way: p.worst_blur_px(n, w, EXACT))  # type: ignore[misc]
        for name, way, long in (("E-DI", "t", "tangential"), ("SVP", "t", "tangential"), ("SPH", "s", "sagittal"),
                                ("E-DI", "s", "sagittal"), ("SVP", "s", "sagittal"))
    ]  # fmt: skip
    return [
        Claim("Sec. 3.3, Fig. 4", "SPH: tangential images within the depth of field, p = ∞", "worst |Δ_t|, Eq. 29",
              1.0, 0.0, lambda p: p.worst_blur_px("SPH", "t"), "px", "<=",
              note="holds in the paper's mode and for distant objects only; see the next two rows"),
        Claim("Sec. 3.3, Fig. 4", "SPH: tangential images within the depth of field, exact", "worst |Δ_t|, Eq. 28",
              1.0, 0.0, lambda p: p.worst_blur_px("SPH", "t", EXACT), "px", "<=",
              erratum=11, corrected=1.0360, corrected_tolerance=5e-5),
        Claim("Sec. 3.4, Fig. 4", "SPH: tangential images within the depth of field, p = 5 M", "worst |Δ_t|, Eq. 29",
              1.0, 0.0, lambda p: p.worst_blur_px("SPH", "t", PAPER, 5 * M), "px", "<=",
              erratum=11, corrected=1.376, corrected_tolerance=5e-4,
              exact=lambda p: p.worst_blur_px("SPH", "t", EXACT, 5 * M)),
        *spread,
        Claim("Sec. 3.3, Fig. 9", "SPH: best L0", "least worst |Δ_t Δ_s/(Δh Δw)|, Eq. 29", 212, 0.5,
              lambda p: p.best_focus("SPH").focus_mm, "mm"),
        Claim("Sec. 3.3, Fig. 9", "E-DI: best L0", "least worst |Δ_t Δ_s/(Δh Δw)|, Eq. 29", 205, 1.5,
              lambda p: p.best_focus("E-DI").focus_mm, "mm", reading="found by trial and error: read as within 1.5 mm"),
        Claim("Sec. 3.3, Fig. 9", "SVP: best L0", "least worst |Δ_t Δ_s/(Δh Δw)|, Eq. 29", 190, 1.5,
              lambda p: p.best_focus("SVP").focus_mm, "mm", erratum=18, corrected=172.5, corrected_tolerance=0.05,
              note="190 mm is where 105 deg is in focus; see the next row"),
        Claim("Secs. 3.3, 3.6", "SVP: L0 that focuses the peripheral area", "L_t = L_s at 105 deg, the field of the "
              "hyperboloidal prototype", 190, 0.5, lambda p: p.at("SVP", 105.0).distance_t_mm[0], "mm",
              note="that 105 deg is meant is our reading: the paper says 'to focus peripheral area'"),
        Claim("Sec. 3.4", "SPH: tangential blur at the best L0, 'almost less than 1 pixel'", "worst |Δ_t|, Eq. 28", 1.0,
              0.05, lambda p: p.worst_blur_px("SPH", "t", EXACT), "px", "<=", reading="'almost' is read as 5 %"),
        Claim("Eq. 37", "SPH: Δ_s/Δw at 135 deg, printed with L_t", "L_s in place of L_t", 0.0172399853, 5e-3,
              lambda p: p.at("SPH", 135.0).blur_s_deg[0], "deg",
              erratum=7, corrected=0.680977331413, corrected_tolerance=5e-9,
              exact=lambda p: p.at("SPH", 135.0, EXACT).blur_s_deg[0]),
        Claim("Sec. 3.3, on Fig. 9(b)", "SVP: Δs(135)/Δs(0) of the objects drawn in Fig. 10",
              "Eq. 11; 1 if they stood in object space", 1.0, 0.5,
              lambda p: p.field("SVP").area_px2[-1] / p.field("SVP").area_px2[0],
              erratum=15, corrected=48.7386, corrected_tolerance=5e-4,
              note="'In Fig. 10, object spaces show 15×15-deg square' is said of Fig. 11: Fig. 10 is the image"),
        Claim("Figs. 10 and 11, captions", "SPH: height of the spot at 0 deg in Fig. 11, read along the image radius",
              "|Δ_t|/Δh in deg, not |Δ_t| in px", 0.979286635, 5e-3,
              lambda p: abs(p.at("SPH", 0.0).blur_t_deg[0]), "deg",
              erratum=16, corrected=0.196150888513, corrected_tolerance=5e-9,
              note="'radial and sagittal directions': radial and circumferential in Fig. 10, tangential and sagittal "
                   "in Fig. 11"),
    ]  # fmt: skip


def _pixels() -> list[Claim]:
    """Secs. 1 and 3.3: how much is seen, and by one pixel."""
    return [
        Claim("Sec. 3.3", "whole sphere", "4π (180/π)²", 41253, 0.5, lambda p: p.square_degrees, "deg²"),
        Claim("Sec. 3.3", "coverage of 0 to 135 deg", "(1 - cos Ω)/2", 0.8356, 5e-5, lambda p: p.coverage,
              erratum=9, corrected=0.8536, corrected_tolerance=5e-5, note="digits exchanged"),
        Claim("Sec. 1", "share of the sphere seen, 'almost 80 %'", "(1 - cos Ω)/2", 80, 0.5, lambda p: 100 * p.coverage,
              "%", erratum=17, corrected=85, corrected_tolerance=0.5),
        Claim("Sec. 3.3", "π × 500², in millions", "π N²", 0.735, 5e-4, lambda p: np.pi * RADIUS_PX**2 / 1e6,
              erratum=8, corrected=0.785, corrected_tolerance=5e-4, note="given correctly earlier in the section"),
        Claim("Sec. 3.3", "mean solid angle of a pixel", "41253 × coverage / (π N²)", 0.048, 5e-4,
              lambda p: p.mean_pixel_deg2, "deg²", erratum=10, corrected=0.0448, corrected_tolerance=5e-5),
        Claim("Sec. 3.3, Fig. 11", "its side", "square root of the same", 0.21, 5e-3,
              lambda p: np.sqrt(p.mean_pixel_deg2), "deg", note="(0.21)² is .044, not the printed .048"),
    ]  # fmt: skip


def _viewpoints() -> list[Claim]:
    """Sec. 4.2, Fig. 15."""
    return [
        Claim("Sec. 4.2, Fig. 15", "SPH: error of one viewpoint at 40 M, ±", "least worst error in the picture", 1, 0.5,
              lambda p: p.one_viewpoint(40).worst_px, "px"),
        Claim("Sec. 4.2, Fig. 15", "SPH: error of one viewpoint at 7 M, ±", "least worst error in the picture", 5, 0.5,
              lambda p: p.one_viewpoint(7).worst_px, "px"),
        Claim("Sec. 4.2", "SPH shows the largest influence: its error at 7 M over that of E-DI",
              "least worst error in the picture", 0.0, 0.0,
              lambda p: p.one_viewpoint(7).worst_px - p.one_viewpoint(7, "E-DI").worst_px, "px", ">=",
              erratum=20, corrected=-0.651, corrected_tolerance=5e-4,
              note="its viewpoints do spread farthest; in pixels E-DI is worse, since its picture is larger there"),
        Claim("Sec. 4.2", "distance of 40 M", "40 × 43.9 mm", 180, 0.5, lambda p: 40 * M / 10, "cm",
              erratum=17, corrected=175.6, corrected_tolerance=0.05),
        Claim("Sec. 4.2", "distance of 7 M, 'about'", "7 × 43.9 mm", 30, 1, lambda p: 7 * M / 10, "cm",
              reading="'about' is read as 1 cm"),
        Claim("Sec. 4.2", "SVP: no error at any distance", "least worst error at 7 M", 0.0, 1e-9,
              lambda p: p.one_viewpoint(7, "SVP").worst_px, "px"),
    ]  # fmt: skip


@cache
def frames_a_second() -> float:
    """Pictures of 1000 x 1000 pixels that one core straightens in a second, to a panorama of 1440 x 360."""
    sensor = load_sensor("paper-spherical")
    dewarp = Dewarper(sensor, views.panorama(sensor, (1440, 360)))
    picture = np.zeros((*sensor.image_size[::-1], 3), np.uint8)
    dewarp(picture)
    begin = time.process_time()
    for _ in range(20):
        dewarp(picture)
    return 20 / max(time.process_time() - begin, 1e-9)


def _processing() -> list[Claim]:
    """Sec. 4.1: pictures straightened as they come."""
    return [
        Claim("Sec. 4.1", "pictures of 1000 × 1000 pixels processed a second", "panoramas of 1440 × 360 pixels, per "
              "second of processor time, measured here", 15, 0.0, lambda p: frames_a_second(), "1/s", ">="),
    ]  # fmt: skip


def _prototypes() -> list[Claim]:
    """Sec. 5.1: are the prototypes those of the theory?"""

    beta = np.radians(135.0 - 12.0) / 2
    return [
        Claim("Sec. 5.1", "spherical prototype: diameter that sees 135 deg", "2 A sin β, A = 50 mm, Θ = 12 deg",
              88, 0.5, lambda p: 2 * 50.0 * np.sin(beta), "mm"),
        Claim("Secs. 3.3, 5.1", "M of a hemisphere of 100 mm diameter", "A sin β, Θ = 12 deg", 43.9, 0.05,
              lambda p: 50.0 * np.sin(beta), "mm"),
        Claim("Sec. 5.1", "hyperboloidal prototype: largest viewing angle at 60 mm diameter",
              "field of the bundled sensor of that rim", 105, 0.5,
              lambda p: load_sensor("prototype-hyperboloidal").field_deg[1], "deg",
              is_assumed=True,
              note="its parameters are not printed: the bundled sensor is made for this, with Θ = 12 deg"),
    ]  # fmt: skip


def claims() -> list[Claim]:
    return [*_optics(), *_spots(), *_pixels(), *_viewpoints(), *_processing(), *_prototypes()]
