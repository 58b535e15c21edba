"""Interface of differentiable cameras: projection, back-projection and image sampling."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ...base.arguments import choice, format_value, instance
from ...base.errors import InvalidParameter
from ...dewarp.screens import Screen
from ._library import Tensor, torch

CPU_CHUNK_RAYS = 1 << 16
"""Rays processed at a time on a CPU, whose cache holds their intermediate values."""
OUTSIDE_GRID = -2.0
"""Grid coordinate of missing pixels, outside the image for every kernel."""
GRID_TOLERANCE = 1e-6
"""Rounding of grid coordinates at the outer edges of the image."""


class TorchRays(NamedTuple):
    """Rays in the world frame, one per pixel; 0 and without gradient if not valid."""

    origins: Tensor
    """(..., 3) mm."""
    directions: Tensor
    """(..., 3) unit vectors from the sensor to the object."""
    valid: Tensor
    """(...) bool."""


class TorchProjection(NamedTuple):
    """Pixels, one per point or direction; 0 and without gradient if not valid."""

    pixels: Tensor
    """(..., 2) px, (u, v) with integers at pixel centres."""
    valid: Tensor
    """(...) bool; False outside the field or outside the image."""


class TorchCamera(ABC):
    """Camera on tensors, differentiable with respect to its inputs and its free parameters.

    Attributes
    ----------
    parameters
        Free parameters by the names of the sensor file: scalars that require gradients, for use
        with an optimiser.
    image_size
        (width, height) px.
    """

    parameters: dict[str, Tensor]
    image_size: tuple[int, int]
    device: object
    dtype: object

    def project(self, points_mm: Tensor) -> TorchProjection:
        """Project points (..., 3) of the world frame, mm, into the image.

        Raises
        ------
        InvalidParameter
            If the tensor has another shape or type, or is on another device.
        """
        rows = self._rows("points_mm", points_mm, 3)
        return self._project_rows(rows, points_mm.shape[:-1], distant=False)

    def project_directions(self, directions: Tensor) -> TorchProjection:
        """Project points at infinity in directions (..., 3) of any length into the image.

        Raises
        ------
        InvalidParameter
            If the tensor has another shape or type, or is on another device.
        """
        rows = self._rows("directions", directions, 3)
        return self._project_rows(rows, directions.shape[:-1], distant=True)

    def backproject(self, pixels: Tensor) -> TorchRays:
        """Return the rays of pixels (..., 2) into the world.

        Raises
        ------
        InvalidParameter
            If the tensor has another shape or type, or is on another device.
        """
        return self._backproject_rows(self._rows("pixels", pixels, 2), pixels.shape[:-1])

    @abstractmethod
    def _project_rows(
        self, targets: Tensor, shape: Sequence[int], distant: bool
    ) -> TorchProjection:
        """Project points or directions (n, 3) and reshape the result."""

    @abstractmethod
    def _backproject_rows(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        """Return the rays of pixels (n, 2), reshaped."""

    def _rows(self, name: str, values: Tensor, columns: int) -> Tensor:
        """Check an input and reshape it to (n, columns)."""
        check_tensor(name, values, f"(..., {columns})")
        if values.device != self.device:
            raise InvalidParameter(
                f"{name} must be on the device of the camera, {self.device}; got {values.device}; "
                f"use differentiable(..., device={str(values.device)!r}) or "
                f".to({str(self.device)!r})"
            )
        return values.reshape(-1, columns)

    def grid(self, pixels: Tensor) -> Tensor:
        """Convert pixels to the coordinates of :func:`torch.nn.functional.grid_sample`.

        Parameters
        ----------
        pixels : (..., 2)
            Pixels (u, v), integers at pixel centres.

        Returns
        -------
        (..., 2) tensor
            Coordinates for ``align_corners=False``; -1 and 1 are the outer edges of the image.

        Examples
        --------
        >>> import omnimirror as om, torch
        >>> from omnimirror.interop.torch import differentiable
        >>> camera = differentiable(om.load_sensor("paper-spherical"))
        >>> camera.grid(torch.tensor([[511.5, -0.5]])).tolist()
        [[0.0, -1.0]]
        """
        check_tensor("pixels", pixels, "(..., 2)")
        size = torch.tensor(self.image_size, dtype=pixels.dtype, device=pixels.device)
        return (2 * pixels + 1) / size - 1

    def view_grid(self, screen: Screen) -> Tensor:
        """Return the sampling grid of a view, differentiable by the free parameters.

        Coordinates in the outer half of border pixels are clamped to the pixel centres, so that
        bilinear sampling with zero padding does not mix the border of the image with 0.

        Parameters
        ----------
        screen
            Screen of :mod:`omnimirror.screens`.

        Returns
        -------
        (rows, columns, 2) tensor
            Grid for :func:`torch.nn.functional.grid_sample` with ``align_corners=False``; -2
            outside the field.

        Examples
        --------
        >>> import omnimirror as om
        >>> from omnimirror.interop.torch import differentiable
        >>> ahead = om.screens.Plane((32, 24), hfov_deg=60.0)
        >>> differentiable(om.load_sensor("paper-spherical")).view_grid(ahead).shape
        torch.Size([24, 32, 2])
        """
        width, height = instance("screen", screen, Screen, "a screen of omnimirror.screens").size
        columns, rows = np.arange(width, dtype=float), np.arange(height, dtype=float)
        targets = screen.targets_at(*np.meshgrid(columns, rows))
        targets = torch.as_tensor(targets, dtype=self.dtype, device=self.device)
        project = self.project_directions if screen.is_distant else self.project
        pixels, valid = project(targets)
        last = torch.tensor(self.image_size, dtype=pixels.dtype, device=pixels.device) - 1
        clamped = torch.minimum(pixels.clamp(min=0), last)
        return torch.where(valid[..., None], self.grid(clamped), OUTSIDE_GRID)

    def sample(self, images: Tensor, pixels: Tensor, *, mode: str = "bilinear") -> Tensor:
        """Sample images at pixels, differentiable with respect to both.

        Parameters
        ----------
        images : (n, channels, height, width) or (channels, height, width)
            Images of the camera.
        pixels : (n, ..., 2) or (..., 2)
            Pixels (u, v) for each image.
        mode
            ``"bilinear"``, ``"bicubic"`` or ``"nearest"``.

        Returns
        -------
        (n, channels, ...) or (channels, ...) tensor
            Samples; 0 outside the image. Border pixels are replicated under the kernel.

        Raises
        ------
        InvalidParameter
            If the mode is unknown, an input is not a tensor of ``torch.float64`` or
            ``torch.float32``, or the shapes do not match.

        Examples
        --------
        >>> import omnimirror as om, torch
        >>> from omnimirror.interop.torch import differentiable
        >>> camera = differentiable(om.load_sensor("paper-spherical"))
        >>> ramp = torch.arange(1024.0).expand(1, 1024, 1024)  # value = column
        >>> camera.sample(ramp, torch.tensor([[100.25, 7.0]])).round(decimals=3)
        tensor([[100.2500]])
        """
        choice("mode", mode, ("bilinear", "bicubic", "nearest"))
        check_tensor("images", images, "(..., channels, height, width)")
        check_tensor("pixels", pixels, "(..., 2)")
        if images.ndim == 3:
            return self.sample(images[None], pixels[None], mode=mode)[0]
        if images.ndim != 4 or pixels.shape[0] != len(images):
            raise InvalidParameter(
                "images and pixels must have the shapes (n, channels, height, width) and "
                "(n, ..., 2), or both without n; "
                f"got {tuple(images.shape)} and {tuple(pixels.shape)}"
            )
        grid = self.grid(pixels).reshape(len(pixels), 1, -1, 2).to(images.dtype)
        samples = torch.nn.functional.grid_sample(
            images, grid, mode=mode, padding_mode="border", align_corners=False
        )
        inside = (grid.abs() <= 1 + GRID_TOLERANCE).all(dim=-1)
        samples = torch.where(inside[:, None], samples, 0.0)
        return samples.reshape(*images.shape[:2], *pixels.shape[1:-1])


def supported_dtypes() -> tuple[object, ...]:
    """Return the floating-point types that cameras support."""
    return torch.float64, torch.float32


def check_tensor(name: str, value: Any, shape: str) -> None:
    """Check type and last dimension of a tensor.

    Parameters
    ----------
    name
        Name of the argument.
    value
        Value to check.
    shape
        Dimensions as text, such as ``"(..., 3)"``; a numeric last dimension is checked.

    Raises
    ------
    InvalidParameter
        If the value is not such a tensor.
    """
    last, is_tensor = shape.strip("()").split(", ")[-1], isinstance(value, torch.Tensor)
    has_dtype = is_tensor and value.dtype in supported_dtypes()
    if has_dtype and (not last.isdigit() or value.shape[-1:] == (int(last),)):
        return
    actual = f"{value.dtype} {tuple(value.shape)}" if is_tensor else format_value(value)
    raise InvalidParameter(
        f"{name} must be a tensor {shape} of torch.float64 or torch.float32; got {actual}"
    )


def chunk_slices(count: int, device: str) -> Iterator[slice]:
    """Yield slices of the rays to process at a time; one slice except on a CPU."""
    is_chunked = device == "cpu" and count > CPU_CHUNK_RAYS
    starts = range(0, count, CPU_CHUNK_RAYS) if is_chunked else (0,)
    yield from (slice(a, b) for a, b in pairwise((*starts, count)))
