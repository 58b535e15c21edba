"""Video frames: pixel formats, access to planes, conversion, orientation and deinterlacing."""

from __future__ import annotations

import struct
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal

import av
import numpy as np
from av.filter import Graph
from av.sidedata.sidedata import Type as SideData
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from ..base.errors import MediaError
from .image_metadata import ORIENTATION_NAMES, STORED_ORIENTATION_HINT, UPRIGHT, oriented

# -- Pixel formats ---------------------------------------------------------------------------------

ChromaSubsampling = Literal["420", "422", "444"]
DEPTHS = (8, 10, 12, 16)
CHROMA_444_CODECS = ("ffv1", "prores_ks", "utvideo", "ffvhuff")
"""Professional and archive codecs, whose players support 4:4:4 for RGB images."""
CODECS_WITHOUT_ALPHA = ("libx265", "libvpx-vp9")
"""Codecs with nominal transparency that requires additional streams or lacks support in players."""


@dataclass(frozen=True)
class PixelFormat:
    """Properties of a pixel format of luma and chroma.

    >>> PixelFormat.of("yuva444p10le")
    PixelFormat(colours='444', bits=10, alpha=True)
    >>> [PixelFormat.of(name).name for name in ("rgb48be", "nv12", "yuv411p")]
    ['yuv444p16le', 'yuv420p', 'yuv422p']
    """

    colours: ChromaSubsampling = "420"
    """Chroma subsampling: per 2 x 2 pixels, per 2 x 1, or per pixel."""
    bits: int = 8
    alpha: bool = False

    @classmethod
    def of(cls, pixel_format: str) -> PixelFormat:
        """Return the properties of an FFmpeg pixel format; grey counts as the lowest subsampling.

        Raises
        ------
        ValueError
            If there is no such format.
        """
        coded = av.VideoFormat(pixel_format, 64, 64)
        parts = coded.components
        is_packed_colour = coded.is_rgb or coded.has_palette
        shared = parts[1] if len(parts) > 2 and not is_packed_colour else None
        colours: ChromaSubsampling = "444" if is_packed_colour else "420"
        if shared is not None and shared.height == coded.height:
            colours = "444" if shared.width == coded.width else "422"
        elif shared is not None and shared.width == coded.width:
            colours = "444"
        alpha = any(part.is_alpha for part in parts) or coded.has_palette
        bits = max(part.bits for part in parts)
        unsupported = (12,) if alpha and colours == "420" else ()  # FFmpeg has no such format
        depths = [depth for depth in DEPTHS if depth >= bits and depth not in unsupported]
        return cls(colours, depths[0] if depths else DEPTHS[-1], alpha)

    @property
    def name(self) -> str:
        """Planar format with these properties."""
        return f"yuv{'a' if self.alpha else ''}{self.colours}p{'' if self.bits == 8 else f'{self.bits}le'}"

    @property
    def even(self) -> tuple[bool, bool]:
        """True if the format requires an even width and an even height."""
        return self.colours != "444", self.colours == "420"


def nearest_format(requested: PixelFormat, supported: Sequence[str]) -> str:
    """Return the supported format with the smallest loss, and among these with the smallest excess.

    >>> nearest_format(PixelFormat("422", 10), ["yuv420p", "yuv444p", "yuv422p10le", "yuv444p12le"])
    'yuv422p10le'
    >>> nearest_format(PixelFormat("444", 12, True), ["yuv420p", "yuv444p10le"])
    'yuv444p10le'
    """

    def costs(name: str) -> tuple[int, ...]:
        kind = PixelFormat.of(name)
        colour = int(kind.colours) - int(requested.colours)
        bits = kind.bits - requested.bits
        is_lost = (requested.alpha > kind.alpha, max(0, -colour), max(0, -bits))
        is_added = (
            max(0, colour),
            max(0, bits),
            kind.alpha > requested.alpha,
            name.startswith("yuvj"),
        )
        return (*map(int, is_lost), *map(int, is_added))

    planar = [
        name
        for name in supported
        if name.startswith("yuv") and PixelFormat.of(name).name in (name, name.replace("j", ""))
    ]
    return min(planar, key=costs, default=supported[0] if supported else PixelFormat().name)


def conversion_losses(of: str, to: PixelFormat) -> str:
    """Describe the losses of a pixel format conversion; empty if there are none.

    >>> conversion_losses("yuva444p12le", PixelFormat("420", 8))
    '12 bits are reduced to 8, chroma is reduced from 4:4:4 to 4:2:0, transparency is lost'
    >>> conversion_losses("yuv420p", PixelFormat("422", 10)), conversion_losses("rgb24", PixelFormat())
    ('', 'chroma is reduced from RGB to 4:2:0')
    """
    source, losses = PixelFormat.of(of), []
    coded = av.VideoFormat(of, 64, 64)
    bits = max(part.bits for part in coded.components)
    if bits > to.bits:
        losses.append(f"{bits} bits are reduced to {to.bits}")
    if source.colours > to.colours:
        full = "RGB" if coded.is_rgb or coded.has_palette else ":".join(source.colours)
        losses.append(f"chroma is reduced from {full} to {':'.join(to.colours)}")
    if any(part.is_alpha for part in coded.components) and not to.alpha:
        losses.append("transparency is lost")
    return ", ".join(losses)


