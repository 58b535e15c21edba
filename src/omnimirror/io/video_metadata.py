"""Metadata of videos: tracks, chapters, timecode and HDR mastering display."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import av
from av.packet import Packet
from av.sidedata.sidedata import Type as SideData

# -- Tracks and chapters ---------------------------------------------------------------------------

TEXT_SUBTITLES = ("subrip", "ass", "webvtt", "mov_text", "text")
"""Codecs of text subtitles, which containers store in different forms; others are images."""
SUBTITLE_CODECS = {
    "mp4": ("mov_text",),
    "mov": ("mov_text",),
    "ipod": ("mov_text",),
    "matroska": ("subrip", "ass", "webvtt"),
    "webm": ("webvtt",),
}
"""Text subtitle codecs by container format; others are converted to the first."""
NO_TEXT = b"\0\0"
"""Length field of a sample of 3GPP timed text without text."""
CHAPTER_FORMATS = tuple(SUBTITLE_CODECS)
TRACK_METADATA = {"title": "title", "name": "title", "comment": "comment"}
"""Metadata of a track that are kept, and their names in the output (MP4 calls the title a name)."""
FORMATS_WITHOUT_TITLES = ("ipod", "mpegts")
QUICKTIME_LANGUAGES = frozenset(
    [
        "eng",
        "fra",
        "ger",
        "ita",
        "dut",
        "sve",
        "spa",
        "dan",
        "por",
        "nor",
        "heb",
        "jpn",
        "ara",
        "fin",
        "gre",
        "ice",
        "mlt",
        "tur",
        "chi",
        "urd",
        "hin",
        "tha",
        "kor",
        "lit",
        "pol",
        "hun",
        "est",
        "lav",
        "rus",
        "alb",
        "ron",
        "ces",
        "slk",
        "slv",
        "yid",
        "mac",
        "bul",
        "ukr",
        "bel",
        "uzb",
        "kaz",
        "aze",
        "arm",
        "geo",
        "mol",
        "kir",
        "tgk",
        "tuk",
        "mon",
        "pus",
        "kur",
        "kas",
        "snd",
        "tib",
        "nep",
        "san",
        "mar",
        "ben",
        "asm",
        "guj",
        "ori",
        "mal",
        "kan",
        "tam",
        "tel",
        "bur",
        "khm",
        "lao",
        "vie",
        "ind",
        "tgl",
        "may",
        "amh",
        "tir",
        "orm",
        "som",
        "swa",
        "run",
        "mlg",
        "epo",
        "wel",
        "baq",
        "cat",
        "lat",
        "que",
        "grn",
        "aym",
        "tat",
        "uig",
        "dzo",
        "jav",
    ]
)
"""Languages that FFmpeg writes to QuickTime files."""
QUICKTIME_LANGUAGE_CODES = {
    "deu": "ger",
    "fre": "fra",
    "nld": "dut",
    "swe": "sve",
    "ell": "gre",
    "isl": "ice",
    "zho": "chi",
    "sqi": "alb",
    "rum": "ron",
    "cze": "ces",
    "slo": "slk",
    "mkd": "mac",
    "hye": "arm",
    "kat": "geo",
    "bod": "tib",
    "mya": "bur",
    "msa": "may",
    "cym": "wel",
    "eus": "baq",
}
"""Alternative codes of ISO 639-2 for them."""
DATA_OF = {"mp4": ("bin_data",), "mpegts": ("klv", "timed_id3")}
"""Data codecs by container format, in which FFmpeg keeps their identification.

