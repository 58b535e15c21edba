"""Sensor as a camera: frames and handedness by brute force, images of points, field limits."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Camera, Mount, pan_tilt_direction, view_axes
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors.mirror import MirrorPose

SPH = om.load_sensor("paper-spherical")


@pytest.mark.parametrize(("orientation", "azimuth"), [("up", 7.595), ("down", -7.595)])
def test_forward_wall_orientation(orientation, azimuth):
    """Numeric case of section 1a: point A at y = +400 mm, on the left for an observer, on a wall 3
    m ahead."""
    sensor = replace(SPH, mount=Mount(orientation, forward_azimuth_deg=0.0))
    (a, b), valid = sensor.project([[3000, 400, 0], [3000, -400, 0]])
    assert valid.all()
    for pixel, sign in ((a, 1), (b, -1)):
        u, v = pixel - 511.5
        assert np.degrees(np.arctan2(v, u)) == pytest.approx(sign * azimuth, abs=5e-4)
    columns = [1799.5 - 10 * np.degrees(np.arctan2(y, 3000)) for y in (400, -400)]
    assert columns == pytest.approx([1723.55, 1875.45], abs=5e-3)
    # the observation of those pixels is in those panorama columns
    _, directions, _ = sensor.backproject([a, b])
    pans = np.degrees(np.arctan2(-directions[:, 1], directions[:, 0]))
    assert 1799.5 + 10 * pans == pytest.approx(
        columns, abs=0.2
    )  # backproject starts at the mirror, not at the origin


def test_manually_traced_ray_reaches_pixel():
    """Brute force in the camera frame: lens at the origin, directed upwards at a sphere; find the
    pixel of the point."""
    A, m, b0, pitch = 1.138 * 43.9, 4.110 * 43.9, SPH.lens.image_distance, 5.2e-3
    target = np.array([900.0, -300.0, m + 250.0])  # X right, Y down, Z up the optical axis
    centre = np.array([0.0, 0.0, m + A])

    def miss(uv):
        ray = np.array([*(uv * pitch), b0]) / np.linalg.norm([*(uv * pitch), b0])
        t = ray @ centre - np.sqrt((ray @ centre) ** 2 - centre @ centre + A * A)
        hit, n = t * ray, (t * ray - centre) / A
        out = ray - 2 * (ray @ n) * n
        return np.cross(out, (target - hit) / np.linalg.norm(target - hit))

    uv = np.array([400.0, -130.0])
    for _ in range(50):  # Gauss-Newton with numerical derivatives
        J = np.stack([(miss(uv + d) - miss(uv - d)) / 2e-4 for d in np.eye(2) * 1e-4], axis=1)
        uv = uv - np.linalg.lstsq(J, miss(uv), rcond=None)[0]
    assert np.linalg.norm(miss(uv)) < 1e-12
    # Seen from below the mirror with the image top towards x: Y is backwards, Z up, so X = Y x Z is
    # to the left.
    up = replace(SPH, mount=Mount("up", forward_azimuth_deg=-90.0))
    world = np.array([-target[1], target[0], target[2] - m])
    pixels, valid = up.project([world])
    assert valid[0]
    np.testing.assert_allclose(pixels[0] - 511.5, uv, atol=1e-7)


@given(orientation=st.sampled_from(["up", "down", "forward"]), azimuth=st.floats(-720, 720))
def test_mounts_are_rotations(orientation, azimuth):
    R = Mount(orientation, azimuth).rotation()
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)
    axis = {"up": [0, 0, 1], "down": [0, 0, -1], "forward": [1, 0, 0]}[orientation]
    np.testing.assert_allclose(R @ [0, 0, 1], axis, atol=1e-15)
    c, s = np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))
    np.testing.assert_allclose(
        R @ [c, s, 0], [0, 0, 1] if orientation == "forward" else [1, 0, 0], atol=1e-12
    )


def test_integer_azimuth_accepted():
    assert (Mount("up", -360 * 2**90).rotation() == Mount("up", 0).rotation()).all()


@given(pan=st.floats(-180, 180), tilt=st.floats(-90, 90), roll=st.floats(-180, 180))
def test_view_axes_right_handed(pan, tilt, roll):
    f, r, d = view_axes(pan, tilt, roll)
    np.testing.assert_allclose(np.array([f, r, d]) @ np.array([f, r, d]).T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.cross(r, d), f, atol=1e-14)  # X right, Y down, Z forward
    np.testing.assert_allclose(f, pan_tilt_direction(np.radians(pan), np.radians(tilt)), atol=1e-14)
    assert view_axes(pan, 0, 0)[1][2] == 0  # the horizon is level


def test_raw_image_is_reversed_unless_flipped():
    """A word on a wall, traversed from left to right, is traversed in reverse in the raw image."""

    def turn(sensor):
        word = np.array([[2000.0, y, 100.0] for y in (300, 0, -300)])
        (a, b, c), _ = sensor.project(word)
        up = sensor.project([[2000.0, 0.0, 300.0]]).pixels[0] - b
        right = c - a
        return np.sign(
            right[0] * up[1] - right[1] * up[0]
        )  # -1 if up is to the left of right: readable

    for orientation in ("up", "down", "forward"):
        sensor = replace(SPH, mount=Mount(orientation))
        flipped = replace(SPH, mount=Mount(orientation, image_flipped=True))
        if orientation == "forward":  # the mirror images the rear: move the wall there
            continue
        assert sensor.is_image_reversed
        assert turn(sensor) == 1
        assert not flipped.is_image_reversed
        assert turn(flipped) == -1


@pytest.mark.parametrize("tilt_deg", [0.0, 0.3])
def test_centre_refers_to_unflipped_image(tilt_deg):
    """The delivered image is the array reversed by columns, for any position of the optical axis."""
    sensor = om.load_sensor("paper-spherical")
    imager = replace(
        sensor.imager, width_px=60, height_px=48, pixel_pitch_um=90.0, centre_px=(21.0, 26.0)
    )
    straight = replace(sensor, imager=imager, mirror_pose=MirrorPose(tilt_x_deg=tilt_deg))
    flipped = replace(straight, mount=replace(sensor.mount, image_flipped=True))
    directions = straight.backproject([[21.0, 26.0], [30.0, 12.0]]).directions
    np.testing.assert_allclose(
        straight.project_directions(directions).pixels, [[21.0, 26.0], [30.0, 12.0]], atol=1e-9
    )
    np.testing.assert_allclose(
        flipped.project_directions(directions).pixels, [[38.0, 26.0], [29.0, 12.0]], atol=1e-9
    )
    scene = om.Room(texel_mm=40.0)
    one, other = (om.expose(s, scene, samples=1) for s in (straight, flipped))
    np.testing.assert_allclose(other, one[:, ::-1], atol=1e-5)


def test_pixels_outside_rim_or_image_invalid():
    _, directions, valid = SPH.backproject(
        [[511.5, 511.5], [5.0, 5.0], [-3.0, 511.5], [1013.2, 511.5], [1013.0, 511.5]]
    )
    assert valid.tolist() == [True, False, False, False, True]
    assert np.isnan(directions[~valid]).all()
    small = replace(SPH, imager=Imager(600, 600, 5.2))
    directions = SPH.backproject([[511.5 + 400, 511.5]]).directions
    pixels, valid = small.project_directions(directions)
    assert not valid[0]
    assert np.isnan(pixels[0]).all()


def test_zero_directions_and_hidden_points_invalid():
    assert SPH.project_directions([[0, 0, 0], [0, 0, -1], [0, 0, 1]]).valid.tolist() == [
        False,
        True,
        False,
    ]
    assert SPH.project([[0, 0, 500], [0, 0, -100], [np.nan, 0, 0]]).valid.tolist() == [
        False,
        True,
        False,
    ]


def test_distant_point_matches_direction():
    rng = np.random.default_rng(1)
    d = rng.normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    by_direction = SPH.project_directions(d)
    by_point = SPH.project(d * 1e12)
    both = by_direction.valid & by_point.valid
    assert both.mean() > 0.6
    np.testing.assert_allclose(by_point.pixels[both], by_direction.pixels[both], atol=1e-6)


def test_sensor_is_camera_with_symmetry():
    assert isinstance(SPH, Camera)
    s = SPH.symmetry
    np.testing.assert_array_equal(s.axis, [0, 0, -1])
    angles = np.radians([0.0, 60.0, 135.0])
    np.testing.assert_allclose(
        s.radius_px(angles), om.evaluate(SPH, np.degrees(angles)).h_px, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Mount("left"), "camera_looks must be one of up, down, forward; got 'left'"),
        (lambda: Mount("up", float("inf")), "forward_azimuth_deg must be a finite number; got inf"),
        (lambda: Imager(0, 10, 5.0), "width_px must be between 1 and 100000 px; got 0"),
        (lambda: Imager(10, 10.5, 5.0), "height_px must be an integer number of pixels; got 10.5"),
        (
            lambda: Imager(10, 10, float("nan")),
            r"pixel_pitch_um must be between 0\.01 and 10000 um; got nan",
        ),
        (lambda: Imager(10, 10, 5.0, (1.0,)), "centre_px must be a pair .* got 1 numbers"),
    ],
)
def test_invalid_parts_rejected(make, message):
    with pytest.raises(InvalidParameter, match=message):
        make()


def test_sensors_with_cached_symmetry_can_be_pickled():
    sensor = om.load_sensor("paper-spherical")
    omega = np.linspace(sensor.symmetry.omega_min, sensor.symmetry.omega_max, 5)
    copy = pickle.loads(pickle.dumps(sensor))
    assert copy == sensor
    np.testing.assert_array_equal(copy.symmetry.radius_px(omega), sensor.symmetry.radius_px(omega))
    np.testing.assert_array_equal(copy.symmetry.origin_mm(omega), sensor.symmetry.origin_mm(omega))
