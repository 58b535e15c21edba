"""Blind noise estimation against the added noise, and against the coding error."""

import cv2
import numpy as np
import pytest
from restoration_gain import clouds, dead_leaves, with_fewer_pixels

import omnimirror as om
from omnimirror.base.colour import linear_from_srgb, srgb_from_linear
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.dewarp.restoration.noise import detected_coding, standard_tables
from omnimirror.io.images import parse_jpeg_coding, read_jpeg_coding
from omnimirror.simulation.scenes.calibration_hall import Hall


@pytest.fixture(scope="module")
def light() -> np.ndarray:
    """An image of the hall with the blur of a spherical mirror, in linear light."""
    sensor = with_fewer_pixels(om.load_sensor("paper-spherical"), 256, 1.0)
    return om.expose(sensor, Hall(), samples=16, blur=True)


@pytest.fixture(scope="module")
def inside(light) -> np.ndarray:
    """Mask of the mirror image."""
    rows, columns = np.indices(light.shape[:2]) - 127.5
    return np.hypot(rows, columns) < 118


def noisy(light, noise: float, seed: int = 1) -> np.ndarray:
    srgb = srgb_from_linear(light) + noise * np.random.default_rng(seed).standard_normal(
        light.shape
    )
    return np.rint(255 * np.clip(srgb, 0, 1)).astype(np.uint8)


def rms(image, light, inside) -> float:
    return float(np.sqrt(((image / 255 - srgb_from_linear(light))[inside] ** 2).mean()))


def as_jpeg(image, quality: int) -> tuple[bytes, np.ndarray]:
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return data.tobytes(), np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


@pytest.mark.parametrize("noise", [0.005, 0.01, 0.03])
def test_white_noise_estimate(light, inside, noise: float):
    estimate = om.estimate_noise(noisy(light, noise), where=inside)
    assert estimate.kind == "white"
    assert estimate.fraction == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize("quality", [95, 90, 85, 75, 60, 50])
def test_coding_error_estimate_with_and_without_file(light, inside, tmp_path, quality: int):
    """Not the remaining noise, which coding removes, but the deviation from the image before noise
    and coding."""
    data, image = as_jpeg(noisy(light, 0.01), quality)
    (tmp_path / "a.jpg").write_bytes(data)
    truth = rms(image, light, inside)
    assert truth > 0.012
    for file in (tmp_path / "a.jpg", None):
        estimate = om.estimate_noise(image, file, where=inside)
        assert estimate.kind == "JPEG"
        assert estimate.fraction == pytest.approx(truth, rel=0.25)


@pytest.mark.parametrize("quality", [92, 75, 60])
def test_texture_is_not_residual_coding_noise(inside, quality: int):
    """Clouds have no uniform blocks; without their gradient, the residual is texture."""
    textured = om.expose(
        with_fewer_pixels(om.load_sensor("paper-spherical"), 256, 1.0),
        clouds(1024),
        samples=32,
        blur=True,
    )
    for noise in (0.003, 0.03):
        image = as_jpeg(noisy(textured, noise), quality)[1]
        truth = rms(image, textured, inside)
        assert om.estimate_noise(image, where=inside).fraction == pytest.approx(truth, rel=0.25)


def test_visible_fraction_of_coding_error(light, inside):
    """Only for noise below the quantisation steps; the finer the steps, the larger its fraction."""
    shares = [
        om.estimate_noise(as_jpeg(noisy(light, 0.01), q)[1], where=inside).visible_fraction
        for q in (60, 85, 95)
    ]
    assert shares[0] < 0.35
    assert shares == sorted(shares)
    assert om.estimate_noise(noisy(light, 0.01), where=inside).visible_fraction == 1


def test_previous_coding_is_not_attributed_to_file(tmp_path):
    """A finely coded file is treated like typical files, with visible noise."""
    slope = np.repeat(
        np.linspace(40, 200, 256).astype(np.uint8)[None, :, None], 256, axis=0
    ).repeat(3, axis=2)
    (tmp_path / "a.jpg").write_bytes(as_jpeg(slope, 95)[0])
    estimate = om.estimate_noise(slope, tmp_path / "a.jpg")
    assert estimate.fraction == pytest.approx(0.005)
    assert estimate.visible_fraction > 0.8


