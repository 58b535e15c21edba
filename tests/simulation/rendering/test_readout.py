"""Block-wise readout of light equals the readout of the complete image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.image_sensor import Imager
from omnimirror.simulation.rendering.exposure import exposed
from omnimirror.simulation.rendering.readout import Readout
from tests.everyday import few

SENSOR = replace(om.load_sensor("paper-spherical"), imager=Imager(121, 97, 60.0))
ROOM = om.Room(texel_mm=40.0)
DETECTORS = {
    "sharp": om.Detector(),
    "noise": om.Detector(exposure=1.4, full_well_e=9000.0, read_noise_e=5.0),
    "many electrons": om.Detector(full_well_e=2e5, read_noise_e=20.0, bits=16),
    "mosaic": om.Detector(bayer="GBRG", bits=12, curve="linear"),
    "noisy mosaic": om.Detector(full_well_e=4000.0, read_noise_e=3.0, bayer="RGGB", curve="linear", bits=10),
}


@pytest.mark.parametrize(
    "more",
    [{}, pytest.param({"wavelengths_nm": (620.0, 540.0, 460.0)}, marks=pytest.mark.full)],
    ids=["grey", "coloured"],
)
@pytest.mark.parametrize("samples", [1, 1024], ids=["wide parts", "parts beside each other"])
@pytest.mark.parametrize("detector", few(DETECTORS.values(), DETECTORS["noisy mosaic"]), ids=DETECTORS)
def test_it_is_the_same_as_of_all_light(detector, samples, more):
    scene = om.Environment(np.random.default_rng(2).random((16, 32, 3)).astype(np.float32)) if samples == 1 else ROOM
    light = om.expose(SENSOR, scene, samples=samples, **more)
    readout = Readout(detector, seed=7)
    rows = []
    taken = exposed(
        SENSOR, scene, readout.medium, samples=samples, progress=lambda done, _: rows.append(done), workers=3, **more
    )
    numbers = readout.numbers(taken)
    assert numbers.dtype == detector.dtype
    np.testing.assert_array_equal(numbers, detector.read(light, seed=7))
    assert rows[-1] == 97


def test_what_noise_is_drawn_does_not_hang_on_how_many_rows_come_at_once():
    light, detector = np.random.default_rng(3).random((30, 20, 3)).astype(np.float32), DETECTORS["noisy mosaic"]
    readout = Readout(detector, seed=4)
    parts = [readout.medium.read(light[a:b]) for a, b in ((0, 7), (7, 8), (8, 30))]
    np.testing.assert_array_equal(readout.numbers(np.concatenate(parts)), detector.read(light, seed=4))


def test_numbers_hold_no_more_memory_than_they_need():
    """Including odd sizes, for 1-byte numbers from 2-byte electrons, and for numbers of equal size."""
    light = np.random.default_rng(5).random((7, 5, 3)).astype(np.float32)
    for detector in (om.Detector(full_well_e=1e4), om.Detector(full_well_e=1e4, bits=12), om.Detector(full_well_e=1e9)):
        readout = Readout(detector, seed=2)
        numbers = readout.numbers(readout.medium.read(light))
        assert numbers.shape == light.shape
        assert numbers.dtype == detector.dtype
        assert numbers.base.nbytes - numbers.nbytes < readout.medium.dtype().itemsize
        np.testing.assert_array_equal(numbers, detector.read(light, seed=2))
