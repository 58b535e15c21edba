"""Processing of videos: a reader yields frames, a function transforms them, and a sink writes them,
in threads.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any, Literal, NamedTuple

import av

from ..base import interrupts
from ..base.errors import MediaError
from ..base.logs import OnProgress
from .progress import ProgressMeter
from .video_frames import Image, Planes, as_frame, image_of_frame, planar, planes, workable
from .video_reader import Item
from .video_writer import Sink

FrameInput = Literal["image", "planes", "frame"]
FrameResult = av.VideoFrame | Image | Planes
FrameFunction = Callable[[Any, float], FrameResult]
"""Function of an image (h, w, 3), planes, or a frame, and its time (s); returns an image, planes,
or a frame.
"""

PreparedItem = tuple[Item, Image | Planes | av.VideoFrame | None]
"""Frame with the input of the function, or audio packet with None."""


class ProcessingResult(NamedTuple):
    """Result of :func:`process`."""

    frames: int
    elapsed_s: float
    exit_code: int = 0
    """Exit code: 0 for a complete run, 130 after Ctrl-C, 143 after SIGTERM; processed frames are
    kept.
    """

    is_signal: bool = False
    """True if a signal stopped the run, and not the closing of a preview window."""

    @property
    def is_stopped(self) -> bool:
        """True if the run was stopped early."""
        return self.exit_code != 0

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.frames / max(self.elapsed_s, 1e-9)


def process(
    items: Iterable[Item],
    sink: Sink,
    function: FrameFunction,
    pixels: FrameInput = "image",
    on_progress: OnProgress | None = None,
    total: int | None = None,
    queue_size: int = 4,
) -> ProcessingResult:
    """Apply a function to every frame, in order; audio packets pass unchanged.

    Reading, processing and writing overlap in separate threads, with the function in the thread of
    the caller. Ctrl-C or SIGTERM ends the source: processed frames are written and kept; a second
    signal aborts. A damaged source is handled in the same way, and its error is raised at the end.
    In all cases the sink is closed or aborted on return.

    Parameters
    ----------
    items
        Frames and packets, as from :meth:`VideoReader.items` or :meth:`LiveSource.frames`.
    sink
        Sink, such as a :class:`VideoWriter`.
    function
        Called as ``function(image, time_s)``. The result must have separate memory, since it is
        written while the next frame is processed; :func:`omnimirror.io.video_frames.empty_frame`
        avoids a copy.
    pixels
        Input of the function. ``"image"``: (h, w, 3) uint8, red, green, blue. ``"planes"``: (y,
        u, v), or (y, uv) of NV12, as from :func:`omnimirror.io.video_frames.planes`, without
        conversion for sources of 4:2:0 with 8 bits. ``"frame"``: the frame with planes of the bit
        depth and chroma subsampling of the source and its colour coding, as for
        :func:`omnimirror.dewarp.video_files.dewarp_frame`.
    on_progress
        Callback of the number of frames and ``total``, a few times per second and at the end.
    total
        Expected number of frames.
    queue_size
        Maximum number of frames queued between two threads. 0 reads in the thread of the caller:
        for live sources, which have their own thread and whose frames must not wait.

    Raises
    ------
    MediaError
        If the source is damaged, raised after all readable frames are written; or the sink fails.
        Errors of the function are passed on, and abort the sink.
    """
    meter = ProgressMeter(on_progress, total)
    with interrupts.deferred():
        source = (
            _ReaderThread(items, pixels, queue_size)
            if queue_size
            else (_prepared(item, pixels) for item in items)
        )
        writing = _WriterThread(sink, max(1, queue_size))
        error: MediaError | None = None
        try:
            try:
                _process_items(source, function, writing, meter)
            except _SourceError as e:
                error = e.error
            finally:
                if isinstance(source, _ReaderThread):
                    source.stop()
            exit_code, is_signal = interrupts.exit_code(), interrupts.is_signal()
            writing.finish(may_be_empty=bool(exit_code) or error is not None)
        except BaseException:
            writing.discard()
            raise
    if error is not None:
        raise error
    meter.report()
    return ProcessingResult(sink.frames_written, meter.elapsed_s, exit_code, is_signal)


def in_real_time(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the items of a file in real time, each frame at its presentation time: for cameras,
    streams and windows.
    """
    start = None
    for item in items:
        if isinstance(item, av.VideoFrame):
            start = time.monotonic() - (item.time or 0.0) if start is None else start
            while (
                remaining := start + (item.time or 0.0) - time.monotonic()
            ) > 0 and not interrupts.is_pending():
                time.sleep(min(remaining, interrupts.POLL_S))
        yield item


