"""Atomic writing of videos: video files and image sequences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from fractions import Fraction
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import av
import numpy as np
from av.audio.stream import AudioStream
from av.packet import Packet

from ..base.errors import MediaError
from ..base.files import atomic_output
from ._panorama import GPano
from .batch import WRITABLE_VIDEO_SUFFIXES
from .image_sequences import NUMBER_PATTERN, SEQUENCE_SUFFIXES, numbered, numbers_of
from .images import ImageFormat, check_size, format_of, write_image
from .mp4 import SPHERICAL_SUFFIXES, can_be_spherical, extend_duration, make_spherical
from .video_encoder import DEFAULT_CODEC, Encoder, media_errors
from .video_frames import ChromaSiting, ColourCoding, Image, PixelFormat, converted, siting_of
from .video_metadata import DATA_KEEPERS
from .video_reader import Item, VideoReader

# -- Atomic writing of video files -----------------------------------------------------------------

DEFAULT_CODECS = {".webm": "libvpx-vp9"}
"""Default codec by suffix, if it is not H.264."""
FRAGMENTS = {"movflags": "hybrid_fragmented+delay_moov", "frag_duration": "1000000"}
CLUSTERS = {"cluster_time_limit": "1000"}
MAX_RESCUED_FILES = 999
LOSS_HINT = (
    "use --set video.codec=ffv1 with .mkv, video.codec=prores_ks with .mov, or video.pixel_format"
)
RECOVERABLE_OPTIONS = {
    ".mp4": FRAGMENTS,
    ".m4v": FRAGMENTS,
    ".mov": FRAGMENTS,
    ".mkv": CLUSTERS,
    ".webm": CLUSTERS,
    ".ts": {},
}
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
    def siting(self) -> ChromaSiting:
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
        Path whose suffix selects the format, one of :data:`omnimirror.io.batch.WRITABLE_VIDEO_SUFFIXES`.
    panorama
        Part of the full sphere in the video, for players; supported by MP4 and MOV.
    **encoding
        As for :class:`Encoder`.

    Raises
    ------
    MediaError
        If the suffix is unknown, the format does not support the content, or the file cannot be
        written.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from omnimirror.io.video_frames import frame_of_image
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
            raise MediaError(
                f"cannot write {path}: panorama metadata requires {', '.join(SPHERICAL_SUFFIXES)}"
            )
        if panorama is not None and panorama.cropped_size != size:
            expected = " x ".join(map(str, panorama.cropped_size))
            raise MediaError(
                f"cannot write {path}: size must be that of panorama, {expected} px; got {size[0]} x {size[1]} px"
            )
        self._panorama = panorama
        encoding.setdefault("codec", DEFAULT_CODECS.get(suffix, DEFAULT_CODEC))
        encoding["container_options"] = {"flush_packets": "1", **RECOVERABLE_OPTIONS[suffix]}
        self.notes: list[str] = []
        """Remarks on the file for the user, in sentences."""
        self._stack: ExitStack | None = ExitStack()
        with media_errors(path), self._stack:
            self._temporary = self._stack.enter_context(atomic_output(self.path, self._rescue))
            self._encoder = Encoder(str(self._temporary), size, frame_rate, **encoding)
            self._encoder.target = str(path)
            if self._encoder.losses:
                self.notes.append(f"{path}: {self._encoder.losses}; {LOSS_HINT}")
            if self._encoder.dropped_tracks:
                self.notes.append(
                    f"{path}: dropped {self._encoder.dropped_tracks}; .mkv supports them"
                )
            if self._encoder.dropped_data:
                self.notes.append(f"{path}: dropped {self._encoder.dropped_data}; {DATA_KEEPERS}")
            if suffix == ".ts" and "timecode" in (encoding.get("metadata") or {}):
                self.notes.append(f"{path}: the timecode is lost; .mov, .mp4 and .mkv support it")
            self._stack = self._stack.pop_all()

    @classmethod
    def from_source(
        cls,
        source: VideoReader,
        path: str | Path,
        size: tuple[int, int] | None = None,
        **options: Any,
    ) -> VideoWriter:
        """Create a writer with rate, times, bit depth, colour coding, rotation, metadata and tracks
        of a source.

        ``options`` are passed to :class:`VideoWriter`, and override the source: an upright view, for
        example, requires ``rotation_deg=0``.
        """
        as_source = {
            "time_base": source.time_base,
            "source_format": source.pixel_format,
            "colour": source.colour,
            "display": source.display,
            "rotation_deg": source.rotation_deg,
            "pixel_aspect": source.pixel_aspect,
            "audio": source.audio_streams,
            "subtitles": source.subtitle_streams,
            "data": source.data_streams,
            "chapters": source.chapters,
            "start_time_s": source.start_time_s,
            "metadata": source.metadata,
        }
        return cls(
            path,
            size or source.size,
            options.pop("frame_rate", source.frame_rate),
            **{**as_source, **options},
        )

    def _rescue(self, leftover: Path) -> Path | None:
        """Return a name for the output of a killed run, if it contains any frame."""
        try:
            VideoReader(leftover, with_audio=False).close()
        except MediaError:
            return None
        stem, suffix = f"{self.path.stem}.rescued", self.path.suffix
        names = (
            leftover.with_name(f"{stem}{n}{suffix}")
            for n in ("", *(f"-{i}" for i in range(2, MAX_RESCUED_FILES + 1)))
        )
        name = next((name for name in names if not name.exists()), None)
        if name is not None:
            self.notes.append(
                f"the partial output of a terminated run for {self.path} was renamed to {name}"
            )
        return name

    @property
    def frames_written(self) -> int:
        return self._encoder.frames_written

    @property
    def siting(self) -> ChromaSiting:
        return siting_of(self._encoder.codec)

    def write(self, frame: av.VideoFrame) -> None:
        """Encode a frame.

        Raises
        ------
        MediaError
            If the file cannot be written, for example because the disk is full.
        InvalidParameter
            If the frame has another size.
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
            If the file cannot be written, or has no frame; an existing file is unchanged.
        """
        if self._stack is None:
            return
        if not self.frames_written:
            self.abort()
            raise MediaError(f"cannot write {self.path}: there are no frames")
        stack, self._stack = self._stack, None
        with media_errors(self.path), stack:
            try:
                self._encoder.finish()
                if self._temporary.suffix.lower() in SPHERICAL_SUFFIXES:
                    extend_duration(self._temporary)
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
        aborted = MediaError("aborted")
        with suppress(MediaError):
            stack.__exit__(MediaError, aborted, None)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
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
        If the suffix is not supported.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITABLE_VIDEO_SUFFIXES:
        raise MediaError(
            f"cannot write {path}: the suffix must be one of {', '.join(WRITABLE_VIDEO_SUFFIXES)}; got {suffix!r}"
        )
    return suffix


# -- Image sequences -------------------------------------------------------------------------------

EXACT_CONVERSION = 2 | 0x2000 | 0x40000
"""FFmpeg's bilinear, full_chroma_int and accurate_rnd; without the last, 10-bit white is not exact.
"""
WHITE_16_BIT = 65280


class ImageSequenceWriter:
    """Writer of frames as images with a pattern such as ``f%04d.png``: ``f0001.png``, ``f0002.png``
    ...

    Images of more than 8 bits are written with 16 if the format supports it (PNG, TIFF), and
    transparency is kept if possible. Times, audio and colour coding of the source are not stored:
    images are sRGB, or have the transfer function of the source, which :attr:`notes` reports for
    HDR. On any interruption the written images are complete and are kept.

    Parameters
    ----------
    pattern
        Pattern whose suffix selects the format; ``%04d`` in its name is the number with four
        digits, from 1.
    size : (width, height) px
    source_format
        Pixel format of the input.
    colour
        Colour coding of the input.
    panorama
        Panorama metadata of every image; ignored for formats without support.
    skip_existing
        Skip the numbers of existing images; the caller filters frames with :meth:`missing_frames`.

    Raises
    ------
    MediaError
        If the pattern is invalid, or the format does not support images of this size.

    Examples
    --------
    >>> import tempfile
    >>> from omnimirror.io.video_frames import frame_of_image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sequence = ImageSequenceWriter(folder + "/f%03d.png", (64, 48))
    ...     for _ in range(2):
    ...         sequence.write(frame_of_image(np.full((48, 64, 3), 128, np.uint8)))
    ...     sorted(path.name for path in Path(folder).iterdir())
    ['f001.png', 'f002.png']
    """

    siting: ChromaSiting = "center"  # siting assumed by FFmpeg in conversions to RGB

    def __init__(
        self,
        pattern: str | Path,
        size: tuple[int, int],
        source_format: str = "yuv420p",
        colour: ColourCoding | None = None,
        panorama: GPano | None = None,
        *,
        skip_existing: bool = False,
    ) -> None:
        self.pattern, self.frames_written = check_pattern(pattern), 0
        check_size(self.pattern, size)
        self._panorama = panorama
        coded = av.VideoFormat(source_format, 64, 64)
        kind, of = PixelFormat.of(source_format), format_of(self.pattern)
        self._is_deep = kind.bits > 8 and "uint16" in of.depths
        self._has_alpha = of.has_alpha and (
            any(part.is_alpha for part in coded.components) or coded.has_palette
        )
        self._existing = frozenset(numbers_of(self.pattern)) if skip_existing else frozenset()
        self._numbers = (number for number in count(1) if number not in self._existing)
        self.notes = [f"{pattern}: {loss}" for loss in self._losses(kind, of, colour)]
        """Remarks on the images for the user, in sentences."""

    def _losses(
        self, kind: PixelFormat, of: ImageFormat, colour: ColourCoding | None
    ) -> Iterator[str]:
        losses = []
        if kind.bits > 8 and not self._is_deep:
            losses.append(f"{kind.bits} bits are reduced to 8")
        if kind.alpha and not of.has_alpha:
            losses.append("transparency is lost")
        if losses:
            yield f"{', '.join(losses)}; use .png or .tif"
        if colour is not None and colour.is_hdr:
            yield "HDR tags are lost in images; write a video to keep them"

    def missing_frames(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield the frames of a video whose images do not exist yet."""
        number = 0
        for item in items:
            if isinstance(item, av.VideoFrame):
                number += 1
                if number not in self._existing:
                    yield item

    def write(self, frame: av.VideoFrame) -> None:
        """Write the frame as the next image.

        Raises
        ------
        MediaError
            If the image cannot be written, for example because the disk is full.
        """
        write_image(
            numbered(self.pattern, next(self._numbers)), self._image(frame), panorama=self._panorama
        )
        self.frames_written += 1

    def _image(self, frame: av.VideoFrame) -> Image:
        if not self._is_deep:
            return converted(
                frame, "rgba" if self._has_alpha else "rgb24", interpolation=EXACT_CONVERSION
            ).to_ndarray()
        image: Image = converted(
            frame, "rgba64le" if self._has_alpha else "rgb48le", interpolation=EXACT_CONVERSION
        ).to_ndarray()
        colours = image[..., :3]  # white of FFmpeg is 255/256
        np.minimum(colours, WHITE_16_BIT, out=colours)
        colours += colours >> 8
        return image

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Discard an audio packet."""

    def close(self) -> None:
        """Finish the sequence.

        Raises
        ------
        MediaError
            If no image was written, and none existed before.
        """
        if not self.frames_written and not self._existing:
            raise MediaError(f"cannot write {self.pattern}: there are no frames")

    def abort(self) -> None:
        """Stop; written images are complete and are kept."""


def is_image_output(name: str | Path) -> bool:
    """Return whether the name of an output is that of an image or an image sequence.

    >>> [is_image_output(name) for name in ("out/f%04d.jpg", "f.png", "f%d.gif", "f%d.mp4")]
    [True, True, True, False]
    """
    suffix = Path(name).suffix.lower()
    return suffix in SEQUENCE_SUFFIXES or (
        bool(NUMBER_PATTERN.search(Path(name).name)) and suffix not in WRITABLE_VIDEO_SUFFIXES
    )


def check_pattern(pattern: str | Path) -> Path:
    """Return the pattern of an image sequence after checking that it can be written.

    Raises
    ------
    MediaError
        If the pattern has no number or several, one without zero padding, or the suffix is unknown.
    """
    path = Path(pattern)
    numbers = NUMBER_PATTERN.findall(path.name)
    example = "such as f%04d.png"
    if path.suffix.lower() not in SEQUENCE_SUFFIXES:
        raise MediaError(
            f"cannot write {pattern}: the suffix of an image sequence must be one of {', '.join(SEQUENCE_SUFFIXES)}"
        )
    if not numbers:
        raise MediaError(f"cannot write {pattern}: the name must contain a number, {example}")
    if len(numbers) > 1 or "%" in NUMBER_PATTERN.sub("", str(pattern)):
        raise MediaError(
            f"cannot write {pattern}: the name must contain one number and no other %, {example}"
        )
    zero, width = numbers[0]
    if width and (not zero or int(width) > 9):
        raise MediaError(
            f"cannot write {pattern}: the number must have at most 9 digits with leading zeros, {example}"
        )
    return path
