"""What is computed with a blur: the compiled kernels against sparse matrices, and both against what defines them."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.restoration_gain import faster

import omnimirror as om
from omnimirror.imagers import Imager
from omnimirror.native import backend
from omnimirror.simulate.restoration.blur_problem import BlurProblem
from omnimirror.simulate.restoration.blurring import Blur
from omnimirror.simulate.restoration.deconvolution import solve
from omnimirror.simulate.restoration.operators import CompiledOperator, Operator, SparseOperator
from omnimirror.simulate.restoration.round_blur import round_blur_of

needs_compiled = pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
KINDS = [SparseOperator, pytest.param(CompiledOperator, marks=needs_compiled)]


@pytest.fixture(scope="module")
def blur() -> Blur:
    """Of a sensor whose picture is cut off, so that kernels reach beyond its edge."""
    sensor = faster(om.load_sensor("paper-hyperboloidal"), 96, 0.5)
    sensor = replace(sensor, imager=Imager(90, 70, sensor.imager.pixel_pitch_um, centre_px=(40.0, 30.0)))
    return BlurProblem(round_blur_of(sensor)).blur


def random(places: int, channels: int, seed: int):
    return np.random.default_rng(seed).random((places, channels), np.float32)


def on_fine_grid(operator: Operator, channels: int, seed: int):
    return random(operator.shape[0] * operator.shape[1], channels, seed)


def stiffness_of(operator: Operator):
    """Some, and none beyond the last row and column, where there are no differences."""
    return random(operator.shape[0] * operator.shape[1], 1, 9).ravel()


def test_kernels_reach_beyond_the_edge(blur: Blur):
    rows, _ = np.divmod(blur.pixels, blur.size[0])
    assert (blur.fineness * rows.max() + blur.offsets[:, 0].max()) >= blur.fineness * blur.size[1]


def test_every_kernel_adds_up_to_one(blur: Blur):
    np.testing.assert_allclose(np.add.reduceat(blur.weights, blur.firsts[:-1]), 1, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("channels", [1, 4])
def test_spreading_is_the_transpose_of_blurring(blur: Blur, kind, channels: int):
    operator = kind(blur)
    fine, pixels = on_fine_grid(operator, channels, 1), random(len(blur.pixels), channels, 2)
    forth, back = np.vdot(operator.blur(fine), pixels), np.vdot(fine, operator.spread(pixels))
    assert forth == pytest.approx(back, rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_the_curvature_is_that_of_squares_of_residuals_and_differences(blur: Blur, kind):
    """Its scalar product with d is |slope A fine d|^2 + sum stiffness (right^2 + down^2)."""
    operator = kind(blur)
    fine, d, slope = on_fine_grid(operator, 4, 1), on_fine_grid(operator, 4, 2), random(len(blur.pixels), 4, 3)
    stiffness = stiffness_of(operator)
    product = np.empty_like(d)
    power = operator.curvature_times(fine, slope**2, stiffness, d, product)
    picture, at = d.reshape(*operator.shape, 4).astype(float), stiffness.reshape(operator.shape)
    right = (at[:, :-1, None] * np.diff(picture, axis=1) ** 2).sum()
    down = (at[:-1, :, None] * np.diff(picture, axis=0) ** 2).sum()
    explained = ((slope * (blur.matrix() @ (fine * d))).astype(float) ** 2).sum()
    assert power == pytest.approx(explained + right + down, rel=1e-4)
    assert power == pytest.approx(np.vdot(d, product), rel=1e-4)


@needs_compiled
@pytest.mark.parametrize("channels", [1, 4])
def test_compiled_kernels_and_matrices_agree(blur: Blur, channels: int):
    one, other = CompiledOperator(blur), SparseOperator(blur)
    fine, d, slope2 = (
        on_fine_grid(one, channels, 1),
        on_fine_grid(one, channels, 2),
        random(len(blur.pixels), channels, 3),
    )
    np.testing.assert_allclose(one.blur(fine), other.blur(fine), rtol=1e-5)
    np.testing.assert_allclose(one.spread(slope2), other.spread(slope2), rtol=1e-4, atol=1e-6)
    products = np.empty_like(d), np.empty_like(d)
    for operator, product in zip((one, other), products, strict=True):
        operator.curvature_times(fine, slope2, stiffness_of(one), d, product)
    np.testing.assert_allclose(*products, rtol=1e-3, atol=1e-5)


@needs_compiled
@pytest.mark.parametrize("channels", [1, 3])
def test_pictures_solved_by_compiled_kernels_and_by_matrices_are_the_same(blur: Blur, channels: int):
    roots = np.random.default_rng(4).random((blur.size[1], blur.size[0], channels), np.float32)
    widening, noise = (np.full(roots.shape[:2], value, np.float32) for value in (2.0, 0.02))
    one, other = (
        solve(kind(blur), blur.pixels, widening, roots, noise, noise) for kind in (CompiledOperator, SparseOperator)
    )
    assert np.abs(one - other).max() < 0.01
    assert np.sqrt(((one - other) ** 2).mean()) < 2e-4


@needs_compiled
def test_arrays_that_do_not_fit_are_refused(blur: Blur):
    operator = CompiledOperator(blur)
    with pytest.raises(ValueError, match="values are"):
        operator.blur(np.zeros((5, 4), np.float32))
    with pytest.raises(ValueError, match="there is no such kernel"):
        CompiledOperator(blur._replace(kernels=blur.kernels + 10**6))
    with pytest.raises(ValueError, match="pixels ascend"):
        CompiledOperator(blur._replace(pixels=np.ascontiguousarray(blur.pixels[::-1])))
