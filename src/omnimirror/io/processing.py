"""From a source through a picture function to a sink, with reading and writing in threads of their own."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any, Literal, NamedTuple

import av

from ..base.errors import MediaError
from . import interrupts
from .progress import FrameProgress, Meter
from .video.frames import Image, Planes, as_frame, image_of_frame, planar, planes, workable
from .video.reader import Item
from .video.writer import Sink

Pixels = Literal["picture", "planes", "frame"]
Made = av.VideoFrame | Image | Planes
PictureFunction = Callable[[Any, float], Made]
"""A picture (h, w, 3), planes, or a frame, and its time (s), to another picture, planes, or a finished frame."""

Prepared = tuple[Item, Image | Planes | av.VideoFrame | None]
"""A frame with what the function takes, or a packet of sound with nothing."""


class Outcome(NamedTuple):
    """What became of it."""

    frames: int
    elapsed_s: float
    exit_code: int = 0
    """0 where it came to its end; 130 where Ctrl-C ended it, 143 where SIGTERM did, and what was done is kept."""

    is_signal: bool = False
    """Whether a signal ended it, and not the window of a preview that was closed."""

    @property
    def stopped(self) -> bool:
        """Whether it was ended before its end."""
        return self.exit_code != 0

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.frames / max(self.elapsed_s, 1e-9)


def process(
    items: Iterable[Item],
    sink: Sink,
    function: PictureFunction,
    pixels: Pixels = "picture",
    progress: Callable[[FrameProgress], None] | None = None,
    total: int | None = None,
    ahead: int = 4,
) -> Outcome:
    """Put every frame through a function, in order; packets of sound pass by untouched.

    Reading, the function and writing overlap, each in its own thread, with the function in the caller's.
    Ctrl-C or SIGTERM ends the source: what was done is written and kept, and a second one gives up. A
    damaged source is treated alike, and its error raised at the end. In every case the sink has been
    closed, or given up, when this returns.

    Parameters
    ----------
    items
        Frames and packets, as :meth:`VideoReader.items` or :meth:`LiveSource.frames` gives them.
    sink
        Such as a :class:`VideoWriter`.
    function
        Called as ``function(picture, time_s)``. What it returns must be memory of its own, since it is
        written while the next frame is made; :func:`omnimirror.io.video.frames.empty_frame` spares a copy.
    pixels
        ``"picture"``: it takes (h, w, 3) uint8, red, green, blue. ``"planes"``: it takes (y, u, v), or
        (y, uv) of NV12, as :func:`omnimirror.io.video.frames.planes` gives them, without any conversion
        unless the source is of another kind than 4:2:0 with 8 bits. ``"frame"``: it takes the frame with
        planes of whatever depth and colour resolution the source has, which also tells how they are coded, such as
        :func:`omnimirror.dewarp.frames.dewarp_frame`.
    progress
        Told a few times a second, and at the end.
    total
        Frames to expect, for the time left.
    ahead
        Frames that wait between two threads, at most. 0 reads in the caller's thread: for live sources,
        which have a thread already and whose frames must not wait.

    Raises
    ------
    MediaError
        The source is damaged, after all that could be read has been written; or the sink cannot be
        written. Errors of the function are passed on, and give the sink up.
    """
    meter = Meter(progress, total)
    with interrupts.deferred():
        source = _Reading(items, pixels, ahead) if ahead else (_prepared(item, pixels) for item in items)
        writing = _Writing(sink, max(1, ahead))
        problem: MediaError | None = None
        try:
            try:
                _work(source, function, writing, meter)
            except _SourceProblem as e:
                problem = e.error
            finally:
                if isinstance(source, _Reading):
                    source.stop()
            exit_code, is_signal = interrupts.exit_code(), interrupts.is_signal()
            writing.finish(may_be_empty=bool(exit_code) or problem is not None)
        except BaseException:
            writing.give_up()
            raise
    if problem is not None:
        raise problem
    meter.report()
    return Outcome(sink.frames_written, meter.elapsed_s, exit_code, is_signal)


def in_real_time(items: Iterable[Item]) -> Iterator[Item]:
    """Items of a file, each frame held back until its time has come: for a camera, a stream or a window to show."""
    start = None
    for item in items:
        if isinstance(item, av.VideoFrame):
            start = time.monotonic() - (item.time or 0.0) if start is None else start
            while (left := start + (item.time or 0.0) - time.monotonic()) > 0 and not interrupts.is_pending():
                time.sleep(min(left, interrupts.POLL_S))
        yield item


def _work(source: Iterable[Prepared], function: PictureFunction, writing: _Writing, meter: Meter) -> None:
    """Everything from the source through the function to the writing thread, until it ends or is asked to."""
    for item, pixels_of_item in source:
        if isinstance(item, av.VideoFrame):
            writing.put(as_frame(function(pixels_of_item, item.time or 0.0), item))
            meter.step()
        else:
            writing.put(item)
        if interrupts.is_pending():
            return


class _SourceProblem(Exception):
    """An error of the source, told apart from those of the function."""

    def __init__(self, error: MediaError) -> None:
        self.error = error


def _prepared(item: Item, pixels: Pixels) -> Prepared:
    """An item with what the function takes; None for sound."""
    if not isinstance(item, av.VideoFrame):
        return item, None
    if pixels == "picture":
        return item, image_of_frame(item)
    if pixels == "frame":
        item = workable(item)
        return item, item
    item = planar(item)
    return item, planes(item)


class _Reading:
    """Reads ahead in a thread of its own."""

    def __init__(self, items: Iterable[Item], pixels: Pixels, ahead: int) -> None:
        self._waiting: queue.Queue[Prepared | BaseException | None] = queue.Queue(ahead)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(items, pixels), name="reading", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Prepared]:
        while not interrupts.is_pending():
            try:
                item = self._waiting.get(timeout=interrupts.POLL_S)
            except queue.Empty:
                continue
            if item is None:
                return
            if isinstance(item, MediaError):
                raise _SourceProblem(item)
            if isinstance(item, BaseException):
                raise item
            yield item

    def _run(self, items: Iterable[Item], pixels: Pixels) -> None:
        try:
            for item in items:
                if not self._put(_prepared(item, pixels)):
                    break
        except BaseException as e:  # handed over, and raised where the frames are taken
            self._put(e)
        self._put(None)

    def _put(self, item: Prepared | BaseException | None) -> bool:
        """Whether there was still someone to take it."""
        while not self._stopping.is_set():
            with suppress(queue.Full):
                self._waiting.put(item, timeout=interrupts.POLL_S)
                return True
        return False

    def stop(self) -> None:
        """Take no more, and wait until the source has been let go."""
        self._stopping.set()
        self._thread.join()


class _Writing:
    """Writes in a thread of its own, what is put, in order."""

    def __init__(self, sink: Sink, ahead: int) -> None:
        self._sink = sink
        self._waiting: queue.Queue[Item | None] = queue.Queue(ahead)
        self._error: BaseException | None = None
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name="writing", daemon=True)
        self._thread.start()

    def put(self, item: Item | None) -> None:
        """Hand over the next frame or packet; an error of the sink is raised here."""
        while self._error is None:
            with suppress(queue.Full):
                self._waiting.put(item, timeout=interrupts.POLL_S)
                return
        raise self._error

    def _run(self) -> None:
        while True:
            item = self._waiting.get()
            if item is None:
                return
            if self._error is not None:  # take the rest, so that nobody waits
                continue
            try:
                if isinstance(item, av.VideoFrame):
                    self._sink.write(item)
                else:
                    self._sink.write_packet(item)
            except BaseException as e:
                self._error = e

    def finish(self, may_be_empty: bool = False) -> None:
        """Write what waits, and close the sink; where nothing was written it may be given up instead."""
        self.put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error
        self._is_over = True
        if may_be_empty and not self._sink.frames_written:
            self._sink.abort()
        else:
            self._sink.close()

    def give_up(self) -> None:
        """Forget what waits, and give the sink up."""
        if self._is_over:
            return
        self._error = self._error or MediaError("given up")
        self._waiting.put(None)
        self._thread.join()
        self._is_over = True
        self._sink.abort()
