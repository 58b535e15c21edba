"""Which kind of differentiable camera a camera becomes."""

from __future__ import annotations

from collections.abc import Iterable

from ...arguments import instance, shown
from ...calibrate.physical.names import place_of, value_of
from ...calibrate.physical.tolerances import free_names
from ...cameras import Camera
from ...errors import InvalidParameter
from ...lenses import Orthographic, Perspective
from ...sensor import Sensor
from .cameras import TorchCamera, precisions
from .library import torch
from .mirror_camera import MirrorCamera
from .other_cameras import OtherCamera


def differentiable(
    camera: Camera, free: str | Iterable[str] = (), *, dtype: object = None, device: object = "cpu"
) -> TorchCamera:
    """A camera whose answers are PyTorch tensors, with gradients.

    A sensor of one mirror with an ordinary lens is traced by PyTorch, on any device, wherever its mirror sits; its
    gradients are those of the theorem of implicit functions at the reflection point. Every other camera (two mirrors, a
    tube or a dome, lenses known by their surfaces, form errors, calibrated models) is traced by NumPy on the processor,
    and its gradients are differences, right to eight digits or so.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    free
        Parameters of a sensor that shall have gradients, by the names of its file or in groups: ``"shape"``,
        ``"focal"``, ``"centre"``, ``"distortion"``, ``"distance"``, ``"decentre"``, ``"tilt"``.
    dtype
        Of the tables and parameters: ``torch.float64`` by default, or ``torch.float32``. What is asked should be of
        the same.
    device
        Where the tables and parameters are, and what is asked has to be: ``"cpu"``, ``"cuda"``, ``"cuda:1"``, ..

    Returns
    -------
    TorchCamera
        With ``project``, ``project_directions``, ``backproject``, ``sample``, ``grid`` and ``view_grid``.

    Raises
    ------
    InvalidParameter
        A parameter that the sensor does not have, or one of a camera that is no sensor; another ``dtype``; a device
        that PyTorch does not find here.
    OmnimirrorError
        PyTorch is not installed.

    Examples
    --------
    >>> import omnimirror as om, torch
    >>> from omnimirror.interop.torch import differentiable
    >>> camera = differentiable(om.load_sensor("paper-spherical"), free=("focal", "tilt"))
    >>> list(camera.parameters)
    ['lens.focal_length_mm', 'mirror_pose.tilt_x_deg', 'mirror_pose.tilt_y_deg']
    >>> pixels, valid = camera.project(torch.tensor([[3000.0, 400.0, -200.0]], dtype=torch.float64))
    >>> pixels[0, 0].backward()
    >>> camera.parameters["lens.focal_length_mm"].grad.round(decimals=3)  # px per mm
    tensor(4.6140, dtype=torch.float64)
    """
    instance("camera", camera, Camera, "a camera, such as om.load_sensor gives")
    words = (free,) if isinstance(free, str) else tuple(free)
    if words and not isinstance(camera, Sensor):
        raise InvalidParameter(f"free = {words!r} is valid for sensors; a {type(camera).__name__} is taken as it is")
    names = free_names(camera, words) if isinstance(camera, Sensor) and words else ()
    dtype = _precision(dtype)
    device = _found(device, dtype)
    parameters = {}
    for name in names:
        value = value_of(camera, place_of(camera, name))  # type: ignore[arg-type]  # a sensor, as was just found
        parameters[name] = torch.tensor(value, dtype=dtype, device=device, requires_grad=True)
    kind = MirrorCamera if isinstance(camera, Sensor) and _is_plain(camera) else OtherCamera
    return kind(camera, parameters, dtype, device)  # type: ignore[arg-type]  # a sensor, as was just found


def _precision(dtype: object) -> object:
    if dtype is not None and dtype not in precisions():
        raise InvalidParameter(f"dtype = {shown(dtype)}; valid are torch.float64 and torch.float32")
    return torch.float64 if dtype is None else dtype


def _found(device: object, dtype: object) -> object:
    """A device with its number, as tensors on it say it; one that computes in such numbers."""
    try:
        tried = torch.zeros(1, dtype=dtype, device=device)
        tried.item()
        return tried.device
    except (RuntimeError, AssertionError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InvalidParameter(
            f"device = {shown(device)} is none that PyTorch can use here ({reason}); 'cpu' always is"
        ) from None


def _is_plain(sensor: Sensor) -> bool:
    """Whether it is one mirror as it was meant, seen by an ordinary lens through nothing."""
    return (
        sensor.secondary is None
        and sensor.housing.shell is None
        and sensor.is_ideal_but_for_pose
        and isinstance(sensor.lens, Perspective | Orthographic)
    )
