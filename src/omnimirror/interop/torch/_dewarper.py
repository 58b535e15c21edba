"""Dewarping of PyTorch tensors on any device with the maps of a :class:`omnimirror.Dewarper`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from ...base.arguments import InvalidType, format_value, instance
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...dewarp import Dewarper
from ...dewarp.interfaces import KERNELS
from ...dewarp.sampling import border_values, sample_positions
from ._library import Tensor, torch

MODES = {"nearest": "nearest", "linear": "bilinear", "cubic": "bicubic"}
"""Modes of ``torch.nn.functional.grid_sample``; its cubic kernel has a = -0.75 as well."""
INTEGER_DTYPES = ("uint8", "uint16", "int16")
DTYPES = (*INTEGER_DTYPES, "bool", "float16", "bfloat16", "float32", "float64")


class _Samples(NamedTuple):
    """Samples of all output pixels on one device."""

    grid: Tensor
    """(1, 1, n, 2) positions between -1 and 1, as of ``grid_sample``."""
    indices: Tensor
    """(n,) output pixel of each sample."""
    weights: Tensor
    """(n,) reciprocal of the number of samples of the output pixel; empty if all have one."""
    outside: Tensor
    """(rows * columns,) bool: pixels without a sample."""


@dataclass(frozen=True)
class TorchDewarper:
    """Dewarper for PyTorch tensors on the CPU or a GPU.

    The samples are those of the dewarper: each output pixel is one sample, or the mean of several
    cubic samples for ``"auto"`` and ``"area"``. They are computed once and kept on each device on
    which images are dewarped. Gradients with respect to the values of images are supported.

    Parameters
    ----------
    dewarper
        Camera, view, interpolation, viewpoint and border.

    Raises
    ------
    InvalidParameter
        If the argument is not a dewarper, or a tensor does not match its camera.
    OmnimirrorError
        If PyTorch is not installed.
    OutsideField
        If, on first use, the view does not intersect the field of the camera.

    Examples
    --------
    >>> import omnimirror as om, torch
    >>> view = om.screens.Plane((64, 48), tilt_deg=-30.0)
    >>> dewarp = om.torch.TorchDewarper(om.Dewarper(om.load_sensor("paper-spherical"), view))
    >>> images = torch.full((2, 3, 1024, 1024), 200, dtype=torch.uint8)  # or device="cuda"
    >>> dewarp(images).shape, dewarp(images)[0, :, 20, 30]
    (torch.Size([2, 3, 48, 64]), tensor([200, 200, 200], dtype=torch.uint8))
    """

    dewarper: Dewarper

    def __post_init__(self) -> None:
        instance("dewarper", self.dewarper, Dewarper, "an om.Dewarper")

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __call__(self, images: Tensor) -> Tensor:
        """Return dewarped images on the same device, with the same data type.

        Parameters
        ----------
        images : (c, h, w) or (n, c, h, w) tensor
            Images of the camera's ``image_size``: uint8, uint16, int16, bool, float16, bfloat16,
            float32 or float64, with any number of channels.

        Returns
        -------
        (c, rows, columns) or (n, c, rows, columns) tensor
            Sampled in float32, or in float64 for float64 images; integers are rounded to the
            nearest and limited to the range of the type, and a bool is True where the mean is above
            0.5.

        Raises
        ------
        InvalidParameter
            If the tensor does not match the camera in shape or type.
        """
        name = self._checked_dtype(images)
        dtype = torch.float64 if name == "float64" else torch.float32
        batch = images if images.ndim == 4 else images[None]
        count, channels = batch.shape[:2]
        samples = self._samples(batch.device, dtype)
        values = self._sampled(batch.to(dtype), samples)
        width, height = self.dewarper.view.size
        if samples.weights.numel():
            sums = values.new_zeros((count, channels, height * width))
            flat = sums.index_add(2, samples.indices, values * samples.weights)
        else:
            flat = values.new_empty((count, channels, height * width))
            flat = flat.index_copy(2, samples.indices, values)
        border = torch.as_tensor(self._border(name, channels), dtype=dtype, device=batch.device)
        flat = torch.where(samples.outside, border[:, None], flat)
        result = _converted(flat, images.dtype, name).reshape(count, channels, height, width)
        return result if images.ndim == 4 else result[0]

    def _checked_dtype(self, images: Tensor) -> str:
        """Return the name of the data type of a valid tensor."""
        if not isinstance(images, torch.Tensor):
            raise InvalidType(f"images must be a torch.Tensor; got {format_value(images)}")
        width, height = self.dewarper.camera.image_size
        if images.ndim not in (3, 4) or images.shape[-2:] != (height, width) or not images.numel():
            raise InvalidParameter(
                f"images must have the shape (c, {height}, {width}) or (n, c, {height}, {width}) "
                f"of the camera; got {tuple(images.shape)}"
            )
        name = str(images.dtype).removeprefix("torch.")
        if name not in DTYPES:
            raise InvalidParameter(
                f"the type of images must be one of {', '.join(DTYPES)}; got {name}"
            )
        return name

    def _border(self, name: str, channels: int) -> tuple[float, ...]:
        """Return one border value per channel, valid for the data type."""
        dtype = name if name in (*INTEGER_DTYPES, "bool") else "float32"
        return border_values(self.dewarper.border, np.empty((1, 1, channels), dtype))

    def _sampled(self, batch: Tensor, samples: _Samples) -> Tensor:
        """Return the samples (n, c, samples) of images."""
        mode = MODES[KERNELS[self.dewarper.interpolation]]
        grid = samples.grid.expand(len(batch), -1, -1, -1)
        sample = torch.nn.functional.grid_sample
        return sample(batch, grid, mode, padding_mode="border", align_corners=False)[:, :, 0]

    def _samples(self, device: Any, dtype: Any) -> _Samples:
        if (device, dtype) not in self._device_samples:
            self._device_samples[device, dtype] = self._computed_samples(device, dtype)
        return self._device_samples[device, dtype]

    @cached_property
    def _device_samples(self) -> dict[tuple[Any, Any], _Samples]:
        return {}

    def _computed_samples(self, device: Any, dtype: Any) -> _Samples:
        interpolation = self.dewarper.interpolation
        positions, indices = sample_positions(self.dewarper.pixel_map, interpolation)
        size = np.array(self.dewarper.camera.image_size)
        # The outermost half pixel has the edge value; nearest rounds halves upwards
        centres = np.clip(positions.astype(np.float64), 0, size - 1)
        if interpolation == "nearest":
            centres = np.floor(centres + 0.5)
        grid = (2 * centres + 1) / size - 1
        columns, rows = self.dewarper.view.size
        counts = np.bincount(indices, minlength=rows * columns)
        weights = 1 / counts[indices] if counts.max(initial=0) > 1 else np.zeros(0)
        return _Samples(
            torch.as_tensor(grid[None, None], dtype=dtype, device=device),
            torch.as_tensor(indices, device=device),
            torch.as_tensor(weights, dtype=dtype, device=device),
            torch.as_tensor(counts == 0, device=device),
        )


def _converted(values: Tensor, dtype: Any, name: str) -> Tensor:
    """Return values rounded to a data type."""
    if name == "bool":
        return values > 0.5
    if name in INTEGER_DTYPES:
        limits = torch.iinfo(dtype)
        return torch.floor(values + 0.5).clamp(limits.min, limits.max).to(dtype)
    return values.to(dtype)
