"""HDR metadata of the mastering display of a video (SMPTE ST 2086, CTA-861.3)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from av.sidedata.sidedata import Type as SideData

DYNAMIC = {
    SideData.DYNAMIC_HDR_PLUS: "HDR10+",
    SideData.DYNAMIC_HDR_VIVID: "HDR Vivid",
    SideData.DOVI_RPU_BUFFER: "Dolby Vision",
    SideData.DOVI_METADATA: "Dolby Vision",
}
"""Dynamic metadata for the display of each image: valid only for whole images before dewarping."""
OPTIONS = {"libx265": "x265-params", "libx264": "x264-params", "libsvtav1": "svtav1-params"}
"""Encoder options for the metadata, by codec; other codecs do not support it."""
DISPLAY_LOST = "what it tells of the display that it was graded on is lost"


@dataclass(frozen=True)
class Display:
    """Mastering display of a video, and its light levels."""

    primaries: tuple[Fraction, ...] = ()
    """x and y of red, green, blue and white; empty if unknown."""
    luminance: tuple[Fraction, ...] = ()
    """Minimum and maximum luminance, cd/m2; empty if unknown."""
    light: tuple[int, ...] = ()
    """Maximum pixel luminance and maximum frame-average luminance, cd/m2; empty if unknown."""

    @classmethod
    def of(cls, side_data: Any) -> Display:
        """Read the side data of a frame.

        >>> Display.of({})
        Display(primaries=(), luminance=(), light=())
        """
        told = cls()
        if (mastering := side_data.get(SideData.MASTERING_DISPLAY_METADATA)) is not None:
            *parts, has_primaries, has_luminance = struct.unpack("22i", bytes(mastering)[:88])
            values = tuple(Fraction(parts[i], parts[i + 1] or 1) for i in range(0, 20, 2))
            told = cls(values[:8] if has_primaries else (), values[8:] if has_luminance else ())
        if (light := side_data.get(SideData.CONTENT_LIGHT_LEVEL)) is not None:
            told = cls(told.primaries, told.luminance, struct.unpack("2I", bytes(light)[:8]))
        return told

    def options(self, codec: str) -> str | None:
        """Return the encoder options; None if the codec does not support all data.

        >>> Display(light=(1000, 400)).options("libx265"), Display(light=(1000, 400)).options("ffv1")
        ('max-cll=1000,400', None)
        """
        has_mastering = bool(self.primaries and self.luminance)
        if codec not in OPTIONS or bool(self.primaries) != bool(self.luminance):
            return None
        is_av1 = codec == "libsvtav1"
        names = {"libx265": ("master-display", "max-cll"), "libx264": ("mastering-display", "cll")}
        mastering, light = names.get(codec, ("mastering-display", "content-light"))
        told = []
        if has_mastering:
            xy = [f"{float(v):.6f}" if is_av1 else str(round(50_000 * v)) for v in self.primaries]
            least, most = (f"{float(v):.6f}" if is_av1 else str(round(10_000 * v)) for v in self.luminance)
            red, green, blue, white = (f"({xy[i]},{xy[i + 1]})" for i in range(0, 8, 2))
            told.append(f"{mastering}=G{green}B{blue}R{red}WP{white}L({most},{least})")
        if self.light:
            told.append(f"{light}={self.light[0]},{self.light[1]}")
        return ":".join(told)


def dynamic_kinds(side_data: Any) -> str:
    """Return the names of the dynamic HDR metadata as a phrase; empty if there are none."""
    return " and ".join(dict.fromkeys(name for kind, name in DYNAMIC.items() if side_data.get(kind) is not None))
