"""A sheet as a layout of a DXF file: its lines, filled areas and letters where they are on the paper, in mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.text import Text

from ...escaping import dxf_text
from .sheet import CAPITAL, POINT, Sheet

LAYER, STYLE = "SHEET", "OpenSans"
ALIGNMENTS = {"left": "", "center": "CENTER", "right": "RIGHT"}
UPRIGHT = {"baseline": "left", "bottom": "left", "center": "center", "top": "right"}
WIDTHS = (18, 25, 35, 50, 70, 100)
"""Of lines that DXF files know, 1/100 mm."""


def add_layout(doc: Any, sheet: Sheet) -> None:
    """Add a sheet to an ezdxf document, as a layout as large as its paper."""
    doc.layers.add(LAYER)
    layout = doc.layouts.new(sheet.size)
    layout.page_setup(size=(sheet.width, sheet.height), margins=(0, 0, 0, 0), units="mm")
    for line in sheet.ax.lines:
        _add_line(doc, layout, line)
    for patch in sheet.ax.patches:
        corners = np.asarray(patch.get_path().vertices)[:-1]
        layout.add_solid([*map(tuple, corners)], dxfattribs=_look(patch.get_facecolor()))
    for text in sheet.ax.texts:
        _add_text(layout, text)
    doc.layouts.delete("Layout1")  # empty


def _add_line(doc: Any, layout: Any, line: Line2D) -> None:
    points = np.stack([line.get_xdata(), line.get_ydata()], axis=-1)
    wide = line.get_linewidth() / POINT
    look = _look(line.get_color()) | {"lineweight": min(WIDTHS, key=lambda w: abs(w - 100 * wide))}
    _, dashes = line._unscaled_dash_pattern  # type: ignore[attr-defined]  # what set_dashes was given
    if dashes:
        look["linetype"] = _linetype(doc, [d * wide for d in dashes])
        look["ltscale"] = 1.0 / doc.header["$LTSCALE"]
    layout.add_lwpolyline([*map(tuple, points)], dxfattribs=look)


def _linetype(doc: Any, dashes: list[float]) -> str:
    """The name of a pattern of dashes and gaps, mm."""
    name = "SHEET_" + "_".join(f"{100 * d:.0f}" for d in dashes)
    if name not in doc.linetypes:
        signed = [d if i % 2 == 0 else -d for i, d in enumerate(dashes)]
        doc.linetypes.add(name, [sum(dashes), *signed])
    return name


def _add_text(layout: Any, text: Text) -> None:
    from ezdxf.enums import TextEntityAlignment

    across: str = text.get_horizontalalignment()
    along: str = text.get_verticalalignment()
    if text.get_rotation():  # a sheet aligns what comes out upright, DXF the words before they are turned
        across, along = UPRIGHT[along], {"right": "bottom", "center": "center", "left": "top"}[across]
    level = {"baseline": "", "center": "MIDDLE", "bottom": "BOTTOM", "top": "TOP"}[along]
    side = ALIGNMENTS[across]
    name = f"{level}_{side or 'LEFT'}" if level else side or "LEFT"
    words = layout.add_text(
        dxf_text(text.get_text()), height=float(text.get_fontsize()) / POINT * CAPITAL, rotation=text.get_rotation(),
        dxfattribs={"style": STYLE, **_look(text.get_color())},
    )  # fmt: skip
    words.set_placement(text.get_position(), align=TextEntityAlignment[name])


def _look(colour: Any) -> dict[str, Any]:
    red, green, blue = (round(255 * c) for c in to_rgb(colour))
    return {"layer": LAYER, "true_color": red << 16 | green << 8 | blue}
