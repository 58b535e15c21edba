"""Contract of all samplers, maps and image layouts, against the definition in plain NumPy and
float64.

The definition is documented in :mod:`omnimirror.dewarp.sampling`. Each map is created from a
formula for the position of any view pixel and intermediate point; the reference evaluates the
formula and never the map.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.dewarp._source_coordinates import lattice_map
from omnimirror.dewarp.interfaces import INTERPOLATIONS, Annulus, Map
from omnimirror.dewarp.maps import LatticeMap, PixelMap, PolarMap, Rectangle
from omnimirror.dewarp.sampling import remap
from omnimirror.dewarp.yuv import SITINGS, remap_planes
from tests.everyday import few
from tests.samplers import instructions

SOURCE = (231, 170)  # odd and even
FULL = {"uint8": 255, "uint16": 65535, "float32": 1.0}
KINDS = [(depth, channels) for depth in FULL for channels in (1, 2, 3, 4)]
SINGLE = ("nearest", "linear", "cubic")
AVERAGING = ("auto", "area")
UNDECIDED_PX = 2e-3
"""Distance from the image border, or for nearest from the midpoint between pixels, within which
rounding decides."""


@pytest.fixture(params=["opencv", *instructions()])
def sampler(request, uncompiled):
    """All samplers."""
    if request.param == "opencv":
        uncompiled()
        yield request.param
    else:
        before = backend.name
        backend.kernels.set_instruction_set(request.param)
        yield request.param
        backend.kernels.set_instruction_set(before)


# -- maps and their formulas
# -------------------------------------------------------------------------

Formula = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Case(NamedTuple):
    """Map of a view, and the image position of its point (x, y): (..., 2), NaN outside the field."""

    map: Map
    at: Formula

    def pixels(self) -> np.ndarray:
        width, height = self.map.size
        return self.at(*np.meshgrid(np.arange(float(width)), np.arange(float(height))))


def curved_map(across: float, down: float) -> Formula:
    """Return a parabolic map, reproduced exactly by cubics, with the given source pixels per output
    pixel."""

    def at(x, y):
        u = 24.0137 + across * x - 0.21 * down * y + 1.2e-3 * down * y * y
        return np.stack(
            [u, 17.0171 + 0.15 * across * x + down * y + 0.9e-3 * across * x * x], axis=-1
        )

    return at


def with_holes(at: Formula) -> Formula:
    """Add two stripes outside the field, with a margin of one pixel to all fractional positions."""

    def holed(x, y):
        pixels = at(x, y)
        pixels[((x > 20.4) & (x < 23.6)) | ((y > 9.4) & (y < 10.6))] = np.nan
        return pixels

    return holed


def pixel_map(at: Formula, size: tuple[int, int], dtype=np.float32, **more) -> PixelMap:
    x, y = np.meshgrid(np.arange(float(size[0])), np.arange(float(size[1])))
    return PixelMap(at(x, y).astype(dtype), SOURCE, **more)


def lattice(at: Formula, size: tuple[int, int], step: int, shift=(0.0, 0.0), patched=False) -> Case:
    """Return nodes of a formula, with some cells refined to pixels; one of these is outside the
    field."""
    across, down = (-(-n // step) for n in size)
    x, y = np.meshgrid((np.arange(across + 3) - 1.0) * step, (np.arange(down + 3) - 1.0) * step)
    nodes = np.ascontiguousarray(np.moveaxis(at(x, y), -1, 0), np.float32)
    cells = np.full((down, across), -1, np.int32)
    patches = np.empty((0, step, step, 2), np.float32)

    def position(x, y):
        return at(x + shift[0], y + shift[1])

    if not patched:
        return Case(LatticeMap(nodes, size, SOURCE, step, cells, patches, shift), position)
    cells[1, 1], cells[0, 2] = 0, 1
    one = np.arange(float(step))
    patches = np.stack(
        [at(*np.meshgrid(one + step, one + step)), np.full((step, step, 2), np.nan)]
    ).astype(np.float32)

    def holed(x, y):
        pixels = position(x, y)
        pixels[(y < step) & (x >= 2 * step) & (x < 3 * step)] = np.nan
        return pixels

    return Case(LatticeMap(nodes, size, SOURCE, step, cells, patches, shift), holed)


def polar(centre: tuple[float, float], radii: tuple[float, float], size: tuple[int, int]) -> Case:
    (inner, per_row), per_column = radii, 0.11

    def at(x, y):
        radius, angle = inner + per_row * y, -0.3 + per_column * x
        return np.stack(
            [centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=-1
        )

    rows, columns = np.arange(float(size[1])), np.arange(float(size[0]))
    return Case(PolarMap(centre, inner + per_row * rows, -0.3 + per_column * columns, SOURCE), at)


def refined(size: tuple[int, int]) -> Case:
    """Map of a camera whose field boundary crosses the view."""

    def at(x, y):
        x, y = np.broadcast_arrays(x, y)
        pixels = curved_map(2.1, 1.4)(x, y)
        pixels[pixels[..., 0] > 180.0] = np.nan
        return pixels

    return Case(lattice_map(at, size, SOURCE), at)


def two_views(size: tuple[int, int]) -> Case:
    """Two adjacent views of distant parts of the image."""
    middle = size[0] // 2

    def at(x, y):
        return np.where(
            (x < middle)[..., None],
            curved_map(1.3, 1.1)(x, y),
            [200.3, 150.2] - curved_map(1.1, 0.9)(x - middle, y),
        )

    views = [Rectangle(0, 0, middle, size[1]), Rectangle(middle, 0, size[0] - middle, size[1])]
    return Case(pixel_map(at, size, views=views), at)


MAKERS: dict[str, Callable[[], Case]] = {
    "pixels": lambda: Case(pixel_map(curved_map(2.2, 2.0), (121, 97)), curved_map(2.2, 2.0)),
    "pixels in float64": lambda: Case(
        pixel_map(curved_map(0.7, 0.6), (66, 50), np.float64), curved_map(0.7, 0.6)
    ),
    "pixels with holes": lambda: Case(
        pixel_map(with_holes(curved_map(1.9, 3.4)), (60, 41)), with_holes(curved_map(1.9, 3.4))
    ),
    "two views": lambda: two_views((92, 63)),
    "lattice of 4": lambda: lattice(curved_map(1.2, 1.0), (101, 64), 4),
    "lattice of 8, shifted": lambda: lattice(curved_map(2.4, 1.9), (64, 65), 8, (0.25, 0.5)),
    "lattice of 16": lambda: lattice(curved_map(2.3, 2.8), (130, 70), 16),
    "lattice of 16, patched": lambda: lattice(curved_map(1.3, 1.6), (130, 90), 16, patched=True),
    "lattice of 32": lambda: lattice(curved_map(1.1, 1.0), (203, 101), 32),
    "lattice of 32, patched": lambda: lattice(curved_map(0.8, 0.7), (203, 101), 32, patched=True),
    "lattice of 64": lambda: lattice(curved_map(0.8, 0.5), (203, 101), 64),
    "polar": lambda: polar((114.3, 84.1), (3.3, 1.7), (59, 45)),
    "polar, cut by the picture": lambda: polar((101.7, 61.2), (5.2, 2.9), (58, 57)),
    "refined": lambda: refined((120, 97)),
    "pixels of a lattice": lambda: all_pixels(MAKERS["lattice of 16"]()),
    "pixels of circles": lambda: all_pixels(MAKERS["polar"]()),
}


def all_pixels(case: Case) -> Case:
    return Case(PixelMap.of(case.map), case.at)


@pytest.fixture(params=MAKERS)
def case(request) -> Case:
    """A newly created map of each kind: packed data of one test are not available to the next."""
    return MAKERS[request.param]()


# -- images and reference values
# ---------------------------------------------------------------------


@cache
def random_image(
    depth: str, channels: int, size: tuple[int, int] = SOURCE, noise: float = 0.01
) -> np.ndarray:
    """Return an image with structure of many scales."""
    rng = np.random.default_rng(5)
    levels = [
        cv2.resize(rng.random((n, n, channels)), size, interpolation=cv2.INTER_CUBIC)
        for n in (3, 9, 31)
    ]
    values = sum(
        np.reshape(level, (size[1], size[0], channels)) / (k + 1) for k, level in enumerate(levels)
    )
    values = (values - values.min()) / np.ptp(values) + rng.normal(0, 1, values.shape) * noise
    values = values.clip(0, 1) * FULL[depth]
    return (values if depth == "float32" else np.rint(values)).astype(depth)


def keys(t: np.ndarray) -> np.ndarray:
    """Return the four weights of the cubic kernel with a = -0.75 by its definition; (4, n)."""
    a, d = -0.75, np.abs(np.array([-1, 0, 1, 2])[:, None] - t)
    return np.where(d <= 1, (a + 2) * d**3 - (a + 3) * d**2 + 1, a * (d**3 - 5 * d**2 + 8 * d - 4))


def is_on(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    u, v = pixels[..., 0], pixels[..., 1]
    return (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)


def sampled(image: np.ndarray, pixels: np.ndarray, kernel: str) -> np.ndarray:
    """Return unrounded values (n, channels) at positions (n, 2) in the image; undefined outside."""
    height, width = image.shape[:2]
    u, v = np.nan_to_num(pixels).T
    u, v = u.clip(0, width - 1), v.clip(0, height - 1)
    if kernel == "nearest":
        return image[(v + 0.5).astype(int), (u + 0.5).astype(int)].astype(float)
    x, y = np.floor(u).astype(int), np.floor(v).astype(int)
    if kernel == "linear":
        first, across, down = 0, np.stack([1 - (u - x), u - x]), np.stack([1 - (v - y), v - y])
    else:
        first, across, down = -1, keys(u - x), keys(v - y)
    values = np.zeros((len(u), image.shape[2]))
    for j, wy in enumerate(down):
        for i, wx in enumerate(across):
            tap = image[(y + j + first).clip(0, height - 1), (x + i + first).clip(0, width - 1)]
            values += (wy * wx)[:, None] * tap
    return values


def in_range(image: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values if image.dtype == np.float32 else values.clip(0, FULL[image.dtype.name])


def truth(image: np.ndarray, pixels: np.ndarray, kernel: str, border: object) -> np.ndarray:
    """Return one sample for each position (rows, columns, 2)."""
    values = in_range(image, sampled(image, pixels.reshape(-1, 2), kernel)).reshape(
        *pixels.shape[:2], -1
    )
    return np.where(is_on(image, pixels)[..., None], values, border)


def decided(image: np.ndarray, pixels: np.ndarray, kernel: str) -> np.ndarray:
    """Return the mask of positions whose visibility does not depend on rounding."""
    height, width = image.shape[:2]
    ends = np.abs(pixels[..., None] - np.array([[-0.5, width - 0.5], [-0.5, height - 0.5]])).min(
        axis=(-2, -1)
    )
    near = ends < UNDECIDED_PX
    if kernel == "nearest":
        near |= (np.abs(pixels - np.floor(pixels) - 0.5) < UNDECIDED_PX).any(axis=-1)
    return ~near


# -- single samples
# ----------------------------------------------------------------------------------

TOLERANCE = {"uint8": 1.5, "uint16": 6.0, "float32": 9e-5}
IS_OPENCV_4 = cv2.__version__.startswith("4.")
"""OpenCV 4 quantises fractions of a pixel to 1/32 in some of its implementations."""


@cache
def single_samples(
    name: str, depth: str, channels: int, interpolation: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return image values at the pixels of a map, and the mask independent of rounding."""
    image, pixels = random_image(depth, channels), MAKERS[name]().pixels()
    expected = truth(image, pixels, interpolation, border_of(depth, channels))
    return expected, decided(image, pixels, interpolation)


