"""Iterative restoration: compiled kernels against sparse matrices, and both against their
definition."""

from dataclasses import replace

import numpy as np
import pytest
from restoration_gain import with_fewer_pixels

import omnimirror as om
from omnimirror.base.native import backend
from omnimirror.dewarp.restoration import blur_model
from omnimirror.dewarp.restoration._blur_fraction import BlurProblem
from omnimirror.dewarp.restoration._deconvolution import (
    CompiledDeblurring,
    Effort,
    SparseDeblurring,
    deblurring_of,
    solve,
)
from omnimirror.dewarp.restoration.blur_model import (
    Blur,
    blur_kernels,
    radial_blur_of,
    whole_groups,
)
from omnimirror.optics.image_sensor import Imager
from tests.everyday import few

needs_compiled = pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")
KINDS = [SparseDeblurring, pytest.param(CompiledDeblurring, marks=needs_compiled)]


@pytest.fixture
def small_tiles(monkeypatch: pytest.MonkeyPatch):
    """Several tiles in a small image."""
    monkeypatch.setattr(blur_model, "TILE_PX", 40)


def blur_of(fineness: int) -> Blur:
    """Blur of a cropped image, with kernels that extend beyond its border."""
    sensor = with_fewer_pixels(om.load_sensor("paper-hyperboloidal"), 96, 0.5)
    sensor = replace(
        sensor, imager=Imager(90, 70, sensor.imager.pixel_pitch_um, centre_px=(40.0, 30.0))
    )
    radial_blur = radial_blur_of(sensor)
    return blur_kernels(
        radial_blur.offsets, radial_blur.whole_radius_px, radial_blur.sizes, fineness
    )


@pytest.fixture(scope="module")
def blur() -> Blur:
    return blur_of(2)


@pytest.fixture(scope="module")
def coarse_blur() -> Blur:
    return blur_of(1)


def random_roots(blur: Blur, channels: int = 3, seed: int = 4):
    return np.random.default_rng(seed).random((blur.size[1], blur.size[0], channels), np.float32)


def test_kernels_extend_beyond_border(blur: Blur):
    rows, _ = np.divmod(blur.pixels, blur.size[0])
    assert (blur.fineness * rows.max() + blur.offsets[:, 0].max()) >= blur.fineness * blur.size[1]


def test_kernels_sum_to_one(blur: Blur):
    np.testing.assert_allclose(np.add.reduceat(blur.weights, blur.firsts[:-1]), 1, atol=1e-5)


def steps_of(blur: Blur, count: int) -> np.ndarray:
    return np.full(len(blur.tiles), count, np.int32)


def values_of(blur: Blur, box: np.ndarray) -> tuple[slice, slice]:
    """Return rows and columns of the pixels whose values a tile uses to estimate a box."""
    across = whole_groups(blur.reach)
    top, bottom, left, right = box
    rows = slice(max(top - blur.reach, 0), bottom + blur.reach)
    return rows, slice(max(left - across, 0), right + across)


@pytest.mark.usefixtures("small_tiles")
def test_tiles_partition_image_and_contain_dependencies(blur: Blur):
    width, height = blur.size
    coverage = np.zeros((height, width), int)
    matrix, indices = blur.matrix(), np.full((height, width), -1)
    indices.ravel()[blur.pixels] = np.arange(len(blur.pixels))
    assert len(blur.tiles) > 1
    for own, explained in blur.tiles:
        coverage[own[0] : own[1], own[2] : own[3]] += 1
        inside = np.zeros((height, width), bool)
        inside[values_of(blur, explained)] = True
        fine = np.repeat(np.repeat(inside, blur.fineness, axis=0), blur.fineness, axis=1).ravel()
        indices_in_tile = indices[explained[0] : explained[1], explained[2] : explained[3]]
        assert (
            not np.asarray(matrix[indices_in_tile[indices_in_tile >= 0]].sum(axis=0))
            .ravel()[~fine]
            .any()
        )
        depends = np.repeat(
            np.repeat(_box(own, coverage.shape), blur.fineness, axis=0), blur.fineness, axis=1
        ).ravel()
        needed = np.asarray(matrix @ depends.astype(np.float32)) > 0
        assert np.isin(np.flatnonzero(needed), indices_in_tile).all()
    assert (coverage == 1).all()


