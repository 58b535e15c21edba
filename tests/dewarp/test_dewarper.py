"""Dewarper: separable against general maps, sampled positions, empty pixels, invalid arguments."""

import copy
import multiprocessing
import pickle
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp import _source_coordinates, sampling
from omnimirror.dewarp._source_coordinates import exact_pixels, is_separable, polar_map_of
from omnimirror.optics.sensor_files import bundled_sensors
from tests.everyday import few
from tests.samplers import remap_at

BALL = om.MirrorBall(
    centre_px=(511.0, 509.5), rim_radius_px=480.0, field_deg=270.0, image_size=(1024, 1020)
)
FISHEYE = om.OCam(
    polynomial=(-250.0, 0.0, 4e-4),
    centre_px=(320.0, 240.0),
    image_size=(640, 480),
    optics="fisheye",
)
CAMERAS = {
    **{name: om.load_sensor(name) for name in bundled_sensors()},
    "ball": BALL,
    "fisheye": FISHEYE,
}
MOUNTS = [Mount("up"), Mount("down", 17.0), Mount("up", -90.0, True), Mount("down", 200.0, True)]


@pytest.mark.parametrize("mount", few(MOUNTS, MOUNTS[3]), ids=str)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_separable_panorama_matches_general(camera, mount):
    camera = replace(camera, mount=mount)
    view = om.screens.Cylinder((200, 120), -90.0, 90.0, 13.0, 350.0)
    assert is_separable(camera, view)
    separable, general = polar_map_of(camera, view).pixels(), exact_pixels(camera, view)
    assert np.isfinite(general).any()
    np.testing.assert_array_equal(np.isnan(separable), np.isnan(general))
    np.testing.assert_allclose(separable, general, atol=1e-9, rtol=0)


@pytest.mark.parametrize("viewpoint", few(["exact", "single", 15.0], "exact"))
@pytest.mark.parametrize(
    "mount", few([Mount("up"), Mount("down", 200.0, True)], Mount("down", 200.0, True)), ids=str
)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_near_panorama_about_axis_is_separable(camera, mount, viewpoint):
    camera = replace(camera, mount=mount)
    for view in (
        om.screens.Cylinder((30, 60), -85.0, 80.0, 13.0, 350.0, distance_mm=300.0),
        om.screens.Equirectangular(
            (30, 60), pan_deg=70.0, distance_mm=250.0, offset_mm=(0.0, 0.0, -60.0)
        ),
    ):
        assert is_separable(camera, view)
        separable = polar_map_of(camera, view, viewpoint).pixels()
        general = exact_pixels(camera, view, viewpoint)
        assert np.isfinite(general).any()
        np.testing.assert_array_equal(np.isnan(separable), np.isnan(general))
        np.testing.assert_allclose(separable, general, atol=2e-5, rtol=0)


@pytest.mark.parametrize(
    "camera", [BALL, FISHEYE, replace(BALL, centre_px=(90.0, 500.0))], ids=["within", "cut", "off"]
)
def test_panorama_is_sampled_without_pixel_map(camera):
    """Equal to sampling at their coordinates up to one grey level, and with a map on request."""
    width, height = camera.image_size
    image = cv2.resize(
        np.random.default_rng(3).integers(0, 255, (40, 40, 3), np.uint8), (width, height)
    )
    dewarp = om.Dewarper(camera, om.screens.Cylinder((500, 300), -90.0, 60.0), "linear")
    dewarped = dewarp(image)
    assert "pixel_map" not in dewarp.__dict__
    expected = remap_at(image, dewarp.coordinates())
    mapped_dewarper = replace(dewarp, keep_map=True)
    for later in (dewarped, mapped_dewarper(image), mapped_dewarper(image)):
        differs = np.abs(later.astype(int) - expected).max(axis=-1) > 1
        assert differs.mean() < 1e-3  # at the image border float32 can decide differently
    assert "pixel_map" in mapped_dewarper.__dict__


