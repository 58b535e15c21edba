"""omnimirror's own files: camera files (TOML with a table ``[camera]``) and sensor files.

Both describe a camera completely.
"""

from __future__ import annotations

from pathlib import Path

from ...cameras.models import RadialModel
from ...optics.sensor import Sensor
from ...optics.sensor_files import format_camera, format_sensor, parse_camera
from .base import CameraFile, CameraFormat, Layout, Reading, Stored


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera or the sensor; mount and optics are stored in the file."""
    camera = parse_camera(file.text, reading.source, Path(reading.source).parent)
    return [Stored(getattr(camera, "name", ""), camera)]


def write_camera(camera: RadialModel, name: str = "") -> str:
    """Return the text of a camera file."""
    return format_camera(camera)


def write_sensor(sensor: Sensor, name: str = "") -> str:
    """Return the text of a sensor file."""
    return format_sensor(sensor)


FORMAT = CameraFormat(
    "omnimirror camera or sensor TOML",
    lambda file: file.name.endswith(".toml"),
    read,
    {
        "camera": Layout(RadialModel, write_camera, "a calibrated model"),
        "sensor": Layout(Sensor, write_sensor, "a sensor of mirror, lens and imager"),
    },
    ("*.toml",),
)
