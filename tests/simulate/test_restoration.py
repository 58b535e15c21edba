"""Restoration: its blur against real rays, and its pictures against the scene without blur."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from benchmarks.restoration import clouds, dead_leaves, faster, gains

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.mirrors.pose import MirrorPose
from omnimirror.simulate.restoration import Restorer

TARGETS = {"paper-spherical": (2.5, 3.0), "paper-equidistant": (2.5, 3.5), "paper-hyperboloidal": (3.0, 4.0)}
"""Gains in dB over the inner two thirds of the radius, and over the outer third."""


@dataclass(frozen=True)
class Around:
    """An environment painted on a sphere about the mirror's vertex."""

    environment: om.Environment
    radius_mm: float

    def radiance(self, origins_mm, directions):
        return self.environment.radiance(
            origins_mm, self.distance_mm(origins_mm, directions)[:, None] * _units(directions) + origins_mm
        )

    def distance_mm(self, origins_mm, directions):
        d = _units(directions)
        along = (d * origins_mm).sum(axis=1)
        return -along + np.sqrt(along**2 + self.radius_mm**2 - (np.asarray(origins_mm) ** 2).sum(axis=1))


def _units(directions):
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def scene() -> om.Environment:
    return dead_leaves(1024, 900, smallest_deg=2.1)


@pytest.fixture(scope="module")
def small() -> Restorer:
    """A quarter of the pixels along a side and four times the aperture: the same blur in pixels."""
    return Restorer(faster(om.load_sensor("paper-spherical"), 256, 1.0))


def test_the_matrix_blurs_as_real_rays_do(small: Restorer, scene: om.Environment):
    sensor, blur = small.sensor, small.blur
    fine = om.expose(faster(sensor, 256 * blur.fineness, sensor.lens.f_number), scene, 16)
    traced = om.expose(sensor, scene, 1024, blur=True).reshape(-1, 3)[blur.pixels]
    sharp = om.expose(sensor, scene, 64).reshape(-1, 3)[blur.pixels]
    outer = small.radius.ravel()[blur.pixels] > 90
    error = (blur.matrix() @ fine.reshape(-1, 3) - traced)[outer]
    assert np.sqrt((error**2).mean()) < 0.25 * np.sqrt(((sharp - traced)[outer] ** 2).mean())


def test_a_scene_never_tuned_on_gains(small: Restorer, scene: om.Environment):
    found = gains(small, scene)
    rest, outer = TARGETS["paper-spherical"]
    assert found.gain_db[0] > rest
    assert found.gain_db[1] > outer
    assert found.tenths_db.min() > -0.2


@pytest.mark.full
@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("kind", ["dead leaves", "hall"])
def test_sensors_of_the_paper_gain_what_was_promised(name: str, kind: str):
    """On two kinds of scene that nothing was tuned on."""
    found = gains(Restorer(om.load_sensor(name)), dead_leaves() if kind == "dead leaves" else om.simulate.Hall())
    assert found.gain_db[0] > TARGETS[name][0]
    assert found.gain_db[1] > TARGETS[name][1]
    assert found.tenths_db.min() > -0.2


def test_a_scene_full_of_texture_loses_nothing(small: Restorer):
    """Clouds, whose finest detail drowns in the noise, leave little to gain."""
    found = gains(small, clouds(1024))
    assert found.gain_db[0] > -0.1
    assert found.gain_db[1] > 0.5


def test_near_things_are_blurred_otherwise(scene: om.Environment):
    """A wall all around at 300 mm: its own blur restores more than that of distant things."""
    sensor = faster(om.load_sensor("paper-hyperboloidal"), 256, 1.0)
    near = Around(scene, 300.0)
    right, wrong = (gains(Restorer(sensor, distance), near).gain_db for distance in (300.0, np.inf))
    assert right[0] > wrong[0] + 0.1
    assert right[1] > wrong[1] + 2
    assert right.min() > 2.5


@pytest.mark.parametrize("level", [0.15, 0.5, 0.85])
def test_noise_is_not_amplified(small: Restorer, level: float):
    rng = np.random.default_rng(5)
    noisy = np.rint(255 * np.clip(level + 0.01 * rng.standard_normal((256, 256)), 0, 1)).astype(np.uint8)
    restored = small(noisy, 0.01)
    where = small.share > 0.9
    assert restored[where].std() < 0.5 * noisy[where].std()
    assert restored[where].mean() == pytest.approx(noisy[where].mean(), abs=0.5)