def _process_items(
    source: Iterable[PreparedItem],
    function: FrameFunction,
    writing: _WriterThread,
    meter: ProgressMeter,
) -> None:
    """Process all items of the source until its end or a requested stop."""
    for item, prepared in source:
        if isinstance(item, av.VideoFrame):
            writing.put(as_frame(function(prepared, item.time or 0.0), item))
            meter.step()
        else:
            writing.put(item)
        if interrupts.is_pending():
            return


class _SourceError(Exception):
    """Error of the source, distinguished from errors of the function."""

    def __init__(self, error: MediaError) -> None:
        self.error = error


def _prepared(item: Item, pixels: FrameInput) -> PreparedItem:
    """Return an item with the input of the function; None for audio."""
    if not isinstance(item, av.VideoFrame):
        return item, None
    if pixels == "image":
        return item, image_of_frame(item)
    if pixels == "frame":
        item = workable(item)
        return item, item
    item = planar(item)
    return item, planes(item)


class _ReaderThread:
    """Reader of queued items in a separate thread."""

    def __init__(self, items: Iterable[Item], pixels: FrameInput, queue_size: int) -> None:
        self._queue: queue.Queue[PreparedItem | BaseException | None] = queue.Queue(queue_size)
        self._stopping = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(items, pixels), name="reading", daemon=True
        )
        self._thread.start()

    def __iter__(self) -> Iterator[PreparedItem]:
        while not interrupts.is_pending():
            try:
                item = self._queue.get(timeout=interrupts.POLL_S)
            except queue.Empty:
                continue
            if item is None:
                return
            if isinstance(item, MediaError):
                raise _SourceError(item)
            if isinstance(item, BaseException):
                raise item
            yield item

    def _run(self, items: Iterable[Item], pixels: FrameInput) -> None:
        try:
            for item in items:
                if not self._put(_prepared(item, pixels)):
                    break
        except BaseException as e:  # passed on, and raised in the consuming thread
            self._put(e)
        self._put(None)

    def _put(self, item: PreparedItem | BaseException | None) -> bool:
        """Queue an item; return False if the consumer has stopped."""
        while not self._stopping.is_set():
            with suppress(queue.Full):
                self._queue.put(item, timeout=interrupts.POLL_S)
                return True
        return False

    def stop(self) -> None:
        """Stop, and wait until the source is released."""
        self._stopping.set()
        self._thread.join()


class _WriterThread:
    """Writer of queued items in order, in a separate thread."""

    def __init__(self, sink: Sink, queue_size: int) -> None:
        self._sink = sink
        self._queue: queue.Queue[Item | None] = queue.Queue(queue_size)
        self._error: BaseException | None = None
        self._is_finished = False
        self._thread = threading.Thread(target=self._run, name="writing", daemon=True)
        self._thread.start()

    def put(self, item: Item | None) -> None:
        """Queue the next frame or packet; raise an error of the sink."""
        while self._error is None:
            with suppress(queue.Full):
                self._queue.put(item, timeout=interrupts.POLL_S)
                return
        raise self._error

    def _run(self) -> None:
        while True:
            item = self._queue.get()
            if item is None:
                return
            if self._error is not None:  # drain the queue, so no producer blocks
                continue
            try:
                if isinstance(item, av.VideoFrame):
                    self._sink.write(item)
                else:
                    self._sink.write_packet(item)
            except BaseException as e:
                self._error = e

    def finish(self, may_be_empty: bool = False) -> None:
        """Write the queued items and close the sink; without frames, the sink may be aborted
        instead.
        """
        self.put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error
        self._is_finished = True
        if may_be_empty and not self._sink.frames_written:
            self._sink.abort()
        else:
            self._sink.close()

    def discard(self) -> None:
        """Discard the queued items and abort the sink."""
        if self._is_finished:
            return
        self._error = self._error or MediaError("aborted")
        self._queue.put(None)
        self._thread.join()
        self._is_finished = True
        self._sink.abort()
