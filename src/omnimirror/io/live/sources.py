"""Cameras and network streams: the newest frame, and the stream found again when it is lost."""

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

from ...base.errors import MediaError
from .. import interrupts
from ..pictures.orientation import UPRIGHT
from ..video.frames import Siting, siting_of
from ..video.interlace import Fields
from ..video.orientation import orientation_of, upright

TICKS = Fraction(1, 90_000)  # s, the unit of the frames' times
SCHEMES = ("rtsp", "rtsps", "http", "https", "udp", "tcp", "rtp", "rtmp", "srt", "file")
NEEDS_PORT = ("udp", "tcp", "rtp", "srt")
NEVER_BETTER = (av.error.LookupError, av.error.HTTPUnauthorizedError, av.error.HTTPForbiddenError)
"""No such protocol or decoder, or not for us: waiting does not help."""
CLOSING_S = 0.2  # longer than any running stream takes to its next frame
LOW_DELAY = {"flags": "low_delay", "analyzeduration": "500000"}
"""Half a second (us) to learn what the stream is, whose frames are given all the same."""
OPTIONS_OF_SCHEME = {
    "rtsp": {"rtsp_transport": "tcp"},  # a frame lost on UDP smears the picture until the next key frame
    "udp": {"overrun_nonfatal": "1"},
}


def is_live(text: str) -> bool:
    """Whether an input is a camera or a stream rather than a file.

    >>> [is_live(text) for text in ("rtsp://door/1", "/dev/video0", "0", "room.mp4", "C:\\\\room.mp4", "١٢٣")]
    [True, True, True, False, False, False]
    """
    return (
        (text.isascii() and text.isdigit())
        or text.startswith("/dev/video")
        or text.partition("://")[0].lower() in SCHEMES
    )


