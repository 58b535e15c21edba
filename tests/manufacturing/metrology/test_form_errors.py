"""Recovery of known form errors, separated from alignment, noise and outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.base.numerics import noll, zernike_values
from omnimirror.optics.mirrors import Cone, EvenPolynomial, Hyperboloid, Sphere
from tests.everyday import few

from .clouds import TERMS, height_mm, in_machine, on, places

BALL, HYPERBOLOID = Sphere(50.0, 44.0), Hyperboloid(32.5, 74.5, 44.0)
MIRRORS = {
    "ball": BALL,
    "hyperboloid": HYPERBOLOID,
    "polynomial": EvenPolynomial((0.012, 2e-6), 30.0),
}


def amounts(form) -> dict[int, float]:
    return {term.noll: term.um for term in form.terms}


def test_terms_match_textbook_formulas():
    x, y = places(1.0, 200, np.random.default_rng(3))
    for j, formula in TERMS.items():
        np.testing.assert_allclose(zernike_values(x, y, [j])[:, 0], formula(x, y), atol=1e-12)


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("term", few([6, 11, 14, 22], 11))
@pytest.mark.parametrize("name", MIRRORS)
def test_amplitudes_are_recovered_within_five_percent(name, term, above):
    form = om.form_error(
        MIRRORS[name], in_machine(on(MIRRORS[name], {term: 1.0}, noise_um=0.2), above)
    )
    amplitudes = amounts(form)
    assert amplitudes[term] == pytest.approx(1.0, abs=0.05)
    others = [um for j, um in amplitudes.items() if j not in (1, term)]
    assert np.abs(others).max() < 0.03
    assert form.noise_um == pytest.approx(0.2, rel=0.1)
    assert form.unexplained_um < 0.05
    assert form.outliers <= 2


def test_alignment_is_recovered_and_spheres_use_their_outline():
    for mirror, vertex, tilt in ((HYPERBOLOID, 2e-4, 2e-4), (BALL, 0.1, 0.1)):
        alignment = om.form_error(mirror, in_machine(on(mirror, {9: 0.5}, 0.1))).place
        np.testing.assert_allclose(alignment.vertex_mm, [3.0, -2.0, 100.0], atol=vertex)
        np.testing.assert_allclose(alignment.tilt_deg, [0.8, -0.5], atol=tilt)
        assert len(alignment.free) == (2 if mirror is BALL else 0)


def test_uncertainties_are_realistic():
    truth = {5: 0.4, 9: -0.3, 11: 0.5}
    deviations = []
    for seed in range(25):
        form = om.form_error(
            HYPERBOLOID, in_machine(on(HYPERBOLOID, truth, 0.3, count=1500, seed=seed)), order=4
        )
        # Shift and tilt of the mirror absorb a part of terms 2, 3, 7 and 8, its height a part of
        # term 1
        deviations += [
            (t.um - truth.get(t.noll, 0.0)) / t.sigma_um
            for t in form.terms
            if t.noll in (5, 6, 9, 10, 12, 13, 14, 15)
        ]
    assert np.mean(np.abs(deviations) < 3) >= 0.95
    assert 0.7 < np.std(deviations) < 1.3


def test_noise_and_unexplained_form_are_separated():
    points = on(HYPERBOLOID, {6: 1.0}, noise_um=0.1, count=20000)
    ripple = 0.3e-3 * np.sin(2 * np.pi * points[:, 0] / 4.0)  # 4 mm
    form = om.form_error(HYPERBOLOID, in_machine(points + ripple[:, None] * [0.0, 0.0, 1.0]))
    r = np.hypot(points[:, 0], points[:, 1])
    along_normal = 1e3 * np.std(ripple / np.sqrt(1 + HYPERBOLOID.slope(r) ** 2))
    assert form.unexplained_um == pytest.approx(along_normal, rel=0.1)
    assert form.noise_um == pytest.approx(
        0.1, rel=0.5
    )  # point spacing of 0.4 mm: some of the ripple counts as noise
    assert amounts(form)[6] == pytest.approx(1.0, abs=0.05)


def test_outliers_are_rejected_and_counted():
    points = on(HYPERBOLOID, {11: 0.5}, 0.1)
    points[::500, 2] += 0.02
    form = om.form_error(HYPERBOLOID, in_machine(points))
    assert form.outliers == 12
    assert amounts(form)[11] == pytest.approx(0.5, abs=0.02)


def test_null_test_departures_are_equivalent():
    truth = {6: 0.8, 11: -0.4}
    points = on(HYPERBOLOID, {}, 0.0)
    r = np.hypot(points[:, 0], points[:, 1])
    along = height_mm(truth, points[:, 0] / 44.0, points[:, 1] / 44.0) / np.sqrt(
        1 + HYPERBOLOID.slope(r) ** 2
    )
    departures = np.column_stack([points[:, :2] + [7.0, 9.0], along + 0.01])
    amplitudes = amounts(om.form_error(HYPERBOLOID, departures, are_departures=True))
    assert amplitudes[6] == pytest.approx(0.8, abs=0.02)
    assert amplitudes[11] == pytest.approx(-0.4, abs=0.04)


def test_corrected_mirror_contains_symmetric_terms():
    truth = {4: 0.5, 6: 1.0, 11: -0.6, 22: 0.3}
    corrected = om.form_error(
        HYPERBOLOID, in_machine(on(HYPERBOLOID, truth, 0.05, count=12000))
    ).corrected()
    x = np.linspace(0.5, 43.5, 200)
    about = {j: um for j, um in truth.items() if noll(j)[1] == 0}
    expected = (
        HYPERBOLOID.sag(x)
        + height_mm(about, x / 44.0, 0 * x)
        - height_mm(about, np.zeros(1), np.zeros(1))
    )
    assert np.ptp(1e3 * (corrected.sag(x) - expected)) < 0.05  # um; the alignment absorbs its part


def test_summary_values_match_the_surface():
    form = om.form_error(BALL, on(BALL, {6: 0.5, 11: 0.2}, 0.0))
    assert form.rms_um == pytest.approx(np.hypot(0.5, 0.2), rel=0.02)
    assert form.rotational_rms_um == pytest.approx(0.2, rel=0.05)
    x, y = places(1.0, 200000, np.random.default_rng(1))
    assert form.peak_to_valley_um == pytest.approx(
        1e3 * np.ptp(height_mm({6: 0.5, 11: 0.2}, x, y)), rel=0.03
    )


def test_partial_coverage_reduces_the_order():
    points = on(HYPERBOLOID, {6: 1.0}, 0.1)
    half = points[points[:, 0] > 12.0]
    with pytest.raises(OmnimirrorError, match=r"the points do not determine terms up to order 8"):
        om.form_error(HYPERBOLOID, half, order=8)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (on(HYPERBOLOID, {}, 0.1)[:199], "the cloud must have at least 200 points; got 199"),
        (
            1e-3 * on(HYPERBOLOID, {}, 0.1),
            r"0.08.* mm wide .* the mirror 88 .*: the unit seems to be m; specify",
        ),
        (1e3 * on(HYPERBOLOID, {}, 0.1), "the unit seems to be um"),
        (on(HYPERBOLOID, {}, 0.1) / 25.4, "the unit seems to be inch"),
        (on(Hyperboloid(32.5, 74.5, 4.0), {}, 0.1), "the points must cover at least"),
        (on(Sphere(80.0, 44.0), {}, 0.1), "does not match the mirror"),
        (on(HYPERBOLOID, {}, 0.1) * [1, 1, 0], "the cloud is flat, and the mirror is .* mm deep"),
        (np.full((300, 3), np.nan), "points"),
        (np.zeros((300, 4)), r"points_mm must have the shape \(n, 3\); got shape \(300, 4\)"),
        (np.zeros((300, 2)), "one single point"),
        (on(HYPERBOLOID, {}, 0.1)[:, [2, 0, 1]], "check"),
        (np.zeros((300, 3)), "."),
    ],
)
def test_invalid_points_are_rejected(points, message):
    with pytest.raises(OmnimirrorError, match=message):
        om.form_error(HYPERBOLOID, points)


def test_invalid_order_is_rejected():
    with pytest.raises(
        InvalidParameter, match=r"order must be an integer between 2 and .*; got 40"
    ):
        om.form_error(HYPERBOLOID, on(HYPERBOLOID, {}, 0.1), order=40)


def profile_error_um(form, truth) -> float:
    """Return the maximum departure of the corrected mirror from the true one, relative to the
    vertices.
    """
    x = np.linspace(0, 0.999 * truth.rim_radius_mm, 300)
    return float(1e3 * np.abs(form.corrected().sag(x) - truth.sag(x)).max())


def posed(points: np.ndarray, seed: int) -> np.ndarray:
    """Return points in a machine with random position, tilt of about 1 deg, and either direction of
    z.
    """
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("xyz", [*rng.normal(size=2), rng.uniform(0, 360)], degrees=True)
    machine_points = points @ turn.as_matrix().T + 30 * rng.normal(size=3)
    return machine_points * [1.0, -1.0, -1.0] if seed % 2 else machine_points


def unchanged(points: np.ndarray, seed: int) -> np.ndarray:
    return points


@pytest.mark.parametrize("transform", [unchanged, posed])
@pytest.mark.parametrize("factor", few([1.0, 1.002, 0.998, 0.98, 1.02], 1.002, 0.98))
def test_radius_error_causes_no_tilt_or_shift(factor, transform):
    """The radius is the only error: no tilt, no asymmetric form, no rejected points."""
    nominal = om.load_sensor("paper-spherical").mirror
    truth = replace(nominal, radius_mm=factor * nominal.radius_mm)
    form = om.form_error(nominal, transform(on(truth, {}, 0.3, count=4000, seed=101), 3))
    assert form.radius_mm == pytest.approx(
        truth.radius_mm, abs=4 * form.place.radius_sigma_mm + 1e-6
    )
    assert form.place.radius_sigma_mm < 1e-4
    assert form.outliers == 0
    assert len(form.x_mm) > 3990
    assert profile_error_um(form, truth) < 0.1
    assert max(abs(t.um) for t in form.terms if noll(t.noll)[1]) < 0.03
    if transform is unchanged:
        assert np.abs(form.place.vertex_mm).max() < 1e-3
        np.testing.assert_array_equal(form.place.tilt_deg, 0.0)
        assert not form.place.is_centred_by_outline


def test_sphere_of_another_mirror_is_rejected():
    with pytest.raises(
        OmnimirrorError, match=r"sphere of radius 60 mm, and the mirror has 50 mm; check that"
    ):
        om.form_error(BALL, on(Sphere(60.0, 44.0), {}, 0.1))


@pytest.mark.parametrize("seed", few(range(6), 0, 1))
@pytest.mark.parametrize("name", [*MIRRORS, "cone"])
def test_two_percent_gross_outliers(name, seed):
    mirror = {**MIRRORS, "cone": Cone(45.0, 30.0)}[name]
    points, rng = on(mirror, {}, 0.3, count=4000, seed=seed), np.random.default_rng(seed)
    outliers = rng.choice(4000, 80, replace=False)
    points[outliers, 2] += 3.0 if seed % 2 else rng.choice([-3.0, 3.0], 80)
    form = om.form_error(mirror, posed(points, seed))
    assert 75 <= form.outliers <= 82
    assert profile_error_um(form, mirror) < 0.1  # noise at the vertex, with few points
    assert max(abs(t.um) for t in form.terms if noll(t.noll)[1]) < 0.1


def ball_centres(mirror, radius: float, points: np.ndarray) -> np.ndarray:
    """Return centres of a ball that touches a mirror at points (n, 3), on the side of the lens."""
    r = np.hypot(points[:, 0], points[:, 1])
    slope = mirror.slope(r)
    normal = np.stack(
        [-slope * points[:, 0] / r, -slope * points[:, 1] / r, np.ones(len(r))], axis=1
    )
    return points - radius * normal / np.sqrt(1 + slope**2)[:, None]


@pytest.mark.parametrize("radius", few([0.5, 2.0, 4.0], 2.0))
@pytest.mark.parametrize("name", [*MIRRORS, "ball of another radius"])
def test_probe_radius_is_compensated(name, radius):
    nominal = MIRRORS.get(name, BALL)
    truth = nominal if name in MIRRORS else replace(BALL, radius_mm=50.5)
    centres = ball_centres(truth, radius, on(truth, {}, 0.1, count=3000))
    form = om.form_error(nominal, posed(centres, 5), probe_radius_mm=radius)
    assert profile_error_um(form, truth) < 0.06
    assert len(form.x_mm) > 2990
    if form.radius_mm is not None:
        assert form.radius_mm == pytest.approx(truth.radius_mm, abs=1e-4)


@pytest.mark.parametrize("columns", [2, 3])
@pytest.mark.parametrize("name", [*MIRRORS, "ball of another radius"])
def test_profile_determines_symmetric_form(name, columns):
    nominal = MIRRORS.get(name, BALL)
    truth = nominal if name in MIRRORS else replace(BALL, radius_mm=50.5)
    x, rng = np.linspace(-0.99, 0.99, 801) * truth.rim_radius_mm, np.random.default_rng(2)
    z = (
        truth.sag(np.abs(x))
        + 1e-3
        * 0.5
        * np.sqrt(5)
        * (6 * (x / truth.rim_radius_mm) ** 4 - 6 * (x / truth.rim_radius_mm) ** 2 + 1)
        + 1e-4 * rng.normal(size=801)
    )
    c, s = np.cos(0.005), np.sin(0.005)
    profile = np.stack([c * x - s * z + 3.0, s * x + c * z + 50.0], axis=1)
    if columns == 3:  # along another line in plan view
        profile = np.column_stack([0.6 * profile[:, 0], 0.8 * profile[:, 0] + 2.0, -profile[:, 1]])
    form = om.form_error(nominal, profile)
    assert form.place.is_profile
    assert form.place.is_inverted == (columns == 3)
    assert all(noll(t.noll)[1] == 0 for t in form.terms)
    at = np.linspace(0, 0.98, 200)
    sag_mm = truth.sag(at * truth.rim_radius_mm) + 1e-3 * 0.5 * np.sqrt(5) * (6 * at**4 - 6 * at**2)
    assert np.abs(1e3 * (form.corrected().sag(at * truth.rim_radius_mm) - sag_mm)).max() < 0.1
    if name == "hyperboloid":
        across = [0, -1] if columns == 2 else [-0.8, -0.6]
        np.testing.assert_allclose(
            form.place.tilt_deg, np.degrees(0.005) * np.array(across), atol=1e-3
        )


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (
            np.stack([np.linspace(2, 40, 400), BALL.sag(np.linspace(2, 40, 400))], axis=1),
            {},
            "both sides of the axis",
        ),
        (
            np.stack(
                [np.linspace(-40, 40, 40), BALL.sag(np.abs(np.linspace(-40, 40, 40)))], axis=1
            ),
            {},
            "at least 50",
        ),
        (
            np.stack(
                [np.linspace(-40, 40, 99), BALL.sag(np.abs(np.linspace(-40, 40, 99)))], axis=1
            ),
            {"order": 4},
            "order",
        ),
        (on(BALL, {}, 0.1), {"probe_radius_mm": -1.0}, "probe_radius_mm must be .*; got -1"),
        (
            on(BALL, {}, 0.1),
            {"probe_radius_mm": 1.0, "are_departures": True},
            "of the surface itself",
        ),
    ],
)
def test_invalid_profiles_and_probes_are_rejected(points, options, message):
    with pytest.raises(OmnimirrorError, match=message):
        om.form_error(BALL, points, **options)