def _box(box: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    inside = np.zeros(shape, bool)
    inside[box[0] : box[1], box[2] : box[3]] = True
    return inside


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("channels", [1, 3])
def test_forward_model_matches_matrix(blur: Blur, kind, channels: int):
    """Image with known fine values: initially, each is the mean of the pixels it touches."""
    roots = random_roots(blur, channels)
    fine = np.repeat(np.repeat(roots, 2, axis=0), 2, axis=1)
    padded = np.pad(fine, ((1, 0), (1, 0), (0, 0)), "edge")
    fine = (padded[1:, 1:] + padded[:-1, 1:] + padded[1:, :-1] + padded[:-1, :-1]) / 4
    sharp = kind(blur).start(roots, roots)
    light = (fine**2).reshape(blur.size[1], 2, blur.size[0], 2, channels).mean(axis=(1, 3))
    np.testing.assert_allclose(sharp.light(), light, atol=1e-5)
    blurred = sharp.blurred()
    expected = blur.matrix() @ (fine**2).reshape(-1, channels)
    np.testing.assert_allclose(blurred.reshape(-1, channels)[blur.pixels], expected, atol=1e-5)
    assert not blurred[~blur.known].any()
    right, down = np.zeros_like(fine), np.zeros_like(fine)
    right[:, :-1], down[:-1] = np.diff(fine, axis=1), np.diff(fine, axis=0)
    steepness = np.sqrt((right**2 + down**2).sum(axis=2) + 0.005**2)
    logarithms = np.log(steepness).reshape(blur.size[1], 2, blur.size[0], 2).mean(axis=(1, 3))
    np.testing.assert_allclose(sharp.log_steepness(), logarithms, atol=1e-4)


def concentrated(blur: Blur, by_pixel: np.ndarray) -> Blur:
    """Return the same blur with the given concentration of its kernels."""

    class SpecifiedConcentration(Blur):
        concentration = np.ascontiguousarray(by_pixel)

    return SpecifiedConcentration(*blur)


def test_concentration_is_row_norm(blur: Blur):
    matrix = blur.matrix()
    rows, columns = np.divmod(blur.pixels, blur.size[0])
    inside = (
        np.minimum.reduce([rows, columns, blur.size[1] - 1 - rows, blur.size[0] - 1 - columns])
        >= blur.reach
    )
    lengths = np.sqrt(np.asarray(matrix.power(2).sum(axis=1)).ravel())
    assert inside.sum() > 1000
    np.testing.assert_allclose(
        blur.concentration.ravel()[blur.pixels[inside]], lengths[inside] / 2, rtol=1e-4
    )


@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_step_size_follows_concentration(name: str):
    """Squares with noise: with 0.1 or 10 times the concentration, conjugate gradients leave more
    blur."""
    problem = BlurProblem(radial_blur_of(with_fewer_pixels(om.load_sensor(name), 144, 0.5)))
    rng = np.random.default_rng(8)
    light = np.kron(rng.random((18, 18)), np.ones((8, 8))).astype(np.float32)[..., None]
    fine = np.repeat(np.repeat(light, 2, axis=0), 2, axis=1)
    roots = np.sqrt(light)
    roots.reshape(-1, 1)[problem.blur.pixels] = np.sqrt(problem.blur.matrix() @ fine.reshape(-1, 1))
    roots = np.maximum(roots + 0.01 * rng.standard_normal(roots.shape), 0).astype(np.float32)
    noise, errors = np.full(roots.shape[:2], 0.01, np.float32), []
    for times in (0.1, 1, 10):
        blur = concentrated(problem.blur, np.float32(times) * problem.blur.concentration)
        sharp = solve(
            (None, deblurring_of(blur)), problem.widening, roots, noise, noise, Effort(0, 4, 4)
        )
        errors.append(((sharp.light() - light)[problem.known_pixels] ** 2).mean())
    assert errors[1] < 0.95 * min(errors[0], errors[2]), errors


@pytest.mark.usefixtures("small_tiles")
@pytest.mark.parametrize("kind", KINDS)
def test_iterations_reduce_residual(blur: Blur, kind):
    """Squares blurred by the matrix itself: the residual decreases to 10 %."""
    width, height = blur.size
    squares = np.kron(
        np.random.default_rng(6).random((height // 5, width // 5)), np.ones((10, 10))
    )[..., None]
    roots = np.full((height, width, 1), 0.5, np.float32)
    roots.reshape(-1, 1)[blur.pixels] = np.sqrt(blur.matrix() @ (squares**2).reshape(-1, 1))
    sharp = kind(blur).start(roots, roots)
    targets, left = roots.reshape(-1, 1)[blur.pixels], []
    for _ in range(4):
        blurred = sharp.blurred().reshape(-1, 1)[blur.pixels]
        left.append(float(((np.sqrt(blurred) - targets) ** 2).mean()))
        sharp.improve(np.full((height, width), 1e-4, np.float32), steps_of(blur, 8))
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.01 * left[0]


@pytest.mark.parametrize("kind", KINDS)
def test_large_difference_cost_flattens_image(blur: Blur, kind):
    roots = 0.4 + 0.2 * random_roots(blur)
    sharp = kind(blur).start(roots, roots)
    for _ in range(3):
        sharp.improve(np.full(roots.shape[:2], 10, np.float32), steps_of(blur, 30))
    values = np.sqrt(sharp.light()).reshape(-1, 3)[blur.pixels]
    assert values.std() < 0.2 * roots.reshape(-1, 3)[blur.pixels].std()
    assert values.mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.usefixtures("small_tiles")
@pytest.mark.parametrize("kind", KINDS)
def test_values_far_from_known_pixels_are_unchanged(kind):
    sensor = with_fewer_pixels(om.load_sensor("paper-hyperboloidal"), 96, 0.5)
    imager = Imager(130, 140, sensor.imager.pixel_pitch_um, centre_px=(40.0, 50.0))
    blur = BlurProblem(radial_blur_of(replace(sensor, imager=imager))).blur
    roots = random_roots(blur)
    sharp = kind(blur).start(roots, roots)
    before = sharp.light()
    sharp.improve(np.full(roots.shape[:2], 0.02, np.float32), steps_of(blur, 4))
    changes = np.abs(sharp.light() - before).max(axis=2) > 0
    near = np.zeros(changes.shape, bool)
    for _, explained in blur.tiles:
        near[values_of(blur, explained)] = True
    assert near.mean() < 0.8
    assert not changes[~near].any()
    assert changes[blur.known].all()


@pytest.mark.usefixtures("small_tiles")
@pytest.mark.parametrize("kind", KINDS)
def test_tiles_without_steps_are_unchanged(blur: Blur, kind):
    roots, costs = random_roots(blur), np.full(blur.size[::-1], 0.02, np.float32)
    steps = steps_of(blur, 3) * (np.arange(len(blur.tiles)) % 2 == 0)
    some, all_, none = (kind(blur).start(roots, roots) for _ in range(3))
    for _ in range(2):  # the second run must not depend on data left by the first
        all_.improve(costs, steps_of(blur, 3))
    some.improve(costs, steps_of(blur, 3))
    once = some.light()
    some.improve(costs, steps)
    light, twice = some.light(), all_.light()
    for (tile, _), count in zip(blur.tiles, steps, strict=True):
        region = slice(tile[0], tile[1]), slice(tile[2], tile[3])
        np.testing.assert_array_equal(light[region], (twice if count else once)[region])
    none.improve(costs, steps_of(blur, 0))
    np.testing.assert_array_equal(none.light(), kind(blur).start(roots, roots).light())
    np.testing.assert_array_equal(
        none.log_steepness(), kind(blur).start(roots, roots).log_steepness()
    )


@needs_compiled
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("block", [1, 2, 4, 8])
def test_pixels_with_shared_kernel_are_grouped(
    monkeypatch: pytest.MonkeyPatch, block: int, channels: int
):
    monkeypatch.setattr(blur_model, "_block_px", lambda sizes, whole_radius_px: block)
    blur = BlurProblem(
        radial_blur_of(with_fewer_pixels(om.load_sensor("paper-spherical"), 100, 0.4))
    ).blur
    roots = random_roots(blur, channels)
    one, other = (kind(blur).start(roots, roots) for kind in (CompiledDeblurring, SparseDeblurring))
    for sharp in (one, other):
        sharp.improve(np.full(roots.shape[:2], 0.02, np.float32), steps_of(blur, 3))
    np.testing.assert_allclose(one.light(), other.light(), atol=2e-5)


# Effect of float32 rounding, in light: if each root is perturbed in its last bit, the sparse
# implementation differs from itself by so much in 0.1 % of the values, and by so little in half of
# them, at worst of twelve images. Three times that are accepted; the two implementations differ by
# up to 2.5 times as much. Single values can diverge after many steps (3e-2).
@needs_compiled
@pytest.mark.parametrize(
    ("tile_px", "effort", "of_thousandth", "of_half"),
    [
        (128, Effort(0, 1, 3), 1.2e-6, 1.0e-7),
        (40, Effort(0, 3, 3), 5.4e-5, 1.5e-7),
        (40, Effort(2, 2, 3), 1.2e-4, 1.5e-7),
        (128, Effort(0, 6, 8), 3.4e-4, 9.8e-7),
    ],
)
@pytest.mark.parametrize("instructions", few(["plain", "best"], "best"))
@pytest.mark.parametrize("channels", few([1, 3], 3))
def test_compiled_solver_matches_matrices(
    monkeypatch: pytest.MonkeyPatch,
    blur: Blur,
    coarse_blur: Blur,
    channels: int,
    instructions: str,
    tile_px: int,
    effort: Effort,
    of_thousandth: float,
    of_half: float,
):
    monkeypatch.setattr(blur_model, "TILE_PX", tile_px)
    roots = random_roots(blur, channels)
    widening, noise = (np.full(roots.shape[:2], value, np.float32) for value in (2.0, 0.02))
    before = backend.name
    if instructions == "plain":
        backend.kernels.set_instruction_set("plain")
    try:
        one, other = (
            solve(
                (kind(coarse_blur) if effort.coarse_rounds else None, kind(blur)),
                widening,
                roots,
                noise,
                noise,
                effort,
            )
            for kind in (CompiledDeblurring, SparseDeblurring)
        )
        for output, expected in ((one.light(), other.light()), (one.blurred(), other.blurred())):
            apart = np.quantile(np.abs(output - expected), [0.999, 0.5])
            assert (apart < 3 * np.array([of_thousandth, of_half])).all(), apart
    finally:
        backend.kernels.set_instruction_set(before)


@needs_compiled
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_tiled_restoration_matches_full_image(monkeypatch: pytest.MonkeyPatch, name: str):
    """Including tile boundaries: a checkerboard is restored equally well."""
    problem = BlurProblem(radial_blur_of(with_fewer_pixels(om.load_sensor(name), 160, 0.625)))
    columns = np.arange(160) // 9 % 2
    light = np.where(columns ^ columns[:, None], 0.5, 0.1).astype(np.float32)[..., None]
    roots = np.sqrt(light)
    roots.reshape(-1, 1)[problem.blur.pixels] = np.sqrt(
        problem.blur.matrix() @ np.repeat(np.repeat(light, 2, axis=0), 2, axis=1).reshape(-1, 1)
    )
    noise, errors = np.full(roots.shape[:2], 0.01, np.float32), []
    for tile_px in (160, 56):
        monkeypatch.setattr(blur_model, "TILE_PX", tile_px)
        sharp = solve(
            (None, CompiledDeblurring(problem.blur)),
            problem.widening,
            roots,
            noise,
            noise,
            Effort(0, 5, 6),
        )
        errors.append((sharp.light() - light)[..., 0] ** 2)
    edges = np.isin(np.arange(160), [n + at for n in (56, 112) for at in range(-4, 4)])
    assert {int(tile[1]) for tile, _ in problem.blur.tiles} == {56, 112, 160}
    whole, tiled = errors
    for where in (problem.known_pixels, problem.known_pixels & (edges | edges[:, None])):
        assert (
            tiled[where].mean()
            < 1.02 * whole[where].mean()
            < 0.5 * ((roots**2 - light)[..., 0] ** 2)[where].mean()
        )


@needs_compiled
def test_invalid_arrays_raise(blur: Blur):
    deblurring = CompiledDeblurring(blur)
    with pytest.raises(ValueError, match="roots must have shape"):
        deblurring.start(*2 * [np.zeros((5, 4, 3), np.float32)])
    for guess in (np.zeros((5, 4, 3), np.float32), random_roots(blur, 1)):
        with pytest.raises(ValueError, match="guess must have shape"):
            deblurring.start(random_roots(blur), guess)
    sharp = deblurring.start(*2 * [random_roots(blur)])
    with pytest.raises(ValueError, match="costs must have shape"):
        sharp.improve(np.zeros((5, 4), np.float32), steps_of(blur, 1))
    with pytest.raises(ValueError, match="steps must have shape"):
        sharp.improve(np.zeros(blur.size[::-1], np.float32), steps_of(blur, 1)[1:])
    with pytest.raises(ValueError, match="kernels must be -1 or less than"):
        CompiledDeblurring(
            concentrated(blur._replace(kernels=blur.kernels + 10**6), blur.concentration)
        )
    with pytest.raises(ValueError, match="concentration must have shape"):
        CompiledDeblurring(concentrated(blur, blur.concentration[1:]))
    with pytest.raises(ValueError, match="kernels must contain a kernel for each pixel"):
        CompiledDeblurring(blur._replace(kernels=np.full_like(blur.kernels, -1)))
    with pytest.raises(ValueError, match="kernels must have shape"):
        CompiledDeblurring(blur._replace(kernels=np.ascontiguousarray(blur.kernels[:, :-1])))

    class Wide(Blur):
        tiles = np.full((1, 2, 4), 10**6, np.int32)

    with pytest.raises(ValueError, match="tiles must be inside the image"):
        CompiledDeblurring(Wide(*blur))
