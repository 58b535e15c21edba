"""Tracks and chapters of a video besides frames: those kept in another file, and those lost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import av
from av.packet import Packet

TEXT_SUBTITLES = ("subrip", "ass", "webvtt", "mov_text", "text")
"""Codecs of text subtitles, which containers store in different forms; others are images."""
SUBTITLES_OF = {
    "mp4": ("mov_text",),
    "mov": ("mov_text",),
    "ipod": ("mov_text",),
    "matroska": ("subrip", "ass", "webvtt"),
    "webm": ("webvtt",),
}
"""Text subtitle codecs by container format; others are converted to the first."""
WITH_CHAPTERS = tuple(SUBTITLES_OF)
OF_A_TRACK = {"title": "title", "name": "title", "comment": "comment"}
"""Metadata of a track that are kept, and their names in the output (MP4 calls the title a name)."""
WITHOUT_TITLES = ("ipod", "mpegts")
QUICKTIME = frozenset(
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
QUICKTIME_NAMES = {
    "deu": "ger", "fre": "fra", "nld": "dut", "swe": "sve", "ell": "gre", "isl": "ice", "zho": "chi", "sqi": "alb",
    "rum": "ron", "cze": "ces", "slo": "slk", "mkd": "mac", "hye": "arm", "kat": "geo", "bod": "tib", "mya": "bur",
    "msa": "may", "cym": "wel", "eus": "baq",
}  # fmt: skip
"""Alternative codes of ISO 639-2 for them."""
CLOCKED = ("mpegts", "mpeg")
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
        return {"id": number, "start": start, "end": end, "time_base": MILLISECOND, "metadata": self.metadata}


def chapters_between(container: Any, start: Fraction, end: Fraction | None) -> tuple[Chapter, ...]:
    """Return the chapters of a file between two times (s), with times relative to the start."""
    found = []
    for each in container.chapters():
        first, last = each["start"] * each["time_base"], each["end"] * each["time_base"]
        last = last if end is None else min(last, end)
        if last > max(first, start):
            found.append(Chapter(max(first, start) - start, last - start, dict(each["metadata"])))
    return tuple(found)


def text_subtitles(container: Any) -> tuple[Any, ...]:
    """Return the subtitle streams of a file that are text."""
    return tuple(stream for stream in container.streams.subtitles if _codec(stream) in TEXT_SUBTITLES)


def lost_tracks(container: Any) -> Iterable[str]:
    """Yield descriptions of the tracks of a file that no output keeps."""
    images = [stream for stream in container.streams.subtitles if _codec(stream) not in TEXT_SUBTITLES]
    if images:
        yield f"{_number(images, 'subtitle track')} with images instead of text"
    if container.streams.attachments:
        yield _number(container.streams.attachments, "attachment")
    if len(container.streams.video) > 1:
        yield _number(container.streams.video[1:], "further video track")


def lost_in(format_name: str, audio: Sequence[Any], subtitles: Sequence[Any], chapters: Sequence[Chapter]) -> str:
    """Describe the tracks and chapters that a format does not support; empty if it supports all.

    >>> lost_in("mpegts", (), (), (Chapter(Fraction(0), Fraction(1), {}),))
    '1 chapter'
    """
    lost = []
    if format_name == "mov":
        languages = dict.fromkeys(language_in(format_name, track) for track in (*audio, *subtitles))
        lost += [f"the language {name!r}" for name in languages if name and name not in QUICKTIME]
    if format_name in WITHOUT_TITLES and any({"title", "name"} & set(track.metadata) for track in (*audio, *subtitles)):
        lost.append("the titles of tracks")
    if chapters and format_name not in WITH_CHAPTERS:
        lost.append(_number(chapters, "chapter"))
    if subtitles and format_name not in SUBTITLES_OF:
        lost.append(_number(subtitles, "subtitle track"))
    return " and ".join(lost)


def language_in(format_name: str, source: Any) -> str:
    """Return the code of a track's language in a format; empty if it is unknown."""
    language = str(source.metadata.get("language", "und"))
    if format_name == "mov":
        language = QUICKTIME_NAMES.get(language, language)
    return "" if language == "und" else language


def describe(stream: Any, source: Any, format_name: str) -> None:
    """Copy language, title and disposition of a track to the output."""
    stream.metadata.update({OF_A_TRACK[key]: text for key, text in source.metadata.items() if key in OF_A_TRACK})
    if language := language_in(format_name, source):
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
        held, codec = SUBTITLES_OF[container.format.name], _codec(source)
        self._source = source
        self._is_same = codec in held
        if self._is_same:
            self._stream = container.add_stream_from_template(source)
        else:
            source.codec_context.open(strict=False)
            self._stream = container.add_stream(held[0])
            context = self._stream.codec_context
            context.subtitle_header = source.codec_context.subtitle_header
            context.time_base = self._stream.time_base = MILLISECOND
        describe(self._stream, source, container.format.name)

    def packet(self, packet: Packet[Any]) -> Packet[Any] | None:
        """Return a packet of the source in the output form; None if it has no text."""
        if self._is_same:
            packet.stream = self._stream
            return packet
        decoded = self._source.codec_context.decode2(packet)
        if decoded is None or not len(decoded):
            return None
        try:
            made: Any = self._stream.codec_context.encode_subtitle(decoded)
        except av.FFmpegError:  # empty text
            return None
        made.pts, made.dts, made.duration = packet.pts, packet.dts, packet.duration
        made.time_base, made.stream = packet.time_base, self._stream
        return made if made.size else None


def _codec(stream: Any) -> str:
    context = stream.codec_context
    return "" if context is None else str(context.codec.canonical_name)


def _number(things: Sequence[object], what: str) -> str:
    return f"{len(things)} {what}{'' if len(things) == 1 else 's'}"
