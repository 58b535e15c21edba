"""Initial camera from a detected rim, for a known sensor or a common type of mirror."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...base.arguments import instance, validate_arguments
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.typing import Array
from ...cameras.camera import CameraLooks, Mount
from ...cameras.models import MirrorBall
from ...optics.mirrors.mirror import MirrorPose
from ...optics.sensor import Sensor
from ...optics.sensor_files import load_sensor
from ._rim_detection import MIN_CONFIDENCE, MirrorOutline

FirstCamera: TypeAlias = Sensor | MirrorBall

MIN_DIFFERENCE_PX = 0.4
"""Difference of the semi-axes below which an ellipse is treated as a circle."""
MAX_AXIS_OFFSET = 0.25  # fraction of the radius; a larger offset from the axis indicates a crop
RIM_POINTS = 24
OWN_IMAGE = 0.02  # fraction of the rim's radius; accuracy of the camera's own image
SAME_ASPECT = 0.01  # tolerance of the aspect ratios of image and imager without a crop


@dataclass(frozen=True)
class MirrorPreset:
    """Common type of mirror: a sensor included in omnimirror, or a ball with a full field."""

    words: str
    sensor: str | None = None
    field_deg: float = 0.0
    camera_looks: CameraLooks = "up"
    """Orientation of the camera for a ball."""


PRESETS = {
    "one-shot": MirrorPreset(
        "radius proportional to the field angle, up to 135 deg", "exact-equidistant"
    ),
    "ball": MirrorPreset(
        "complete mirror ball at a distance of several diameters",
        field_deg=340.0,
        camera_looks="forward",
    ),
    "dome": MirrorPreset("larger part of a ball, such as a ceiling dome mirror", field_deg=260.0),
    "convex": MirrorPreset(
        "cap of a ball, such as a traffic mirror", field_deg=160.0, camera_looks="forward"
    ),
    "paraboloid": MirrorPreset(
        "paraboloid with a telecentric lens, up to 105 deg", "paraboloid-telecentric"
    ),
    "hyperboloid": MirrorPreset(
        "hyperboloid with a single viewpoint, up to 135 deg", "paper-hyperboloidal"
    ),
    "sphere": MirrorPreset("spherical mirror near its lens, up to 135 deg", "paper-spherical"),
}
"""Common types of mirrors by name."""
DEFAULT_PRESET = "one-shot"
"""Default type.

