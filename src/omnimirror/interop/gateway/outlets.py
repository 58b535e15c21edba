"""Where frames of a view leave: each coded once for all who watch, and by nobody where nobody does.

Frames come from threads that work, watchers wait in the event loop; news goes from one to the other by
``call_soon_threadsafe``. A watcher that is slow misses frames and holds up nobody.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

import av

from .coders import Chunk, TransportCoder

Item = TypeVar("Item")

BEHIND = 50
"""Chunks that wait for a watcher of a transport stream; with more of them it goes on with the next key frame."""
SEGMENTS = 5
"""Of HLS, that are kept."""
HLS_LINGER_S = 10.0
"""For so long after a playlist or a segment was asked for someone is taken to watch."""


class Outlet:
    """One way out of a view.

    Parameters
    ----------
    wake
        Called when somebody begins to watch.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self.watchers = 0
        self.frame_rate: Fraction | float = 25
        """Of what it is given, as far as the source tells."""
        self._wake = wake
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news = asyncio.Event()

    @property
    def is_wanted(self) -> bool:
        """Whether anyone watches."""
        return self.watchers > 0

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Within the block somebody watches."""
        self._loop = asyncio.get_running_loop()
        self.watchers += 1
        self._wake()
        try:
            yield
        finally:
            self.watchers -= 1

    def take(self, frame: av.VideoFrame) -> None:
        """Code a frame and pass it on, in a thread that works."""
        raise NotImplementedError

    def rest(self) -> None:
        """Let go of what coding needs: nobody has watched for a while."""

    def _tell(self, publish: Callable[..., None], *news: object) -> None:
        """Call a method in the event loop, and wake all who wait."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._published, publish, *news)

    def _published(self, publish: Callable[..., None], *news: object) -> None:
        publish(*news)
        self._news.set()  # wakes all that wait, and none that come later
        self._news = asyncio.Event()


class NewestOutlet(Outlet, Generic[Item]):
    """One thing after the other: to each watcher the newest."""

    def __init__(self, wake: Callable[[], None], code: Callable[[av.VideoFrame], Item]) -> None:
        super().__init__(wake)
        self._code = code
        self._newest: Item | None = None
        self._count = 0

    def take(self, frame: av.VideoFrame) -> None:
        """Code a frame."""
        self._tell(self._publish, self._code(frame))

    def _publish(self, item: Item) -> None:
        self._newest, self._count = item, self._count + 1

    async def items(self) -> AsyncGenerator[Item, None]:
        """Each that is made from now on, and that one comes to take."""
        with self.watched():
            seen = self._count
            while True:
                while self._count == seen or self._newest is None:
                    await self._news.wait()
                seen = self._count
                yield self._newest


class Segment(NamedTuple):
    """A piece of HLS, from one key frame to the next."""

    number: int
    data: bytes
    duration_s: float


class _Reader:
    """A watcher of a transport stream."""

    def __init__(self) -> None:
        self.waiting: asyncio.Queue[bytes] = asyncio.Queue()
        self._is_begun = False

    def put(self, chunk: Chunk) -> bool:
        """Hand over a chunk, once there was a key frame; False where so many wait that it has to begin again."""
        if self.waiting.qsize() >= BEHIND:
            while not self.waiting.empty():
                self.waiting.get_nowait()
            self._is_begun = False
        self._is_begun |= chunk.is_key
        if self._is_begun:
            self.waiting.put_nowait(chunk.data)
        return self._is_begun


class TransportOutlet(Outlet):
    """A transport stream, and the same cut into segments for HLS."""

    def __init__(self, size: tuple[int, int], wake: Callable[[], None]) -> None:
        super().__init__(wake)
        self.size = size
        self.segments: deque[Segment] = deque(maxlen=SEGMENTS)
        self._code: TransportCoder | None = None
        self._begin: list[Chunk] = []
        self._readers: list[_Reader] = []
        self._next_number, self._hls_until = 0, float("-inf")
        self._key_is_asked = False

    @property
    def is_wanted(self) -> bool:
        """Whether anyone watches, or asked for a playlist of late."""
        return self.watchers > 0 or (self._loop is not None and self._loop.time() < self._hls_until)

    def take(self, frame: av.VideoFrame) -> None:
        """Code a frame, a key frame where somebody has just come."""
        if self._code is None:
            self._code = TransportCoder(self.size, self.frame_rate)
        is_key, self._key_is_asked = self._key_is_asked, False
        self._tell(self._publish, self._code(frame, is_key))

    def rest(self) -> None:
        """Let go of the encoder; segments of before are forgotten."""
        if self._code is not None:
            self._code.close()
            self._code = None
        self._begin.clear()
        self.segments.clear()

    def _publish(self, chunk: Chunk) -> None:
        if chunk.is_key and self._begin:
            lasted = chunk.time_s - self._begin[0].time_s
            self.segments.append(Segment(self._next_number, b"".join(c.data for c in self._begin), lasted))
            self._next_number += 1
            self._begin.clear()
        if chunk.is_key or self._begin:
            self._begin.append(chunk)
        for reader in self._readers:
            self._key_is_asked |= not reader.put(chunk)

    async def chunks(self) -> AsyncGenerator[bytes, None]:
        """The stream from the next key frame on, which comes at once; what was missed is left out up to another."""
        reader = _Reader()
        with self.watched():
            self._readers.append(reader)
            self._key_is_asked = True
            try:
                while True:
                    yield await reader.waiting.get()
            finally:
                self._readers.remove(reader)

    async def playlist(self, folder: str, query: str) -> str:
        """The playlist of HLS, once there is a segment; they stand in a folder, each with a query behind it."""
        self._touch()
        while not self.segments:
            await self._news.wait()
            self._touch()
        longest = max(segment.duration_s for segment in self.segments)
        lines = [
            "#EXTM3U", "#EXT-X-VERSION:3", f"#EXT-X-TARGETDURATION:{round(longest + 0.5)}",
            f"#EXT-X-MEDIA-SEQUENCE:{self.segments[0].number}",
        ]  # fmt: skip
        for segment in self.segments:
            lines += [f"#EXTINF:{segment.duration_s:.3f},", f"{folder}/{segment.number}.ts{query}"]
        return "\n".join([*lines, ""])

    def segment(self, number: int) -> bytes:
        """A segment of the playlist.

        Raises
        ------
        KeyError
            It is there no more, or not yet.
        """
        self._touch()
        for segment in self.segments:
            if segment.number == number:
                return segment.data
        raise KeyError(number)

    def _touch(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._hls_until = self._loop.time() + HLS_LINGER_S
        self._wake()
