"""Messages that go with straightened pictures: camera_info, and where the virtual cameras stand in the TF tree."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras import Camera
from ...frames import Mount
from ...sensor import Sensor
from ..pinholes import Pinhole

Array = NDArray[np.float64]

INFO = "sensor_msgs/msg/CameraInfo"
TF = "tf2_msgs/msg/TFMessage"
STATIC = "/tf_static"
METRES = 1e-3


class Messages:
    """Factory of messages of ROS 2, or of ROS 1.

    Parameters
    ----------
    store
        Type store of rosbags.
    is_ros1
        Whether messages are serialised for a bag of ROS 1.
    """

    def __init__(self, store: Any, is_ros1: bool = False) -> None:
        self.store, self.types, self.is_ros1 = store, store.types, is_ros1

    def serialized(self, message: Any) -> bytes:
        """Return the bytes of a message as a bag stores them."""
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def header(self, stamp: Any, frame: str) -> Any:
        """Return a header with a copy of a stamp, which may be of the other ROS version."""
        time = self.types["builtin_interfaces/msg/Time"](sec=stamp.sec, nanosec=stamp.nanosec)
        sequence = {"seq": 0} if self.is_ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **sequence)

    def camera_info(self, header: Any, pinhole: Pinhole) -> Any:
        """Return the CameraInfo of a pinhole camera without distortion."""
        width, height = pinhole.size
        whole = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        matrices = {
            "d": np.zeros(5), "k": pinhole.matrix.ravel(), "r": np.eye(3).ravel(),
            "p": np.hstack([pinhole.matrix, np.zeros((3, 1))]).ravel(),
        }  # fmt: skip
        if self.is_ros1:
            matrices = {name.upper(): values for name, values in matrices.items()}
        return self.types[INFO](
            header=header, height=height, width=width, distortion_model="plumb_bob", **matrices, binning_x=0,
            binning_y=0, roi=whole,
        )  # fmt: skip

    def image(self, header: Any, encoding: str, values: NDArray[Any]) -> Any:
        """A raw picture."""
        height, width = values.shape[:2]
        data = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"), copy=False)).view(np.uint8).ravel()
        return self.types["sensor_msgs/msg/Image"](
            header=header, height=height, width=width, encoding=encoding, is_bigendian=0, step=data.size // height,
            data=data,
        )  # fmt: skip

    def compressed(self, header: Any, kind: str, data: bytes) -> Any:
        """A compressed picture."""
        return self.types["sensor_msgs/msg/CompressedImage"](
            header=header, format=kind, data=np.frombuffer(data, np.uint8)
        )

    def transform(self, stamp: Any, parent: str, child: str, rotation: Array, position_mm: Array) -> Any:
        """Where a frame stands in another: the columns of ``rotation`` are its axes there."""
        from scipy.spatial.transform import Rotation

        x, y, z = (float(value) * METRES for value in position_mm)
        qx, qy, qz, qw = (float(value) for value in Rotation.from_matrix(rotation).as_quat())
        of = self.types
        return of["geometry_msgs/msg/TransformStamped"](
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=of["geometry_msgs/msg/Transform"](
                translation=of["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                rotation=of["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
            ),
        )

    def tree(self, transforms: list[Any]) -> Any:
        """Transforms that stay as they are."""
        return self.types[TF](transforms=transforms)


def mirror_in_optical(camera: Camera) -> tuple[Array, Array] | None:
    """The mirror's frame (x forward, y left, z up, from its vertex) in the optical frame of the camera that sees it.

    Returns
    -------
    rotation (3, 3), position (3,) mm
        None where nothing is known of how the camera is mounted. A calibrated model, and a telecentric lens, have no
        place from which to count: there both frames stand at one.
    """
    mount = getattr(camera, "mount", None)
    if not isinstance(mount, Mount):
        return None
    away_mm = camera.mirror_distance_mm if isinstance(camera, Sensor) else 0.0
    return mount.rotation().T, np.array([0.0, 0.0, away_mm if np.isfinite(away_mm) else 0.0])
