"""Cameras and network streams with reconnection, and continuous playback of sources."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from urllib.parse import urlsplit

import av
from av.container import InputContainer

from ..base.errors import MediaError
from . import interrupts
from .exif import UPRIGHT
from .video_frames import (
    ChromaSiting,
    Deinterlacer,
    frame_orientation,
    orientation_note,
    siting_of,
    upright,
)
from .video_reader import VideoReader

# -- Cameras and network streams: newest frame, and reconnection after losses ----------------------

TICKS = Fraction(1, 90_000)  # s, unit of the frame times
SCHEMES = ("rtsp", "rtsps", "http", "https", "udp", "tcp", "rtp", "rtmp", "srt", "file")
SCHEMES_WITH_PORT = ("udp", "tcp", "rtp", "srt")
PERMANENT_ERRORS = (
    av.error.LookupError,
    av.error.HTTPUnauthorizedError,
    av.error.HTTPForbiddenError,
)
"""Errors for which retrying is useless: unknown protocol or decoder, access denied."""
CLOSE_TIMEOUT_S = 0.2  # longer than the frame interval of any running stream
LOW_DELAY = {"flags": "low_delay", "analyzeduration": "500000"}
"""Analysis of the stream for 0.5 s (in us); the frames are returned nevertheless."""
SCHEME_OPTIONS = {
    "rtsp": {"rtsp_transport": "tcp"},  # lost UDP packets corrupt images until the next key frame
    "udp": {"overrun_nonfatal": "1"},
}


def is_live(text: str) -> bool:
    """Return whether an input is a camera or a stream rather than a file.

    >>> [is_live(text) for text in ("rtsp://door/1", "/dev/video0", "0", "room.mp4", "C:\\\\room.mp4", "١٢٣")]
    [True, True, True, False, False, False]
    """
    return (
        (text.isascii() and text.isdigit())
        or text.startswith("/dev/video")
        or text.partition("://")[0].lower() in SCHEMES
    )


class LiveSource:
    """Camera or stream, read in a thread that keeps only the newest frame.

    A slow consumer misses frames, which are counted, and never lags behind. A stream that ends or
    falls silent is reopened after delays that double from ``first_wait_s`` to ``longest_wait_s``.

    Parameters
    ----------
    url
        Address (RTSP, HTTP, UDP, TCP, RTP, RTMP, SRT), or a camera: ``/dev/video0``, or ``0`` for
        short.
    timeout_s : s
        Silence after which the stream counts as lost; also the timeout for opening it.
    patience_s : s
        Time to retry without a single frame, ``inf`` for no limit.
    reconnect
        Whether to reopen a stream that has ended.
    options
        FFmpeg options for opening the source, such as ``{"video_size": "1920x1080"}`` for a camera,
        or ``{"rtsp_flags": "listen", "listen_timeout": "10"}``.
    report
        Called with a sentence, in the reading thread, when the stream is lost and when it is
        restored.
    opening_s : s, optional
        Time to retry for the first frame; ``patience_s`` by default.
    stored_orientation
        Return frames as stored, without the rotation of a display matrix.

    Raises
    ------
    MediaError
        The camera or file does not exist, or the address has an unknown scheme or no host. Later
        errors are raised by :meth:`frames`.

    Examples
    --------
    >>> LiveSource("/dev/video99")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: there is no camera /dev/video99; ...
    """

    def __init__(
        self,
        url: str,
        timeout_s: float = 5.0,
        patience_s: float = 30.0,
        first_wait_s: float = 0.25,
        longest_wait_s: float = 8.0,
        reconnect: bool = True,
        options: Mapping[str, str] | None = None,
        report: Callable[[str], None] | None = None,
        opening_s: float | None = None,
        stored_orientation: bool = False,
    ) -> None:
        self.url, self._format = checked(str(url))
        self.name = named(self.url)
        """Address without the password, for display."""
        self.timeout_s, self.patience_s = timeout_s, patience_s
        self.opening_s = patience_s if opening_s is None else opening_s
        self._waits = (first_wait_s, longest_wait_s)
        self._reconnect = reconnect
        self._scheme = self.url.partition("://")[0].lower()
        self._options = {**LOW_DELAY, **SCHEME_OPTIONS.get(self._scheme, {}), **(options or {})}
        self._stored_orientation = stored_orientation
        self._report = report or (lambda sentence: None)
        self.received = 0
        """Number of received frames, consumed or not."""
        self.dropped = 0
        """Number of frames that were replaced by a newer one before they were consumed."""
        self.reconnects = 0
        """Number of reconnections."""
        self.frame_rate: Fraction | None = None
        """Frames per second of the stream; None before the first frame, or if unknown."""
        self.siting: ChromaSiting = "left"
        """Position of chroma samples in the frames."""
        self.notes: tuple[str, ...] = ()
        """Remarks on the frames for the user, in sentences; known after the first frame."""
        self._newest: av.VideoFrame | None = None
        self._problem: MediaError | None = None
        self._is_over = False
        self._news = threading.Condition()
        self._stopping = threading.Event()
        self._start = self._heard = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=f"reading {self.url}", daemon=True)
        self._thread.start()

    def first(self) -> av.VideoFrame:
        """Wait for the first frame; :meth:`frames` yields it again unless a newer one has arrived.

        Raises
        ------
        MediaError
            No frame arrives within the patience.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._is_over)
            if self._newest is not None:
                return self._newest
        raise self._problem or MediaError(f"{self.name} ended before its first frame")

    def frames(self) -> Iterator[av.VideoFrame]:
        """Yield the newest frame until :meth:`close` or Ctrl-C, with the arrival time from 0.

        Raises
        ------
        MediaError
            No frame arrives within the patience, or the stream cannot be read.
        """
        while not interrupts.is_pending():
            with self._news:
                self._news.wait_for(
                    lambda: self._newest is not None or self._is_over, interrupts.POLL_S
                )
                frame, self._newest = self._newest, None
            if frame is not None:
                yield frame
            elif self._is_over:
                if self._problem is not None:
                    raise self._problem
                return

    def close(self) -> None:
        """Stop reading.

        A silent stream is released in the background, after ``timeout_s`` of FFmpeg, which cannot
        be interrupted.
        """
        self._stopping.set()
        self._end(None)
        self._thread.join(CLOSE_TIMEOUT_S)

    def __enter__(self) -> LiveSource:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # -- reading thread ----------------------------------------------------------------------------

    def _run(self) -> None:
        first, longest = self._waits
        wait = first
        while not self._stopping.is_set():
            before = self.received
            reason = self._read_once()
            if self._stopping.is_set() or self._is_over:
                return
            if not self._reconnect and self.received:
                self._end(None)
                return
            if self.received > before:
                wait = first
            if self._left_s() < wait:
                silent_s = time.monotonic() - self._heard
                self._end(
                    MediaError(f"nothing has come from {self.name} for {silent_s:.1f} s: {reason}")
                )
                return
            self._report(f"{self.name} is lost: {reason}; trying again in {wait:g} s")
            self._stopping.wait(wait)
            wait = min(2 * wait, longest)

    def _left_s(self) -> float:
        """Return the remaining patience, s."""
        patience_s = self.patience_s if self.received else self.opening_s
        return self._heard + patience_s - time.monotonic()

    def _read_once(self) -> str:
        """Read until the stream is lost; return the reason."""
        try:
            with self._open() as container:
                self._receive(container)
            return "it ended"
        except (av.error.ExitError, av.error.TimeoutError):
            return f"nothing came for {self.timeout_s:g} s"
        except PERMANENT_ERRORS as e:
            self._end(MediaError(f"cannot read {self.name}: {e.strerror}"))
            return str(e.strerror)
        except MediaError as e:
            self._end(e)
            return str(e)
        except (av.FFmpegError, OSError) as e:
            reason = e.strerror or str(e)
            if self._scheme == "file" and not self.received:  # the file is not a video
                self._end(MediaError(f"cannot read {self.name}: {reason}"))
            return reason

    def _open(self) -> InputContainer:
        times = (self.timeout_s, self.timeout_s)
        container = av.open(
            self.url, "r", format=self._format, options=self._options, timeout=times
        )
        if not container.streams.video:
            container.close()
            raise av.error.InvalidDataError(0, "there is no video in it")
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"  # frame threads would delay frames
        self.frame_rate = stream.average_rate or stream.guessed_rate
        self.siting = siting_of(stream.codec_context.name)
        return container

    def _receive(self, container: InputContainer) -> None:
        is_found_again, fields = self.received > 0, Deinterlacer()
        for packet in container.demux(container.streams.video[0]):
            if self._stopping.is_set() or self._left_s() < 0:  # the packets may contain no frames
                return
            try:
                frames = packet.decode()
            except (av.error.InvalidDataError, av.error.EOFError):
                continue  # for example before the first key frame
            for frame in (whole for coded in frames for whole in fields(coded)):
                if is_found_again:
                    self.reconnects += 1
                    self._report(
                        f"{self.name} is back after {time.monotonic() - self._heard:.1f} s"
                    )
                    is_found_again = False
                found = frame_orientation(frame)
                if not self.received and (
                    note := orientation_note(self.name, found, self._stored_orientation)
                ):
                    self.notes = (note,)
                self._offer(
                    upright(frame, UPRIGHT if self._stored_orientation else found or UPRIGHT)
                )

    def _offer(self, frame: av.VideoFrame) -> None:
        with self._news:
            if not self.received:
                self._start = time.monotonic()
            self._heard = time.monotonic()
            frame.time_base = TICKS
            frame.pts = round((self._heard - self._start) / TICKS)
            self.received += 1
            self.dropped += self._newest is not None
            self._newest = frame
            self._news.notify_all()

    def _end(self, problem: MediaError | None) -> None:
        with self._news:
            self._problem = self._problem or problem
            self._is_over = True
            self._news.notify_all()


