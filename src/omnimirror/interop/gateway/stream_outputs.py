"""Encoded outputs of a live view: JPEG images, raw frames, and H.264 in an MPEG transport stream.

Each frame is encoded once for all clients and not at all without clients. Frames arrive from
worker threads and clients wait in the event loop; results cross over by ``call_soon_threadsafe``.
Slow clients skip frames and do not delay others.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

import av

from ...io.live_sources import TICKS
from ...io.video_encoder import Encoder
from ...io.video_frames import FULL_RANGE, ColourCoding, converted

Item = TypeVar("Item")

JPEG_QUANTISER = 4
"""Quantiser scale of FFmpeg (``-q:v``), about quality 90."""
KEY_FRAME_INTERVAL_S = 1.0
"""Interval of key frames, at which players start and HLS segments are cut."""
H264_OPTIONS = {
    "preset": "veryfast",
    "tune": "zerolatency",
    "threads": "1",
    "forced-idr": "1",
    "g": "1000000",
}
"""No delay and no automatic key frames; views are encoded in parallel, one thread each."""
MPEGTS_OPTIONS = {"flush_packets": "1", "mpegts_flags": "pat_pmt_at_frames"}
BT601 = 5
"""Colour matrix of JPEG in the numbering of swscale."""
MAX_QUEUED_CHUNKS = 50
"""Chunks queued for a client; a slower client continues with the next key frame."""
HLS_SEGMENTS = 5
HLS_TIMEOUT_S = 10.0
"""Time without a request after which an HLS client is considered disconnected."""

# -- encoders ------------------------------------------------------------------------------------


class JpegEncoder:
    """JPEG encoder for YUV frames, without conversion to RGB."""

    def __init__(self) -> None:
        self._context: av.VideoCodecContext | None = None

    def __call__(self, frame: av.VideoFrame) -> bytes:
        """Encode a frame whose chroma samples are centred between luma samples."""
        # JPEG: full-range luma, BT.601 matrix, 4:2:0.
        frame = converted(frame, "yuvj420p", dst_color_range=FULL_RANGE, dst_colorspace=BT601)
        if self._context is None:
            context = av.CodecContext.create("mjpeg", "w")
            assert isinstance(context, av.VideoCodecContext)
            context.width, context.height = frame.width, frame.height
            context.pix_fmt = "yuvj420p"
            context.time_base, context.thread_count = TICKS, 1
            context.qmin = context.qmax = JPEG_QUANTISER
            self._context = context
        frame.pict_type = av.video.frame.PictureType.NONE
        return b"".join(bytes(packet) for packet in self._context.encode(frame))


class Chunk(NamedTuple):
    """One frame of a transport stream."""

    data: bytes
    is_key: bool
    time_s: float


class TransportEncoder:
    """Encoder of frames as H.264 in an MPEG transport stream, one chunk per frame."""

    def __init__(self, size: tuple[int, int], frame_rate: Fraction | float) -> None:
        self._size, self._rate = size, frame_rate
        self._buffer = _Buffer()
        self._encoder: Encoder | None = None
        self._last_key_s = float("-inf")

    def __call__(self, frame: av.VideoFrame, is_key: bool = False) -> Chunk:
        """Encode a frame; key frames on request and every second."""
        time_s = float(frame.pts * TICKS) if frame.pts is not None else 0.0
        is_key = is_key or time_s - self._last_key_s >= KEY_FRAME_INTERVAL_S
        if is_key:
            self._last_key_s = time_s
        if self._encoder is None:
            self._encoder = Encoder(
                self._buffer,
                self._size,
                self._rate,
                TICKS,
                options=H264_OPTIONS,
                colour=ColourCoding.of_video(frame),
                container_format="mpegts",
                container_options=MPEGTS_OPTIONS,
                is_live=True,
            )
        self._encoder.encode(frame, is_key)
        return Chunk(self._buffer.drain(), is_key, time_s)

    def close(self) -> None:
        """Release the encoder."""
        if self._encoder is not None:
            self._encoder.discard()


class _Buffer:
    """File-like output of the muxer."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes, /) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def drain(self) -> bytes:
        """Return and clear the buffered bytes."""
        data = b"".join(self._parts)
        self._parts.clear()
        return data


# -- outputs -------------------------------------------------------------------------------------


class StreamOutput:
    """Base class of the outputs of a view.

    Parameters
    ----------
    wake
        Called when a client connects.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self.clients = 0
        self.frame_rate: Fraction | float = 25
        """Frame rate of the source, if known."""
        self._wake = wake
        self._loop: asyncio.AbstractEventLoop | None = None
        self._update = asyncio.Event()

    @property
    def is_active(self) -> bool:
        """True if frames are needed."""
        return self.clients > 0

    @contextmanager
    def connected(self) -> Iterator[None]:
        """Count a client within the block."""
        self._loop = asyncio.get_running_loop()
        self.clients += 1
        self._wake()
        try:
            yield
        finally:
            self.clients -= 1

    def take(self, frame: av.VideoFrame) -> None:
        """Encode a frame in a worker thread and publish the result."""
        raise NotImplementedError

    def release(self) -> None:
        """Release the encoder after a period without clients."""

    def _publish_threadsafe(self, publish: Callable[..., None], *values: object) -> None:
        """Call a method in the event loop and wake all waiting clients."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._publish_and_notify, publish, *values)

    def _publish_and_notify(self, publish: Callable[..., None], *values: object) -> None:
        publish(*values)
        self._update.set()  # wakes current waiters; later ones wait for the new event
        self._update = asyncio.Event()