def test_separability_requires_vertical_axis():
    cylinder = om.screens.Cylinder((200, 120), -90.0, 90.0)
    assert not is_separable(BALL, replace(cylinder, distance_mm=300.0, offset_mm=(0.0, 1.0, 0.0)))
    assert not is_separable(replace(BALL, mount=Mount("forward")), cylinder)
    assert not is_separable(BALL, om.screens.Plane((20, 10)))
    assert not is_separable(replace(FISHEYE, affine=(1.0, 0.001, 0.0)), cylinder)


def test_cropped_camera_is_separable():
    """If the centre is near a corner, only some pixels around it determine the handedness of the
    image."""
    camera = om.MirrorBall(
        centre_px=(3.0, 470.0), rim_radius_px=900.0, field_deg=200.0, image_size=(640, 480)
    )
    view = om.screens.Cylinder((300, 100), -90.0, 0.0)
    separable, general = polar_map_of(camera, view).pixels(), exact_pixels(camera, view)
    np.testing.assert_array_equal(np.isnan(separable), np.isnan(general))
    np.testing.assert_allclose(separable, general, atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    "view", [om.screens.Plane((90, 70), 30.0, -20.0), om.screens.DomeMaster((80, 80), 135.0)]
)
def test_coordinates_match_camera_projection(view, monkeypatch):
    monkeypatch.setattr(
        _source_coordinates, "STRIP_PX", 1000
    )  # several strips, the last one incomplete
    targets = view.targets(0, view.size[1])
    pixels = om.Dewarper(BALL, view).coordinates(exact=True)
    expected = BALL.project_directions(targets.reshape(-1, 3)).pixels.reshape(pixels.shape)
    np.testing.assert_array_equal(pixels, expected)


@dataclass(frozen=True)
class Wall:
    """Screen at a finite distance."""

    size = (12, 8)
    is_distant = False

    def targets_at(self, u, v):
        y, z = np.broadcast_arrays(500 - u * 1000 / 11, 200 - v * 600 / 7)
        return np.stack([np.full_like(y, 600.0), y, z], axis=-1)


def test_near_screen_uses_exact_reflection():
    sensor = om.load_sensor("paper-spherical")
    pixels = om.Dewarper(sensor, Wall()).coordinates()
    points = Wall().targets_at(np.arange(12.0), np.arange(8.0)[:, None]).reshape(-1, 3)
    np.testing.assert_allclose(
        pixels.reshape(-1, 2), sensor.project(points).pixels, atol=1e-4, rtol=0
    )
    assert np.abs(pixels.reshape(-1, 2) - sensor.project_directions(points).pixels).max() > 1


def test_sampling_uses_coordinates():
    """Sampling an image whose values are its coordinates returns these.

    OpenCV's cubic kernel (a = -0.75) bends a ramp by up to 0.047.
    """
    width, height = BALL.image_size
    v, u = np.mgrid[:height, :width].astype(np.float32)
    image = np.dstack([u, v, u + v])
    view = om.screens.Plane((160, 120), 20.0, -30.0, 5.0, 70.0)
    for interpolation, tolerance in (("linear", 0.02), ("cubic", 0.06), ("nearest", 0.51)):
        dewarp = om.Dewarper(BALL, view, interpolation)
        x, y = np.moveaxis(dewarp.coordinates(), -1, 0)
        dewarped = dewarp(image)
        assert dewarp.valid.all()
        np.testing.assert_allclose(dewarped[..., 0], x, atol=tolerance)
        np.testing.assert_allclose(dewarped[..., 1], y, atol=tolerance)
        np.testing.assert_allclose(dewarped[..., 2], x + y, atol=2 * tolerance)


