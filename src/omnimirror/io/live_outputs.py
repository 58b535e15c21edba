"""Outputs other than files: network streams, pipes, virtual cameras and windows."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import ExitStack, suppress
from dataclasses import replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from subprocess import PIPE, Popen
from types import TracebackType
from typing import Any, BinaryIO, Literal

import av
from av.audio.stream import AudioStream
from av.packet import Packet

from ..base import interrupts
from ..base.errors import InvalidParameter, MediaError
from .video_encoder import DEFAULT_CODEC, Encoder, media_errors
from .video_frames import (
    ChromaSiting,
    Image,
    PixelFormat,
    converted,
    image_of_frame,
    is_full_range,
    planes,
    siting_of,
)

STREAM_FORMATS = {
    "udp": "mpegts",
    "tcp": "mpegts",
    "http": "mpegts",
    "rtsp": "rtsp",
    "rtmp": "flv",
    "srt": "mpegts",
}
"""Container format of a stream by the scheme of its address."""
LIVE_OPTIONS = {
    "libx264": {"tune": "zerolatency", "preset": "veryfast"},
    "libx265": {"tune": "zerolatency"},
}
KEY_FRAME_INTERVAL_S = 1.0  # maximum delay until a new viewer receives an image
VIRTUAL_CAMERAS = Path("/sys/devices/virtual/video4linux")


def stream_format(url: str) -> str:
    """Return the container format for an address; raise an error for unsupported schemes."""
    scheme, separator, _ = url.partition("://")
    if not separator or scheme.lower() not in STREAM_FORMATS:
        raise MediaError(
            f"the scheme of a stream must be one of {', '.join(STREAM_FORMATS)}; got {url!r}"
        )
    return STREAM_FORMATS[scheme.lower()]


class SinkBase:
    """Base class of sinks: closed at the end of the block, also on errors; without audio."""

    frames_written = 0
    siting: ChromaSiting = "left"
    """Position of chroma samples that readers of the output assume."""

    def write(self, frame: av.VideoFrame) -> None:
        """Write the next frame."""
        raise NotImplementedError

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Discard an audio packet."""

    def close(self) -> None:
        """Finish the output."""

    def abort(self) -> None:
        """Stop immediately."""
        self.close()

    def __enter__(self) -> Any:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None or isinstance(error, KeyboardInterrupt):
            self.close()
        else:
            self.abort()


