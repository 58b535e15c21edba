"""Sensor as a calibration model: images equal those of the sensor, derivatives those of its images."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.sensor_parameters import parameter_names
from omnimirror.cameras.camera import Mount
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few

MISALIGNED = MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0)


def random_points(count=60, seed=0):
    """Return points all around at 0.3 to 2 m, outside the obscuration of the mirror."""
    rng = np.random.default_rng(seed)
    towards = rng.normal(size=(2 * count, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    towards = towards[towards[:, 2] < 0.5][:count]
    return towards * rng.uniform(300, 2000, (len(towards), 1))


def distorted(sensor):
    return replace(sensor, lens=replace(sensor.lens, k1=-0.8, k2=2.0, k3=0.3, p1=0.004, p2=-0.003))


SENSORS = {
    **{kind: sensor_of(kind) for kind in MIRRORS},
    **{f"{kind}-misaligned": replace(sensor_of(kind), mirror_pose=MISALIGNED) for kind in MIRRORS},
    "distorted": replace(distorted(sensor_of("conic-asphere")), mirror_pose=MISALIGNED),
    "flipped": replace(
        distorted(sensor_of("sphere")),
        mirror_pose=MISALIGNED,
        mount=Mount("down", 20.0, True, 10.0, 5.0),
    ),
    "telecentric": sensor_of("sphere", "orthographic"),
    "telecentric-misaligned": replace(
        sensor_of("paraboloid", "orthographic"), mirror_pose=MISALIGNED
    ),
}


EVERYDAY = (
    "cone-misaligned",
    "conic-asphere",
    "cylinder-misaligned",
    "distorted",
    "equidistant-misaligned",
    "flipped",
    "sampled",
    "slope-spline-misaligned",
    "telecentric",
    "telecentric-misaligned",
)


@pytest.fixture(params=few(sorted(SENSORS), *EVERYDAY))
def sensor(request):
    return SENSORS[request.param]


def all_free(sensor):
    """Return all parameters of a sensor, with long lists reduced to three central elements."""
    names = list(parameter_names(sensor))
    lists = [n for n in names if n.startswith("mirror.") and n.endswith("]")]
    return om.SensorModel(sensor, tuple(n for n in names if n not in lists or n in middle(lists)))


def middle(names):
    return names[len(names) // 2 : len(names) // 2 + 3]


def projection(model, points, distant):
    """Return the points imaged by the sensor; for others, the search on a cone is slow and
    unsuccessful."""
    return points[model.image(points, distant=distant).valid]


@pytest.mark.parametrize("distant", [False, True])
def test_model_projects_as_sensor(sensor, distant):
    points = random_points()
    world = points @ sensor.mount.rotation().T
    image = om.SensorModel(sensor).image(points, distant=distant)
    truth = (sensor.project_directions if distant else sensor.project)(world)
    assert truth.valid.any()
    assert image.valid[truth.valid].all()
    np.testing.assert_allclose(
        image.pixels[truth.valid], truth.pixels[truth.valid], rtol=0, atol=1e-9
    )


DERIVED = ["conic-asphere", "equidistant", "ellipsoid", "even-polynomial", "slope-spline", "cone"]


@pytest.mark.parametrize("distant", [False, True])
@pytest.mark.parametrize(
    "name", [f"{kind}-misaligned" for kind in DERIVED] + ["distorted", "flipped", "telecentric"]
)
def test_derivatives_by_parameters_are_differences(name, distant):
    model = all_free(SENSORS[name])
    points = projection(model, random_points(24), distant)
    image = model.image(points, distant=distant)
    values = np.array([p.value for p in model.parameters])
    for k, parameter in enumerate(model.parameters):
        step = np.zeros(len(values))
        step[k] = h = 1e-6 * min(parameter.scale, max(1.0, abs(parameter.value)))
        moved = [model.with_parameters(values + sign * step).sensor for sign in (1, -1)]
        after, before = (
            om.SensorModel(other, ("focal",)).image(points, distant=distant) for other in moved
        )
        is_visible = image.valid & after.valid & before.valid
        assert is_visible.any()
        error = (after.pixels - before.pixels - 2 * h * image.d_parameters[:, :, k])[is_visible]
        assert (
            np.abs(error).max()
            < 1e-10 + 1e-5 * np.abs(2 * h * image.d_parameters[is_visible][:, :, k]).max()
        ), parameter.name


@pytest.mark.parametrize("distant", [False, True])
@pytest.mark.parametrize(
    "name",
    few(
        [n for n in sorted(SENSORS) if not n.startswith(("cylinder", "ground"))],
        *(n for n in EVERYDAY if not n.startswith("cylinder")),
    ),
)
def test_derivatives_by_points_are_differences(name, distant):
    sensor = SENSORS[name]
    model = om.SensorModel(sensor)
    points = projection(
        model, random_points(24) * (1e-3 if distant else 1.0), distant
    )  # directions of length about 1
    image, h = model.image(points, distant=distant), 1e-6 if distant else 1e-3
    for axis in np.eye(3):
        after, before = (model.image(points + s * h * axis, distant=distant) for s in (1, -1))
        is_visible = image.valid & after.valid & before.valid
        difference = (after.pixels - before.pixels)[is_visible] / (2 * h)
        scale = np.abs(image.d_points[is_visible]).max(initial=1.0)
        np.testing.assert_allclose(
            difference, image.d_points[is_visible] @ axis, rtol=0, atol=1e-5 * scale
        )


def test_points_beyond_rim_project_smoothly():
    """Points beyond the rim of an estimate that is too small correct its size."""
    sensor = sensor_of("hyperboloid")
    omega = np.radians(sensor.field_deg[1] + np.linspace(-2.0, 4.0, 121))
    image = om.SensorModel(sensor).image(
        np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1), distant=True
    )
    assert image.valid.all()
    assert np.ptp(np.diff(image.pixels[:, 0], n=2)) < 0.01


def test_invisible_points_are_invalid_and_nan():
    image = om.SensorModel(sensor_of("sphere")).image(
        [[0.0, 0.0, 500.0], [np.nan, 0.0, 0.0], [400.0, 0.0, 0.0]]
    )
    assert image.valid.tolist() == [False, False, True]
    assert np.isnan(image.pixels[:2]).all()
    assert np.isnan(image.d_parameters[:2]).all()
    assert np.isfinite(image.d_points[2]).all()


def test_parameters_round_trip_and_others_are_unchanged():
    sensor = SENSORS["distorted"]
    model = om.SensorModel(sensor, ("shape", "centre", "distortion", "tilt"))
    values = np.array([p.value for p in model.parameters])
    moved = model.with_parameters(values * 1.01 + 0.001)
    np.testing.assert_array_equal([p.value for p in moved.parameters], values * 1.01 + 0.001)
    assert [p.name for p in moved.parameters] == list(model.free)
    assert moved.priors == model.priors
    assert moved.with_parameters(values).parameters == model.parameters
    assert moved.sensor.mirror_distance_mm == sensor.mirror_distance_mm
    assert replace(moved.sensor.imager, centre_px=sensor.imager.centre) == replace(
        sensor.imager, centre_px=sensor.imager.centre
    )


def test_parameter_scale_moves_image_by_one_pixel():
    model, points = all_free(sensor_of("conic-asphere")), random_points()
    image = model.image(points)
    moved = np.linalg.norm(image.d_parameters[image.valid], axis=1) * [
        p.scale for p in model.parameters
    ]
    assert ((np.median(moved, axis=0) > 0.3) & (np.median(moved, axis=0) < 3)).all()


def test_priors_are_tolerances_of_the_design():
    sensor = sensor_of("sphere")
    model = om.SensorModel(sensor, ("focal", "tilt"))
    assert {p.name: (p.value, p.sigma) for p in model.priors} == {
        "lens.focal_length_mm": (11.6, pytest.approx(0.58)),
        "mirror_pose.tilt_x_deg": (0.0, 3.0),
        "mirror_pose.tilt_y_deg": (0.0, 3.0),
    }
    custom = om.SensorModel(sensor, ("focal",), (("lens.focal_length_mm", 11.5, 0.1),))
    assert custom.priors[0].value == 11.5


@pytest.mark.parametrize(
    ("free", "priors", "message"),
    [
        (("focus",), None, "groups \\(shape, focal"),
        (
            ("mirror.a_mm",),
            None,
            "parameters of 'sphere' must be among mirror.radius_mm.*got 'mirror.a_mm'",
        ),
        ((), None, "at least one parameter of 'sphere'"),
        (("focal",), (("mirror.radius_mm", 50.0, 1.0),), "must refer to free parameters"),
        (
            ("focal",),
            (("lens.focal_length_mm", 11.0, 0.0),),
            r"sigma of lens\.focal_length_mm must be greater than 0 and finite; got 0\.0",
        ),
    ],
)
def test_errors_report_valid_values(free, priors, message):
    with pytest.raises(InvalidParameter, match=message):
        om.SensorModel(sensor_of("sphere"), free, priors)


def test_viewpoint_is_intersection_of_rays_and_axis():
    """The viewpoint of a single-viewpoint hyperboloid is its focus."""
    sensor = sensor_of("hyperboloid")
    focus = np.hypot(sensor.mirror.a_mm, sensor.mirror.b_mm) - sensor.mirror.b_mm
    np.testing.assert_allclose(om.SensorModel(sensor).viewpoint_mm, [0, 0, focus], atol=1e-6)
