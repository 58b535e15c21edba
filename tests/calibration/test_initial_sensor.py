"""Initial values: from a central model to a mirror, and photographed balls."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import NotOneToOne
from omnimirror.calibration.sensor_model import ring_directions, without_fold
from omnimirror.cameras.camera import inside_image
from omnimirror.cameras.models import Unified
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import ConicAsphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import sensor_of
from tests.everyday import few


def differences_px(model, central, omega_max_deg):
    directions = ring_directions(central, omega_max_deg)[0]
    image, reference = (
        model.image(directions, distant=True),
        central.image(directions, distant=True),
    )
    is_common = image.valid & reference.valid
    is_common[is_common] = inside_image(reference.pixels[is_common], central.image_size)
    assert is_common.sum() > 500
    return np.hypot(*(image.pixels - reference.pixels)[is_common].T).max()


def test_unknown_mirror_reproduces_central_model():
    central = Unified(
        xi=1.1,
        focal_px=(260.0, 260.0),
        centre_px=(318.0, 242.0),
        image_size=(640, 480),
        optics="mirror",
    )
    model = om.SensorModel.from_central_model(central, omega_max_deg=125.0)
    assert differences_px(model, central, 125.0) < 0.1
    assert 0 < model.viewpoint_mm[2] < 40


@pytest.mark.parametrize(
    "kind", few(["sphere", "hyperboloid", "even-polynomial", "slope-spline"], "hyperboloid")
)
def test_known_mirror_type_recovers_shape(kind):
    truth = sensor_of(kind)
    change = (
        {"slopes": tuple(0.9 * s for s in truth.mirror.slopes)} if kind == "slope-spline" else {}
    )
    change |= (
        {"radius_mm": 60.0} if kind == "sphere" else {"a_mm": 45.0} if kind == "hyperboloid" else {}
    )
    change |= {"coefficients": (0.5, 0.0, 0.0)} if kind == "even-polynomial" else {}
    nominal = replace(truth, mirror=replace(truth.mirror, **change))
    field = truth.field_deg[1]
    model = om.SensorModel.from_central_model(
        om.SensorModel(truth), nominal, free=("shape", "tilt"), omega_max_deg=field - 0.1
    )
    x = np.linspace(0, 0.99 * truth.mirror.rim_radius_mm, 50)
    np.testing.assert_allclose(model.sensor.mirror.slope(x), truth.mirror.slope(x), atol=2e-3)
    assert differences_px(model, om.SensorModel(truth), field - 0.5) < 0.1


def test_misaligned_mirror_of_known_shape_is_estimated():
    truth = replace(sensor_of("sphere"), mirror_pose=MirrorPose(0.7, -0.4, 0.0, 0.0, 0.0))
    model = om.SensorModel.from_central_model(
        om.SensorModel(truth), truth.aligned(), free=("decentre",), omega_max_deg=120.0
    )
    pose = model.sensor.mirror_pose
    assert (pose.decentre_x_mm, pose.decentre_y_mm) == (
        pytest.approx(0.7, abs=1e-3),
        pytest.approx(-0.4, abs=1e-3),
    )


def test_ball_outline_is_reproduced():
    """Rays just inside the outline hit the ball, rays just outside miss it."""
    centre, radius = np.array([2350.0, 1300.0]), 700.0
    model = om.mirror_ball_model((4000, 3000), tuple(centre), radius, focal_px=6000.0)
    phi = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    ring = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    assert model.backproject(centre + 0.99 * radius * ring).valid.all()
    assert not model.backproject(centre + 1.01 * radius * ring).valid.any()
    axis = model.backproject(centre[None]).directions @ model.mount.rotation()  # back to the camera
    assert axis[0, 2] < -0.99


def test_distant_ball_equals_parallel_projection():
    near = om.mirror_ball_model((1001, 1001), (500.0, 500.0), 400.0, focal_px=4e6)
    far = om.MirrorBall(
        centre_px=(500.0, 500.0),
        rim_radius_px=400.0,
        field_deg=360.0,
        image_size=(1001, 1001),
        mount=near.mount,
    )
    pixels = np.array([[600.0, 500.0], [500.0, 250.0], [350.0, 700.0]])
    np.testing.assert_allclose(
        near.backproject(pixels).directions, far.backproject(pixels).directions, atol=2e-3
    )


def test_folding_mirror_ends_before_fold():
    """Estimated from photographs: the polynomials reverse at 129 deg, outside the boards."""
    shape = (0.9048884, -1.0279182, 0.7558168, -0.2282032)
    mirror = ConicAsphere(13.6992394, -8.2502947, 44.1189806, shape, 40.0)
    lens, imager = Perspective(5.2085251, 8.0, 160.0), Imager(640, 480, 5.0)
    sensor = om.Sensor(mirror, lens, imager, mirror_distance_mm=187.7321209)
    with pytest.raises(
        NotOneToOne, match=r"less than 43\.3\d* mm, where .* stops increasing \(129\.\d* deg\)"
    ):
        _ = sensor.field_deg
    limited = without_fold(sensor)
    assert limited.field_deg[1] == pytest.approx(129.1, abs=0.1)
    assert 0.97 < limited.mirror.rim_radius_mm / mirror.rim_radius_mm < 1
    x = np.linspace(0, limited.mirror.rim_radius_mm, 9)
    np.testing.assert_array_equal(limited.mirror.sag(x), mirror.sag(x))
    assert without_fold(limited) is limited
