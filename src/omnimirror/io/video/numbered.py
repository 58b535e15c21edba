"""Image sequences as video output, each image written atomically."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path

import av
import numpy as np
from av.audio.stream import AudioStream
from av.packet import Packet

from ...base.errors import MediaError
from ..batch import VIDEOS_WRITTEN
from ..pictures.images import PictureFormat, check_size, format_of, write_image
from ..pictures.panorama import GPano
from .formats import Kind
from .frames import Colour, Image, Siting, converted
from .reader import Item
from .sequences import NUMBER, SEQUENCES, numbered, numbers_of

EXACT = 2 | 0x2000 | 0x40000
"""FFmpeg's bilinear, full_chroma_int and accurate_rnd; without the last, 10-bit white is not exact.
"""
WHITE = 65280


class NumberedPictures:
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
    like
        Pixel format of the input.
    colour
        Colour coding of the input.
    panorama
        Panorama metadata of every image; ignored for formats without support.
    skip_existing
        Skip the numbers of existing images; the caller filters frames with :meth:`lacking`.

    Raises
    ------
    MediaError
        The pattern is invalid, or the format does not support images of this size.

    Examples
    --------
    >>> import tempfile
    >>> from omnimirror.io.video.frames import frame_of_image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pictures = NumberedPictures(folder + "/f%03d.png", (64, 48))
    ...     for _ in range(2):
    ...         pictures.write(frame_of_image(np.full((48, 64, 3), 128, np.uint8)))
    ...     sorted(path.name for path in Path(folder).iterdir())
    ['f001.png', 'f002.png']
    """

    siting: Siting = "center"  # siting assumed by FFmpeg in conversions to RGB

    def __init__(
        self,
        pattern: str | Path,
        size: tuple[int, int],
        like: str = "yuv420p",
        colour: Colour | None = None,
        panorama: GPano | None = None,
        *,
        skip_existing: bool = False,
    ) -> None:
        self.pattern, self.frames_written = check_pattern(pattern), 0
        check_size(self.pattern, size)
        self._panorama = panorama
        held = av.VideoFormat(like, 64, 64)
        kind, of = Kind.of(like), format_of(self.pattern)
        self._is_deep = kind.bits > 8 and "uint16" in of.depths
        self._has_alpha = of.has_alpha and (any(part.is_alpha for part in held.components) or held.has_palette)
        self._there = frozenset(numbers_of(self.pattern)) if skip_existing else frozenset()
        self._numbers = (number for number in count(1) if number not in self._there)
        self.notes = [f"{pattern}: {lost}" for lost in self._losses(kind, of, colour)]
        """Remarks on the images for the user, in sentences."""

    def _losses(self, kind: Kind, of: PictureFormat, colour: Colour | None) -> Iterator[str]:
        told = []
        if kind.bits > 8 and not self._is_deep:
            told.append(f"{kind.bits} bits become 8")
        if kind.alpha and not of.has_alpha:
            told.append("transparency is lost")
        if told:
            yield f"{', '.join(told)}; .png and .tif keep them"
        if colour is not None and colour.is_hdr:
            yield "the picture is HDR, and pictures do not say so; a video keeps its tags"

    def lacking(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield the frames of a video whose images do not exist yet."""
        number = 0
        for item in items:
            if isinstance(item, av.VideoFrame):
                number += 1
                if number not in self._there:
                    yield item

    def write(self, frame: av.VideoFrame) -> None:
        """Write the frame as the next image.

        Raises
        ------
        MediaError
            The image cannot be written, for example because the disk is full.
        """
        write_image(numbered(self.pattern, next(self._numbers)), self._picture(frame), panorama=self._panorama)
        self.frames_written += 1

    def _picture(self, frame: av.VideoFrame) -> Image:
        if not self._is_deep:
            return converted(frame, "rgba" if self._has_alpha else "rgb24", interpolation=EXACT).to_ndarray()
        image: Image = converted(frame, "rgba64le" if self._has_alpha else "rgb48le", interpolation=EXACT).to_ndarray()
        colours = image[..., :3]  # white of FFmpeg is 255/256
        np.minimum(colours, WHITE, out=colours)
        colours += colours >> 8
        return image

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Discard an audio packet."""

    def close(self) -> None:
        """Finish the sequence.

        Raises
        ------
        MediaError
            No image was written, and none existed before.
        """
        if not self.frames_written and not self._there:
            raise MediaError(f"no frame was written to {self.pattern}")

    def abort(self) -> None:
        """Stop; written images are complete and are kept."""


def is_of_pictures(name: str | Path) -> bool:
    """Return whether the name of an output is that of an image or an image sequence.

    >>> is_of_pictures("out/f%04d.jpg"), is_of_pictures("f.png"), is_of_pictures("f%d.gif"), is_of_pictures("f%d.mp4")
    (True, True, True, False)
    """
    suffix = Path(name).suffix.lower()
    return suffix in SEQUENCES or (bool(NUMBER.search(Path(name).name)) and suffix not in VIDEOS_WRITTEN)


def check_pattern(pattern: str | Path) -> Path:
    """Return the pattern of an image sequence after checking that it can be written.

    Raises
    ------
    MediaError
        The pattern has no number or several, one without zero padding, or the suffix is unknown.
    """
    path = Path(pattern)
    found = NUMBER.findall(path.name)
    valid = "such as f%04d.png"
    if path.suffix.lower() not in SEQUENCES:
        raise MediaError(f"cannot write {pattern}: numbered pictures are {', '.join(SEQUENCES)}")
    if not found:
        raise MediaError(f"cannot write {pattern}: a video becomes numbered pictures, {valid}")
    if len(found) > 1 or "%" in NUMBER.sub("", str(pattern)):
        raise MediaError(f"cannot write {pattern}: the name takes one number and no other %, {valid}")
    zero, width = found[0]
    if width and (not zero or int(width) > 9):
        raise MediaError(f"cannot write {pattern}: a number has up to 9 digits and zeros before it, {valid}")
    return path
