"""Atomic writing of video files."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import av
from av.audio.stream import AudioStream
from av.packet import Packet

from ...base.errors import MediaError
from ...base.files import replacing
from ..batch import VIDEOS_WRITTEN
from ..pictures.panorama import GPano
from .encoder import DEFAULT_CODEC, Encoder, sentences
from .frames import Siting, siting_of
from .mp4.ending import show_to_the_last
from .mp4.spherical import SUFFIXES, can_be_spherical, make_spherical
from .reader import VideoReader

CODECS = {".webm": "libvpx-vp9"}
"""Default codec by suffix, if it is not H.264."""
FRAGMENTS = {"movflags": "hybrid_fragmented+delay_moov", "frag_duration": "1000000"}
CLUSTERS = {"cluster_time_limit": "1000"}
MOST_RESCUED = 999
KEEPING = "--codec ffv1 in .mkv and prores_ks in .mov keep most, --pixel-format names another choice"
UNFINISHED = {
    ".mp4": FRAGMENTS, ".m4v": FRAGMENTS, ".mov": FRAGMENTS, ".mkv": CLUSTERS, ".webm": CLUSTERS, ".ts": {},
}  # fmt: skip
"""Container options for files that play up to the last second after any termination of the writer.
MP4 and MOV are fragmented, and are converted to one ordinary file at the end.
"""


class Sink(Protocol):
    """Consumer of frames, ended once, by :meth:`close` or :meth:`abort`."""

    @property
    def frames_written(self) -> int:
        """Number of written frames."""
        ...

    @property
    def siting(self) -> Siting:
        """Position of chroma samples that readers of the output assume."""
        ...

    def write(self, frame: av.VideoFrame) -> None:
        """Write the next frame."""
        ...

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Write an audio packet; a sink without audio discards it."""
        ...

    def close(self) -> None:
        """Finish the output, which is then playable."""
        ...

    def abort(self) -> None:
        """Abort; an existing output is unchanged."""
        ...


