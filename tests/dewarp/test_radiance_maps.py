"""Light probes: images of a mirror ball in an analytic environment by exact reflection."""

from dataclasses import replace

import cv2
import numpy as np
import OpenEXR
import pytest

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp import radiance_maps

SIZE, RADIUS, SUB = 600, 280.0, 4
LAMP = np.array([0.36, 0.48, 0.8])  # ahead, left, up
LAMP_PEAK, LAMP_SHARPNESS = np.array([60.0, 50.0, 30.0]), 60.0


def radiance(directions):
    """Return the analytic radiance: a gradient from floor to sky, a coloured side, and a lamp."""
    x, y, z = np.moveaxis(directions, -1, 0)
    ambient = np.stack([0.5 + 0.2 * z, 0.5 + 0.3 * y, 0.5 + 0.4 * z + 0.05 * x], axis=-1)
    lamp = np.exp(LAMP_SHARPNESS * (directions @ LAMP - 1))
    return ambient + LAMP_PEAK * lamp[..., None]


def mean_radiance():
    """Return the exact mean over the sphere: odd terms vanish, the lamp has a closed form."""
    share = (1 - np.exp(-2 * LAMP_SHARPNESS)) / (2 * LAMP_SHARPNESS)
    return 0.5 + LAMP_PEAK * share


def photograph():
    """Render the ball seen from far behind it, along +x, by reflection at its exact normals."""
    steps = (np.arange(SIZE * SUB) + 0.5) / SUB - 0.5 - (SIZE - 1) / 2
    right, down = np.meshgrid(steps / RADIUS, steps / RADIUS)
    rho = np.hypot(right, down)
    normals = np.stack([-np.sqrt(np.maximum(1 - rho**2, 0)), -right, -down], axis=-1)
    reflected = np.array([1.0, 0, 0]) - 2 * normals[..., :1] * normals
    light = np.where((rho < 1)[..., None], radiance(reflected), 7.0)  # bright background
    return cv2.resize(light.astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_AREA)


def map_directions(height, width):
    pan = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    up = np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    pan, up = np.meshgrid(pan, up)
    return np.stack([np.cos(up) * np.cos(pan), -np.cos(up) * np.sin(pan), np.sin(up)], axis=-1)


def solid_angle_mean(image):
    height = len(image)
    weights = np.sin((np.arange(height) + 0.5) / height * np.pi)
    return np.average(image.mean(axis=1), axis=0, weights=weights)


@pytest.fixture(scope="module")
def image():
    return photograph()


@pytest.fixture(scope="module")
def ball():
    centre = ((SIZE - 1) / 2, (SIZE - 1) / 2)
    return om.MirrorBall(
        centre_px=centre,
        rim_radius_px=RADIUS,
        field_deg=360.0,
        image_size=(SIZE, SIZE),
        mount=Mount("forward"),
    )


@pytest.fixture(scope="module")
def probe(image, ball):
    return om.light_probe(image, ball, width_px=360)


def test_radiance_by_direction(probe):
    directions = map_directions(*probe.visible.shape)
    away = np.degrees(np.arccos(directions[..., 0].clip(-1, 1)))  # from the blind direction
    error = abs(probe.radiance / radiance(directions) - 1)[away > 10]
    assert probe.visible[away > 10].all()
    assert error.max() < 0.02
    assert np.median(error) < 1e-4
    assert probe.radiance.max() == pytest.approx(LAMP_PEAK[0] + 0.66, rel=0.02)


def test_energy(probe):
    np.testing.assert_allclose(solid_angle_mean(probe.radiance), mean_radiance(), rtol=1e-3)


@pytest.mark.parametrize("width_px", [8, 64, 256])
@pytest.mark.parametrize(
    "lamp_px",
    [
        (300, 300),
        (420, 230),
        (520, 260),
        (300, 102),  # 0.1 deg from the zenith, at the radius R sin 45 deg
        (300, 497),
    ],
)
def test_energy_of_a_lamp_of_one_pixel(ball, lamp_px, width_px):
    light = np.zeros((SIZE, SIZE, 3), np.float32)
    light[lamp_px[1], lamp_px[0]] = 1e4
    probe = om.light_probe(light, ball, width_px=width_px)
    # The ball is equal-area: pi R^2 pixels are 4 pi sr.
    expected = 1e4 / (np.pi * RADIUS**2)
    assert (probe.radiance >= 0).all()
    np.testing.assert_allclose(solid_angle_mean(probe.radiance), expected, rtol=0.05)


