"""Differentiable camera for any camera model, traced by NumPy with finite-difference gradients.

Used for two mirrors, tubes and domes, lens prescriptions, form errors and calibrated models. It is
slower, runs on the CPU, and gradients are accurate to about eight digits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ...calibration.sensor_parameters import parameter_location, value_of
from ...cameras.camera import Camera
from ...optics.sensor import Sensor
from ._camera import TorchCamera, TorchProjection, TorchRays
from ._library import Tensor, torch
from ._parameters import SensorParameters

Mapping = Callable[[Camera, Array], tuple[Array, NDArray[np.bool_]]]
"""Function of a camera and inputs (n, k) that returns values (n, m) and validity (n,)."""

RELATIVE_STEP = 1e-5
"""Difference step relative to the input or parameter, or to 1 if that is larger."""


class NumericalCamera(TorchCamera):
    """Any camera; see :func:`omnimirror.interop.torch.differentiable`."""

    def __init__(
        self, camera: Camera, free: dict[str, Tensor], dtype: object, device: object
    ) -> None:
        self.camera, self.parameters = camera, free
        self.image_size, self.dtype, self.device = camera.image_size, dtype, device

    def _project_rows(
        self, targets: Tensor, shape: Sequence[int], distant: bool
    ) -> TorchProjection:
        pixels, valid = self._apply(_project_directions if distant else _project, targets)
        return TorchProjection(pixels.reshape(*shape, 2), valid.reshape(shape))

    def _backproject_rows(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        rays, valid = self._apply(_backproject, pixels)
        rays = rays.reshape(*shape, 6)
        return TorchRays(rays[..., :3], rays[..., 3:], valid.reshape(shape))

    def _apply(self, mapping: Mapping, inputs: Tensor) -> tuple[Tensor, Tensor]:
        parameters = self.parameters.values()
        result: tuple[Tensor, Tensor] = _function().apply(self, mapping, inputs, *parameters)
        return result

    def current_camera(self) -> Camera:
        """Return the camera with the current values of the parameters."""
        if isinstance(self.camera, Sensor):
            return SensorParameters(self.camera, self.parameters).current_sensor()
        return self.camera


def _project(camera: Camera, points_mm: Array) -> tuple[Array, NDArray[np.bool_]]:
    return camera.project(points_mm)


def _project_directions(camera: Camera, directions: Array) -> tuple[Array, NDArray[np.bool_]]:
    return camera.project_directions(directions)


def _backproject(camera: Camera, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
    rays = camera.backproject(pixels)
    return np.concatenate([rays.origins, rays.directions], axis=1), rays.valid


@lru_cache(maxsize=1)
def _function() -> Any:
    """Return the autograd function, defined when PyTorch is first used."""

    class CameraFunction(torch.autograd.Function):  # type: ignore[misc]  # lazily imported base
        @staticmethod
        def forward(
            ctx: Any, camera: NumericalCamera, mapping: Mapping, inputs: Tensor, *_: Tensor
        ) -> tuple[Tensor, Tensor]:
            current, points = camera.current_camera(), inputs.detach().cpu().double().numpy()
            values, valid = mapping(current, points)
            ctx.context = camera, current, mapping, points, valid, inputs.device, inputs.dtype
            outputs = inputs.new_tensor(np.where(valid[:, None], values, 0.0))
            mask = torch.as_tensor(valid, device=inputs.device)
            ctx.mark_non_differentiable(mask)
            return outputs, mask

        @staticmethod
        def backward(ctx: Any, gradient: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
            camera, current, mapping, points, valid, device, dtype = ctx.context
            weights = np.where(valid[:, None], gradient.detach().cpu().double().numpy(), 0.0)
            input_gradient = None
            if ctx.needs_input_grad[2]:
                columns = [
                    (weights * _input_derivative(current, mapping, points, k)).sum(axis=1)
                    for k in range(points.shape[1])
                ]
                stacked = np.stack(columns, axis=1)
                input_gradient = torch.as_tensor(stacked, dtype=dtype, device=device)
            parameter_gradients = []
            for name, value in camera.parameters.items():
                derivative = _parameter_derivative(current, mapping, points, name)
                total = torch.as_tensor((weights * derivative).sum(), dtype=value.dtype)
                parameter_gradients.append(total.to(value.device))
            return None, None, input_gradient, *parameter_gradients

    return CameraFunction


def _input_derivative(camera: Camera, mapping: Mapping, points: Array, column: int) -> Array:
    """Return derivatives (n, m) with respect to one component of the inputs."""
    step = RELATIVE_STEP * np.maximum(np.abs(points).max(axis=1), 1.0)
    sides = []
    for sign in (1.0, -1.0):
        shifted = points.copy()
        shifted[:, column] += sign * step
        sides.append(mapping(camera, shifted))
    return _difference(mapping(camera, points), sides, step[:, None])


def _parameter_derivative(camera: Camera, mapping: Mapping, points: Array, name: str) -> Array:
    """Return derivatives (n, m) with respect to a parameter of a sensor."""
    assert isinstance(camera, Sensor)
    value = value_of(camera, parameter_location(camera, name))
    step = RELATIVE_STEP * max(abs(value), 1.0)
    sides = []
    for sign in (1.0, -1.0):
        shifted = torch.tensor(value + sign * step, dtype=torch.float64)
        sides.append(mapping(SensorParameters(camera, {name: shifted}).current_sensor(), points))
    return _difference(mapping(camera, points), sides, np.full((1, 1), step))


def _difference(centre: Any, sides: list[Any], step: Array) -> Array:
    """Return central differences; one-sided if one side is not valid, 0 if both are not."""
    (upper, upper_valid), (lower, lower_valid) = sides
    up = np.where(upper_valid[:, None], upper, centre[0])
    down = np.where(lower_valid[:, None], lower, centre[0])
    width = step * np.maximum(upper_valid.astype(float) + lower_valid, 1.0)[:, None]
    derivative: Array = np.nan_to_num((up - down) / width)
    return derivative
