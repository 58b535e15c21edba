"""Video files, read frame by frame with their audio, through PyAV."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, TypeAlias

import av
from av.audio.stream import AudioStream
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from ..base.errors import InvalidParameter, MediaError
from ..base.files import check_file
from .image_metadata import TRANSPOSING_ORIENTATIONS, UPRIGHT
from .image_sequences import first_number, is_sequence, numbered_files
from .video_frames import (
    SITING_AFTER_ORIENTATION,
    ColourCoding,
    Deinterlacer,
    frame_orientation,
    orientation_note,
    siting_of,
    upright,
)
from .video_metadata import (
    ARBITRARY_ORIGIN_FORMATS,
    DATA_OF,
    MasteringDisplay,
    advance_timecode,
    chapters_between,
    data_streams,
    dropped_tracks,
    dynamic_hdr_names,
    holds_data,
    read_timecode,
    text_subtitles,
)

AnyPacket: TypeAlias = "Packet[Any]"
Item: TypeAlias = "av.VideoFrame | AnyPacket"
"""Decoded frame, or audio packet as stored."""

SEEK_MARGINS_S = (0, 2, 10)
"""Successive margins (s) for seeking earlier if the index of a file leads past the requested frame.
"""
MAX_AUDIO_DELAY_S = 5
"""Maximum delay of audio relative to video within a file."""
DURATION_TOLERANCE_S = 0.5
"""Tolerance of the duration before a file is reported as truncated."""


class VideoReader:
    """Video file: properties, and frames and audio of a time range.

    The rotation or mirroring in the display matrix of a file is applied, as by FFmpeg and players,
    unless ``stored_orientation`` is set. Interlaced frames are deinterlaced
    (:class:`.Deinterlacer`). Only the first video stream is read, with all audio streams, text
    subtitles, data streams that an output can store, and chapters; ``notes`` names other, dropped
    tracks. Each pass reads the file again.

    Parameters
    ----------
    path
        File, or image sequence such as ``f%04d.png``.
    start_s : s
        Start time, from the start of the file.
    duration_s : s, optional
        Duration; the rest by default. Frames with times in [start, start + duration) are read, with
        the times in the file minus ``start_s``.
    with_audio
        Whether packets of audio, subtitles and data are read too.
    frame_rate : frames per second
        Frame rate of image sequences; files contain their own.
    stored_orientation
        Return frames as stored, for a camera that was calibrated with stored pixels.

    Raises
    ------
    MediaError
        If the file does not exist, or has no video that can be decoded.
    InvalidParameter
        If the requested part is outside the video.

    Examples
    --------
    >>> VideoReader("missing.mp4")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: cannot read the video missing.mp4: the file does not exist
    """

    def __init__(
        self,
        path: str | Path,
        start_s: float = 0.0,
        duration_s: float | None = None,
        with_audio: bool = True,
        frame_rate: float = 25.0,
        stored_orientation: bool = False,
    ) -> None:
        self.path = Path(path)
        self._options: dict[str, str] = {}
        if is_sequence(path):
            if not 0 < frame_rate < math.inf:
                raise InvalidParameter(f"frame_rate must be greater than 0; got {frame_rate:g}")
            rate = Fraction(frame_rate).limit_denominator(1001)
            self._options = {"start_number": str(first_number(self.path)), "framerate": str(rate)}
        if not (math.isfinite(start_s) and start_s >= 0):
            raise InvalidParameter(f"start_s must be at least 0 s; got {start_s:g}")
        if duration_s is not None and not duration_s > 0:
            raise InvalidParameter(f"duration_s must be greater than 0 s; got {duration_s:g}")
        self.start_s = start_s
        self.duration_s = duration_s
        self.with_audio = with_audio
        self.stored_orientation = stored_orientation
        self._container = self._open()
        try:
            self._probe()
        except BaseException:
            self._container.close()
            raise

    def _probe(self) -> None:
        """Read the properties of the video, some of them from the first frame."""
        stream = self._container.streams.video[0]
        first = next(_decoded(self._container, stream), None)
        if first is None:
            raise MediaError(
                f"cannot read the video {self.path}: no frame can be decoded; it is damaged or truncated"
            )
        stored = frame_orientation(first)
        self.orientation = UPRIGHT if stored is None or self.stored_orientation else stored
        """Orientation applied to the stored frames, as in EXIF, 1 to 8."""
        is_quarter_turn = self.orientation in TRANSPOSING_ORIENTATIONS
        self.size: tuple[int, int] = (
            (first.height, first.width) if is_quarter_turn else (first.width, first.height)
        )
        self.codec: str = stream.codec_context.codec.canonical_name
        self.pixel_format: str = first.format.name
        self.colour = ColourCoding.of_video(first)
        self.siting = siting_of(stream.codec_context.name)
        if self.siting == "left":
            self.siting = SITING_AFTER_ORIENTATION.get(self.orientation, self.siting)
        self.notes: list[str] = []
        """Remarks on the file for the user, in sentences."""
        if note := orientation_note(str(self.path), stored, self.stored_orientation):
            self.notes.append(note)
        if first.interlaced_frame:
            self.notes.append(
                f"{self.path} is interlaced; frames are deinterlaced from the first field"
            )
        side_data: Any = first.side_data
        self.display = MasteringDisplay.of(side_data)
        if dynamic := dynamic_hdr_names(side_data):
            self.notes.append(f"{self.path}: dropped dynamic HDR metadata ({dynamic})")
        self.rotation_deg: int = first.rotation if self.orientation == UPRIGHT else 0
        aspect = stream.sample_aspect_ratio or Fraction(1)
        self.pixel_aspect = 1 / aspect if is_quarter_turn else aspect
        self.frame_rate: Fraction = stream.average_rate or stream.guessed_rate or Fraction(25)
        self.time_base: Fraction = stream.time_base or 1 / self.frame_rate
        self.metadata: dict[str, str] = dict(self._container.metadata)
        if timecode := read_timecode(
            [self.metadata, *(stream.metadata for stream in self._container.streams)]
        ):
            frames = round(Fraction(self.start_s) * self.frame_rate)
            self.metadata["timecode"] = advance_timecode(timecode, frames, self.frame_rate)
        self._probe_tracks()
        origin = _origin(self._container)
        is_clocked = any(
            name in ARBITRARY_ORIGIN_FORMATS for name in self._container.format.name.split(",")
        )
        self.start_time_s = Fraction(0) if self.start_s > 0 or is_clocked else origin
        """Start time in the file; times of frames and packets are relative to it."""
        self._first_s = max(0.0, (first.time or 0.0) - float(_origin(self._container)))
        self.total_duration_s = _duration(self._container, stream)
        if self.total_duration_s is not None and self.start_s >= self.total_duration_s:
            raise InvalidParameter(
                f"start_s must be less than the duration of {self.path}, "
                f"{self.total_duration_s:.6g} s; got {self.start_s:g}"
            )

    def _probe_tracks(self) -> None:
        """Select the tracks other than the video, and the chapters between start and end."""
        self.audio_streams: tuple[AudioStream, ...] = (
            tuple(self._container.streams.audio) if self.with_audio else ()
        )
        self.subtitle_streams = text_subtitles(self._container) if self.with_audio else ()
        """Text subtitle streams, whose packets are returned with those of the audio."""
        data = data_streams(self._container) if self.with_audio else ()
        self.data_streams = tuple(s for s in data if any(holds_data(name, s) for name in DATA_OF))
        """Data streams, such as telemetry, whose packets are returned with those of the audio."""
        start = _origin(self._container) + Fraction(self.start_s).limit_denominator(1_000_000)
        length = (
            None
            if self.duration_s is None
            else Fraction(self.duration_s).limit_denominator(1_000_000)
        )
        self.chapters = chapters_between(
            self._container, start, None if length is None else start + length
        )
        if self.with_audio and (dropped := " and ".join(dropped_tracks(self._container))):
            self.notes.append(f"{self.path}: dropped {dropped}")

    @property
    def expected_frames(self) -> int | None:
        """Expected number of frames, if the file contains it."""
        stream = self._container.streams.video[0]
        is_whole = self.start_s == 0 and self.duration_s is None
        if is_whole and stream.frames:
            return stream.frames
        if self.total_duration_s is None:
            return None if self.duration_s is None else round(self.duration_s * self.frame_rate)
        rest = self.total_duration_s - max(self.start_s, self._first_s)
        return round(
            (rest if self.duration_s is None else min(rest, self.duration_s)) * self.frame_rate
        )

    def frames(self) -> Iterator[av.VideoFrame]:
        """Yield the frames in presentation order, as :meth:`items` without audio."""
        return (item for item in self.items() if isinstance(item, av.VideoFrame))

    def items(self) -> Iterator[Item]:
        """Yield frames, and audio packets as stored, in the order of the file.

        Raises
        ------
        MediaError
            If the file is damaged or truncated; raised after all readable items.
        """
        with self._open() as container:
            yield from _Pass(self, container)

    def close(self) -> None:
        """Release the file."""
        self._container.close()

    def __enter__(self) -> VideoReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open(self) -> InputContainer:
        try:
            kind = "image2" if self._options else None
            for path in numbered_files(self.path) if self._options else (self.path,):
                check_file(path)  # FFmpeg would block on a pipe
            container = av.open(
                str(self.path), "r", format=kind, options=self._options, metadata_errors="replace"
            )
        except FileNotFoundError:
            raise MediaError(
                f"cannot read the video {self.path}: the file does not exist"
            ) from None
        except (av.FFmpegError, OSError) as e:
            reason = e.strerror or str(e)
            if isinstance(e, av.error.InvalidDataError):
                reason = "it is not a video, or is damaged or truncated"
            raise MediaError(f"cannot read the video {self.path}: {reason}") from None
        if not container.streams.video or container.streams.video[0].codec_context is None:
            container.close()
            raise MediaError(f"cannot read the video {self.path}: no video stream can be decoded")
        container.streams.video[0].thread_type = "AUTO"
        return container


class _Pass:
    """Single pass through a file, with counters for missing data that are reported at its end."""

    def __init__(self, reader: VideoReader, container: InputContainer) -> None:
        self.reader = reader
        self.container = container
        self.video = container.streams.video[0]
        self.tick = reader.time_base
        self.audio = list(container.streams.audio)[: len(reader.audio_streams)]
        sparse = (*reader.subtitle_streams, *reader.data_streams)
        self.sparse = [container.streams[own.index] for own in sparse]
        self.reader_streams = {own.index: own for own in (*reader.audio_streams, *sparse)}
        """Streams of the reader: packets are used after this pass has closed its container."""
        origin = _origin(container)
        self.start = origin + Fraction(reader.start_s).limit_denominator(1_000_000)
        length = reader.duration_s
        self.end = (
            None if length is None else self.start + Fraction(length).limit_denominator(1_000_000)
        )
        self.deinterlace = Deinterlacer()
        self.packets = 0
        self.damaged = 0
        self.decoded = 0
        self.reached = Fraction(0)
        """End time of the data read, of any stream."""

    def __iter__(self) -> Iterator[Item]:
        problem = None
        items = self._from_start() if self.reader.start_s > 0 else self._read(None)
        try:
            for item in items:
                self.decoded += isinstance(item, av.VideoFrame)
                yield item
        except av.FFmpegError as e:
            problem = e.strerror or str(e)
        self._check(problem)

    def _from_start(self) -> Iterator[Item]:
        """Decode from the key frame before the start, and drop frames before the start."""
        for back in SEEK_MARGINS_S:
            target = max(Fraction(0), self.start - back)
            try:
                self.container.seek(int(target / self.tick), stream=self.video)
            except av.FFmpegError:
                break
            read = self._read(self.start)
            first = next(read, None)
            if first is not None:
                yield first
                yield from read
                return
        self.container.seek(0)
        yield from self._read(None)

    def _read(self, must_reach: Fraction | None) -> Iterator[Item]:
        """Yield the items between start and end; none if the first frame is later than required."""
        early: list[Item] = []
        has_begun = must_reach is None
        for item, time in self._timed():
            if not has_begun:
                if isinstance(item, av.VideoFrame):
                    if time > (must_reach or 0):
                        return
                    has_begun = True
                    yield from early
                elif self._is_inside(item, time):
                    early.append(self._shifted(item))
                    continue
            if self._is_inside(item, time):
                yield self._shifted(item)

    def _timed(self) -> Iterator[tuple[Item, Fraction]]:
        """Yield frames and packets with their times in the file (s), until video and audio have
        passed the end.
        """
        streams = [self.video, *self.audio, *self.sparse]
        running = {stream.index for stream in (self.video, *self.audio)}
        expected = Fraction(0)
        for packet in self.container.demux(streams):
            self._note(packet)
            if self.end is not None and _time(packet) > self.end + MAX_AUDIO_DELAY_S:
                return
            if isinstance(packet.stream, VideoStream):
                for frame in self._decode(packet):
                    if frame.pts is None:
                        frame.time_base, frame.pts = self.tick, round(expected / self.tick)
                    time = frame.pts * (frame.time_base or self.tick)
                    expected = time + 1 / self.reader.frame_rate
                    yield frame, time
                    if self.end is not None and time >= self.end:
                        running.discard(packet.stream.index)
            elif packet.pts is not None and packet.size:
                packet.stream = self.reader_streams[packet.stream_index]
                yield packet, _time(packet)
                if self.end is not None and _time(packet) >= self.end:
                    running.discard(packet.stream.index)
            if not running:
                return

    def _decode(self, packet: AnyPacket) -> list[av.VideoFrame]:
        frames: list[av.VideoFrame] = []
        try:
            frames = packet.decode()
        except av.error.InvalidDataError:
            self.damaged += 1
        except av.error.EOFError:  # already flushed
            pass
        complete = [ready for frame in frames for ready in self.deinterlace(frame)]
        complete = complete if packet.size else complete + self.deinterlace.flush()
        return [upright(frame, self.reader.orientation) for frame in complete]

    def _note(self, packet: AnyPacket) -> None:
        if packet.size:
            self.packets += isinstance(packet.stream, VideoStream)
            self.damaged += packet.is_corrupt and isinstance(packet.stream, VideoStream)
            self.reached = max(
                self.reached, _time(packet) + (packet.duration or 0) * packet.time_base
            )

    def _is_inside(self, item: Item, time: Fraction) -> bool:
        # File times are rounded to the ticks of the stream; half a tick before the start is inside.
        # Data before the start of the file, such as the priming of an audio codec, belong to it.
        tolerance = (item.time_base or self.tick) / 2
        has_begun = self.reader.start_s == 0 or time >= self.start - tolerance
        return has_begun and (self.end is None or time < self.end - tolerance)

    def _shifted(self, item: Item) -> Item:
        shift = round(self.start / (item.time_base or self.tick))
        item.pts = (item.pts or 0) - shift
        if isinstance(item, Packet) and item.dts is not None:
            item.dts -= shift
        return item

    def _check(self, problem: str | None) -> None:
        """Report missing data in one sentence."""
        path, count = self.reader.path, self.decoded
        if problem is not None:
            raise MediaError(f"the video {path} is damaged: {problem} after {count} decoded frames")
        if self.damaged:
            raise MediaError(
                f"the video {path} is damaged: cannot decode {self.damaged} of {self.packets} frames; decoded {count}"
            )
        is_whole = self.reader.start_s == 0 and self.end is None
        nominal_s = self.reader.total_duration_s
        is_counted = (
            "mov" in self.container.format.name
        )  # other formats count skipped frames, or none
        is_missing_frames = is_whole and is_counted and self.packets < self.video.frames
        ends_early = (
            self.end is None
            and nominal_s is not None
            and self.reached + Fraction(DURATION_TOLERANCE_S) < nominal_s
        )
        if is_missing_frames or ends_early:
            raise MediaError(f"the video {path} is truncated after {count} decoded frames")
        if not count:
            raise MediaError(
                f"the requested part of the video {path} must contain at least one frame"
            )


def _decoded(container: InputContainer, stream: VideoStream) -> Iterator[av.VideoFrame]:
    """Yield the decoded frames, skipping damaged packets."""
    try:
        for packet in container.demux(stream):
            try:
                yield from packet.decode()
            except (av.error.InvalidDataError, av.error.EOFError):
                continue
    except av.FFmpegError:
        return


def _duration(container: InputContainer, stream: VideoStream) -> float | None:
    """Return the duration in the file (s), from its start; None if unknown."""
    if stream.duration is not None and stream.time_base is not None:
        begin = Fraction(stream.start_time or 0) * stream.time_base
        return float(begin + stream.duration * stream.time_base - _origin(container))
    match = re.fullmatch(
        r"(\d+):(\d+):(\d+\.?\d*)", stream.metadata.get("DURATION", "")
    )  # Matroska
    if match:
        return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3])
    return None if container.duration is None else container.duration / av.time_base


def _origin(container: InputContainer) -> Fraction:
    """Return the time origin (s) of a file; earlier data keep their negative times."""
    return max(Fraction(0), Fraction(container.start_time or 0, av.time_base))


def _time(packet: AnyPacket) -> Fraction:
    stamp = packet.pts if packet.pts is not None else packet.dts
    return (stamp or 0) * packet.time_base
