"""Restoration: blur against real rays, and restored images against the scene without blur."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from restoration_gain import (
    clouds,
    dead_leaves,
    gains,
    jpeg_round_trip,
    load_environment,
    with_fewer_pixels,
)

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.restoration.deblurring import Restorer
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.street import Street
from tests.everyday import few

TARGETS = {
    "paper-spherical": (2.5, 3.0),
    "paper-equidistant": (2.5, 3.5),
    "paper-hyperboloidal": (3.0, 4.0),
}
"""Gains in dB over the inner 2/3 of the radius, and over the outer 1/3."""


@dataclass(frozen=True)
class Around:
    """An environment on a sphere about the mirror vertex."""

    environment: om.Environment
    radius_mm: float

    def radiance(self, origins_mm, directions):
        return self.environment.radiance(
            origins_mm,
            self.distance_mm(origins_mm, directions)[:, None] * _units(directions) + origins_mm,
        )

    def distance_mm(self, origins_mm, directions):
        d = _units(directions)
        along = (d * origins_mm).sum(axis=1)
        return -along + np.sqrt(
            along**2 + self.radius_mm**2 - (np.asarray(origins_mm) ** 2).sum(axis=1)
        )


def _units(directions):
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def scene() -> om.Environment:
    return dead_leaves(1024, 900, smallest_deg=2.1)


@pytest.fixture(scope="module")
def smaller() -> Restorer:
    """Fewer pixels for comparisons of two implementations."""
    return Restorer(with_fewer_pixels(om.load_sensor("paper-spherical"), 160, 0.625))


@pytest.fixture(scope="module")
def small() -> Restorer:
    """25 % of the pixels per side and four times the aperture: the same blur in pixels."""
    return Restorer(with_fewer_pixels(om.load_sensor("paper-spherical"), 256, 1.0))


def test_blur_matrix_matches_ray_traced_blur(small: Restorer, scene: om.Environment):
    sensor, blur = small.camera, small.problem.blur
    fine = om.expose(
        with_fewer_pixels(sensor, 256 * blur.fineness, sensor.lens.f_number), scene, samples=16
    )
    traced = om.expose(sensor, scene, samples=1024, blur=True).reshape(-1, 3)[blur.pixels]
    sharp = om.expose(sensor, scene, samples=64).reshape(-1, 3)[blur.pixels]
    outer = small.radius.ravel()[blur.pixels] > 90
    error = (blur.matrix() @ fine.reshape(-1, 3) - traced)[outer]
    assert np.sqrt((error**2).mean()) < 0.25 * np.sqrt(((sharp - traced)[outer] ** 2).mean())


def test_restoration_gains_on_unseen_scene(small: Restorer, scene: om.Environment):
    result = gains(small, scene)
    rest, outer = TARGETS["paper-spherical"]
    assert result.gain_db[0] > rest
    assert result.gain_db[1] > outer
    assert result.tenths_db.min() > -0.2


@pytest.mark.full
@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("kind", ["dead leaves", "hall"])
def test_paper_sensor_restoration_gain(name: str, kind: str):
    """Two kinds of scenes that were excluded from tuning."""
    result = gains(
        Restorer(om.load_sensor(name)), dead_leaves() if kind == "dead leaves" else om.Hall()
    )
    assert result.gain_db[0] > TARGETS[name][0]
    assert result.gain_db[1] > (
        5.5 if (name, kind) == ("paper-spherical", "hall") else TARGETS[name][1]
    )
    assert result.tenths_db.min() > -0.2


@pytest.mark.parametrize("times", [1.0, 1.15])
def test_restoration_preserves_textured_scene(small: Restorer, times: float):
    """Clouds, whose finest detail is below the noise, permit little gain and do not reveal
    overestimated blur."""
    restorer = (
        small if times == 1 else Restorer(small.camera, specified=small.known.scaled(times).sizes)
    )
    result = gains(restorer, clouds(1024))
    assert result.tenths_db.min() > -0.1
    assert result.gain_db[1] > 0.5


def test_restoration_gain_increases_with_lower_noise(small: Restorer, scene: om.Environment):
    """At 0.3 %, where errors of the known blur exceed the noise and must not be amplified."""
    result = gains(small, scene, noise=0.003)
    assert result.gain_db[0] > 2.5
    assert result.gain_db[1] > 3.5
    assert result.tenths_db.min() > 1


@pytest.mark.parametrize("times", [1.0, 1.15])
def test_restoration_gains_at_rim_with_saturation(small: Restorer, shared_data: Path, times: float):
    """Saturated points amplify all errors of the blur; very bright points with black gaps would be another solution."""
    photograph = shared_data / "environments" / "st_fagans_interior_1k.hdr"
    restorer = (
        small if times == 1 else Restorer(small.camera, specified=small.known.scaled(times).sizes)
    )
    result = gains(restorer, load_environment(photograph))
    assert result.tenths_db.min() > -0.1
    assert result.gain_db[1] > 0.3


def test_white_image_is_unchanged(smaller: Restorer):
    """A saturated pixel and its neighbours may have any higher true value."""
    image = np.random.default_rng(3).integers(40, 90, (160, 160, 3), dtype=np.uint8)
    image[:, 110:] = 255
    restored = smaller(image, 0.02, 1.0)
    assert (restored[:, 115:] == 255).all()
    assert (restored[:, :105] != image[:, :105]).any()


@pytest.mark.full
def test_blur_depends_on_object_distance(scene: om.Environment):
    """A wall at 300 mm all around: its own blur restores more than that of distant objects, which
    causes no damage."""
    sensor = with_fewer_pixels(om.load_sensor("paper-hyperboloidal"), 160, 0.625)
    near = Around(scene, 300.0)
    right, mismatched = (
        gains(Restorer(sensor, distance), near).gain_db for distance in (300.0, np.inf)
    )
    assert right[0] > mismatched[0] + 0.1
    assert right[1] > mismatched[1] + 2
    assert right.min() > 2.5
    assert mismatched.min() > 0


@pytest.mark.parametrize("level", [0.15, 0.5, 0.85])
def test_noise_is_not_amplified(smaller: Restorer, level: float):
    rng = np.random.default_rng(5)
    noisy = np.rint(255 * np.clip(level + 0.01 * rng.standard_normal((160, 160)), 0, 1)).astype(
        np.uint8
    )
    restored = smaller(noisy, 0.01)
    where = smaller.fraction > 0.9
    assert restored[where].std() < 0.5 * noisy[where].std()
    assert restored[where].mean() == pytest.approx(noisy[where].mean(), abs=0.5)


def test_edges_do_not_ring(small: Restorer):
    """Black and white quarters of the sky: overshoot of the restored image is small."""
    columns = (np.arange(720) // 45) % 2
    light = np.broadcast_to(np.where(columns, 0.6, 0.1)[None, :, None], (360, 720, 3)).astype(
        np.float32
    )
    blurred = om.render_image(
        small.camera, om.Environment(np.ascontiguousarray(light)), samples=256, blur=True
    )
    sharp = om.render_image(small.camera, om.Environment(np.ascontiguousarray(light)), samples=16)
    restored = small(blurred, 0.01).astype(float)
    where = (small.fraction > 0.9) & (small.radius > 40)
    low, high = np.percentile(sharp[where], [1, 99])
    assert restored[where].max() < high + 0.03 * 255
    assert restored[where].min() > low - 0.03 * 255


def test_restoration_is_consistent_across_image_types(smaller: Restorer, scene: om.Environment):
    byte = om.render_image(smaller.camera, scene, samples=32, blur=True)
    reference = smaller(byte, 0.01, 1.0) / 255
    light = om.expose(smaller.camera, scene, samples=32, blur=True)
    for image in (byte * np.uint16(257), light):
        restored = smaller(image, 0.01, 1.0)
        assert restored.dtype == image.dtype
        assert restored.shape == image.shape
        values = srgb_from_linear(restored) if image is light else restored / 65535
        assert np.sqrt(((values - reference) ** 2).mean()) < 0.006


def test_restoration_preserves_alpha_and_outside(smaller: Restorer):
    image = np.random.default_rng(0).integers(0, 255, (160, 160, 4), dtype=np.uint8)
    restored = smaller(image, 0.05, 1.0)
    np.testing.assert_array_equal(restored[..., 3], image[..., 3])
    outside = smaller.fraction == 0
    np.testing.assert_array_equal(restored[outside], image[outside])
    assert (restored[~outside] != image[~outside]).any()


def test_restoration_commutes_with_flip(smaller: Restorer, scene: om.Environment):
    """Also off centre, where a flip moves the optical axis; neighbours are one-sided, so not exact
    to the byte."""
    sensor = replace(smaller.camera, imager=replace(smaller.camera.imager, centre_px=(68.0, 80.0)))
    image = om.render_image(sensor, scene, samples=32, blur=True)
    flipped = replace(sensor, mount=replace(sensor.mount, image_flipped=True))
    restored = Restorer(sensor)(image, 0.01, 1.0).astype(float)
    reversed_image = np.ascontiguousarray(image[:, ::-1])
    other, mismatched = (
        Restorer(camera)(reversed_image, 0.01, 1.0)[:, ::-1] for camera in (flipped, sensor)
    )
    assert np.sqrt(((other - restored) ** 2).mean()) < 0.2 * np.sqrt(
        ((mismatched - restored) ** 2).mean()
    )


def test_pixels_beyond_rim_do_not_affect_restoration(smaller: Restorer, scene: om.Environment):
    """A wall, a window or a lamp behind the mirror: up to the last restored pixel."""
    image = om.render_image(smaller.camera, scene, samples=32, blur=True)
    beyond = smaller.radius > smaller.known.whole_radius_px
    others = [image.copy(), image.copy()]
    others[0][beyond] = 255
    others[1][beyond] = np.random.default_rng(1).integers(0, 255, (int(beyond.sum()), 3))
    restored = smaller(image, 0.01)
    for other in others:
        np.testing.assert_array_equal(smaller(other, 0.01)[~beyond], restored[~beyond])
    assert (restored[~beyond] != image[~beyond]).any()


@pytest.mark.long
def test_specified_blur_restores_other_cameras(smaller: Restorer, scene: om.Environment):
    """Image of a sensor with the blur specified in each form: equal to that of the sensor, up to
    the rim."""
    image = om.render_image(smaller.camera, scene, samples=32, blur=True)
    centre, rim = smaller.camera.symmetry.centre_px, smaller.camera.rim_radius_px
    ball = om.MirrorBall(
        centre_px=centre, rim_radius_px=rim, field_deg=360.0, image_size=(160, 160)
    )
    ocam = om.OCam(
        polynomial=(-37.5, 0.0, 0.0064), centre_px=centre, image_size=(160, 160), rim_radius_px=rim
    )
    radii = np.linspace(0, 81, 82)
    table = np.stack([radii, *smaller.known.sizes(radii)], axis=-1)
    inner = smaller.radius < 0.9 * rim
    expected = smaller(image, 0.01, 1.0).astype(float)
    gain = np.sqrt(((expected - image)[inner] ** 2).mean())
    for camera, sizes in (
        (ball, table),
        (ocam, table),
        (ball, smaller.known.sizes),
        (smaller.camera, table),
    ):
        restored = Restorer(camera, specified=sizes)(image, 0.01, 1.0)
        assert np.sqrt(((restored - expected)[inner] ** 2).mean()) < 0.05 * gain, camera


@pytest.mark.parametrize("times", [1.4, pytest.param(2.0, marks=pytest.mark.full)])
def test_overestimated_blur_is_reduced(small: Restorer, scene: om.Environment, times: float):
    """The correct blur is not reduced; a larger one is reduced to about the actual blur."""
    noisy = om.render_image(
        small.camera, scene, samples=64, blur=True
    ) + 2.55 * np.random.default_rng(1).standard_normal(3)
    image = np.clip(noisy, 0, 255).astype(np.uint8)
    assert small.blur_fraction(image, 0.01) == 1
    restorer = Restorer(small.camera, specified=small.known.scaled(times).sizes)
    assert restorer.blur_fraction(image, 0.01) * times == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(
    ("name", "world"),
    few(
        [("paper-equidistant", Hall), ("paper-hyperboloidal", Hall), ("paper-equidistant", Street)],
        ("paper-equidistant", Hall),
    ),
)
def test_large_blur_on_small_image_is_reduced(name: str, world):
    """A correctly specified blur is removed; if the specified blur is too large, at most the actual blur is removed."""
    sensor = om.load_sensor(name)
    sensor = with_fewer_pixels(sensor, 256, sensor.lens.f_number * 256 / sensor.imager.width_px)
    noisy = om.render_image(sensor, world(), samples=64, blur=True) + 2.55 * np.random.default_rng(
        1
    ).standard_normal((256, 256, 3))
    image = np.rint(np.clip(noisy, 0, 255)).astype(np.uint8)
    blur = Restorer(sensor).known
    for times in (1, 1.5, 1.9, 2):
        removed = times * Restorer(sensor, specified=blur.scaled(times).sizes).blur_fraction(
            image, 0.01
        )
        assert removed < 1.15, times
        assert removed > 0.65 or times > 1


def test_blur_of_texture_and_plain_images(
    smaller: Restorer,
):
    """Grain on a uniform surface: with the specified noise, and as texture above it."""
    grain = 0.5 + 0.01 * np.random.default_rng(5).standard_normal((160, 160))
    image = np.rint(255 * grain).astype(np.uint8)
    assert smaller.blur_fraction(image, 0.01) == 1
    assert smaller.blur_fraction(image, 0.007) < 0.9


@pytest.mark.parametrize(
    ("kind", "quality"),
    [pytest.param("leaves", 90, marks=pytest.mark.full), ("leaves", 75), ("clouds", 75)],
)
def test_restoration_preserves_coded_images(
    small: Restorer, kind: str, quality: int, request: pytest.FixtureRequest
):
    """Blind noise estimation: neither blocks nor ringing are sharpened, and clouds, which are
    texture everywhere, lose no more than by coding."""
    scene = request.getfixturevalue("scene") if kind == "leaves" else clouds(1024)
    assert gains(small, scene, quality=quality).tenths_db.min() > -0.3


def _tenths(restorer: Restorer, sharp, image, restored):
    """Return gains (10,) in dB by radial zone."""
    tenth = np.minimum(10 * restorer.radius / restorer.camera.rim_radius_px, 10).astype(int)
    truth = srgb_from_linear(sharp)
    before, after = (((values / 255.0 - truth) ** 2).mean(axis=2) for values in (image, restored))
    return np.array(
        [10 * np.log10(before[tenth == k].mean() / after[tenth == k].mean()) for k in range(10)]
    )


def _rendered(sensor: om.Sensor, scene, stops: int | None):
    """Return the light of an image with an aperture some stops smaller than that of the sensor, or
    sharp."""
    if stops is None:
        return om.expose(sensor, scene, samples=16)
    lens = replace(sensor.lens, f_number=sensor.lens.f_number * 2 ** (stops / 2))
    return om.expose(replace(sensor, lens=lens), scene, samples=64, blur=True)


SCENES = {
    "leaves": lambda data: dead_leaves(1024, 900, smallest_deg=2.1),
    "hall": lambda data: Hall(),
    "clouds": lambda data: clouds(1024),
    "windows": lambda data: load_environment(data / "environments" / "st_fagans_interior_1k.hdr"),
    "panorama": lambda data: load_environment(data / "environments" / "pannellum_examplepano.jpg"),
}


@pytest.mark.parametrize("stops", [0, 1, 2, 3, None])
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("paper-hyperboloidal", "leaves"),
        ("paper-hyperboloidal", "windows"),
        *(
            pytest.param("paper-hyperboloidal", kind, marks=pytest.mark.full)
            for kind in ("hall", "clouds", "panorama")
        ),
        ("paper-spherical", "leaves"),
        *(
            pytest.param("paper-spherical", kind, marks=pytest.mark.full)
            for kind in ("clouds", "panorama")
        ),
    ],
)
def test_removed_blur_does_not_exceed_actual_blur(
    shared_data: Path, name: str, kind: str, stops: int | None
):
    """A lens stopped down after its file was written, up to a completely sharp image."""
    sensor = with_fewer_pixels(om.load_sensor(name), 256, 1.0)
    restorer, scene = Restorer(sensor), SCENES[kind](shared_data)
    noise = 0.01 * np.random.default_rng(1).standard_normal((256, 256, 3))
    values = srgb_from_linear(_rendered(sensor, scene, stops)) + noise
    image = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    gains_db = _tenths(restorer, _rendered(sensor, scene, None), image, restorer(image, 0.01))
    assert gains_db.min() > -0.3
    if stops == 0:
        assert gains_db.mean() > (1 if name == "paper-hyperboloidal" or kind == "leaves" else 0.4)
    if stops is None:
        assert restorer.decide(image, 0.01).fraction < 0.3


@pytest.mark.parametrize(
    ("stops", "noise"),
    [
        (None, 0.01),
        (None, 0.004),
        pytest.param(2, 0.004, marks=pytest.mark.full),
        pytest.param(3, 0.01, marks=pytest.mark.full),
    ],
)
def test_blur_is_not_removed_from_sharper_image_with_few_isolated_edges(
    shared_data: Path, stops: int | None, noise: float
):
    """Restoration with the blur of the sensor file would lose up to 20 dB."""
    sensor = with_fewer_pixels(om.load_sensor("paper-spherical"), 240, 1.0)
    restorer, scene = Restorer(sensor), SCENES["windows"](shared_data)
    image = _noisy(_rendered(sensor, scene, stops), noise, seed=12)
    gains_db = _tenths(restorer, _rendered(sensor, scene, None), image, restorer(image, noise))
    assert gains_db.min() > -0.3


def _noisy(light, noise: float, seed: int):
    values = srgb_from_linear(light)
    values = values + noise * np.random.default_rng(seed).standard_normal(values.shape)
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


@pytest.mark.parametrize("saturated", [0.0015, pytest.param(0.005, marks=pytest.mark.full)])
def test_lamps_do_not_contradict_correct_blur(shared_data: Path, saturated: float):
    """Lamps of up to ten times the light of white leave residuals for every blur."""
    photograph = shared_data / "environments" / "st_fagans_interior_1k.hdr"
    sensor = with_fewer_pixels(om.load_sensor("paper-spherical"), 240, 0.8)
    image = _noisy(_rendered(sensor, load_environment(photograph, saturated), 0), 0.01, seed=13)
    assert Restorer(sensor).decide(image, 0.01).fraction > 0.6


def _disk(diameter_px: float):
    """Return the kernel of a disc, supersampled, of unit sum."""
    axis_px = (np.arange(15 * 8) - 59.5) / 8
    inside = np.hypot(*np.meshgrid(axis_px, axis_px)) <= diameter_px / 2
    kernel = inside.reshape(15, 8, 15, 8).mean(axis=(1, 3))
    return kernel / kernel.sum()


@pytest.mark.parametrize(
    ("actual", "specified"),
    few(
        [(0.0, 1.0), (0.0, 1.5), (0.0, 2.0), (0.0, 2.5), (0.0, 3.0), (1.5, 3.0), (3.0, 3.0)],
        (0.0, 1.0),
        (0.0, 2.0),
        (1.5, 3.0),
    ),
)
def test_uniform_blur_that_is_specified_too_large_does_no_harm(
    shared_data: Path, actual: float, specified: float
):
    """A specified blur of 3 px is not removed from a photograph with 1.5 px or none; a correct value is."""
    sensor = with_fewer_pixels(om.load_sensor("paper-hyperboloidal"), 256, 1.0)
    sharp = _rendered(sensor, SCENES["leaves"](shared_data), None)
    ball = om.MirrorBall(
        centre_px=sensor.symmetry.centre_px,
        rim_radius_px=sensor.rim_radius_px,
        field_deg=300.0,
        image_size=(256, 256),
    )
    light = cv2.filter2D(sharp, -1, _disk(actual)) if actual else sharp
    noise = 0.01 * np.random.default_rng(1).standard_normal(light.shape)
    image = np.rint(255 * np.clip(srgb_from_linear(light) + noise, 0, 1)).astype(np.uint8)
    restorer = Restorer(ball, specified=specified)
    share = restorer.decide(image, 0.01).fraction
    gains_db = _tenths(restorer, sharp, image, restorer(image, 0.01, share))
    assert gains_db.min() > -0.3
    assert gains_db.mean() > (3 if actual == specified else -0.1)
    assert (share == 1) == (actual == specified)


@pytest.mark.parametrize("amount", [0.6, pytest.param(1.0, marks=pytest.mark.full)])
@pytest.mark.parametrize(
    "name", ["paper-hyperboloidal", pytest.param("paper-spherical", marks=pytest.mark.full)]
)
def test_sharpened_image_is_unchanged(shared_data: Path, name: str, amount: float):
    """Denoised, sharpened and coded as by phones; the same image without sharpening is restored."""
    sensor = with_fewer_pixels(om.load_sensor(name), 256, 1.0)
    restorer, scene = Restorer(sensor), SCENES["panorama"](shared_data)
    values = srgb_from_linear(_rendered(sensor, scene, 0))
    noisy = np.rint(
        255 * np.clip(values + 0.01 * np.random.default_rng(1).standard_normal(values.shape), 0, 1)
    )
    plain = cv2.bilateralFilter(noisy.astype(np.uint8), 5, 10, 2).astype(np.float32)
    sharpened = plain + amount * (plain - cv2.GaussianBlur(plain, (0, 0), 1.0))
    plain, sharpened = (
        jpeg_round_trip(np.rint(np.clip(v, 0, 255)).astype(np.uint8), 85)
        for v in (plain, sharpened)
    )
    decision = restorer.decide(sharpened)
    assert decision.fraction == 0
    assert "overshoot" in decision.reason
    np.testing.assert_array_equal(restorer(sharpened), sharpened)
    assert restorer.decide(plain).fraction > 0.8


@pytest.mark.parametrize(
    ("name", "kind", "quality"),
    [
        ("paper-hyperboloidal", "windows", 95),
        pytest.param("paper-hyperboloidal", "windows", 85, marks=pytest.mark.full),
        pytest.param("paper-spherical", "panorama", 95, marks=pytest.mark.full),
    ],
)
def test_weakly_sharpened_image_is_restored_partially(
    shared_data: Path, name: str, kind: str, quality: int
):
    """Denoised and sharpened by an amount of 0.3: less blur is removed than from the image without."""
    sensor = with_fewer_pixels(om.load_sensor(name), 256, 1.0)
    restorer, scene = Restorer(sensor), SCENES[kind](shared_data)
    values = srgb_from_linear(_rendered(sensor, scene, 0))
    noisy = np.rint(
        255 * np.clip(values + 0.01 * np.random.default_rng(1).standard_normal(values.shape), 0, 1)
    )
    plain = cv2.bilateralFilter(noisy.astype(np.uint8), 5, 10, 2).astype(np.float32)
    sharpened = plain + 0.3 * (plain - cv2.GaussianBlur(plain, (0, 0), 1.0))
    plain, sharpened = (
        jpeg_round_trip(np.rint(np.clip(v, 0, 255)).astype(np.uint8), quality)
        for v in (plain, sharpened)
    )
    decision = restorer.decide(sharpened)
    assert decision.fraction < 0.5
    assert "overshoot" in decision.reason
    restored = restorer(sharpened, fraction=decision.fraction)
    assert _tenths(restorer, _rendered(sensor, scene, None), sharpened, restored).min() > -0.3
    assert restorer.decide(plain).fraction == 1


@pytest.mark.parametrize("quality", [85, pytest.param(70, marks=pytest.mark.full)])
def test_coding_ringing_is_not_sharpening(small: Restorer, scene: om.Environment, quality: int):
    """Sharp edges everywhere, where coding errors overshoot by more than a sharpened photograph does."""
    image = jpeg_round_trip(om.render_image(small.camera, scene, samples=64, blur=True), quality)
    assert small.decide(image).fraction > 0.5


@pytest.mark.parametrize(
    ("blur", "message"),
    [
        (None, "blur must be specified for a MirrorBall"),
        (-1.0, "blur must be between 0 and 30 px; got -1 px"),
        ((1.0, np.nan), "blur must be between .*; got nan px"),
        ([[0, 1, 1], [0, 2, 2]], "finite and increasing"),
        ([[0, 1]], r"got shape \(1, 2\)"),
        (lambda radius: (radius, radius, radius), "must return two diameters"),
    ],
)
def test_invalid_blur_raises(blur, message: str):
    ball = om.MirrorBall(
        centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=360.0, image_size=(64, 64)
    )
    with pytest.raises(InvalidParameter, match=message):
        om.restore(ball, np.zeros((64, 64), np.uint8), noise=0.01, blur=blur)


def test_invalid_image_raises(small: Restorer):
    with pytest.raises(InvalidParameter, match="got 20 x 10 px"):
        small(np.zeros((10, 20), np.uint8))
    with pytest.raises(InvalidParameter, match="int32"):
        small(np.zeros((256, 256), np.int32))
    with pytest.raises(InvalidParameter, match=r"noise must be .*; got 3"):
        small(np.zeros((256, 256), np.uint8), 3)
    with pytest.raises(InvalidParameter, match=r"noise must be .*; got nan"):
        small(np.zeros((256, 256), np.uint8), float("nan"))
    light = np.full((256, 256), 0.5, np.float32)
    light[7, 7:9] = np.nan, np.inf
    with pytest.raises(InvalidParameter, match="got 2 that are NaN or infinite"):
        small(light, 0.01)
    tilted = replace(small.camera, mirror_pose=MirrorPose(tilt_x_deg=0.5))
    with pytest.raises(InvalidParameter, match="got a decentred, tilted or deformed one"):
        om.restore(tilted, np.zeros((256, 256), np.uint8))
