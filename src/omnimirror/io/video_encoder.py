"""Encoding of frames and muxing with copied audio, through PyAV, for files and streams."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import av
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from ..base.errors import InvalidParameter, MediaError, OmnimirrorError
from .video_frames import (
    CHROMA_444_CODECS,
    CODECS_WITHOUT_ALPHA,
    FULL_RANGE,
    ColourCoding,
    PixelFormat,
    conversion_losses,
    converted,
    is_full_range,
    nearest_format,
)
from .video_metadata import (
    CHAPTER_FORMATS,
    DISPLAY_LOST,
    DISPLAY_OPTIONS,
    SUBTITLE_CODECS,
    Chapter,
    MasteringDisplay,
    SubtitleTrack,
    copy_track_metadata,
    dropped_data,
    holds_data,
    unsupported_tracks,
)

DEFAULT_CODEC = "libx264"
KNOWN_CODECS = ("libx264", "libx265", "libsvtav1", "libvpx-vp9", "mpeg4", "mjpeg", "ffv1")
CODECS_WITHOUT_COLOUR_CODING = ("mpeg4",)
"""Codecs that cannot store the colour coding; decoders assume limited range."""
ADDED_OPTIONS = {
    "libx265": {"x265-params": "log-level=none"},  # suppresses output on the terminal
    "libvpx-vp9": {"b": "0"},  # otherwise the quality is that of a low bit rate
}
MPEG_TS_AUDIO_CODECS = ("aac", "mp3", "mp3float", "mp2", "ac3", "eac3", "opus", "dca")
"""Audio codecs that players detect in MPEG-TS; others are muxed without a usable type."""
CONTAINER_METADATA = ("major_brand", "minor_version", "compatible_brands", "encoder", "ENCODER")
"""Metadata of the source's container, which do not apply to its content."""


class Writable(Protocol):
    """Byte output."""

    def write(self, data: bytes, /) -> int:
        """Write bytes; return their number."""
        ...