def test_edges_do_not_ring(small: Restorer):
    """Black and white quarters of the sky: what is restored leaves their range by little."""
    columns = (np.arange(720) // 45) % 2
    light = np.broadcast_to(np.where(columns, 0.6, 0.1)[None, :, None], (360, 720, 3)).astype(np.float32)
    blurred = om.take_picture(small.sensor, om.Environment(np.ascontiguousarray(light)), 256, blur=True)
    sharp = om.take_picture(small.sensor, om.Environment(np.ascontiguousarray(light)), 16)
    restored = small(blurred, 0.01).astype(float)
    where = (small.share > 0.9) & (small.radius > 40)
    low, high = np.percentile(sharp[where], [1, 99])
    assert restored[where].max() < high + 0.03 * 255
    assert restored[where].min() > low - 0.03 * 255


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noise_is_estimated_from_the_picture(small: Restorer, scene: om.Environment, noise: float):
    picture = om.take_picture(small.sensor, scene, 64, blur=True)
    noisy = picture + 255 * noise * np.random.default_rng(2).standard_normal(picture.shape)
    assert small.estimate_noise(np.clip(noisy, 0, 255).astype(np.uint8)) == pytest.approx(noise, rel=0.35)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
def test_kinds_of_pictures_agree(small: Restorer, scene: om.Environment, kind: str):
    light = om.expose(small.sensor, scene, 32, blur=True)
    of_kind = {
        "uint8": lambda: om.take_picture(small.sensor, scene, 32, blur=True),
        "uint16": lambda: om.take_picture(small.sensor, scene, 32, blur=True) * np.uint16(257),
        "float32": lambda: light,
    }[kind]()
    restored = small(of_kind, 0.01)
    assert restored.dtype == of_kind.dtype
    assert restored.shape == of_kind.shape
    from omnimirror.simulate.colour import srgb_from_linear

    full = {"uint8": 255, "uint16": 65535}.get(kind)
    values = srgb_from_linear(restored) if full is None else restored / full
    reference = small(om.take_picture(small.sensor, scene, 32, blur=True), 0.01) / 255
    assert np.sqrt(((values - reference) ** 2).mean()) < 0.006


def test_alpha_and_what_is_outside_stay(small: Restorer):
    picture = np.random.default_rng(0).integers(0, 255, (256, 256, 4), dtype=np.uint8)
    restored = small(picture, 0.05)
    np.testing.assert_array_equal(restored[..., 3], picture[..., 3])
    outside = small.share == 0
    np.testing.assert_array_equal(restored[outside], picture[outside])
    assert (restored[~outside] != picture[~outside]).any()


def test_a_flipped_picture_is_restored_flipped(small: Restorer, scene: om.Environment):
    """Off the middle, too, where flipping moves the optical axis; neighbours count to one side, so not to the byte."""
    sensor = replace(small.sensor, imager=replace(small.sensor.imager, centre_px=(110.0, 128.0)))
    picture = om.take_picture(sensor, scene, 32, blur=True)
    flipped = replace(sensor, mount=replace(sensor.mount, image_flipped=True))
    restored = om.restore(sensor, picture, 0.01).astype(float)
    other = om.restore(flipped, np.ascontiguousarray(picture[:, ::-1]), 0.01)[:, ::-1]
    assert np.sqrt(((other - restored) ** 2).mean()) < 0.3 * np.sqrt(((picture - restored) ** 2).mean())


def test_what_cannot_be_restored_is_refused(small: Restorer):
    with pytest.raises(InvalidParameter, match="20 x 10 px"):
        small(np.zeros((10, 20), np.uint8))
    with pytest.raises(InvalidParameter, match="int32"):
        small(np.zeros((256, 256), np.int32))
    with pytest.raises(InvalidParameter, match="noise = 3 is outside"):
        small(np.zeros((256, 256), np.uint8), 3)
    tilted = replace(small.sensor, mirror_pose=MirrorPose(tilt_x_deg=0.5))
    with pytest.raises(InvalidParameter, match="decentred or tilted"):
        om.restore(tilted, np.zeros((256, 256), np.uint8))
