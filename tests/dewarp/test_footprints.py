"""Footprint averages against their definition in float64, against image content, and at the limits
of fields, views and memory."""

import math
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.native import backend
from omnimirror.dewarp.interfaces import INTERPOLATIONS, KERNELS, Annulus
from omnimirror.dewarp.maps import LatticeMap, PixelMap
from omnimirror.dewarp.sampling import RULES, remap, squared_sides_of_pixels
from tests.everyday import few
from tests.samplers import instructions, remap_at

MODULE = backend.module
INSTRUCTIONS = ["opencv", *instructions()]
FULL = {"uint8": 255, "uint16": 65535, "float32": 1.0}
TOLERANCE = {"uint8": 1.5, "uint16": 4.0, "float32": 6e-5}
KINDS = [(depth, channels) for depth in FULL for channels in (1, 2, 3, 4)]
BALL = om.MirrorBall(
    centre_px=(511.5, 509.5), rim_radius_px=480.0, field_deg=270.0, image_size=(1024, 1020)
)


@pytest.fixture(params=INSTRUCTIONS)
def sampler(request, uncompiled):
    """All instruction sets of this machine, and OpenCV."""
    if request.param == "opencv":
        uncompiled()
        yield request.param
        return
    before = MODULE.instruction_set()
    MODULE.set_instruction_set(request.param)
    yield request.param
    MODULE.set_instruction_set(before)


@pytest.fixture
def exact_sampler(sampler):
    """Samplers that do not quantise the fractions of a pixel to 1/32, as OpenCV 4 does."""
    if sampler == "opencv" and int(cv2.__version__.partition(".")[0]) < 5:
        pytest.skip("OpenCV 4 quantises the fractions of a pixel to 1/32")
    return sampler


# -- definition ------------------------------------------------------------------------------------


def keys(t):
    """Return the four weights of the cubic kernel with a = -0.75 by its definition; (4, n)."""
    a, d = -0.75, np.abs(np.array([-1, 0, 1, 2])[:, None] - t)
    return np.where(d <= 1, (a + 2) * d**3 - (a + 3) * d**2 + 1, a * (d**3 - 5 * d**2 + 8 * d - 4))


def cubic(image, positions):
    """Return unclipped float64 samples (n, channels) at positions (n, 2) in the image."""
    height, width = image.shape[:2]
    u, v = np.clip(positions[:, 0], 0, width - 1), np.clip(positions[:, 1], 0, height - 1)
    x, y = np.floor(u).astype(int), np.floor(v).astype(int)
    values = np.zeros((len(u), image.shape[2]))
    for j, down in enumerate(keys(v - y)):
        for k, across in enumerate(keys(u - x)):
            tap = image[(y + j - 1).clip(0, height - 1), (x + k - 1).clip(0, width - 1)]
            values += (down * across)[:, None] * tap
    return values


def is_in_image(image, positions):
    height, width = image.shape[:2]
    u, v = positions[..., 0], positions[..., 1]
    return (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)


def shortened_side(side_px, interpolation):
    length = np.hypot(*side_px)
    if interpolation == "area":
        return side_px
    return side_px * (1 - (1.2 / length) ** 8) if length > 1.2 else 0 * side_px


def count(side_px, interpolation):
    """Return the number of samples per side."""
    length = np.hypot(*side_px)
    if interpolation == "area":
        return 1 if length <= 0.5 else max(2, math.ceil(length - 1e-6))
    return (
        1 if length <= 1.2 else max(2, math.ceil(length * (1 - (1.2 / length) ** 8) / 1.5 - 1e-6))
    )


def truth(image, positions, matrix, interpolation, border):
    """Return (rows, columns, channels) of an affine map (rows, columns, 2): its columns span the
    footprint."""
    column_side, row_side = np.array(matrix).T
    across, down = count(column_side, interpolation), count(row_side, interpolation)
    column_side, row_side = (
        shortened_side(column_side, interpolation),
        shortened_side(row_side, interpolation),
    )
    flat = positions.reshape(-1, 2).astype(float)
    sums, counts = np.zeros((len(flat), image.shape[2])), np.zeros((len(flat), 1))
    for i in range(across):
        for j in range(down):
            tap = (
                flat
                + ((i + 0.5) / across - 0.5) * column_side
                + ((j + 0.5) / down - 0.5) * row_side
            )
            inside = is_in_image(image, tap)[:, None]
            sums += np.where(inside, cubic(image, tap), 0)
            counts += inside
    means = np.where(counts > 0, sums / np.maximum(counts, 1), cubic(image, flat))
    if image.dtype != np.float32:
        means = means.clip(0, FULL[image.dtype.name])
    return np.where(is_in_image(image, flat)[:, None], means, border).reshape(
        *positions.shape[:2], -1
    )


