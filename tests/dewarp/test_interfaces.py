"""Data types, stacks, and arrays and tensors of other libraries as images of a dewarper."""

from __future__ import annotations

import array
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from PIL import Image as PillowImage
from scipy.ndimage import map_coordinates

import omnimirror as om
from omnimirror.base.errors import InvalidParameter

CAMERA = om.MirrorBall(
    centre_px=(127.0, 125.5), rim_radius_px=120.0, field_deg=270.0, image_size=(256, 252)
)
VIEW = om.screens.Plane((60, 40), 20.0, -30.0, 5.0, 70.0)
PANORAMA = om.screens.Cylinder((60, 90), -90.0, 90.0)  # no pixel above 45 deg is visible
RANGES = {
    "uint8": (0, 255),
    "uint16": (0, 65535),
    "int16": (-32768, 32767),
    "float32": (-2.0, 2.0),
    "float64": (-2.0, 2.0),
}
TOLERANCES = {"uint8": 1.5, "uint16": 1.0, "int16": 1.0, "float32": 1e-6, "float64": 0.0}


def image_of(dtype: str, *channels: int) -> np.ndarray:
    """Return random blocks of 3 x 3 px over the whole range of the type."""
    rng = np.random.default_rng(7)
    low, high = RANGES.get(dtype, (0, 1))
    blocks = rng.uniform(low, high, (84, 86, *channels))
    if dtype == "bool":
        blocks = blocks > 0.5
    elif dtype not in ("float32", "float64"):
        blocks = np.where(rng.random(blocks.shape) < 0.3, high, blocks.round())
    return blocks.repeat(3, 0).repeat(3, 1)[:252, :256].astype(dtype)


@pytest.mark.parametrize("interpolation", ["auto", "nearest", "linear", "cubic", "area"])
@pytest.mark.parametrize("dtype", RANGES)
def test_types_agree_with_float64(dtype, interpolation):
    """Integers are rounded and saturated; uint8 fractions are quantised to 1/255."""
    image = image_of(dtype, 3)
    dewarp = om.Dewarper(CAMERA, PANORAMA, interpolation)
    result, reference = dewarp(image), dewarp(image.astype(float))
    assert (result.dtype, reference.dtype) == (image.dtype, np.float64)
    if image.dtype.kind in "iu":
        reference = reference.clip(*RANGES[dtype])
    np.testing.assert_allclose(result, reference, rtol=0, atol=TOLERANCES[dtype])
    assert np.ptp(result[dewarp.valid].astype(float)) > 0.8 * np.ptp(RANGES[dtype])


@pytest.mark.parametrize("dtype", ["int16", "float64"])
def test_linear_samples_agree_with_scipy(dtype):
    image = image_of(dtype)
    dewarp = om.Dewarper(CAMERA, VIEW, "linear", keep_map=True)
    u, v = np.moveaxis(dewarp.coordinates(), -1, 0)
    expected = map_coordinates(image.astype(float), (v, u), order=1)
    scale = np.ptp(RANGES[dtype])
    np.testing.assert_allclose(dewarp(image), expected, rtol=0, atol=6e-5 * scale)


def test_cubic_overshoot_is_limited_to_int16():
    image = image_of("int16")
    dewarp = om.Dewarper(CAMERA, VIEW, "cubic")
    unlimited = dewarp(image.astype(float))
    result = dewarp(image)
    is_above = unlimited > 32768
    assert is_above.sum() > 10
    np.testing.assert_array_equal(result[is_above], 32767)


@pytest.mark.parametrize("interpolation", ["auto", "nearest", "linear"])
def test_masks_are_true_above_half(interpolation):
    mask = image_of("bool")
    dewarp = om.Dewarper(CAMERA, VIEW, interpolation)
    result, share = dewarp(mask), dewarp(mask.astype(float))
    assert result.dtype == bool
    is_decided = np.abs(share - 0.5) > 0.01
    assert is_decided.mean() > 0.9
    np.testing.assert_array_equal(result[is_decided], (share > 0.5)[is_decided])
    assert 0.2 < result.mean() < 0.8


@pytest.mark.parametrize(
    ("dtype", "border", "opaque"),
    [("int16", -5, 32767), ("float64", -0.25, 1.0), ("bool", True, True)],
)
def test_border_and_transparency(dtype, border, opaque):
    image = image_of(dtype)
    dewarp = om.Dewarper(CAMERA, PANORAMA, "nearest", border=border)
    plain, clear = dewarp(image), dewarp(image, transparent=True)
    np.testing.assert_array_equal(plain[~dewarp.valid], border)
    np.testing.assert_array_equal(clear[..., 0], plain)
    np.testing.assert_array_equal(clear[..., 3], np.where(dewarp.valid, opaque, 0))
    assert clear.dtype == dtype


