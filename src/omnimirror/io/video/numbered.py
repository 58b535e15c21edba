"""Numbered pictures that a video becomes, each written whole or not at all."""

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
"""FFmpeg's bilinear, full_chroma_int and accurate_rnd: without the last, white of ten bits is not white."""
WHITE = 65280


class NumberedPictures:
    """Writes each frame as a picture of its own, by a pattern such as ``f%04d.png``: ``f0001.png``, ``f0002.png`` ..

    Pictures of more than 8 bits are written with 16 where the file holds them (PNG, TIFF), and transparency is kept
    where it can be. Times, sound and how the source's colours were coded have no place in pictures: these are sRGB, or
    whatever the source's transfer was, which :attr:`notes` says of HDR. Whatever ends the writing, the pictures that
    were written are whole and stay.

    Parameters
    ----------
    pattern
        Its suffix names the format, and ``%04d`` in its name the number with four digits, which begins with 1.
    size : (width, height) px
    like
        The pixel format of what will come.
    colour
        How its colours are coded.
    panorama
        What viewers are to know of every picture; left out of files that cannot say it.
    skip_existing
        The numbers of pictures that are there already are left out: whoever writes looks at :meth:`lacking`.

    Raises
    ------
    MediaError
        The pattern is none, or the format cannot hold pictures of that size.

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

    siting: Siting = "center"  # where FFmpeg takes colours to lie that it turns into red, green and blue

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
        """What whoever asked for the pictures should know of them, in sentences."""

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
        """The frames among a video's items whose pictures are not there yet."""
        number = 0
        for item in items:
            if isinstance(item, av.VideoFrame):
                number += 1
                if number not in self._there:
                    yield item

    def write(self, frame: av.VideoFrame) -> None:
        """Write the frame as the next picture.

        Raises
        ------
        MediaError
            It cannot be written, for one because the disk is full.
        """
        write_image(numbered(self.pattern, next(self._numbers)), self._picture(frame), panorama=self._panorama)
        self.frames_written += 1

    def _picture(self, frame: av.VideoFrame) -> Image:
        if not self._is_deep:
            return converted(frame, "rgba" if self._has_alpha else "rgb24", interpolation=EXACT).to_ndarray()
        image: Image = converted(frame, "rgba64le" if self._has_alpha else "rgb48le", interpolation=EXACT).to_ndarray()
        colours = image[..., :3]  # FFmpeg's white is 255 parts of 256
        np.minimum(colours, WHITE, out=colours)
        colours += colours >> 8
        return image

    def write_packet(self, packet: Packet[AudioStream]) -> None:
        """Forget a packet of sound."""

    def close(self) -> None:
        """Everything is written.

        Raises
        ------
        MediaError
            Nothing was, and nothing had been before.
        """
        if not self.frames_written and not self._there:
            raise MediaError(f"no frame was written to {self.pattern}")

    def abort(self) -> None:
        """What was written is whole, and stays."""


def is_of_pictures(name: str | Path) -> bool:
    """Whether the name of an output is one of pictures, as they are or numbered.

    >>> is_of_pictures("out/f%04d.jpg"), is_of_pictures("f.png"), is_of_pictures("f%d.gif"), is_of_pictures("f%d.mp4")
    (True, True, True, False)
    """
    suffix = Path(name).suffix.lower()
    return suffix in SEQUENCES or (bool(NUMBER.search(Path(name).name)) and suffix not in VIDEOS_WRITTEN)


def check_pattern(pattern: str | Path) -> Path:
    """The name of numbered pictures that can be written.

    Raises
    ------
    MediaError
        It has no number or several, one without a width of zeros, or the suffix is not known.
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