def named(url: str) -> str:
    """Return an address without user name and password.

    >>> named("rtsp://me:secret@door:554/1"), named("/dev/video0")
    ('rtsp://door:554/1', '/dev/video0')
    """
    return re.sub(r"^(\w+://)[^/]*@", r"\1", url)


def checked(url: str) -> tuple[str, str | None]:
    """Return the address for FFmpeg, and the format that it requires.

    Raises
    ------
    MediaError
        The source is invalid, regardless of the network.
    """
    if url.isascii() and url.isdigit():
        url = f"/dev/video{url}"
    if url.startswith("/dev/video"):
        if not Path(url).exists():
            found = sorted(str(path) for path in Path("/dev").glob("video*"))
            raise MediaError(
                f"there is no camera {url}; here are {', '.join(found) if found else 'none at all'}"
            )
        return url, "v4l2"
    scheme, colon, rest = url.partition("://")
    if scheme.lower() not in SCHEMES or not colon:
        raise MediaError(
            f"{url!r} is no camera or stream; valid are /dev/video0, and addresses of {', '.join(SCHEMES)}"
        )
    if scheme.lower() == "file":
        if not Path(rest).is_file():
            raise MediaError(f"there is no file {rest!r}, which {url} names")
        return url, None
    _check_machine(url, scheme.lower())
    return url, None