class Encoder:
    """Encoder of frames, with muxing of copied audio, for files and streams.

    Parameters
    ----------
    target
        File name or address, or an object with a method ``write`` for bytes.
    size : (width, height) px
    frame_rate : frames per second
        Mean frame rate for the rate control of the encoder; every frame keeps its own time.
    time_base : s, optional
        Unit of the frame times; the frame interval by default.
    codec
        FFmpeg encoder.
    crf
        Constant rate factor, smaller is better; the default of the encoder if None.
    options
        Other options of the encoder, such as ``{"preset": "fast"}``.
    source_format
        Pixel format of the input: bit depth, chroma subsampling and transparency are kept if the
        codec supports them, and ``losses`` describes the losses. RGB images become 4:2:0 if players
        expect it.
    pixel_format
        Encoded pixel format, regardless of the input.
    colour
        Colour coding; frames of images are converted to it.
    display
        Metadata of the HDR mastering display; ``losses`` reports if the codec does not support it.
    rotation_deg : deg
        Rotation in the metadata, counter-clockwise.
    pixel_aspect
        Width of a pixel divided by its height.
    audio
        Audio streams whose packets are copied.
    subtitles
        Text subtitle streams, whose packets are converted for the container; ``dropped_tracks``
        reports unsupported ones.
    data
        Data streams whose packets are copied; ``dropped_data`` reports unsupported ones.
    chapters
        Chapters; ``dropped_tracks`` reports if the container does not support them.
    start_time_s : s
        Offset of the times of all frames and packets.
    metadata
        Title, time, place and other metadata.
    container_format
        Container format; by default from the name of the target.
    container_options
        Options of the container format.
    is_live
        Use slice threads instead of frame threads, which reduces the latency.

    Raises
    ------
    MediaError
        If the codec is unknown or not supported by the format, or the format does not support the
        audio.
    InvalidParameter
        If the codec does not support the image size.
    """

    def __init__(
        self,
        target: str | Writable,
        size: tuple[int, int],
        frame_rate: Fraction | float,
        time_base: Fraction | None = None,
        codec: str = DEFAULT_CODEC,
        crf: int | None = None,
        options: Mapping[str, str] | None = None,
        source_format: str = "yuv420p",
        pixel_format: str | None = None,
        colour: ColourCoding | None = None,
        display: MasteringDisplay | None = None,
        rotation_deg: int = 0,
        pixel_aspect: Fraction = Fraction(1),
        audio: Sequence[AudioStream] = (),
        subtitles: Sequence[Any] = (),
        data: Sequence[Any] = (),
        chapters: Sequence[Chapter] = (),
        start_time_s: Fraction = Fraction(0),
        metadata: Mapping[str, str] | None = None,
        container_format: str | None = None,
        container_options: Mapping[str, str] | None = None,
        is_live: bool = False,
    ) -> None:
        # More than 60 lines: 23 parameters, each set once, in the order that FFmpeg requires.
        self.size, self.frames_written, self._latest_pts = size, 0, -(2**62)
        self.target, self.codec = target if isinstance(target, str) else "the stream", codec
        rate = Fraction(frame_rate).limit_denominator(1_000_000)
        encoder_options = _options(codec, crf, options or {})
        display_options = (display or MasteringDisplay()).options(codec)
        if display_options:
            name = DISPLAY_OPTIONS[codec]
            encoder_options[name] = ":".join(
                filter(None, [display_options, encoder_options.get(name)])
            )
        self.container: OutputContainer = av.open(
            target, "w", format=container_format, container_options=dict(container_options or {})
        )
        try:
            self._stream = self._video_stream(codec, rate, encoder_options)
            context = self._stream.codec_context
            self._time_base = time_base or 1 / rate
            context.time_base = self._stream.time_base = self._time_base
            self.pixel_format = context.pix_fmt = _pixel_format(
                context.codec, size, source_format, pixel_format
            )
            self.losses = (
                ""
                if pixel_format
                else conversion_losses(source_format, PixelFormat.of(self.pixel_format))
            )
            """Losses of images in the pixel format ``source_format``, as a phrase."""
            context.width, context.height = size
            context.thread_type = "SLICE" if is_live else "AUTO"
            context.sample_aspect_ratio = pixel_aspect
            self._set_colour(colour, display, display_options)
            if rotation_deg:
                self._stream.set_display_rotation(rotation_deg)
            self._start_time_s = start_time_s
            self._add_tracks(audio, subtitles, data, chapters)
            content_metadata = {
                key: text for key, text in (metadata or {}).items() if key not in CONTAINER_METADATA
            }
            self.container.metadata.update(content_metadata)
            with media_errors(self.target):
                context.open()
                self._begin(audio)
        except BaseException:
            self.discard()
            raise

    def _set_colour(
        self,
        colour: ColourCoding | None,
        display: MasteringDisplay | None,
        display_options: str | None,
    ) -> None:
        """Set the colour coding, and append its losses in this codec to ``losses``."""
        self.colour = (
            ColourCoding()
            if colour is None or self.codec in CODECS_WITHOUT_COLOUR_CODING
            else colour
        )
        self.colour.apply_to(self._stream.codec_context)
        if (
            colour is not None
            and colour.is_hdr
            and (self.colour != colour or PixelFormat.of(self.pixel_format).bits < 10)
        ):
            loss = (
                "HDR tags are lost" if self.colour != colour else "HDR with 8 bits causes banding"
            )
            self.losses = ", ".join(filter(None, [self.losses, loss]))
        if display_options is None and display not in (None, MasteringDisplay()):
            self.losses = ", ".join(filter(None, [self.losses, DISPLAY_LOST]))

    def _add_tracks(
        self,
        audio: Sequence[AudioStream],
        subtitles: Sequence[Any],
        data: Sequence[Any],
        chapters: Sequence[Chapter],
    ) -> None:
        """Add the tracks that the container supports; note the others."""
        self._copied: dict[int, Any] = {
            stream.index: self._audio_stream(stream) for stream in audio
        }
        name = self.container.format.name
        self.dropped_tracks = unsupported_tracks(name, audio, subtitles, chapters)
        """Subtitles and chapters that the container does not support, as a phrase."""
        supported = subtitles if name in SUBTITLE_CODECS else ()
        self._subtitles = {
            stream.index: SubtitleTrack(self.container, stream) for stream in supported
        }
        self.dropped_data = dropped_data(name, data)
        """Data tracks that the container does not support, as a phrase."""
        self._copied |= {
            stream.index: self._data_stream(stream) for stream in data if holds_data(name, stream)
        }
        if chapters and name in CHAPTER_FORMATS:
            shifted = (
                c._replace(
                    start_s=c.start_s + self._start_time_s, end_s=c.end_s + self._start_time_s
                )
                for c in chapters
            )
            self.container.set_chapters(
                [chapter.to_av(number) for number, chapter in enumerate(shifted, 1)]
            )

    def encode(self, frame: av.VideoFrame, is_key: bool = False) -> None:
        """Encode a frame with its time and colour coding; packed pixel formats are converted.

        ``is_key`` forces a key frame, if the codec has them.
        """
        if (frame.width, frame.height) != self.size:
            raise InvalidParameter(
                f"frames of {self.target} must have {self.size[0]} x {self.size[1]} px; "
                f"got {frame.width} x {frame.height} px"
            )
        frame = self._converted(frame)
        self._set_time(frame)
        # key frames of the source are not forced
        frame.pict_type = (
            av.video.frame.PictureType.I if is_key else av.video.frame.PictureType.NONE
        )
        with media_errors(self.target):
            self.container.mux(self._stream.encode(frame))
        self.frames_written += 1

    def _converted(self, frame: av.VideoFrame) -> av.VideoFrame:
        """Return the frame in the pixel format and colour coding of the target."""
        is_yuv = frame.format.name.startswith(("yuv", "nv"))
        if not is_yuv:  # the target determines the conversion to luma and chroma
            frame.colorspace, frame.color_range = self.colour.space, self.colour.range
            return converted(frame, self.pixel_format)
        is_full = is_full_range(frame)
        if is_full != self.colour.is_full_range:
            return converted(frame, self.pixel_format, dst_color_range=1 if is_full else FULL_RANGE)
        return (
            frame if frame.format.name == self.pixel_format else converted(frame, self.pixel_format)
        )

    def _set_time(self, frame: av.VideoFrame) -> None:
        """Set increasing times in the unit of the target, as encoders and players require."""
        if frame.pts is None:
            pts = self._latest_pts + round(
                1 / self._stream.codec_context.framerate / self._time_base
            )
        else:
            pts = round(
                (frame.pts * (frame.time_base or self._time_base) + self._start_time_s)
                / self._time_base
            )
        if frame.duration and frame.time_base:
            frame.duration = round(frame.duration * frame.time_base / self._time_base)
        if self.frames_written:
            pts = max(pts, self._latest_pts + 1)
        elif frame.pts is None:
            pts = 0
        frame.pts = self._latest_pts = pts
        frame.time_base = self._time_base

    def copy(self, packet: Packet[AudioStream]) -> None:
        """Write a packet of an audio, subtitle or data stream."""
        output: Packet[Any] | None = None
        if packet.size and (stream := self._copied.get(packet.stream_index)) is not None:
            packet.stream, output = stream, packet
        elif packet.size and (track := self._subtitles.get(packet.stream_index)) is not None:
            output = track.packet(packet)
        if output is None:
            return
        if self._start_time_s:
            shift = round(self._start_time_s / output.time_base)
            output.pts = None if output.pts is None else output.pts + shift
            output.dts = None if output.dts is None else output.dts + shift
        with media_errors(self.target):
            self.container.mux(output)

    def finish(self) -> None:
        """Flush the encoder, and write the trailer."""
        with media_errors(self.target):
            self.container.mux(self._stream.encode(None))
            self.container.close()

    def discard(self) -> None:
        """Close the target without a trailer."""
        with suppress(av.FFmpegError, OSError, ValueError):
            self.container.close()

    def _video_stream(self, codec: str, rate: Fraction, options: dict[str, str]) -> VideoStream:
        name = self.container.format.name
        try:
            stream = self.container.add_stream(codec, rate=rate, options=options)
        except ValueError:
            raise MediaError(
                f"{name} does not support the video codec {codec}; use .mp4 or .mkv"
            ) from None
        assert isinstance(stream, VideoStream)
        return stream

    def _audio_stream(self, source: AudioStream) -> AudioStream:
        is_private = (
            self.container.format.name == "mpegts"
            and source.codec_context.name not in MPEG_TS_AUDIO_CODECS
        )
        try:
            if not is_private:
                stream = self.container.add_stream_from_template(source)
                copy_track_metadata(stream, source, self.container.format.name)
                return stream
        except ValueError:
            pass
        raise self._unsupported_audio(source)

    def _data_stream(self, source: Any) -> Any:
        stream: Any = self.container.add_data_stream(source.name)
        copy_track_metadata(stream, source, self.container.format.name)
        if handler := source.metadata.get("handler_name"):
            stream.metadata["handler_name"] = handler
        stream.time_base = source.time_base
        return stream

    def _begin(self, audio: Sequence[AudioStream]) -> None:
        """Write the header now: unsupported streams raise an error before any work."""
        try:
            self.container.start_encoding()
        except (av.error.ArgumentError, av.error.InvalidDataError, av.error.PatchWelcomeError):
            supported = self.container.supported_codecs
            for stream in audio:
                if stream.codec_context and stream.codec_context.name not in supported:
                    raise self._unsupported_audio(stream) from None
            raise

    def _unsupported_audio(self, source: AudioStream) -> MediaError:
        codec = source.codec_context.name if source.codec_context else "unknown"
        return MediaError(
            f"{self.container.format.name} does not support the audio codec of the source, "
            f"{codec}; write to .mkv, or omit the audio"
        )