@cache
def expected(depth, channels, interpolation):
    """Return the positions and averages of each case of :data:`AFFINE`."""
    maps = [affine(matrix, (74.37, 63.23), shape) for matrix, shape in AFFINE]
    return [
        (positions, truth(texture(depth, channels), positions, matrix, interpolation, FULL[depth]))
        for positions, (matrix, _) in zip(maps, AFFINE, strict=True)
    ]


def texture(depth, channels, size=(150, 130), seed=5):
    """Return structure of all scales, down to single-pixel noise."""
    width, height = size
    rng = np.random.default_rng(seed)
    levels = [
        cv2.resize(rng.random((n, n)), size, interpolation=cv2.INTER_CUBIC) for n in (4, 15, 60)
    ]
    image = np.dstack([np.roll(sum(levels), 17 * c, axis=1) for c in range(channels)])
    image = image / 3 + rng.normal(0, 0.12, (height, width, channels))
    image = image.clip(0, 1) * FULL[depth]
    return (image if depth == "float32" else np.rint(image)).astype(depth)


def affine(matrix, middle, shape):
    """Return a map (rows, columns, 2), float32, with constant parallelogram footprints."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    return (np.stack([x, y], axis=-1) @ np.array(matrix, float).T + middle).astype(np.float32)


FINE = [[0.3, 0.1], [-0.1, 0.4]]
SHRINKING = [[2.3, -0.7], [0.9, 1.7]]
SLANTED = [[6.3, 0.4], [1.1, 0.9]]
STRONG = [[9.0, 2.0], [-2.0, 11.0]]
AFFINE = ((FINE, (9, 11)), (SHRINKING, (60, 43)), (SLANTED, (33, 20)), (STRONG, (12, 17)))


@pytest.mark.parametrize("interpolation", few(["auto", "area"], "auto"))
@pytest.mark.parametrize(
    ("depth", "channels"), few(KINDS, ("uint8", 1), ("uint16", 4), ("float32", 3))
)
def test_averages_match_definition(depth, channels, interpolation, exact_sampler):
    image = texture(depth, channels)
    for positions, means in expected(depth, channels, interpolation):
        fixed = PixelMap(positions, (150, 130), Annulus(75.0, 65.0, 0.0, 1e3))
        for output in (remap(image, fixed, interpolation, border=FULL[depth]) for _ in range(2)):
            assert output.dtype == image.dtype
            np.testing.assert_allclose(output, means, rtol=0, atol=TOLERANCE[depth])


# -- all forms of coordinates ---------------------------------------------------------------------


def grid_of(matrix, size, step, bend=0.0):
    """Return a lattice of an affine or bent map."""
    width, height = size

    def positions_at(x, y):
        at = np.stack([x - width / 2, y - height / 2], axis=-1) @ np.array(matrix).T + (
            74.37,
            63.23,
        )
        return at + bend * np.stack([(y - height / 2) ** 2, (x - width / 2) ** 2], axis=-1)

    down, across = -(-height // step), -(-width // step)
    x, y = np.meshgrid((np.arange(across + 3) - 1.0) * step, (np.arange(down + 3) - 1.0) * step)
    nodes = np.ascontiguousarray(np.moveaxis(positions_at(x, y), -1, 0), np.float32)
    cells, patches = np.full((down, across), -1, np.int32), np.empty((0, step, step, 2), np.float32)
    grid = LatticeMap(nodes, size, (150, 130), step, cells, patches)
    return grid, positions_at(*np.meshgrid(np.arange(float(width)), np.arange(float(height))))


@pytest.mark.parametrize("interpolation", few(["auto", "area"], "auto"))
@pytest.mark.parametrize("step", [4, 8, 16, 32, 64])
def test_lattice_averages_match_pixel_map(step, interpolation, sampler):
    image = texture("uint8", 3)
    for size, matrix in (
        ((47, 61), SHRINKING),
        ((130, 70), [[0.9, 0.1], [0.0, 1.6]]),
        ((1, 1), STRONG),
    ):
        grid, positions = grid_of(matrix, size, step, 1e-3)
        output = remap(image, grid, interpolation, border=9)
        fixed = PixelMap.of(grid)
        for repeated in (
            remap(image, fixed, interpolation, border=9) for _ in range(2 * (step > 4))
        ):
            assert (np.abs(repeated.astype(int) - output) > 1).mean() < 1e-3  # at the image border
        # cells may use one sample more or less than those of a map, which have other origins
        other = remap_at(image, positions, interpolation, border=9)
        assert np.sqrt(np.mean((other.astype(float) - output) ** 2)) < 2


@pytest.mark.parametrize("keep_map", [False, True])
@pytest.mark.parametrize(
    "interpolation", few(["auto", "nearest", "linear", "cubic", "area"], "auto", "cubic")
)
@pytest.mark.parametrize("dtype", few(["uint8", "float32"], "uint8"))
def test_first_image_equals_later_images(dtype, interpolation, keep_map, sampler):
    ball = om.MirrorBall(
        centre_px=(127.5, 126.5), rim_radius_px=120.0, field_deg=270.0, image_size=(256, 254)
    )
    noise = np.random.default_rng(5).integers(0, 256, (254, 256, 3)).astype(dtype)
    for view in (
        om.screens.Plane((70, 44), 10.0, -40.0, 0.0, 140.0),
        om.screens.Cylinder((90, 28), -60.0, 20.0),
        om.screens.Cylinder((90, 28), -60.0, 20.0, distance_mm=500.0, offset_mm=(30.0, 0.0, 0.0)),
        om.screens.CubeMap((60, 40), "3x2"),
    ):
        dewarp = om.Dewarper(ball, view, interpolation, keep_map=keep_map)
        first = dewarp(noise)
        dewarp.coordinates()
        _ = dewarp.valid
        np.testing.assert_array_equal(dewarp(noise), first)


def test_first_frame_equals_later_frames():
    luma, chroma = (
        np.random.default_rng(6).integers(0, 256, s, np.uint8)
        for s in ((1020, 1024), (510, 512, 2))
    )
    for view in (
        om.screens.Plane((160, 100), 10.0, -40.0),
        om.screens.Cylinder((200, 60), -60.0, 20.0),
    ):
        dewarp = om.Dewarper(BALL, view)
        first = dewarp.planes((luma, chroma))
        _ = dewarp.valid
        for plane, repeated in zip(first, dewarp.planes((luma, chroma)), strict=True):
            np.testing.assert_array_equal(plane, repeated)


# -- antialiasing ---------------------------------------------------------------------------------


def test_subpixel_stripes_become_grey(sampler):
    """Stripes sampled once per pixel alias to broad bands."""
    stripes = np.zeros((400, 400), np.uint8)
    stripes[:, ::4] = stripes[:, 1::4] = 200
    positions = affine([[4.3, 0.3], [-0.3, 4.3]], (199.5, 199.5), (80, 80))
    for interpolation in ("auto", "area"):
        averaged = remap_at(stripes, positions, interpolation)
        assert abs(averaged.mean() - 100) < 1
        assert (
            averaged.astype(float).std() < 10
        )  # the mean of 4 px stripes over 4.3 px has a contrast of 6
    assert remap_at(stripes, positions, "cubic").astype(float).std() > 60


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32))
def test_footprint_mean_matches_dense_sampling(seed):
    """Any parallelogram, for an image without structure below two pixels."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(texture("float32", 1, (260, 260), seed % 1000), (0, 0), 1.0)
    angle, shear = rng.uniform(0, 2 * np.pi), rng.uniform(-0.5, 0.5)
    width_px, height_px = rng.uniform(0.2, 12, 2)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ [
        [width_px, shear],
        [0.0, height_px],
    ]
    positions = affine(matrix, (129.5, 129.5), (7, 9))
    many = affine(matrix / 31, (129.5, 129.5), (7 * 31, 9 * 31))
    mean = remap_at(image, many, "linear").reshape(7, 31, 9, 31).mean(axis=(1, 3))
    np.testing.assert_allclose(remap_at(image, positions, "area"), mean, atol=0.015)


