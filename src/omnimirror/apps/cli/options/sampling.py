"""Resampling options: interpolation, colour outside the field, and threads."""

from __future__ import annotations

from dataclasses import dataclass

import click

from ....base.errors import InvalidParameter
from ....base.native import MOST_THREADS
from ....dewarp.contracts import INTERPOLATIONS, Interpolation
from ....dewarp.pipelines import BorderColour
from .common import WholeRange
from .declared import Options, option


def border(text: str) -> BorderColour:
    """Parse a grey level, ``R,G,B``, or ``#rrggbb``.

    >>> border("16").values, border("255,128,0").values, border("#ff8000").values
    ((16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0))
    """
    try:
        return BorderColour.of(text)
    except InvalidParameter as e:
        raise click.BadParameter(str(e)) from None


@dataclass(frozen=True)
class SamplingOptions(Options):
    """Resampling."""

    interpolation: Interpolation = option(
        type=click.Choice(list(INTERPOLATIONS)), default="auto",
        help="Interpolation; auto: cubic, with averaging for minification; area: averaging everywhere.",
    )  # fmt: skip
    border: BorderColour | None = option(
        type=border, metavar="GREY|R,G,B|#rrggbb",
        help="Colour outside the field, in values of the image or as #rrggbb.  [default: see --transparent]",
    )  # fmt: skip
    threads: int | None = option(
        type=WholeRange(1, MOST_THREADS), metavar="N",
        help="Number of dewarping threads.  [default: one per processor core]",
    )  # fmt: skip