def border_of(depth: str, channels: int) -> list[float]:
    return [(7, FULL[depth], 0, 3)[c] for c in range(channels)]


@pytest.mark.parametrize(("depth", "channels"), few(KINDS, ("uint8", 3), ("float32", 1)))
def test_samples_agree_with_interpolation_formulas(depth, channels, request, case, sampler):
    """Check the first image, and the second, after which a map may have been packed."""
    image, name = random_image(depth, channels), request.node.callspec.params["case"]
    border = border_of(depth, channels)
    for interpolation in SINGLE:
        expected, is_decided = single_samples(name, depth, channels, interpolation)
        assert is_decided.mean() > 0.97
        for _ in range(2):
            samples = remap(image, case.map, interpolation, border=border)
            assert samples.dtype == image.dtype
            tolerance = 0 if interpolation == "nearest" else TOLERANCE[depth]
            if sampler == "opencv" and IS_OPENCV_4 and depth == "float32" and tolerance:
                tolerance = 2e-3
            np.testing.assert_allclose(
                samples[is_decided], expected[is_decided], rtol=0, atol=tolerance
            )


def test_border_and_output_arguments(case, sampler):
    """A grey image without a channel axis; a target with gaps between rows and pixels, returned
    unchanged."""
    grey, colours = random_image("uint8", 1)[..., 0], random_image("uint8", 3)
    for interpolation in INTERPOLATIONS:
        plain = remap(grey, case.map, interpolation, border=9)
        assert plain.shape == case.map.size[::-1]
        np.testing.assert_array_equal(
            plain, remap(grey[..., None], case.map, interpolation, border=(9,))[..., 0]
        )
        one = remap(colours, case.map, interpolation, border=(9, 9, 9))
        memory = np.full((*case.map.size[::-1], 5), 77, np.uint8)
        assert (
            remap(colours[::-1].copy()[::-1], case.map, interpolation, memory[..., 1:4], 9)
            is not memory
        )
        np.testing.assert_array_equal(memory[..., 1:4], one)
        assert (memory[..., [0, 4]] == 77).all()


