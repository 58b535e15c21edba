"""Lettering: words as coverage maps, with the font of matplotlib."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...base.colour import Light
from ...base.errors import InvalidParameter

OVERSAMPLING = 8  # oversampling of letters before averaging, for edges with 65 grey levels
FONT = "DejaVu Sans"


@cache
def lettering(text: str, cap_height_px: float) -> Light:
    """Return the coverage (h, w) of a word in bold letters, 1 inside and 0 outside, cropped to the
    ink.

    Row 0 is the top of the letters and column 0 their left, in reading direction.

    Parameters
    ----------
    text
    cap_height_px : px
        Height of a capital H.

    Raises
    ------
    InvalidParameter
        If the text has no ink.

    Examples
    --------
    >>> bitmap = lettering("H", 20.0)
    >>> bitmap.shape[0], float(bitmap[10].max()), float(bitmap[2, bitmap.shape[1] // 2])
    (20, 1.0, 0.0)
    """
    import cv2
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        raise InvalidParameter(f"the text {text!r} leaves no ink; it needs at least one visible letter")
    font = FontProperties(family=FONT, weight="bold")
    capital = TextPath((0, 0), "H", size=100, prop=font).get_extents().height
    scale = cap_height_px * OVERSAMPLING / capital
    outlines = [np.asarray(p) * scale for p in TextPath((0, 0), text, size=100, prop=font).to_polygons()]
    points = np.concatenate(outlines)
    left, top = points[:, 0].min(), points[:, 1].max()
    width, height = np.ceil((np.ptp(points, axis=0) - 1e-6) / OVERSAMPLING).astype(int)
    fine = np.zeros((height * OVERSAMPLING, width * OVERSAMPLING), dtype=np.float32)
    shapes = [np.rint(np.column_stack([p[:, 0] - left, top - p[:, 1]])).astype(np.int32) for p in outlines]
    # Even-odd filling of all shapes at once keeps holes open, as in an O
    cv2.fillPoly(fine, shapes, 1.0)
    ink: Light = fine.reshape(height, OVERSAMPLING, width, OVERSAMPLING).mean(axis=(1, 3))
    return ink
