"""Cameras that are traced by NumPy alone: their derivatives are differences, by what was asked and every parameter.

Two mirrors, tubes and domes, lenses known by their surfaces, form errors, calibrated models: slower, on the processor,
and right to eight digits or so instead of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...calibrate.physical.names import place_of, value_of
from ...cameras import Camera
from ...sensor import Sensor
from .cameras import TorchCamera, TorchProjection, TorchRays
from .library import Tensor, torch
from .numbers import Numbers

Array = NDArray[np.float64]
Answer = Callable[[Camera, Array], tuple[Array, NDArray[np.bool_]]]
"""Values (n, m) and valid (n,) of what is asked (n, k)."""

STEP = 1e-5  # of what is asked, or of a parameter, or of 1 if that is larger


class OtherCamera(TorchCamera):
    """Any camera, through its contract alone; see :func:`omnimirror.interop.torch.differentiable`."""

    def __init__(self, camera: Camera, free: dict[str, Tensor], dtype: object, device: object) -> None:
        self.camera, self.parameters = camera, free
        self.image_size, self.dtype, self.device = camera.image_size, dtype, device

    def _projected(self, targets: Tensor, shape: Sequence[int], distant: bool) -> TorchProjection:
        pixels, valid = self._asked(_directions if distant else _points, targets)
        return TorchProjection(pixels.reshape(*shape, 2), valid.reshape(shape))

    def _rays(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        rays, valid = self._asked(_rays, pixels)
        rays = rays.reshape(*shape, 6)
        return TorchRays(rays[..., :3], rays[..., 3:], valid.reshape(shape))

    def _asked(self, answer: Answer, what: Tensor) -> tuple[Tensor, Tensor]:
        values: tuple[Tensor, Tensor] = _function().apply(self, answer, what, *self.parameters.values())
        return values

    def present(self) -> Camera:
        """The camera with its parameters as they are now."""
        return Numbers(self.camera, self.parameters).present() if isinstance(self.camera, Sensor) else self.camera


def _points(camera: Camera, xyz: Array) -> tuple[Array, NDArray[np.bool_]]:
    return camera.project(xyz)


def _directions(camera: Camera, xyz: Array) -> tuple[Array, NDArray[np.bool_]]:
    return camera.project_directions(xyz)


def _rays(camera: Camera, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
    rays = camera.backproject(pixels)
    return np.concatenate([rays.origins, rays.directions], axis=1), rays.valid


@lru_cache(maxsize=1)
def _function() -> Any:
    """The operation, made when PyTorch is there."""

    class Asked(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, camera: OtherCamera, answer: Answer, asked: Tensor, *_: Tensor) -> tuple[Tensor, Tensor]:
            present, at = camera.present(), asked.detach().cpu().double().numpy()
            values, valid = answer(present, at)
            ctx.question = camera, present, answer, at, valid, asked.device, asked.dtype
            found = asked.new_tensor(np.where(valid[:, None], values, 0.0))
            seen = torch.as_tensor(valid, device=asked.device)
            ctx.mark_non_differentiable(seen)
            return found, seen

        @staticmethod
        def backward(ctx: Any, pull: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
            camera, present, answer, at, valid, device, dtype = ctx.question
            weight = np.where(valid[:, None], pull.detach().cpu().double().numpy(), 0.0)
            back = None
            if ctx.needs_input_grad[2]:
                columns = [(weight * _by_column(present, answer, at, k)).sum(axis=1) for k in range(at.shape[1])]
                back = torch.as_tensor(np.stack(columns, axis=1), dtype=dtype, device=device)
            numbers = [
                torch.as_tensor((weight * _by_number(camera, present, answer, at, name)).sum(), dtype=value.dtype).to(
                    value.device
                )
                for name, value in camera.parameters.items()
            ]
            return None, None, back, *numbers

    return Asked


def _by_column(camera: Camera, answer: Answer, at: Array, column: int) -> Array:
    """Derivatives (n, m) by one component of what was asked."""
    step = STEP * np.maximum(np.abs(at).max(axis=1), 1.0)
    ends = []
    for sign in (1.0, -1.0):
        moved = at.copy()
        moved[:, column] += sign * step
        ends.append(answer(camera, moved))
    return _difference(answer(camera, at), ends, step[:, None])


def _by_number(camera: OtherCamera, present: Camera, answer: Answer, at: Array, name: str) -> Array:
    """Derivatives (n, m) by a parameter."""
    assert isinstance(present, Sensor)
    value = value_of(present, place_of(present, name))
    step = STEP * max(abs(value), 1.0)
    ends = []
    for sign in (1.0, -1.0):
        moved = torch.tensor(value + sign * step, dtype=torch.float64)
        ends.append(answer(Numbers(present, {name: moved}).present(), at))
    return _difference(answer(present, at), ends, np.full((1, 1), step))


def _difference(here: Any, ends: list[Any], step: Array) -> Array:
    """Of values either side; of one side where the other is out of view, and 0 where both are."""
    (after, seen_after), (before, seen_before) = ends
    up, down = np.where(seen_after[:, None], after, here[0]), np.where(seen_before[:, None], before, here[0])
    apart = step * np.maximum(seen_after.astype(float) + seen_before, 1.0)[:, None]
    rates: Array = np.nan_to_num((up - down) / apart)
    return rates