def test_auto_equals_cubic_without_minification(sampler):
    image = texture("uint8", 3, (1024, 1020))
    for view in (
        om.screens.Plane((320, 180), 30.0, -20.0, 0.0, 40.0),
        om.screens.Cylinder((400, 60), -20.0, -15.0, 0, 60),
    ):
        auto, cubic = om.Dewarper(BALL, view), om.Dewarper(BALL, view, "cubic")
        for _ in range(2):
            np.testing.assert_array_equal(auto(image), cubic(image))
        assert auto._map.averages("auto") is None  # same cost as cubic


def test_regions_join_without_seam():
    """On a gradient, boundaries of averaged and non-averaged cells cause no steps."""
    v, u = np.mgrid[:1020, :1024]
    image = (100 + 60 * np.sin(u / 3.1) * np.sin(v / 3.7)).astype(np.float32)
    view = om.screens.Plane((640, 400), 20.0, -40.0, 0.0, 150.0)
    dewarp = om.Dewarper(BALL, view)
    output, taps = dewarp(image), dewarp._map.averages("auto").taps
    assert len(np.unique(taps.reshape(-1, 2), axis=0)) >= 4
    step = dewarp._map.step
    differs = (
        (np.diff(taps.astype(int), axis=1) != 0).any(axis=-1).repeat(step, axis=0)[: view.size[1]]
    )
    bend = np.abs(np.diff(output, 3, axis=1))  # of four consecutive pixels
    rows, cells = np.nonzero(differs)
    columns = (cells + 1) * step  # the first pixel of the next cell
    inside = (columns + 10 < view.size[0]) & dewarp.valid[
        rows, np.minimum(columns + 10, view.size[0] - 1)
    ]
    rows, columns = rows[inside], columns[inside]
    assert len(rows) > 500
    across_border = bend[rows, columns - 2].mean()  # two pixels on each side
    within_cells = np.mean([bend[rows, columns - 2 + k].mean() for k in (-5, -4, 4, 5)])
    assert across_border < 1.1 * within_cells


