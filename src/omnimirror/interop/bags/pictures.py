"""Pictures in messages: what an encoding's bytes are, as arrays, and the way back."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import MediaError
from ...media.pictures.images import decoded, encoded

Image = NDArray[Any]

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
KINDS = (IMAGE, COMPRESSED)
"""The types of messages that hold pictures."""


class Coding(NamedTuple):
    """What an encoding's bytes are."""

    depth: str
    channels: int
    to_rgb: int | None = None
    """OpenCV's conversion to what is worked with: RGB, RGBA or grey. None where it is that already."""
    back: int | None = None
    """Its conversion back; where there is none, the straightened picture is rgb8 or rgb16."""


CODINGS = {
    "mono8": Coding("uint8", 1),
    "mono16": Coding("uint16", 1),
    "8UC1": Coding("uint8", 1),
    "16UC1": Coding("uint16", 1),
    "rgb8": Coding("uint8", 3),
    "rgb16": Coding("uint16", 3),
    "rgba8": Coding("uint8", 4),
    "bgr8": Coding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "8UC3": Coding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgr16": Coding("uint16", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgra8": Coding("uint8", 4, cv2.COLOR_BGRA2RGBA, cv2.COLOR_RGBA2BGRA),
    "yuv422": Coding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": Coding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": Coding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": Coding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    # OpenCV names a pattern by its second row, from the second column on
    **{
        f"bayer_{pattern}{bits}": Coding(f"uint{bits}", 1, conversion)
        for bits in (8, 16)
        for pattern, conversion in {
            "rggb": cv2.COLOR_BayerBG2RGB,
            "bggr": cv2.COLOR_BayerRG2RGB,
            "gbrg": cv2.COLOR_BayerGR2RGB,
            "grbg": cv2.COLOR_BayerGB2RGB,
        }.items()
    },
}
"""By ROS's names (sensor_msgs/image_encodings.hpp)."""


class Unpacked(NamedTuple):
    """A picture, and how to put one like it into a message of the same kind."""

    image: Image
    """(h, w), (h, w, 3) or (h, w, 4); red, green, blue (alpha)."""
    coding: str
    """The encoding of its message, or the suffix of a compressed one's."""


def picture_of(message: Any, topic: str) -> Unpacked:
    """The picture in a message, raw or compressed.

    Raises
    ------
    MediaError
        Its encoding is not known, or it does not hold as many bytes as it says.
    """
    return _raw(message, topic) if hasattr(message, "encoding") else _compressed(message, topic)


def _raw(message: Any, topic: str) -> Unpacked:
    name, width, height, step = message.encoding, message.width, message.height, message.step
    coding = CODINGS.get(name)
    if coding is None:
        raise MediaError(f"pictures of {topic} are encoded as {name!r}; valid are {', '.join(CODINGS)}")
    kind = np.dtype(coding.depth).newbyteorder(">" if message.is_bigendian else "<")
    row = width * coding.channels * kind.itemsize
    if not width or not height or step < row or len(message.data) != height * step:
        raise MediaError(
            f"a picture of {topic} says that it has {width} x {height} px of {name} in rows of {step} bytes, and holds "
            f"{len(message.data)} bytes"
        )
    rows = np.asarray(message.data, np.uint8).reshape(height, step)[:, :row]
    values = np.ascontiguousarray(rows).view(kind).astype(coding.depth, copy=False)
    image = values if coding.channels == 1 else values.reshape(height, width, coding.channels)
    return Unpacked(image if coding.to_rgb is None else np.asarray(cv2.cvtColor(image, coding.to_rgb)), name)


def _compressed(message: Any, topic: str) -> Unpacked:
    told = message.format.lower()
    suffix = next((s for word, s in (("png", ".png"), ("jpeg", ".jpg"), ("jpg", ".jpg")) if word in told), None)
    if suffix is None or "compresseddepth" in told:
        raise MediaError(f"pictures of {topic} are compressed as {message.format!r}; valid are jpeg and png")
    return Unpacked(decoded(f"of {topic}", bytes(message.data)), suffix)


def raw_values(image: Image, coding: str) -> tuple[str, Image]:
    """The encoding of a straightened picture, and its values (h, w) or (h, w, c) in that encoding's order."""
    known = CODINGS[coding]
    if known.to_rgb is None:
        return coding, image
    if known.back is None:
        return ("rgb8" if image.dtype == np.uint8 else "rgb16"), image
    return coding, np.asarray(cv2.cvtColor(image, known.back))


def compressed_bytes(image: Image, suffix: str) -> tuple[str, bytes]:
    """What a compressed message says of its format, as ROS's image transport does, and its data."""
    bits, kind = 8 * image.itemsize, "png" if suffix == ".png" else "jpeg"
    named = ("mono", "mono") if image.ndim == 2 else ("rgb", "bgr")  # what it was, and as what OpenCV decodes it
    return f"{named[0]}{bits}; {kind} compressed {named[1]}{bits}", encoded(image, suffix)
