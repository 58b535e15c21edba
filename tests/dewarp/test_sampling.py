"""Compiled samplers with unusual memory layouts, and threads.

Their values for all maps and images are tested in tests/contracts.
"""

from __future__ import annotations

import multiprocessing
import os
import threading

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.dewarp.interfaces import INTERPOLATIONS
from omnimirror.dewarp.maps import PixelMap, PolarMap, node_weights
from omnimirror.dewarp.sampling import remap
from omnimirror.simulation.rendering import render_pinhole_image
from tests.everyday import few
from tests.samplers import instructions as all_instructions
from tests.samplers import remap_at

# -- Compiled samplers with unusual memory layouts, and threads ------------------------------------
#
# Their values for all maps and images are tested in tests/contracts.

MODULE = backend.module
INSTRUCTIONS = all_instructions()
FULL = {"uint8": 255, "uint16": 65535, "float32": 1.0}
KINDS = [(depth, channels) for depth in FULL for channels in (1, 2, 3, 4)]
COMPILED_INTERPOLATIONS = ["nearest", "linear", "cubic"]

pytestmark = pytest.mark.skipif(MODULE is None, reason="requires the compiled module")


@pytest.fixture(params=INSTRUCTIONS)
def instructions(request):
    """All instruction sets of this machine."""
    before = MODULE.instruction_set()
    MODULE.set_instruction_set(request.param)
    yield request.param
    MODULE.set_instruction_set(before)


# -- reference values ------------------------------------------------------------------------------


def keys(t):
    """Return the four weights of the cubic kernel with a = -0.75 by its definition; (4, n)."""
    a = -0.75
    d = np.abs(np.array([-1, 0, 1, 2])[:, None] - t)
    return np.where(d <= 1, (a + 2) * d**3 - (a + 3) * d**2 + 1, a * (d**3 - 5 * d**2 + 8 * d - 4))


def truth(image, coordinates, interpolation, border=0.0):
    """Return values by the definition of the samplers, in float64 without rounding; (rows, columns,
    channels)."""
    image = np.atleast_3d(image)
    height, width = image.shape[:2]
    u, v = np.asarray(coordinates, np.float64).reshape(-1, 2).T
    with np.errstate(invalid="ignore"):
        inside = (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)
    u, v = np.where(inside, u, 0).clip(0, width - 1), np.where(inside, v, 0).clip(0, height - 1)
    if interpolation == "nearest":
        values = image[(v + 0.5).astype(int), (u + 0.5).astype(int)].astype(float)
    else:
        x, y = np.floor(u).astype(int), np.floor(v).astype(int)
        if interpolation == "linear":
            first, wx, wy = 0, np.stack([1 - (u - x), u - x]), np.stack([1 - (v - y), v - y])
        else:
            first, wx, wy = -1, keys(u - x), keys(v - y)
        values = np.zeros((len(u), image.shape[2]))
        for j, down in enumerate(wy):
            for k, across in enumerate(wx):
                tap = image[(y + j + first).clip(0, height - 1), (x + k + first).clip(0, width - 1)]
                values += (down * across)[:, None] * tap
        if image.dtype != np.float32:
            values = values.clip(0, FULL[image.dtype.name])
    values[~inside] = border
    return values.reshape(*np.shape(coordinates)[:2], -1)


def photograph(depth="uint8", channels=3, size=(230, 170)):
    """Return smooth structure of many scales with noise."""
    width, height = size
    rng = np.random.default_rng(5)
    levels = [
        cv2.resize(rng.random((n, n, channels)), size, interpolation=cv2.INTER_CUBIC)
        for n in (3, 9, 31, 90)
    ]
    image = sum(
        np.reshape(level, (height, width, channels)) / (k + 1) for k, level in enumerate(levels)
    )
    image = (image - image.min()) / np.ptp(image) + rng.normal(0, 0.01, image.shape)
    image = image.clip(0, 1) * FULL[depth]
    return (image if depth == "float32" else np.rint(image)).astype(depth)


