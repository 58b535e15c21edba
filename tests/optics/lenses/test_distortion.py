"""Lens distortion with OpenCV coefficients, in all functions of a sensor."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.dewarp import Dewarper, screens
from omnimirror.optics.lenses import lens
from omnimirror.optics.lenses.lens import (
    distorted,
    distorted_radius,
    distorted_rates,
    fold,
    shrinkage,
    undistorted,
    undistorted_radius,
)
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from omnimirror.simulation import rendering as rays
from omnimirror.simulation.pixel_rays import sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment
from tests.everyday import few

BARREL = {"k1": -1.5, "k2": 2.0, "k3": -0.3}
TANGENTIAL = {**BARREL, "p1": 0.01, "p2": -0.008}
LENSES = pytest.mark.parametrize("terms", [BARREL, TANGENTIAL], ids=["radial", "tangential"])
MISALIGNED_POSE = MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)


def sensor_with(
    name: str = "paper-spherical", pixels: int = 1024, pose: MirrorPose | None = None, **terms
) -> om.Sensor:
    sensor = om.load_sensor(name)
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    imager = replace(
        sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch, centre_px=None
    )
    return replace(
        sensor, imager=imager, lens=replace(sensor.lens, **terms), mirror_pose=pose or MirrorPose()
    )


def opencv(terms) -> np.ndarray:
    return np.array([terms.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])


@LENSES
def test_distortion_matches_opencv(terms, monkeypatch):
    ideal = np.random.default_rng(0).uniform(-0.4, 0.4, (500, 2))
    brown = tuple(terms.get(n, 0.0) for n in ("k1", "k2", "k3", "p1", "p2"))
    expected = cv2.projectPoints(
        np.c_[ideal, np.ones(500)], np.zeros(3), np.zeros(3), np.eye(3), opencv(terms)
    )[0][:, 0]
    np.testing.assert_allclose(distorted(ideal, brown), expected, atol=1e-14)
    np.testing.assert_allclose(undistorted(expected, brown), ideal, atol=1e-12)
    image = expected.reshape(20, 25, 2)
    np.testing.assert_allclose(undistorted(image, brown).reshape(-1, 2), ideal, atol=1e-12)
    np.testing.assert_array_equal(distorted(ideal.reshape(20, 25, 2), brown).shape, image.shape)
    np.testing.assert_array_equal(undistorted(np.zeros((1, 2)), brown), [[0.0, 0.0]])
    monkeypatch.setattr(lens, "MAX_STEPS", 5)  # the convergence is quadratic
    np.testing.assert_allclose(undistorted(expected, brown), ideal, atol=1e-12)


@pytest.mark.parametrize("name", ["p1", "p2"])
def test_distortion_with_one_tangential_term(name):
    ideal = np.array([[0.3, -0.2], [0.1, 0.4]])
    x, y, p = *ideal.T, 0.02
    s = x**2 + y**2
    moved = (
        [2 * p * x * y, p * (s + 2 * y**2)] if name == "p1" else [p * (s + 2 * x**2), 2 * p * x * y]
    )
    brown = (0.0, 0.0, 0.0, p * (name == "p1"), p * (name == "p2"))
    np.testing.assert_allclose(distorted(ideal, brown), ideal + np.transpose(moved), rtol=1e-14)
    np.testing.assert_allclose(undistorted(ideal + np.transpose(moved), brown), ideal, atol=1e-12)


def test_image_points_without_ideal_point_are_nan():
    """On the axis x = 0 with p1 = 0.1, y' = y + 0.3 y^2 has its minimum, -1/1.2, at y = -1/0.6."""
    y = np.linspace(-1.6, -0.84, 60)
    image, brown = np.stack([np.zeros_like(y), y], axis=-1), (0.0, 0.0, 0.0, 0.1, 0.0)
    assert np.isnan(undistorted(image, brown)).all()
    image[:, 1] = y + 0.8
    np.testing.assert_allclose(distorted(undistorted(image, brown), brown), image, atol=1e-9)