MAX_CRF = 63
"""Largest constant rate factor of AV1 and VP9; H.264 and H.265 use 51 for larger ones."""


def _options(codec: str, crf: int | None, options: Mapping[str, str]) -> dict[str, str]:
    """Return the options of the encoder after checking that it has them all."""
    try:
        context = av.CodecContext.create(codec, "w")
    except ValueError:
        raise MediaError(
            f"codec must be an FFmpeg encoder such as {', '.join(KNOWN_CODECS)}; got {codec!r}"
        ) from None
    if codec == "libsvtav1":
        os.environ.setdefault("SVT_LOG", "0")  # suppresses terminal output
    if context.type != "video":
        raise MediaError(
            f"codec must be a video encoder such as {', '.join(KNOWN_CODECS)}; got {codec!r}"
        )
    supported = {
        option.name
        for option in (*context.supported_options.generic, *context.supported_options.private)
    }
    if crf is not None and not 0 <= crf <= MAX_CRF:
        raise InvalidParameter(f"crf must be between 0 and {MAX_CRF}; got {crf}")
    encoder_options = {**({} if crf is None else {"crf": str(crf)}), **options}
    for name in encoder_options:
        if name not in supported:
            raise MediaError(f"options must be supported by the encoder {codec}; got {name!r}")
    for name, value in ADDED_OPTIONS.get(codec, {}).items():
        encoder_options.setdefault(name, value)
    return encoder_options


