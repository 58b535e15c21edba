"""Frames of a view as what goes over the network: JPEG pictures, and H.264 in an MPEG transport stream."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import av

from ...media.live.sources import TICKS
from ...media.video.encoder import Encoder
from ...media.video.frames import FULL_RANGE, Colour, converted

JPEG_SCALE = 4
"""Of the quantisation, as FFmpeg's ``-q:v``; about quality 90."""
KEY_FRAME_EVERY_S = 1.0  # players begin at one, and segments of HLS are cut there
H264 = {"preset": "veryfast", "tune": "zerolatency", "threads": "1", "forced-idr": "1", "g": "1000000"}
"""Nothing is held back; views share the cores, not the frames of a view; key frames come when they are asked for."""
BT601 = 5  # as swscale counts
TRANSPORT = {"flush_packets": "1", "mpegts_flags": "pat_pmt_at_frames"}


class JpegCoder:
    """Frames as JPEG pictures, without a detour by red, green and blue."""

    def __init__(self) -> None:
        self._context: av.VideoCodecContext | None = None

    def __call__(self, frame: av.VideoFrame) -> bytes:
        """The bytes of a picture; the frame's colour samples must lie in the middle of their pixels."""
        frame = _of_jpeg(frame)
        if self._context is None:
            context = av.CodecContext.create("mjpeg", "w")
            assert isinstance(context, av.VideoCodecContext)
            context.width, context.height, context.pix_fmt = frame.width, frame.height, "yuvj420p"
            context.time_base, context.thread_count = TICKS, 1
            context.qmin = context.qmax = JPEG_SCALE
            self._context = context
        frame.pict_type = av.video.frame.PictureType.NONE
        return b"".join(bytes(packet) for packet in self._context.encode(frame))


def _of_jpeg(frame: av.VideoFrame) -> av.VideoFrame:
    """As JPEG codes them: luma from 0 to 255, colours by the matrix of BT.601, 4:2:0."""
    return converted(frame, "yuvj420p", dst_color_range=FULL_RANGE, dst_colorspace=BT601)


class Chunk(NamedTuple):
    """A frame in a transport stream."""

    data: bytes
    is_key: bool
    """Whether players can begin with it."""
    time_s: float


class TransportCoder:
    """Frames as H.264 in an MPEG transport stream, a chunk for each."""

    def __init__(self, size: tuple[int, int], frame_rate: Fraction | float) -> None:
        self._size, self._rate = size, frame_rate
        self._buffer = _Buffer()
        self._encoder: Encoder | None = None
        self._latest_key_s = float("-inf")

    def __call__(self, frame: av.VideoFrame, is_key: bool = False) -> Chunk:
        """The chunk of a frame; a key frame where one is asked for, and every second."""
        time_s = float(frame.pts * TICKS) if frame.pts is not None else 0.0
        is_key = is_key or time_s - self._latest_key_s >= KEY_FRAME_EVERY_S
        if is_key:
            self._latest_key_s = time_s
        if self._encoder is None:
            self._encoder = Encoder(
                self._buffer, self._size, self._rate, TICKS, options=H264, colour=Colour.told_by(frame),
                container_format="mpegts", container_options=TRANSPORT, is_live=True,
            )  # fmt: skip
        self._encoder.encode(frame, is_key)
        return Chunk(self._buffer.taken(), is_key, time_s)

    def close(self) -> None:
        """Let the encoder go."""
        if self._encoder is not None:
            self._encoder.discard()


class _Buffer:
    """Where the muxer writes to."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes, /) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def taken(self) -> bytes:
        """All since the last time."""
        data = b"".join(self._parts)
        self._parts.clear()
        return data
