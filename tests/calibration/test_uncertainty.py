"""Errors of directions and floor points against samples of parameters from the covariance."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.base.parameters import Uncertainty
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    MirrorBall,
    OCam,
    RadialSpline,
    Unified,
)
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import tables_of
from tests.commands import omnimirror
from tests.conftest import sensor_of

FREE = ("focal", "distance", "decentre", "tilt", "shape")
HEIGHT = 1200.0


def random_covariance(model, size_px=0.2, seed=1):
    """Return the covariance of correlated parameters that move the image by fractions of a pixel."""
    rng = np.random.default_rng(seed)
    mixed = rng.normal(size=(len(model.parameters), len(model.parameters)))
    mixed *= size_px * np.array([p.scale for p in model.parameters])[:, None] / np.sqrt(len(mixed))
    return mixed @ mixed.T


def models():
    sensor = replace(sensor_of("conic-asphere"), mirror_pose=MirrorPose(0.6, -0.3, 0.0, 0.4, -0.5))
    sensor = replace(sensor, mount=Mount("down", 30.0, True, 4.0, -3.0))
    yield om.SensorModel(sensor, FREE)
    yield Unified(
        xi=1.0,
        focal_px=(260.0, 260.0),
        centre_px=(511.5, 511.5),
        image_size=(1024, 1024),
        optics="mirror",
        mount=Mount("up"),
    )


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(m, id=m.KIND, marks=() if m.KIND == "sensor" else pytest.mark.full)
        for m in models()
    ],
)
def test_sampled_parameters_match_uncertainty(model):
    covariance = random_covariance(model, 0.2 if model.KIND == "sensor" else 0.03)
    pixels = np.array([[661.5, 511.5], [511.5, 711.5], [420.0, 450.0], [511.5, 560.0]])
    sigma_deg = om.direction_uncertainty(model, pixels, covariance=covariance)
    height = HEIGHT if (model.backproject(pixels).directions[:, 2] < 0).any() else -HEIGHT
    sigma_mm = om.floor_uncertainty(model, pixels, height_mm=height, covariance=covariance)
    rng = np.random.default_rng(0)
    values = np.array([p.value for p in model.parameters])
    directions, floor = [], []
    for sample in rng.multivariate_normal(values, covariance, size=400):
        rays = model.with_parameters(sample).backproject(pixels)
        directions.append(rays.directions)
        along = (-height - rays.origins[:, 2]) / rays.directions[:, 2]
        floor.append((rays.origins + along[:, None] * rays.directions)[:, :2])
    assert np.isfinite(sigma_deg).all()
    for i, _ in enumerate(pixels):
        spread = np.cov(np.array(directions)[:, i].T)
        assert np.degrees(np.sqrt(np.linalg.eigvalsh(spread)[-1])) == pytest.approx(
            sigma_deg[i], rel=0.12
        )
        if np.isfinite(sigma_mm[i]):
            spread = np.cov(np.array(floor)[:, i].T)
            assert np.sqrt(np.linalg.eigvalsh(spread)[-1]) == pytest.approx(sigma_mm[i], rel=0.12)
    assert np.isfinite(sigma_mm).sum() >= 2


def calibrated():
    sensor = sensor_of("sphere")
    model = om.SensorModel(sensor, ("focal", "decentre"))
    uncertainty = Uncertainty(model.free, random_covariance(model))
    return replace(sensor, uncertainty=uncertainty)


def test_a_calibrated_sensor_keeps_its_covariance_in_its_file(tmp_path):
    sensor = calibrated()
    om.save_sensor(sensor, tmp_path / "mine.toml")
    loaded = om.load_sensor(tmp_path / "mine.toml")
    assert loaded == sensor
    pixels = [[700.0, 500.0], [100.0, 100.0]]
    sigmas = om.direction_uncertainty(loaded, pixels)
    model = om.SensorModel(sensor, sensor.uncertainty.names)
    np.testing.assert_array_equal(
        sigmas, om.direction_uncertainty(model, pixels, covariance=sensor.uncertainty.covariance)
    )


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"names": ["lens.k1"], "covariance": [[1.0, 0.0]]},
            r"sensor file line 27: covariance must have the shape \(1, 1\) for 1 names",
        ),
        ({"names": ["lens.k1"], "covariance": [[-1.0]]}, "negative eigenvalue"),
        ({"names": ["lens.k1"]}, "uncertainty.covariance is missing"),
        (
            {"names": ["a", "a"], "covariance": [[1.0, 0.0], [0.0, 1.0]]},
            r"sensor file line 27: names must be different names of parameters; got \('a', 'a'\)",
        ),
    ],
)
def test_invalid_table_is_rejected_with_its_line(table, message):
    text = tomli_w.dumps({**tables_of(sensor_of("sphere")), "uncertainty": table})
    with pytest.raises(SpecError, match=message):
        om.parse_sensor(text)


def test_sensor_without_covariance_raises():
    with pytest.raises(InvalidParameter, match=r"\[uncertainty\]"):
        om.direction_uncertainty(sensor_of("sphere"), [[500.0, 500.0]])
    with pytest.raises(InvalidParameter, match="for the parameters lens"):
        om.direction_uncertainty(
            om.SensorModel(sensor_of("sphere")), [[500.0, 500.0]], covariance=np.eye(2)
        )


def test_command_prints_and_draws_uncertainty(tmp_path):
    om.save_sensor(calibrated(), tmp_path / "mine.toml")
    result = omnimirror(
        "uncertainty", tmp_path / "mine.toml", "--height-mm", "1200", "-o", tmp_path / "map.png"
    )
    assert result.returncode == 0, result.stderr
    assert "points of a floor 1200 mm below: median" in result.stdout + result.stderr
    assert (tmp_path / "map.png").stat().st_size > 1000


def test_all_interfaces_return_same_direction_uncertainty():
    """Results of a calibration, of pixels of its camera, and of the covariance itself."""
    board = om.Board("chessboard", 11, 7, 30.0)
    truth = om.Unified(
        xi=0.9, focal_px=(160.0, 160.0), centre_px=(322.0, 238.0), image_size=(640, 480)
    )
    calibration = om.calibrate_camera(
        om.simulate_detections(truth, board, 6, noise_px=0.1), board, model="unified"
    )
    pixels = np.array([[400.0, 240.0], [322.0, 100.0]])
    directions = (
        calibration.model.backproject(pixels).directions @ calibration.model.mount.rotation()
    )
    sigma = calibration.direction_sigma_deg(directions)
    np.testing.assert_allclose(
        om.direction_uncertainty(calibration.camera, pixels), sigma, rtol=1e-6
    )


SIZE, CENTRE, FOCAL = (640, 480), (319.5, 239.5), (140.0, 140.0)
MODELS = [
    Unified(
        xi=0.9,
        focal_px=FOCAL,
        centre_px=CENTRE,
        image_size=SIZE,
        k1=-0.01,
        k3=0.001,
        optics="mirror",
    ),
    EnhancedUnified(
        alpha=0.55, beta=1.1, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, optics="mirror"
    ),
    DoubleSphere(
        xi=-0.1, alpha=0.55, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, optics="mirror"
    ),
    KannalaBrandt(
        focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, k1=0.02, k4=1e-4, optics="mirror"
    ),
    KannalaBrandt(
        focal_px=FOCAL,
        centre_px=CENTRE,
        image_size=SIZE,
        k1=0.02,
        k4=1e-4,
        optics="fisheye",
        mount=Mount("forward"),
    ),
    OCam(polynomial=(-140.0, 0.0, 1.8e-3, 1e-7), centre_px=CENTRE, image_size=SIZE),
    RadialSpline(radii_px=(75.0, 150.0, 230.0), field_deg=270.0, centre_px=CENTRE, image_size=SIZE),
    MirrorBall(centre_px=CENTRE, rim_radius_px=230.0, field_deg=250.0, image_size=SIZE),
]


def field_angles_deg(camera, pixels):
    """Return angles between pixel rays and the camera axis, from the Camera contract only."""
    return np.degrees(
        np.arccos(np.clip(camera.backproject(pixels).directions @ camera.axis, -1, 1))
    )


@pytest.mark.parametrize("camera", MODELS, ids=lambda c: f"{c.KIND}-{c.optics}")
def test_uncertainties_are_restricted_to_the_calibrated_field(camera, tmp_path):
    """All models: via files, for directions, floors, maps, tables and figures."""
    uncertainty = Uncertainty(
        tuple(p.name for p in camera.parameters), random_covariance(camera, 0.01), 80.0
    )
    om.save_camera(replace(camera, uncertainty=uncertainty), tmp_path / "camera.toml")
    loaded = om.load_camera(tmp_path / "camera.toml")
    assert loaded.uncertainty == uncertainty
    pixels = np.random.default_rng(0).uniform(0, np.array(SIZE) - 1, (400, 2))
    angles = field_angles_deg(camera, pixels)
    is_finite, inside = np.isfinite(angles), angles <= 80.0
    assert 0.1 < inside.mean() < is_finite.mean()
    np.testing.assert_array_equal(np.isfinite(om.direction_uncertainty(loaded, pixels)), inside)
    unrestricted = om.direction_uncertainty(loaded, pixels, field_deg=180.0)
    np.testing.assert_array_equal(np.isfinite(unrestricted), is_finite)
    np.testing.assert_array_equal(
        om.direction_uncertainty(loaded, pixels)[inside], unrestricted[inside]
    )
    for height in (1000.0, -1000.0):
        limited, floor = (
            om.floor_uncertainty(loaded, pixels, height_mm=height, field_deg=f)
            for f in (None, 180.0)
        )
        np.testing.assert_array_equal(np.isfinite(limited), np.isfinite(floor) & inside)
        calibration = om.uncertainty_map(loaded, height_mm=height, steps=40)
        grid = np.stack(np.meshgrid(calibration.columns, calibration.rows), axis=-1).reshape(-1, 2)
        outside = ~(field_angles_deg(camera, grid) <= 80.0)
        assert np.isnan(calibration.sigma.reshape(-1)[outside]).all()
        assert (calibration.field_deg, calibration.is_restricted) == (80.0, True)
    table = om.evaluate_camera(loaded, [0.0, 79.0, 81.0])
    assert np.isfinite(table.direction_sigma_deg).tolist() == [True, True, False]
    assert table.summary()["calibrated_field_deg"] == 80.0


def test_the_command_reports_the_calibrated_field(tmp_path):
    """Boards reach 95 deg and the camera 137 deg: the outermost corner limits the field."""
    truth, board = MODELS[0], om.Board("chessboard", 11, 7, 30.0)
    detections = om.simulate_detections(truth, board, 60, noise_px=0.1, seed=4)
    farthest = [field_angles_deg(truth, d.corners_px).max() for d in detections]
    selected = [d for d, angle in zip(detections, farthest, strict=True) if angle < 95.0][:8]
    calibration = om.calibrate_camera(selected, board, model="unified")
    outermost = max(angle for angle in farthest if angle < 95.0)
    assert len(selected) == 8
    assert (
        70.0
        < calibration.field_deg
        == pytest.approx(
            max(field_angles_deg(truth, d.corners_px).max() for d in selected), abs=0.5
        )
    )
    assert calibration.field_deg < outermost + 0.5
    calibration.save(tmp_path / "camera.toml")
    result = omnimirror("uncertainty", tmp_path / "camera.toml", "--json", tmp_path / "inside.json")
    assert (
        f"restricted to the calibrated field of 0 to {calibration.field_deg:.4g} deg; use --field-deg"
        in result.stdout
    )
    wide = omnimirror(
        "uncertainty",
        tmp_path / "camera.toml",
        "--field-deg",
        "180",
        "--json",
        tmp_path / "all.json",
    )
    assert "restricted" not in wide.stdout + wide.stderr
    inside, unrestricted = (
        json.loads((tmp_path / f"{name}.json").read_text()) for name in ("inside", "all")
    )
    assert inside["largest_deg"] < 0.5 * unrestricted["largest_deg"]
    assert (inside["is_restricted"], unrestricted["is_restricted"]) == (True, False)


@pytest.mark.parametrize("to", ["opencv-omnidir", "kalibr-ds", "py-ocamcalib", "camodocal"])
def test_conversion_is_restricted_to_the_calibrated_field(to, tmp_path):
    """A camera with a k3 that no other program supports, and that deviates from other models beyond
    its corners."""
    camera = Unified(
        xi=0.9,
        focal_px=FOCAL,
        centre_px=CENTRE,
        image_size=SIZE,
        k1=-0.01,
        k2=1e-3,
        k3=2e-4,
        optics="mirror",
    )
    uncertainty = Uncertainty(
        tuple(p.name for p in camera.parameters), random_covariance(camera, 0.01), 95.0
    )
    calibrated_camera = replace(camera, uncertainty=uncertainty)
    file = "a.json" if to == "py-ocamcalib" else "a.yaml"
    conversion = om.convert(calibrated_camera, tmp_path / file, to=to, tolerance_px=5.0)
    wide = om.convert(calibrated_camera, tmp_path / file, to=to, tolerance_px=50.0, field_deg=180.0)
    assert max(c.at_deg for c in conversion.costs) < 95.0 + 1e-6
    assert conversion.largest_px < wide.largest_px / 2
    assert any(
        "calibrated field of 0 to 95 deg" in note and "fit.field_deg" in note
        for note in conversion.notes
    )
    assert not any("calibrated field" in note for note in wide.notes)
    message = r"--tolerance-px .*fit\.field_deg"
    with pytest.raises(
        InvalidParameter,
        match=message + (".*estimation\\.fixed=k3" if to == "opencv-omnidir" else ""),
    ):
        om.convert(calibrated_camera, tmp_path / file, to=to)


def test_exact_conversion_notes_the_calibrated_field(tmp_path):
    camera = MODELS[5]
    uncertainty = Uncertainty(("cx",), ((0.01,),), 70.0)
    conversion = om.convert(
        replace(camera, uncertainty=uncertainty), tmp_path / "calib_results.txt"
    )
    assert conversion.exact
    assert any(
        "calibrated field of 0 to 70 deg is not in the file" in note for note in conversion.notes
    )
    own_format = om.convert(replace(camera, uncertainty=uncertainty), tmp_path / "camera.toml")
    assert not any("calibrated field" in note for note in own_format.notes)
    assert om.load_camera(tmp_path / "camera.toml").uncertainty.field_deg == 70.0


def test_the_field_of_a_sensor_is_that_of_its_uncertainty():
    sensor = replace(calibrated(), uncertainty=replace(calibrated().uncertainty, field_deg=60.0))
    pixels = np.random.default_rng(0).uniform(0, 1023, (200, 2))
    inside = field_angles_deg(om.SensorModel(sensor), pixels) <= 60.0
    np.testing.assert_array_equal(np.isfinite(om.direction_uncertainty(sensor, pixels)), inside)


@pytest.mark.parametrize("field_deg", [0.0, -3.0, 180.5, float("nan")])
def test_invalid_field_raises(field_deg):
    with pytest.raises(InvalidParameter, match="field_deg"):
        Uncertainty(("cx",), ((1.0,),), field_deg)