Its radii are between those of a sphere and a hyperboloid, which limits the error of all angles.
"""


@validate_arguments
def camera_from_rim(
    rim: MirrorOutline, mirror: str | Path | Sensor = DEFAULT_PRESET, *, mount: Mount | None = None
) -> FirstCamera:
    """Create a camera for dewarping from a detected rim and a type of mirror.

    Parameters
    ----------
    rim
        Result of :func:`omnimirror.detect_mirror_outline`.
    mirror
        Name of a preset (``one-shot``, ``ball``, ``dome``, ``convex``, ``paraboloid``,
        ``hyperboloid``, ``sphere``), a sensor, or its name or file.
    mount
        Orientation of the camera; by default that of the sensor's file. For balls, cameras look
        ahead; for a dome, up.

    Returns
    -------
    Sensor or MirrorBall
        Camera with its rim at the detected position.

    Raises
    ------
    InvalidParameter
        If the confidence of the rim is too low, or the mirror is unknown.

    Examples
    --------
    >>> rim = MirrorOutline((400.0, 300.0), (250.0, 250.0), 0.0, 0.99, (800, 600))
    >>> camera_from_rim(rim, "ball").field_deg
    340.0
    >>> round(camera_from_rim(rim).rim_radius_px, 6)
    250.0
    """
    check_confidence(rim)
    selection = mirror if isinstance(mirror, Sensor) else mirror_by_name(mirror)
    if isinstance(selection, Sensor):
        return sensor_from_rim(rim, selection if mount is None else replace(selection, mount=mount))
    if selection.sensor is None:
        return MirrorBall(
            centre_px=rim.centre_px,
            rim_radius_px=rim.radius_px,
            field_deg=selection.field_deg,
            image_size=rim.image_size,
            mount=mount or Mount(selection.camera_looks),
        )
    sensor = load_sensor(selection.sensor)
    return _centre_on_rim(rim, sensor if mount is None else replace(sensor, mount=mount))


@validate_arguments
def mirror_by_name(name: str | Path) -> MirrorPreset | Sensor:
    """Return the mirror with a given name.

    Parameters
    ----------
    name
        Name of a preset, or name or file of a sensor.

    Raises
    ------
    InvalidParameter
        If the name is unknown.

    Examples
    --------
    >>> mirror_by_name("ball").field_deg, mirror_by_name("paper-spherical").name
    (340.0, 'paper-spherical')
    """
    if preset := PRESETS.get(str(name)):
        return preset
    try:
        return load_sensor(name)
    except OmnimirrorError as e:
        raise InvalidParameter(f"{e}; presets: {', '.join(PRESETS)}") from None


def check_confidence(rim: MirrorOutline) -> None:
    """Raise an error for a rim with insufficient confidence.

    Parameters
    ----------
    rim
        Detected rim.

    Raises
    ------
    InvalidParameter
        If the confidence is too low.
    """
    if not rim.is_accepted:
        raise InvalidParameter(
            f"the confidence of the mirror outline must be at least {MIN_CONFIDENCE:g}; "
            f"got {rim.confidence:.2f}; use more images of the same sensor or one with the "
            "complete rim, or specify the mirror with --ball CX,CY,R,FOV or a --sensor "
            "file"
        )


@validate_arguments
def sensor_from_rim(rim: MirrorOutline, sensor: Sensor) -> Sensor:
    """Estimate the scale and mirror pose of a known sensor from its rim in one image.

    The rim is a circle of known radius at a known distance from the lens. Five parameters determine
    its image, an ellipse with five parameters: the scale of the image, the offset of the circle's
    centre from the axis, and its tilt. To first order the major semi-axis a gives the scale, the
    offset of the centre the position, and ``b / a = cos t`` the tilt t about the major axis. Off
    the axis, perspective has an effect of similar size; therefore the five equations are solved
    exactly. Two opposite tilts result in the same ellipse (Hartley and Zisserman, Multiple View
    Geometry, 8.3, describe the cone of rays); this is the first result of :func:`sensors_from_rim`.

    Parameters
    ----------
    rim
        Result of :func:`omnimirror.detect_mirror_outline`.
    sensor
        Nominal sensor. An image with another aspect ratio, or with the rim far from its centre, is
        treated as cropped: the offset is then that of the crop, and the tilt is zero. This also
        applies to sensors with two mirrors.

    Returns
    -------
    Sensor
        Sensor with the imager of the image, and the pose of the mirror. The tilt is zero for an
        ellipse whose semi-axes differ by less than :data:`MIN_DIFFERENCE_PX`.

    Raises
    ------
    InvalidParameter
        If the confidence of the rim is too low.

    Examples
    --------
    >>> import omnimirror as om
    >>> rim = MirrorOutline((520.0, 511.5), (500.0, 500.0), 0.0, 0.99, (1024, 1024))
    >>> pose = sensor_from_rim(rim, om.load_sensor("paper-spherical")).mirror_pose
    >>> round(pose.decentre_x_mm, 2), round(pose.tilt_y_deg, 2)
    (0.75, 0.0)
    """
    return sensors_from_rim(rim, sensor)[0]


@validate_arguments
def sensors_from_rim(rim: MirrorOutline, sensor: Sensor) -> tuple[Sensor, ...]:
    """Return a known sensor in all poses that produce a rim: one, or two with opposite tilts.

    The camera's own image selects between them: its position is that of the mirror normal through
    the lens, on the side to which the mirror is tilted. If it is not detected, or agrees with
    neither pose, both are returned, with the smaller decentre first.

    Parameters
    ----------
    rim
        Result of :func:`omnimirror.detect_mirror_outline`.
    sensor
        As for :func:`sensor_from_rim`.

    Returns
    -------
    tuple of Sensor
        One or two sensors, most probable first.

    Raises
    ------
    InvalidParameter
        If the confidence of the rim is too low.

    Examples
    --------
    An ellipse with axes that differ by 2 % is the rim of a mirror tilted by about 11 deg to either
    side:

    >>> import omnimirror as om
    >>> rim = MirrorOutline((511.5, 511.5), (500.0, 490.0), 90.0, 0.99, (1024, 1024))
    >>> sorted(round(one.mirror_pose.tilt_y_deg) for one in sensors_from_rim(rim, om.load_sensor("paper-spherical")))
    [-11, 11]
    """
    check_confidence(rim)
    instance("sensor", sensor, Sensor, "a sensor, for example from om.load_sensor")
    width, height = rim.image_size
    imager = sensor.imager
    aspect = (width / height) / (imager.width_px / imager.height_px)
    u, v = ((c + 0.5) * width / imager.width_px - 0.5 for c in imager.centre)
    axis_offset = np.hypot(rim.centre_px[0] - u, rim.centre_px[1] - v) / rim.radius_px
    if (
        abs(aspect - 1) > SAME_ASPECT
        or axis_offset > MAX_AXIS_OFFSET
        or sensor.secondary is not None
    ):
        return (_centre_on_rim(rim, sensor),)
    pitch_um = sensor.aligned().rim_radius_px * imager.pixel_pitch_um / rim.semi_axes_px[0]
    scaled_imager = replace(
        imager, width_px=width, height_px=height, pixel_pitch_um=pitch_um, centre_px=(u, v)
    )
    scaled = replace(sensor, imager=scaled_imager)
    is_tilted = rim.semi_axes_px[0] - rim.semi_axes_px[1] > MIN_DIFFERENCE_PX
    candidates = [_fit_pose(scaled, rim, side) for side in ((1, -1) if is_tilted else (0,))]
    return _consistent_with_camera_image(
        sorted(candidates, key=lambda candidate: float(np.hypot(*candidate.mirror_pose.shift[:2]))),
        rim,
    )


def _consistent_with_camera_image(
    candidates: list[Sensor], rim: MirrorOutline
) -> tuple[Sensor, ...]:
    """Return the sensors that agree with the detected image of the camera; both if ambiguous."""
    if len(candidates) < 2 or rim.camera_image is None:
        return tuple(candidates)
    measured = [
        sensor.image_plane.flat_mm(np.array(rim.camera_image.centre_px))[0] / sensor.imager.pitch_mm
        for sensor in candidates
    ]
    distances = [
        float(np.linalg.norm(position - _lens_image(sensor)))
        for sensor, position in zip(candidates, measured, strict=True)
    ]
    consistent = [
        k
        for k in (0, 1)
        if distances[k]
        < OWN_IMAGE * rim.radius_px
        < 2 * OWN_IMAGE * rim.radius_px
        < distances[1 - k]
    ]
    return tuple(candidates[k] for k in consistent) or tuple(candidates)


def _lens_image(sensor: Sensor) -> Array:
    """Return the image of the lens (2,) in px from the image centre; NaN if it is not visible.

    A ray from the lens along the mirror normal is reflected into itself.
    """
    from scipy.optimize import least_squares

    pose, mirror, rim_mm = sensor.mirror_pose, sensor.mirror, sensor.mirror.rim_radius_mm

    def line_of_sight(position: Array) -> tuple[Array, Array]:
        """Return a mirror point (1, 3) relative to the lens, and the direction to the lens."""
        height = mirror.sag(np.array([np.hypot(*position)]))
        point = pose.to_camera(np.array([[*position, float(height[0])]])) - sensor.lens_offset
        towards = np.array([[0.0, 0.0, -1.0]]) if sensor.lens.TELECENTRIC else -point
        return point, towards / np.linalg.norm(towards)

    def tangential_components(position: Array) -> Array:
        """Return the components (2,) of the direction to the lens along two tangents."""
        x, y = position
        radius = max(float(np.hypot(x, y)), 1e-9)
        slope = float(mirror.slope(np.array([radius]))[0]) / radius
        tangents = pose.rotate_to_camera(np.array([[1.0, 0.0, slope * x], [0.0, 1.0, slope * y]]))
        return np.asarray(tangents @ line_of_sight(position)[1][0])

    solution = least_squares(tangential_components, np.zeros(2), x_scale=rim_mm)
    if np.abs(solution.fun).max() > 1e-6 or np.hypot(*solution.x) > rim_mm:
        return np.full(2, np.nan)
    return np.asarray(sensor.lens.image_of(*line_of_sight(solution.x))[0] / sensor.imager.pitch_mm)


def _fit_pose(sensor: Sensor, rim: MirrorOutline, tilt_side: int) -> Sensor:
    """Return the sensor with the given rim, and a tilt to one side of the minor axis or no tilt."""
    from scipy.optimize import least_squares

    mirror, pitch_mm = sensor.mirror, sensor.imager.pitch_mm
    image_mm = sensor.image_plane.flat_mm(rim.points(RIM_POINTS))[0]
    centre = image_mm.mean(axis=0)
    a, b = rim.semi_axes_px
    minor_axis = np.radians(rim.angle_deg + 90)
    minor_axis = np.pi - minor_axis if sensor.mount.image_flipped else minor_axis
    tilt_deg = (
        tilt_side
        * np.degrees(np.arccos(min(b / a, 1.0)))
        * np.array([-np.sin(minor_axis), np.cos(minor_axis)])
    )
    sag_mm = float(mirror.sag(np.array([mirror.rim_radius_mm]))[0])
    azimuth = np.arange(RIM_POINTS) * (2 * np.pi / RIM_POINTS)
    circle = mirror.rim_radius_mm * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    circle = np.column_stack([circle, np.full(RIM_POINTS, sag_mm)])
    per_mm = a * pitch_mm / mirror.rim_radius_mm

    def pose_of(numbers: Array) -> MirrorPose:
        tilt = numbers[3:] if tilt_side else np.zeros(2)
        return MirrorPose(float(numbers[1]), float(numbers[2]), 0.0, float(tilt[0]), float(tilt[1]))

    def offsets_from_centre(numbers: Array) -> Array:
        """Return offsets (n, 2) of the scaled image points of the rim from the ellipse centre."""
        points = pose_of(numbers).to_camera(circle) - sensor.lens_offset
        towards = (
            np.broadcast_to([0.0, 0.0, -1.0], points.shape) if sensor.lens.TELECENTRIC else -points
        )
        offsets: Array = numbers[0] * sensor.lens.image_of(points, towards) - centre
        return offsets

    def distances(numbers: Array) -> Array:
        away = offsets_from_centre(numbers)
        return np.asarray(np.linalg.norm(np.linalg.solve(shape, away.T), axis=0) - 1)

    moments = (image_mm - centre).T @ (image_mm - centre) * (2 / RIM_POINTS)
    shape = np.linalg.cholesky(moments)
    start = np.array([1.0, *(centre / per_mm), *tilt_deg])[: 5 if tilt_side else 3]
    solution = least_squares(
        distances, start, x_scale=np.array([0.01, 1.0, 1.0, 1.0, 1.0])[: len(start)]
    ).x
    imager = replace(
        sensor.imager, pixel_pitch_um=sensor.imager.pixel_pitch_um / float(solution[0])
    )
    return replace(sensor, imager=imager, mirror_pose=pose_of(solution))


def _centre_on_rim(rim: MirrorOutline, sensor: Sensor) -> Sensor:
    """Return the aligned sensor with its axis at the centre of the rim."""
    width, height = rim.image_size
    aligned = sensor.aligned()
    pitch_um = aligned.rim_radius_px * aligned.imager.pixel_pitch_um / rim.radius_px
    u, v = rim.centre_px
    centre = (width - 1 - u, v) if sensor.mount.image_flipped else (u, v)
    imager = replace(
        aligned.imager, width_px=width, height_px=height, pixel_pitch_um=pitch_um, centre_px=centre
    )
    return replace(aligned, imager=imager)
