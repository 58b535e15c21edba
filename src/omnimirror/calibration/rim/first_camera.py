"""A first camera from nothing but a rim: of a sensor that is known, or of a common mirror that it is taken for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...base.arguments import checked, instance
from ...base.errors import InvalidParameter, OmnimirrorError
from ...cameras.frames import CameraLooks, Mount
from ...cameras.models import MirrorBall
from ...optics.mirrors.pose import MirrorPose
from ...optics.sensor import Array, Sensor
from ...optics.sensor_files import load_sensor
from .finder import SURE, FoundRim

FirstCamera: TypeAlias = Sensor | MirrorBall

LEAST_DIFFERENCE_PX = 0.4
"""Of the semi-axes, below which an ellipse may be a circle."""
FARTHEST_BESIDE = 0.25  # of the radius, by which a mirror is mounted off the axis; more is a crop
RIM_POINTS = 24
OWN_IMAGE = 0.02  # of the rim's radius, to which it is known where the camera sees itself; twice that tells
SAME_ASPECT = 0.01  # of a picture and an imager, of which neither was cropped


@dataclass(frozen=True)
class CommonMirror:
    """A common mirror: one that comes with omnimirror, or a ball with a full field."""

    words: str
    sensor: str | None = None
    field_deg: float = 0.0
    camera_looks: CameraLooks = "up"
    """How a ball is photographed."""


PRESETS = {
    "one-shot": CommonMirror("radius proportional to the field angle, to 135 deg", "exact-equidistant"),
    "ball": CommonMirror("a whole mirror ball, seen from some diameters away", field_deg=340.0, camera_looks="forward"),
    "dome": CommonMirror("the larger part of a ball, as under a shop's ceiling", field_deg=260.0),
    "convex": CommonMirror("the cap of a ball, as at street corners", field_deg=160.0, camera_looks="forward"),
    "paraboloid": CommonMirror("a paraboloid under a telecentric lens, to 105 deg", "paraboloid-telecentric"),
    "hyperboloid": CommonMirror("a hyperboloid with a single viewpoint, to 135 deg", "paper-hyperboloidal"),
    "sphere": CommonMirror("a spherical mirror near its lens, to 135 deg", "paper-spherical"),
}
"""Common mirrors by their names."""
DEFAULT = "one-shot"
"""Which is meant where none is named: radii between those of a sphere and of a hyperboloid, so that no angle is far
off."""


@checked
def camera_from_rim(rim: FoundRim, mirror: str | Path | Sensor = DEFAULT, *, mount: Mount | None = None) -> FirstCamera:
    """A camera that straightens a picture whose rim is known, of a common mirror or a known sensor.

    Parameters
    ----------
    rim
        As :func:`omnimirror.find_rim` gives it.
    mirror
        The name of a preset (``one-shot``, ``ball``, ``dome``, ``convex``, ``paraboloid``, ``hyperboloid``,
        ``sphere``), a sensor, or its name or file.
    mount
        How the camera stands; by default as the sensor's file says, and before a ball as its photographers do: it looks
        ahead, and up to a dome.

    Returns
    -------
    Sensor or MirrorBall
        With its rim where the picture has it.

    Raises
    ------
    InvalidParameter
        The rim is not sure, or the mirror is not known.

    Examples
    --------
    >>> rim = FoundRim((400.0, 300.0), (250.0, 250.0), 0.0, 0.99, (800, 600))
    >>> camera_from_rim(rim, "ball").field_deg
    340.0
    >>> round(camera_from_rim(rim).rim_radius_px, 6)
    250.0
    """
    check_sure(rim)
    known = mirror if isinstance(mirror, Sensor) else mirror_of(mirror)
    if isinstance(known, Sensor):
        return sensor_from_rim(rim, known if mount is None else replace(known, mount=mount))
    if known.sensor is None:
        return MirrorBall(
            rim.centre_px, rim.radius_px, known.field_deg, rim.image_size, mount or Mount(known.camera_looks)
        )
    sensor = load_sensor(known.sensor)
    return _centred(rim, sensor if mount is None else replace(sensor, mount=mount))


@checked
def mirror_of(name: str | Path) -> CommonMirror | Sensor:
    """The mirror that a name stands for.

    Parameters
    ----------
    name
        Of a preset, or the name or file of a sensor.

    Raises
    ------
    InvalidParameter
        There is none of that name.

    Examples
    --------
    >>> mirror_of("ball").field_deg, mirror_of("paper-spherical").name
    (340.0, 'paper-spherical')
    """
    if preset := PRESETS.get(str(name)):
        return preset
    try:
        return load_sensor(name)
    except OmnimirrorError as e:
        raise InvalidParameter(f"{e}; presets of common mirrors are {', '.join(PRESETS)}") from None


def check_sure(rim: FoundRim) -> None:
    """Refuse a rim that is not sure.

    Parameters
    ----------
    rim

    Raises
    ------
    InvalidParameter
        Its confidence is too low.
    """
    if not rim.is_sure:
        raise InvalidParameter(
            f"no rim was found for sure: the confidence {rim.confidence:.2f} is below {SURE:g}; give more pictures of "
            "the same sensor or one with all of its rim, or say where it is with --ball CX,CY,R,FOV or a --sensor file"
        )


@checked
def sensor_from_rim(rim: FoundRim, sensor: Sensor) -> Sensor:
    """A known sensor as one picture shows it: how large, how far beside the lens's axis, how much tilted.

    The rim is a circle of known radius at a known distance from the lens. Five numbers say how its image comes about:
    the scale of the picture, the place of the circle's middle beside the axis, and its tilt; and an ellipse has five.
    To first order the longer semi-axis a gives the scale, the centre's offset the place, and ``b / a = cos t`` the tilt
    t towards the shorter axis; off the axis perspective adds to it as much, so that the five are solved for exactly.
    Two tilts give the same ellipse, to both sides (Hartley and Zisserman, Multiple View Geometry, 8.3, have the cone of
    rays behind it): this is the first that :func:`sensors_from_rim` gives.

    Parameters
    ----------
    rim
        As :func:`omnimirror.find_rim` gives it.
    sensor
        As designed. A picture of another shape than its imager was cropped, and so was one with the rim far off its
        middle: then the offset is taken for that of the crop, and the tilt for none; so it is of two mirrors.

    Returns
    -------
    Sensor
        With the imager of the picture, and the mirror's pose. Of an ellipse whose axes differ by less than
        :data:`LEAST_DIFFERENCE_PX` the tilt is none.

    Raises
    ------
    InvalidParameter
        The rim is not sure.

    Examples
    --------
    >>> import omnimirror as om
    >>> rim = FoundRim((520.0, 511.5), (500.0, 500.0), 0.0, 0.99, (1024, 1024))
    >>> pose = sensor_from_rim(rim, om.load_sensor("paper-spherical")).mirror_pose
    >>> round(pose.decentre_x_mm, 2), round(pose.tilt_y_deg, 2)
    (0.75, 0.0)
    """
    return sensors_from_rim(rim, sensor)[0]


@checked
def sensors_from_rim(rim: FoundRim, sensor: Sensor) -> tuple[Sensor, ...]:
    """A known sensor in every pose in which it shows a rim: one, or two that are tilted to either side.

    The camera's own image tells them apart: it lies where the mirror's normal goes through the lens, which is on the
    side to which the mirror is tilted. Where it is not seen, or fits neither, both stay, the smaller decentre first.

    Parameters
    ----------
    rim
        As :func:`omnimirror.find_rim` gives it.
    sensor
        As :func:`sensor_from_rim` takes it.

    Returns
    -------
    tuple of Sensor
        One or two, the likelier first.

    Raises
    ------
    InvalidParameter
        The rim is not sure.

    Examples
    --------
    An ellipse that is 2 % flatter than a circle is seen of a mirror tilted by about 11 deg, to one side or the other:

    >>> import omnimirror as om
    >>> rim = FoundRim((511.5, 511.5), (500.0, 490.0), 90.0, 0.99, (1024, 1024))
    >>> sorted(round(one.mirror_pose.tilt_y_deg) for one in sensors_from_rim(rim, om.load_sensor("paper-spherical")))
    [-11, 11]
    """
    check_sure(rim)
    instance("sensor", sensor, Sensor, "a sensor, such as om.load_sensor gives")
    width, height = rim.image_size
    imager = sensor.imager
    aspect = (width / height) / (imager.width_px / imager.height_px)
    u, v = ((c + 0.5) * width / imager.width_px - 0.5 for c in imager.centre)
    beside = np.hypot(rim.centre_px[0] - u, rim.centre_px[1] - v) / rim.radius_px
    if abs(aspect - 1) > SAME_ASPECT or beside > FARTHEST_BESIDE or sensor.secondary is not None:
        return (_centred(rim, sensor),)
    pitch_um = sensor.aligned().rim_radius_px * imager.pixel_pitch_um / rim.semi_axes_px[0]
    own = replace(imager, width_px=width, height_px=height, pixel_pitch_um=pitch_um, centre_px=(u, v))
    sized = replace(sensor, imager=own)
    is_tilted = rim.semi_axes_px[0] - rim.semi_axes_px[1] > LEAST_DIFFERENCE_PX
    found = [_posed(sized, rim, side) for side in ((1, -1) if is_tilted else (0,))]
    return _told_apart(sorted(found, key=lambda one: float(np.hypot(*one.mirror_pose.shift[:2]))), rim)


def _told_apart(found: list[Sensor], rim: FoundRim) -> tuple[Sensor, ...]:
    """Those of two sensors that show the camera where it is seen: one, or both where that does not tell."""
    if len(found) < 2 or rim.inner is None:
        return tuple(found)
    seen = [sensor.image_plane.flat_mm(np.array(rim.inner.centre_px))[0] / sensor.imager.pitch_mm for sensor in found]
    away = [float(np.linalg.norm(place - _own_image(sensor))) for sensor, place in zip(found, seen, strict=True)]
    fits = [k for k in (0, 1) if away[k] < OWN_IMAGE * rim.radius_px < 2 * OWN_IMAGE * rim.radius_px < away[1 - k]]
    return tuple(found[k] for k in fits) or tuple(found)


def _own_image(sensor: Sensor) -> Array:
    """Place (2,) px from the picture's centre at which the mirror shows the lens; NaN where it does not.

    There a ray from the lens meets the mirror along its normal and goes back to where it came from.
    """
    from scipy.optimize import least_squares

    pose, mirror, rim_mm = sensor.mirror_pose, sensor.mirror, sensor.mirror.rim_radius_mm

    def seen(place: Array) -> tuple[Array, Array]:
        """A point (1, 3) of the mirror from the lens, and the direction (1, 3) from it towards the lens."""
        height = mirror.sag(np.array([np.hypot(*place)]))
        point = pose.to_camera(np.array([[*place, float(height[0])]])) - sensor.optical_train.lens_offset
        towards = np.array([[0.0, 0.0, -1.0]]) if sensor.lens.TELECENTRIC else -point
        return point, towards / np.linalg.norm(towards)

    def lean(place: Array) -> Array:
        """How much (2,) the direction towards the lens leans from the normal, along two tangents."""
        x, y = place
        away = max(float(np.hypot(x, y)), 1e-9)
        slope = float(mirror.slope(np.array([away]))[0]) / away
        tangents = pose.turned_to_camera(np.array([[1.0, 0.0, slope * x], [0.0, 1.0, slope * y]]))
        return np.asarray(tangents @ seen(place)[1][0])

    found = least_squares(lean, np.zeros(2), x_scale=rim_mm)
    if np.abs(found.fun).max() > 1e-6 or np.hypot(*found.x) > rim_mm:
        return np.full(2, np.nan)
    return np.asarray(sensor.lens.image_of(*seen(found.x))[0] / sensor.imager.pitch_mm)


def _posed(sensor: Sensor, rim: FoundRim, side: int) -> Sensor:
    """The sensor that shows the rim, its mirror tilted to one side or the other of the shorter axis, or not at all."""
    from scipy.optimize import least_squares

    mirror, pitch_mm = sensor.mirror, sensor.imager.pitch_mm
    image_mm = sensor.image_plane.flat_mm(rim.points(RIM_POINTS))[0]
    middle = image_mm.mean(axis=0)
    a, b = rim.semi_axes_px
    turn = np.radians(rim.angle_deg + 90)
    turn = np.pi - turn if sensor.mount.image_flipped else turn
    tilt_deg = side * np.degrees(np.arccos(min(b / a, 1.0))) * np.array([-np.sin(turn), np.cos(turn)])
    sag_mm = float(mirror.sag(np.array([mirror.rim_radius_mm]))[0])
    around = np.arange(RIM_POINTS) * (2 * np.pi / RIM_POINTS)
    circle = mirror.rim_radius_mm * np.stack([np.cos(around), np.sin(around)], axis=1)
    circle = np.column_stack([circle, np.full(RIM_POINTS, sag_mm)])
    per_mm = a * pitch_mm / mirror.rim_radius_mm

    def pose_of(numbers: Array) -> MirrorPose:
        tilt = numbers[3:] if side else np.zeros(2)
        return MirrorPose(float(numbers[1]), float(numbers[2]), 0.0, float(tilt[0]), float(tilt[1]))

    def miss(numbers: Array) -> Array:
        """How far the points (n,) of the rim lie outside the ellipse, of an image enlarged by the first number."""
        points = pose_of(numbers).to_camera(circle) - sensor.optical_train.lens_offset
        towards = np.broadcast_to([0.0, 0.0, -1.0], points.shape) if sensor.lens.TELECENTRIC else -points
        offsets: Array = numbers[0] * sensor.lens.image_of(points, towards) - middle
        return offsets

    def distances(numbers: Array) -> Array:
        away = miss(numbers)
        return np.asarray(np.linalg.norm(np.linalg.solve(shape, away.T), axis=0) - 1)

    moments = (image_mm - middle).T @ (image_mm - middle) * (2 / RIM_POINTS)
    shape = np.linalg.cholesky(moments)
    start = np.array([1.0, *(middle / per_mm), *tilt_deg])[: 5 if side else 3]
    found = least_squares(distances, start, x_scale=np.array([0.01, 1.0, 1.0, 1.0, 1.0])[: len(start)]).x
    imager = replace(sensor.imager, pixel_pitch_um=sensor.imager.pixel_pitch_um / float(found[0]))
    return replace(sensor, imager=imager, mirror_pose=pose_of(found))


def _centred(rim: FoundRim, sensor: Sensor) -> Sensor:
    """The aligned sensor with its axis in the middle of the rim."""
    width, height = rim.image_size
    aligned = sensor.aligned()
    pitch_um = aligned.rim_radius_px * aligned.imager.pixel_pitch_um / rim.radius_px
    u, v = rim.centre_px
    centre = (width - 1 - u, v) if sensor.mount.image_flipped else (u, v)
    imager = replace(
        aligned.imager, width_px=width, height_px=height, pixel_pitch_um=pitch_um, centre_px=centre
    )  # fmt: skip
    return replace(aligned, imager=imager)