# -- Frames and arrays -----------------------------------------------------------------------------
#
# A frame is a PyAV frame: it owns its memory, and has a time (``pts`` in units of ``time_base``,
# ``time`` in seconds) and a colour coding. Conversions use this coding and copy it to their results.

Image = NDArray[Any]
Planes = tuple[NDArray[Any], ...]
"""Planes (y, u, v), or (y, uv) of NV12: (h, w), then (h/2, w/2), or (h/2, w/2, 2), halves rounded
up; uint8. Other frames have chroma (h, w/2) in 4:2:2 and (h, w) in 4:4:4, a fourth plane (h, w) for
transparency, and uint16.
"""

PLANAR_FORMATS = ("yuv420p", "yuvj420p", "nv12")
"""Pixel formats with direct access to planes; the second is the first in full range."""
PACKED_FORMATS = {1: "gray", 3: "rgb24", 4: "rgba"}
FULL_RANGE = 2
ChromaSiting = Literal["left", "center", "right", "top", "bottom"]
"""Position of chroma samples; the last three occur in frames that were turned or mirrored."""
CENTRE_SITED_CODECS = ("mjpeg", "mpeg1video", "h263", "flv1")
"""Codecs with chroma samples at the centre of 2 x 2 pixels, instead of at the left."""

_thread_cache = threading.local()


