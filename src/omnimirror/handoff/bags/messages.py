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
    """Makes messages of ROS 2's types.

    Parameters
    ----------
    store
        A type store of rosbags that knows them.
    """

    def __init__(self, store: Any) -> None:
        self.store, self.types = store, store.types

    def serialized(self, message: Any) -> bytes:
        """The bytes of a message, as a bag holds them."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def header(self, stamp: Any, frame: str) -> Any:
        """A header; the stamp is copied, so that it may come from a bag of ROS 1."""
        time = self.types["builtin_interfaces/msg/Time"](sec=stamp.sec, nanosec=stamp.nanosec)
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def camera_info(self, header: Any, pinhole: Pinhole) -> Any:
        """What ROS knows of a camera: a pinhole without distortion."""
        width, height = pinhole.size
        whole = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.types[INFO](
            header=header, height=height, width=width, distortion_model="plumb_bob", d=np.zeros(5),
            k=pinhole.matrix.ravel(), r=np.eye(3).ravel(),
            p=np.hstack([pinhole.matrix, np.zeros((3, 1))]).ravel(), binning_x=0, binning_y=0, roi=whole,
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
