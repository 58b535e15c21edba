"""Video frames: access to planes as arrays, and conversion of arrays to frames.

A frame is a PyAV frame: it owns its memory, and has a time (``pts`` in units of ``time_base``,
``time`` in seconds) and a colour coding. Conversions use this coding and copy it to their results.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Literal

import av
import numpy as np
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from ...base.errors import MediaError
from .formats import Kind

Image = NDArray[Any]
Planes = tuple[NDArray[Any], ...]
"""Planes (y, u, v), or (y, uv) of NV12: (h, w), then (h/2, w/2), or (h/2, w/2, 2), halves rounded
up; uint8. Other frames have chroma (h, w/2) in 4:2:2 and (h, w) in 4:4:4, a fourth plane (h, w) for
transparency, and uint16.
"""

PLANAR = ("yuv420p", "yuvj420p", "nv12")
"""Pixel formats with direct access to planes; the second is the first in full range."""
PACKED = {1: "gray", 3: "rgb24", 4: "rgba"}
FULL_RANGE = 2
Siting = Literal["left", "center", "right", "top", "bottom"]
"""Position of chroma samples; the last three occur in frames that were turned or mirrored."""
CENTRED = ("mjpeg", "mpeg1video", "h263", "flv1")
"""Codecs with chroma samples at the centre of 2 x 2 pixels, instead of at the left."""

_kept = threading.local()


@dataclass(frozen=True)
class Colour:
    """Colour coding with the numbers of FFmpeg (ITU-T H.273); unspecified by default.

    >>> Colour(range=2).is_full_range
    True
    """

    range: int = 0
    """1: luma from 16 to 235; 2: from 0 to 255."""
    space: int = 2
    """Matrix of luma and chroma: 1 BT.709, 5 and 6 BT.601, 9 BT.2020."""
    primaries: int = 2
    transfer: int = 2

    @property
    def is_full_range(self) -> bool:
        return self.range == FULL_RANGE

    @property
    def is_hdr(self) -> bool:
        """True if the transfer function is PQ or HLG."""
        return self.transfer in (16, 18)

    @classmethod
    def of(cls, coded: Any) -> Colour:
        """Return the colour coding of a frame, or of a codec context."""
        return cls(int(coded.color_range), int(coded.colorspace), int(coded.color_primaries), int(coded.color_trc))

    @classmethod
    def told_by(cls, frame: av.VideoFrame) -> Colour:
        """Return the colour coding of a video with such frames; RGB becomes BT.709."""
        return OF_RGB if frame.format.is_rgb or frame.format.has_palette else cls.of(frame)

    def put_on(self, coded: Any) -> None:
        """Set the colour coding of a frame, or of a codec context."""
        coded.color_range = self.range
        coded.colorspace = self.space
        coded.color_primaries = self.primaries
        coded.color_trc = self.transfer


OF_RGB = Colour(range=1, space=1, primaries=1, transfer=13)
"""Coding of RGB images as luma and chroma: BT.709, with the sRGB transfer function."""


def planes(frame: av.VideoFrame) -> Planes:
    """Return the planes of a frame in planar YUV or NV12, without copying or converting.

    Rows may be padded, as described by the strides of the views. The views keep the memory of the
    frame alive.

    Raises
    ------
    MediaError
        The frame has another pixel format; convert it first by :func:`planar` or :func:`workable`.

    Examples
    --------
    >>> frame, (y, u, v) = empty_frame((63, 47))
    >>> y[:] = 128
    >>> [plane.shape for plane in planes(frame)], planes(frame)[0][0, 62]
    ([(47, 63), (24, 32), (24, 32)], np.uint8(128))
    """
    if not has_planes(frame):
        raise MediaError(f"frames of pixel format {frame.format.name} have no planes; valid are nv12 and planar YUV")
    kind = np.dtype(np.uint8 if Kind.of(frame.format.name).bits == 8 else "<u2")
    views: list[NDArray[Any]] = []
    for plane in frame.planes:
        step = abs(plane.line_size) // kind.itemsize
        rows = np.frombuffer(plane, kind)[: step * plane.height].reshape(plane.height, step)  # type: ignore[call-overload]
        if plane.line_size < 0:  # stored bottom-up
            rows = rows[::-1]
        is_pairs = len(frame.planes) == 2 and bool(views)
        views.append(rows[:, : 2 * plane.width].reshape(plane.height, -1, 2) if is_pairs else rows[:, : plane.width])
    return tuple(views)


def siting_of(codec: str) -> Siting:
    """Return the chroma siting of a codec, unless specified by a stream (not available in PyAV).

    >>> siting_of("h264"), siting_of("mjpeg")
    ('left', 'center')
    """
    return "center" if codec in CENTRED else "left"


def is_full_range(frame: av.VideoFrame) -> bool:
    """Return whether luma has full range, 0 to 255."""
    return bool(frame.color_range == FULL_RANGE) or frame.format.name.startswith("yuvj")


def converted(frame: av.VideoFrame, pixel_format: str, **colours: int) -> av.VideoFrame:
    """Convert a frame to another pixel format, with its time and colour coding.

    The setup of a conversion in FFmpeg takes longer than the conversion; it is cached per thread
    for the next frame.
    """
    kept: dict[Any, VideoReformatter] = _kept.__dict__.setdefault("reformatters", {})
    kind = (frame.width, frame.height, frame.format.name, pixel_format)
    if kind not in kept:
        kept[kind] = VideoReformatter()
    return kept[kind].reformat(frame, format=pixel_format, **colours)


def planar(frame: av.VideoFrame) -> av.VideoFrame:
    """Return the frame itself if its planes are accessible, otherwise converted to yuv420p."""
    return frame if frame.format.name in PLANAR else converted(frame, "yuv420p")


def has_planes(frame: av.VideoFrame) -> bool:
    """Return whether :func:`planes` supports the frame."""
    name = frame.format.name
    return name in PLANAR or Kind.of(name).name == name.replace("yuvj", "yuv")


def workable(frame: av.VideoFrame) -> av.VideoFrame:
    """Return the frame itself if its planes are accessible, otherwise converted losslessly to a
    planar format.
    """
    if has_planes(frame):
        return frame
    if frame.format.is_rgb or frame.format.has_palette:
        OF_RGB.put_on(frame)
    return converted(frame, Kind.of(frame.format.name).name)


def empty_frame(
    size: tuple[int, int], pixel_format: str = "yuv420p", like: av.VideoFrame | None = None
) -> tuple[av.VideoFrame, Planes]:
    """Allocate a frame to be filled through its planes, which avoids a copy.

    Parameters
    ----------
    size : (width, height) px
    pixel_format
        ``"nv12"``, or planar YUV; values are undefined.
    like
        Frame that provides time and colour coding.
    """
    frame = av.VideoFrame(size[0], size[1], pixel_format)
    if like is not None:
        _carry_on(like, frame)
        Colour.of(like).put_on(frame)
    return frame, planes(frame)


def frame_of_planes(parts: Planes, like: av.VideoFrame | None = None) -> av.VideoFrame:
    """Create a frame from copies of planes as from :func:`planes`, with time and colour coding of
    ``like``.

    Raises
    ------
    MediaError
        The shapes do not form a 4:2:0 image.
    """
    height, width = parts[0].shape[:2]
    frame, into = empty_frame((width, height), "nv12" if len(parts) == 2 else "yuv420p", like)
    if [part.shape for part in parts] != [plane.shape for plane in into]:
        shapes = ", ".join(str(part.shape) for part in parts)
        raise MediaError(f"planes of shapes {shapes} are not one 4:2:0 picture of {width} x {height} px")
    for part, plane in zip(parts, into, strict=True):
        plane[:] = part
    return frame


def image_of_frame(frame: av.VideoFrame) -> Image:
    """Convert the frame to an image (h, w, 3) uint8, red, green, blue, according to its colour
    coding.
    """
    image: Image = converted(frame, "rgb24").to_ndarray()
    return image


def frame_of_image(image: Image, like: av.VideoFrame | None = None) -> av.VideoFrame:
    """Create a frame of an image (h, w), (h, w, 3) or (h, w, 4) uint8; grey, or red, green, blue
    (alpha).

    A contiguous image is not copied: it must not change until the frame is written. The time is
    that of ``like``; its colour coding is stored for the later conversion to luma and chroma.

    Raises
    ------
    MediaError
        The array is not such an image.
    """
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in PACKED or image.dtype != np.uint8 or 0 in image.shape:
        raise MediaError(
            f"an array of {image.dtype} and shape {image.shape} is no frame; valid are uint8 pictures of 1, 3 or 4 "
            "channels"
        )
    if channels == 1:
        image = image.reshape(image.shape[:2])
    frame = av.VideoFrame.from_numpy_buffer(np.ascontiguousarray(image), format=PACKED[channels])
    if like is not None:
        _carry_on(like, frame)
        frame.colorspace, frame.color_range = like.colorspace, like.color_range
    return frame


def coded_colour(colour: tuple[float, ...], like: av.VideoFrame) -> tuple[int, int, int]:
    """Convert a colour (red, green, blue) of 8 bits to y, u and v in the colour coding of a frame.

    The values have the bit depth of the frame.

    >>> coded_colour((0, 0, 0), empty_frame((64, 48))[0])
    (16, 128, 128)
    """
    scale = 1 << (Kind.of(like.format.name).bits - 8)
    like = planar(like)
    frame = frame_of_image(np.full((2, 2, 3), colour, np.uint8), like)
    frame.color_range = FULL_RANGE if is_full_range(like) else 1
    y, u, v = (scale * int(plane[0, 0]) for plane in planes(converted(frame, "yuv420p")))
    return y, u, v


def as_frame(made: av.VideoFrame | Image | Planes, like: av.VideoFrame) -> av.VideoFrame:
    """Convert the result of an image function (frame, image or planes) to a frame."""
    if isinstance(made, av.VideoFrame):
        if made.pts is None:
            _carry_on(like, made)
        return made
    return frame_of_planes(made, like) if isinstance(made, tuple) else frame_of_image(made, like)


def _carry_on(like: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the time of one frame to another."""
    frame.pts = like.pts
    if like.time_base is not None:
        frame.time_base = like.time_base
    frame.duration = like.duration