@pytest.mark.parametrize(
    "view", [om.screens.Cylinder((60, 90), -90.0, 90.0), om.screens.Plane((60, 90))], ids=str
)
def test_out_is_filled(view):
    image = np.random.default_rng(5).integers(0, 255, (1020, 1024, 3), np.uint8)
    dewarp = om.Dewarper(BALL, view)
    dewarped = dewarp(image)
    rgba = np.empty((90, 60, 4), np.uint8)
    for out in (rgba[..., :3], np.empty((90, 60, 3), np.uint8)):
        assert dewarp(image, out=out) is out
        np.testing.assert_allclose(out, dewarped, atol=1)
    assert dewarp(image, transparent=True, out=rgba) is rgba
    with pytest.raises(
        InvalidParameter, match=r"out must be \(90, 60, 3\) of uint8; got \(90, 60\) of uint8"
    ):
        dewarp(image, out=np.empty((90, 60), np.uint8))


@pytest.mark.parametrize(
    "interpolation", few(["auto", "nearest", "linear", "cubic", "area"], "auto", "nearest")
)
@pytest.mark.parametrize("channels", [(), (1,), (3,), (4,)])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_image_type_is_preserved(dtype, channels, interpolation):
    full = {"uint8": 255, "uint16": 65535, "float32": 1.0}[dtype]
    image = np.full((1020, 1024, *channels), full, dtype)
    dewarp = om.Dewarper(BALL, om.screens.Cylinder((60, 90), -90.0, 90.0), interpolation)
    dewarped = dewarp(image)
    assert dewarped.dtype == image.dtype
    assert dewarped.shape == (90, 60, *channels)
    above = np.arange(90) < 22  # above 45 deg; row 22 is cut by the rim
    np.testing.assert_array_equal(dewarped[above], 0)
    np.testing.assert_allclose(dewarped[23:], full, rtol=1e-6)
    np.testing.assert_array_equal(dewarp.valid[:, 0], np.isfinite(dewarp.coordinates()[:, 0, 0]))
    clear = dewarp(image, transparent=True)
    assert clear.shape == (90, 60, 4)
    np.testing.assert_array_equal(clear[above], 0)
    np.testing.assert_allclose(clear[23:], full, rtol=1e-6)


def test_transparent_preserves_colours():
    image = np.zeros((1020, 1024, 3), np.uint8)
    image[:] = (10, 20, 30)
    view = om.screens.Plane((20, 10), tilt_deg=-30.0)
    np.testing.assert_array_equal(
        om.Dewarper(BALL, view)(image, transparent=True)[5, 5], [10, 20, 30, 255]
    )
    grey = np.full((1020, 1024), 77, np.uint8)
    np.testing.assert_array_equal(
        om.Dewarper(BALL, view)(grey, transparent=True)[5, 5], [77, 77, 77, 255]
    )


@pytest.mark.parametrize("interpolation", ["auto", "nearest", "linear", "cubic", "area"])
def test_image_edge_is_not_smeared(interpolation):
    """A fisheye field extends beyond the image: its white border remains white up to the end."""
    image = np.full((480, 640), 200, np.uint8)
    dewarp = om.Dewarper(
        replace(FISHEYE, mount=Mount("forward")),
        om.screens.Plane((400, 300), hfov_deg=150.0),
        interpolation,
    )
    dewarped = dewarp(image)
    u, v = np.moveaxis(dewarp.coordinates(), -1, 0)
    inside = (u >= -0.5) & (u <= 639.5) & (v >= -0.5) & (v <= 479.5)
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_array_equal(dewarped, np.where(inside, 200, 0))