def test_distortion_rates_match_differences():
    ideal = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
    brown, step = np.array([-0.3, 0.2, -0.1, 0.01, -0.008]), 1e-6
    pixels, by_ideal, by_coefficients = distorted_rates(ideal, tuple(brown))
    area = shrinkage(ideal, tuple(brown)) * np.linalg.det(by_ideal)
    np.testing.assert_allclose(area, 1.0, rtol=1e-12)
    r, (k1, k2, k3) = np.linspace(0.0, 1.2, 7), brown[:3]
    radial = np.polynomial.Polynomial([0, 1, 0, k1, 0, k2, 0, k3])
    np.testing.assert_allclose(
        distorted_radius(r, (k1, k2, k3)), [radial(r), radial.deriv()(r)], rtol=1e-12
    )
    np.testing.assert_array_equal(pixels, distorted(ideal, tuple(brown)))
    for k, e in enumerate(step * np.eye(2)):
        differences = (distorted(ideal + e, tuple(brown)) - distorted(ideal - e, tuple(brown))) / (
            2 * step
        )
        np.testing.assert_allclose(by_ideal[..., k], differences, atol=1e-8)
    for k, e in enumerate(step * np.eye(5)):
        differences = (distorted(ideal, tuple(brown + e)) - distorted(ideal, tuple(brown - e))) / (
            2 * step
        )
        np.testing.assert_allclose(by_coefficients[..., k], differences, atol=1e-8)


@settings(max_examples=50)
@given(st.floats(-2, 2), st.floats(-4, 4), st.floats(-4, 4), st.floats(0.01, 0.95))
def test_distortion_round_trip_up_to_fold(k1, k2, k3, share):
    brown, last = (k1, k2, k3, 0.0, 0.0), fold((k1, k2, k3))
    point = share * min(last, 0.5) * np.array([[0.6, 0.8]])
    np.testing.assert_allclose(undistorted(distorted(point, brown), brown), point, rtol=1e-8)
    if np.isfinite(last):
        assert np.isnan(distorted(last * np.array([[0.61, 0.81]]), brown)).all()


@LENSES
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED_POSE], ids=["aligned", "misplaced"])
def test_distorted_pixels_match_opencv(terms, pose):
    """The sensor without distortion, followed by OpenCV's distortPoints."""
    ideal_sensor, distorted_sensor = sensor_with(pose=pose), sensor_with(pose=pose, **terms)
    b, pitch = ideal_sensor.lens.image_distance, ideal_sensor.imager.pitch_mm
    camera = np.array([[b / pitch, 0, 511.5], [0, b / pitch, 511.5], [0, 0, 1]])
    points = np.random.default_rng(1).normal(0, 800, (300, 3))
    for method in ("project", "project_directions"):
        (before, is_valid), (after, valid) = (
            getattr(s, method)(points) for s in (ideal_sensor, distorted_sensor)
        )
        both = is_valid & valid
        assert both.sum() > 100
        ideal = np.c_[(before[both] - 511.5) * pitch / b, np.ones(both.sum())]
        expected = cv2.projectPoints(ideal, np.zeros(3), np.zeros(3), camera, opencv(terms))[0][
            :, 0
        ]
        np.testing.assert_allclose(after[both], expected, atol=1e-8)
    _, directions, valid = distorted_sensor.backproject(after[both])
    assert valid.all()
    unit_directions = points[both] / np.linalg.norm(points[both], axis=1, keepdims=True)
    np.testing.assert_allclose(directions, unit_directions, atol=1e-9)


