"""Measured angles and distances against known scene points and samples from the covariance."""

import json
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.parameters import Uncertainty
from omnimirror.cameras.camera import Mount
from tests.calibration.test_uncertainty import random_covariance
from tests.commands import omnimirror
from tests.conftest import sensor_of

HEIGHT, WALL, PAN = 1200.0, 900.0, 35.0


def sensor():
    """Return a sensor that is tilted and flipped, and observes the floor and the walls."""
    return replace(sensor_of("sphere"), mount=Mount("up", 30.0, True, 4.0, -3.0))


def wall_points():
    """Return two points on the wall, 500 mm apart, from the definition of pan."""
    pan = np.radians(PAN)
    nearest = WALL * np.array([np.cos(pan), -np.sin(pan), 0.0])
    right = np.array([-np.sin(pan), -np.cos(pan), 0.0])
    first = nearest - 100.0 * right + [0.0, 0.0, -200.0]
    return np.array([first, first + 300.0 * right + [0.0, 0.0, -400.0]])


PLANES = {
    "floor": (np.array([[900.0, 200.0, -HEIGHT], [500.0, -100.0, -HEIGHT]]), {"height_mm": HEIGHT}),
    "wall": (wall_points(), {"wall_mm": WALL, "wall_pan_deg": PAN}),
}


@pytest.mark.parametrize("plane", PLANES)
def test_distance_is_that_of_scene_points(plane):
    """Points 500 mm apart are projected by the skew ray trace, then measured from their pixels."""
    points, options = PLANES[plane]
    result = om.measure(sensor(), sensor().project(points).pixels, **options)
    assert result.distance_mm == pytest.approx(500.0, abs=1e-4)
    np.testing.assert_allclose(result.points_mm, points, atol=1e-4)
    assert result.distance_sigma_mm is None
    assert result.angle_sigma_deg is None


def test_folded_sensors_are_measured_without_uncertainty():
    """A camera with a secondary mirror has no parameters, which only uncertainties require."""
    folded = om.load_sensor("folded-spherical")
    points = np.array([[900.0, 200.0, -HEIGHT], [500.0, -100.0, -HEIGHT]])
    result = om.measure(folded, folded.project(points).pixels, height_mm=HEIGHT)
    assert result.distance_mm == pytest.approx(500.0, abs=0.01)
    assert result.distance_sigma_mm is None


@pytest.mark.parametrize("angle", [1e-3, 40.0, 179.0])
def test_angle_is_that_of_directions(angle):
    pans = np.radians([10.0, 10.0 + angle])
    directions = np.stack([np.cos(pans), -np.sin(pans), 0 * pans], axis=1)
    result = om.measure(sensor(), sensor().project_directions(directions).pixels)
    assert result.angle_deg == pytest.approx(angle, abs=1e-7)
    assert result.distance_mm is None


@pytest.mark.parametrize("plane", PLANES)
def test_uncertainty_matches_samples(plane):
    """Calibration, pixels and plane are sampled together; points are traced again each time."""
    points, options = PLANES[plane]
    model = om.SensorModel(sensor(), ("focal", "distance", "decentre"))
    covariance = random_covariance(model, 0.3)
    pixels = model.project(points).pixels
    sigmas = {"plane_sigma_mm": 3.0, "plane_sigma_deg": 0.3, "pixel_sigma_px": 0.2}
    result = om.measure(model, pixels, covariance=covariance, **options, **sigmas)
    normal = np.array([0.0, 0.0, -1.0])
    if plane == "wall":
        normal = np.array([np.cos(np.radians(PAN)), -np.sin(np.radians(PAN)), 0.0])
    across = np.linalg.svd(normal[None])[2][1:]
    rng = np.random.default_rng(3)
    values = np.array([p.value for p in model.parameters])
    angles, distances = [], []
    for sample in rng.multivariate_normal(values, covariance, size=1500):
        rays = model.with_parameters(sample).backproject(pixels + rng.normal(0.0, 0.2, (2, 2)))
        tilted = normal + np.radians(rng.normal(0.0, 0.3, 2)) @ across
        tilted /= np.linalg.norm(tilted)
        depth = options.get("height_mm", WALL) + rng.normal(0.0, 3.0)
        along = (depth - rays.origins @ tilted) / (rays.directions @ tilted)
        traced = rays.origins + along[:, None] * rays.directions
        distances.append(np.linalg.norm(traced[1] - traced[0]))
        angles.append(np.degrees(np.arccos(rays.directions[0] @ rays.directions[1])))
    # The standard deviation of 1500 samples has a standard error of 1.8 %
    assert np.std(angles) == pytest.approx(result.angle_sigma_deg, rel=0.08)
    assert np.std(distances) == pytest.approx(result.distance_sigma_mm, rel=0.08)
    exact = om.measure(model, pixels, covariance=covariance, **options)
    assert exact.distance_sigma_mm < result.distance_sigma_mm