def test_large_outputs_are_tiled(monkeypatch, uncompiled):
    view = om.screens.Cylinder((90, 70), -90.0, 90.0)
    image = np.random.default_rng(0).integers(0, 255, (1020, 1024, 3), np.uint8)
    whole = om.Dewarper(BALL, view)(image)
    uncompiled()
    monkeypatch.setattr(sampling, "MAX_SIDE_PX", 1025)
    long = om.Dewarper(BALL, om.screens.Cylinder((4000, 3), -50.0, 0.0))(image)
    monkeypatch.undo()
    uncompiled()
    np.testing.assert_array_equal(
        long, om.Dewarper(BALL, om.screens.Cylinder((4000, 3), -50.0, 0.0))(image)
    )
    assert whole.any()
    longest = om.Dewarper(BALL, om.screens.Cylinder((40_000, 2), -50.0, 0.0))(image)
    assert longest.shape == (2, 40_000, 3)
    assert longest[:, 33_000:].any(axis=-1).mean() > 0.9


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (
            np.zeros((510, 512, 3), np.uint8),
            "1024 x 1020 px of the camera; got 512 x 510 px; the aspect ratios are equal",
        ),
        (np.zeros((480, 640), np.uint8), "1024 x 1020 px of the camera; got 640 x 480 px$"),
        (np.zeros((1020, 1024), complex), "float64, bool; got complex128"),
        (
            np.zeros((1020, 1024, 2), np.uint8),
            r"1, 3 or 4 channels; got an array of shape \(1020, 1024, 2\)",
        ),
        (np.zeros(1020, np.uint8), r"got an array of shape \(1020,\)"),
    ],
)
def test_invalid_source_image_raises(image, message):
    with pytest.raises(InvalidParameter, match=message):
        om.Dewarper(BALL, om.screens.Plane((20, 10), tilt_deg=-30.0))(image)


def test_image_too_large_for_opencv_raises(uncompiled):
    uncompiled()
    camera = om.MirrorBall(
        centre_px=(20_000.0, 1.0), rim_radius_px=15_000.0, field_deg=200.0, image_size=(40_000, 3)
    )
    with pytest.raises(
        InvalidParameter, match=r"sides of the image must be at most .*; got 40000 x 3 px"
    ):
        om.Dewarper(camera, om.screens.Plane((21, 11), tilt_deg=-90.0))(
            np.zeros((3, 40_000), np.uint8)
        )


@pytest.mark.parametrize(
    ("view", "message"),
    [
        (
            om.screens.Cylinder((20, 10), 50.0, 80.0),
            r"panorama \(elevation 50 to 80 deg\)",
        ),
        (
            om.screens.Plane((20, 10), tilt_deg=80.0, hfov_deg=30.0),
            r"perspective view \(pan 0, tilt 80, hfov 30 deg\)",
        ),
        (om.screens.DomeMaster((20, 10), 30.0, "zenith"), r"dome \(0 to 30 deg from the zenith\)"),
    ],
)
def test_view_outside_field_raises(view, message):
    with pytest.raises(OutsideField, match="elevation -90 to 45 deg; got the " + message):
        om.Dewarper(BALL, view).coordinates()


# -- border value ---------------------------------------------------------------------------------

ALL_OF_IT = om.screens.Cylinder((60, 90), -90.0, 90.0)  # no pixel above 45 deg is visible


@pytest.mark.parametrize(
    "interpolation", few(["auto", "nearest", "linear", "cubic", "area"], "auto", "nearest")
)
@pytest.mark.parametrize(
    ("dtype", "channels", "border", "expected"),
    [
        ("uint8", (), 17, 17),
        ("uint8", (), (17,), 17),
        ("uint8", (1,), 255, [255]),
        ("uint8", (3,), 17, [17, 17, 17]),
        ("uint8", (3,), (1, 20, 255), [1, 20, 255]),
        ("uint16", (3,), (1, 20, 65535), [1, 20, 65535]),
        ("uint16", (4,), np.array([1, 2, 3, 65535]), [1, 2, 3, 65535]),
        ("float32", (3,), (-1.5, 0.25, 1e6), [-1.5, 0.25, 1e6]),
        ("float32", (), float("nan"), float("nan")),
    ],
)
def test_border_fills_outside(dtype, channels, border, expected, interpolation):
    image = np.full((1020, 1024, *channels), 100, dtype)
    for view in (
        ALL_OF_IT,
        om.screens.DomeMaster((90, 90), 170.0, "nadir"),
        om.screens.CubeMap((80, 60)),
    ):
        dewarp = om.Dewarper(BALL, view, interpolation, border=border)
        for _ in range(2):
            dewarped = dewarp(image)
            np.testing.assert_allclose(dewarped[dewarp.valid], 100, rtol=1e-6)
            outside = dewarped[~dewarp.valid]
            assert len(outside)
            np.testing.assert_array_equal(
                outside, np.broadcast_to(np.array(expected, dtype), outside.shape)
            )