@pytest.mark.full
def test_characteristics_include_distortion():
    """Dh against differences of projected directions; blur against rays of real apertures."""
    sensor = sensor_with(**BARREL)
    omega = np.array([30.0, 60.0, 90.0, 120.0])
    ends = [sensor.project_directions(_direction(omega + s)).pixels for s in (-0.005, 0.005)]
    result = om.evaluate(sensor, omega_deg=omega)
    np.testing.assert_allclose(
        result.dh_domega_px_per_deg, np.linalg.norm(ends[1] - ends[0], axis=1) / 0.01, rtol=1e-6
    )
    assert om.check_blur(sensor, [4.0]).max_abs("edge_t_px").max() < 0.002
    assert om.check_blur(sensor, [4.0]).max_abs("edge_s_px").max() < 0.002
    distorted_mtf, ideal_mtf = (om.mtf(s, omega, pixel=False) for s in (sensor, sensor_with()))
    for i in range(len(omega)):  # object resolution is unchanged, independent of the image scale
        finest = min(m.cycles_per_deg_t[i, -1] for m in (distorted_mtf, ideal_mtf))
        frequency = np.linspace(0, finest, 50)
        a, b = (
            np.interp(frequency, m.cycles_per_deg_t[i], m.tangential[i])
            for m in (distorted_mtf, ideal_mtf)
        )
        np.testing.assert_allclose(a, b, atol=0.005)


def _direction(omega_deg):
    angle = np.radians(omega_deg)
    return np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=-1)


@pytest.mark.skipif(not backend.is_compiled, reason="nothing was compiled here")
@LENSES
@pytest.mark.parametrize(
    "pose", few([MirrorPose(), MISALIGNED_POSE], MISALIGNED_POSE), ids=["aligned", "misplaced"]
)
def test_compiled_rays_match_double_precision(terms, pose):
    sensor = sensor_with(pixels=100, pose=pose, **terms)
    sensor = replace(sensor, mount=replace(sensor.mount, image_flipped=True))
    plan, part = sampling_plan(16, blur=True), (slice(0, 100), slice(0, 100))
    fast, slow = (
        f(sensor, plan, Radiometry(vignetting=1.0), *part)
        for f in (rays._trace_natively, rays._trace_sensor)
    )
    assert np.mean(fast.outcome != slow.outcome) < 1e-4
    is_valid = (fast.outcome == slow.outcome) & (slow.outcome == rays.REFLECTED)
    np.testing.assert_allclose(fast.weight[is_valid], slow.weight[is_valid], atol=1e-5)
    np.testing.assert_allclose(fast.origins[is_valid], slow.origins[is_valid], atol=2e-4)
    a, b = (
        d[is_valid] / np.linalg.norm(d[is_valid], axis=-1, keepdims=True)
        for d in (fast.directions, slow.directions)
    )
    assert np.abs(a - b).max() < 2e-5


@pytest.mark.parametrize(
    "terms",
    [pytest.param(BARREL, marks=pytest.mark.full), TANGENTIAL],
    ids=["radial", "tangential"],
)
def test_dewarper_corrects_distortion(terms):
    """A sensor with distortion, rendered and dewarped with its own file, equals a pinhole view."""
    v, u = np.mgrid[:256, :512] / 40.0
    world = Environment(
        (0.5 + 0.2 * np.stack([np.sin(u), np.cos(u + v), np.sin(2 * v)], axis=-1)).astype(
            np.float32
        )
    )
    view = screens.Plane((200, 120), hfov_deg=70.0)
    direct = srgb_from_linear(
        world.radiance(np.zeros((120 * 200, 3)), view.targets(0, 120).reshape(-1, 3))
    )
    for camera in (sensor_with(), sensor_with(**terms)):
        straight = Dewarper(camera, view, "cubic")(
            srgb_from_linear(expose(camera, world, samples=16))
        )
        apart = straight.reshape(-1, 3) - direct
        assert -10 * np.log10(np.mean(apart**2)) > 60


def test_distortion_conserves_light():
    """The total light of a uniform world is that of its solid angle, independent of distortion."""
    white = Environment(np.ones((4, 8, 3), np.float32))
    sums = [
        float(
            expose(
                sensor_with(pixels=256, **t),
                white,
                samples=16,
                radiometry=Radiometry(vignetting=1.0),
            ).sum()
        )
        for t in ({}, BARREL, TANGENTIAL)
    ]
    np.testing.assert_allclose(sums[1:], sums[0], rtol=2e-3)


