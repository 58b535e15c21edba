"""Pixel formats by what they hold: where colours are sampled, how many bits, whether transparency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import av

Colours = Literal["420", "422", "444"]
DEPTHS = (8, 10, 12, 16)
FULL_COLOUR = ("ffv1", "prores_ks", "utvideo", "ffvhuff")
"""Codecs of studios and archives, whose players take colours of full resolution of pictures in red, green and blue."""
NO_ALPHA = ("libx265", "libvpx-vp9")
"""Codecs that know transparency in name, and need more than pictures for it, or that hardly anything reads."""


@dataclass(frozen=True)
class Kind:
    """What a pixel format of luma and colours holds.

    >>> Kind.of("yuva444p10le")
    Kind(colours='444', bits=10, alpha=True)
    >>> Kind.of("rgb48be").name, Kind.of("nv12").name, Kind.of("yuv411p").name
    ('yuv444p16le', 'yuv420p', 'yuv422p')
    """

    colours: Colours = "420"
    """Colours of each 2 x 2 pixels, of each 2 x 1, or of each."""
    bits: int = 8
    alpha: bool = False

    @classmethod
    def of(cls, pixel_format: str) -> Kind:
        """What a format of FFmpeg's holds, at least; grey ones count as the least that shows them.

        Raises
        ------
        ValueError
            There is no such format.
        """
        found = av.VideoFormat(pixel_format, 64, 64)
        parts = found.components
        is_packed_colour = found.is_rgb or found.has_palette
        shared = parts[1] if len(parts) > 2 and not is_packed_colour else None
        colours: Colours = "444" if is_packed_colour else "420"
        if shared is not None and shared.height == found.height:
            colours = "444" if shared.width == found.width else "422"
        elif shared is not None and shared.width == found.width:
            colours = "444"
        alpha = any(part.is_alpha for part in parts) or found.has_palette
        bits = max(part.bits for part in parts)
        lacking = (12,) if alpha and colours == "420" else ()  # FFmpeg has no such format
        depths = [depth for depth in DEPTHS if depth >= bits and depth not in lacking]
        return cls(colours, depths[0] if depths else DEPTHS[-1], alpha)

    @property
    def name(self) -> str:
        """The planar format that holds just this."""
        return f"yuv{'a' if self.alpha else ''}{self.colours}p{'' if self.bits == 8 else f'{self.bits}le'}"

    @property
    def even(self) -> tuple[bool, bool]:
        """Whether a codec needs an even width and an even height."""
        return self.colours != "444", self.colours == "420"


def nearest(wanted: Kind, known: Sequence[str]) -> str:
    """The format among known ones that loses least, and of these the one that adds least.

    >>> nearest(Kind("422", 10), ["yuv420p", "yuv444p", "yuv422p10le", "yuv444p12le"])
    'yuv422p10le'
    >>> nearest(Kind("444", 12, True), ["yuv420p", "yuv444p10le"])
    'yuv444p10le'
    """

    def costs(name: str) -> tuple[int, ...]:
        kind = Kind.of(name)
        colour = int(kind.colours) - int(wanted.colours)
        bits = kind.bits - wanted.bits
        is_lost = (wanted.alpha > kind.alpha, max(0, -colour), max(0, -bits))
        is_added = (max(0, colour), max(0, bits), kind.alpha > wanted.alpha, name.startswith("yuvj"))
        return (*map(int, is_lost), *map(int, is_added))

    planar = [name for name in known if name.startswith("yuv") and Kind.of(name).name in (name, name.replace("j", ""))]
    return min(planar, key=costs, default=known[0] if known else Kind().name)


def losses(of: str, to: Kind) -> str:
    """What pictures of a pixel format lose, in words; empty where they lose nothing.

    >>> losses("yuva444p12le", Kind("420", 8)), losses("yuv420p", Kind("422", 10)), losses("rgb24", Kind())
    ('12 bits become 8, colours in 4:4:4 become 4:2:0, transparency is lost', '', 'colours in RGB become 4:2:0')
    """
    source, told = Kind.of(of), []
    held = av.VideoFormat(of, 64, 64)
    bits = max(part.bits for part in held.components)
    if bits > to.bits:
        told.append(f"{bits} bits become {to.bits}")
    if source.colours > to.colours:
        full = "RGB" if held.is_rgb or held.has_palette else ":".join(source.colours)
        told.append(f"colours in {full} become {':'.join(to.colours)}")
    if any(part.is_alpha for part in held.components) and not to.alpha:
        told.append("transparency is lost")
    return ", ".join(told)