def spiral(size, shape=(61, 133), max_radius=1.1):
    """Return coordinates all over an image and beyond its borders, some of them NaN."""
    rows, columns = shape
    angle = np.linspace(0, 40, rows * columns).reshape(shape)
    radius = np.linspace(0, max_radius, rows * columns).reshape(shape)
    width, height = size
    pixels = np.stack(
        [
            (width - 1) / 2 + width / 2 * radius * np.cos(angle),
            (height - 1) / 2 + height / 2 * radius * np.sin(angle),
        ],
        axis=-1,
    )
    odd = [np.nan, np.inf, -np.inf, 1e30, -1e30, 2.0**31, -(2.0**31), 2.0**32]
    for i, value in enumerate(odd):
        pixels[7, 10 * i, i % 2] = value
    pixels[9, 3:60] = np.nan
    return pixels.astype(np.float32)


# -- values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_max_sampling_error(channels, interpolation, instructions):
    """Black and white noise: 1/510 px of error in both directions, and rounding."""
    image = np.random.default_rng(0).choice([0, 255], (90, 110, channels)).astype(np.uint8)
    coordinates = spiral((110, 90), (200, 200))
    output = remap_at(image, coordinates, interpolation).astype(float)
    expected = truth(image, coordinates, interpolation).clip(0, 255)
    assert np.abs(output - expected).max() < (1.6 if interpolation == "linear" else 2.2)


def test_instruction_sets_agree():
    """Compare the vector kernels with the plain kernels, which use ordinary arithmetic."""
    before = MODULE.instruction_set()
    for channels in (1, 2, 3, 4):
        image, coordinates = photograph(channels=channels), spiral((230, 170))
        for interpolation in COMPILED_INTERPOLATIONS:
            outputs = []
            for name in INSTRUCTIONS:
                MODULE.set_instruction_set(name)
                packed = MODULE.PackedMap(
                    coordinates,
                    230,
                    170,
                    channels,
                    False,
                    COMPILED_INTERPOLATIONS.index(interpolation),
                )
                out = np.empty((*coordinates.shape[:2], channels), np.uint8)
                packed.sample(image, out, 0)
                outputs.append(out)
            for other in outputs[1:]:
                assert np.abs(other.astype(int) - outputs[0]).max() <= 1
                assert (
                    other != outputs[0]
                ).mean() < 1e-3  # fractions of 0.5 may be rounded either way
    MODULE.set_instruction_set(before)


# -- memory ----------------------------------------------------------------------------------------