@pytest.mark.parametrize(
    ("dtype", "border", "message"),
    [
        ("int16", 40000, "integers from -32768 to 32767 for int16 images; got 40000"),
        ("bool", 2, "integers from 0 to 1 for bool images; got 2"),
    ],
)
def test_border_outside_type_raises(dtype, border, message):
    with pytest.raises(InvalidParameter, match=message):
        om.Dewarper(CAMERA, VIEW, border=border)(image_of(dtype))


def test_byte_order_and_strides_have_no_effect():
    image = image_of("int16", 3)
    dewarp = om.Dewarper(CAMERA, VIEW)
    expected = dewarp(image)
    for same in (image.astype(">i2"), np.asfortranarray(image), image[::-1].copy()[::-1]):
        np.testing.assert_array_equal(dewarp(same), expected)


@pytest.mark.parametrize("dtype", ["uint8", "bool"])
def test_stacks_are_dewarped_image_by_image(dtype):
    stack = np.stack([image_of(dtype, 3), ~image_of(dtype, 3)])
    dewarp = om.Dewarper(CAMERA, VIEW)
    results = dewarp(stack)
    assert results.shape == (2, 40, 60, 3)
    for image, result in zip(stack, results, strict=True):
        np.testing.assert_array_equal(result, dewarp(image))
    out = np.empty_like(results)
    assert dewarp(stack, out=out) is out
    np.testing.assert_array_equal(out, results)
    assert dewarp(stack, transparent=True).shape == (2, 40, 60, 4)
    colours = om.ColourDewarper((CAMERA,) * 3, VIEW)
    np.testing.assert_array_equal(colours(stack), results)


def test_array_interfaces_are_read():
    image = image_of("uint8", 3)
    dewarp = om.Dewarper(CAMERA, VIEW)
    expected = dewarp(image)
    for same in (PillowImage.fromarray(image), xarray.DataArray(image)):
        np.testing.assert_array_equal(dewarp(same), expected)


class Tensor:
    """Tensor on a device, with the DLPack export of NumPy."""

    def __init__(self, values: np.ndarray, device: int = 1) -> None:
        self.values, self.device = values, device

    def __dlpack__(self, **keywords):
        return self.values.__dlpack__(**keywords)

    def __dlpack_device__(self):
        return self.device, 0

    def __array_namespace__(self):
        return SimpleNamespace(from_dlpack=lambda values: Tensor(np.from_dlpack(values)))


def test_tensors_return_tensors_of_their_library():
    image = image_of("float32", 3)
    dewarp = om.Dewarper(CAMERA, VIEW)
    result = dewarp(Tensor(image))
    assert isinstance(result, Tensor)
    np.testing.assert_array_equal(result.values, dewarp(image))
    out = np.empty((40, 60, 3), np.float32)
    assert dewarp(Tensor(image), out=out) is out


@pytest.mark.parametrize("dtype", [*RANGES, "bool"])
def test_torch_tensors(dtype):
    torch = pytest.importorskip("torch", reason="PyTorch is an optional dependency")
    stack = np.stack([image_of(dtype, 3)] * 2)
    dewarp = om.Dewarper(CAMERA, VIEW)
    result = dewarp(torch.from_numpy(stack))
    assert isinstance(result, torch.Tensor)
    np.testing.assert_array_equal(result.numpy(), dewarp(stack))


def test_torch_gradient_is_rejected():
    torch = pytest.importorskip("torch", reason="PyTorch is an optional dependency")
    image = torch.zeros((252, 256), requires_grad=True)
    with pytest.raises(InvalidParameter, match=r"DLPack can export; got a Tensor: .*detach"):
        om.Dewarper(CAMERA, VIEW)(image)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ([[1, 2]], "must be an array of pixels; got"),
        (None, "must be an array of pixels; got None"),
        (array.array("B", b"12"), "must be an array of pixels; got"),
        (Tensor(np.zeros((252, 256), np.uint8), 2), "memory of the CPU; got a Tensor on a device"),
        (np.zeros((252, 256), np.int32), "uint16, int16, float32, float64, bool; got int32"),
        (np.zeros((0, 252, 256, 3), np.uint8), "at least one image; got an array of shape"),
        (np.zeros((2, 252, 200, 3), np.uint8), "256 x 252 px of the camera; got 200 x 252 px"),
        (np.full((252, 256), 1e39), "at most 3.4e.38 or infinite; got 1e.39"),
    ],
)
def test_invalid_image_raises(image, message):
    with pytest.raises(InvalidParameter, match=message):
        om.Dewarper(CAMERA, VIEW)(image)


def test_invalid_out_of_stack_raises():
    stack = np.zeros((2, 252, 256, 3), np.uint8)
    with pytest.raises(InvalidParameter, match=r"stack of 2 images .*; got shape"):
        om.Dewarper(CAMERA, VIEW)(stack, out=np.empty((3, 40, 60, 3), np.uint8))


def test_infinite_float64_values():
    image = image_of("float64")
    image[:, 128:] = np.inf
    result = om.Dewarper(CAMERA, PANORAMA, "nearest")(image)
    assert np.isinf(result).any()
    assert np.isfinite(result).any()
