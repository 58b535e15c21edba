"""Maps against closed forms: cubic lattices, circles, half resolution, and the choice of kernels."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from omnimirror.dewarp import maps
from omnimirror.dewarp.interfaces import Annulus, RemapJob
from omnimirror.dewarp.maps import (
    LatticeMap,
    PixelMap,
    PolarMap,
    Rectangle,
    halved_pixels,
    node_weights,
)
from omnimirror.dewarp.sampling import remap

ANNULUS = Annulus(20.0, 10.0, 4.0, 9.0)
HALF_ANNULUS = Annulus(9.875, 4.5, 2.0, 4.5)
"""The same annulus for samples that are offset by (0.25, 1) px."""


def lattice(at, size, source_size, step, shift=(0.0, 0.0), annulus=None):
    """Return a lattice of a function of output positions, without patches."""
    down, across = -(-size[1] // step), -(-size[0] // step)
    x, y = np.meshgrid((np.arange(across + 3) - 1.0) * step, (np.arange(down + 3) - 1.0) * step)
    cells, patches = np.full((down, across), -1, np.int32), np.empty((0, step, step, 2), np.float32)
    nodes = np.stack(at(x, y)).astype(np.float32)
    return LatticeMap(nodes, size, source_size, step, cells, patches, shift, annulus)


def cubic(x, y):
    """Return a map that is cubic in both directions, which the lattice reproduces."""
    u, v = x / 40.0, y / 30.0
    return 20 + 9 * u - 3 * u**3 * v**2 + 2 * v**3, 15 + 7 * v**3 - 4 * u**2 * v + 3 * u**3


def affine(x, y):
    return 3.4817 + 0.07 * (x - 64.0) + 0.01 * y, 2.4713 - 0.08 * (y - 60.0) + 0.01 * x


def positions(size, shift=(0.0, 0.0)):
    return np.meshgrid(np.arange(size[0]) + shift[0], np.arange(size[1]) + shift[1])


@pytest.mark.parametrize("step", [4, 8])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, 0.75)])
def test_lattice_reproduces_cubic_maps(step, shift):
    """A node outside the field affects the 4 x 4 cells that it is a corner of; patches replace cells."""
    size = (43, 37)
    grid = lattice(cubic, size, (60, 50), step, shift)
    expected = np.stack(cubic(*positions(size, shift)), axis=-1)
    np.testing.assert_allclose(grid.pixels(), expected, rtol=0, atol=2e-4)
    np.testing.assert_allclose(node_weights(step, shift[0]).sum(axis=0), 1.0, atol=1e-6)
    assert node_weights(step)[:, 0].tolist() == [0.0, 1.0, 0.0, 0.0]  # at a node
    for component in (0, 1):
        nodes = grid.nodes.copy()
        nodes[component, 2, 4] = np.nan
        cells = grid.cells.copy()
        cells[1, 2], cells[1, 3] = 1, 0
        patches = np.stack([np.full((step, step, 2), value, np.float32) for value in (7.0, np.nan)])
        cut = LatticeMap(nodes, size, (60, 50), step, cells, patches, shift)
        invalid = np.zeros(expected.shape[:2], bool)
        invalid[: 3 * step, step : 5 * step] = True
        invalid[step : 2 * step, 3 * step : 4 * step] = False
        assert (np.isnan(cut.pixels()) == invalid[..., None]).all()
        assert (cut.pixels()[step : 2 * step, 3 * step : 4 * step] == 7.0).all()
        assert cut.pixels().shape == (37, 43, 2)


def test_lattice_with_valid_pixels():
    grid = lattice(cubic, (8, 8), (60, 50), 4)
    empty, full = np.full((2, 4, 4, 2), np.nan, np.float32), np.zeros((2, 4, 4, 2), np.float32)
    patched = np.array([[0, 1], [1, 0]], np.int32)
    part = np.array([[0, 1], [1, -1]], np.int32)

    def is_visible(cells, patches):
        return LatticeMap(grid.nodes, (8, 8), (60, 50), 4, cells, patches).has_valid_pixels()

    assert grid.has_valid_pixels()
    assert not is_visible(patched, empty)
    assert is_visible(patched, full)
    assert is_visible(patched, np.concatenate([empty[:1], full[:1]]))
    assert is_visible(part, empty)


def test_halved_lattice_evaluates_between_pixels():
    """Also of a lattice whose pixels are offset already; the smallest step needs a pixel map."""
    size, shift = (41, 38), (0.25, 0.5)
    grid = lattice(cubic, size, (60, 51), 8, shift, ANNULUS)
    halved = grid.halved((0.25, 1.0), (0.5, 0.75))
    assert isinstance(halved, LatticeMap)
    assert (halved.step, halved.size, halved.source_size) == (4, (21, 19), (30, 26))
    assert halved.annulus == HALF_ANNULUS
    x, y = positions((21, 19))
    u, v = cubic(2 * x + 0.5 + shift[0], 2 * y + 0.75 + shift[1])
    expected = np.stack([(u - 0.25) / 2, (v - 1.0) / 2], axis=-1)
    np.testing.assert_allclose(halved.pixels(), expected, rtol=0, atol=2e-4)
    assert lattice(cubic, size, (60, 51), 8).halved((0.0, 0.0), (0.0, 0.0)).annulus is None
    last = halved.halved((0.25, 1.0), (0.5, 0.0))
    assert isinstance(last, PixelMap)
    assert (last.size, last.source_size) == ((11, 10), (15, 13))
    u, v = expected[::2].transpose(2, 0, 1)
    between = (u[:, :-1:2] + u[:, 1::2]) / 2, (v[:, :-1:2] + v[:, 1::2]) / 2
    np.testing.assert_allclose(
        last.pixels()[:, :10],
        np.stack([(between[0] - 0.25) / 2, (between[1] - 1.0) / 2], axis=-1),
        rtol=0,
        atol=2e-4,
    )


@pytest.mark.parametrize("siting", [(0.5, 0.5), (0.0, 1.0)])
def test_halved_lattice_ends_with_the_image(siting):
    """A map that leaves a small image on all sides, slowly: cells with a node outside are patched, with
    the validity of a pixel map; all others are interpolated."""
    size, source_size = (136, 120), (8, 6)
    grid = lattice(affine, size, source_size, 8, annulus=ANNULUS)
    halved = grid.halved(siting, siting)
    expected = halved_pixels(grid.pixels(), siting, siting, source_size)
    assert 0.3 < np.isnan(expected).mean() < 0.7
    np.testing.assert_allclose(halved.pixels(), expected, rtol=0, atol=1e-5)
    u, v = grid.nodes
    inside = (u >= -0.5) & (u <= 7.5) & (v >= -0.5) & (v <= 5.5)
    for row, column in np.ndindex(grid.cells.shape):
        is_inside = inside[row : row + 4, column : column + 4].all()
        assert (halved.cells[row, column] == -1) == is_inside
    assert sorted(halved.cells[halved.cells >= 0]) == list(range(len(halved.patches)))
    assert halved.patches.dtype == np.float32
    for corner in ((-0.5, -0.5), (7.5, 5.5)):  # the image ends there
        edge = lattice(lambda x, y, c=corner: (c[0] + 0 * x, c[1] + 0 * y), size, source_size, 8)
        assert (edge.halved(siting, siting).cells == -1).all()
    repeated = LatticeMap(
        grid.nodes, size, source_size, 8, np.zeros_like(grid.cells), np.full((1, 8, 8, 2), 3.0)
    ).halved(siting, siting)
    assert (repeated.cells == 0).all()  # patched already
    np.testing.assert_array_equal(repeated.patches[0, 0, 0], (3.0 - np.array(siting)) / 2)


def test_halved_samples_at_field_boundary():
    """Two of four pixels are sufficient: their mean, which has no position between the others."""
    u, v = np.meshgrid([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], [10.0, 20.0])
    pixels = np.stack([u, v], axis=-1)
    pixels[0, 0] = np.nan
    pixels[:, 2] = (-0.6, 10.0)  # outside the image
    pixels[0, 4:], pixels[1, 4] = np.nan, (8.0, 99.6)
    halved = halved_pixels(pixels, (1.0, 0.0), (0.5, 0.5), (100, 100))
    np.testing.assert_allclose(
        halved, [[[(4 / 3 - 1) / 2, 25 / 3], [2.5, 7.5], [np.nan, np.nan]]], rtol=1e-12
    )
    lone = halved_pixels(np.array([[[5.0, 7.0]]], np.float32), (0.5, 0.0), (0.5, 0.5), (9, 9))
    assert lone.dtype == np.float32
    np.testing.assert_array_equal(lone, [[[2.25, 3.5]]])


def test_halved_samples_stay_within_the_image():
    """The outermost half pixel of the image may exceed the half-resolution plane."""
    pixels = np.array([[[-0.5, -0.5], [-0.5, -0.5], [4.5, 3.5], [4.5, 3.5]]] * 2)
    after = halved_pixels(pixels, (1.0, 1.0), (0.0, 0.0), (5, 4))
    np.testing.assert_array_equal(after, [[[-0.5, -0.5], [1.75, 1.25]]])
    before = halved_pixels(pixels, (0.0, 0.0), (0.0, 0.0), (5, 4))
    np.testing.assert_array_equal(before, [[[-0.25, -0.25], [2.25, 1.5]]])


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_halved_mosaic_does_not_mix_views(order):
    """In either order of the views, and of a view with its surroundings."""
    u, v = np.meshgrid(8.0 * np.arange(6), 8.0 * np.arange(4))
    pixels = np.stack([u, v], axis=-1).astype(np.float32)
    views = [Rectangle(1, 0, 2, 3), Rectangle(3, 0, 2, 3)]
    mosaic = PixelMap(pixels, (60, 51), ANNULUS, [views[k - 1] for k in order])
    halved = mosaic.halved((0.25, 1.0), (0.5, 0.5))
    columns, rows = np.array([0.0, 16.0, 32.0]), np.array([4.0, 16.0])
    x, y = np.meshgrid(columns, rows)
    y[0] = 0.0  # all blocks mix views: values of their first pixels
    np.testing.assert_allclose(halved.pixels(), np.stack([(x - 0.25) / 2, (y - 1.0) / 2], axis=-1))
    assert (halved.size, halved.source_size) == ((3, 2), (30, 26))
    assert halved.averages("cubic") is None
    assert halved.averages("auto").annulus == HALF_ANNULUS
    plain = PixelMap(pixels, (60, 51)).halved((0.25, 1.0), (0.5, 0.5))
    x, y = np.meshgrid(columns + 4.0, [4.0, 20.0])
    np.testing.assert_allclose(plain.pixels(), np.stack([(x - 0.25) / 2, (y - 1.0) / 2], axis=-1))
    assert plain.averages("auto").annulus is None


def test_pixel_map_of_another_map():
    """It has its coordinates in single precision, and its numbers of samples."""
    grid = lattice(lambda x, y: (20 + 2.5 * x, 10 + 2.5 * y), (12, 9), (60, 50), 4)
    fixed = PixelMap.of(grid, ANNULUS)
    assert (fixed.size, fixed.source_size) == ((12, 9), (60, 50))
    np.testing.assert_array_equal(fixed.pixels(), grid.pixels())
    assert fixed.averages("auto") is grid.averages("auto") is not None
    assert fixed.averages("linear") is grid.averages("linear") is None
    circles = PolarMap((31.0, 30.0), np.array([3.0, 6.0]), np.array([0.0, 1.0]), (64, 64))
    assert PixelMap.of(circles).pixels().dtype == np.float32
    assert circles.averages("cubic") is None
    assert PolarMap((31.0, 30.0), np.array([3.0, 6.0]), np.linspace(0, 6, 9), (64, 64)).averages(
        "auto"
    )


@pytest.mark.parametrize(
    ("centre", "radii", "size", "is_within"),
    [
        ((4.0, 5.0), (1.0, 4.0, np.nan), (9, 11), True),
        ((4.0, 5.0), (1.0, 4.01), (9, 11), False),
        ((3.9, 5.0), (4.0,), (9, 11), False),
        ((4.1, 5.0), (4.0,), (9, 11), False),
        ((5.0, 4.0), (4.0,), (11, 9), True),
        ((5.0, 3.9), (4.0,), (11, 9), False),
        ((5.0, 4.1), (4.0,), (11, 9), False),
        ((0.5, 0.5), (0.5,), (2, 2), True),
        ((-0.5, 4.0), (np.nan,), (9, 9), False),
    ],
)
def test_circles_within_the_image(centre, radii, size, is_within):
    """Within the rectangle of pixel centres, a map at half resolution has circles; beyond it, the pixels
    outside the image are invalid."""
    angles = np.linspace(0.0, 2 * np.pi, 73)
    circles = PolarMap(centre, np.array(radii), angles, size)
    assert isinstance(circles.halved((0.0, 0.0), (0.0, 0.0)), PolarMap) == is_within
    assert (circles.size, circles.pixels().shape) == ((73, len(radii)), (len(radii), 73, 2))
    u = centre[0] + np.outer(radii, np.cos(angles))
    v = centre[1] + np.outer(radii, np.sin(angles))
    inside = (abs(2 * u - size[0] + 1) <= size[0]) & (abs(2 * v - size[1] + 1) <= size[1])
    expected = np.where(inside[..., None], np.stack([u, v], axis=-1), np.nan)
    np.testing.assert_allclose(circles.pixels(), expected, rtol=0, atol=1e-12)
    assert circles.has_valid_pixels() == inside.any()


def test_visibility_of_circles_is_checked_in_every_16th_column():
    radii = np.array([5.0])
    for column, is_visible in ((0, True), (16, True), (32, True), (15, False), (17, False)):
        angles = np.full(40, np.pi)
        angles[column] = 0.0  # the other columns are left of the image
        circles = PolarMap((2.0, 3.0), radii, angles, (8, 8))
        assert circles.has_valid_pixels() == is_visible
    beyond = PolarMap((2.0, 3.0), radii, angles, (8, 8), ANNULUS).halved((0.25, 1.0), (0.0, 0.0))
    assert isinstance(beyond, PixelMap)
    assert (beyond.size, beyond.source_size) == ((20, 1), (4, 4))
    assert beyond._annulus == HALF_ANNULUS
    circles = PolarMap((20.0, 20.0), radii, angles, (41, 41), ANNULUS)
    assert circles.halved((0.25, 1.0), (0.0, 0.0)).annulus == HALF_ANNULUS


@pytest.mark.parametrize("interpolation", ["linear", "auto"])
def test_maps_of_one_view_give_one_image(interpolation):
    """Every kind of map against the pixel map of its coordinates."""
    image = np.random.default_rng(1).integers(0, 256, (51, 60, 3), np.uint8)
    lattices = [lattice(cubic, (43, 37), (60, 51), step, (0.25, 0.75)) for step in (4, 8)]
    circles = PolarMap((31.0, 24.0), np.linspace(3.0, 20.0, 9), np.linspace(0.3, 2.9, 21), (60, 51))
    for sampled in (*lattices, circles):
        output = remap(image, sampled, interpolation)
        other = remap(image, PixelMap.of(sampled), interpolation)
        assert output.std() > 20
        assert np.abs(output.astype(int) - other).max() <= 2


def test_packed_coordinates_from_the_second_image_on(monkeypatch):
    """One packed map for each kind of image; none where all pixels are averages."""
    calls = []

    class Packed:
        def __init__(self, pixels, *arguments):
            calls.append(("pack", *arguments))

        def sample(self, source, target, border, *averages):
            calls.append(("packed", len(averages)))

    def record_call(source, pixels, target, *arguments):
        calls.append(("unpacked", arguments[0]))

    kernels = SimpleNamespace(PackedMap=Packed, remap=record_call)
    monkeypatch.setattr(maps, "backend", SimpleNamespace(kernels=kernels))

    def sample(fixed, kernel="linear", dtype=np.uint8, channels=3, are_everywhere=None):
        image = np.zeros((4, 5, channels), dtype)
        averages = None
        if are_everywhere is not None:
            averages = SimpleNamespace(are_everywhere=are_everywhere, compiled=None)
        calls.clear()
        fixed.sample_compiled(RemapJob(image, image, kernel, (0.0,), averages))
        return list(calls)

    fixed = PixelMap(np.zeros((2, 2, 2)), (60, 51))
    assert sample(fixed, "cubic") == [("unpacked", 2)]
    assert sample(fixed) == [("pack", 60, 51, 3, False, 1), ("packed", 0)]
    assert sample(fixed) == [("packed", 0)]
    assert sample(fixed, are_everywhere=False) == [("packed", 2)]
    assert sample(fixed, are_everywhere=True) == [("unpacked", 1)]
    assert sample(fixed, "nearest") == [("pack", 60, 51, 3, False, 0), ("packed", 0)]
    assert sample(fixed, "cubic", np.uint16) == [("pack", 60, 51, 3, True, 2), ("packed", 0)]
    assert sample(fixed, "cubic", np.float32, 1) == [("pack", 60, 51, 1, True, 2), ("packed", 0)]
    averaged = PixelMap(np.zeros((2, 2, 2)), (60, 51))
    assert sample(averaged, are_everywhere=True) == [("unpacked", 1)]
    assert sample(averaged, are_everywhere=True) == [("unpacked", 1)]