In MP4 and MOV files, FFmpeg calls GPMF telemetry (gpmd) ``bin_data``, and writes all ``bin_data``
as gpmd; in other files ``bin_data`` is of any kind.
"""
DATA_KEEPERS = ".mp4 supports GPMF telemetry, .ts supports KLV and ID3"
NO_PACKETS = 48
"""Value of ``discard`` for tracks that FFmpeg reads as other information, such as the text of chapters."""
ARBITRARY_ORIGIN_FORMATS = ("mpegts", "mpeg")
"""Formats with an arbitrary time origin, whose start time has no meaning."""
MILLISECOND = Fraction(1, 1000)


class Chapter(NamedTuple):
    """Chapter of a video, times in s."""

    start_s: Fraction
    end_s: Fraction
    metadata: dict[str, str]

    def to_av(self, number: int) -> Any:
        """Return the chapter as PyAV expects it."""
        start, end = (round(time / MILLISECOND) for time in (self.start_s, self.end_s))
        return {
            "id": number,
            "start": start,
            "end": end,
            "time_base": MILLISECOND,
            "metadata": self.metadata,
        }


def chapters_between(container: Any, start: Fraction, end: Fraction | None) -> tuple[Chapter, ...]:
    """Return the chapters of a file between two times (s), with times relative to the start."""
    chapters = []
    for chapter in container.chapters():
        first, last = (chapter[key] * chapter["time_base"] for key in ("start", "end"))
        last = last if end is None else min(last, end)
        if last > max(first, start):
            chapters.append(
                Chapter(max(first, start) - start, last - start, dict(chapter["metadata"]))
            )
    return tuple(chapters)


def text_subtitles(container: Any) -> tuple[Any, ...]:
    """Return the subtitle streams of a file that are text."""
    return tuple(
        stream for stream in container.streams.subtitles if _codec(stream) in TEXT_SUBTITLES
    )


def data_streams(container: Any) -> tuple[Any, ...]:
    """Return the data streams of a file, without chapters and timecodes, which are read as such."""
    return tuple(
        stream
        for stream in container.streams.data
        if stream.discard != NO_PACKETS and "timecode" not in stream.metadata
    )


def holds_data(format_name: str, stream: Any) -> bool:
    """Return whether a container format can store a data stream."""
    if stream.name == "bin_data" and "mp4" not in stream.container.format.name.split(","):
        return False
    return stream.name in DATA_OF.get(format_name, ())


def dropped_data(format_name: str, data: Sequence[Any]) -> str:
    """Describe the data tracks that a format does not support; empty if it supports all."""
    return " and ".join(
        _data_track(stream) for stream in data if not holds_data(format_name, stream)
    )


def _data_track(stream: Any) -> str:
    """Return a description of a data track, for example "data track 3 (GoPro MET)"."""
    names = (stream.metadata.get(key) for key in ("handler_name", "name", "title"))
    name = next((name.strip() for name in names if name and name.strip()), stream.name)
    return f"data track {stream.index} ({name or 'of an unknown kind'})"


def dropped_tracks(container: Any) -> Iterable[str]:
    """Yield descriptions of the tracks of a file that no output keeps."""
    images = [
        stream for stream in container.streams.subtitles if _codec(stream) not in TEXT_SUBTITLES
    ]
    if images:
        yield f"{_number(images, 'subtitle track')} with images instead of text"
    if container.streams.attachments:
        yield _number(container.streams.attachments, "attachment")
    if len(container.streams.video) > 1:
        yield _number(container.streams.video[1:], "further video track")
    for stream in data_streams(container):
        if not any(holds_data(format_name, stream) for format_name in DATA_OF):
            yield _data_track(stream)


def unsupported_tracks(
    format_name: str, audio: Sequence[Any], subtitles: Sequence[Any], chapters: Sequence[Chapter]
) -> str:
    """Describe the tracks and chapters that a format does not support; empty if it supports all.

    >>> unsupported_tracks("mpegts", (), (), (Chapter(Fraction(0), Fraction(1), {}),))
    '1 chapter'
    """
    unsupported = []
    if format_name == "mov":
        languages = dict.fromkeys(
            language_code(format_name, track) for track in (*audio, *subtitles)
        )
        unsupported += [
            f"the language {name!r}"
            for name in languages
            if name and name not in QUICKTIME_LANGUAGES
        ]
    if format_name in FORMATS_WITHOUT_TITLES and any(
        {"title", "name"} & set(track.metadata) for track in (*audio, *subtitles)
    ):
        unsupported.append("the titles of tracks")
    if chapters and format_name not in CHAPTER_FORMATS:
        unsupported.append(_number(chapters, "chapter"))
    if subtitles and format_name not in SUBTITLE_CODECS:
        unsupported.append(_number(subtitles, "subtitle track"))
    return " and ".join(unsupported)


def language_code(format_name: str, source: Any) -> str:
    """Return the code of a track's language in a format; empty if it is unknown."""
    language = str(source.metadata.get("language", "und"))
    if format_name == "mov":
        language = QUICKTIME_LANGUAGE_CODES.get(language, language)
    return "" if language == "und" else language