def test_errors_of_common_rotation_cancel():
    """A decentred image of a pinhole-like small field shifts both directions equally: the angle is
    determined much better than each direction."""
    model = om.SensorModel(sensor(), ("decentre",))
    pixels = model.project_directions([[1.0, 0.0, 0.0], [1.0, 0.02, 0.0]]).pixels
    covariance = np.diag([1e-4] * len(model.parameters))
    single = om.direction_uncertainty(model, pixels, covariance=covariance)
    assert om.measure(model, pixels, covariance=covariance).angle_sigma_deg < 0.1 * single.min()


def test_uncertainty_is_unknown_outside_calibrated_field():
    model = om.SensorModel(sensor(), ("focal",))
    points, options = PLANES["floor"]
    pixels = model.project(points).pixels
    result = om.measure(model, pixels, covariance=[[1e-4]], field_deg=5.0, **options)
    assert result.angle_sigma_deg is None
    assert result.distance_sigma_mm is None


@pytest.mark.parametrize(
    ("pixels", "options", "message"),
    [
        ([[1.0, 2.0]], {}, r"pixels must be two points \(u, v\)"),
        ([[-9e3, 0.0], [500.0, 500.0]], {}, "pixels must be inside the field of view; got"),
        (None, {"height_mm": 1.0, "wall_mm": 1.0}, "must not be specified together"),
        (None, {"height_mm": 0.0}, "height_mm must be above 0 mm for a floor"),
        (None, {"height_mm": -HEIGHT}, "must reach the plane within 120000 mm"),
        (None, {"plane_sigma_mm": -1.0}, "plane_sigma_mm must be"),
    ],
)
def test_invalid_arguments_are_rejected(pixels, options, message):
    if pixels is None:
        pixels = sensor().project(PLANES["floor"][0]).pixels
    with pytest.raises(InvalidParameter, match=message):
        om.measure(sensor(), pixels, **options)


def test_command_reports_distance_with_uncertainty(tmp_path):
    model = om.SensorModel(sensor(), ("focal", "decentre"))
    calibrated = replace(sensor(), uncertainty=Uncertainty(model.free, random_covariance(model)))
    om.save_sensor(calibrated, tmp_path / "mine.toml")
    points, options = PLANES["floor"]
    pixels = calibrated.project(points).pixels
    done = omnimirror(
        "measure",
        tmp_path / "mine.toml",
        *[repr(float(x)) for x in pixels.ravel()],
        "--height-mm",
        "1200",
        "--json",
        tmp_path / "result.json",
    )
    assert done.returncode == 0, done.stderr
    assert "distance 500 +- " in done.stdout + done.stderr
    written = json.loads((tmp_path / "result.json").read_text())
    expected = om.measure(calibrated, pixels, **options)
    assert written["distance_sigma_mm"] == pytest.approx(expected.distance_sigma_mm, rel=1e-9)