class StreamSink(SinkBase):
    """Video stream to an address: MPEG-TS over UDP, TCP, HTTP or SRT, or a push to an RTSP or RTMP
    server.

    Parameters
    ----------
    url
        Address, for example ``udp://127.0.0.1:5000``; protocol options follow a question mark.
    size, frame_rate, **encoding
        As for :class:`Encoder`, in low-latency mode.

    Raises
    ------
    MediaError
        If the scheme is unknown, or the connection fails.
    """

    def __init__(
        self, url: str, size: tuple[int, int], frame_rate: Fraction | float, **encoding: Any
    ) -> None:
        container_format = stream_format(url)
        codec = encoding.setdefault("codec", DEFAULT_CODEC)
        key_frames = {"g": str(max(1, round(KEY_FRAME_INTERVAL_S * float(frame_rate))))}
        encoding["options"] = {
            **key_frames,
            **LIVE_OPTIONS.get(codec, {}),
            **encoding.get("options", {}),
        }
        with media_errors(url):
            self._encoder = Encoder(
                url, size, frame_rate, container_format=container_format, is_live=True, **encoding
            )
        self.siting = siting_of(codec)
        self.notes = [f"{url}: {self._encoder.losses}"] if self._encoder.losses else []
        """Remarks on the stream for the user, in sentences."""
        self._is_open = True

    def write(self, frame: av.VideoFrame) -> None:
        """Encode and send a frame."""
        self._encoder.encode(frame)
        self.frames_written += 1

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Write an audio packet."""
        self._encoder.copy(packet)

    def close(self) -> None:
        """Send the remaining data and close the connection."""
        if self._is_open:
            self._is_open = False
            self._encoder.finish()

    def abort(self) -> None:
        """Stop immediately."""
        if self._is_open:
            self._is_open = False
            self._encoder.discard()


class PipeSink(SinkBase):
    """Uncompressed frames on a pipe, for another program.

    Parameters
    ----------
    kind
        ``"y4m"``: YUV4MPEG2 with size, rate, bit depth and chroma subsampling in its header;
        ``"rawvideo"``: pixels only.
    frame_rate : frames per second
        Frame rate in the header of y4m.
    pixel_format
        Pixel format of rawvideo: ``"rgb24"``, ``"bgr24"``, ``"gray"``, ``"yuv420p"`` and others
        that NumPy supports.
    stream
        Output stream; standard output by default.

    Raises
    ------
    InvalidParameter
        If the kind is unknown.
    """

    def __init__(
        self,
        kind: Literal["y4m", "rawvideo"],
        frame_rate: Fraction | float,
        pixel_format: str = "rgb24",
        stream: BinaryIO | None = None,
    ) -> None:
        if kind not in ("y4m", "rawvideo"):
            raise InvalidParameter(f"kind must be y4m or rawvideo; got {kind!r}")
        self._stream = stream or sys.stdout.buffer
        self.siting = "center" if kind == "y4m" else "left"
        self._rate = Fraction(frame_rate).limit_denominator(1_000_000)
        self._is_y4m, self._pixel_format = kind == "y4m", pixel_format

    def write(self, frame: av.VideoFrame) -> None:
        """Write a frame to the pipe.

        Raises
        ------
        BrokenPipeError
            If the reader closes the pipe.
        MediaError
            If another error of the pipe occurs.
        """
        try:
            if self._is_y4m:
                self._write_y4m(frame)
            else:
                self._stream.write(converted(frame, self._pixel_format).to_ndarray().data)
            self._stream.flush()
        except BrokenPipeError:
            raise
        except ValueError as e:
            raise MediaError(
                f"cannot write frames of pixel format {self._pixel_format}: {e}"
            ) from None
        except OSError as e:
            raise MediaError(f"cannot write to the pipe: {e.strerror or e}") from None
        self.frames_written += 1

    def _write_y4m(self, frame: av.VideoFrame) -> None:
        is_full = is_full_range(frame)
        is_yuv = frame.format.name.startswith(("yuv", "nv"))  # RGB images are left-sited by default
        kind = replace(PixelFormat.of(frame.format.name), alpha=False) if is_yuv else PixelFormat()
        frame = (
            frame
            if frame.format.name.replace("yuvj", "yuv") == kind.name
            else converted(frame, kind.name)
        )
        if not self.frames_written:
            rate = f"{self._rate.numerator}:{self._rate.denominator}"
            colours = "FULL" if is_full else "LIMITED"
            plain = "420jpeg" if kind.colours == "420" else kind.colours
            sampled = plain if kind.bits == 8 else f"{kind.colours}p{kind.bits}"
            head = f"YUV4MPEG2 W{frame.width} H{frame.height} F{rate} Ip A1:1 C{sampled} XCOLORRANGE={colours}\n"
            self._stream.write(head.encode())
        self._stream.write(b"FRAME\n")
        for plane in planes(frame):
            self._stream.write(plane.tobytes())


class VirtualCamera(SinkBase):
    """Virtual camera for other programs, if the kernel has v4l2loopback.

    Raises
    ------
    MediaError
        If there is no such virtual camera.
    """

    def __init__(self, device: str, size: tuple[int, int], frame_rate: Fraction | float) -> None:
        name = Path(device).name
        if not (VIRTUAL_CAMERAS / name).exists():
            names = (
                sorted(path.name for path in VIRTUAL_CAMERAS.glob("video*"))
                if VIRTUAL_CAMERAS.is_dir()
                else []
            )
            available = ", ".join(f"/dev/{n}" for n in names) or "none available"
            raise MediaError(
                f"the output must be a virtual camera ({available}); got {device}; on Linux, "
                "'sudo modprobe v4l2loopback' creates one if the module is installed"
            )
        with media_errors(device):
            self._encoder = Encoder(
                device, size, frame_rate, codec="rawvideo", container_format="v4l2"
            )
        self._is_open = True

    def write(self, frame: av.VideoFrame) -> None:
        """Output a frame."""
        self._encoder.encode(frame)
        self.frames_written += 1

    def close(self) -> None:
        """Release the camera."""
        if self._is_open:
            self._is_open = False
            self._encoder.discard()


class Preview(SinkBase):
    """Preview window; Escape, q or closing the window stops as Ctrl-C does.

    The window does not block: frames that arrive while another is drawn are dropped.

    Parameters
    ----------
    size : (width, height) px
        Size of the frames; the window is smaller on small screens.

    Raises
    ------
    MediaError
        If there is no display, or Python has no Tk.
    """

    def __init__(self, size: tuple[int, int], title: str = "omnimirror") -> None:
        if sys.platform.startswith("linux") and not (
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        ):
            raise MediaError("a preview window requires a display")
        if find_spec("tkinter") is None or find_spec("_tkinter") is None:
            raise MediaError(
                "a preview window requires Tk for Python; on Debian: apt install python3-tk"
            )
        self._newest: Image | None = None
        self._changed = threading.Condition()
        self._is_closing = False
        command = [sys.executable, "-m", "omnimirror.io._preview_window", *map(str, size), title]
        # In a separate session, the window does not receive signals of the terminal.
        try:
            with interrupts.postponed():
                self._window = Popen(
                    command, stdin=PIPE, stdout=PIPE, stderr=PIPE, start_new_session=True
                )
            assert self._window.stdout is not None
            is_open = self._window.stdout.readline().strip() == b"ready"
        except KeyboardInterrupt:
            self._window.kill()
            self._window.communicate()
            raise
        if not is_open:
            _, stderr = self._window.communicate()
            reason = (stderr.decode(errors="replace").strip().splitlines() or ["unknown reason"])[
                -1
            ]
            raise MediaError(f"cannot open a preview window: {reason}")
        self._thread = threading.Thread(target=self._feed, name="preview", daemon=True)
        self._thread.start()

    def write(self, frame: av.VideoFrame) -> None:
        """Show a frame, unless an earlier one is still being drawn."""
        if self._newest is None:
            image = image_of_frame(frame)
            with self._changed:
                self._newest = image
                self._changed.notify()
        self.frames_written += 1

    def _feed(self) -> None:
        pipe = self._window.stdin
        assert pipe is not None
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest is not None or self._is_closing)
                image = self._newest
            if image is None:
                break
            try:
                pipe.write(image.data)
            except OSError:  # the window was closed
                interrupts.request()
                break
            self._newest = None
        with suppress(OSError):
            pipe.close()

    def close(self) -> None:
        """Close the window after the last frame."""
        with self._changed:
            self._is_closing = True
            self._changed.notify()
        self._thread.join()
        self._window.wait()
        for pipe in (self._window.stdout, self._window.stderr):
            if pipe is not None:
                pipe.close()


class Tee(SinkBase):
    """Several sinks for the same frames, such as a file and a preview.

    Chroma is sited for the first sink.
    """

    def __init__(self, *sinks: Any) -> None:
        self._sinks = sinks
        self.siting = sinks[0].siting

    def write(self, frame: av.VideoFrame) -> None:
        """Write the frame to all sinks."""
        times = frame.pts, frame.time_base, frame.duration
        for sink in self._sinks:
            frame.pts, frame.time_base, frame.duration = times  # writers set their own times
            sink.write(frame)
        self.frames_written += 1

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Write a copy of the packet to each sink, since writers change its times."""
        copies = [_copy_packet(packet) for _ in self._sinks[1:]]
        for sink, copy in zip(self._sinks, [packet, *copies], strict=True):
            sink.write_packet(copy)

    def close(self) -> None:
        """Close all sinks, even if closing one of them fails."""
        with ExitStack() as stack:
            for sink in reversed(self._sinks):
                stack.callback(sink.close)

    def abort(self) -> None:
        """Abort all sinks."""
        for sink in self._sinks:
            sink.abort()


def _copy_packet(packet: Packet[AudioStream]) -> Packet[AudioStream]:
    copy: Any = Packet(bytes(packet))
    copy.stream = packet.stream
    copy.pts, copy.dts, copy.duration = packet.pts, packet.dts, packet.duration
    copy.time_base, copy.is_keyframe = packet.time_base, packet.is_keyframe
    return copy  # type: ignore[no-any-return]  # the type depends on the argument
