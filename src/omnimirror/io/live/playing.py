"""What plays just now: a camera or a stream, found again when it is lost, or a file at its own speed, over and over."""

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
    """The frames of a source, for as long as anyone wants them; taken in one thread, ended from any.

    Parameters
    ----------
    place
        An address, a camera, or the name of a file.
    is_live
        Whether it is a camera or a stream.
    report
        Told in a sentence when a stream is lost and when it is back.
    opening_s : s
        How long to wait for a stream's first frame; what has played once is waited for without end.
    """

    def __init__(
        self, place: str, is_live: bool, report: Callable[[str], None], opening_s: float = float("inf")
    ) -> None:
        self.place, self.is_live = place, is_live
        self.siting: Siting = "left"
        """Where colour samples lie in its frames; known with the first."""
        self.frame_rate: Fraction | None = None
        """Frames a second, as far as it says so; known with the first."""
        self._report, self._opening_s = report, opening_s
        self._stopping = threading.Event()

    def stop(self) -> None:
        """Let the source go."""
        self._stopping.set()

    def frames(self) -> Iterator[av.VideoFrame]:
        """Each frame when its time has come.

        Raises
        ------
        MediaError
            There is no such source, or it never begins.
        """
        return self._live() if self.is_live else self._file()

    def _live(self) -> Iterator[av.VideoFrame]:
        endless = float("inf")
        with LiveSource(self.place, patience_s=endless, opening_s=self._opening_s, report=self._report) as source:

            def close() -> None:
                self._stopping.wait()
                source.close()

            threading.Thread(target=close, daemon=True).start()  # a stream that is silent is let go too
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
    """(width, height) px of a source's frames.

    Raises
    ------
    MediaError
        There is no such source, or nothing comes from it.
    """
    if not is_live:
        return VideoReader(place, with_sound=False).size
    with LiveSource(place) as source:
        frame = source.first()
    return frame.width, frame.height
