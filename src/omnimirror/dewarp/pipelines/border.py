"""Colour outside the field, specified before the depth and channels of the image are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import float_of, shown
from ...base.errors import InvalidParameter
from ...io.pictures.images import FULL

if TYPE_CHECKING:
    import av

HEX_DIGITS = set("0123456789abcdefABCDEF")
VALID = "valid are a grey level, R,G,B and #rrggbb"


@dataclass(frozen=True)
class BorderColour:
    """Grey level or RGB colour, in image values or as a hexadecimal colour.

    >>> BorderColour.of("#204080").of_picture(np.zeros((1, 1, 3), np.uint8)), BorderColour.of(7).values
    ((32.0, 64.0, 128.0), (7.0,))
    """

    text: str
    values: tuple[float, ...]
    is_hex: bool
    """True for values from 0 to 255, independent of the data type of the image."""

    @classmethod
    def of(cls, border: AskedBorder) -> BorderColour:
        """Create a colour from a grey level, (red, green, blue), or text: ``"16"``, ``"255,128,0"``
        or ``"#rrggbb"``.

        >>> [BorderColour.of(b).values for b in ("16", "255,128,0", "#ff8000", (1, 2, 3))]
        [(16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0), (1.0, 2.0, 3.0)]

        Raises
        ------
        InvalidParameter
            If it is not a colour.
        """
        if isinstance(border, BorderColour):
            return border
        if isinstance(border, str):
            if border.startswith("#") and len(border) == 7 and set(border[1:]) <= HEX_DIGITS:
                return cls(border, tuple(float(int(border[i : i + 2], 16)) for i in (1, 3, 5)), True)
            text, parts = border, border.split(",")
        else:
            parts = [f"{part}" for part in border] if isinstance(border, Sequence) else [f"{border}"]
            text = ",".join(parts)
        try:
            values = tuple(float_of(part) for part in parts)
        except ValueError:
            values = ()
        if len(values) not in (1, 3) or not np.isfinite(values).all():
            raise InvalidParameter(f"{shown(border)} is no colour; {VALID}")
        return cls(text, values, False)

    def of_picture(self, image: NDArray[Any]) -> tuple[float, ...]:
        """Return one value per channel of a grey, RGB or RGBA image, opaque.

        Raises
        ------
        InvalidParameter
            If it is not a colour of the image.
        """
        values = self._scaled(image.dtype.name)
        full = FULL[image.dtype.name]
        if image.dtype.kind == "u" and not all(0 <= value <= full and value % 1 == 0 for value in values):
            raise InvalidParameter(
                f"border {self.text} is no value of a picture of {image.dtype.name}; "
                f"valid are whole numbers from 0 to {full}"
            )
        channels = image.shape[2] if image.ndim == 3 else 1
        if channels == 1:
            if len(set(values)) > 1:
                raise InvalidParameter(f"border {self.text} is a colour, and the picture is grey; give one value")
            return values[:1]
        colour = values if len(values) == 3 else values * 3
        return colour if channels == 3 else (*colour, float(full))

    def of_frame(self, frame: av.VideoFrame) -> tuple[int, int, int]:
        """Return y, u and v in the colour coding of a video frame.

        Raises
        ------
        InvalidParameter
            If it is not an 8-bit colour.
        """
        from ...io.video.frames import coded_colour

        return coded_colour(self.of_picture(np.empty((1, 1, 3), np.uint8)), frame)

    def _scaled(self, depth: str) -> tuple[float, ...]:
        if not self.is_hex or depth == "uint8":
            return self.values
        if depth == "uint16":
            return tuple(257.0 * value for value in self.values)
        from ...base.colour import hex_colour  # floating-point images contain linear light

        return tuple(float(light) for light in hex_colour(self.text))


AskedBorder: TypeAlias = BorderColour | str | float | Sequence[float]