def _pixel_format(
    codec: Any, size: tuple[int, int], source_format: str, requested: str | None
) -> str:
    """Return the requested pixel format, or that closest to the input; check the image size."""
    supported = [pixel_format.name for pixel_format in codec.video_formats or []]
    if requested is not None and supported and requested not in supported:
        raise InvalidParameter(
            f"pixel_format must be one of {', '.join(supported)} for {codec.name}; got {requested}"
        )
    chosen = requested or nearest_format(_required_format(codec.name, source_format), supported)
    try:
        kind = PixelFormat.of(chosen)
    except ValueError:
        raise InvalidParameter(
            f"pixel_format must be one of FFmpeg, such as yuv420p or yuv422p10le; got {chosen}"
        ) from None
    sides = [
        side + (side % 2 if is_even else 0) for side, is_even in zip(size, kind.even, strict=True)
    ]
    if sides != [*size] and codec.name not in CHROMA_444_CODECS:
        raise InvalidParameter(
            f"the size of a video encoded by {codec.name} must be even because of chroma "
            f"subsampling, such as {sides[0]} x {sides[1]} px; got {size[0]} x {size[1]} px"
        )
    return chosen


def _required_format(codec: str, source_format: str) -> PixelFormat:
    """Return the required properties of the pixel format of an encoder."""
    kind = PixelFormat.of(source_format)
    is_yuv = source_format.startswith(("yuv", "nv", "p0", "p2", "p4"))
    if not is_yuv and codec not in CHROMA_444_CODECS:
        kind = replace(kind, colours="420", bits=min(kind.bits, 10))
    return replace(kind, alpha=kind.alpha and codec not in CODECS_WITHOUT_ALPHA)


@contextmanager
def media_errors(target: str | Path) -> Iterator[None]:
    """Convert errors of FFmpeg and the operating system to messages."""
    try:
        yield
    except (MediaError, InvalidParameter):
        raise
    except BrokenPipeError as e:
        raise MediaError(f"cannot write {target}: the receiver closed the connection") from e
    except (av.FFmpegError, OSError) as e:
        raise MediaError(f"cannot write {target}: {getattr(e, 'strerror', None) or e}") from None
    except OmnimirrorError as e:
        raise MediaError(str(e)) from None
