"""Imager electronics: noise statistics, and digital numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.colour import srgb_bytes
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.image_sensor import Imager
from omnimirror.simulation.detector import Detector, Electrons, Readout, filtered_light
from omnimirror.simulation.rendering import render_light
from tests.everyday import few

# -- Imager electronics: noise statistics, and digital numbers -------------------------------------


def test_noiseless_detector_is_srgb():
    light = np.random.default_rng(1).uniform(0, 1.3, (20, 30, 3)).astype(np.float32)
    np.testing.assert_array_equal(Detector().read(light), srgb_bytes(light))


FULL, READ = 10_000.0, 5.0
GAIN = 4095 / FULL


def variance_of(mean_e):
    """Return the variance of the linear model of EMVA 1288 (release 4, Eq. 12): shot, read and
    quantisation noise."""
    return GAIN**2 * (mean_e + READ**2) + 1 / 12


@pytest.mark.parametrize(
    "share", [0.0, 1e-3, 0.04, 0.5, 0.94], ids=["dark", "dusk", "dim", "mid", "near saturation"]
)
@pytest.mark.parametrize(
    "changes", [{}, {"black_level_dn": 64.0}, {"bayer": "RGGB"}], ids=["auto", "64", "bayer"]
)
def test_mean_and_variance_match_emva_1288(share, changes):
    camera = Detector(full_well_e=FULL, read_noise_e=READ, bits=12, curve="linear", **changes)
    side = 1000 if "bayer" in changes else 600
    values = camera.read(np.full((side, side, 3), share, np.float32), seed=7).astype(float)
    assert values.mean() == pytest.approx(
        GAIN * share * FULL + camera.offset_dn, abs=5e-3 * np.sqrt(values.var())
    )
    assert values.var() == pytest.approx(variance_of(share * FULL), rel=0.01)
    assert (values == 0).mean() < 1e-5


def test_oversaturated_light_is_white():
    """A pixel with twice its full-well capacity is white in any readout."""
    values = Detector(full_well_e=FULL, read_noise_e=50.0, bits=12, curve="linear").read(
        np.full((200, 200, 3), 2.0, np.float32)
    )
    assert (values == 4095).all()


def test_noise_at_saturation():
    values = Detector(
        full_well_e=FULL, read_noise_e=50.0, bits=12, curve="linear", black_level_dn=0.0
    ).read(np.full((300, 300, 3), 1.0, np.float32))
    assert (values == 4095).mean() == pytest.approx(0.5, abs=0.01)


def test_srgb_black_level_is_subtracted():
    dark = Detector(full_well_e=FULL, read_noise_e=READ).read(np.zeros((99, 99, 3), np.float32))
    assert (dark == 0).mean() > 0.5


@pytest.mark.parametrize("light", [1e30, np.inf])
def test_large_light_values(light):
    camera = Detector(exposure=1e9, full_well_e=1e9, read_noise_e=1e3, bits=16, curve="linear")
    assert (camera.read(np.full((4, 4, 3), light, np.float64)) == 65535).all()


@pytest.mark.parametrize(
    ("light", "seed", "message"),
    [
        (np.full((4, 4, 3), np.nan), 0, "light must not contain NaN"),
        (
            np.where(np.arange(48).reshape(4, 4, 3) == 25, np.nan, 0.5),
            0,
            "light must not contain NaN",
        ),  # one value of one pixel
        (np.zeros((4, 4)), 0, r"got \(4, 4\)"),
        (np.array([[["a", "b", "c"]]]), 0, "light must be numbers"),
        (np.zeros((4, 4, 3)), -1, "seed must be .*; got -1"),
        (np.zeros((4, 4, 3)), 1.5, r"seed must be an integer from 0; got 1\.5"),
        *(
            (np.zeros(shape), 0, "light must be numbers of shape")
            for shape in (
                (3, 4, 2),
                (3, 3, 4),
                (1, 3, 3, 3),
            )
        ),
    ],
)
def test_invalid_light_raises(light, seed, message):
    with pytest.raises(InvalidParameter, match=message):
        Detector(full_well_e=FULL).read(light, seed)


def test_seed_is_reproducible():
    light, noisy = np.full((9, 9, 3), 0.5, np.float32), Detector(full_well_e=100.0)
    np.testing.assert_array_equal(noisy.read(light, 3), noisy.read(light, 3))
    assert (noisy.read(light, 3) != noisy.read(light, 4)).any()
    np.testing.assert_array_equal(noisy.read(light, 3), noisy.read(light, np.int64(3)))
    np.testing.assert_array_equal(noisy.read(light), noisy.read(light, 0))
    readout = Readout(noisy)
    values = readout.digital_values(readout.conversion.read(light))
    np.testing.assert_array_equal(values, noisy.read(light, 0))


def test_negative_light_is_dark():
    noisy = Detector(full_well_e=FULL, read_noise_e=READ, bits=12, curve="linear")
    values = noisy.read(np.full((300, 300, 3), -0.5, np.float32)).astype(float)
    assert values.mean() == pytest.approx(noisy.offset_dn, abs=0.02)


@pytest.mark.parametrize(("noise", "bits"), [(0.0, 8), (50.0, 16)])
def test_counts_have_room_for_20_standard_deviations(noise, bits):
    """Light is limited to 20 standard deviations above white, of photons and of read noise; counts
    have as many above that."""

    def largest(full):
        return full + 20 * (np.sqrt(full) + noise + 1)

    def excess(full):
        return largest(full) + 20 * np.sqrt(largest(full)) - 2**16

    limit = brentq(excess, 1e4, 1e5)
    assert Electrons(Detector(full_well_e=1e4), 0)._max_electrons == 1e4 + 20 * (100 + 1)
    for full, dtype in ((limit * (1 - 1e-9), np.uint16), (limit * (1 + 1e-9), np.uint32)):
        assert (
            Electrons(Detector(full_well_e=full, read_noise_e=noise, bits=bits), 0).dtype == dtype
        )


def test_words_and_integers_of_other_types():
    """Words read from a file and integers of NumPy."""
    linear, none, eight = "".join(["lin", "ear"]), "".join(["no", "ne"]), np.int64(8)
    raw = Detector(bits=eight, curve=linear, bayer=none, black_level_dn=10.0)
    assert raw.dtype == np.uint8
    assert raw.is_pointwise
    assert Detector(full_well_e=float("inf"), bits=np.int64(12)).max_dn == 4095
    light = np.random.default_rng(1).uniform(0, 1, (4, 5, 3)).astype(np.float32)
    np.testing.assert_array_equal(
        raw.read(light), Detector(curve="linear", black_level_dn=10.0).read(light)
    )
    srgb = Detector(curve="".join(["s", "rgb"]))
    np.testing.assert_array_equal(srgb.read(light), srgb_bytes(light))


def test_exposure_saturation_and_bit_depth():
    light = np.array([[[0.0, 0.25, 0.6]]], np.float32)
    values = Detector(exposure=2.0, bits=10, curve="linear").read(light)
    assert values.dtype == np.uint16
    assert values.tolist() == [[[0, 512, 1023]]]


@pytest.mark.parametrize("bayer", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_bayer_mosaic_matches_opencv(bayer):
    """OpenCV names mosaics by the second and third pixel of the second row: BayerBG is RGGB."""
    import cv2

    colour = np.float32([0.8, 0.4, 0.1])
    raw = Detector(curve="linear", bayer=bayer).read(np.tile(colour, (8, 8, 1)))
    code = getattr(
        cv2, f"COLOR_Bayer{ {'RGGB': 'BG', 'BGGR': 'RG', 'GRBG': 'GB', 'GBRG': 'GR'}[bayer] }2RGB"
    )
    np.testing.assert_allclose(cv2.cvtColor(raw, code)[4, 4], np.rint(255 * colour), atol=1)


@pytest.mark.parametrize("full_well_e", [np.inf, 1e4])
@pytest.mark.parametrize("bayer", ["none", "RGGB"])
def test_is_pointwise(bayer, full_well_e):
    detector = Detector(full_well_e=full_well_e, bayer=bayer, curve="linear")
    assert detector.is_pointwise == (bayer == "none" and full_well_e == np.inf)


@pytest.mark.parametrize("first", [0, 1, 2, 3])
def test_mosaic_of_parts_matches_full_image(first):
    light = np.random.default_rng(3).uniform(0, 1, (6, 8, 3)).astype(np.float32)
    detector = Detector(curve="linear", bayer="GRBG")
    np.testing.assert_array_equal(
        filtered_light(detector, light[first:], first), filtered_light(detector, light)[first:]
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposure": 1.1e9}, r"exposure must be between 1e-09 and 1e\+09; got 1\.1e\+09"),
        ({"full_well_e": 9.9}, r"full_well_e must be between 10 and 1e\+09 electrons; got 9\.9"),
        (
            {"read_noise_e": 1e6 + 0.5, "full_well_e": 1e8},
            r"read_noise_e must be between 0 and 1e\+06 electrons; got 1e\+06",
        ),
        (
            {"black_level_dn": 65535.5, "curve": "linear"},
            r"black_level_dn must be between 0 and 65535 DN; got 65535\.5",
        ),
        ({"bits": 17}, "bits must be between 8 and 16; got 17"),
        ({"bits": 7}, "bits must be between 8 and 16; got 7"),
        ({"bits": 9.5}, r"^bits .*9\.5"),
        ({"bayer": "RGBG"}, "bayer must be one of none, RGGB, BGGR, GRBG, GBRG; got 'RGBG'"),
        ({"read_noise_e": 3.0}, "full_well_e"),
        ({"exposure": 0.0}, r"exposure must be between 1e-09 and 1e\+09; got 0"),
        ({"full_well_e": 1e20}, r"full_well_e must be between 10 and 1e\+09 electrons; got 1e\+20"),
        ({"full_well_e": np.nan}, "full_well_e must be a number; got nan"),
        ({"black_level_dn": 10.0}, "curve must be 'linear' with black_level_dn"),
        ({"black_level_dn": 200.0, "curve": "linear"}, "at most 127, half of the largest"),
        ({"black_level_dn": 127.6, "curve": "linear"}, r"at most 127, half .*; got 127\.6 DN"),
        ({"black_level_dn": -0.5, "curve": "linear"}, "black_level_dn must be between 0 and 65535"),
        ({"read_noise_e": -0.1, "full_well_e": 1e4}, "read_noise_e must be between 0 and"),
        ({"full_well_e": 1e9 + 0.5}, "full_well_e must be between 10 and"),
        ({"exposure": 1e9 + 0.5}, "exposure must be between"),
        ({"exposure": np.inf}, "exposure must be"),
        ({"read_noise_e": np.inf, "full_well_e": 1e4}, "read_noise_e must be"),
        (
            {"read_noise_e": 90.0, "full_well_e": 200.0, "curve": "linear"},
            "reduce black_level_dn or read_noise_e",
        ),
    ],
)
def test_invalid_detector_raises(changes, message):
    with pytest.raises(InvalidParameter, match=message):
        Detector(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"exposure": 1e-9},
        {"exposure": 1e9},
        {"full_well_e": 10.0},
        {"full_well_e": 1e9, "read_noise_e": 1e6},
        {"black_level_dn": 127.5, "curve": "linear"},
        {"black_level_dn": 0.0},
        {"bits": 16},
    ],
    ids=str,
)
def test_limits_of_parameters_are_valid(changes):
    assert {name: getattr(Detector(**changes), name) for name in changes} == changes


def test_conversion_order():
    """Random numbers are drawn row by row; a mosaic is an image of one channel."""
    for name, (in_order, is_grey) in {
        "sharp": (False, False),
        "noise": (True, False),
        "mosaic": (True, True),
        "noisy mosaic": (True, True),
    }.items():
        conversion = Readout(DETECTORS[name]).conversion
        assert (conversion.in_order, conversion.is_grey) == (in_order, is_grey)
        assert conversion.empty((4, 2)).shape == ((2, 4) if is_grey else (2, 4, 3))


# -- Block-wise readout of light equals the readout of the complete image --------------------------

SENSOR = replace(om.load_sensor("paper-spherical"), imager=Imager(121, 97, 60.0))
ROOM = om.Room(texel_mm=40.0)
DETECTORS = {
    "sharp": om.Detector(),
    "noise": om.Detector(exposure=1.4, full_well_e=9000.0, read_noise_e=5.0),
    "many electrons": om.Detector(full_well_e=2e5, read_noise_e=20.0, bits=16),
    "mosaic": om.Detector(bayer="GBRG", bits=12, curve="linear"),
    "noisy mosaic": om.Detector(
        full_well_e=4000.0, read_noise_e=3.0, bayer="RGGB", curve="linear", bits=10
    ),
}


@pytest.mark.parametrize(
    "more",
    [{}, pytest.param({"wavelengths_nm": (620.0, 540.0, 460.0)}, marks=pytest.mark.full)],
    ids=["grey", "coloured"],
)
@pytest.mark.parametrize("samples", [1, 1024], ids=["wide parts", "narrow parts"])
@pytest.mark.parametrize(
    "detector", few(DETECTORS.values(), DETECTORS["noisy mosaic"]), ids=DETECTORS
)
def test_readout_matches_detector(detector, samples, more):
    scene = (
        om.Environment(np.random.default_rng(2).random((16, 32, 3)).astype(np.float32))
        if samples == 1
        else ROOM
    )
    light = om.expose(SENSOR, scene, samples=samples, **more)
    readout = Readout(detector, seed=7)
    rows = []
    raw_light = render_light(
        SENSOR,
        scene,
        readout.conversion,
        samples=samples,
        on_progress=lambda done, _: rows.append(done),
        workers=3,
        **more,
    )
    numbers = readout.digital_values(raw_light)
    assert numbers.dtype == detector.dtype
    np.testing.assert_array_equal(numbers, detector.read(light, seed=7))
    assert rows[-1] == 97


def test_noise_is_independent_of_tiling():
    light, detector = (
        np.random.default_rng(3).random((30, 20, 3)).astype(np.float32),
        DETECTORS["noisy mosaic"],
    )
    readout = Readout(detector, seed=4)
    parts = [readout.conversion.read(light[a:b]) for a, b in ((0, 7), (7, 8), (8, 30))]
    np.testing.assert_array_equal(
        readout.digital_values(np.concatenate(parts)), detector.read(light, seed=4)
    )


def test_readout_memory():
    """Including odd sizes, for 1-byte numbers from 2-byte electrons, and for numbers of equal size."""
    light = np.random.default_rng(5).random((7, 5, 3)).astype(np.float32)
    for detector in (
        om.Detector(full_well_e=1e4),
        om.Detector(full_well_e=1e4, bits=12),
        om.Detector(full_well_e=1e9),
    ):
        readout = Readout(detector, seed=2)
        numbers = readout.digital_values(readout.conversion.read(light))
        assert numbers.shape == light.shape
        assert numbers.dtype == detector.dtype
        assert numbers.base.nbytes - numbers.nbytes < readout.conversion.dtype().itemsize
        np.testing.assert_array_equal(numbers, detector.read(light, seed=2))
