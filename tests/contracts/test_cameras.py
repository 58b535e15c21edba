"""Contract of all cameras, for any model and mount."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, NotOneToOne
from omnimirror.base.native import backend
from omnimirror.cameras.camera import Camera, Mount
from omnimirror.cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    RadialSpline,
    Unified,
    ViewpointSpline,
)
from omnimirror.dewarp import _source_coordinates as radial
from omnimirror.optics.lenses import Orthographic, Perspective, TabulatedLens
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors
from tests.conftest import MIRRORS

CATADIOPTRIC = (-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10)
FISHEYE = (-551.7655, 0.0, 8.372454e-04, -6.474789e-07, 1.235631e-09)
SKEWED = (0.999845, 4.4e-05, 8e-06)


def _distorted(name: str, **terms: float) -> om.Sensor:
    sensor = om.load_sensor(name)
    return replace(sensor, lens=replace(sensor.lens, **terms))


MODELS = {
    **{name: om.load_sensor(name) for name in bundled_sensors()},
    "misaligned": replace(
        om.load_sensor("paper-spherical"), mirror_pose=MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0)
    ),
    "distorted": _distorted("paper-equidistant", k1=-0.8, k2=2.0),
    "distorted-tangentially": _distorted("paper-hyperboloidal", k1=0.4, p1=0.004, p2=-0.003),
    "misaligned-telecentric": replace(
        om.load_sensor("paraboloid-telecentric"), mirror_pose=MirrorPose(-0.7, 0.4, -1.0, 0.5, 1.0)
    ),
    "ocam-mirror": om.OCam(
        polynomial=CATADIOPTRIC,
        centre_px=(515.323794, 382.294245),
        image_size=(1024, 768),
        affine=SKEWED,
    ),
    "ocam-mirror-rim": om.OCam(
        polynomial=CATADIOPTRIC,
        centre_px=(515.3, 382.3),
        image_size=(1024, 768),
        rim_radius_px=452.0,
    ),
    "ocam-fisheye": om.OCam(
        polynomial=FISHEYE,
        centre_px=(505.480427, 381.777786),
        image_size=(1024, 768),
        optics="fisheye",
    ),
    "unified": Unified(
        xi=0.96,
        focal_px=(220.0, 220.0),
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
        k1=-0.06,
        k2=0.01,
    ),
    "unified-distorted": Unified(
        xi=0.9,
        focal_px=(220.0, 223.0),
        centre_px=(322.0, 238.0),
        image_size=(640, 480),
        skew_px=0.4,
        k1=-0.08,
        k2=0.02,
        k3=-0.001,
        p1=0.003,
        p2=-0.002,
    ),
    "unified-folding": Unified(
        xi=1.4,
        focal_px=(330.0, 330.0),
        centre_px=(322.0, 238.0),
        image_size=(640, 480),
        k1=-0.5,
        rim_radius_px=200.0,
    ),
    "enhanced-unified": EnhancedUnified(
        alpha=0.6,
        beta=1.1,
        focal_px=(180.0, 180.0),
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
    ),
    "double-sphere": DoubleSphere(
        xi=-0.2,
        alpha=0.6,
        focal_px=(180.0, 181.0),
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
        optics="fisheye",
    ),
    "kannala-brandt": KannalaBrandt(
        focal_px=(170.0, 170.0),
        centre_px=(325.0, 235.0),
        image_size=(640, 480),
        k1=0.05,
        k2=-0.02,
        k3=0.003,
        k4=-0.0002,
    ),
    "radial-spline": RadialSpline(
        radii_px=(44.0, 92.0, 143.0, 191.0, 230.0),
        field_deg=230.0,
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
    ),
    "radial-spline-stretched": RadialSpline(
        radii_px=(44.0, 92.0, 143.0, 191.0, 230.0),
        field_deg=230.0,
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
        stretch_x=0.003,
        shear=-0.002,
        p1=1e-5,
        p2=-2e-5,
    ),
    "viewpoint-spline": ViewpointSpline(
        radii_px=(44.0, 92.0, 143.0, 191.0, 230.0),
        viewpoints_mm=(-2.0, -1.5, 0.0, 2.5, 5.0),
        field_deg=230.0,
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
    ),
    "ball-260": om.MirrorBall(
        centre_px=(1226.0, 1217.5), rim_radius_px=1122.75, field_deg=260.0, image_size=(2464, 2464)
    ),
    "ball-cut": om.MirrorBall(
        centre_px=(100.0, 400.0), rim_radius_px=390.0, field_deg=350.0, image_size=(640, 480)
    ),
    "ball-whole": om.MirrorBall(
        centre_px=(500.0, 500.0), rim_radius_px=499.0, field_deg=360.0, image_size=(1001, 1001)
    ),
}
ASYMMETRIC = {
    *("misaligned", "misaligned-telecentric", "distorted-tangentially", "ocam-mirror"),
    *("unified-distorted", "double-sphere", "radial-spline-stretched"),
}
MOUNTS = [
    Mount("up"),
    Mount("down", 0.0),
    Mount("forward"),
    Mount("up", 33.0, image_flipped=True),
    Mount("forward", 120.0, image_flipped=True, pitch_deg=-12.0, roll_deg=35.0),
]
CASES = [
    pytest.param(
        replace(model, mount=mount),
        id=f"{name}-{mount.camera_looks}{'-flipped' * mount.image_flipped}-{i}",
    )
    for name, model in MODELS.items()
    for i, mount in enumerate(MOUNTS)
]


def random_pixels(camera, count=400):
    """Return pixels over the whole image except the outermost corners, with some at its centre."""
    width, height = camera.image_size
    rng = np.random.default_rng(7)
    edge = 0.5 - 1e-9  # at the border itself, rounding decides
    corners = [[u, v] for u in (-edge, width - 1 + edge) for v in (-edge, height - 1 + edge)]
    near = np.add([[0.0, 0.0], [1e-9, 0.0], [1e-3, -1e-3]], (width / 2, height / 2))
    return np.concatenate(
        [rng.uniform(-0.5, [width - 0.5, height - 0.5], (count, 2)), corners, near]
    )


def random_directions(count=400):
    directions = np.random.default_rng(8).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("camera", CASES)
def test_implements_camera_protocol(camera):
    assert isinstance(camera, Camera)


NO_VECTORS = (
    None,
    "",
    "x",
    b"x",
    True,
    1j,
    7.0,
    [],
    {},
    object(),
    [[]],
    ["a", "b"],
    [[1, 2], [3]],
    np.zeros((2, 5)),
    [1.0, 2.0],
    [1.0, 2.0, 3.0],
    float("inf"),
    10**400,
    np.zeros(3, "datetime64[s]"),
)


@pytest.mark.parametrize("name", MODELS)
def test_invalid_vectors_are_rejected(name):
    camera = MODELS[name]
    for method, argument in (
        (camera.backproject, "pixels"),
        (camera.project, "points_mm"),
        (camera.project_directions, "directions"),
    ):
        for value in NO_VECTORS:
            with pytest.raises(InvalidParameter, match=f"^{argument} "):
                method(value)


@pytest.mark.parametrize("camera", CASES)
def test_project_directions_inverts_backproject(camera):
    pixels = random_pixels(camera)
    origins, directions, valid = camera.backproject(pixels)
    assert valid.sum() > 100
    back = camera.project_directions(directions[valid])
    assert back.valid.all()
    np.testing.assert_allclose(back.pixels, pixels[valid], atol=1e-9, rtol=0)
    for distance_mm in (1e3, 1e7):
        projection = camera.project(origins[valid] + distance_mm * directions[valid])
        assert projection.valid.all()
        np.testing.assert_allclose(projection.pixels, pixels[valid], atol=1e-9, rtol=0)


@pytest.mark.parametrize("camera", CASES)
def test_backproject_returns_unit_vectors_or_nan(camera):
    width, height = camera.image_size
    pixels = np.concatenate(
        [random_pixels(camera), [[-0.6, 3.0], [3.0, height], [width + 1e9, 0.0], [np.nan, 5.0]]]
    )
    origins, directions, valid = camera.backproject(pixels)
    assert origins.shape == directions.shape == (len(pixels), 3)
    np.testing.assert_allclose(np.linalg.norm(directions[valid], axis=1), 1.0, atol=1e-12)
    assert np.isfinite(origins[valid]).all()
    assert np.isnan(origins[~valid]).all()
    assert np.isnan(directions[~valid]).all()
    assert not valid[-4:].any()


@pytest.mark.parametrize("camera", CASES)
def test_project_returns_pixels_in_image_or_nan(camera):
    directions = np.concatenate([random_directions(), np.eye(3), -np.eye(3)])
    pixels, valid = camera.project_directions(directions)
    width, height = camera.image_size
    assert valid.any()
    inside = pixels[valid]
    assert ((inside >= -0.5) & (inside <= (width - 0.5, height - 0.5))).all()
    assert np.isnan(pixels[~valid]).all()
    undefined = camera.project_directions([[0.0, 0.0, 0.0], [np.nan, 1.0, 0.0]])
    assert not undefined.valid.any()
    assert np.isnan(undefined.pixels).all()


@pytest.mark.parametrize("camera", CASES)
def test_projection_is_independent_of_vector_length(camera):
    directions = random_directions()
    short, long = camera.project_directions(directions), camera.project_directions(directions * 1e4)
    np.testing.assert_array_equal(short.valid, long.valid)
    np.testing.assert_allclose(short.pixels, long.pixels, atol=1e-9, rtol=0)


@pytest.mark.parametrize("camera", CASES)
def test_distant_points_are_projected_as_directions(camera):
    directions = random_directions()
    near_enough = camera.project(directions * 1e10)
    limit = camera.project_directions(directions)
    both = near_enough.valid & limit.valid
    assert both.sum() >= limit.valid.sum() - 1
    np.testing.assert_allclose(near_enough.pixels[both], limit.pixels[both], atol=1e-5, rtol=0)


@pytest.mark.parametrize("camera", CASES)
def test_declared_axial_symmetry_holds(camera):
    """Directions about the claimed axis are imaged at the claimed radius and equidistant azimuths."""
    symmetry = camera.symmetry
    if symmetry is None:
        assert any(camera == replace(MODELS[name], mount=camera.mount) for name in ASYMMETRIC)
        return
    axis = symmetry.axis
    e1 = np.cross(axis, [0.36, 0.48, 0.8])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    for omega in np.linspace(symmetry.omega_min, symmetry.omega_max, 7)[1:-1]:
        turn = np.radians(np.arange(0, 360, 10))[:, None]
        directions = np.cos(omega) * axis + np.sin(omega) * (np.cos(turn) * e1 + np.sin(turn) * e2)
        pixels, valid = camera.project_directions(directions)
        offsets = pixels - symmetry.centre_px
        radius = symmetry.radius_px(np.array([omega]))[0]
        np.testing.assert_allclose(np.hypot(*offsets[valid].T), radius, rtol=1e-11)
        angles = np.degrees(np.arctan2(offsets[:, 1], offsets[:, 0]))
        steps = (np.diff(angles)[valid[1:] & valid[:-1]] + 180) % 360 - 180
        np.testing.assert_allclose(abs(steps), 10.0, atol=1e-9)
        assert (np.sign(steps) == np.sign(steps[:1])).all()


@pytest.mark.parametrize("camera", CASES)
def test_orientation_of_image_axes(camera):
    symmetry = camera.symmetry
    if symmetry is None:
        return
    omega = 0.7 * symmetry.omega_min + 0.3 * symmetry.omega_max
    radius = symmetry.radius_px(np.array([omega]))[0]
    for across, in_image in (
        (symmetry.right, [1, 0]),
        (symmetry.down, [0, 1]),
        (-symmetry.right, [-1, 0]),
    ):
        pixels, valid = camera.project_directions(
            [np.cos(omega) * symmetry.axis + np.sin(omega) * across]
        )
        if valid[0]:
            np.testing.assert_allclose(
                pixels[0], symmetry.centre_px + radius * np.array(in_image), atol=1e-8
            )


@pytest.mark.parametrize("camera", CASES)
def test_ray_origins_agree_with_axial_symmetry(camera):
    """Any point of the ray is accepted: the line counts."""
    symmetry = camera.symmetry
    if symmetry is None:
        return
    pixels = random_pixels(camera)
    origins, directions, valid = camera.backproject(pixels)
    origins, directions, offsets = (
        origins[valid],
        directions[valid],
        (pixels - symmetry.centre_px)[valid],
    )
    sideways = (
        offsets @ [symmetry.right, symmetry.down] / np.linalg.norm(offsets, axis=1, keepdims=True)
    )
    across, along = np.zeros((2, len(origins)))
    if symmetry.origin_mm is not None:
        omega = np.arccos(np.clip(directions @ symmetry.axis, -1, 1))
        across, along = symmetry.origin_mm(np.clip(omega, symmetry.omega_min, symmetry.omega_max))
    start = across[:, None] * sideways + along[:, None] * symmetry.axis
    np.testing.assert_allclose(np.cross(origins - start, directions), 0, atol=1e-5)


@pytest.fixture(params=["compiled", "not compiled"])
def table_of(request, uncompiled):
    """Implementation of the radial table of a camera."""
    if request.param == "not compiled":
        uncompiled()
    elif not backend.is_compiled:
        pytest.skip("the compiled module is not built")
    return lambda camera: radial.RadialTable(camera.symmetry, camera.image_size)


TABLES = [
    pytest.param(
        *case.values,
        id=case.id,
        marks=() if (n + n // len(MOUNTS)) % len(MOUNTS) == 0 else pytest.mark.full,
    )
    for n, case in enumerate(CASES)
]
"""Daily cases: each model with one mount, another than that of the preceding model."""


@pytest.mark.parametrize("camera", TABLES)
def test_radial_table_agrees_with_projection(camera, table_of):
    """Interpolated table against the camera; visibility agrees except at the very boundary."""
    if camera.symmetry is None:
        return
    axis, right, down = camera.symmetry.axis, camera.symmetry.right, camera.symmetry.down
    near = axis + np.geomspace(1e-9, 1e-2, 20)[:, None] * (
        0.6 * right - 0.8 * down
    )  # near the axis
    invalid_directions = [[0.0, 0.0, 0.0], [np.nan, 1.0, 0.0]]
    directions = np.concatenate([random_directions() * 7.5, near, [axis], invalid_directions])
    pixels, excess = table_of(camera).pixels_and_excess(directions)
    exact = camera.project_directions(directions).pixels
    np.testing.assert_array_equal(np.isnan(pixels), np.isnan(exact))
    np.testing.assert_array_equal(excess <= 0, ~np.isnan(exact[:, 0]))
    assert np.nanmax(np.abs(pixels - exact)) < 1e-5


@pytest.mark.parametrize("camera", TABLES)
def test_radial_table_agrees_with_projection_of_near_points(camera, table_of):
    """Including points at, behind and inside the mirror, and in its shadow."""
    if camera.symmetry is None:
        return
    rng = np.random.default_rng(5)
    distances = rng.choice([10.0, 45.0, 60.0, 150.0, 1e3, 1e5], 3000)[:, None]
    s = camera.symmetry
    odd = np.outer([-300.0, -50.0, 0.1, 50.0, 300.0], s.axis) + 1e-6 * s.right
    points = np.concatenate(
        [
            random_directions(3000) * distances,
            odd,
            [44.0 * s.right, 44.0 * s.down, [np.nan, 1.0, 0.0]],
        ]
    )
    pixels, excess = table_of(camera).pixels_and_excess(points, are_points=True)
    exact = camera.project(points).pixels
    np.testing.assert_array_equal(np.isnan(pixels), np.isnan(exact))
    assert not (excess[np.isnan(exact[:, 0])] <= 0).any()
    assert np.nanmax(np.abs(pixels - exact)) < 5e-5


LENSES = {
    "perspective": Perspective(11.6, 4.0, 210.0),
    "orthographic": Orthographic(0.0592, 4.0, 22.0),
    "table": TabulatedLens(
        11.6, 4.0, 212.0, (0.0, 5.0, 10.0, 15.0, 20.0),
        tuple(12.2 * np.tan(np.radians([0.0, 5.0, 10.0, 15.0, 20.0]))), (3.0, 3.0, 3.1, 3.2, 3.3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(MIRRORS))
@pytest.mark.parametrize("lens", LENSES)
def test_every_mirror_maps_one_to_one_or_is_rejected(kind, lens):
    """The ray of a pixel projects back to this pixel for any tilt; a small tilt cannot turn an
    invalid sensor into a camera.
    """
    mirror, m = MIRRORS[kind]
    aligned = om.Sensor(
        mirror, LENSES[lens], om.load_sensor("paper-spherical").imager, mirror_distance_mm=m
    )
    rng = np.random.default_rng(3)
    pixels = np.concatenate([rng.uniform(0, 1023, (150, 2)), 511.5 + rng.normal(0.0, 3.0, (20, 2))])
    try:
        aligned.backproject(pixels)
        is_camera = True
    except NotOneToOne:
        is_camera = False
    assert is_camera == ((kind, lens) != ("cone", "orthographic"))
    for tilt in (0.0, 1e-9, 1e-6, 1e-3, 0.3):
        sensor = replace(aligned, mirror_pose=MirrorPose(tilt_x_deg=tilt, tilt_y_deg=-tilt / 3))
        if not is_camera:
            for question in (sensor.backproject, sensor.project, sensor.project_directions):
                with pytest.raises(NotOneToOne):
                    question(np.ones((1, 2 if question == sensor.backproject else 3)))
            continue
        rays = sensor.backproject(pixels)
        assert rays.valid.sum() > 100
        projection = sensor.project_directions(rays.directions[rays.valid])
        assert projection.valid.all()
        np.testing.assert_allclose(projection.pixels, pixels[rays.valid], atol=1e-6)


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_handedness_of_image_by_number_of_reflections(model, flipped):
    """Three directions, clockwise as seen by an observer, and their sense of rotation in the image."""
    model = replace(model, mount=replace(model.mount, image_flipped=flipped))
    axis = (
        model.symmetry.axis
        if model.symmetry
        else getattr(model, "axis", np.array([0.0, 0.0, -1.0]))
    )
    e1 = np.cross(axis, [0.36, 0.48, 0.8])
    e2 = np.cross(axis, e1)  # looking along the axis, from e1 to e2 is clockwise
    around = [e1, e2 - e1 / 2, -e2 - e1 / 2]
    aside = 0.3 + 2 * np.tan(
        model.symmetry.omega_min if model.symmetry else 0.0
    )  # outside the obscuration
    pixels, valid = model.project_directions([axis + aside * e for e in around])
    assert valid.all()
    (du1, dv1), (du2, dv2) = pixels[1] - pixels[0], pixels[2] - pixels[0]
    is_clockwise_in_image = du1 * dv2 - dv1 * du2 > 0  # rows increase downwards
    is_mirror = (
        getattr(model, "optics", "mirror") == "mirror" and getattr(model, "secondary", None) is None
    )
    assert is_clockwise_in_image == (is_mirror == flipped)
    assert model.is_image_reversed == (not is_clockwise_in_image)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_flipped_image_is_mirrored(model):
    """The centre of a sensor is that of the camera; the centre of a calibration is that of the
    delivered image."""
    flipped = replace(model, mount=replace(model.mount, image_flipped=True))
    last_column = model.image_size[0] - 1
    if not isinstance(model, om.Sensor):
        flipped = replace(flipped, centre_px=(last_column - model.centre_px[0], model.centre_px[1]))
    if isinstance(model, om.OCam):
        c, d, e = model.affine
        flipped = replace(flipped, affine=(c, -d, -e))
    reversing = {
        name
        for name in ("skew_px", "shear", "p2")
        if name in getattr(model, "__dataclass_fields__", {})
    }
    flipped = replace(flipped, **{name: -getattr(model, name) for name in reversing})
    directions = random_directions()
    straight, reversed_ = (
        model.project_directions(directions),
        flipped.project_directions(directions),
    )
    np.testing.assert_array_equal(straight.valid, reversed_.valid)
    np.testing.assert_allclose(
        reversed_.pixels, [last_column, 0] + straight.pixels * [-1, 1], atol=1e-9, rtol=0
    )
