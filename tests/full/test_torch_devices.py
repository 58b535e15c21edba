"""Differentiable cameras on a GPU against the CPU; skipped without a GPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.interop.torch import differentiable
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import sensor_of

torch = pytest.importorskip("torch", reason="PyTorch is installed by `make test-full` only")
from tests.full.test_torch import FREE, LENS, PAIRS, POSE, SPH, needs_gpu, others, sample_inputs  # noqa: E402

pytestmark = pytest.mark.full

GPU = "cuda"


def compare(sensor, px: float = 1e-6, dtype=torch.float64, share: float = 1.0) -> None:
    """Compare results on a GPU with NumPy."""
    camera = differentiable(sensor, dtype=dtype, device=GPU)
    for name, inputs in sample_inputs(sensor).items():
        truth = getattr(sensor, name)(inputs)
        result = getattr(camera, name)(torch.from_numpy(inputs).to(GPU, dtype))
        assert all(part.is_cuda for part in result)
        both = result.valid.cpu().numpy() & truth.valid
        assert both.sum() >= share * max(truth.valid.sum(), result.valid.sum().item()) > 100
        for tensor, array in zip(result[:-1], truth[:-1], strict=True):
            np.testing.assert_allclose(
                tensor.detach().cpu().numpy()[both], array[both], rtol=0, atol=px
            )
            assert not tensor[~result.valid].any()


@needs_gpu
@pytest.mark.parametrize("sensor", PAIRS)
@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_results_equal_numpy_on_a_gpu(sensor, pose):
    compare(replace(sensor, mirror_pose=pose))


@needs_gpu
def test_single_precision_and_distortion_on_a_gpu():
    compare(replace(SPH, mirror_pose=POSE), px=2e-3, dtype=torch.float32, share=0.99)
    compare(replace(SPH, lens=LENS, mirror_pose=POSE))


@needs_gpu
@pytest.mark.parametrize("index", range(4), ids=["tube", "two mirrors", "tilted imager", "unified"])
def test_numerical_cameras_return_tensors_on_the_gpu(index):
    compare(others()[index], 1e-12)


@needs_gpu
@pytest.mark.parametrize("kind", sorted(FREE))
def test_gradients_equal_those_of_the_cpu(kind):
    """Gradients by inputs and parameters; ``test_torch`` compares those of the CPU with differences."""
    sensor = replace(sensor_of(kind), mirror_pose=POSE)
    free = (FREE[kind], "focal", "centre", "distortion", "distance", "decentre", "tilt")
    for name, inputs in sample_inputs(sensor, 400).items():
        points = inputs[getattr(sensor, name)(inputs).valid][:150]
        gradients = []
        for device in ("cpu", GPU):
            camera = differentiable(sensor, free, device=device)
            leaf = torch.from_numpy(points).to(device).requires_grad_()
            values = torch.cat(getattr(camera, name)(leaf)[:-1], dim=-1)
            weights = (
                torch.linspace(0.5, 1.5, values.numel(), dtype=torch.float64)
                .reshape(values.shape)
                .to(device)
            )
            (values * weights).sum().backward()
            numbers = [leaf.grad, *(number.grad for number in camera.parameters.values())]
            gradients.append(
                [0.0 if number is None else number.cpu().numpy() for number in numbers]
            )
        for ours, theirs in zip(*gradients, strict=True):
            np.testing.assert_allclose(
                ours, theirs, rtol=1e-6, atol=1e-8 * max(np.abs(theirs).max(), 1.0)
            )


@needs_gpu
def test_gradients_of_numerical_cameras_on_a_gpu():
    camera, sensor = (
        (differentiable(others()[1], ("focal",), device=device) for device in ("cpu", GPU)),
        others()[1],
    )
    inputs = sample_inputs(sensor, 60)["project"]
    points = inputs[sensor.project(inputs).valid][:8]
    rates = []
    for one in camera:
        leaf = torch.from_numpy(points).to(one.device).requires_grad_()
        one.project(leaf).pixels.sum().backward()
        rates.append(
            [leaf.grad.cpu().numpy(), *(float(number.grad) for number in one.parameters.values())]
        )
    for ours, theirs in zip(*rates, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


@needs_gpu
def test_grid_sample_on_a_gpu_equals_the_dewarper():
    image = om.render_image(SPH, om.Room(texel_mm=20.0), samples=1)
    ahead = om.screens.Plane((160, 120), hfov_deg=70.0, tilt_deg=-10.0)
    tensor = torch.from_numpy(image.copy()).permute(2, 0, 1).to(GPU, torch.float64)[None]
    camera = differentiable(SPH, device=GPU)
    view = torch.nn.functional.grid_sample(
        tensor, camera.view_grid(ahead)[None], align_corners=False
    )
    assert (
        np.abs(
            view[0].permute(1, 2, 0).cpu().numpy() - om.Dewarper(SPH, ahead, "linear")(image)
        ).max()
        <= 1.01
    )


@needs_gpu
def test_inputs_on_another_device_raise():
    points = torch.ones(3, 3, dtype=torch.float64)
    for inputs, camera in (
        (points.to(GPU), differentiable(SPH)),
        (points, differentiable(SPH, device=GPU)),
    ):
        with pytest.raises(
            InvalidParameter,
            match=r"must be on the device of the camera.*differentiable\(\.\.\., device=",
        ):
            camera.project(inputs)
    with pytest.raises(
        InvalidParameter, match=r"device must be available to PyTorch.*; got 'cuda:99'"
    ):
        differentiable(SPH, device="cuda:99")