def guarded(shape, dtype, padding=97):
    """Return an array surrounded by guard bytes, and a function that checks them."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.full(size + 2 * padding, 0xA5, np.uint8)
    offset = padding - (memory.ctypes.data + padding) % np.dtype(dtype).itemsize
    array = memory[offset : offset + size].view(dtype).reshape(shape)
    return (
        array,
        lambda: (memory[:offset] == 0xA5).all() and (memory[offset + size :] == 0xA5).all(),
    )


SIZES = st.one_of(st.integers(1, 40), st.sampled_from([63, 64, 65, 127, 128, 129, 200]))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_random_sizes_stay_within_memory(data):
    """Sizes from 1 x 1, odd widths, padded rows, all types, all maps: correct values and unchanged
    guards."""
    name = data.draw(st.sampled_from(INSTRUCTIONS))
    depth, channels = data.draw(st.sampled_from(KINDS))
    interpolation = data.draw(st.sampled_from(COMPILED_INTERPOLATIONS))
    width, height, columns, rows = (data.draw(SIZES) for _ in range(4))
    gap, out_gap = data.draw(st.integers(0, 5)), data.draw(st.integers(0, 5))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    memory, intact = guarded((height, width + gap, channels), depth)
    image = memory[:, :width]
    image[:] = photograph(depth, channels, (max(width, 4), max(height, 4)))[:height, :width]
    coordinates = rng.uniform(-2, max(width, height) + 1, (rows, columns, 2)).astype(np.float32)
    coordinates[rng.random((rows, columns)) < 0.1] = np.nan
    coordinates[rng.random((rows, columns)) < 0.2] = (width - 1, height - 1)
    coordinates[rng.random((rows, columns)) < 0.2] = (width - 0.5, height - 0.5)
    target, is_intact = guarded((rows, columns + out_gap, channels), depth)
    target[:] = 0
    expected = truth(image, coordinates, interpolation)
    before = MODULE.instruction_set()
    MODULE.set_instruction_set(name)
    try:
        for output in (
            remap_at(image, coordinates, interpolation, target[:, :columns]),
            remap(
                image, PixelMap(coordinates, (width, height)), interpolation, target[:, :columns]
            ),
        ):
            if interpolation == "nearest":
                np.testing.assert_array_equal(output, expected)
            else:
                np.testing.assert_allclose(
                    output,
                    expected,
                    rtol=0,
                    atol={"uint8": 1.6, "uint16": 4.0, "float32": 6e-5}[depth],
                )
    finally:
        MODULE.set_instruction_set(before)
    assert intact()
    assert is_intact()
    assert (target[:, columns:] == 0).all()


@pytest.mark.parametrize("interpolation", COMPILED_INTERPOLATIONS)
def test_strided_arrays_give_same_result(interpolation, instructions):
    image = photograph(size=(60, 50))
    coordinates = spiral((60, 50))
    expected = remap_at(image, coordinates, interpolation)
    wide = np.zeros((50, 130, 5), np.uint8)
    wide[:, 3:123:2, 1:4] = image
    apart = np.frombuffer(
        bytes(1) + np.pad(image, ((0, 0), (0, 7), (0, 0))).tobytes(), np.uint8, offset=1
    )
    views = [
        np.asfortranarray(image),
        wide[:, 3:123:2, 1:4],
        image[::-1].copy()[::-1],
        image[:, ::-1].copy()[:, ::-1],
        image[..., ::-1].copy()[..., ::-1],
        apart.reshape(50, 67, 3)[:, :60],
    ]
    fixed = PixelMap(coordinates, (60, 50))
    for view in views:
        np.testing.assert_array_equal(remap_at(view, coordinates, interpolation), expected)
        np.testing.assert_array_equal(remap(view, fixed, interpolation), expected)
    shape = expected.shape
    for out in (
        np.zeros(shape, np.uint8, order="F"),
        np.zeros((*shape[:2], 6), np.uint8)[..., ::2],
        np.zeros(shape, np.uint8)[::-1, ::-1],
    ):
        assert remap_at(image, coordinates, interpolation, out) is out
        np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(
        remap_at(image, np.asfortranarray(coordinates), interpolation), expected
    )
    doubled = np.repeat(coordinates, 2, axis=0)[::2]
    np.testing.assert_array_equal(remap_at(image, doubled, interpolation), expected)


def test_misaligned_16_bit_array_raises(instructions):
    image = photograph("uint16", size=(60, 50))
    memory = np.zeros(image.nbytes + 1, np.uint8)
    odd = np.ndarray(image.shape, np.uint16, memory.data, offset=1)
    odd[:] = image
    coordinates = spiral((60, 50))
    np.testing.assert_array_equal(remap_at(odd, coordinates), remap_at(image, coordinates))
    also_odd = np.ndarray(
        coordinates.shape, np.float32, bytearray(coordinates.nbytes + 1), offset=1
    )
    also_odd[:] = coordinates
    np.testing.assert_array_equal(remap_at(image, also_odd), remap_at(image, coordinates))
    with pytest.raises(ValueError, match="aligned"):
        MODULE.remap(odd, coordinates, np.empty((*coordinates.shape[:2], 3), np.uint16), 1, 0)
    swapped = image.astype(image.dtype.newbyteorder())
    np.testing.assert_array_equal(remap_at(swapped, coordinates), remap_at(image, coordinates))


def test_in_place_remap(instructions):
    image = photograph(size=(60, 50))
    coordinates = np.ascontiguousarray(spiral((60, 50), (50, 90))[:, :60])
    expected = remap_at(image, coordinates)
    np.testing.assert_array_equal(remap_at(image, coordinates, out=image), expected)


@pytest.mark.parametrize("interpolation", COMPILED_INTERPOLATIONS)
def test_images_wider_than_16_bit_index(interpolation, instructions):
    for size in ((40_001, 21), (21, 40_001), (70_000, 2)):
        width, height = size
        rows = np.linspace(0, 250, height, dtype=np.uint8)[:, None]
        image = np.dstack([np.broadcast_to(rows, (height, width))] * 3) // 2
        image = image + (np.arange(width) % 97).astype(np.uint8)[None, :, None]
        u = np.linspace(-1, width, 1000)
        coordinates = np.stack([u, np.linspace(-1, height, 1000)], axis=-1)[None]
        expected = truth(image, coordinates, interpolation)
        output = remap_at(image, coordinates, interpolation)
        assert (np.abs(output - expected) > 1.5).mean() < 1e-3
        wide = remap_at(
            image, np.repeat(coordinates, 40, axis=1), interpolation
        )  # and an output of the same width
        np.testing.assert_array_equal(wide[:, ::40], output)


def test_too_many_values_raise():
    huge = np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (70_000, 70_000), (0, 0))
    with pytest.raises(
        InvalidParameter, match=r"must have at most .* values; got .* in 70000 x 70000 px"
    ):
        remap_at(huge, np.zeros((1, 1, 2), np.float32))


def test_empty_outputs(instructions):
    image = photograph(size=(60, 50))
    for shape in ((0, 5, 2), (5, 0, 2), (0, 0, 2)):
        assert remap_at(image, np.zeros(shape, np.float32)).shape == (*shape[:2], 3)
    circles = PolarMap((3.0, 3.0), np.zeros(0), np.ones(1), (60, 50))
    assert remap(image, circles).shape == (0, 1, 3)


def test_empty_fields(instructions):
    image = photograph(size=(60, 50))
    for value in (np.nan, np.inf, -1.0):
        out = np.full((20, 70, 3), 77, np.uint8)
        remap_at(image, np.full((20, 70, 2), value, np.float32), "cubic", out, border=3)
        assert (out == 3).all()


def test_compiled_module_checks_bounds():
    image, coordinates = photograph(size=(60, 50)), spiral((60, 50))
    out = np.empty((*coordinates.shape[:2], 3), np.uint8)
    x, y = np.zeros((2, 7, 7), np.float32)
    cells, patches = np.full((4, 4), -1, np.int32), np.empty((0, 16, 16, 2), np.float32)
    far = np.zeros((4, 4), np.int32)
    weights, whole = [node_weights(16)] * 2, np.empty((50, 60, 3), np.uint8)
    MODULE.remap_lattice(
        image, x, y, *weights, cells, patches, whole, 1, 0
    )  # valid arguments are accepted
    for call in (
        lambda: MODULE.remap(image, coordinates[1:], out, 1, 0),
        lambda: MODULE.remap(image[:, ::2], coordinates, out, 1, 0),
        lambda: MODULE.remap(image, coordinates, out[..., :1], 1, 0),
        lambda: MODULE.remap(image, coordinates, out, 3, 0),
        lambda: MODULE.remap(image, np.zeros(coordinates.shape, np.int32), out, 1, 0),
        lambda: MODULE.remap_polar(image, *[np.zeros(9, np.float32)] * 3, 1, 1, out, 1, 0),
        lambda: MODULE.PackedMap(coordinates, 61, 50, 3, False, 1).sample(image, out, 0),
        lambda: MODULE.PackedMap(coordinates, 60, 50, 3, True, 1).sample(image, out, 0),
        lambda: MODULE.PackedMap(coordinates, 60, 50, 5, False, 1),
        lambda: MODULE.PackedMap(coordinates, 1 << 29, 50, 3, False, 1),
        lambda: MODULE.remap_lattice(image, x, y, *weights, far, patches, whole, 1, 0),
        lambda: MODULE.remap_lattice(image, x[1:], y, *weights, cells, patches, whole, 1, 0),
        lambda: MODULE.remap_lattice(
            image, x, y, weights[0], weights[1][:, :8], cells, patches, whole, 1, 0
        ),
        lambda: MODULE.remap_lattice(image, x, y, *weights, cells, patches, whole[:32], 1, 0),
    ):
        with pytest.raises(
            (ValueError, TypeError),
            match=r"coordinates|cell|weights|interpolation|pixels|radius|radii|src|must",
        ):
            call()


@pytest.mark.parametrize("interpolation", [0, 1, 2])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_sides_beyond_float32_precision(interpolation, dtype, instructions):
    """Integer positions at float32 gaps of 1 and 2 pixels yield their pixel, and those beyond the
    last one none."""
    width = 2**24 + 5
    image = np.zeros((16, width, 1), dtype)  # few pages are touched
    beyond = width + 1, width + 3, 2.0**30
    positions_px = np.array(
        [[2**23 - 0.5, 2**23 + 1, 2**23 + 3, 2**24 - 1, width - 1, *beyond]], np.float32
    )
    last = [int(x) for x in positions_px[0, 1:5]]
    image[0, last, 0] = [11, 12, 13, 14]
    out = np.empty((1, 8, 1), dtype)
    MODULE.remap(
        image,
        np.stack([positions_px, np.zeros_like(positions_px)], axis=-1),
        out,
        interpolation,
        99,
    )
    assert out[0, 1:5, 0].tolist() == [11, 12, 13, 14]
    assert out[0, 5:, 0].tolist() == [99] * 3


@pytest.mark.parametrize("interpolation", [0, 1, 2])
@pytest.mark.parametrize("at", [0, 24, 48, -1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e30, 3e38])
def test_nan_nodes(value, at, interpolation, instructions):
    """Cells with such a node are undefined, others are unchanged."""
    image, step = photograph(size=(400, 300)), 16
    shape = 4 + 3, 8 + 3
    x, y = np.meshgrid(
        *(np.linspace(100, last, n, dtype=np.float32) for last, n in ((300, 11), (200, 7)))
    )
    cells, patches = np.full((4, 8), -1, np.int32), np.empty((0, step, step, 2), np.float32)
    weights = node_weights(step)
    whole, odd = np.empty((2, 64, 128, 3), np.uint8)
    MODULE.remap_lattice(image, x, y, weights, weights, cells, patches, whole, interpolation, 0)
    x.reshape(-1)[at] = value
    MODULE.remap_lattice(image, x, y, weights, weights, cells, patches, odd, interpolation, 0)
    row, column = np.unravel_index(np.arange(x.size)[at], shape)
    near = np.zeros((4, 8), bool)
    near[max(row - 3, 0) : row + 1, max(column - 3, 0) : column + 1] = True
    is_near = np.repeat(np.repeat(near, step, axis=0), step, axis=1)
    assert np.abs(odd[~is_near].astype(int) - whole[~is_near]).max() <= 1
    if np.isnan(value):
        assert not odd[is_near].any()


def test_invalid_weights_raise():
    image, step = photograph(size=(400, 300)), 16
    x, y = np.full((2, 7, 11), 150, np.float32)
    cells, patches, good = (
        np.full((4, 8), -1, np.int32),
        np.empty((0, step, step, 2), np.float32),
        node_weights(step),
    )
    out = np.empty((64, 128, 3), np.uint8)
    for value, where in (
        (1e6, good > 2),
        (0.01, good > 0.5),
        (np.nan, good > 0.5),
        (-np.inf, good < 0),
    ):
        weights_of_wrong_shape = (
            np.where(where, np.float32(value), good) if where.any() else good * np.float32(value)
        )
        for weights in ((weights_of_wrong_shape, good), (good, weights_of_wrong_shape)):
            with pytest.raises(ValueError, match=r"must sum to 1|must be finite"):
                MODULE.remap_lattice(image, x, y, *weights, cells, patches, out, 1, 0)
    far = np.array([[1e5], [0], [0], [1 - 1e5]], np.float32).repeat(
        step, axis=1
    )  # sum 1, far from Lagrange weights
    x, y = np.meshgrid(
        *(np.linspace(100, last, n, dtype=np.float32) for last, n in ((300, 11), (200, 7)))
    )
    MODULE.remap_lattice(image, x, y, far, far, cells, patches, out, 1, 7)
    assert (out == 7).all()


@pytest.mark.parametrize("count", few([0, 1, 7, 8, 9, 511, 513, 1030], 0, 9, 513))
@pytest.mark.parametrize("is_near", [False, True])
def test_random_target_counts_stay_within_memory(count, is_near, instructions):
    """All in one call, against one call each."""
    q = np.linspace(0.0, 0.9, 50)
    origins = np.stack([40 * q, -20 * q**2], axis=-1)  # approximately a paraboloid
    camera = MODULE.AxialCamera(
        np.eye(3), 499.5, 499.5, 1000, 1000, 0.0, 0.9, 500 * q / 0.9, origins, 3.0
    )
    targets, _ = guarded((count, 3), "float64")
    targets[:] = np.random.default_rng(count).normal(size=(count, 3)) * 100
    targets[::5] = (np.nan, 1.0, 2.0)
    (pixels, intact), (excess, is_unchanged) = (
        guarded((count, 2), "float64"),
        guarded((count,), "float64"),
    )
    camera.project(targets, is_near, pixels, excess)
    assert intact()
    assert is_unchanged()
    alone, distance = np.empty((1, 2)), np.empty(1)
    for target, pixel, far in zip(targets, pixels, excess, strict=True):
        camera.project(target[None], is_near, alone, distance)
        np.testing.assert_allclose(alone[0], pixel, atol=1e-9)
        np.testing.assert_allclose(distance[0], far, atol=1e-9)
    assert count < 7 or np.isfinite(pixels).any()


def test_invalid_tables_raise():
    table = np.eye(3), 5.0, 5.0, 11, 11, 0.0, 0.9
    good = MODULE.AxialCamera(*table, np.arange(4.0), np.empty((0, 2)), 0.0)
    for call in (
        lambda: MODULE.AxialCamera(*table, np.zeros(1), np.empty((0, 2)), 0.0),
        lambda: MODULE.AxialCamera(*table, np.arange(4.0), np.zeros((1, 2)), 0.0),
        lambda: MODULE.AxialCamera(*table, np.array([0.0, np.nan]), np.empty((0, 2)), 0.0),
        lambda: MODULE.AxialCamera(*table[:5], 0.9, 0.9, np.arange(4.0), np.empty((0, 2)), 0.0),
        lambda: good.project(np.zeros((3, 3)), False, np.zeros((2, 2)), None),
        lambda: good.project(np.zeros((3, 3)), False, np.zeros((3, 2)), np.zeros(2)),
        lambda: good.project(np.zeros((3, 2)), False, np.zeros((3, 2)), None),
    ):
        with pytest.raises(ValueError, match=r"table|origins|radii|targets|pixels|excess|last"):
            call()


# -- threads ---------------------------------------------------------------------------------------


@pytest.fixture
def three_threads():
    before = backend.threads
    yield backend.set_threads
    backend.set_threads(before)


@pytest.mark.parametrize("interpolation", COMPILED_INTERPOLATIONS)
def test_threads_give_identical_results(interpolation, instructions, three_threads):
    image, coordinates = photograph(size=(300, 200)), spiral((300, 200), (333, 401))
    fixed = PixelMap(coordinates, (300, 200))
    three_threads(1)
    expected = remap(image, fixed, interpolation)
    for count in (2, 4, 7):
        three_threads(count)
        assert backend.threads == count
        for _ in range(20):
            np.testing.assert_array_equal(remap(image, fixed, interpolation), expected)


def test_concurrent_callers_do_not_deadlock(three_threads):
    three_threads(3)
    image, coordinates = photograph(size=(300, 200)), spiral((300, 200), (333, 401))
    fixed = PixelMap(coordinates, (300, 200))
    expected = remap(image, fixed)
    right = []

    def work():
        right.extend(np.array_equal(remap(image, fixed), expected) for _ in range(50))

    callers = [threading.Thread(target=work) for _ in range(5)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(60)
    assert sum(right) == 250
    assert not any(caller.is_alive() for caller in callers)


def _sum_in_a_child(queue):
    image, coordinates = photograph(size=(300, 200)), spiral((300, 200), (333, 401))
    queue.put(int(remap_at(image, coordinates).sum()))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="requires os.fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_forked_processes_have_own_threads(three_threads):
    three_threads(3)
    image, coordinates = photograph(size=(300, 200)), spiral((300, 200), (333, 401))
    expected = int(remap_at(image, coordinates).sum())
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    child = context.Process(target=_sum_in_a_child, args=(queue,))
    child.start()
    child.join(60)
    assert child.exitcode == 0
    assert queue.get() == expected
    assert int(remap_at(image, coordinates).sum()) == expected


# -- Dewarped images against the true view: the densely sampled scene ------------------------------

S = om.screens
SAMPLES = 4
CAMERA = om.MirrorBall(
    centre_px=(149.5, 149.5), rim_radius_px=142.0, field_deg=270.0, image_size=(300, 300)
)
VIEWS = {
    "magnified": S.Plane((160, 120), 20.0, -15.0, 0.0, 45.0),
    "about 1 to 1": S.Cylinder((360, 135), -90.0, 45.0),
    "both, in one view": S.Plane((150, 96), 20.0, -40.0, 0.0, 140.0),
    "2 to 1": S.DomeMaster((140, 140), 135.0, "nadir"),
    "4 to 1": S.Cylinder((100, 36), -90.0, 45.0),
    "7 to 1": S.DomeMaster((42, 42), 135.0, "nadir"),
}


@pytest.fixture(scope="module")
def room():
    return om.Room()


@pytest.fixture(scope="module")
def image(room):
    return om.render_image(CAMERA, room, samples=SAMPLES**2, distant=True)


def decibels(room, image):
    """Return the PSNR of all interpolations in all views, by omnimirror and OpenCV; {view:
    {interpolation: dB}}."""
    table = {}
    for name, screen in VIEWS.items():
        width, height = screen.size
        u, v = ((np.arange(n * SAMPLES) + 0.5) / SAMPLES - 0.5 for n in (width, height))
        truth = render_pinhole_image(room, screen.targets_at(*np.meshgrid(u, v)), SAMPLES)
        pixels = om.Dewarper(CAMERA, screen).coordinates()
        inside = np.isfinite(pixels[..., 0])
        maps = np.moveaxis(np.nan_to_num(pixels, nan=-10.0).astype(np.float32), -1, 0)
        images = {kind: om.Dewarper(CAMERA, screen, kind)(image) for kind in INTERPOLATIONS}
        images["cv2 lanczos"] = cv2.remap(image, *maps, cv2.INTER_LANCZOS4)
        table[name] = {
            kind: 10
            * np.log10(255**2 / np.mean((output[inside].astype(float) - truth[inside]) ** 2))
            for kind, output in images.items()
        }
    return table


def test_auto_interpolation_has_highest_psnr(room, image):
    table = decibels(room, image)
    for name, row in table.items():
        assert row["auto"] > max(row.values()) - 0.3, (name, row)
    assert table["magnified"]["cubic"] > table["magnified"]["linear"] + 0.7
    for name in ("2 to 1", "4 to 1", "7 to 1"):
        assert table[name]["auto"] > table[name]["cubic"] + 2, table[name]
    mixed = table["both, in one view"]
    assert mixed["auto"] > max(mixed["linear"], mixed["cubic"], mixed["area"]), mixed