class VideoWriter:
    """Video file, written atomically.

    It is encoded under a temporary name that is renamed at the end. Leaving the ``with`` block by
    Ctrl-C finishes the file with the frames so far; after any other error an existing file is
    unchanged. The temporary file of a killed run is playable; the next writer of the same file
    renames it to ``NAME.rescued.mp4``.

    Parameters
    ----------
    path
        Path whose suffix selects the format, one of :data:`omnimirror.io.batch.VIDEOS_WRITTEN`.
    panorama
        Part of the full sphere in the video, for players; supported by MP4 and MOV.
    **encoding
        As for :class:`Encoder`.

    Raises
    ------
    MediaError
        The suffix is unknown, the format does not support the content, or the file cannot be
        written.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from omnimirror.io.video.frames import frame_of_image
    >>> folder = tempfile.TemporaryDirectory()
    >>> with VideoWriter(folder.name + "/grey.mp4", (64, 48), 25) as video:
    ...     for _ in range(10):
    ...         video.write(frame_of_image(np.full((48, 64, 3), 128, np.uint8)))
    >>> VideoReader(folder.name + "/grey.mp4").expected_frames
    10
    >>> folder.cleanup()
    """

    def __init__(
        self,
        path: str | Path,
        size: tuple[int, int],
        frame_rate: Fraction | float,
        panorama: GPano | None = None,
        **encoding: Any,
    ) -> None:
        self.path = Path(path)
        suffix = check_video_name(path)
        if panorama is not None and not can_be_spherical(path):
            raise MediaError(f"{path} cannot say that it is a panorama; valid are {', '.join(SUFFIXES)}")
        if panorama is not None and panorama.cropped_size != size:
            told = " x ".join(map(str, panorama.cropped_size))
            raise MediaError(f"cannot write {path}: the video has {size[0]} x {size[1]} px, and the panorama {told} px")
        self._panorama = panorama
        encoding.setdefault("codec", CODECS.get(suffix, DEFAULT_CODEC))
        encoding["container_options"] = {"flush_packets": "1", **UNFINISHED[suffix]}
        self.notes: list[str] = []
        """Remarks on the file for the user, in sentences."""
        self._stack: ExitStack | None = ExitStack()
        with sentences(path), self._stack:
            self._temporary = self._stack.enter_context(replacing(self.path, self._rescue))
            self._encoder = Encoder(str(self._temporary), size, frame_rate, **encoding)
            self._encoder.target = str(path)
            if self._encoder.lost:
                self.notes.append(f"{path}: {self._encoder.lost}; {KEEPING}")
            if self._encoder.lost_tracks:
                self.notes.append(f"{path}: not kept are {self._encoder.lost_tracks}; .mkv keeps them")
            if suffix == ".ts" and "timecode" in (encoding.get("metadata") or {}):
                self.notes.append(f"{path}: the timecode is lost; .mov, .mp4 and .mkv keep it")
            self._stack = self._stack.pop_all()

    @classmethod
    def like(
        cls, source: VideoReader, path: str | Path, size: tuple[int, int] | None = None, **more: Any
    ) -> VideoWriter:
        """Create a writer with rate, times, bit depth, colour coding, rotation, metadata and tracks
        of a source.

        ``more`` is passed to :class:`VideoWriter`, and overrides the source: a view drawn upright,
        for example, requires ``rotation_deg=0``.
        """
        as_source = {
            "time_base": source.time_base,
            "like": source.pixel_format,
            "colour": source.colour,
            "display": source.display,
            "rotation_deg": source.rotation_deg,
            "pixel_aspect": source.pixel_aspect,
            "audio": source.audio_streams,
            "subtitles": source.subtitle_streams,
            "chapters": source.chapters,
            "begins_s": source.begins_s,
            "metadata": source.metadata,
        }
        return cls(path, size or source.size, more.pop("frame_rate", source.frame_rate), **{**as_source, **more})

    def _rescue(self, leftover: Path) -> Path | None:
        """Return a name for the output of a killed run, if it contains any frame."""
        try:
            VideoReader(leftover, with_sound=False).close()
        except MediaError:
            return None
        stem, suffix = f"{self.path.stem}.rescued", self.path.suffix
        names = (leftover.with_name(f"{stem}{n}{suffix}") for n in ("", *(f"-{i}" for i in range(2, MOST_RESCUED + 1))))
        name = next((name for name in names if not name.exists()), None)
        if name is not None:
            self.notes.append(f"what a run that was killed had done of {self.path} is {name} now")
        return name

    @property
    def frames_written(self) -> int:
        return self._encoder.frames_written

    @property
    def siting(self) -> Siting:
        return siting_of(self._encoder.codec)

    def write(self, frame: av.VideoFrame) -> None:
        """Encode a frame.

        Raises
        ------
        MediaError
            The file cannot be written, for example because the disk is full.
        InvalidParameter
            The frame has another size.
        """
        self._encoder.encode(frame)

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Write an audio packet of the source."""
        self._encoder.copy(packet)

    def close(self) -> None:
        """Finish the file and rename it.

        Raises
        ------
        MediaError
            The file cannot be written, or has no frame; an existing file is unchanged.
        """
        if self._stack is None:
            return
        if not self.frames_written:
            self.abort()
            raise MediaError(f"no frame was written to {self.path}")
        stack, self._stack = self._stack, None
        with sentences(self.path), stack:
            try:
                self._encoder.finish()
                if self._temporary.suffix.lower() in SUFFIXES:
                    show_to_the_last(self._temporary)
                if self._panorama is not None:
                    make_spherical(self._temporary, self._panorama)
            except BaseException:
                self._encoder.discard()
                raise

    def abort(self) -> None:
        """Remove the temporary file; an existing file is unchanged."""
        if self._stack is None:
            return
        stack, self._stack = self._stack, None
        self._encoder.discard()
        given_up = MediaError("given up")
        with suppress(MediaError):
            stack.__exit__(MediaError, given_up, None)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        is_stopped = isinstance(error, KeyboardInterrupt) and self.frames_written > 0
        if error is None or is_stopped:
            self.close()
        else:
            self.abort()


def check_video_name(path: str | Path) -> str:
    """Return the suffix of a video file that can be written, in lower case.

    >>> check_video_name("room.MP4")
    '.mp4'

    Raises
    ------
    MediaError
        The suffix is not supported.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in VIDEOS_WRITTEN:
        what = f"videos of kind {suffix!r} are" if suffix else "a video without a suffix is"
        raise MediaError(f"cannot write {path}: {what} not known; valid are {', '.join(VIDEOS_WRITTEN)}")
    return suffix
