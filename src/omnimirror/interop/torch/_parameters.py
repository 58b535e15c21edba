"""Parameters of a sensor, of which the free ones are tensors."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...calibration.sensor_parameters import DISTANCE, parameter_location, value_of, with_values
from ...optics.lenses import Orthographic
from ...optics.sensor import Sensor
from ._library import Tensor, torch

Components = tuple[Tensor, Tensor, Tensor]
"""x, y and z of vectors."""


class SensorParameters:
    """Parameters by name: tensors if free, floats otherwise.

    Parameters
    ----------
    sensor
        Sensor with the initial values.
    free
        Free parameters by name.
    """

    def __init__(self, sensor: Sensor, free: Mapping[str, Tensor]) -> None:
        self.sensor, self.free = sensor, free

    def __getitem__(self, name: str) -> Tensor:
        if name in self.free:
            return self.free[name]
        return value_of(self.sensor, parameter_location(self.sensor, name))

    def are_zero(self, *names: str) -> bool:
        """Return whether all parameters are fixed at 0."""
        return not any(name in self.free or self[name] for name in names)

    def current_sensor(self) -> Sensor:
        """Return the sensor with the current values of the free parameters."""
        slots = [parameter_location(self.sensor, name) for name in self.free]
        values = [float_value(value) for value in self.free.values()]
        initial = [value_of(self.sensor, slot) for slot in slots]
        return self.sensor if values == initial else with_values(self.sensor, slots, values)

    @property
    def pitch_mm(self) -> Tensor:
        """Pixel pitch, mm."""
        return self["imager.pixel_pitch_um"] * 1e-3

    @property
    def image_scale(self) -> Tensor:
        """Image height per tangent of the field angle, mm; magnification if telecentric."""
        lens = self.sensor.lens
        if isinstance(lens, Orthographic):
            return self["lens.magnification"]
        # Thin lens focused at distance d from the principal point: image distance f / (1 - f / d),
        # with distances from the pupil at p.
        f, at = self["lens.focal_length_mm"], lens.pupil.at_mm
        return f / (1 - (f - at) / (lens.focus_distance_mm - at))

    @property
    def pupil(self) -> Components:
        """Entrance pupil in the mirror frame; direction of the rays if telecentric."""
        if self.sensor.lens.TELECENTRIC:
            return self.to_mirror((0.0, 0.0, -1.0), distant=True)
        return self.to_mirror((0.0, 0.0, self.sensor.lens.pupil.at_mm - self[DISTANCE]))

    @property
    def shift(self) -> Components:
        """Mirror vertex in the camera frame."""
        names = ("decentre_x_mm", "decentre_y_mm", "displacement_mm")
        x, y, z = (self[f"mirror_pose.{name}"] for name in names)
        return x, y, z

    def rotation(self) -> list[list[Tensor]] | None:
        """Return the rows of the rotation from mirror to camera frame; None if there is no tilt."""
        if self.are_zero("mirror_pose.tilt_x_deg", "mirror_pose.tilt_y_deg"):
            return None
        (cx, sx), (cy, sy) = (_cos_sin(self[f"mirror_pose.tilt_{axis}_deg"]) for axis in "xy")
        return [[cy, sy * sx, sy * cx], [0.0, cx, -sx], [-sy, cy * sx, cy * cx]]

    def to_mirror(self, xyz: tuple[Tensor, ...], distant: bool = False) -> Components:
        """Transform points, or directions if ``distant``, from camera to mirror frame."""
        if distant:
            x, y, z = xyz
        else:
            x, y, z = (a - b for a, b in zip(xyz, self.shift, strict=True))
        rotation = self.rotation()
        if rotation is None:
            return x, y, z
        a, b, c = (x * rotation[0][k] + y * rotation[1][k] + z * rotation[2][k] for k in range(3))
        return a, b, c

    def to_camera(self, xyz: tuple[Tensor, ...], distant: bool = False) -> Components:
        """Transform points, or directions if ``distant``, from mirror to camera frame."""
        x, y, z = xyz
        rotation = self.rotation()
        if rotation is not None:
            x, y, z = (row[0] * x + row[1] * y + row[2] * z for row in rotation)
        if distant:
            return x, y, z
        a, b, c = self.shift
        return x + a, y + b, z + c


def float_value(value: Tensor) -> float:
    """Return a number, or the current value of a tensor, as a float."""
    return float(value.detach()) if hasattr(value, "detach") else float(value)


def _cos_sin(degrees: Tensor) -> tuple[Tensor, Tensor]:
    radians = torch.as_tensor(degrees, dtype=torch.float64) * (math.pi / 180)
    return torch.cos(radians), torch.sin(radians)
