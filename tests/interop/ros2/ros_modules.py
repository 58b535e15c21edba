"""Stand-ins for the modules of ROS 2, with messages that check their values as rosidl does.

Names and types of the fields are those of the message definitions of ROS 2 Humble in rosbags.
"""

from __future__ import annotations

import array
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
MESSAGES = {
    "builtin_interfaces": ["Time"],
    "geometry_msgs": ["Quaternion", "Transform", "TransformStamped", "Vector3"],
    "sensor_msgs": ["CameraInfo", "CompressedImage", "Image", "RegionOfInterest"],
    "std_msgs": ["Header"],
    "tf2_msgs": ["TFMessage"],
}


class Message:
    """Message with the fields of its definition."""

    NAME: str

    def __init__(self, **values: Any) -> None:
        for name, (kind, inner) in STORE.fielddefs[self.NAME][1]:
            value = values.pop(name)
            assert is_valid(kind, inner, value), f"{self.NAME}.{name}: {value!r:.80}"
            setattr(self, name, value)
        assert not values, f"{self.NAME} has no fields {sorted(values)}"


def is_valid(kind: Nodetype, inner: Any, value: Any) -> bool:
    """Return whether the setter of rclpy accepts a value."""
    if kind is Nodetype.NAME:
        return isinstance(value, Message) and inner == value.NAME
    if kind is Nodetype.BASE:
        types = {"string": str, "bool": bool, "float64": float}
        return type(value) is types.get(inner[0], int)
    (item_kind, item), length = inner
    if item_kind is Nodetype.BASE and item[0] == "uint8":
        return isinstance(value, array.array) and value.typecode == "B"
    if isinstance(value, np.ndarray):
        return kind is Nodetype.ARRAY and value.dtype == np.float64 and value.shape == (length,)
    return isinstance(value, list) and all(is_valid(item_kind, item, each) for each in value)


class Publisher:
    """Publisher that keeps its messages."""

    def __init__(self, kind: type, qos: Any) -> None:
        self.kind, self.qos, self.messages = kind, qos, []

    def publish(self, message: Message) -> None:
        assert type(message) is self.kind
        self.messages.append(message)


class Node:
    """Node with given parameters, in the namespace ``/rover/cam``."""

    overrides: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str, **options: bool) -> None:
        assert options == {
            "allow_undeclared_parameters": True,
            "automatically_declare_parameters_from_overrides": True,
        }
        self.name, self.values = name, dict(self.overrides)
        self.publishers: dict[str, Publisher] = {}
        self.errors: list[str] = []
        self.infos: list[str] = []

    def has_parameter(self, name: str) -> bool:
        return name in self.values

    def declare_parameter(self, name: str, default: Any) -> None:
        assert name not in self.values
        self.values[name] = default

    def get_parameter(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(name=name, value=self.values[name])

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, SimpleNamespace]:
        assert prefix == ""
        return {name: self.get_parameter(name) for name in self.values}

    def set_parameter(self, name: str, value: Any) -> SimpleNamespace:
        """Set a parameter as ``ros2 param set`` does."""
        result = self.on_parameters([SimpleNamespace(name=name, value=value)])
        if result.successful:
            self.values[name] = value
        return result

    def resolve_topic_name(self, name: str) -> str:
        return f"/rover/cam/{name}"

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self.on_parameters = callback

    def create_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        assert topic not in self.publishers
        self.publishers[topic] = Publisher(kind, qos)
        return self.publishers[topic]

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any) -> None:
        self.subscription = SimpleNamespace(kind=kind, topic=topic, callback=callback, qos=qos)

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(
            error=lambda text, **_: self.errors.append(text), info=self.infos.append
        )


def modules() -> dict[str, ModuleType]:
    """Return the modules that the node imports, by name."""
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": type("Shutdown", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="transient local"),
            "QoSProfile": SimpleNamespace,
            "qos_profile_sensor_data": "sensor data",
        },
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"SetParametersResult": SimpleNamespace},
    }
    for package, names in MESSAGES.items():
        contents[package] = {}
        contents[f"{package}.msg"] = {
            name: type(name, (Message,), {"NAME": f"{package}/msg/{name}"}) for name in names
        }
    result = {}
    for name, members in contents.items():
        result[name] = ModuleType(name)
        vars(result[name]).update(members)
    return result
