"""Dewarping of PyTorch tensors against the samplers of the package, on the CPU and a GPU."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.sampling import sample_positions
from tests.dewarp.test_interfaces import CAMERA, PANORAMA, RANGES, VIEW, image_of

torch = pytest.importorskip("torch", reason="PyTorch is an optional dependency")
DEVICES = [
    "cpu",
    pytest.param(
        "cuda",
        marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="PyTorch has no GPU"),
    ),
]
INTERPOLATIONS = ["auto", "nearest", "linear", "cubic", "area"]
TOLERANCES = {"uint8": 1, "uint16": 2, "int16": 2, "float32": 1.3e-4, "float64": 1.3e-4}
"""Only the compiled samplers quantise fractions of a pixel, to 1/255 or 1/65535."""


def dewarped(dewarp: om.Dewarper, image: np.ndarray, device: str) -> np.ndarray:
    """Dewarp an image (h, w, c) by PyTorch."""
    tensor = torch.from_numpy(image).permute(2, 0, 1).to(device)
    result = om.torch.TorchDewarper(dewarp)(tensor)
    assert (result.dtype, result.device) == (tensor.dtype, tensor.device)
    return result.permute(1, 2, 0).cpu().numpy()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("dtype", RANGES)
def test_tensors_agree_with_arrays(dtype, interpolation, device, beside):
    image = image_of(dtype, 3)
    for view in (VIEW, PANORAMA):
        dewarp = om.Dewarper(CAMERA, view, interpolation, border=1, keep_map=True)
        result, expected = dewarped(dewarp, image, device), dewarp(image)
        difference = np.abs(result.astype(float) - expected.astype(float)).max()
        label = f"views of {dtype} tensors by TorchDewarper, maximum difference"
        beside("PyTorch", label, difference, TOLERANCES[dtype], "")
        assert expected.std() > 0.1 * np.ptp(RANGES[dtype])


@pytest.mark.parametrize("device", DEVICES)
def test_masks_agree_with_arrays(device):
    mask = image_of("bool", 1)
    dewarp = om.Dewarper(CAMERA, VIEW, "linear", keep_map=True)
    result, share = dewarped(dewarp, mask, device), dewarp(mask.astype(float))
    is_decided = np.abs(share - 0.5) > 1e-3
    np.testing.assert_array_equal(result[is_decided], (share > 0.5)[is_decided])
    assert 0.2 < result.mean() < 0.8


@pytest.mark.parametrize("device", DEVICES)
def test_batches_are_dewarped_image_by_image(device):
    stack = torch.from_numpy(np.stack([image_of("uint8", 5), 255 - image_of("uint8", 5)]))
    images = stack.permute(0, 3, 1, 2).to(device)
    dewarp = om.torch.TorchDewarper(om.Dewarper(CAMERA, PANORAMA, "area"))
    results = dewarp(images)
    assert results.shape == (2, 5, 90, 60)
    for image, result in zip(images, results, strict=True):
        assert torch.equal(dewarp(image), result)


def test_area_is_mean_of_listed_samples():
    """An image of its coordinates yields the mean positions of the samples of each pixel."""
    v, u = np.mgrid[:252, :256].astype(np.float32)
    dewarp = om.Dewarper(CAMERA, om.screens.Plane((12, 9), 20.0, -30.0, 5.0, 70.0), "area")
    positions, indices = sample_positions(dewarp.pixel_map, "area")
    counts = np.bincount(indices)
    assert counts.min() > 4
    means = [np.bincount(indices, weights) / counts for weights in positions.T]
    result = dewarp(np.dstack([u, v, u]))[..., :2].reshape(-1, 2)
    np.testing.assert_allclose(result, np.transpose(means), atol=0.02)  # cubic ripple of a ramp


def test_gradient_of_float_images():
    dewarp = om.torch.TorchDewarper(om.Dewarper(CAMERA, VIEW, "auto"))
    image = torch.rand((1, 252, 256), dtype=torch.float64, requires_grad=True)
    dewarp(image).sum().backward()
    np.testing.assert_allclose(image.grad.sum(), 40 * 60, rtol=1e-9)


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_half_precision(dtype):
    image = torch.from_numpy(image_of("float32", 1)).permute(2, 0, 1)
    dewarp = om.torch.TorchDewarper(om.Dewarper(CAMERA, VIEW))
    result = dewarp(image.to(getattr(torch, dtype)))
    assert str(result.dtype) == f"torch.{dtype}"
    np.testing.assert_allclose(result.float(), dewarp(image), atol=0.03)


def test_used_dewarper_can_be_pickled():
    image = torch.from_numpy(image_of("uint8", 3)).permute(2, 0, 1)
    dewarp = om.torch.TorchDewarper(om.Dewarper(CAMERA, VIEW))
    expected = dewarp(image)
    assert torch.equal(pickle.loads(pickle.dumps(dewarp))(image), expected)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (np.zeros((3, 252, 256)), "images must be a torch.Tensor; got"),
        (torch.zeros((252, 256)), r"shape \(c, 252, 256\) .* of the camera; got \(252, 256\)"),
        (torch.zeros((252, 256, 3)), r"of the camera; got \(252, 256, 3\)"),
        (torch.zeros((3, 252, 256), dtype=torch.int32), "float32, float64; got int32"),
    ],
)
def test_invalid_tensor_raises(images, message):
    with pytest.raises(InvalidParameter, match=message):
        om.torch.TorchDewarper(om.Dewarper(CAMERA, VIEW))(images)


def test_invalid_dewarper_raises():
    with pytest.raises(InvalidParameter, match=r"dewarper must be an om\.Dewarper; got"):
        om.torch.TorchDewarper(VIEW)
