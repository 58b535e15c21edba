"""Cameras of the studio: bundled sensors, mirror balls, and files given or uploaded."""

from __future__ import annotations

import hashlib
import re
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ...base.errors import InvalidParameter, SpecError
from ...cameras.camera import Mount
from ...cameras.models import MirrorBall
from ...cameras.models.camera_model import Optics
from ...cameras.models.ocam import parse_ocam
from ...optics.camera_files import AnyCamera, is_ocam_text, parse_camera
from ...optics.image_sensor import Imager
from ...optics.sensor import Sensor
from ...optics.sensor_files import bundled_sensors, format_sensor, load_sensor
from ._camera_tables import camera_model, kind_of, mount_message, title_of
from .look_messages import CameraInfo, SensorEntry, SensorFileRequest

BALL = re.compile(r"ball:(\d{1,3}(?:\.\d{1,3})?)")
BALL_FIELD_DEG = 340.0
BALL_SIZE = (1024, 1024)
MAX_UPLOADED = 64


@dataclass(frozen=True)
class NamedCamera:
    """Camera with its command-line options."""

    id: str
    name: str
    title: str
    options: tuple[str, ...]
    camera: AnyCamera

    @property
    def entry(self) -> SensorEntry:
        return SensorEntry(
            id=self.id,
            name=self.name,
            title=self.title,
            kind=kind_of(self.camera),
            mount=mount_message(self.camera.mount),
        )

    def standing(self, mount: Mount) -> AnyCamera:
        """Return the camera with another mount."""
        return replace(self.camera, mount=mount)

    def model(self, mount: Mount | None = None) -> CameraInfo:
        """Return the description of the camera for the page, with its own or another mount."""
        camera = self.camera if mount is None else self.standing(mount)
        model = camera_model(self.id, self.name, self.title, self.options, camera)
        return model.model_copy(update={"mount_in_file": mount_message(self.camera.mount)})


class Cameras:
    """Cameras by name; uploaded cameras are kept while the server runs, and the oldest are removed
    first."""

    def __init__(self, camera: NamedCamera | None = None) -> None:
        self._bundled = {
            name: _sensor_camera(name, load_sensor(name), name) for name in bundled_sensors()
        }
        self._given = {camera.id: camera} if camera else {}
        self._uploaded: OrderedDict[str, NamedCamera] = OrderedDict()

    def entries(self) -> list[SensorEntry]:
        """Return all selectable cameras."""
        ball = [] if any(k.startswith("ball:") for k in self._given) else [ball_of(BALL_FIELD_DEG)]
        cameras = [*self._given.values(), *self._bundled.values(), *ball, *self._uploaded.values()]
        return [k.entry for k in cameras]

    def find(self, id: str) -> NamedCamera:
        """Return a camera by name.

        Raises
        ------
        KeyError
            If the name is unknown.
        InvalidParameter
            If the field of a mirror ball is invalid.
        """
        for shelf in (self._given, self._bundled, self._uploaded):
            if id in shelf:
                return shelf[id]
        if match := BALL.fullmatch(id):
            return ball_of(float(match[1]))
        raise KeyError(id)

    def add(self, name: str, data: bytes, optics: str = "mirror") -> NamedCamera:
        """Read an uploaded calibration: a sensor file, a camera file, or OCamCalib text.

        Raises
        ------
        OmnimirrorError
            If the file is unknown or invalid; the message contains the position and the valid
            values.
        """
        camera = read_calibration(name, data, optics)
        self._uploaded[camera.id] = camera
        self._uploaded.move_to_end(camera.id)
        while len(self._uploaded) > MAX_UPLOADED:
            self._uploaded.popitem(last=False)
        return camera

    def file_of(self, requested: SensorFileRequest) -> str:
        """Return the sensor file of a sensor with its image circle fitted to an image.

        Raises
        ------
        KeyError
            If the sensor is unknown.
        InvalidParameter
            If the camera has no sensor file, or a fixed image circle.
        """
        return format_sensor(self.fitted(requested))

    def with_circle(self, requested: SensorFileRequest) -> Sensor | MirrorBall:
        """Return the sensor or mirror ball with its image circle fitted to an image."""
        camera = self.find(requested.id).camera
        if isinstance(camera, MirrorBall):
            mount = Mount(**requested.mount.model_dump())
            return MirrorBall(
                centre_px=requested.centre_px,
                rim_radius_px=requested.rim_radius_px,
                field_deg=camera.field_deg,
                image_size=requested.image_size,
                mount=mount,
            )
        return self.fitted(requested)

    def fitted(self, requested: SensorFileRequest) -> Sensor:
        """Return the sensor with its image circle fitted to an image; raises the errors of
        ``file_of``."""
        camera = self.find(requested.id).camera
        if not isinstance(camera, Sensor) or camera.symmetry is None:
            raise InvalidParameter(
                f"the image circle can be fitted for aligned mirror sensors only; got {requested.id!r}"
            )
        return fitted(camera, requested)


def fitted(sensor: Sensor, requested: SensorFileRequest) -> Sensor:
    """Return the sensor with its rim imaged on a given circle, by a change of the pixel pitch."""
    if not np.isfinite([*requested.centre_px, requested.rim_radius_px]).all():
        raise InvalidParameter(
            f"centre and radius of the circle must be finite; got {requested.centre_px}, {requested.rim_radius_px}"
        )
    width, height = requested.image_size
    u, v = requested.centre_px
    if requested.mount.image_flipped:
        u = width - 1 - u
    pitch_um = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / requested.rim_radius_px
    mount = Mount(**requested.mount.model_dump())
    return replace(sensor, imager=Imager(width, height, pitch_um, (u, v)), mount=mount)


def read_calibration(name: str, data: bytes, optics: str = "mirror") -> NamedCamera:
    """Read a camera from the bytes of a calibration file in any format of the command line."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SpecError(
            f"{name} must be a sensor file, a camera file or calib_results.txt of OCamCalib; got a file that is not "
            "UTF-8 text"
        ) from None
    id = f"file:{hashlib.sha256(data + f'{name} {optics}'.encode()).hexdigest()[:16]}"
    if is_ocam_text(text):
        if optics not in get_args(Optics):
            raise InvalidParameter(
                f"optics must be one of {', '.join(get_args(Optics))}; got {optics!r}"
            )
        kind: Literal["mirror", "fisheye"] = "fisheye" if optics == "fisheye" else "mirror"
        camera = parse_ocam(text, name, kind)
        options = ("--sensor", name, "--set", f"camera.optics={kind}")
        return NamedCamera(id, name, title_of(camera), options, camera)
    parsed = parse_camera(text, source=name)
    if isinstance(parsed, Sensor):
        return _sensor_camera(id, parsed, name)
    return NamedCamera(id, name, title_of(parsed), ("--sensor", name), parsed)


def ball_of(field_deg: float) -> NamedCamera:
    """Return a mirror ball with the given field in an image of its own; the page moves its image
    circle."""
    centre = (BALL_SIZE[0] - 1) / 2, (BALL_SIZE[1] - 1) / 2
    ball = MirrorBall(
        centre_px=centre, rim_radius_px=500.0, field_deg=field_deg, image_size=BALL_SIZE
    )
    options = ("--ball", f"{centre[0]:g},{centre[1]:g},500,{field_deg:g}")
    return NamedCamera(f"ball:{field_deg:g}", "mirror ball", title_of(ball), options, ball)


def _sensor_camera(id: str, sensor: Sensor, file: str) -> NamedCamera:
    return NamedCamera(id, sensor.name, title_of(sensor), ("--sensor", file), sensor)