@pytest.mark.parametrize("quality", [90, 75, 50])
def test_coding_error_of_grey_and_full_chroma_images(light, inside, quality: int):
    grey = noisy(light.mean(axis=2), 0.01)
    decoded = cv2.imdecode(
        cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_UNCHANGED
    )
    truth = rms(decoded, light.mean(axis=2), inside)
    assert om.estimate_noise(decoded, where=inside).fraction == pytest.approx(truth, rel=0.25)
    fine = [
        cv2.IMWRITE_JPEG_QUALITY,
        quality,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    data = cv2.imencode(".jpg", noisy(light, 0.01)[..., ::-1], fine)[1]
    assert parse_jpeg_coding(data.tobytes()).subsampling == (1, 1)


@pytest.mark.parametrize(
    "code", [cv2.COLOR_BayerRG2RGB, cv2.COLOR_BayerRG2RGB_EA, cv2.COLOR_BayerRG2RGB_VNG]
)
def test_demosaiced_noise_estimate(light, inside, code: int):
    """Noise after demosaicing."""

    def demosaiced(image):
        mosaic = image[..., 1].copy()
        mosaic[::2, ::2], mosaic[1::2, 1::2] = image[::2, ::2, 2], image[1::2, 1::2, 0]
        return cv2.demosaicing(mosaic, code)

    image = demosaiced(noisy(light, 0.01))
    left = (image.astype(float) - demosaiced(noisy(light, 0.0)))[inside] / 255
    estimate = om.estimate_noise(image, where=inside)
    assert estimate.kind == "demosaiced"
    assert estimate.fraction == pytest.approx(np.sqrt((left**2).mean()), rel=0.25)


def test_linear_noise_increases_with_light(light, inside):
    """Read noise and shot noise: standard deviation of the square root of the light, in dark and
    bright regions."""
    variance = 1e-5 + 4e-4 * light.mean(axis=2)
    linear = light + np.sqrt(variance)[..., None] * np.random.default_rng(1).standard_normal(
        light.shape
    )
    estimate = om.estimate_noise(linear.astype(np.float32), where=inside)
    assert estimate.kind == "linear"
    level = light.mean(axis=2)
    truth = np.sqrt(variance) / (2 * np.sqrt(np.maximum(level, 1e-6)))
    for low, high in ((0.03, 0.1), (0.1, 0.3), (0.3, 0.9)):
        in_band = inside & (low < level) & (level < high)
        assert np.median(estimate.by_pixel[in_band] / truth[in_band]) == pytest.approx(1, rel=0.25)


def test_noise_estimate_of_16_bit_image(light, inside):
    srgb = srgb_from_linear(light) + 0.002 * np.random.default_rng(1).standard_normal(light.shape)
    deep = np.rint(65535 * np.clip(srgb, 0, 1)).astype(np.uint16)
    assert om.estimate_noise(deep, where=inside).fraction == pytest.approx(0.002, rel=0.25)


def test_jpeg_coding_matches_encoder(light, tmp_path):
    """OpenCV writes the standard tables, scaled as by libjpeg."""
    for quality in (30, 75, 95):
        data, image = as_jpeg(noisy(light, 0.01), quality)
        coding = parse_jpeg_coding(data)
        for table, standard in zip(
            coding.tables, (*standard_tables(quality), standard_tables(quality)[1]), strict=True
        ):
            np.testing.assert_array_equal(table, standard)
        assert coding.subsampling == (2, 2)
        mask = np.ones(image.shape[:2], bool)
        detected = detected_coding(image, mask)
        assert np.abs(np.log(detected.tables[0] / coding.tables[0])).mean() < 0.1
    om.write_image(tmp_path / "a.png", image)
    assert read_jpeg_coding(tmp_path / "a.png") is None
    assert detected_coding(noisy(light, 0.01), mask) is None


@pytest.mark.parametrize("end", [3, 30, 100, 200])
def test_truncated_jpeg_coding(light, end: int):
    coding = parse_jpeg_coding(as_jpeg(noisy(light, 0.01), 75)[0][:end])
    assert coding is None or all(table.shape == (8, 8) for table in coding.tables)


def test_invalid_noise_input_raises(tmp_path):
    for invalid_image in (
        np.zeros((8, 8, 2), np.uint8),
        np.zeros((0, 8), np.uint8),
        np.zeros((8, 8), int),
        [[1, 2]],
    ):
        with pytest.raises(InvalidParameter, match="image must"):
            om.estimate_noise(invalid_image)
    with pytest.raises(InvalidParameter, match="got 1 that are NaN"):
        om.estimate_noise(np.full((1, 1), np.nan, np.float32))
    with pytest.raises(InvalidParameter, match="where must have the shape"):
        om.estimate_noise(np.zeros((8, 8), np.uint8), where=np.ones((4, 4), bool))
    with pytest.raises(MediaError, match="cannot read"):
        om.estimate_noise(np.zeros((8, 8), np.uint8), tmp_path / "none.jpg")
    assert 0 < om.estimate_noise(np.zeros((5, 5), np.uint8)).fraction < 0.01  # smaller than a block


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant", "paper-hyperboloidal"])
def test_coding_error_of_leaves(name: str):
    """Strong texture, with colours coarsened by coding."""
    sensor = with_fewer_pixels(om.load_sensor(name), 512, om.load_sensor(name).lens.f_number / 2)
    light = om.expose(sensor, dead_leaves(), samples=16, blur=True)
    rows, columns = np.indices(light.shape[:2]) - 255.5
    inside = np.hypot(rows, columns) < 0.95 * sensor.rim_radius_px
    for quality in (85, 75, 60, 50):
        image = as_jpeg(noisy(light, 0.01), quality)[1]
        assert om.estimate_noise(image, where=inside).fraction == pytest.approx(
            rms(image, light, inside), rel=0.25
        )


def test_linear_and_srgb_estimates_agree(light, inside):
    """Uniform noise in sRGB, reported for linear light: its mean deviation is close to the added
    one."""
    image = linear_from_srgb(noisy(light, 0.02) / 255.0)
    assert om.estimate_noise(image, where=inside).fraction == pytest.approx(0.02, rel=0.35)