def _check_machine(url: str, scheme: str) -> None:
    """Check that an address has a host, or a port if it listens."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as e:
        raise MediaError(f"{named(url)!r} is no address of a stream: {e}") from None
    if not host and port is None:
        raise MediaError(
            f"{named(url)!r} names no machine; valid is {scheme}://MACHINE or {scheme}://MACHINE:PORT/PATH"
        )
    if scheme in SCHEMES_WITH_PORT and port is None:
        raise MediaError(f"{named(url)!r} names no port; valid is {scheme}://MACHINE:PORT")


# -- Continuous playback: a camera or stream with reconnection, or a file in real time, repeated


class Playback:
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
    stored_orientation
        Yield frames as stored, without the rotation of a display matrix.
    """

    def __init__(
        self,
        place: str,
        is_live: bool,
        report: Callable[[str], None],
        opening_s: float = float("inf"),
        *,
        stored_orientation: bool = False,
    ) -> None:
        self.place, self.is_live = place, is_live
        self.siting: ChromaSiting = "left"
        """Position of chroma samples in the frames; known after the first one."""
        self.frame_rate: Fraction | None = None
        """Frames per second, if the source contains it; known after the first frame."""
        self.notes: tuple[str, ...] = ()
        """Remarks on the frames for the user, in sentences; known after the first frame."""
        self._report, self._opening_s, self._stored_orientation = (
            report,
            opening_s,
            stored_orientation,
        )
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
        live = LiveSource(
            self.place,
            patience_s=float("inf"),
            opening_s=self._opening_s,
            report=self._report,
            stored_orientation=self._stored_orientation,
        )
        with live as source:

            def close() -> None:
                self._stopping.wait()
                source.close()

            threading.Thread(target=close, daemon=True).start()  # a silent stream blocks
            for frame in source.frames():
                self.siting, self.frame_rate, self.notes = (
                    source.siting,
                    source.frame_rate,
                    source.notes,
                )
                yield frame
                if self._stopping.is_set():
                    return

    def _file(self) -> Iterator[av.VideoFrame]:
        while not self._stopping.is_set():
            reader = VideoReader(
                self.place, with_sound=False, stored_orientation=self._stored_orientation
            )
            self.siting, self.frame_rate, self.notes = (
                reader.siting,
                reader.frame_rate,
                tuple(reader.notes),
            )
            begin, first = time.monotonic(), None
            for frame in reader.frames():
                shown_s = frame.time or 0.0
                first = shown_s if first is None else first
                self._stopping.wait(max(0.0, shown_s - first - (time.monotonic() - begin)))
                if self._stopping.is_set():
                    return
                yield frame
            self._stopping.wait(float(1 / reader.frame_rate))


def source_size(place: str, is_live: bool, *, stored_orientation: bool = False) -> tuple[int, int]:
    """Return the (width, height) of the frames of a source, px; ``stored_orientation`` as for
    :class:`Playback`.

    Raises
    ------
    MediaError
        The source does not exist, or yields no frame.
    """
    if not is_live:
        return VideoReader(place, with_sound=False, stored_orientation=stored_orientation).size
    with LiveSource(place, stored_orientation=stored_orientation) as source:
        frame = source.first()
    return frame.width, frame.height