class LiveSource:
    """A camera or a stream, read in a thread that keeps nothing but the newest frame.

    Whoever takes the frames more slowly than they come misses some, which are counted, and never lags
    behind. A stream that ends or falls silent is opened again, after pauses that double from
    ``first_wait_s`` to ``longest_wait_s``.

    Parameters
    ----------
    url
        An address (RTSP, HTTP, UDP, TCP, RTP, RTMP, SRT), or a camera: ``/dev/video0``, or ``0`` for short.
    timeout_s : s
        Silence after which the stream counts as lost; also how long opening may take.
    patience_s : s
        How long to go on trying without a single frame, ``inf`` for ever.
    reconnect
        Whether to open a stream again that has ended.
    options
        Options of FFmpeg's for opening it, such as ``{"video_size": "1920x1080"}`` of a camera, or
        ``{"rtsp_flags": "listen", "listen_timeout": "10"}``.
    report
        Told in a sentence, from the reading thread, when the stream is lost and when it is back.
    opening_s : s, optional
        How long to go on trying for the very first frame; ``patience_s`` unless given.
    stored_orientation
        Return frames as they are stored, without the rotation in a display matrix.

    Raises
    ------
    MediaError
        There is no such camera or file, or the address is of no known kind, or names no machine. What happens later
        is raised by :meth:`frames`.

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
        """The address without a password, for people."""
        self.timeout_s, self.patience_s = timeout_s, patience_s
        self.opening_s = patience_s if opening_s is None else opening_s
        self._waits = (first_wait_s, longest_wait_s)
        self._reconnect = reconnect
        self._scheme = self.url.partition("://")[0].lower()
        self._options = {**LOW_DELAY, **OPTIONS_OF_SCHEME.get(self._scheme, {}), **(options or {})}
        self._stored_orientation = stored_orientation
        self._report = report or (lambda sentence: None)
        self.received = 0
        """Frames that came, taken or not."""
        self.dropped = 0
        """Frames that were replaced by a newer one before anyone took them."""
        self.reconnects = 0
        """How often the stream was found again."""
        self.frame_rate: Fraction | None = None
        """Frames a second, as the stream says; None before the first frame, or if it says nothing."""
        self.siting: Siting = "left"
        """Where colour samples lie in its frames."""
        self._newest: av.VideoFrame | None = None
        self._problem: MediaError | None = None
        self._is_over = False
        self._news = threading.Condition()
        self._stopping = threading.Event()
        self._start = self._heard = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=f"reading {self.url}", daemon=True)
        self._thread.start()

    def first(self) -> av.VideoFrame:
        """Wait for the first frame, which :meth:`frames` will give again unless a newer one has come.

        Raises
        ------
        MediaError
            Nothing comes within the patience.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._is_over)
            if self._newest is not None:
                return self._newest
        raise self._problem or MediaError(f"{self.name} ended before its first frame")

    def frames(self) -> Iterator[av.VideoFrame]:
        """Always the newest frame, until :meth:`close` or Ctrl-C; its time is that of its arrival, from 0.

        Raises
        ------
        MediaError
            Nothing has come within the patience, or the stream cannot be read at all.
        """
        while not interrupts.is_pending():
            with self._news:
                self._news.wait_for(lambda: self._newest is not None or self._is_over, interrupts.POLL_S)
                frame, self._newest = self._newest, None
            if frame is not None:
                yield frame
            elif self._is_over:
                if self._problem is not None:
                    raise self._problem
                return

    def close(self) -> None:
        """Stop reading.

        A stream that is silent just now is let go in the background, when FFmpeg's ``timeout_s`` is over:
        nothing wakes it before.
        """
        self._stopping.set()
        self._end(None)
        self._thread.join(CLOSING_S)

    def __enter__(self) -> LiveSource:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- in the reading thread ---------------------------------------------------------------------

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
                self._end(MediaError(f"nothing has come from {self.name} for {silent_s:.1f} s: {reason}"))
                return
            self._report(f"{self.name} is lost: {reason}; trying again in {wait:g} s")
            self._stopping.wait(wait)
            wait = min(2 * wait, longest)

    def _left_s(self) -> float:
        """How long the patience lasts, s."""
        patience_s = self.patience_s if self.received else self.opening_s
        return self._heard + patience_s - time.monotonic()

    def _read_once(self) -> str:
        """Read until the stream is lost; why it was."""
        try:
            with self._open() as container:
                self._receive(container)
            return "it ended"
        except (av.error.ExitError, av.error.TimeoutError):
            return f"nothing came for {self.timeout_s:g} s"
        except NEVER_BETTER as e:
            self._end(MediaError(f"cannot read {self.name}: {e.strerror}"))
            return str(e.strerror)
        except MediaError as e:
            self._end(e)
            return str(e)
        except (av.FFmpegError, OSError) as e:
            reason = e.strerror or str(e)
            if self._scheme == "file" and not self.received:  # it will not turn into a video
                self._end(MediaError(f"cannot read {self.name}: {reason}"))
            return reason

    def _open(self) -> InputContainer:
        times = (self.timeout_s, self.timeout_s)
        container = av.open(self.url, "r", format=self._format, options=self._options, timeout=times)
        if not container.streams.video:
            container.close()
            raise av.error.InvalidDataError(0, "there is no video in it")
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"  # threads that work on several frames at once hold frames back
        self.frame_rate = stream.average_rate or stream.guessed_rate
        self.siting = siting_of(stream.codec_context.name)
        return container

    def _receive(self, container: InputContainer) -> None:
        is_found_again, fields = self.received > 0, Fields()
        for packet in container.demux(container.streams.video[0]):
            if self._stopping.is_set() or self._left_s() < 0:  # what comes may be no pictures
                return
            try:
                frames = packet.decode()
            except (av.error.InvalidDataError, av.error.EOFError):
                continue  # as before the first key frame
            for frame in (whole for coded in frames for whole in fields(coded)):
                if is_found_again:
                    self.reconnects += 1
                    self._report(f"{self.name} is back after {time.monotonic() - self._heard:.1f} s")
                    is_found_again = False
                orientation = None if self._stored_orientation else orientation_of(frame)
                self._offer(upright(frame, orientation or UPRIGHT))

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
    """An address without the name and password of a user.

    >>> named("rtsp://me:secret@door:554/1"), named("/dev/video0")
    ('rtsp://door:554/1', '/dev/video0')
    """
    return re.sub(r"^(\w+://)[^/]*@", r"\1", url)


def checked(url: str) -> tuple[str, str | None]:
    """The address as FFmpeg wants it, and the format it must be told.

    Raises
    ------
    MediaError
        There can be no such source, whatever happens on the network.
    """
    if url.isascii() and url.isdigit():
        url = f"/dev/video{url}"
    if url.startswith("/dev/video"):
        if not Path(url).exists():
            found = sorted(str(path) for path in Path("/dev").glob("video*"))
            raise MediaError(f"there is no camera {url}; here are {', '.join(found) if found else 'none at all'}")
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
    """An address names a machine, or where to listen it names a port."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as e:
        raise MediaError(f"{named(url)!r} is no address of a stream: {e}") from None
    if not host and port is None:
        raise MediaError(
            f"{named(url)!r} names no machine; valid is {scheme}://MACHINE or {scheme}://MACHINE:PORT/PATH"
        )
    if scheme in NEEDS_PORT and port is None:
        raise MediaError(f"{named(url)!r} names no port; valid is {scheme}://MACHINE:PORT")
