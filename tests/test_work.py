"""Cost of calls in evaluations, mirrors and bytes, which, unlike times, do not depend on the machine."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis.focus import FocusFunction
from omnimirror.base.colour import srgb_bytes
from omnimirror.base.native import backend
from omnimirror.calibration.edge_detection import edge_chains
from omnimirror.design.mirror_construction import LensAndCover, RimRay
from omnimirror.optics.batch.evaluate import Designs, evaluate_designs
from omnimirror.optics.batch.families import family
from omnimirror.optics.housing import Dome, Housing
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import TabulatedMapping
from omnimirror.optics.mirrors.mirror import Mirror
from omnimirror.optics.tracing.meridian import Meridian
from omnimirror.simulation.detector import Readout
from omnimirror.simulation.rendering import render_light


@pytest.fixture
def call_counts(monkeypatch):
    """Count calls of methods by name."""
    counts: Counter[str] = Counter()

    def count(owner: type, name: str) -> None:
        method = getattr(owner, name)

        def once_more(*args, **options):
            counts[name] += 1
            return method(*args, **options)

        monkeypatch.setattr(owner, name, once_more)

    counts.calls_of = count
    return counts


@contextmanager
def most_bytes(allowed: float):
    """Fail if the allocated memory grows by more than the given bytes."""
    tracemalloc.start()
    try:
        yield
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes <= allowed, f"peak of {peak_bytes:,} bytes exceeds {allowed:,.0f} bytes"


@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal", "paper-equidistant"])
def test_best_focus_traces_rays_twice(call_counts, name):
    """Once to approximate the mirror points for a single Newton step, and once at these points."""
    sensor = om.load_sensor(name)
    om.best_focus(sensor)  # fills the table cache
    call_counts.calls_of(Meridian, "_rays")
    call_counts.calls_of(FocusFunction, "__call__")
    om.best_focus(sensor)
    assert call_counts["_rays"] <= 2
    assert call_counts["__call__"] <= 25  # the initial scan is one call


def test_field_of_image_traces_only_boundary_rays(call_counts):
    call_counts.calls_of(om.Sensor, "backproject")
    call_counts.calls_of(om.Sensor, "project_directions")
    om.views.panorama(om.load_sensor("paper-spherical"))
    assert not call_counts


@pytest.mark.skipif(not backend.is_compiled, reason="not built")
def test_design_batch_memory_is_that_of_its_columns():
    c = [0.6409, 0.155, -0.01] * np.ones((2000, 1))
    designs = Designs(family("even-polynomial", 3), c, 172.0, 43.9, 11.6, 4.0, 5.2)
    evaluate_designs(designs, native=True)
    with most_bytes(1.05 * 10 * 2000 * 100 * 8):
        evaluate_designs(designs, native=True)


def test_dewarper_with_given_output_allocates_no_image():
    sensor = om.load_sensor("paper-spherical")
    dewarp = om.Dewarper(sensor, om.screens.Plane((640, 480), tilt_deg=-20))
    image = np.zeros((1024, 1024, 3), np.uint8)
    out = dewarp(image)
    with most_bytes(out.nbytes / 4):
        dewarp(image, out=out)


def test_field_is_found_without_full_map():
    sensor = om.load_sensor("paper-spherical")
    dewarp = om.Dewarper(sensor, om.screens.Plane((1280, 960), tilt_deg=40.0, hfov_deg=100.0))
    inside = np.isfinite(dewarp.coordinates()[..., 0])
    dewarp(np.zeros((1024, 1024), np.uint8))  # prepares the map
    with most_bytes(1024 * 1024 + 1.1 * inside.nbytes):
        valid = dewarp.valid
    np.testing.assert_array_equal(valid, inside)
    assert 0.3 < valid.mean() < 0.9


@pytest.mark.parametrize(
    ("detector", "allowed"),
    [(om.Detector(), 0.5), (om.Detector(full_well_e=1e4, read_noise_e=4.0), 1.0)],
)
def test_detector_readout_allocates_no_full_copies(detector, allowed):
    """Relative to the radiance image, the 8-bit image takes 25 %, and the electrons, which are
    converted to digital numbers in place, take 50 %."""
    light = np.full((1000, 1000, 3), 0.3, np.float32)
    detector.read(light[:2])
    with most_bytes(allowed * light.nbytes):
        detector.read(light)
    with most_bytes(0.5 * light.nbytes):
        srgb_bytes(light)


@pytest.mark.parametrize(
    "world",
    [om.Room(texel_mm=40.0), om.Environment(np.full((16, 32, 3), 0.4, np.float32))],
    ids=type,
)
def test_rendering_allocates_no_full_radiance_image(world):
    sensor = om.load_sensor("paper-spherical")
    imager = replace(sensor.imager, width_px=2048, height_px=2048, pixel_pitch_um=2.6)
    om.render_image(sensor, world, samples=1)  # one-time preparation
    with most_bytes(2 * 3 * 2048**2):
        om.render_image(replace(sensor, imager=imager), world, samples=1, workers=2)


def test_noisy_rendering_allocates_no_full_radiance_image():
    """2 bytes per value for electrons, which are converted in place to digital numbers, and
    temporary data.

    Temporary data are up to six rows of tiles and the buffers of the kernels, depending on the
    number of threads. A full radiance image alone would take 4 bytes per value.
    """
    sensor = om.load_sensor("paper-spherical")
    imager = replace(sensor.imager, width_px=2048, height_px=2048, pixel_pitch_um=2.6)
    detector = om.Detector(full_well_e=1e4, read_noise_e=4.0)

    def render_counts(camera: om.Sensor):
        readout = Readout(detector, seed=1)
        return readout.digital_values(
            render_light(camera, om.Room(texel_mm=40.0), readout.conversion, samples=1, workers=2)
        )

    render_counts(sensor)  # one-time preparation
    with most_bytes(3.5 * 3 * 2048**2):
        render_counts(replace(sensor, imager=imager))


def test_edge_detection_allocates_no_full_gradient_image():
    """2 bytes per pixel and gradient, 1 byte of flags, and a band of temporary data, instead of 41
    bytes for the whole image."""
    image = np.zeros((6000, 2000), np.uint8)
    image[:, 700:] = 200
    with most_bytes(14 * image.size):
        edge_chains(image)


def test_dome_coverage_is_traced_to_rim_only_at_solution(call_counts):
    """The surface is not checked for intermediate iterates, which would take most of the time."""
    rim = RimRay(120.0, 12.0, 30.0)
    exact = TabulatedMapping.from_function(lambda omega: omega, 120.0, 12.0, 30.0)
    around = LensAndCover(Perspective(1.0, 1.0, 10.0), Housing(shell=Dome(material="acrylic")))
    call_counts.calls_of(Mirror, "_check")
    mirror = around.made_for_mapping(exact, rim).mirror
    assert mirror is not exact
    assert call_counts["_check"] == 1
