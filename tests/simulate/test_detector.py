"""The imager's electronics: noise that can be counted, and numbers as they are written."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.errors import InvalidParameter
from omnimirror.simulate import Detector
from omnimirror.simulate.colour import srgb_bytes


def test_without_noise_it_writes_srgb():
    light = np.random.default_rng(1).uniform(0, 1.3, (20, 30, 3)).astype(np.float32)
    np.testing.assert_array_equal(Detector().read(light), srgb_bytes(light))


@pytest.mark.parametrize("share", [0.04, 0.3, 0.7])
@pytest.mark.parametrize("read_noise_e", [0.0, 12.0])
def test_the_variance_of_the_signal_is_that_of_photons_and_reading(share, read_noise_e):
    full = 4000.0
    values = Detector(full_well_e=full, read_noise_e=read_noise_e, bits=16, curve="linear").read(
        np.full((300, 300, 3), share, np.float32), seed=7
    )
    electrons = values / 65535 * full
    assert electrons.mean() == pytest.approx(share * full, rel=2e-3)
    assert electrons.var() == pytest.approx(share * full + read_noise_e**2, rel=0.02)


def test_a_seed_repeats_the_noise():
    light, noisy = np.full((9, 9, 3), 0.5, np.float32), Detector(full_well_e=100.0)
    np.testing.assert_array_equal(noisy.read(light, 3), noisy.read(light, 3))
    assert (noisy.read(light, 3) != noisy.read(light, 4)).any()


def test_exposure_saturates_and_bits_fill_their_range():
    light = np.array([[[0.0, 0.25, 0.6]]], np.float32)
    values = Detector(exposure=2.0, bits=10, curve="linear").read(light)
    assert values.dtype == np.uint16
    assert values.tolist() == [[[0, 512, 1023]]]


@pytest.mark.parametrize("bayer", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_a_mosaic_is_what_opencv_reads(bayer):
    """OpenCV names mosaics by the second row's second and third pixel: BayerBG is RGGB."""
    import cv2

    colour = np.float32([0.8, 0.4, 0.1])
    raw = Detector(curve="linear", bayer=bayer).read(np.tile(colour, (8, 8, 1)))
    code = getattr(cv2, f"COLOR_Bayer{ {'RGGB': 'BG', 'BGGR': 'RG', 'GRBG': 'GB', 'GBRG': 'GR'}[bayer] }2RGB")
    np.testing.assert_allclose(cv2.cvtColor(raw, code)[4, 4], np.rint(255 * colour), atol=1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bits": 7}, "bits = 7"),
        ({"bits": 9.5}, "bits = 9.5"),
        ({"bayer": "RGBG"}, "bayer = 'RGBG'"),
        ({"read_noise_e": 3.0}, "full_well_e"),
        ({"exposure": 0.0}, "exposure = 0"),
    ],
)
def test_what_no_imager_is_is_refused(changes, words):
    with pytest.raises(InvalidParameter, match=words):
        Detector(**changes)