# -- boundaries -----------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", ["symmetric", "stretched"])
def test_averages_exclude_outside_of_field(camera, sampler):
    """An image that is grey inside the field and bright beyond the reach of a single sample."""
    ball = om.MirrorBall(
        centre_px=(255.5, 254.5), rim_radius_px=240.0, field_deg=270.0, image_size=(512, 510)
    )
    v, u = np.mgrid[:510, :512]
    image = np.where(np.hypot(u - 255.5, v - 254.5) < 244, 80, 255).astype(np.uint8)
    view = om.screens.DomeMaster((90, 90), 150.0, "nadir")
    dewarp = om.Dewarper(
        ball if camera == "symmetric" else _Unsymmetric(ball), view, "area", border=7
    )
    for _ in range(2):
        output = dewarp(image)
        assert 0.6 < dewarp.valid.mean() < 0.9
        np.testing.assert_array_equal(output[dewarp.valid], 80)
        np.testing.assert_array_equal(output[~dewarp.valid], 7)
    np.testing.assert_array_equal(dewarp.valid, om.Dewarper(ball, view, "nearest").valid)


class _Unsymmetric:
    """Camera without a known axis of symmetry."""

    symmetry = None

    def __init__(self, camera):
        self.camera = camera

    def __getattr__(self, name):
        return getattr(self.camera, name)


def test_averages_at_image_border(sampler):
    """A white image remains white up to its last pixel, whose footprint crosses the border."""
    image = np.full((50, 60, 3), 255, np.uint8)
    positions = affine([[7.0, 0.0], [0.0, 5.0]], (29.5, 24.5), (15, 13))
    for interpolation in ("auto", "area"):
        output = remap_at(image, positions, interpolation, border=10)
        np.testing.assert_array_equal(output[is_in_image(image, positions)], 255)
        np.testing.assert_array_equal(output[~is_in_image(image, positions)], 10)


