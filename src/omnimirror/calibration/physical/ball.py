"""Mirror ball at a finite distance and off the image centre."""

from __future__ import annotations

import numpy as np

from ...base.arguments import checked, finite, number
from ...base.errors import InvalidParameter
from ...cameras.frames import Mount
from ...optics.image_sensor import Imager
from ...optics.lenses import Perspective
from ...optics.mirrors import Sphere
from ...optics.mirrors.pose import MirrorPose
from ...optics.sensor import Sensor
from .sensor_model import SensorModel

GRAZING = 1 - 1e-6  # fraction of the outline's distance from the axis: grazing incidence
MOST_PX = 1e9
SMALLEST = 1e-6  # radians; minimum angular radius of a ball
PITCH_UM = 5.0  # arbitrary: an image determines only angles


@checked
def mirror_ball_model(
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    rim_radius_px: float,
    *,
    focal_px: float,
    ball_radius_mm: float = 40.0,
    mount: Mount | None = None,
) -> SensorModel:
    """Create a sensor model of a ball from its outline in the image.

    The outline of a ball of radius A at centre distance D has the angular radius
    ``sin(alpha) = A / D``. An image determines only the ratio of radius and distance: the radius is
    assumed known, and distance and position are estimated.

    Parameters
    ----------
    image_size : (width, height)
        Size of the image.
    centre_px : (u, v)
        Centre of the outline.
    rim_radius_px
        Radius of the outline.
    focal_px
        Focal length of the camera in pixels: ``width / 2 / tan(hfov / 2)``.
    ball_radius_mm
        Radius of the ball.
    mount
        Orientation of the camera; by default horizontal, as on a tripod.

    Returns
    -------
    SensorModel
        Model with free distance and position.

    Raises
    ------
    InvalidParameter
        If a number is not positive.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.mirror_ball_model((4000, 3000), (2050.0, 1480.0), 900.0, focal_px=6000.0)
    >>> round(model.sensor.mirror_distance_mm + 40.0)  # to the centre of the ball
    270
    >>> [p.name for p in model.parameters]
    ['mount.mirror_distance_mm', 'mirror_pose.decentre_x_mm', 'mirror_pose.decentre_y_mm']
    """
    number("rim_radius_px", rim_radius_px, low=1.0, high=MOST_PX)
    number("focal_px", focal_px, low=1.0, high=MOST_PX)
    number("ball_radius_mm", ball_radius_mm, low=1e-3, high=1e6)
    stand = Mount("forward") if mount is None else mount
    (width, height), (u, v) = finite("image_size", image_size, 1.0), finite("centre_px", centre_px)
    across = np.array([u - (width - 1) / 2, v - (height - 1) / 2])
    if stand.image_flipped:
        across[0] = -across[0]
    off = float(np.hypot(*across))
    far, near = np.arctan((off + rim_radius_px) / focal_px), np.arctan((off - rim_radius_px) / focal_px)
    delta, alpha = (far + near) / 2, (far - near) / 2  # of the ball's centre; elongated off axis
    if not alpha > SMALLEST:
        raise InvalidParameter(
            f"rim_radius_px = {rim_radius_px:g} is not valid with focal_px = {focal_px:g}: the ball would be a point"
        )
    towards = np.append(np.sin(delta) * across / (off or 1.0), np.cos(delta))
    vertex = ball_radius_mm * (1 / np.sin(alpha) - 1) * towards
    distance, b0 = float(vertex[2]), focal_px * PITCH_UM * 1e-3
    pose = MirrorPose(
        decentre_x_mm=float(vertex[0]),
        decentre_y_mm=float(vertex[1]),
        tilt_x_deg=float(-np.degrees(np.arcsin(towards[1]))),
        tilt_y_deg=float(np.degrees(np.arctan2(towards[0], towards[2]))),
    )
    sensor = Sensor(
        Sphere(ball_radius_mm, float(ball_radius_mm * np.cos(alpha) * GRAZING)),
        Perspective(1 / (1 / b0 + 1 / distance), 8.0, distance),
        Imager(int(width), int(height), PITCH_UM),
        stand,
        distance,
        name="mirror ball",
        mirror_pose=pose,
    )
    return SensorModel(sensor, ("distance", "decentre"))