def test_border_with_added_alpha_is_transparent():
    for image, border in (
        (np.full((1020, 1024, 3), 100, np.uint8), (1, 2, 3)),
        (np.full((1020, 1024), 100, np.uint8), 9),
    ):
        dewarped = om.Dewarper(BALL, ALL_OF_IT, border=border)(image, transparent=True)
        colour = border if isinstance(border, tuple) else (border,) * 3
        np.testing.assert_array_equal(dewarped[0, 0], [*colour, 0])
        np.testing.assert_array_equal(dewarped[-5, 0], [100, 100, 100, 255])


@pytest.mark.parametrize(
    ("dtype", "channels", "border", "message"),
    [
        (
            "uint8",
            (3,),
            256,
            "border must contain integers from 0 to 255 for uint8 images; got 256",
        ),
        ("uint8", (3,), -1, "border must contain integers .*; got -1"),
        ("uint16", (3,), 0.5, "for uint16 images; got 0.5"),
        ("uint8", (3,), (1, 2), r"each of the 3 channels of the image; got \(1, 2\)"),
        ("uint8", (), (1, 2, 3), r"each of the 1 channels of the image; got \(1, 2, 3\)"),
    ],
)
def test_border_mismatch_raises(dtype, channels, border, message):
    with pytest.raises(InvalidParameter, match=message):
        om.Dewarper(BALL, ALL_OF_IT, border=border)(np.zeros((1020, 1024, *channels), dtype))


@pytest.mark.parametrize("border", ["red", (1, "x"), None, [[1, 2, 3]]])
def test_invalid_border_raises(border):
    with pytest.raises(
        InvalidParameter, match="border must be one number or one number per channel"
    ):
        om.Dewarper(BALL, ALL_OF_IT, border=border)


def test_unknown_interpolation_raises():
    with pytest.raises(
        InvalidParameter, match="must be one of auto, nearest, linear, cubic, area; got 'lanczos'"
    ):
        om.Dewarper(BALL, om.screens.Plane((20, 10)), "lanczos")


# -- copies ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "duplicate_of", [copy.copy, copy.deepcopy, lambda d: pickle.loads(pickle.dumps(d))]
)
@pytest.mark.parametrize(
    "camera", [om.load_sensor("paper-spherical"), BALL], ids=["sensor", "ball"]
)
def test_used_dewarper_can_be_copied_and_pickled(camera, duplicate_of):
    width, height = camera.image_size
    image = np.random.default_rng(7).integers(0, 256, (height, width, 3), np.uint8)
    for view in (om.screens.Cylinder((60, 20), -60.0, -10.0), om.screens.CubeMap((48, 36))):
        dewarp = om.Dewarper(camera, view, "area", border=(1, 2, 3), keep_map=True)
        dewarped = dewarp(image)
        duplicate = duplicate_of(dewarp)
        assert duplicate == dewarp
        np.testing.assert_array_equal(duplicate(image), dewarped)


@pytest.mark.full
def test_dewarper_in_spawned_processes():
    dewarp = om.Dewarper(
        om.load_sensor("paper-spherical"), om.screens.Cylinder((60, 20), -60.0, -10.0)
    )
    image = np.random.default_rng(8).integers(0, 256, (1024, 1024, 3), np.uint8)
    dewarped = dewarp(image)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        np.testing.assert_array_equal(pool.map(dewarp, [image])[0], dewarped)