@pytest.mark.parametrize("width", [36, 72, 200])
def test_panorama_seam_is_averaged_as_other_columns(width, sampler):
    """The same columns in the middle of a panorama that is turned by half a turn."""
    image = cv2.GaussianBlur(texture("uint8", 3, (1024, 1020)), (0, 0), 2)
    seam, middle = (
        om.Dewarper(BALL, om.views.panorama(BALL, (width, 24), pan_deg=pan_deg))(image).astype(int)
        for pan_deg in (0.0, 180.0)
    )
    difference = np.abs(np.roll(seam, width // 2, axis=1) - middle)
    assert difference[:, [0, -1, width // 2 - 1, width // 2]].max() <= 1
    assert difference.max() <= 1


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "auto", "area"])
@pytest.mark.parametrize(("width", "value"), [(1600, np.inf), (360, np.inf), (72, -np.inf)])
def test_infinite_value_does_not_yield_nan(interpolation, width, value, exact_sampler):
    """Exactly the pixels that a bright value at the same position affects become infinite."""
    dewarp = om.Dewarper(BALL, om.views.panorama(BALL, (width, width // 4)), interpolation)
    positions = dewarp.coordinates()
    u, v = np.rint(positions[positions.shape[0] // 2, positions.shape[1] // 3]).astype(int)
    image = np.full((1020, 1024, 3), 0.5, np.float32)
    grey = dewarp(image)
    image[v, u, 1] = 100.0
    bright = dewarp(image)
    image[v, u, 1] = value
    output = dewarp(image)
    np.testing.assert_array_equal(output[..., [0, 2]], grey[..., [0, 2]])
    brighter = bright[..., 1] > grey[..., 1] + 1e-3
    assert 1 <= brighter.sum() <= 16
    assert (output[brighter, 1] == value).all()
    assert np.isfinite(output[~brighter]).all()
    np.testing.assert_allclose(output[~brighter, 1], grey[~brighter, 1], atol=1e-3)


def test_mosaic_views_do_not_mix(sampler):
    """Each view equals the single view up to its last pixel, for any direction of its neighbour."""
    image = texture("uint8", 3, (1024, 1020))
    down, ahead = (
        om.screens.DomeMaster((80, 80), 100.0, "nadir"),
        om.screens.Plane((79, 50), 0.0, -10.0, 0.0, 120.0),
    )
    mosaic = om.screens.Mosaic((159, 80), ((0, 0, down), (80, 0, ahead)))
    together = om.Dewarper(BALL, mosaic)
    for _ in range(2):
        output = together(image)
        for left, top, view in mosaic.parts:
            width, height = view.size
            alone = om.Dewarper(BALL, view)(image)
            part = output[top : top + height, left : left + width]
            # cells have other origins there, and may use one sample more
            difference = np.abs(part.astype(int) - alone)
            assert difference.mean() < 0.5
            assert difference[:, [0, -1]].mean() < 0.8
            assert difference.max() < 20


def test_discontinuities_do_not_enlarge_footprints():
    positions = np.concatenate(
        [affine(FINE, (40, 40), (32, 24)), affine(FINE, (900, 700), (32, 24))], axis=1
    )
    assert squared_sides_of_pixels(positions).max() < 0.3


def test_single_pixel_and_row_views():
    image = texture("uint8", 3, (1024, 1020))
    for size in ((1, 1), (1, 40), (40, 1), (2, 2)):
        for interpolation in ("auto", "area"):
            dewarp = om.Dewarper(BALL, om.screens.Plane(size, 0.0, -40.0, 0.0, 60.0), interpolation)
            assert dewarp(image).shape == (size[1], size[0], 3)
            assert dewarp(image).any()


def test_number_of_taps_is_bounded():
    """4000 source pixels on 8: limited to 128 samples per side."""
    image = np.full((4000, 4000), 99, np.uint8)
    positions = affine([[500.0, 0], [0, 500.0]], (1999.5, 1999.5), (8, 8))
    fixed = PixelMap(positions, (4000, 4000))
    assert fixed.averages("area").taps.max() == 128
    assert (remap(image, fixed, "area") == 99).all()


# -- memory ----------------------------------------------------------------------------------------

SIZES = st.one_of(st.integers(1, 40), st.sampled_from([63, 64, 65, 127, 129, 200]))


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_random_sizes_stay_within_memory(data):
    """Smooth maps of any size with holes, beyond the borders: guard bytes around both images are
    unchanged."""
    name = data.draw(st.sampled_from(INSTRUCTIONS[1:] or INSTRUCTIONS))
    depth, channels = data.draw(st.sampled_from(KINDS))
    interpolation = data.draw(st.sampled_from(["auto", "area"]))
    width, height, columns, rows = (data.draw(SIZES) for _ in range(4))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    matrix = rng.uniform(-4, 4, (2, 2))
    positions = affine(matrix, (width / 2, height / 2), (rows, columns))
    positions[rng.random((rows, columns)) < data.draw(st.sampled_from([0, 0.05, 0.5]))] = np.nan
    positions[:, rng.random(columns) < 0.1] += np.float32(rng.uniform(-300, 300))
    item, padding = np.dtype(depth).itemsize, 96

    def guarded(shape):
        size = int(np.prod(shape)) * item
        memory = np.full(size + 2 * padding, 0xA5, np.uint8)
        return memory, memory[padding : padding + size].view(depth).reshape(shape)

    source, image = guarded((height, width, channels))
    image[:] = 0.5 if depth == "float32" else 77
    target, out = guarded((rows, columns, channels))
    before = MODULE and MODULE.instruction_set()
    if MODULE is not None:
        MODULE.set_instruction_set(name)
    try:
        fixed = PixelMap(positions, (width, height))
        for output in (remap(image, fixed, interpolation, out) for _ in range(2)):
            inside = is_in_image(image, positions)
            np.testing.assert_allclose(output[inside], 0.5 if depth == "float32" else 77, rtol=1e-5)
            assert (output[~inside] == 0).all()
    finally:
        if MODULE is not None:
            MODULE.set_instruction_set(before)
    for memory in (source, target):
        assert (memory[:padding] == 0xA5).all()
        assert (memory[-padding:] == 0xA5).all()


@pytest.mark.skipif(MODULE is None, reason="requires the compiled module")
def test_compiled_module_checks_bounds():
    image, positions = texture("uint8", 3), affine(SHRINKING, (70, 60), (40, 30))
    out = np.empty((40, 30, 3), np.uint8)
    taps = np.full((3, 2, 2), 2, np.uint8)
    good = MODULE.Averages(taps, 16, 1.2, None)
    MODULE.remap(image, positions, out, 2, 0, good)
    grid, _ = grid_of(FINE, (30, 40), 8)
    for call in (
        lambda: MODULE.Averages(taps * 0, 16, 1.2, None),
        lambda: MODULE.Averages(taps + 127, 16, 1.2, None),
        lambda: MODULE.Averages(taps, 12, 1.2, None),
        lambda: MODULE.Averages(taps[..., :1].copy(), 16, 1.2, None),
        lambda: MODULE.remap(image, positions, out, 1, 0, good),
        lambda: MODULE.remap(
            image, positions, out, 2, 0, MODULE.Averages(taps[:2].copy(), 16, 1.2, None)
        ),
        lambda: MODULE.PackedMap(positions, 150, 130, 3, False, 2).sample(
            image, out, 0, None, good
        ),
        lambda: MODULE.PackedMap(positions, 150, 130, 3, False, 2).sample(
            image, out, 0, positions[1:], good
        ),
        lambda: MODULE.remap(image, positions, out, 2, (1, 2)),
        lambda: MODULE.remap(image, positions, out, 2, (1, 2, 256)),
        lambda: MODULE.squared_sides_of_lattice(
            *grid.nodes, 8, grid.cells, grid.patches, np.empty((1, 1, 2), np.float32)
        ),
        lambda: MODULE.squared_sides_of_lattice(
            *grid.nodes, 8, grid.cells + 1, grid.patches, np.empty((5, 4, 2), np.float32)
        ),
    ):
        with pytest.raises(
            (ValueError, TypeError),
            match=r"taps|border|step|coordinates|averaged|cell|out|arguments|interpolation",
        ):
            call()


@pytest.mark.skipif(MODULE is None, reason="requires the compiled module")
def test_threads_give_identical_results():
    image, before = texture("uint8", 3), backend.threads
    grid, _ = grid_of(SHRINKING, (60, 61), 16)
    fixed = PixelMap.of(grid)
    backend.set_threads(1)
    expected = remap(image, fixed, "auto"), remap(image, grid, "area")
    for count_of_threads in (2, 3, 7):
        backend.set_threads(count_of_threads)
        np.testing.assert_array_equal(remap(image, fixed, "auto"), expected[0])
        np.testing.assert_array_equal(remap(image, grid, "area"), expected[1])
    backend.set_threads(before)


def test_interpolations_have_rules():
    assert set(RULES) == {"auto", "area"}
    assert set(KERNELS) == set(INTERPOLATIONS)