@dataclass(frozen=True)
class ColourCoding:
    """Colour coding with the numbers of FFmpeg (ITU-T H.273); unspecified by default.

    >>> ColourCoding(range=2).is_full_range
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
    def of(cls, coded: Any) -> ColourCoding:
        """Return the colour coding of a frame, or of a codec context."""
        return cls(
            int(coded.color_range),
            int(coded.colorspace),
            int(coded.color_primaries),
            int(coded.color_trc),
        )

    @classmethod
    def of_video(cls, frame: av.VideoFrame) -> ColourCoding:
        """Return the colour coding of a video with such frames; RGB becomes BT.709."""
        return RGB_CODING if frame.format.is_rgb or frame.format.has_palette else cls.of(frame)

    def apply_to(self, coded: Any) -> None:
        """Set the colour coding of a frame, or of a codec context."""
        coded.color_range = self.range
        coded.colorspace = self.space
        coded.color_primaries = self.primaries
        coded.color_trc = self.transfer


RGB_CODING = ColourCoding(range=1, space=1, primaries=1, transfer=13)
"""Coding of RGB images as luma and chroma: BT.709, with the sRGB transfer function."""


def planes(frame: av.VideoFrame) -> Planes:
    """Return the planes of a frame in planar YUV or NV12, without copying or converting.

    Rows may be padded, as described by the strides of the views. The views keep the memory of the
    frame alive.

    Raises
    ------
    MediaError
        If the frame has another pixel format; convert it first by :func:`planar` or
        :func:`workable`.

    Examples
    --------
    >>> frame, (y, u, v) = empty_frame((63, 47))
    >>> y[:] = 128
    >>> [plane.shape for plane in planes(frame)], planes(frame)[0][0, 62]
    ([(47, 63), (24, 32), (24, 32)], np.uint8(128))
    """
    if not has_planes(frame):
        raise MediaError(
            f"the pixel format must be nv12 or planar YUV to access planes; got {frame.format.name}"
        )
    kind = np.dtype(np.uint8 if PixelFormat.of(frame.format.name).bits == 8 else "<u2")
    views: list[NDArray[Any]] = []
    for plane in frame.planes:
        step = abs(plane.line_size) // kind.itemsize
        rows = np.frombuffer(plane, kind)[: step * plane.height].reshape(plane.height, step)  # type: ignore[call-overload]  # a plane is a buffer
        if plane.line_size < 0:  # stored bottom-up
            rows = rows[::-1]
        is_pairs = len(frame.planes) == 2 and bool(views)
        views.append(
            rows[:, : 2 * plane.width].reshape(plane.height, -1, 2)
            if is_pairs
            else rows[:, : plane.width]
        )
    return tuple(views)


def siting_of(codec: str) -> ChromaSiting:
    """Return the chroma siting of a codec, unless specified by a stream (not available in PyAV).

    >>> siting_of("h264"), siting_of("mjpeg")
    ('left', 'center')
    """
    return "center" if codec in CENTRE_SITED_CODECS else "left"


def is_full_range(frame: av.VideoFrame) -> bool:
    """Return whether luma has full range, 0 to 255."""
    return bool(frame.color_range == FULL_RANGE) or frame.format.name.startswith("yuvj")


def converted(frame: av.VideoFrame, pixel_format: str, **colours: int) -> av.VideoFrame:
    """Convert a frame to another pixel format, with its time and colour coding.

    The setup of a conversion in FFmpeg takes longer than the conversion; it is cached per thread
    for the next frame.
    """
    reformatters: dict[Any, VideoReformatter] = _thread_cache.__dict__.setdefault(
        "reformatters", {}
    )
    kind = (frame.width, frame.height, frame.format.name, pixel_format)
    if kind not in reformatters:
        reformatters[kind] = VideoReformatter()
    return reformatters[kind].reformat(frame, format=pixel_format, **colours)


def planar(frame: av.VideoFrame) -> av.VideoFrame:
    """Return the frame itself if its planes are accessible, otherwise converted to yuv420p."""
    return frame if frame.format.name in PLANAR_FORMATS else converted(frame, "yuv420p")


def has_planes(frame: av.VideoFrame) -> bool:
    """Return whether :func:`planes` supports the frame."""
    name = frame.format.name
    return name in PLANAR_FORMATS or PixelFormat.of(name).name == name.replace("yuvj", "yuv")


def workable(frame: av.VideoFrame) -> av.VideoFrame:
    """Return the frame itself if its planes are accessible, otherwise converted losslessly to a
    planar format.
    """
    if has_planes(frame):
        return frame
    if frame.format.is_rgb or frame.format.has_palette:
        RGB_CODING.apply_to(frame)
    return converted(frame, PixelFormat.of(frame.format.name).name)


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
        _copy_time(like, frame)
        ColourCoding.of(like).apply_to(frame)
    return frame, planes(frame)


def frame_of_planes(parts: Planes, like: av.VideoFrame | None = None) -> av.VideoFrame:
    """Create a frame from copies of planes as from :func:`planes`, with time and colour coding of
    ``like``.

    Raises
    ------
    MediaError
        If the shapes do not form a 4:2:0 image.
    """
    height, width = parts[0].shape[:2]
    frame, into = empty_frame((width, height), "nv12" if len(parts) == 2 else "yuv420p", like)
    if [part.shape for part in parts] != [plane.shape for plane in into]:
        shapes = ", ".join(str(part.shape) for part in parts)
        raise MediaError(
            f"planes must have the shapes of a 4:2:0 image of {width} x {height} px; got {shapes}"
        )
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
        If the array is not such an image.
    """
    channels = image.shape[2] if image.ndim == 3 else 1
    if (
        image.ndim not in (2, 3)
        or channels not in PACKED_FORMATS
        or image.dtype != np.uint8
        or 0 in image.shape
    ):
        raise MediaError(
            f"image must be uint8 of shape (h, w), (h, w, 3) or (h, w, 4); got {image.dtype} of shape {image.shape}"
        )
    if channels == 1:
        image = image.reshape(image.shape[:2])
    frame = av.VideoFrame.from_numpy_buffer(
        np.ascontiguousarray(image), format=PACKED_FORMATS[channels]
    )
    if like is not None:
        _copy_time(like, frame)
        frame.colorspace, frame.color_range = like.colorspace, like.color_range
    return frame


def coded_colour(colour: tuple[float, ...], like: av.VideoFrame) -> tuple[int, int, int]:
    """Convert a colour (red, green, blue) of 8 bits to y, u and v in the colour coding of a frame.

    The values have the bit depth of the frame.

    >>> coded_colour((0, 0, 0), empty_frame((64, 48))[0])
    (16, 128, 128)
    """
    scale = 1 << (PixelFormat.of(like.format.name).bits - 8)
    like = planar(like)
    frame = frame_of_image(np.full((2, 2, 3), colour, np.uint8), like)
    frame.color_range = FULL_RANGE if is_full_range(like) else 1
    y, u, v = (scale * int(plane[0, 0]) for plane in planes(converted(frame, "yuv420p")))
    return y, u, v


def as_frame(result: av.VideoFrame | Image | Planes, like: av.VideoFrame) -> av.VideoFrame:
    """Convert the result of an image function (frame, image or planes) to a frame."""
    if isinstance(result, av.VideoFrame):
        if result.pts is None:
            _copy_time(like, result)
        return result
    if isinstance(result, tuple):
        return frame_of_planes(result, like)
    return frame_of_image(result, like)


