"""Rendered images: positions of objects against Sensor.project, which shares no code with the
renderer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.colour import srgb_bytes
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import pan_tilt_direction
from omnimirror.simulation.rendering import (
    _low_pass_filtered,
    _with_half_pixel_pitch,
    expose,
    render_pinhole_image,
)

ORANGE = np.array([1.0, 0.4, 0.0], dtype=np.float32)


def sensor_looking(
    camera_looks: str, name: str = "paper-spherical", flipped: bool = False
) -> om.Sensor:
    sensor = om.load_sensor(name)
    return replace(
        sensor, mount=replace(sensor.mount, camera_looks=camera_looks, image_flipped=flipped)
    )


def small(sensor: om.Sensor, factor: int) -> om.Sensor:
    """Return the same sensor with fewer, larger pixels."""
    size = sensor.imager.width_px // factor
    pitch = sensor.imager.pixel_pitch_um * factor
    return replace(
        sensor, imager=replace(sensor.imager, width_px=size, height_px=size, pixel_pitch_um=pitch)
    )


@dataclass(frozen=True)
class Even:
    """Scene of one colour."""

    def radiance(self, origins_mm: np.ndarray, directions: np.ndarray) -> np.ndarray:
        return np.tile(ORANGE, (len(directions), 1))


@dataclass(frozen=True)
class Ball:
    """White ball at a finite distance in a black world."""

    centre_mm: tuple[float, float, float]
    radius_mm: float

    def radiance(self, origins_mm: np.ndarray, directions: np.ndarray) -> np.ndarray:
        d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        towards = self.centre_mm - origins_mm
        along = (towards * d).sum(axis=1)
        hit = (along > 0) & ((towards**2).sum(axis=1) - along**2 < self.radius_mm**2)
        return np.repeat(hit.astype(np.float32)[:, None], 3, axis=1)


@pytest.mark.parametrize("camera_looks", ["up", "down", "forward"])
@pytest.mark.parametrize("flipped", [False, True])
def test_rendered_ball_matches_projection(camera_looks: str, flipped: bool):
    sensor = sensor_looking(camera_looks, flipped=flipped)
    centre = (150.0, 400.0, 90.0)
    image = om.render_image(sensor, Ball(centre, 20.0), samples=1)
    rows, columns = np.nonzero(image[..., 0])
    expected = sensor.project([centre]).pixels[0]
    assert len(rows) > 50
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.4)


def test_rendered_distant_scene_matches_projection():
    sensor, centre = sensor_looking("up"), (150.0, 70.0, 30.0)  # close enough for parallax
    image = om.render_image(sensor, Ball(centre, 9.0), samples=1, distant=True)
    rows, columns = np.nonzero(image[..., 0])
    centroid = [columns.mean(), rows.mean()]
    np.testing.assert_allclose(centroid, sensor.project_directions([centre]).pixels[0], atol=0.4)
    assert np.linalg.norm(centroid - sensor.project([centre]).pixels[0]) > 5


@pytest.mark.parametrize("camera_looks", ["up", "down"])
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_rendered_sign_matches_projection(camera_looks: str, name: str):
    """The (dark) ink is inside the outline of the projected corners, and the wall around it is
    bright."""
    import cv2

    sensor, room = sensor_looking(camera_looks, name), om.Room(texel_mm=10.0)
    image = om.render_image(sensor, room, samples=1).astype(float).mean(axis=2)
    top_left, top_right, bottom_right, bottom_left = room.sign_corners_mm("OMNIMIRROR")
    share = np.linspace(0, 1, 60)[:, None]

    def outline(factor: float) -> np.ndarray:
        corners = np.array([top_left, top_right, bottom_right, bottom_left])
        middle = corners.mean(axis=0)
        a, b, c, d = middle + (corners - middle) * (1, factor, factor + 0.4 * (factor > 1))
        edges = np.concatenate(
            [a + share * (b - a), b + share * (c - b), c + share * (d - c), d + share * (a - d)]
        )
        projection = sensor.project(edges)
        assert projection.valid.all()
        mask = np.zeros(image.shape, dtype=np.uint8)
        cv2.fillPoly(mask, [np.rint(projection.pixels).astype(np.int32)], 1)
        return mask.astype(bool)

    inside, around = outline(1.0), outline(1.06) & ~outline(1.02)
    dark = image < 100
    assert 0.3 < dark[inside].mean() < 0.7, "letters cover about half of it"
    assert dark[around].mean() < 0.01


def test_image_handedness():
    """Left of the centre is west in the flipped image of an upward camera; see section 1a."""
    room = om.Room(texel_mm=10.0)
    raw = om.render_image(small(sensor_looking("up"), 4), room, samples=1)
    flipped = om.render_image(small(sensor_looking("up", flipped=True), 4), room, samples=1)
    np.testing.assert_array_equal(raw[:, ::-1], flipped)


def test_image_outside_rim_is_black():
    sensor = sensor_looking("up")
    image = om.render_image(sensor, Even(), samples=4)
    v, u = np.indices(image.shape[:2])
    radius = np.hypot(u - 511.5, v - 511.5)
    assert not image[radius > sensor.rim_radius_px + 0.75].any()
    assert (image[radius < sensor.rim_radius_px - 0.75] == srgb_bytes(ORANGE)).all(), "RGB order"


def test_rim_is_antialiased():
    sensor = small(sensor_looking("up"), 16)
    image = om.render_image(sensor, Even(), samples=256)
    red = np.where(
        image[..., 0] <= 10,
        image[..., 0] / 255 / 12.92,
        ((image[..., 0] / 255 + 0.055) / 1.055) ** 2.4,
    )
    assert red.sum() == pytest.approx(np.pi * sensor.rim_radius_px**2, rel=2e-3)


def test_rendering_is_reproducible():
    sensor, room = small(sensor_looking("down"), 4), om.Room(texel_mm=10.0)
    first = om.render_image(sensor, room, workers=1)
    np.testing.assert_array_equal(first, om.render_image(sensor, room, workers=3))
    np.testing.assert_array_equal(first, om.render_image(sensor, om.Room(texel_mm=10.0)))


def test_samples_are_averaged_in_linear_light():
    """Two by two samples of a pixel equal four pixels of half the size."""
    room, coarse, fine = (
        om.Room(texel_mm=10.0),
        small(sensor_looking("up"), 8),
        small(sensor_looking("up"), 4),
    )
    image = om.render_image(fine, room, samples=1) / 255.0
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    expected = srgb_bytes(linear.reshape(128, 2, 128, 2, 3).mean(axis=(1, 3)))
    answer = om.render_image(coarse, room, samples=4)
    different = np.abs(answer.astype(int) - expected).max(axis=2) > 2
    assert different.mean() < 0.01, "but for the lamps, which saturate once and not four times"


def test_on_progress_counts_rows():
    sensor, updates = small(sensor_looking("up"), 4), []
    om.render_image(
        sensor, Even(), samples=16, on_progress=lambda done, total: updates.append((done, total))
    )
    assert updates == sorted(updates)
    assert len(updates) > 1
    assert updates[-1] == (256, 256)


def test_pinhole_image_averaging_and_nan():
    pan, tilt = np.meshgrid(
        np.radians(np.arange(-20, 20, 0.5)), np.radians(np.arange(10, -10, -0.5))
    )
    directions = pan_tilt_direction(pan, tilt)
    directions[:2, :2] = np.nan
    image = render_pinhole_image(Even(), directions, samples=2)
    assert image.shape == (20, 40, 3)
    assert not image[0, 0].any()
    assert (image[1:] == srgb_bytes(ORANGE)).all()


def test_invalid_value_raises():
    with pytest.raises(InvalidParameter, match=r"^samples "):
        om.render_image(sensor_looking("up"), Even(), samples=0)
    with pytest.raises(InvalidParameter, match=r"samples = 2; got \(4, 5, 3\)"):
        render_pinhole_image(Even(), np.ones((4, 5, 3)), samples=2)


@pytest.mark.parametrize(
    ("name", "scene", "options"),
    [
        ("paper-spherical", om.Room(texel_mm=40.0), {}),
        ("paper-spherical", om.Room(texel_mm=40.0), {"blur": True}),
        (
            "paper-spherical",
            om.Environment(np.random.default_rng(1).random((64, 128, 3), np.float32)),
            {"samples": 3},
        ),
        ("folded-hyperboloidal", om.Room(texel_mm=40.0), {"samples": 1}),
        (
            "paper-spherical",
            om.Room(texel_mm=40.0),
            {"radiometry": om.Radiometry(reflectivity=(0.9, 0.7, 0.4))},
        ),
    ],
    ids=["walls", "blurred", "environment", "two mirrors", "coloured"],
)
def test_image_is_encoded_light(name, scene, options):
    """It is read in parts, and the complete light is never assembled."""
    sensor = small(om.load_sensor(name), 8)
    light = expose(sensor, scene, **options)
    assert light.max() > 0.1
    assert (om.render_image(sensor, scene, **options) == srgb_bytes(light)).all()


def test_low_pass_filter_kernel():
    """A small ball: equal light and position, variance larger by 3/16 + 1/48 - 1/12 = 1/8 px^2."""
    sensor, scene = small(sensor_looking("up"), 8), Ball((900.0, 400.0, 90.0), 60.0)
    box = expose(sensor, scene, samples=64)[..., 1].astype(float)
    tent = _low_pass_filtered(expose(_with_half_pixel_pitch(sensor), scene, samples=16))[
        ..., 1
    ].astype(float)
    assert tent.sum() == pytest.approx(box.sum(), rel=1e-6)
    np.testing.assert_array_equal(
        om.render_image(sensor, scene, samples=64, low_pass=True)[..., 1],
        srgb_bytes(tent.astype(np.float32)),
    )
    v, u = np.indices(box.shape)
    for at in (u, v):
        (mean_a, mean_b), (a, b) = zip(*(moments(light, at) for light in (box, tent)), strict=True)
        assert mean_a == pytest.approx(mean_b, abs=0.02)
        assert b - a == pytest.approx(1 / 8, abs=0.02)
    even = om.render_image(sensor, Even(), samples=16, low_pass=True)
    np.testing.assert_array_equal(
        even[40:80, 40:80], om.render_image(sensor, Even(), samples=16)[40:80, 40:80]
    )
    with pytest.raises(
        InvalidParameter, match="low_pass must be False unless the camera is a sensor"
    ):
        om.render_image(
            om.MirrorBall(
                centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=280.0, image_size=(64, 64)
            ),
            Even(),
            low_pass=True,
        )


def moments(light: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """Return mean and variance of a coordinate, weighted by light."""
    mean = (light * at).sum() / light.sum()
    return float(mean), float((light * (at - mean) ** 2).sum() / light.sum())