class LatestOutput(StreamOutput, Generic[Item]):
    """Output that delivers the latest encoded frame to each client."""

    def __init__(self, wake: Callable[[], None], encode: Callable[[av.VideoFrame], Item]) -> None:
        super().__init__(wake)
        self._encode = encode
        self._latest: Item | None = None
        self._count = 0

    def take(self, frame: av.VideoFrame) -> None:
        """Encode a frame and publish it."""
        self._publish_threadsafe(self._publish, self._encode(frame))

    def _publish(self, item: Item) -> None:
        self._latest, self._count = item, self._count + 1

    async def items(self) -> AsyncGenerator[Item, None]:
        """Yield new items; items published while the client is busy are skipped."""
        with self.connected():
            count = self._count
            while True:
                while self._count == count or self._latest is None:
                    await self._update.wait()
                count = self._count
                yield self._latest


class Segment(NamedTuple):
    """HLS segment from one key frame to the next."""

    number: int
    data: bytes
    duration_s: float


class _StreamClient:
    """Queue of one client of a transport stream."""

    def __init__(self) -> None:
        self.queue: asyncio.Queue[bytes] = asyncio.Queue()
        self._started = False

    def put(self, chunk: Chunk) -> bool:
        """Queue a chunk from the first key frame on; return False while waiting for one.

        A full queue is cleared, and the client continues with the next key frame.
        """
        if self.queue.qsize() >= MAX_QUEUED_CHUNKS:
            while not self.queue.empty():
                self.queue.get_nowait()
            self._started = False
        self._started |= chunk.is_key
        if self._started:
            self.queue.put_nowait(chunk.data)
        return self._started


class TransportOutput(StreamOutput):
    """Transport stream, continuous and as HLS segments."""

    def __init__(self, size: tuple[int, int], wake: Callable[[], None]) -> None:
        super().__init__(wake)
        self.size = size
        self.segments: deque[Segment] = deque(maxlen=HLS_SEGMENTS)
        self._encode: TransportEncoder | None = None
        self._open_segment: list[Chunk] = []
        self._stream_clients: list[_StreamClient] = []
        self._next_number, self._hls_until = 0, float("-inf")
        self._key_requested = False

    @property
    def is_active(self) -> bool:
        """True if clients are connected or have requested a playlist recently."""
        if self.clients > 0:
            return True
        return self._loop is not None and self._loop.time() < self._hls_until

    def take(self, frame: av.VideoFrame) -> None:
        """Encode a frame, as a key frame for a new client, and publish it."""
        if self._encode is None:
            self._encode = TransportEncoder(self.size, self.frame_rate)
        is_key, self._key_requested = self._key_requested, False
        self._publish_threadsafe(self._publish, self._encode(frame, is_key))

    def release(self) -> None:
        """Release the encoder and discard the segments."""
        if self._encode is not None:
            self._encode.close()
            self._encode = None
        self._open_segment.clear()
        self.segments.clear()

    def _publish(self, chunk: Chunk) -> None:
        if chunk.is_key and self._open_segment:
            duration_s = chunk.time_s - self._open_segment[0].time_s
            data = b"".join(c.data for c in self._open_segment)
            self.segments.append(Segment(self._next_number, data, duration_s))
            self._next_number += 1
            self._open_segment.clear()
        if chunk.is_key or self._open_segment:
            self._open_segment.append(chunk)
        for client in self._stream_clients:
            self._key_requested |= not client.put(chunk)

    async def chunks(self) -> AsyncGenerator[bytes, None]:
        """Yield the stream from the next key frame, which is requested immediately."""
        client = _StreamClient()
        with self.connected():
            self._stream_clients.append(client)
            self._key_requested = True
            try:
                while True:
                    yield await client.queue.get()
            finally:
                self._stream_clients.remove(client)

    async def playlist(self, folder: str, query: str) -> str:
        """Return the HLS playlist once there is a segment.

        Parameters
        ----------
        folder
            URL path of the segments.
        query
            Query string appended to each segment URL.
        """
        self._keep_active()
        while not self.segments:
            await self._update.wait()
            self._keep_active()
        longest_s = max(segment.duration_s for segment in self.segments)
        lines = [
            "#EXTM3U",
            "#EXT-X-VERSION:3",
            f"#EXT-X-TARGETDURATION:{round(longest_s + 0.5)}",
            f"#EXT-X-MEDIA-SEQUENCE:{self.segments[0].number}",
        ]
        for segment in self.segments:
            lines.append(f"#EXTINF:{segment.duration_s:.3f},")
            lines.append(f"{folder}/{segment.number}.ts{query}")
        return "\n".join([*lines, ""])

    def segment(self, number: int) -> bytes:
        """Return a segment of the playlist.

        Raises
        ------
        KeyError
            If the segment is not available.
        """
        self._keep_active()
        for segment in self.segments:
            if segment.number == number:
                return segment.data
        raise KeyError(number)

    def _keep_active(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._hls_until = self._loop.time() + HLS_TIMEOUT_S
        self._wake()
