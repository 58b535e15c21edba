"""Properties of pixel formats: chroma subsampling, bit depth, transparency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import av

Colours = Literal["420", "422", "444"]
DEPTHS = (8, 10, 12, 16)
FULL_COLOUR = ("ffv1", "prores_ks", "utvideo", "ffvhuff")
"""Professional and archive codecs, whose players support 4:4:4 for RGB images."""
NO_ALPHA = ("libx265", "libvpx-vp9")
"""Codecs with nominal transparency that requires additional streams or lacks support in players."""


@dataclass(frozen=True)
class Kind:
    """Properties of a pixel format of luma and chroma.

    >>> Kind.of("yuva444p10le")
    Kind(colours='444', bits=10, alpha=True)
    >>> Kind.of("rgb48be").name, Kind.of("nv12").name, Kind.of("yuv411p").name
    ('yuv444p16le', 'yuv420p', 'yuv422p')
    """

    colours: Colours = "420"
    """Chroma subsampling: per 2 x 2 pixels, per 2 x 1, or per pixel."""
    bits: int = 8
    alpha: bool = False

    @classmethod
    def of(cls, pixel_format: str) -> Kind:
        """Return the properties of an FFmpeg pixel format; grey counts as the lowest subsampling.

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
        """Planar format with these properties."""
        return f"yuv{'a' if self.alpha else ''}{self.colours}p{'' if self.bits == 8 else f'{self.bits}le'}"

    @property
    def even(self) -> tuple[bool, bool]:
        """True if the format requires an even width and an even height."""
        return self.colours != "444", self.colours == "420"


def nearest(wanted: Kind, known: Sequence[str]) -> str:
    """Return the known format with the smallest loss, and among these with the smallest excess.

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
    """Describe the losses of a pixel format conversion; empty if there are none.

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