def copy_track_metadata(stream: Any, source: Any, format_name: str) -> None:
    """Copy language, title and disposition of a track to the output."""
    stream.metadata.update(
        {
            TRACK_METADATA[key]: text
            for key, text in source.metadata.items()
            if key in TRACK_METADATA
        }
    )
    if language := language_code(format_name, source):
        stream.metadata["language"] = language
    stream.disposition = source.disposition


class SubtitleTrack:
    """Text subtitles, converted to the form of the output container.

    Parameters
    ----------
    container
        Output file, before its header is written.
    source
        Source subtitle stream.
    """

    def __init__(self, container: Any, source: Any) -> None:
        supported, codec = SUBTITLE_CODECS[container.format.name], _codec(source)
        self._source = source
        self._is_same = codec in supported
        if self._is_same:
            self._stream = container.add_stream_from_template(source)
            # The MP4 muxer ends a text when a packet of any track passes it, and compares ticks of
            # different lengths: ticks longer than those of the video end it in time.
            self._stream.time_base = MILLISECOND
        else:
            source.codec_context.open(strict=False)
            self._stream = container.add_stream(supported[0])
            context = self._stream.codec_context
            context.subtitle_header = source.codec_context.subtitle_header
            context.time_base = self._stream.time_base = MILLISECOND
        copy_track_metadata(self._stream, source, container.format.name)

    def packet(self, packet: Packet[Any]) -> Packet[Any] | None:
        """Return a packet of the source in the output form; None if it has no text."""
        if self._is_same:
            if _codec(self._source) == "mov_text" and bytes(packet)[:2] == NO_TEXT:
                return None  # a pause; the muxer inserts its own, and another delays what follows
            packet.stream = self._stream
            return packet
        decoded = self._source.codec_context.decode2(packet)
        if decoded is None or not len(decoded):
            return None
        try:
            output: Any = self._stream.codec_context.encode_subtitle(decoded)
        except av.FFmpegError:  # empty text
            return None
        output.pts, output.dts, output.duration = packet.pts, packet.dts, packet.duration
        output.time_base, output.stream = packet.time_base, self._stream
        return output if output.size else None


def _codec(stream: Any) -> str:
    context = stream.codec_context
    return "" if context is None else str(context.codec.canonical_name)


def _number(items: Sequence[object], noun: str) -> str:
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


# -- SMPTE timecodes of frames (ST 12) -------------------------------------------------------------


def read_timecode(metadata: Iterable[Mapping[str, str]]) -> str | None:
    """Return the first timecode in the metadata of a file and its streams."""
    timecodes = (
        text for part in metadata for key, text in part.items() if key.lower() == "timecode"
    )
    return next(timecodes, None)