def test_blind_cone_is_filled_from_its_edge(probe):
    directions = map_directions(*probe.visible.shape)
    hidden = ~probe.visible
    assert 0.001 < hidden.mean() < 0.02
    assert directions[hidden][:, 0].min() > np.cos(np.radians(10))  # behind the ball: ahead
    # The exact radiance varies little within the cone; the background has 7.
    truth = radiance(directions[hidden])
    assert abs(probe.radiance[hidden] / truth - 1).max() < 0.04


def test_filled_pole_has_one_value(image, ball):
    upright = replace(ball, mount=Mount("up"), field_deg=300.0)
    probe = om.light_probe(image, upright, width_px=256)
    top = probe.radiance[0]
    assert not probe.visible[0].any()
    assert np.ptp(top, axis=0).max() < 0.02 * top.mean()
    edge = probe.radiance[np.flatnonzero(probe.visible.all(axis=1))[0]]
    assert (edge.min(axis=0) <= top[0]).all()
    assert (top[0] <= edge.max(axis=0)).all()


def test_visible_fraction_of_a_known_field(ball, image):
    # The projection is equal-area; pixels up to 2.5 px from the rim may be excluded.
    probe = om.light_probe(image, replace(ball, field_deg=300.0), width_px=512)
    full = np.sin(np.radians(75)) ** 2
    assert full * (1 - 2.5 / RADIUS) ** 2 < probe.visible_fraction <= full


def test_integers_are_linearised(image, ball, probe):
    scale = np.float32(0.01)
    sixteen = np.rint(65535 * srgb_from_linear(image * scale)).astype(np.uint16)
    deep = om.light_probe(sixteen, ball, width_px=360)
    np.testing.assert_allclose(deep.radiance / scale, probe.radiance, rtol=0.02, atol=0.02)
    eight = om.light_probe((sixteen / 257).round().astype(np.uint8), ball, width_px=360)
    assert solid_angle_mean(eight.radiance) / scale == pytest.approx(mean_radiance(), rel=0.03)


def test_reflectance_by_colour(image, ball, probe):
    brighter = om.light_probe(image, ball, width_px=360, reflectance=(0.5, 0.8, 1.0))
    np.testing.assert_allclose(
        brighter.radiance, probe.radiance / np.float32([0.5, 0.8, 1.0]), rtol=1e-5
    )
    same = om.light_probe(image, ball, width_px=360, reflectance=np.array([0.5, 0.8, 1.0]))
    np.testing.assert_array_equal(same.radiance, brighter.radiance)


def test_pan_rotates_the_map(image, ball, probe):
    turned = om.light_probe(image, ball, width_px=360, pan_deg=90.0)
    seen = turned.visible & np.roll(probe.visible, -90, axis=1)
    rotated = np.roll(probe.radiance, -90, axis=1)
    np.testing.assert_allclose(turned.radiance[seen], rotated[seen], rtol=2e-3)


def test_sensor_with_a_mirror():
    """The package's ray-traced image of an environment yields this environment in the field."""
    sensor = om.load_sensor("paper-spherical")
    truth = radiance(map_directions(256, 512)).astype(np.float32)
    light = om.expose(sensor, om.Environment(truth), samples=4)
    probe = om.light_probe(light, sensor, width_px=512)
    directions = map_directions(*probe.visible.shape)
    inside = (directions[..., 2] < np.sin(np.radians(40))) & (
        directions[..., 2] > np.sin(np.radians(-80))
    )
    assert probe.visible[inside].all()
    assert abs(probe.radiance / truth - 1)[inside].max() < 0.03


@pytest.mark.parametrize("suffix", [".hdr", ".exr"])
def test_files_in_other_programs(probe, suffix, tmp_path):
    path = tmp_path / f"probe{suffix}"
    om.write_image(path, probe.radiance)
    if suffix == ".hdr":
        read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
        tolerance = 2**-7  # of the largest channel: shared exponent, 8 bits
    else:
        with OpenEXR.File(str(path)) as file:
            read = file.channels()["RGB"].pixels.copy()
        tolerance = 0.0
    error = abs(read - probe.radiance).max(axis=-1)
    assert (error <= tolerance * probe.radiance.max(axis=-1)).all()


