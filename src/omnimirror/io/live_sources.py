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

from ..base import interrupts
from ..base.errors import MediaError
from .image_metadata import UPRIGHT
from .video_frames import (
    ChromaSiting,
    Deinterlacer,
    frame_orientation,
    orientation_note,
    siting_of,
    upright,
)
from .video_reader import VideoReader

# -- Cameras and network streams -------------------------------------------------------------------

TICKS = Fraction(1, 90_000)  # s, unit of the frame times
SCHEMES = ("rtsp", "rtsps", "http", "https", "udp", "tcp", "rtp", "rtmp", "srt", "file")
SCHEMES_WITH_PORT = ("udp", "tcp", "rtp", "srt")
PERMANENT_ERRORS = (
    av.error.LookupError,
    av.error.HTTPUnauthorizedError,
    av.error.HTTPForbiddenError,
)
"""Permanent errors, for which no retry is made: unknown protocol or decoder, access denied."""
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
    falls silent is reopened after delays that double from ``min_delay_s`` to ``max_delay_s``.

    Parameters
    ----------
    url
        Address (RTSP, HTTP, UDP, TCP, RTP, RTMP, SRT), or a camera: ``/dev/video0``, or ``0`` for
        short.
    timeout_s : s
        Silence after which the stream counts as lost; also the timeout for opening it.
    patience_s : s Time to retry without receiving a frame, ``inf`` for no limit. reconnect
        Whether to reopen a stream that has ended.
    options
        FFmpeg options for opening the source, such as ``{"video_size": "1920x1080"}`` for a camera,
        or ``{"rtsp_flags": "listen", "listen_timeout": "10"}``.
    on_warning
        Called with a message, in the reading thread, when the stream is lost and when it is
        restored.
    opening_s : s, optional
        Time to retry for the first frame; ``patience_s`` by default.
    stored_orientation
        Return frames as stored, without the rotation of a display matrix.

    Raises
    ------
    MediaError
        If the camera or file does not exist, or the address has an unknown scheme or no host. Later
        errors are raised by :meth:`frames`.

    Examples
    --------
    >>> LiveSource("/dev/video99")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: the camera must be one of the connected ones ...; got /dev/video99
    """

    def __init__(
        self,
        url: str,
        timeout_s: float = 5.0,
        patience_s: float = 30.0,
        min_delay_s: float = 0.25,
        max_delay_s: float = 8.0,
        reconnect: bool = True,
        options: Mapping[str, str] | None = None,
        on_warning: Callable[[str], None] | None = None,
        opening_s: float | None = None,
        stored_orientation: bool = False,
    ) -> None:
        self.url, self._format = resolve_source(str(url))
        self.name = without_credentials(self.url)
        """Address without the password, for display."""
        self.timeout_s, self.patience_s = timeout_s, patience_s
        self.opening_s = patience_s if opening_s is None else opening_s
        self._delays = (min_delay_s, max_delay_s)
        self._reconnect = reconnect
        self._scheme = self.url.partition("://")[0].lower()
        self._options = {**LOW_DELAY, **SCHEME_OPTIONS.get(self._scheme, {}), **(options or {})}
        self._stored_orientation = stored_orientation
        self._on_warning = on_warning or (lambda message: None)
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
        self._error: MediaError | None = None
        self._is_finished = False
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._start = self._last_frame_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=f"reading {self.url}", daemon=True)
        self._thread.start()

    def first(self) -> av.VideoFrame:
        """Wait for the first frame; :meth:`frames` yields it again unless a newer one has arrived.

        Raises
        ------
        MediaError
            If no frame arrives within ``opening_s``.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._is_finished)
            if self._newest is not None:
                return self._newest
        raise self._error or MediaError(f"{self.name} ended before the first frame")

    def frames(self) -> Iterator[av.VideoFrame]:
        """Yield the newest frame until :meth:`close` or Ctrl-C, with the arrival time from 0.

        Raises
        ------
        MediaError
            If no frame arrives within ``patience_s`` (the first: ``opening_s``), or the stream
            cannot be read.
        """
        while not interrupts.is_pending():
            with self._changed:
                self._changed.wait_for(
                    lambda: self._newest is not None or self._is_finished, interrupts.POLL_S
                )
                frame, self._newest = self._newest, None
            if frame is not None:
                yield frame
            elif self._is_finished:
                if self._error is not None:
                    raise self._error
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
        min_delay, max_delay = self._delays
        delay = min_delay
        while not self._stopping.is_set():
            before = self.received
            reason = self._read_once()
            if self._stopping.is_set() or self._is_finished:
                return
            if not self._reconnect and self.received:
                self._end(None)
                return
            if self.received > before:
                delay = min_delay
            if self._remaining_s() < delay:
                silent_s = time.monotonic() - self._last_frame_s
                self._end(MediaError(f"no frame from {self.name} for {silent_s:.1f} s: {reason}"))
                return
            self._on_warning(f"{self.name} is disconnected: {reason}; reconnecting in {delay:g} s")
            self._stopping.wait(delay)
            delay = min(2 * delay, max_delay)

    def _remaining_s(self) -> float:
        """Return the remaining time for retries, s."""
        patience_s = self.patience_s if self.received else self.opening_s
        return self._last_frame_s + patience_s - time.monotonic()

    def _read_once(self) -> str:
        """Read until the stream is lost; return the reason."""
        try:
            with self._open() as container:
                self._receive(container)
            return "end of stream"
        except (av.error.ExitError, av.error.TimeoutError):
            return f"no data for {self.timeout_s:g} s"
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
            raise av.error.InvalidDataError(0, "the source has no video")
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"  # frame threads would delay frames
        self.frame_rate = stream.average_rate or stream.guessed_rate
        self.siting = siting_of(stream.codec_context.name)
        return container

    def _receive(self, container: InputContainer) -> None:
        is_reconnecting, deinterlace = self.received > 0, Deinterlacer()
        for packet in container.demux(container.streams.video[0]):
            if (
                self._stopping.is_set() or self._remaining_s() < 0
            ):  # the packets may contain no frames
                return
            try:
                frames = packet.decode()
            except (av.error.InvalidDataError, av.error.EOFError):
                continue  # for example before the first key frame
            for frame in (ready for coded in frames for ready in deinterlace(coded)):
                if is_reconnecting:
                    self.reconnects += 1
                    self._on_warning(
                        f"{self.name} is reconnected after {time.monotonic() - self._last_frame_s:.1f} s"
                    )
                    is_reconnecting = False
                orientation = frame_orientation(frame)
                if not self.received and (
                    note := orientation_note(self.name, orientation, self._stored_orientation)
                ):
                    self.notes = (note,)
                self._offer(
                    upright(frame, UPRIGHT if self._stored_orientation else orientation or UPRIGHT)
                )

    def _offer(self, frame: av.VideoFrame) -> None:
        with self._changed:
            if not self.received:
                self._start = time.monotonic()
            self._last_frame_s = time.monotonic()
            frame.time_base = TICKS
            frame.pts = round((self._last_frame_s - self._start) / TICKS)
            self.received += 1
            self.dropped += self._newest is not None
            self._newest = frame
            self._changed.notify_all()

    def _end(self, problem: MediaError | None) -> None:
        with self._changed:
            self._error = self._error or problem
            self._is_finished = True
            self._changed.notify_all()


