"""The options that say how values are taken: interpolation, the colour outside the field, and threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

from ...arguments import float_of
from ...dewarp.sampling.remap import INTERPOLATIONS
from ...errors import InvalidParameter
from ...media.pictures.images import FULL
from ...native import MOST_THREADS
from .common import WholeRange

if TYPE_CHECKING:
    import av

Command = TypeVar("Command", bound=Callable[..., Any])

HEX_DIGITS = set("0123456789abcdefABCDEF")


@dataclass(frozen=True)
class BorderColour:
    """What the user wrote: a grey, or red, green and blue.

    >>> border("#204080").of_picture(np.zeros((1, 1, 3), np.uint8)), border("7").of_picture(np.zeros((1, 1), np.uint8))
    ((32.0, 64.0, 128.0), (7.0,))
    """

    text: str
    values: tuple[float, ...]
    is_hex: bool
    """Whether values count to 255 whatever the picture's do."""

    def of_picture(self, image: NDArray[Any]) -> tuple[float, ...]:
        """One value per channel of a picture, grey, RGB or RGBA, opaque.

        Raises
        ------
        InvalidParameter
            If the picture has no such colour.
        """
        values = self._scaled(image.dtype.name)
        full = FULL[image.dtype.name]
        if image.dtype.kind == "u" and not all(0 <= value <= full and value % 1 == 0 for value in values):
            raise InvalidParameter(
                f"--border {self.text} is no value of a picture of {image.dtype.name}; "
                f"valid are whole numbers from 0 to {full}"
            )
        channels = image.shape[2] if image.ndim == 3 else 1
        if channels == 1:
            if len(set(values)) > 1:
                raise InvalidParameter(f"--border {self.text} is a colour, and the picture is grey; give one value")
            return values[:1]
        colour = values if len(values) == 3 else values * 3
        return colour if channels == 3 else (*colour, float(full))

    def of_frame(self, frame: av.VideoFrame) -> tuple[int, int, int]:
        """y, u and v as a video frame's colours are coded.

        Raises
        ------
        InvalidParameter
            If it is no colour of 8 bits.
        """
        from ...media.video.frames import coded_colour

        return coded_colour(self.of_picture(np.empty((1, 1, 3), np.uint8)), frame)

    def _scaled(self, depth: str) -> tuple[float, ...]:
        if not self.is_hex or depth == "uint8":
            return self.values
        if depth == "uint16":
            return tuple(257.0 * value for value in self.values)
        from ...simulate.colour import hex_colour  # pictures of floats hold linear light

        return tuple(float(light) for light in hex_colour(self.text))


def border(text: str) -> BorderColour:
    """A grey level, ``R,G,B``, or ``#rrggbb``.

    >>> border("16").values, border("255,128,0").values, border("#ff8000").values
    ((16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0))
    """
    if text.startswith("#") and len(text) == 7 and set(text[1:]) <= HEX_DIGITS:
        return BorderColour(text, tuple(float(int(text[i : i + 2], 16)) for i in (1, 3, 5)), True)
    try:
        values = tuple(float_of(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (1, 3) or not np.isfinite(values).all():
        raise click.BadParameter(f"{text!r} is no colour; valid are a grey level, R,G,B and #rrggbb")
    return BorderColour(text, values, False)


_OPTIONS = (
    click.option(
        "--interpolation",
        type=click.Choice(list(INTERPOLATIONS)),
        default="auto",
        show_default=True,
        help="auto: cubic, and averaged where the view shrinks the picture; area: averaged everywhere.",
    ),
    click.option(
        "--border",
        type=border,
        metavar="GREY|R,G,B|#rrggbb",
        help="The colour outside the field, in the picture's values or as on web pages.  [default: see --transparent]",
    ),
    click.option(
        "--threads",
        type=WholeRange(1, MOST_THREADS),
        metavar="N",
        help="How many threads straighten.  [default: one per processor core]",
    ),
)


def sampling_options(command: Command) -> Command:
    """Give a click command the options that say how values are taken."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
