"""ROS 2 node that dewarps the images of an omnidirectional mirror camera.

The node subscribes to ``image_raw`` and publishes each view as an image with camera_info, and the
frames of the virtual cameras on ``/tf_static``. Topics, encodings and frames are those of dewarped
bags. The entries of the views are parameters, such as ``front.pan_deg``, which can be changed while
the node runs.
"""

from __future__ import annotations

import array
from types import SimpleNamespace
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from omnimirror.base.errors import OmnimirrorError
from omnimirror.dewarp.request import DewarpRequest
from omnimirror.interop.named_views import load_views, parse_view
from omnimirror.interop.ros_bags.dewarping import MessageFactory, VirtualRig
from omnimirror.optics.camera_files import load_camera

SETTINGS = {
    "sensor": "",
    "views": "",
    "image_transport": "raw",
    "interpolation": "auto",
    "keep_tilt": False,
    "mirror_frame": "",
}
"""Parameters other than the entries of views, with their defaults."""
TRANSPORTS = {"raw": (Image, ""), "compressed": (CompressedImage, "/compressed")}
DEFAULT_VIEW = "front"


def _is_view_entry(name: str) -> bool:
    """Return whether a parameter is the entry of a view, such as ``front.pan_deg``."""
    return "." in name and not name.startswith("qos_overrides.")


def _as_message_values(values: dict[str, Any]) -> dict[str, Any]:
    """Convert arrays to the types of message fields; rclpy checks lists element by element."""
    return {
        name: array.array("B", value.tobytes())
        if isinstance(value, np.ndarray) and value.dtype == np.uint8
        else value.tolist()
        if name == "d"
        else value
        for name, value in values.items()
    }


def _message_types() -> dict[str, Any]:
    """Return constructors of messages by the names that rosbags uses."""
    types = {
        "builtin_interfaces/msg/Time": Time,
        "std_msgs/msg/Header": Header,
        "sensor_msgs/msg/Image": Image,
        "sensor_msgs/msg/CompressedImage": CompressedImage,
        "sensor_msgs/msg/CameraInfo": CameraInfo,
        "sensor_msgs/msg/RegionOfInterest": RegionOfInterest,
        "geometry_msgs/msg/Vector3": Vector3,
        "geometry_msgs/msg/Quaternion": Quaternion,
        "geometry_msgs/msg/Transform": Transform,
        "geometry_msgs/msg/TransformStamped": TransformStamped,
        "tf2_msgs/msg/TFMessage": TFMessage,
    }
    return {
        name: lambda kind=kind, **values: kind(**_as_message_values(values))
        for name, kind in types.items()
    }


class Publishers:
    """Destination of messages: one publisher per topic, created with its first message."""

    def __init__(self, node: Node) -> None:
        self.factory = MessageFactory(SimpleNamespace(types=_message_types()))
        self._node = node
        self._publishers: dict[str, Any] = {}

    def write(self, topic: str, message: Any, timestamp: int, *, latched: bool = False) -> None:
        """Publish a message; late subscribers receive the last latched one."""
        if topic not in self._publishers:
            latest = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            qos = latest if latched else qos_profile_sensor_data
            self._publishers[topic] = self._node.create_publisher(type(message), topic, qos)
        self._publishers[topic].publish(message)


class DewarpNode(Node):
    """Node that dewarps one image topic to several views.

    Raises
    ------
    OmnimirrorError
        If a parameter is invalid, or the sensor or the views cannot be read.
    """

    def __init__(self) -> None:
        super().__init__(
            "omnimirror_dewarp",
            allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True,
        )
        for name, default in SETTINGS.items():
            if not self.has_parameter(name):
                self.declare_parameter(name, default)
        self._sink = Publishers(self)
        self._last_image: Any = None
        values = {name: self.get_parameter(name).value for name in SETTINGS}
        parameters = self.get_parameters_by_prefix("")
        self._entries = {n: p.value for n, p in parameters.items() if _is_view_entry(n)}
        transport = TRANSPORTS.get(values["image_transport"])
        if transport is None:
            raise OmnimirrorError(
                f"image_transport must be raw or compressed; got {values['image_transport']!r}"
            )
        kind, suffix = transport
        self._topic = self.resolve_topic_name("image_raw") + suffix
        self._rig = self._create_rig(values, self._entries)
        self.add_on_set_parameters_callback(self._on_parameters)
        self.create_subscription(kind, self._topic, self._on_image, qos_profile_sensor_data)

    def _create_rig(self, settings: dict[str, Any], entries: dict[str, Any]) -> VirtualRig:
        """Return the virtual cameras of the parameters."""
        if not settings["sensor"]:
            raise OmnimirrorError(
                "sensor must be a sensor file, a camera file or the name of a bundled sensor; "
                "add -p sensor:=FILE"
            )
        changes: dict[str, dict[str, Any]] = {}
        for name, value in entries.items():
            view, _, key = name.partition(".")
            is_list = isinstance(value, list | tuple | array.array)
            changes.setdefault(view, {})[key] = list(value) if is_list else value
        if settings["views"]:
            views: Any = load_views(settings["views"], changes)
        else:
            tables = changes or {DEFAULT_VIEW: {}}
            views = {name: parse_view(name, table) for name, table in tables.items()}
        request = DewarpRequest(
            load_camera(settings["sensor"]),
            interpolation=settings["interpolation"],
            keep_tilt=settings["keep_tilt"],
        )
        return VirtualRig(request, views, self._topic, self._sink, settings["mirror_frame"] or None)

    def _on_image(self, message: Any) -> None:
        """Publish the views of an image; an invalid image is reported."""
        self._last_image = message
        try:
            self._rig.dewarp(message)
        except OmnimirrorError as e:
            self.get_logger().error(str(e), throttle_duration_sec=5.0)
            return
        for note in self._rig.notes:
            self.get_logger().info(note)
        self._rig.notes.clear()

    def _on_parameters(self, parameters: list[Any]) -> SetParametersResult:
        """Apply changed parameters if the views are valid for the last image."""
        settings = {name: self.get_parameter(name).value for name in SETTINGS}
        entries = dict(self._entries)
        for parameter in parameters:
            if parameter.name == "image_transport":
                reason = "image_transport cannot be changed while the node runs; restart it"
                return SetParametersResult(successful=False, reason=reason)
            if parameter.name in SETTINGS:
                settings[parameter.name] = parameter.value
            elif _is_view_entry(parameter.name):
                entries[parameter.name] = parameter.value
        try:
            rig = self._create_rig(settings, entries)
            if self._last_image is not None:
                rig.dewarp(self._last_image)
        except OmnimirrorError as e:
            return SetParametersResult(successful=False, reason=str(e))
        self._rig, self._entries = rig, entries
        return SetParametersResult(successful=True)


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    try:
        rclpy.spin(DewarpNode())
    except OmnimirrorError as e:
        raise SystemExit(f"omnimirror_dewarp: {e}") from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
