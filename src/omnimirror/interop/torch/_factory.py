"""Selection of the differentiable camera for a sensor or a calibrated camera."""

from __future__ import annotations

from collections.abc import Iterable

from ...base.arguments import format_value, instance
from ...base.errors import InvalidParameter
from ...calibration.sensor_parameters import free_names, parameter_location, value_of
from ...cameras.camera import Camera
from ...optics.lenses import Orthographic, Perspective
from ...optics.sensor import Sensor
from ._camera import TorchCamera, supported_dtypes
from ._library import torch
from ._mirror_camera import MirrorCamera
from ._numerical_camera import NumericalCamera


def differentiable(
    camera: Camera, free: str | Iterable[str] = (), *, dtype: object = None, device: object = "cpu"
) -> TorchCamera:
    """Return a camera that works on PyTorch tensors with gradients.

    A sensor with one mirror, aligned or misaligned, and an ideal lens is traced by PyTorch on any
    device; gradients follow from the implicit function theorem at the reflection point. All other
    cameras (two mirrors, tubes and domes, lens prescriptions, form errors, calibrated models) are
    traced by NumPy on the CPU, with gradients by finite differences, accurate to about eight
    digits.

    Parameters
    ----------
    camera
        Sensor or calibrated camera.
    free
        Parameters of a sensor with gradients, by the names of the sensor file or by group:
        ``"shape"``, ``"focal"``, ``"centre"``, ``"distortion"``, ``"distance"``, ``"decentre"``,
        ``"tilt"``.
    dtype
        Type of the parameters and tables: ``torch.float64`` (default) or ``torch.float32``.
        Inputs should have the same type.
    device
        Device of the parameters and tables, and of all inputs: ``"cpu"``, ``"cuda"``, ...

    Returns
    -------
    TorchCamera
        Camera with ``project``, ``project_directions``, ``backproject``, ``sample``, ``grid`` and
        ``view_grid``.

    Raises
    ------
    InvalidParameter
        If a parameter does not exist, ``free`` is given for a calibrated camera, ``dtype`` is not
        supported, or ``device`` is not available.
    OmnimirrorError
        If PyTorch is not installed.

    Examples
    --------
    >>> import omnimirror as om, torch
    >>> camera = om.torch.differentiable(om.load_sensor("paper-spherical"), free=("focal", "tilt"))
    >>> list(camera.parameters)
    ['lens.focal_length_mm', 'mirror_pose.tilt_x_deg', 'mirror_pose.tilt_y_deg']
    >>> points_mm = torch.tensor([[3000.0, 400.0, -200.0]], dtype=torch.float64)
    >>> pixels, valid = camera.project(points_mm)
    >>> pixels[0, 0].backward()
    >>> camera.parameters["lens.focal_length_mm"].grad.round(decimals=3)  # px per mm
    tensor(4.6140, dtype=torch.float64)
    """
    instance("camera", camera, Camera, "a camera (see om.load_sensor)")
    names = (free,) if isinstance(free, str) else tuple(free)
    sensor = camera if isinstance(camera, Sensor) else None
    if names and sensor is None:
        raise InvalidParameter(
            f"free must be empty unless camera is a sensor; got {names!r} for a {type(camera).__name__}"
        )
    values = {}
    if sensor is not None and names:
        for name in free_names(sensor, names):
            values[name] = value_of(sensor, parameter_location(sensor, name))
    dtype = _checked_dtype(dtype)
    device = _available_device(device, dtype)
    parameters = {
        name: torch.tensor(value, dtype=dtype, device=device, requires_grad=True)
        for name, value in values.items()
    }
    if sensor is not None and _is_traceable(sensor):
        return MirrorCamera(sensor, parameters, dtype, device)
    return NumericalCamera(camera, parameters, dtype, device)


def _checked_dtype(dtype: object) -> object:
    if dtype is not None and dtype not in supported_dtypes():
        raise InvalidParameter(
            f"dtype must be torch.float64 or torch.float32; got {format_value(dtype)}"
        )
    return torch.float64 if dtype is None else dtype


def _available_device(device: object, dtype: object) -> object:
    """Return a device with its index, after a test computation with the data type."""
    try:
        probe = torch.zeros(1, dtype=dtype, device=device)
        probe.item()
        return probe.device
    except (RuntimeError, AssertionError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InvalidParameter(
            f"device must be available to PyTorch, such as 'cpu'; got {format_value(device)} ({reason})"
        ) from None


def _is_traceable(sensor: Sensor) -> bool:
    """Return whether PyTorch can trace a sensor: one ideal mirror, an ideal lens and no cover."""
    return (
        sensor.secondary is None
        and sensor.housing.shell is None
        and sensor.is_ideal_except_pose
        and isinstance(sensor.lens, Perspective | Orthographic)
    )
