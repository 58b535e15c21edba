"""Continuous playback: a camera or stream with reconnection, or a file in real time, repeated."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from fractions import Fraction

import av

from ..video.frames import Siting
from ..video.reader import VideoReader
from .sources import LiveSource


class Playing:
    """Endless frames of a source; read in one thread, stopped from any thread.

    Parameters
    ----------
    place
        Address, camera, or name of a file.
    is_live
        Whether the source is a camera or a stream.
    report
        Called with a sentence when a stream is lost and when it is restored.
    opening_s : s
        Timeout for the first frame of a stream; a stream that has played is waited for without
        limit.
    """

    def __init__(
        self, place: str, is_live: bool, report: Callable[[str], None], opening_s: float = float("inf")
    ) -> None:
        self.place, self.is_live = place, is_live
        self.siting: Siting = "left"
        """Position of chroma samples in the frames; known after the first one."""
        self.frame_rate: Fraction | None = None
        """Frames per second, if the source contains it; known after the first frame."""
        self._report, self._opening_s = report, opening_s
        self._stopping = threading.Event()

    def stop(self) -> None:
        """Stop the source."""
        self._stopping.set()

    def frames(self) -> Iterator[av.VideoFrame]:
        """Yield each frame at its presentation time.

        Raises
        ------
        MediaError
            The source does not exist, or yields no frame.
        """
        return self._live() if self.is_live else self._file()

    def _live(self) -> Iterator[av.VideoFrame]:
        endless = float("inf")
        with LiveSource(self.place, patience_s=endless, opening_s=self._opening_s, report=self._report) as source:

            def close() -> None:
                self._stopping.wait()
                source.close()

            threading.Thread(target=close, daemon=True).start()  # a silent stream blocks
            for frame in source.frames():
                self.siting, self.frame_rate = source.siting, source.frame_rate
                yield frame
                if self._stopping.is_set():
                    return

    def _file(self) -> Iterator[av.VideoFrame]:
        while not self._stopping.is_set():
            reader = VideoReader(self.place, with_sound=False)
            self.siting, self.frame_rate = reader.siting, reader.frame_rate
            begin, first = time.monotonic(), None
            for frame in reader.frames():
                shown_s = frame.time or 0.0
                first = shown_s if first is None else first
                self._stopping.wait(max(0.0, shown_s - first - (time.monotonic() - begin)))
                if self._stopping.is_set():
                    return
                yield frame
            self._stopping.wait(float(1 / reader.frame_rate))


def size_of(place: str, is_live: bool) -> tuple[int, int]:
    """Return the (width, height) of the frames of a source, px.

    Raises
    ------
    MediaError
        The source does not exist, or yields no frame.
    """
    if not is_live:
        return VideoReader(place, with_sound=False).size
    with LiveSource(place) as source:
        frame = source.first()
    return frame.width, frame.height
