"""Table of a calibrated camera against differences of its own projection."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.base.parameters import Uncertainty
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.commands import omnimirror
from tests.contracts.test_camera_models import MODELS

STEP = 1e-5


@pytest.mark.parametrize("camera", MODELS.values(), ids=MODELS)
def test_resolution_matches_projection(camera):
    """Radial and tangential resolution of 1 deg, from pixels of directions, undistorted to one
    side."""
    table = om.evaluate_camera(camera)
    assert table.omega_deg[0] == 0.0
    assert np.radians(table.omega_deg[-1]) == pytest.approx(camera.omega_max)
    sign = -1.0 if camera.optics == "mirror" else 1.0
    interior = slice(1, -1)
    omega = np.radians(table.omega_deg[interior])

    def pixels(omega, phi):
        directions = [
            np.sin(omega) * np.cos(phi),
            np.sin(omega) * np.sin(phi),
            sign * np.cos(omega),
        ]
        return camera.image(np.stack(directions, axis=-1), distant=True).pixels

    areas = []
    for phi in np.arange(8) * np.pi / 4:
        radial = (pixels(omega + STEP, phi) - pixels(omega - STEP, phi)) / (2 * np.degrees(STEP))
        azimuthal = (pixels(omega, phi + STEP) - pixels(omega, phi - STEP)) / (
            2 * np.degrees(STEP) * np.sin(omega)
        )[:, None]
        areas.append(np.abs(radial[:, 0] * azimuthal[:, 1] - radial[:, 1] * azimuthal[:, 0]))
        if camera.symmetry is not None:
            np.testing.assert_allclose(
                np.linalg.norm(radial, axis=1), table.dh_domega_px_per_deg[interior], rtol=1e-6
            )
            np.testing.assert_allclose(
                np.linalg.norm(azimuthal, axis=1), table.width_px_per_deg[interior], rtol=1e-6
            )
    np.testing.assert_allclose(np.mean(areas, axis=0), table.area_px2[interior], rtol=0.03)


def test_viewpoints_match_ray_axis_intersections():
    camera = MODELS["viewpoint-spline"]
    table = om.evaluate_camera(camera, [30.0, 60.0, 90.0])
    directions = np.radians(table.omega_deg)
    d = np.stack([0 * directions, np.sin(directions), -np.cos(directions)], axis=-1)
    rays = camera.backproject(camera.image(d, distant=True).pixels)
    radial, axial = (
        np.hypot(*rays.directions[:, :2].T),
        rays.directions[:, 2],
    )  # it faces up: Z is that of the world
    heights = rays.origins[:, 2] - np.hypot(*rays.origins[:, :2].T) / radial * axial
    np.testing.assert_allclose(table.viewpoint_z_mm, heights, atol=1e-9)


def test_angles_outside_field_rejected():
    camera = MODELS["ball"]
    with pytest.raises(
        OutsideField, match="omega_deg must be 0 to 150 deg, the field of the camera; got 160"
    ):
        om.evaluate_camera(camera, [10.0, 160.0])
    with pytest.raises(
        InvalidParameter, match=r"camera must be a calibrated camera \(see om\.load_camera\); got "
    ):
        om.evaluate_camera(om.load_sensor("paper-spherical"))


def test_skew_evaluation_matches_meridian():
    sensor = om.load_sensor("paper-hyperboloidal")
    table = om.evaluate_camera(om.SensorModel(sensor), [20.0, 60.0, 100.0])
    truth = om.evaluate(sensor, [20.0, 60.0, 100.0])
    for column in ("h_px", "dh_domega_px_per_deg", "width_px_per_deg"):
        np.testing.assert_allclose(getattr(table, column), getattr(truth, column), rtol=1e-6)
    assert np.ptp(table.viewpoint_z_mm) < 1e-6  # focus of a hyperboloid
    assert table.azimuthal_variation_percent < 1e-4
    assert table.field_deg == pytest.approx(sensor.field_deg[1], abs=1e-4)


def test_estimated_parameters_are_free_in_model():
    """More or fewer parameters than usual: the direction error is that of the uncertainty in the
    file."""
    parameters = om.SensorModel(om.load_sensor("paper-spherical")).parameters
    sensor = misaligned()
    names = (*sensor.uncertainty.names, "mirror.radius_mm")
    uncertainty = Uncertainty(names, np.diag([1e-4, 1e-4, 1e-6]))
    built = replace(sensor, uncertainty=uncertainty)
    assert [p.name for p in om.SensorModel(built).parameters] == list(names)
    assert set(names) != {p.name for p in parameters}
    table = om.evaluate_camera(om.SensorModel(built), [60.0, 100.0])
    result = om.evaluate_camera(om.SensorModel(sensor), [60.0, 100.0])
    assert (table.direction_sigma_deg > result.direction_sigma_deg).all()


def misaligned():
    """A misaligned sensor with uncertainties of a typical calibration."""
    pose = MirrorPose(0.4, -0.3, tilt_x_deg=0.5, tilt_y_deg=-0.6)
    sensor = replace(om.load_sensor("paper-spherical"), mirror_pose=pose)
    names = ("lens.focal_length_mm", "mirror_pose.decentre_x_mm")
    return replace(sensor, uncertainty=Uncertainty(names, ((1e-4, 0.0), (0.0, 1e-4))))


def test_misaligned_sensor_evaluation():
    """Radius and resolution against differences of its own projection, azimuth by azimuth."""
    sensor, omega = misaligned(), np.radians(60.0)
    table = om.evaluate_camera(om.SensorModel(sensor, sensor.uncertainty.names), [60.0])
    phi = np.radians(np.arange(0, 360, 10))

    def pixels(omega, rotation_rad=0.0):
        direction = (
            np.sin(omega) * np.cos(phi + rotation_rad),
            np.sin(omega) * np.sin(phi + rotation_rad),
            -np.cos(omega) + 0 * phi,
        )
        image = sensor.project_directions(np.stack(direction, axis=-1) @ sensor.mount.rotation().T)
        assert image.valid.all()
        return image.pixels

    centre = sensor.project_directions(-sensor.mount.rotation()[:, 2][None]).pixels[0]
    step = np.radians(0.01)
    radial = np.linalg.norm(pixels(omega + step) - pixels(omega - step), axis=1) / 0.02
    tangential = (
        np.linalg.norm(pixels(omega, step) - pixels(omega, -step), axis=1) / 0.02 / np.sin(omega)
    )
    assert table.h_px[0] == pytest.approx(
        np.linalg.norm(pixels(omega) - centre, axis=1).mean(), abs=1e-3
    )
    assert table.dh_domega_px_per_deg[0] == pytest.approx(radial.mean(), rel=1e-5)
    assert table.width_px_per_deg[0] == pytest.approx(tangential.mean(), rel=1e-5)
    assert table.azimuthal_variation_percent > 100 * np.abs(radial / radial.mean() - 1).max() > 0.01
    sigmas = om.direction_uncertainty(sensor, pixels(omega))
    assert table.direction_sigma_deg[0] == pytest.approx(np.sqrt((sigmas**2).mean()), rel=1e-4)


def test_evaluate_command_describes_misalignment(tmp_path):
    om.save_sensor(misaligned(), tmp_path / "built.toml")
    run = omnimirror(
        "evaluate",
        tmp_path / "built.toml",
        "--omega-deg",
        "0:120:30",
        "--json",
        tmp_path / "table.json",
    )
    assert run.returncode == 0, run.stderr
    output = " ".join(run.stdout.split())
    assert "decentred by 0.5 mm and tilted by 0.781 deg" in output
    assert "omnimirror uncertainty" in output
    assert '"azimuthal_variation_percent"' in (tmp_path / "table.json").read_text()
    failure = omnimirror("evaluate", tmp_path / "built.toml", "--focus-mm", "auto")
    assert failure.returncode == 2
    assert "--focus-mm requires an aligned mirror" in " ".join(failure.stderr.split())
