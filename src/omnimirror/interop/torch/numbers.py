"""The numbers of a sensor, of which some are tensors that learn."""

from __future__ import annotations

from collections.abc import Mapping

from ...calibrate.physical.names import DISTANCE, changed, place_of, value_of
from ...lenses import Orthographic
from ...sensor import Sensor
from .library import Tensor, torch

DEGREE = 0.017453292519943295


class Numbers:
    """A sensor's numbers by name: tensors where they are free, floats elsewhere."""

    def __init__(self, sensor: Sensor, free: Mapping[str, Tensor]) -> None:
        self.sensor, self.free = sensor, free

    def __getitem__(self, name: str) -> Tensor:
        return self.free[name] if name in self.free else value_of(self.sensor, place_of(self.sensor, name))

    def fixed(self, *names: str) -> bool:
        """Whether all of these are 0 and stay so."""
        return not any(name in self.free or self[name] for name in names)

    def present(self) -> Sensor:
        """The sensor with the values that the tensors have just now."""
        places = [place_of(self.sensor, name) for name in self.free]
        values = [plain(value) for value in self.free.values()]
        if all(value == value_of(self.sensor, place) for place, value in zip(places, values, strict=True)):
            return self.sensor
        return changed(self.sensor, places, values)

    @property
    def pitch_mm(self) -> Tensor:
        """Distance of pixels."""
        return self["imager.pixel_pitch_um"] * 1e-3

    @property
    def image_scale(self) -> Tensor:
        """Image height per tangent of the viewing angle, or under a telecentric lens per mm of the mirror (mm)."""
        lens = self.sensor.lens
        if isinstance(lens, Orthographic):
            return self["lens.magnification"]
        f, at = self["lens.focal_length_mm"], lens.pupil.at_mm
        return f / (1 - (f - at) / (lens.focus_distance_mm - at))  # principal point and reference point are one

    @property
    def pupil(self) -> tuple[Tensor, Tensor, Tensor]:
        """Where the lens sees from, in the frame of the mirror; a telecentric one: whereto its rays lead."""
        if self.sensor.lens.TELECENTRIC:
            return self.to_mirror((0.0, 0.0, -1.0), distant=True)
        return self.to_mirror((0.0, 0.0, self.sensor.lens.pupil.at_mm - self[DISTANCE]))

    @property
    def shift(self) -> tuple[Tensor, Tensor, Tensor]:
        """The mirror's vertex in the camera frame."""
        x, y, z = (self[f"mirror_pose.{key}"] for key in ("decentre_x_mm", "decentre_y_mm", "displacement_mm"))
        return x, y, z

    def rotation(self) -> list[list[Tensor]] | None:
        """Rows of the rotation from the mirror's frame to the camera's; None where both are parallel for good."""
        if self.fixed("mirror_pose.tilt_x_deg", "mirror_pose.tilt_y_deg"):
            return None
        (cx, sx), (cy, sy) = (_cos_sin(self[f"mirror_pose.tilt_{axis}_deg"]) for axis in "xy")
        return [[cy, sy * sx, sy * cx], [0.0, cx, -sx], [-sy, cy * sx, cy * cx]]

    def to_mirror(self, xyz: tuple[Tensor, ...], distant: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """Components of points or directions of the camera frame, in the mirror's."""
        x, y, z = xyz if distant else tuple(a - b for a, b in zip(xyz, self.shift, strict=True))
        if (turn := self.rotation()) is None:
            return x, y, z
        a, b, c = (x * turn[0][k] + y * turn[1][k] + z * turn[2][k] for k in range(3))
        return a, b, c

    def to_camera(self, xyz: tuple[Tensor, ...], distant: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """The way back."""
        x, y, z = xyz
        if (turn := self.rotation()) is not None:
            x, y, z = (row[0] * x + row[1] * y + row[2] * z for row in turn)
        if distant:
            return x, y, z
        a, b, c = self.shift
        return x + a, y + b, z + c


def plain(value: Tensor) -> float:
    """A number, or the value that a tensor has now."""
    return float(value.detach()) if hasattr(value, "detach") else float(value)


def _cos_sin(degrees: Tensor) -> tuple[Tensor, Tensor]:
    radians = torch.as_tensor(degrees, dtype=torch.float64) * DEGREE
    return torch.cos(radians), torch.sin(radians)
