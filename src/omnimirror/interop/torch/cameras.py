"""What a camera offers to programs that learn: projection, rays, and pictures sampled where points appear."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ...arguments import choice, instance, shown
from ...dewarp.screens import Screen
from ...errors import InvalidParameter
from .library import Tensor, torch

AT_ONCE = 1 << 16
"""Rays worked on at a time by a processor, whose cache holds their numbers."""
OUTSIDE = -2.0
"""In a grid: outside the picture, whatever is sampled there."""


class TorchRays(NamedTuple):
    """Rays in the world frame, one per pixel asked for; 0 and without a gradient where not valid."""

    origins: Tensor
    """(.., 3) mm."""
    directions: Tensor
    """(.., 3) unit vectors from the sensor to the object."""
    valid: Tensor
    """(..) bool."""


class TorchProjection(NamedTuple):
    """Pixels, one per point or direction asked for; 0 and without a gradient where not valid."""

    pixels: Tensor
    """(.., 2) px, (u, v) with integers at pixel centres."""
    valid: Tensor
    """(..) bool: False where the point is out of view or its image falls outside the picture."""


class TorchCamera(ABC):
    """A camera whose answers are tensors, differentiable by what they were asked and by its free parameters.

    Attributes
    ----------
    parameters
        Free parameters by the names of the sensor file, scalars that require gradients: give them to an optimiser.
    image_size
        (width, height) px.
    """

    parameters: dict[str, Tensor]
    image_size: tuple[int, int]
    device: object
    dtype: object

    def project(self, points_mm: Tensor) -> TorchProjection:
        """Pixels of points (.., 3) mm of the world frame; InvalidParameter for what is no such tensor here."""
        return self._projected(self._rows("points_mm", points_mm, 3), points_mm.shape[:-1], distant=False)

    def project_directions(self, directions: Tensor) -> TorchProjection:
        """Pixels of infinitely distant points in directions (.., 3) of any length; refused as by ``project``."""
        return self._projected(self._rows("directions", directions, 3), directions.shape[:-1], distant=True)

    def backproject(self, pixels: Tensor) -> TorchRays:
        """Rays of pixels (.., 2) into the world; refused as by ``project``."""
        return self._rays(self._rows("pixels", pixels, 2), pixels.shape[:-1])

    @abstractmethod
    def _projected(self, targets: Tensor, shape: Sequence[int], distant: bool) -> TorchProjection:
        """Pixels of points or directions (n, 3), in a shape."""

    @abstractmethod
    def _rays(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        """Rays of pixels (n, 2), in a shape."""

    def _rows(self, name: str, what: Tensor, columns: int) -> Tensor:
        """What is asked for, as rows (n, columns)."""
        check_tensor(name, what, f"(.., {columns})")
        if what.device != self.device:
            raise InvalidParameter(
                f"{name} are on {what.device} and the camera is on {self.device}; both have to be on one device: "
                f"differentiable(.., device={str(what.device)!r}) or .to({str(self.device)!r})"
            )
        return what.reshape(-1, columns)

    def grid(self, pixels: Tensor) -> Tensor:
        """Pixels as :func:`torch.nn.functional.grid_sample` takes them with ``align_corners=False``.

        Parameters
        ----------
        pixels : (.., 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        (.., 2) tensor
            -1 and 1 are the outer edges of the picture.

        Examples
        --------
        >>> import omnimirror as om, torch
        >>> from omnimirror.interop.torch import differentiable
        >>> camera = differentiable(om.load_sensor("paper-spherical"))
        >>> camera.grid(torch.tensor([[511.5, -0.5]])).tolist()
        [[0.0, -1.0]]
        """
        check_tensor("pixels", pixels, "(.., 2)")
        size = torch.tensor(self.image_size, dtype=pixels.dtype, device=pixels.device)
        return (2 * pixels + 1) / size - 1

    def view_grid(self, screen: Screen) -> Tensor:
        """A view of the camera's pictures as a grid, differentiable by the free parameters.

        Parameters
        ----------
        screen
            Of :mod:`omnimirror.screens`.

        Returns
        -------
        (rows, columns, 2) tensor
            For :func:`torch.nn.functional.grid_sample`; -2 where the view shows nothing.

        Examples
        --------
        >>> import omnimirror as om
        >>> from omnimirror.interop.torch import differentiable
        >>> ahead = om.screens.Plane((32, 24), hfov_deg=60.0)
        >>> differentiable(om.load_sensor("paper-spherical")).view_grid(ahead).shape
        torch.Size([24, 32, 2])
        """
        width, height = instance("screen", screen, Screen, "a screen of omnimirror.screens").size
        targets = screen.targets_at(*np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)))
        xyz = torch.as_tensor(targets, dtype=self.dtype, device=self.device)
        seen = self.project_directions(xyz) if screen.is_distant else self.project(xyz)
        return torch.where(seen.valid[..., None], self.grid(seen.pixels), OUTSIDE)

    def sample(self, pictures: Tensor, pixels: Tensor, *, mode: str = "bilinear") -> Tensor:
        """Pictures at pixels, differentiable by both.

        Parameters
        ----------
        pictures : (n, channels, height, width) or (channels, height, width)
            Of the camera.
        pixels : (n, .., 2) or (.., 2)
            Pixels (u, v): for each of n pictures its own.
        mode
            ``"bilinear"``, ``"bicubic"`` or ``"nearest"``.

        Returns
        -------
        (n, channels, ..) or (channels, ..) tensor
            0 outside the picture.

        Raises
        ------
        InvalidParameter
            For another mode, what is no tensor of ``torch.float64`` or ``torch.float32``, or pictures and pixels that
            do not belong together.

        Examples
        --------
        >>> import omnimirror as om, torch
        >>> from omnimirror.interop.torch import differentiable
        >>> camera = differentiable(om.load_sensor("paper-spherical"))
        >>> ramp = torch.arange(1024.0).expand(1, 1024, 1024)  # as bright as the column's number
        >>> camera.sample(ramp, torch.tensor([[100.25, 7.0]])).round(decimals=3)
        tensor([[100.2500]])
        """
        choice("mode", mode, ("bilinear", "bicubic", "nearest"))
        check_tensor("pictures", pictures, "(.., channels, height, width)")
        check_tensor("pixels", pixels, "(.., 2)")
        if pictures.ndim == 3:
            return self.sample(pictures[None], pixels[None], mode=mode)[0]
        if pictures.ndim != 4 or pixels.shape[0] != len(pictures) or pixels.shape[-1] != 2:
            raise InvalidParameter(
                f"pictures {tuple(pictures.shape)} and pixels {tuple(pixels.shape)} do not belong together; valid are "
                "(n, channels, height, width) and (n, .., 2), or both without n"
            )
        grid = self.grid(pixels).reshape(len(pixels), 1, -1, 2).to(pictures.dtype)
        found = torch.nn.functional.grid_sample(pictures, grid, mode=mode, align_corners=False)
        return found.reshape(*pictures.shape[:2], *pixels.shape[1:-1])


def precisions() -> tuple[object, ...]:
    """Types of numbers that a camera can be asked in."""
    return torch.float64, torch.float32


def check_tensor(name: str, value: Any, shape: str) -> None:
    """Refuse what is no tensor of such numbers; ``shape`` says its axes in words, the last by its length or a name."""
    last, is_tensor = shape.strip("()").split(", ")[-1], isinstance(value, torch.Tensor)
    if is_tensor and value.dtype in precisions() and (not last.isdigit() or value.shape[-1:] == (int(last),)):
        return
    found = f"{value.dtype} {tuple(value.shape)}" if is_tensor else shown(value)
    raise InvalidParameter(f"{name} = {found}; valid is a tensor {shape} of torch.float64 or torch.float32")


def pieces_of(count: int, device: str) -> Iterator[slice]:
    """Slices that a processor works on one after the other; a graphics card takes all at once."""
    ends = range(0, count, AT_ONCE) if device == "cpu" and count > AT_ONCE else (0,)
    yield from (slice(a, b) for a, b in pairwise((*ends, count)))
