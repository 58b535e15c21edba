"""Blur, depth of field and best focus against ray cones, definitions and the corrected paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis import MERITS
from omnimirror.analysis.minimise import lowest
from omnimirror.design import Rim, generated_mirror
from omnimirror.lenses import Orthographic, Perspective
from omnimirror.mirrors import EvenPolynomial

SPH, EDI, SVP = (om.load_sensor(f"paper-{n}") for n in ("spherical", "equidistant", "hyperboloidal"))
LENS = Perspective(11.6, 4.0, 212.0)


@pytest.mark.parametrize("L", [150.0, 205.0, 212.0, 230.0, 4000.0])
def test_blur_is_the_width_of_the_cone_at_the_imager(L):
    """Image the point with the lens equation, and cut its cone of light at b0 (Eqs. 25-27)."""
    f, D = 11.6, 11.6 / 4
    b0, b = 1 / (1 / f - 1 / 212.0), 1 / (1 / f - 1 / L)
    assert float(LENS.blur(L)) == pytest.approx(D * (b0 - b) / b, rel=1e-12, abs=1e-15)


def test_the_papers_blur_drops_f_against_the_focus_distance():
    assert float(LENS.blur(220.0, mode="paper")) == pytest.approx(11.6**2 / 4 * (220 - 212) / (212 * 220), rel=1e-12)
    ratio = LENS.blur(220.0, mode="paper") / LENS.blur(220.0)
    assert 1 - float(ratio) == pytest.approx(11.6 / 212, rel=1e-12)  # 5.5 % too small


@pytest.mark.parametrize("mode", ["exact", "paper"])
@pytest.mark.parametrize("lens", [LENS, Orthographic(0.06, 4.0, 20.0)], ids=["perspective", "orthographic"])
def test_depth_of_field_ends_where_the_blur_is_the_tolerance(lens, mode):
    near, far = lens.depth_of_field(0.0052, mode)
    assert near < lens.focus_distance_mm < far
    np.testing.assert_allclose(lens.blur([near, far], mode=mode), [-0.0052, 0.0052], rtol=1e-10)


def test_depth_of_field_beyond_the_hyperfocal_distance_has_no_far_end():
    assert Perspective(11.6, 4.0, 7000.0).depth_of_field(0.0052).far == np.inf
    assert LENS.hyperfocal_distance(0.0052) == pytest.approx(6469.2, abs=0.1)


def test_airy_disk():
    assert om.evaluate(SPH, [0.0]).airy_px == pytest.approx(1.09, abs=0.005)


def test_exact_blur_on_axis_of_the_sphere():
    """Erratum 11: -1.036 px at L0 = 212, so not every tangential point is within the depth of field."""
    assert om.evaluate(SPH, [0.0]).blur_t_px[0] == pytest.approx(-1.036, abs=5e-4)


@pytest.mark.parametrize(
    ("sensor", "merit", "focus", "value"),
    [
        (SPH, "product", 212.4, 0.0751),
        (EDI, "product", 206.0, 0.566),
        (SVP, "product", 172.5, 1.52),
        (SPH, "floored-area", 215.5, 0.704),
        (SPH, "worst-deg", 219.5, 0.596),
    ],
)
def test_best_focus_of_the_papers_mirrors(sensor, merit, focus, value):
    best = om.best_focus(sensor, merit, np.linspace(0, 135, 1001), mode="paper", image_radius_px=500)
    assert best.focus_mm == pytest.approx(focus, abs=0.05)
    assert best.value == pytest.approx(value, rel=2e-3)


def test_the_papers_focus_of_svp_follows_from_its_outer_field():
    best = om.best_focus(SVP, "product", np.linspace(82, 135, 1001), mode="paper", image_radius_px=500)
    assert best.focus_mm == pytest.approx(189.7, abs=0.05)


@pytest.mark.parametrize("merit", MERITS)
def test_no_focus_on_a_fine_grid_is_better_than_the_best(merit, bundled):
    """The search against plain enumeration of evaluations."""
    best = om.best_focus(bundled, merit)
    angles = np.linspace(*bundled.field_deg, 1001)
    weights = np.sin(np.radians(angles)) + 1e-9

    def value(focus):
        r = om.evaluate(bundled, angles, focus_mm=focus)
        return {
            "floored-area": r.floored_area_deg2.max(),
            "mean-floored-area": np.average(r.floored_area_deg2, weights=weights),
            "product": np.abs(r.blur_t_deg * r.blur_s_deg).max(),
            "worst-px": max(np.abs(r.blur_t_px).max(), np.abs(r.blur_s_px).max()),
            "worst-deg": max(np.abs(r.blur_t_deg).max(), np.abs(r.blur_s_deg).max()),
            "rss-deg": np.hypot(r.blur_t_deg, r.blur_s_deg).max(),
        }[merit]

    assert value(best.focus_mm) == pytest.approx(best.value, rel=1e-12)
    r = om.evaluate(bundled, angles)
    L = np.concatenate([r.distance_t_mm, r.distance_s_mm])
    assert best.value <= min(value(f) for f in np.linspace(L.min(), L.max(), 150)) * (1 + 1e-9)


def test_floored_area_is_never_below_a_pixel_and_the_airy_disk():
    r = om.evaluate(SPH, np.linspace(0, 135, 50))
    floor = (1 + r.airy_px**2) / r.area_px2
    assert np.all(r.floored_area_deg2 >= floor)
    sides = [np.sqrt(r.blur_t_px**2 + 1 + r.airy_px**2), np.sqrt(r.blur_s_px**2 + 1 + r.airy_px**2)]
    np.testing.assert_allclose(r.floored_area_deg2, sides[0] * sides[1] / r.area_px2, rtol=1e-12)


@pytest.mark.parametrize("name", ["paper-spherical", "paraboloid-telecentric"])
@pytest.mark.parametrize("curvature", [1e-5, 1e-7, 1e-9, 1e-12])
def test_a_mirror_as_good_as_flat_is_focused_at_its_images_or_as_far_as_can_be(name, curvature):
    """z = c x^2 has images of distant objects 1/(4 c) away, at last farther than any lens can be focused."""
    sensor = replace(om.load_sensor(name), mirror=EvenPolynomial((curvature,), 20.0))
    best = om.best_focus(sensor)
    assert om.evaluate(sensor, focus_mm=best.focus_mm).focus_mm == best.focus_mm
    farthest = sensor.lens.PARAMETERS["focus_distance_mm"].high
    assert best.focus_mm == pytest.approx(min(1 / (4 * curvature), farthest), rel=0.05)


def test_images_on_both_sides_of_infinity_leave_far_foci_to_choose_from():
    """The mirror of a far plane to 80 deg has tangential ones behind the lens; no focus on a fine scan is better."""
    placed = generated_mirror("rectifying", Rim(80.0, 12.0, 43.9))
    sensor = replace(SPH, mirror=placed.mirror, mirror_distance_mm=placed.distance_mm)
    angles = np.linspace(0, sensor.field_deg[1], 301)
    best = om.best_focus(sensor, omega_deg=angles)
    found = om.evaluate(sensor, angles)
    assert found.distance_t_mm.min() < 0 < 5e3 < found.distance_t_mm.max()
    for focus in 1 / np.linspace(1e-7, 1 / 60, 200):
        assert om.evaluate(sensor, angles, focus_mm=focus).floored_area_deg2.max() >= best.value * (1 - 1e-9)


def test_auto_focus_is_the_best_focus():
    assert om.evaluate(SPH, [0.0], focus_mm="auto").focus_mm == om.best_focus(SPH).focus_mm


def test_lowest_finds_the_deepest_of_several_valleys():
    assert lowest(lambda x: abs(np.sin(3 * x)) + 0.01 * (x - 2) ** 2, 0.5, 9.0) == pytest.approx(
        2 * np.pi / 3, abs=1e-6
    )
    assert lowest(lambda x: x, 1.0, 1.0) == 1.0


def test_blur_in_degrees_is_blur_over_resolution():
    r = om.evaluate(SPH, [20.0, 100.0])
    np.testing.assert_allclose(r.blur_t_deg * r.dh_domega_px_per_deg, r.blur_t_px, rtol=1e-12)
    np.testing.assert_allclose(r.blur_s_deg * r.width_px_per_deg, r.blur_s_px, rtol=1e-12)
    np.testing.assert_allclose(r.blur_area_deg2, r.blur_t_deg * r.blur_s_deg, rtol=1e-12)


@pytest.mark.parametrize("sensor", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_blur_agrees_with_a_cone_of_real_rays_through_the_aperture(sensor):
    """Section 6: edge rays of the aperture, traced from a distant object over the real mirror, land on the
    imager within a few hundredths of a pixel of the predicted blur."""
    lens, m, mirror = sensor.lens, sensor.mirror_distance_mm, sensor.mirror
    angles = np.array([15.0, 60.0, 105.0, 130.0])
    result = om.evaluate(sensor, angles)
    radius = lens.focal_length_mm / lens.f_number / 2
    for i, omega in enumerate(np.radians(angles)):
        landed = []
        for side in (-radius, radius):  # the ray through (side, -m) that came from direction omega
            low, high = result.x_mm[i] - 5.0, min(result.x_mm[i] + 5.0, mirror.rim_radius_mm * 1.02)

            def misses(x, side=side, omega=omega):
                theta = np.arctan2(x - side, m + float(mirror.sag(x)))
                return 2 * np.arctan(float(mirror.slope(x))) + theta - omega

            for _ in range(60):
                middle = (low + high) / 2
                low, high = (low, middle) if misses(middle) > 0 else (middle, high)
            tangent = (low - side) / (m + float(mirror.sag(low)))
            # a thin lens bends a ray at s by -s/f, and turns the picture upside down
            b0 = lens.image_distance
            landed.append(b0 * tangent - side * (1 - b0 / lens.focal_length_mm))
        real_px = abs(landed[1] - landed[0]) / sensor.imager.pitch_mm
        assert real_px == pytest.approx(abs(result.blur_t_px[i]), abs=0.05)