def test_constant_image_is_preserved(case, sampler):
    """Neither the border value nor pixels outside the image contribute."""
    pixels = case.pixels()
    for value in (0, 1, 127, 254, 255):
        image = np.full((SOURCE[1], SOURCE[0], 3), value, np.uint8)
        is_decided, inside = decided(image, pixels, "linear"), is_on(image, pixels)
        for interpolation in INTERPOLATIONS:
            samples = remap(image, case.map, interpolation, border=99)
            assert (samples[inside & is_decided] == value).all()
            assert (samples[~inside & is_decided] == 99).all()


# -- averages
# ----------------------------------------------------------------------------------------

TAPS = 10  # reference taps per side, independent of the sampler
SAMPLED_PIXELS = 400  # pixels of a view


def footprint_means(
    image: np.ndarray, case: Case, x: np.ndarray, y: np.ndarray, interpolation: str
) -> np.ndarray:
    """Return means (n, c) over pixel footprints (n,), from the midpoint to one neighbour to that of
    the opposite one.

    For ``auto``, a side of s px is shortened by the factor 1 - (1.2 / s)^8. Undefined near the
    field boundary.
    """
    origin = case.at(x, y)

    def side(dx: int, dy: int) -> np.ndarray:
        edge = case.at(x + dx, y + dy) - origin
        length = np.linalg.norm(edge, axis=-1, keepdims=True)
        if interpolation == "area":
            return edge
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(length > 1.2, edge * (1 - (1.2 / length) ** 8), 0.0)

    aside, upright = (side(-1, 0), side(1, 0)), (side(0, -1), side(0, 1))
    sums = np.zeros((len(x), image.shape[2]))
    parts = (np.arange(TAPS) + 0.5) / TAPS - 0.5
    for s in parts:
        across = origin + abs(s) * aside[int(s > 0)]
        for t in parts:
            sums += sampled(image, across + abs(t) * upright[int(t > 0)], "cubic")
    return sums / TAPS**2