def _copy_time(like: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the time of one frame to another."""
    frame.pts = like.pts
    if like.time_base is not None:
        frame.time_base = like.time_base
    frame.duration = like.duration


# -- Orientation of a video (display matrix) ---------------------------------------------------------

ORIENTATION_OF_AXES = {
    ((1, 0), (0, 1)): 1,
    ((-1, 0), (0, 1)): 2,
    ((-1, 0), (0, -1)): 3,
    ((1, 0), (0, -1)): 4,
    ((0, 1), (1, 0)): 5,
    ((0, 1), (-1, 0)): 6,
    ((0, -1), (-1, 0)): 7,
    ((0, -1), (1, 0)): 8,
}
"""Orientation as in EXIF, by the directions (right, down) on the display of the stored rows and
columns.
"""
SITING_AFTER_ORIENTATION: dict[int, ChromaSiting] = {
    2: "right",
    3: "right",
    5: "top",
    6: "top",
    7: "bottom",
    8: "bottom",
}
"""Position of chroma samples after an orientation of left-sited frames, by orientation."""


def frame_orientation(frame: av.VideoFrame) -> int | None:
    """Return the orientation of a frame as in EXIF, 1 to 8; None for a rotation by no multiple of
    90 deg.
    """
    side_data: Any = frame.side_data
    matrix = side_data.get(SideData.DISPLAYMATRIX)
    if matrix is None:
        return UPRIGHT
    values = np.array(struct.unpack("=9i", bytes(matrix)[:36])).reshape(3, 3)[:2, :2] / 65536.0
    signs = np.where(np.abs(values) > 0.02 * np.abs(values).max(), np.sign(values), 0).astype(int)
    (a, b), (c, d) = signs.tolist()
    return ORIENTATION_OF_AXES.get(((a, b), (c, d)))


def orientation_note(name: str, orientation: int | None, is_stored: bool) -> str | None:
    """Return a sentence that reports the orientation in a video file or stream; None if there is
    nothing to report.

    >>> orientation_note("ride.mp4", 3, is_stored=True)
    'ride.mp4: frames as stored; the display orientation is: rotated by 180 deg'
    """
    if orientation is None:
        return f"{name}: the rotation in the file is not a multiple of 90 deg and is not applied"
    if orientation == UPRIGHT:
        return None
    if is_stored:
        return f"{name}: frames as stored; the display orientation is: {ORIENTATION_NAMES[orientation]}"
    return (
        f"{name}: {ORIENTATION_NAMES[orientation]} according to the file; {STORED_ORIENTATION_HINT}"
    )


def upright(frame: av.VideoFrame, orientation: int) -> av.VideoFrame:
    """Return a frame with an orientation applied; time and colour coding are kept.

    Chroma that is subsampled in one direction only, or of frames with an odd number of rows or
    columns, is interpolated to full resolution first.
    """
    if orientation == UPRIGHT:
        return frame
    frame = workable(frame)
    kind = PixelFormat.of(frame.format.name)
    if kind.colours == "422" or (kind.colours == "420" and (frame.width % 2 or frame.height % 2)):
        frame = converted(frame, replace(kind, colours="444").name)
    parts = [oriented(part, orientation) for part in planes(frame)]
    height, width = parts[0].shape[:2]
    output, targets = empty_frame((width, height), frame.format.name, like=frame)
    if is_full_range(frame):
        output.color_range = FULL_RANGE
    for part, target in zip(parts, targets, strict=True):
        target[:] = part
    return output


# -- Deinterlacing -----------------------------------------------------------------------------------


class Deinterlacer:
    """Deinterlacer of interlaced frames with FFmpeg's bwdif; other frames pass unchanged.

    Each image has the time of its first field; missing rows are estimated from the frames before
    and after, which delays the output by one frame.
    """

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._kind: tuple[int, int, str] | None = None

    def __call__(self, frame: av.VideoFrame) -> list[av.VideoFrame]:
        """Return the images that are complete after this frame."""
        if self._graph is None and not frame.interlaced_frame:
            return [frame]
        ready: list[av.VideoFrame] = []
        kind = (frame.width, frame.height, frame.format.name)
        if self._graph is None or kind != self._kind:
            ready, self._graph, self._kind = self.flush(), _graph(frame), kind
        self._graph.push(frame)
        return ready + _finished_frames(self._graph)

    def flush(self) -> list[av.VideoFrame]:
        """Return the delayed image."""
        graph, self._graph = self._graph, None
        if graph is None:
            return []
        graph.push(None)
        return _finished_frames(graph)


def _graph(frame: av.VideoFrame) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=frame.time_base or Fraction(1, av.time_base),
    )
    bwdif = graph.add("bwdif", "mode=send_frame:deint=interlaced")
    sink = graph.add("buffersink")
    source.link_to(bwdif)
    bwdif.link_to(sink)
    graph.configure()
    return graph


def _finished_frames(graph: Graph) -> list[av.VideoFrame]:
    ready: list[av.VideoFrame] = []
    while True:
        try:
            frame = graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return ready
        assert isinstance(frame, av.VideoFrame)
        ready.append(frame)
