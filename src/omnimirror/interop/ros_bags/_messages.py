"""ROS messages: images and their encodings, camera_info, and transforms of the TF tree."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...base.errors import MediaError
from ...base.typing import Array
from ...cameras.camera import Camera, Mount
from ...io.images import decoded, encoded
from ...optics.sensor import Sensor
from ..pinholes import EquivalentPinhole

Image = NDArray[Any]

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
TF_STATIC = "/tf_static"

# -- images --------------------------------------------------------------------------------------


class Encoding(NamedTuple):
    """Pixel format of an image message."""

    depth: str
    channels: int
    to_rgb: int | None = None
    """OpenCV conversion to RGB, RGBA or grey; None if no conversion is needed."""
    from_rgb: int | None = None
    """Inverse conversion; without one, dewarped images are rgb8 or rgb16."""


ENCODINGS = {
    "mono8": Encoding("uint8", 1),
    "mono16": Encoding("uint16", 1),
    "8UC1": Encoding("uint8", 1),
    "16UC1": Encoding("uint16", 1),
    "rgb8": Encoding("uint8", 3),
    "rgb16": Encoding("uint16", 3),
    "rgba8": Encoding("uint8", 4),
    "bgr8": Encoding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "8UC3": Encoding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgr16": Encoding("uint16", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgra8": Encoding("uint8", 4, cv2.COLOR_BGRA2RGBA, cv2.COLOR_RGBA2BGRA),
    "yuv422": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    # OpenCV names a Bayer pattern by its second row, beginning with the second column.
    **{
        f"bayer_{pattern}{bits}": Encoding(f"uint{bits}", 1, conversion)
        for bits in (8, 16)
        for pattern, conversion in {
            "rggb": cv2.COLOR_BayerBG2RGB,
            "bggr": cv2.COLOR_BayerRG2RGB,
            "gbrg": cv2.COLOR_BayerGR2RGB,
            "grbg": cv2.COLOR_BayerGB2RGB,
        }.items()
    },
}
"""Encodings by ROS name (sensor_msgs/image_encodings.hpp)."""


class MessageImage(NamedTuple):
    """Decoded image of a message."""

    image: Image
    """(h, w), (h, w, 3) or (h, w, 4), RGB(A)."""
    encoding: str
    """Encoding of a raw message, or file suffix of a compressed one."""

    @property
    def is_compressed(self) -> bool:
        """True if the message was a CompressedImage."""
        return self.encoding.startswith(".")


def decode_image(message: Any, topic: str) -> MessageImage:
    """Return the image of a raw or compressed message.

    Raises
    ------
    MediaError
        If the encoding is unknown or the number of bytes does not match the size.
    """
    if hasattr(message, "encoding"):
        return _decode_raw(message, topic)
    return _decode_compressed(message, topic)


def _decode_raw(message: Any, topic: str) -> MessageImage:
    name, width, height, step = message.encoding, message.width, message.height, message.step
    encoding = ENCODINGS.get(name)
    if encoding is None:
        raise MediaError(
            f"the encoding of {topic} must be one of {', '.join(ENCODINGS)}; got {name!r}"
        )
    dtype = np.dtype(encoding.depth).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = width * encoding.channels * dtype.itemsize
    if not width or not height or step < row_bytes or len(message.data) != height * step:
        raise MediaError(
            f"an image of {topic} must hold {width} x {height} px of {name} in rows of {step} "
            f"bytes; got {len(message.data)} bytes"
        )
    rows = np.asarray(message.data, np.uint8).reshape(height, step)[:, :row_bytes]
    image = np.ascontiguousarray(rows).view(dtype).astype(encoding.depth, copy=False)
    if encoding.channels > 1:
        image = image.reshape(height, width, encoding.channels)
    if encoding.to_rgb is not None:
        image = np.asarray(cv2.cvtColor(image, encoding.to_rgb))
    return MessageImage(image, name)


def _decode_compressed(message: Any, topic: str) -> MessageImage:
    label = message.format.lower()
    suffixes = {"png": ".png", "jpeg": ".jpg", "jpg": ".jpg"}
    suffix = next((suffix for word, suffix in suffixes.items() if word in label), None)
    if suffix is None or "compresseddepth" in label:
        raise MediaError(f"the compression of {topic} must be jpeg or png; got {message.format!r}")
    return MessageImage(decoded(f"of {topic}", bytes(message.data)), suffix)


def encode_raw(image: Image, name: str) -> tuple[str, Image]:
    """Return the encoding of a dewarped image and its values (h, w) or (h, w, c) in that order."""
    encoding = ENCODINGS[name]
    if encoding.to_rgb is None:
        return name, image
    if encoding.from_rgb is None:
        return ("rgb8" if image.dtype == np.uint8 else "rgb16"), image
    return name, np.asarray(cv2.cvtColor(image, encoding.from_rgb))


def encode_compressed(image: Image, suffix: str) -> tuple[str, bytes]:
    """Return the format label of a compressed message, as ROS image_transport, and its data."""
    bits, codec = 8 * image.itemsize, "png" if suffix == ".png" else "jpeg"
    original, stored = ("mono", "mono") if image.ndim == 2 else ("rgb", "bgr")
    label = f"{original}{bits}; {codec} compressed {stored}{bits}"
    return label, encoded(image, suffix)


# -- messages ------------------------------------------------------------------------------------


class MessageFactory:
    """Factory of messages of ROS 2 or ROS 1.

    Parameters
    ----------
    store
        Type store of rosbags.
    ros1
        Create and serialise messages for a bag of ROS 1.
    """

    def __init__(self, store: Any, ros1: bool = False) -> None:
        self.store, self.types, self.ros1 = store, store.types, ros1

    def serialize(self, message: Any) -> bytes:
        """Return the bytes of a message as stored in a bag."""
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def header(self, stamp: Any, frame: str) -> Any:
        """Return a Header with a copy of a stamp, which may be of the other ROS version."""
        time = self.types["builtin_interfaces/msg/Time"](sec=stamp.sec, nanosec=stamp.nanosec)
        sequence = {"seq": 0} if self.ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **sequence)

    def camera_info(self, header: Any, pinhole: EquivalentPinhole) -> Any:
        """Return the CameraInfo of a pinhole camera without distortion."""
        width, height = pinhole.size
        roi = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        matrices = {
            "d": np.zeros(5),
            "k": pinhole.matrix.ravel(),
            "r": np.eye(3).ravel(),
            "p": np.hstack([pinhole.matrix, np.zeros((3, 1))]).ravel(),
        }
        if self.ros1:
            matrices = {name.upper(): values for name, values in matrices.items()}
        return self.types[CAMERA_INFO](
            header=header,
            height=height,
            width=width,
            distortion_model="plumb_bob",
            **matrices,
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def image(self, header: Any, encoding: str, values: Image) -> Any:
        """Return an Image."""
        height, width = values.shape[:2]
        little_endian = values.astype(values.dtype.newbyteorder("<"), copy=False)
        data = np.ascontiguousarray(little_endian).view(np.uint8).ravel()
        return self.types[IMAGE](
            header=header,
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )

    def compressed_image(self, header: Any, label: str, data: bytes) -> Any:
        """Return a CompressedImage."""
        return self.types[COMPRESSED_IMAGE](
            header=header, format=label, data=np.frombuffer(data, np.uint8)
        )

    def transform(
        self, stamp: Any, parent: str, child: str, rotation: Array, position_mm: Array
    ) -> Any:
        """Return a TransformStamped; the columns of ``rotation`` are the child axes."""
        x, y, z = (float(value) / 1000.0 for value in position_mm)
        qx, qy, qz, qw = (float(value) for value in Rotation.from_matrix(rotation).as_quat())
        types = self.types
        return types["geometry_msgs/msg/TransformStamped"](
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
            ),
        )

    def tf_message(self, transforms: list[Any]) -> Any:
        """Return a TFMessage."""
        return self.types[TF_MESSAGE](transforms=transforms)


def mirror_in_optical_frame(camera: Camera) -> tuple[Array, Array] | None:
    """Return the pose of the mirror frame in the optical frame of the camera below the mirror.

    The mirror frame is x forward, y left, z up, with the origin at the vertex. For calibrated
    models and telecentric lenses, which have no finite mirror distance, both origins coincide.

    Returns
    -------
    rotation, position_mm
        (3, 3) array and (3,) array, mm; None if the mount of the camera is unknown.
    """
    mount = getattr(camera, "mount", None)
    if not isinstance(mount, Mount):
        return None
    distance_mm = camera.mirror_distance_mm if isinstance(camera, Sensor) else 0.0
    if not np.isfinite(distance_mm):
        distance_mm = 0.0
    return mount.rotation().T, np.array([0.0, 0.0, distance_mm])
