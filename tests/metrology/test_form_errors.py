"""Form errors that were put in come back, apart from place, noise and wrong points."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter, OmnimirrorError
from omnimirror.mirrors import EvenPolynomial, Hyperboloid, Sphere
from omnimirror.numerics.zernike import noll, zernike_values
from tests.everyday import few

from .clouds import TERMS, height_mm, in_machine, on, places

BALL, HYPERBOLOID = Sphere(50.0, 44.0), Hyperboloid(32.5, 74.5, 44.0)
MIRRORS = {"ball": BALL, "hyperboloid": HYPERBOLOID, "polynomial": EvenPolynomial((0.012, 2e-6), 30.0)}


def amounts(form) -> dict[int, float]:
    return {term.noll: term.um for term in form.terms}


def test_the_terms_are_those_of_the_textbook():
    x, y = places(1.0, 200, np.random.default_rng(3))
    for j, formula in TERMS.items():
        np.testing.assert_allclose(zernike_values(x, y, [j])[:, 0], formula(x, y), atol=1e-12)


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("term", few([6, 11, 14, 22], 11))
@pytest.mark.parametrize("name", MIRRORS)
def test_a_micrometre_comes_back_within_five_percent(name, term, above):
    form = om.form_error(MIRRORS[name], in_machine(on(MIRRORS[name], {term: 1.0}, noise_um=0.2), above))
    found = amounts(form)
    assert found[term] == pytest.approx(1.0, abs=0.05)
    others = [um for j, um in found.items() if j not in (1, term)]
    assert np.abs(others).max() < 0.03
    assert form.noise_um == pytest.approx(0.2, rel=0.1)
    assert form.unexplained_um < 0.05
    assert form.wrong <= 2


def test_the_place_in_the_machine_is_found_and_a_ball_is_centred_by_its_outline():
    for mirror, vertex, tilt in ((HYPERBOLOID, 2e-4, 2e-4), (BALL, 0.1, 0.1)):
        place = om.form_error(mirror, in_machine(on(mirror, {9: 0.5}, 0.1))).place
        np.testing.assert_allclose(place.vertex_mm, [3.0, -2.0, 100.0], atol=vertex)
        np.testing.assert_allclose(place.tilt_deg, [0.8, -0.5], atol=tilt)
        assert len(place.free) == (2 if mirror is BALL else 0)


def test_what_is_stated_is_as_uncertain_as_stated():
    truth = {5: 0.4, 9: -0.3, 11: 0.5}
    off = []
    for seed in range(25):
        form = om.form_error(HYPERBOLOID, in_machine(on(HYPERBOLOID, truth, 0.3, count=1500, seed=seed)), order=4)
        # A shift and a tilt of the mirror explain a part of 2, 3, 7 and 8, its height one of 1
        off += [
            (t.um - truth.get(t.noll, 0.0)) / t.sigma_um for t in form.terms if t.noll in (5, 6, 9, 10, 12, 13, 14, 15)
        ]
    assert np.mean(np.abs(off) < 3) >= 0.95
    assert 0.7 < np.std(off) < 1.3


def test_noise_is_told_from_form_that_the_terms_do_not_hold():
    points = on(HYPERBOLOID, {6: 1.0}, noise_um=0.1, count=20000)
    ripple = 0.3e-3 * np.sin(2 * np.pi * points[:, 0] / 4.0)  # 4 mm
    form = om.form_error(HYPERBOLOID, in_machine(points + ripple[:, None] * [0.0, 0.0, 1.0]))
    r = np.hypot(points[:, 0], points[:, 1])
    along_normal = 1e3 * np.std(ripple / np.sqrt(1 + HYPERBOLOID.slope(r) ** 2))
    assert form.unexplained_um == pytest.approx(along_normal, rel=0.1)
    assert form.noise_um == pytest.approx(
        0.1, rel=0.5
    )  # neighbours are .4 mm apart: some of the ripple counts as noise
    assert amounts(form)[6] == pytest.approx(1.0, abs=0.05)


def test_wrong_points_are_left_out_and_counted():
    points = on(HYPERBOLOID, {11: 0.5}, 0.1)
    points[::500, 2] += 0.02
    form = om.form_error(HYPERBOLOID, in_machine(points))
    assert form.wrong == 12
    assert amounts(form)[11] == pytest.approx(0.5, abs=0.02)


def test_departures_of_a_null_test_say_the_same():
    truth = {6: 0.8, 11: -0.4}
    points = on(HYPERBOLOID, {}, 0.0)
    r = np.hypot(points[:, 0], points[:, 1])
    along = height_mm(truth, points[:, 0] / 44.0, points[:, 1] / 44.0) / np.sqrt(1 + HYPERBOLOID.slope(r) ** 2)
    seen = np.column_stack([points[:, :2] + [7.0, 9.0], along + 0.01])
    found = amounts(om.form_error(HYPERBOLOID, seen, are_departures=True))
    assert found[6] == pytest.approx(0.8, abs=0.02)
    assert found[11] == pytest.approx(-0.4, abs=0.04)


def test_the_corrected_mirror_has_the_part_about_the_axis():
    truth = {4: 0.5, 6: 1.0, 11: -0.6, 22: 0.3}
    made = om.form_error(HYPERBOLOID, in_machine(on(HYPERBOLOID, truth, 0.05, count=12000))).corrected()
    x = np.linspace(0.5, 43.5, 200)
    about = {j: um for j, um in truth.items() if noll(j)[1] == 0}
    wanted = HYPERBOLOID.sag(x) + height_mm(about, x / 44.0, 0 * x) - height_mm(about, np.zeros(1), np.zeros(1))
    assert np.ptp(1e3 * (made.sag(x) - wanted)) < 0.05  # um; the mirror's place takes what it can


def test_figures_of_the_whole_are_those_of_the_surface():
    form = om.form_error(BALL, on(BALL, {6: 0.5, 11: 0.2}, 0.0))
    assert form.rms_um == pytest.approx(np.hypot(0.5, 0.2), rel=0.02)
    assert form.rotational_rms_um == pytest.approx(0.2, rel=0.05)
    x, y = places(1.0, 200000, np.random.default_rng(1))
    assert form.peak_to_valley_um == pytest.approx(1e3 * np.ptp(height_mm({6: 0.5, 11: 0.2}, x, y)), rel=0.03)


def test_a_half_measured_mirror_has_fewer_terms_or_none():
    points = on(HYPERBOLOID, {6: 1.0}, 0.1)
    half = points[points[:, 0] > 12.0]
    with pytest.raises(OmnimirrorError, match=r"terms up to order 8 are not told apart by the points"):
        om.form_error(HYPERBOLOID, half, order=8)


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (on(HYPERBOLOID, {}, 0.1)[:199], "the cloud has 199 points; at least 200 are valid"),
        (1e-3 * on(HYPERBOLOID, {}, 0.1), r"not of this mirror: it is 0.08.* mm wide .* check the unit and the sensor"),
        (on(Sphere(80.0, 44.0), {}, 0.1), "not of this mirror"),
        (on(HYPERBOLOID, {}, 0.1) * [1, 1, 0], "is flat"),
        (np.full((300, 3), np.nan), "points"),
        (np.zeros((300, 2)), r"points_mm has shape \(300, 2\)"),
        (np.zeros((300, 3)), "."),
    ],
)
def test_points_that_are_no_mirror_are_refused_by_a_sentence(points, sentence):
    with pytest.raises(OmnimirrorError, match=sentence):
        om.form_error(HYPERBOLOID, points)


def test_an_order_out_of_range_is_refused():
    with pytest.raises(InvalidParameter, match="order = 40 is"):
        om.form_error(HYPERBOLOID, on(HYPERBOLOID, {}, 0.1), order=40)
