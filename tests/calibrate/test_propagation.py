"""Errors of directions and floor points: what parameters drawn from the covariance really do."""

from dataclasses import replace

import numpy as np
import pytest
import tomli_w

import omnimirror as om
from omnimirror.camera_models import Unified
from omnimirror.errors import InvalidParameter, SpecError
from omnimirror.frames import Mount
from omnimirror.mirrors.pose import MirrorPose
from omnimirror.parameters import Uncertainty
from omnimirror.specs.sensor_file import tables_of
from tests.commands import omnimirror
from tests.conftest import sensor_of

FREE = ("focal", "distance", "decentre", "tilt", "shape")
HEIGHT = 1200.0


def some_covariance(model, size_px=0.2, seed=1):
    """Of parameters that move the picture by fractions of a pixel, correlated."""
    rng = np.random.default_rng(seed)
    mixed = rng.normal(size=(len(model.parameters), len(model.parameters)))
    mixed *= size_px * np.array([p.scale for p in model.parameters])[:, None] / np.sqrt(len(mixed))
    return mixed @ mixed.T


def models():
    sensor = replace(sensor_of("conic-asphere"), mirror_pose=MirrorPose(0.6, -0.3, 0.0, 0.4, -0.5))
    sensor = replace(sensor, mount=Mount("down", 30.0, True, 4.0, -3.0))
    yield om.SensorModel(sensor, FREE)
    yield Unified(1.0, (260.0, 260.0), (511.5, 511.5), (1024, 1024), optics="mirror", mount=Mount("up"))


@pytest.mark.parametrize(
    "model", [pytest.param(m, id=m.KIND, marks=() if m.KIND == "sensor" else pytest.mark.full) for m in models()]
)
def test_drawn_parameters_scatter_as_much_as_is_said(model):
    covariance = some_covariance(model, 0.2 if model.KIND == "sensor" else 0.03)
    pixels = np.array([[661.5, 511.5], [511.5, 711.5], [420.0, 450.0], [511.5, 560.0]])
    said_deg = om.direction_uncertainty(model, pixels, covariance=covariance)
    height = HEIGHT if (model.backproject(pixels).directions[:, 2] < 0).any() else -HEIGHT
    said_mm = om.floor_uncertainty(model, pixels, height_mm=height, covariance=covariance)
    rng = np.random.default_rng(0)
    values = np.array([p.value for p in model.parameters])
    directions, floor = [], []
    for drawn in rng.multivariate_normal(values, covariance, size=400):
        rays = model.with_parameters(drawn).backproject(pixels)
        directions.append(rays.directions)
        along = (-height - rays.origins[:, 2]) / rays.directions[:, 2]
        floor.append((rays.origins + along[:, None] * rays.directions)[:, :2])
    assert np.isfinite(said_deg).all()
    for i, _ in enumerate(pixels):
        spread = np.cov(np.array(directions)[:, i].T)
        assert np.degrees(np.sqrt(np.linalg.eigvalsh(spread)[-1])) == pytest.approx(said_deg[i], rel=0.12)
        if np.isfinite(said_mm[i]):
            spread = np.cov(np.array(floor)[:, i].T)
            assert np.sqrt(np.linalg.eigvalsh(spread)[-1]) == pytest.approx(said_mm[i], rel=0.12)
    assert np.isfinite(said_mm).sum() >= 2


def calibrated():
    sensor = sensor_of("sphere")
    model = om.SensorModel(sensor, ("focal", "decentre"))
    known = Uncertainty(model.free, some_covariance(model))
    return replace(sensor, uncertainty=known)


def test_a_calibrated_sensor_keeps_its_covariance_in_its_file(tmp_path):
    sensor = calibrated()
    om.save_sensor(sensor, tmp_path / "mine.toml")
    read = om.load_sensor(tmp_path / "mine.toml")
    assert read == sensor
    pixels = [[700.0, 500.0], [100.0, 100.0]]
    own = om.direction_uncertainty(read, pixels)
    model = om.SensorModel(sensor, sensor.uncertainty.names)
    np.testing.assert_array_equal(
        own, om.direction_uncertainty(model, pixels, covariance=sensor.uncertainty.covariance)
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"names": ["lens.k1"], "covariance": [[1.0, 0.0]]}, "covariance is no matrix"),
        ({"names": ["lens.k1"], "covariance": [[-1.0]]}, "negative eigenvalue"),
        ({"names": ["lens.k1"]}, "uncertainty.covariance is missing"),
        ({"names": ["a", "a"], "covariance": [[1.0, 0.0], [0.0, 1.0]]}, "each once"),
    ],
)
def test_a_wrong_table_is_refused_at_its_line(table, words):
    text = tomli_w.dumps({**tables_of(sensor_of("sphere")), "uncertainty": table})
    with pytest.raises(SpecError, match=words):
        om.parse_sensor(text)


def test_a_sensor_without_covariance_says_what_is_missing():
    with pytest.raises(InvalidParameter, match=r"\[uncertainty\]"):
        om.direction_uncertainty(sensor_of("sphere"), [[500.0, 500.0]])
    with pytest.raises(InvalidParameter, match="the camera's parameters are lens"):
        om.direction_uncertainty(om.SensorModel(sensor_of("sphere")), [[500.0, 500.0]], covariance=np.eye(2))


def test_the_command_says_it_and_draws_it(tmp_path):
    om.save_sensor(calibrated(), tmp_path / "mine.toml")
    result = omnimirror("uncertainty", tmp_path / "mine.toml", "--height-mm", "1200", "-o", tmp_path / "map.png")
    assert result.returncode == 0, result.stderr
    assert "points of a floor 1200 mm below: median" in result.stdout + result.stderr
    assert (tmp_path / "map.png").stat().st_size > 1000


def test_every_door_says_the_same_error_of_a_direction():
    """Of a calibration, of its camera's pixels, and of the covariance itself."""
    board = om.Board("chessboard", 11, 7, 30.0)
    truth = om.Unified(0.9, (160.0, 160.0), (322.0, 238.0), (640, 480))
    found = om.calibrate_camera(om.simulate_detections(truth, board, 6, noise_px=0.1), board, model="unified")
    pixels = np.array([[400.0, 240.0], [322.0, 100.0]])
    ahead = found.model.backproject(pixels).directions @ found.model.mount.rotation()
    said = found.direction_sigma_deg(ahead)
    np.testing.assert_allclose(om.direction_uncertainty(found.camera, pixels), said, rtol=1e-6)