def test_merged_exposures_recover_the_radiance():
    rng = np.random.default_rng(3)
    levels = np.exp(rng.uniform(np.log(0.01), np.log(300), (64, 64, 1)))
    truth = (levels * rng.uniform(0.5, 1, (64, 64, 3))).astype(np.float32)
    times = [1 / 8, 1 / 60, 1 / 500, 1 / 4000]
    images = [
        np.rint(255 * srgb_from_linear(truth * time / times[0])).astype(np.uint8) for time in times
    ]
    merged = om.merge_exposures(images, times)
    assert abs(merged / truth - 1)[truth.min(axis=-1) > 0.05].max() < 0.04
    # Beyond the shortest exposure, the values are those of its white.
    white = np.full((1, 1, 3), 255, np.uint8)
    np.testing.assert_allclose(om.merge_exposures([white, white], [1.0, 0.25]), 4.0, rtol=1e-6)
    np.testing.assert_allclose(om.merge_exposures([white, white], [0.25, 1.0]), 1.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width_px": 255}, "width_px must be even; got 255"),
        ({"width_px": 16386}, "width_px must be an integer between 8 and 16384; got 16386"),
        ({"reflectance": 0.0}, "reflectance must be"),
        ({"reflectance": 1e-40}, "reflectance must be between 0.001 and 1; got 1e-40"),
        ({"reflectance": [0.9, 0.9]}, r"tuple of 3 values .*; got \[0.9, 0.9\]"),
        ({"reflectance": (0.9, 0.9, 1.5)}, "reflectance must be"),
    ],
)
def test_invalid_arguments(image, ball, change, message):
    with pytest.raises(InvalidParameter, match=message):
        om.light_probe(image, ball, **change)


def test_invalid_images(image, ball):
    with pytest.raises(InvalidParameter, match="image"):
        om.light_probe(image[1:], ball)
    broken = image.copy()
    broken[SIZE // 2, SIZE // 2] = np.nan
    with pytest.raises(InvalidParameter, match=r"finite values .* on the mirror; got nan"):
        om.light_probe(broken, ball)
    with pytest.raises(InvalidParameter, match=r"finite values .* on the mirror; got inf"):
        om.light_probe(np.full(image.shape, 1e300), ball)  # beyond the range of float32
    broken = image.copy()
    broken[0, 0] = np.nan  # outside the ball
    assert np.isfinite(om.light_probe(broken, ball, width_px=64).radiance).all()
    with pytest.raises(InvalidParameter, match="one time per image"):
        om.merge_exposures([np.zeros((4, 4, 3), np.uint8)], [1.0, 2.0])
    with pytest.raises(InvalidParameter, match="got int16"):
        om.light_probe(np.zeros(image.shape, np.int16), ball)
    with pytest.raises(InvalidParameter, match="uint8 or uint16"):
        om.merge_exposures([image], [1.0])
    with pytest.raises(InvalidParameter, match="1, 3 or 4 channels"):
        om.merge_exposures([np.zeros((4, 4, 2), np.uint8)], [1.0])
    with pytest.raises(InvalidParameter, match="at least one pixel"):
        om.merge_exposures([np.zeros((0, 4, 3), np.uint8)], [1.0])


def test_masked_integers_are_linearised():
    """Masks of pixels do not change their values."""
    masked = np.ma.masked_equal(np.full((2, 2, 3), 255, np.uint8), 255)
    np.testing.assert_array_equal(om.merge_exposures([masked], [1.0]), 1.0)


def test_a_probe_without_visible_pixels_is_rejected(image, ball):
    """Instead of a black map."""
    for change, width_px in [({"rim_radius_px": 0.3}, None), ({"field_deg": 10.0}, 8)]:
        with pytest.raises(OutsideField, match="at least one pixel of the map"):
            om.light_probe(image, replace(ball, **change), width_px=width_px)


def test_pixels_without_a_ray_have_no_light():
    """Bright pixels beside the image circle of a camera without symmetry."""
    fisheye = om.ThinPrismFisheye(
        focal_px=(100.0, 100.0), centre_px=(319.5, 239.5), image_size=(640, 480), s3=0.1
    )
    rows, columns = np.mgrid[:480, :640]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    outside = ~fisheye.backproject(pixels).valid.reshape(480, 640)
    assert 0 < outside.mean() < 0.5
    light = np.where(outside[..., None], np.float32(50), np.float32([[[1, 1, 1]]]))
    probe = om.light_probe(light, fisheye, width_px=256)
    np.testing.assert_allclose(probe.radiance, 1.0, rtol=0.01)


def test_default_width_is_limited(image, ball, monkeypatch):
    """Narrow fields have many pixels per degree, and a full sphere at this resolution is large."""
    monkeypatch.setattr(radiance_maps, "MAX_DEFAULT_WIDTH_PX", 64)
    assert om.light_probe(image, ball).visible.shape == (32, 64)
    assert om.light_probe(image, ball, width_px=66).visible.shape == (33, 66)