def well_inside(image: np.ndarray, case: Case) -> np.ndarray:
    """Return the pixels with all neighbours in the image, several pixels inside its border, and in
    the same view."""
    pixels = case.pixels()
    height, width = image.shape[:2]
    with np.errstate(invalid="ignore"):
        good = (pixels > 8).all(axis=-1) & (pixels < np.array([width, height]) - 9).all(axis=-1)
    if len(getattr(case.map, "_views", ())):
        good[:, case.map.size[0] // 2 - 1 : case.map.size[0] // 2 + 1] = False
    inner = np.zeros_like(good)
    inner[1:-1, 1:-1] = np.lib.stride_tricks.sliding_window_view(good, (3, 3)).all(axis=(2, 3))
    return inner


@cache
def smooth(depth: str, channels: int) -> np.ndarray:
    """Return an image without fine structure, for which all dense taps have the same mean."""
    values = cv2.GaussianBlur(random_image("float32", channels, noise=0.15), (0, 0), 1.6).reshape(
        SOURCE[1], SOURCE[0], -1
    )
    return values if depth == "float32" else np.rint(values * FULL[depth]).astype(depth)


@cache
def sampled_means(name: str, interpolation: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows and columns (n,) of some pixels, and their means (n, 4) in the smooth image."""
    case, image = MAKERS[name](), smooth("float32", 4)
    rows, columns = np.nonzero(well_inside(image, case))
    sample = np.random.default_rng(3).permutation(len(rows))[:SAMPLED_PIXELS]
    rows, columns = rows[sample], columns[sample]
    return (
        rows,
        columns,
        footprint_means(image, case, columns.astype(float), rows.astype(float), interpolation),
    )


@pytest.mark.parametrize("depth", few(FULL, "uint8"))
def test_area_samples_are_means_over_footprints(depth, request, case, sampler):
    """The second image equals the first bit by bit."""
    image, name = smooth(depth, 4), request.node.callspec.params["case"]
    for interpolation in AVERAGING:
        rows, columns, expected = sampled_means(name, interpolation)
        assert len(rows) > 300
        first, second = (remap(image, case.map, interpolation) for _ in range(2))
        np.testing.assert_array_equal(first, second)
        error = np.abs(first[rows, columns] / FULL[depth] - expected)
        assert error.max() < 0.012
        assert error.mean() < 0.0012 + 0.3 * (depth == "uint8") / 255


def test_stripes_distinguish_area_from_point_samples(sampler):
    """Not detectable with the smooth image: if a view minifies single-pixel stripes, their mean is
    grey."""
    stripes = np.zeros((SOURCE[1], SOURCE[0], 3), np.uint8)
    stripes[:, ::2] = 200
    for name in ("pixels", "lattice of 16", "refined"):
        case = MAKERS[name]()
        inner = well_inside(stripes, case)
        for interpolation in AVERAGING:
            samples = remap(stripes, case.map, interpolation)[inner].astype(float)
            assert abs(samples.mean() - 100) < 2
            assert samples.std() < 25
        assert remap(stripes, case.map, "cubic")[inner].astype(float).std() > 50


def test_pixels_outside_annulus_have_no_weight(sampler):
    """The image is grey inside the field and bright outside; the outside does not contribute."""
    v, u = np.mgrid[: SOURCE[1], : SOURCE[0]]
    centre, rim_px = (114.3, 84.1), 70.0
    image = np.where(np.hypot(u - centre[0], v - centre[1]) < rim_px + 3, 80, 255).astype(np.uint8)
    radii, angles = np.arange(2.0, rim_px, 2.5), np.arange(0.0, 6.0, 0.11)
    circles = PolarMap(centre, radii, angles, SOURCE, Annulus(*centre, 0.0, rim_px))
    for pixel_map in (circles, PixelMap.of(circles)):
        assert (remap(image, pixel_map, "area") == 80).all()


# -- planar YUV, 4:2:0
# -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sitings", [("left", "left"), ("center", "center"), ("topleft", "left")], ids="-".join
)
@pytest.mark.parametrize("is_paired", [False, True], ids=["three planes", "NV12"])
def test_chroma_is_interpolated_between_luma_pixels(is_paired, sitings, case, sampler):
    """A chroma sample at (x, y) between its four pixels has the value of the formula at that point."""
    site, of_view = (np.array(SITINGS[s]) for s in sitings)
    across, down = (SOURCE[0] + 1) // 2, (SOURCE[1] + 1) // 2
    luma, colours = (
        random_image("uint8", 1)[..., 0],
        random_image("uint8", 2, (across, down), noise=0.0),
    )
    parts = (luma, colours) if is_paired else (luma, colours[..., 0], colours[..., 1])
    columns, rows = (-(-n // 2) for n in case.map.size)
    kinds = ((rows, columns, 2),) if is_paired else ((rows, columns),) * 2
    out = tuple(np.empty(shape, np.uint8) for shape in (case.map.size[::-1], *kinds))
    planes = remap_planes(
        parts,
        case.map,
        case.map.halved(SITINGS[sitings[0]], SITINGS[sitings[1]]),
        "linear",
        out,
        (16, 128, 129),
    )
    chroma = planes[1] if is_paired else np.dstack(planes[1:])
    x, y = np.meshgrid(2.0 * np.arange(columns) + of_view[0], 2.0 * np.arange(rows) + of_view[1])
    pixels = (case.at(x, y) - site) / 2
    is_on_luma = [
        is_on(luma, case.at(np.floor(x) + i, np.floor(y) + j)) for i in (0, 1) for j in (0, 1)
    ]
    is_inside, is_outside = np.all(is_on_luma, axis=0), ~np.any(is_on_luma, axis=0)
    if len(getattr(case.map, "_views", ())):  # across the seam, the first pixel is used
        is_inside[:, (case.map.size[0] // 2) // 2] = False
    inner = is_inside & (pixels > 0).all(axis=-1) & (pixels < [across - 1, down - 1]).all(axis=-1)
    assert inner.mean() > 0.15
    expected = truth(colours, pixels, "linear", 0)
    assert np.abs(chroma - expected)[inner].max() < (2.5 if IS_OPENCV_4 else 2)
    clear = is_outside & decided(luma, case.at(x, y), "linear")
    assert (chroma[clear] == (128, 129)).all()
    np.testing.assert_array_equal(planes[0], remap(luma, case.map, "linear", border=16))


# -- properties of maps, and invalid arguments
# -------------------------------------------------------


def test_maps_store_positions_and_sizes(case):
    expected, pixels = case.pixels(), case.map.pixels()
    assert pixels.shape == (*case.map.size[::-1], 2)
    assert case.map.source_size == SOURCE
    assert not (np.isfinite(pixels) & np.isnan(expected)).any()
    missing = np.isnan(pixels[..., 0]) & np.isfinite(expected[..., 0])
    image = random_image("uint8", 1)
    assert not (missing & is_on(image, expected) & decided(image, expected, "linear")).any()
    np.testing.assert_allclose(pixels[~missing], expected[~missing], atol=1.5e-3)
    halved = case.map.halved((0.0, 0.5), (0.0, 0.5))
    assert halved.size == tuple(-(-n // 2) for n in case.map.size)
    assert halved.source_size == tuple(-(-n // 2) for n in SOURCE)


def test_invalid_sampler_arguments_are_rejected(case, sampler):
    pixel_map, image = case.map, random_image("uint8", 3)
    locked = np.empty((*pixel_map.size[::-1], 3), np.uint8)
    locked.flags.writeable = False
    for message, call in {
        "of the map; got": lambda: remap(image[1:], pixel_map),
        "must have 1 to 4 channels": lambda: remap(
            np.empty((*SOURCE[::-1], 5), np.uint8), pixel_map
        ),
        "got complex128": lambda: remap(image.astype(complex), pixel_map),
        "out must be .*; got": lambda: remap(image, pixel_map, out=np.empty((3, 3, 3), np.uint8)),
        "out must be writeable": lambda: remap(image, pixel_map, out=locked),
        "border must .*; got 256": lambda: remap(image, pixel_map, border=256),
        r"border must .*; got \(1, 2\)": lambda: remap(image, pixel_map, border=(1, 2)),
        "must be one of .*; got 'lanczos'": lambda: remap(image, pixel_map, "lanczos"),
    }.items():
        with pytest.raises(InvalidParameter, match=message):
            call()


# -- comparison of samplers
# --------------------------------------------------------------------------


@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
@pytest.mark.parametrize("interpolation", few(INTERPOLATIONS, "nearest", "cubic"))
def test_samplers_agree_on_photograph(interpolation, shared_data, uncompiled):
    """Maps created from cameras and screens: a panorama, a view, and a mosaic."""
    image = om.read_image(shared_data / "mirrorball" / "store.jpg")
    image = cv2.resize(image, (1024, 1024), interpolation=cv2.INTER_AREA)
    ball, screens = (
        om.MirrorBall(
            centre_px=(511.5, 509.5), rim_radius_px=480.0, field_deg=270.0, image_size=(1024, 1024)
        ),
        om.screens,
    )
    views = [
        screens.Cylinder((500, 200), -90.0, 45.0),
        screens.Plane((320, 200), 10.0, -40.0, 0.0, 130.0),
        screens.CubeMap((240, 160), "3x2"),
    ]
    samples = [om.Dewarper(ball, view, interpolation)(image) for view in views]
    uncompiled()
    for view, compiled in zip(views, samples, strict=True):
        difference = np.abs(
            compiled.astype(int) - om.Dewarper(ball, view, interpolation)(image)
        ).max(axis=-1)
        share = 2e-3 if interpolation == "nearest" else 5e-3 if IS_OPENCV_4 else 2e-4
        assert (difference > 1).mean() < share