def advance_timecode(timecode: str, frames: int, rate: Fraction) -> str:
    """Add a number of frames to a timecode; a semicolon marks drop-frame timecode.

    >>> [advance_timecode(t, 1, Fraction(30000, 1001)) for t in ("00:00:59;29", "00:09:59;29")]
    ['00:01:00;02', '00:10:00;00']
    >>> advance_timecode("23:59:59:24", 26, Fraction(25))
    '00:00:01:00'
    """
    parts = re.fullmatch(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d+)", timecode)
    if parts is None:
        return timecode
    hours, minutes, seconds, frame = (int(parts[i]) for i in (1, 2, 3, 5))
    per_second = round(rate)
    dropped = per_second // 15 if parts[4] != ":" else 0  # per minute, except every tenth
    per_minute = 60 * per_second - dropped
    per_ten_minutes = 600 * per_second - 9 * dropped
    minutes += 60 * hours
    count = (
        (60 * minutes + seconds) * per_second + frame - dropped * (minutes - minutes // 10) + frames
    )
    tens, rest = divmod(count % (144 * per_ten_minutes), per_ten_minutes)
    number = (
        rest
        + tens * 9 * dropped
        + tens * per_ten_minutes
        + (max(0, rest - dropped) // per_minute) * dropped
    )
    seconds, frame = divmod(number, per_second)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{parts[4]}{frame:02}"


# -- HDR metadata (SMPTE ST 2086, CTA-861.3) -------------------------------------------------------

DYNAMIC_HDR = {
    SideData.DYNAMIC_HDR_PLUS: "HDR10+",
    SideData.DYNAMIC_HDR_VIVID: "HDR Vivid",
    SideData.DOVI_RPU_BUFFER: "Dolby Vision",
    SideData.DOVI_METADATA: "Dolby Vision",
}
"""Dynamic metadata for the display of each image: valid only for whole images before dewarping."""
DISPLAY_OPTIONS = {"libx265": "x265-params", "libx264": "x264-params", "libsvtav1": "svtav1-params"}
"""Encoder options for the metadata, by codec; other codecs do not support it."""
DISPLAY_LOST = "HDR metadata of the mastering display are lost"


@dataclass(frozen=True)
class MasteringDisplay:
    """Mastering display of a video, and its light levels."""

    primaries: tuple[Fraction, ...] = ()
    """x and y of red, green, blue and white; empty if unknown."""
    luminance: tuple[Fraction, ...] = ()
    """Minimum and maximum luminance, cd/m2; empty if unknown."""
    light: tuple[int, ...] = ()
    """Maximum pixel luminance and maximum frame-average luminance, cd/m2; empty if unknown."""

    @classmethod
    def of(cls, side_data: Any) -> MasteringDisplay:
        """Read the side data of a frame.

        >>> MasteringDisplay.of({})
        MasteringDisplay(primaries=(), luminance=(), light=())
        """
        display = cls()
        if (mastering := side_data.get(SideData.MASTERING_DISPLAY_METADATA)) is not None:
            *parts, has_primaries, has_luminance = struct.unpack("22i", bytes(mastering)[:88])
            values = tuple(Fraction(parts[i], parts[i + 1] or 1) for i in range(0, 20, 2))
            display = cls(values[:8] if has_primaries else (), values[8:] if has_luminance else ())
        if (light := side_data.get(SideData.CONTENT_LIGHT_LEVEL)) is not None:
            levels = struct.unpack("2I", bytes(light)[:8])
            display = cls(display.primaries, display.luminance, levels)
        return display

    def options(self, codec: str) -> str | None:
        """Return the encoder options; None if the codec does not support all data.

        >>> display = MasteringDisplay(light=(1000, 400))
        >>> display.options("libx265"), display.options("ffv1")
        ('max-cll=1000,400', None)
        """
        has_mastering = bool(self.primaries and self.luminance)
        if codec not in DISPLAY_OPTIONS or bool(self.primaries) != bool(self.luminance):
            return None
        is_av1 = codec == "libsvtav1"
        names = {"libx265": ("master-display", "max-cll"), "libx264": ("mastering-display", "cll")}
        mastering, light = names.get(codec, ("mastering-display", "content-light"))
        options = []
        if has_mastering:
            xy = [f"{float(v):.6f}" if is_av1 else str(round(50_000 * v)) for v in self.primaries]
            low, high = (
                f"{float(v):.6f}" if is_av1 else str(round(10_000 * v)) for v in self.luminance
            )
            red, green, blue, white = (f"({xy[i]},{xy[i + 1]})" for i in range(0, 8, 2))
            options.append(f"{mastering}=G{green}B{blue}R{red}WP{white}L({high},{low})")
        if self.light:
            options.append(f"{light}={self.light[0]},{self.light[1]}")
        return ":".join(options)


def dynamic_hdr_names(side_data: Any) -> str:
    """Return the names of the dynamic HDR metadata as a phrase; empty if there are none."""
    return " and ".join(
        dict.fromkeys(name for kind, name in DYNAMIC_HDR.items() if side_data.get(kind) is not None)
    )