def test_folding_distortion_rejected():
    sensor = sensor_with(k1=-10.0)
    with pytest.raises(InvalidParameter, match=r"12.* the image folds over at 10\.3. deg"):
        sensor.backproject([[511.5, 511.5]])
    with pytest.raises(InvalidParameter, match="the image folds over"):
        expose(
            replace(sensor, mirror_pose=MISALIGNED_POSE),
            Environment(np.ones((4, 8, 3), np.float32)),
            samples=1,
        )


def test_distortion_in_sensor_files():
    text = format_sensor(sensor_with(**TANGENTIAL))
    assert parse_sensor(text) == sensor_with(**TANGENTIAL)
    assert "k1" not in format_sensor(sensor_with())


def test_radii_beyond_fold_are_nan():
    """r (1 - 0.3 r^2) increases to 0.7027 at r = 1.0541; the smallest positive root of the
    polynomial below."""
    k, radii = (-0.3, 0.0, 0.0), np.array([0.0, 0.1, 0.5, 0.7, 0.71, 5.0])
    assert fold(k) == pytest.approx(1 / np.sqrt(0.9), rel=1e-9)
    inverse = undistorted_radius(radii, k)
    for radius, r in zip(radii, inverse, strict=True):
        roots = np.roots([-0.3, 0.0, 1.0, -radius])
        real = [
            root.real for root in roots if abs(root.imag) < 1e-9 and -1e-12 <= root.real <= 1.06
        ]
        assert np.isnan(r) if not real else r == pytest.approx(min(real), abs=1e-9)
    assert np.isnan(inverse).tolist() == [False] * 4 + [True] * 2
    np.testing.assert_allclose(
        undistorted_radius(np.array([5.0]) * (1 + 0.2 * 25), (0.2, 0.0, 0.0)), [5.0], rtol=1e-9
    )


def test_fold_is_the_first_maximum():
    """At the fold itself, points are valid; without real extremum or at negative squares, no fold."""
    third = (-1 / 3, 0.0, 0.0)  # 1 - r^2 = 0
    assert fold(third) == 1.0
    brown = (*third, 0.0, 0.0)
    np.testing.assert_allclose(distorted(np.array([[1.0, 0.0]]), brown), [[2 / 3, 0.0]])
    assert np.isnan(distorted(np.array([[1.0 + 1e-9, 0.0]]), brown)).all()
    # 1 - 5 s + 4 s^2 = 0 for s = r^2 = 1/4 and 1; 7 k3 s^3 alone: -1 at s = 1
    assert fold((-5 / 3, 4 / 5, 0.0)) == pytest.approx(0.5, rel=1e-12)
    assert fold((0.0, 0.0, -1 / 7)) == pytest.approx(1.0, rel=1e-12)
    assert [fold(k) for k in [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (-0.6, 0.2, 0.0)]] == [np.inf] * 3


@pytest.mark.parametrize(
    ("k", "steps"),
    [
        ((-0.3, 0.0, 0.0), 8),
        ((0.2, 0.0, 0.0), 6),
        ((0.5, -0.2, 0.01), 7),
        ((4.0, 0.0, 0.0), 13),
        ((0.9, -1.9, 0.6), 7),  # fold at the lower end of the bracket
        ((-0.1, 0.8, -0.8), 7),  # fold at its upper end
    ],
)
def test_radii_are_inverted_within_a_number_of_steps(k, steps, monkeypatch):
    monkeypatch.setattr(lens, "MAX_STEPS", steps)
    r = np.linspace(0.0, 0.95 * min(fold(k), 3.0), 300)
    np.testing.assert_allclose(undistorted_radius(distorted_radius(r, k)[0], k), r, rtol=1e-9)