def without_credentials(url: str) -> str:
    """Return an address without user name and password.

    >>> without_credentials("rtsp://me:secret@door:554/1"), without_credentials("/dev/video0")
    ('rtsp://door:554/1', '/dev/video0')
    """
    return re.sub(r"^(\w+://)[^/]*@", r"\1", url)


def resolve_source(url: str) -> tuple[str, str | None]:
    """Return the address for FFmpeg, and the format that it requires.

    Raises
    ------
    MediaError
        If the source is invalid, regardless of the network.
    """
    if url.isascii() and url.isdigit():
        url = f"/dev/video{url}"
    if url.startswith("/dev/video"):
        if not Path(url).exists():
            available = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*")))
            raise MediaError(
                f"the camera must be one of the connected ones ({available or 'none'}); got {url}"
            )
        return url, "v4l2"
    scheme, colon, rest = url.partition("://")
    if scheme.lower() not in SCHEMES or not colon:
        raise MediaError(
            f"the source must be a camera such as /dev/video0, or an address of {', '.join(SCHEMES)}; got {url!r}"
        )
    if scheme.lower() == "file":
        if not Path(rest).is_file():
            raise MediaError(f"{url} must be the address of an existing file")
        return url, None
    _check_host(url, scheme.lower())
    return url, None


def _check_host(url: str, scheme: str) -> None:
    """Check that an address has a host, or a port if it listens."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as e:
        raise MediaError(f"{without_credentials(url)!r} must be a valid address: {e}") from None
    if not host and port is None:
        raise MediaError(
            f"the address must contain a host, as in {scheme}://HOST or "
            f"{scheme}://HOST:PORT/PATH; got {without_credentials(url)!r}"
        )
    if scheme in SCHEMES_WITH_PORT and port is None:
        raise MediaError(
            f"the address must contain a port, as in {scheme}://HOST:PORT; got {without_credentials(url)!r}"
        )


# -- Continuous playback ---------------------------------------------------------------------------


class Playback:
    """Endless frames of a source; read in one thread, stopped from any thread.

    Parameters
    ----------
    source
        Address, camera, or name of a file.
    is_live
        Whether the source is a camera or a stream.
    on_warning
        Called with a message when a stream is lost and when it is restored.
    opening_s : s
        Timeout for the first frame of a stream; after the first frame, retries continue without
        limit.
    stored_orientation
        Yield frames as stored, without the rotation of a display matrix.
    """

    def __init__(
        self,
        source: str,
        is_live: bool,
        on_warning: Callable[[str], None],
        opening_s: float = float("inf"),
        *,
        stored_orientation: bool = False,
    ) -> None:
        self.source, self.is_live = source, is_live
        self.siting: ChromaSiting = "left"
        """Position of chroma samples in the frames; known after the first one."""
        self.frame_rate: Fraction | None = None
        """Frames per second, if the source contains it; known after the first frame."""
        self.notes: tuple[str, ...] = ()
        """Remarks on the frames for the user, in sentences; known after the first frame."""
        self._on_warning, self._opening_s, self._stored_orientation = (
            on_warning,
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
            If the source does not exist, or yields no frame.
        """
        return self._live() if self.is_live else self._file()

    def _live(self) -> Iterator[av.VideoFrame]:
        live = LiveSource(
            self.source,
            patience_s=float("inf"),
            opening_s=self._opening_s,
            on_warning=self._on_warning,
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
                self.source, with_audio=False, stored_orientation=self._stored_orientation
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


def source_size(source: str, is_live: bool, *, stored_orientation: bool = False) -> tuple[int, int]:
    """Return the (width, height) of the frames of a source, px; ``stored_orientation`` as for
    :class:`Playback`.

    Raises
    ------
    MediaError
        If the source does not exist, or yields no frame.
    """
    if not is_live:
        return VideoReader(source, with_audio=False, stored_orientation=stored_orientation).size
    with LiveSource(source, stored_orientation=stored_orientation) as stream:
        frame = stream.first()
    return frame.width, frame.height
