"""HTML cards that notebooks display for cameras: a line drawing and a table, for light and dark
themes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .escaping import html_text
from .typing import Array

Rows = Mapping[str, str]

MAX_HEIGHT_PX, MAX_WIDTH_PX = 190.0, 230.0  # maximum size of a drawing
MARGIN_PX = 5.0
LINE_STYLES = {
    "strong": 'stroke-width="2.6"',
    "plain": 'stroke-width="1.2"',
    "fine": 'stroke-width="1" stroke-opacity=".45"',
}
CELL_STYLE = "background:none;border:0;padding:0 1.2em 0 0;text-align:left;vertical-align:top"


class Line(NamedTuple):
    """Polyline of a drawing: coordinates (n,) to the right and up, and a line style."""

    x: Array
    y: Array
    style: str


def card(title: str, kind: str, drawing: str, rows: Rows, note: str) -> str:
    """Return the HTML of a card: a drawing next to a table and a note.

    >>> "<b" in card("mine", "camera", "", {"Field": "0 to 90°"}, "")
    True
    """
    cells = "".join(
        f'<tr style="background:none"><th scope="row" style="{CELL_STYLE};font-weight:400;opacity:.75">'
        f'{html_text(name)}</th><td style="{CELL_STYLE};max-width:32em">{html_text(value)}</td></tr>'
        for name, value in rows.items()
    )
    below = f'<div style="max-width:44em;opacity:.75">{html_text(note)}</div>' if note else ""
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:.6em 1.6em;align-items:center;font:13px/1.5 system-ui,sans-serif">'
        f'{drawing}<div><b style="font-size:15px">{html_text(title)}</b> '
        f'<span style="opacity:.75">{html_text(kind)}</span>'
        f'<table style="border-collapse:collapse;margin:.3em 0;font-size:13px">{cells}</table>{below}</div></div>'
    )


def line_drawing(lines: Sequence[Line], label: str) -> str:
    """Return an SVG of lines to a common scale, in the colour of the surrounding text; "" without
    lines.
    """
    if not lines:
        return ""
    x, y = (np.concatenate([line[axis] for line in lines]) for axis in (0, 1))
    low, size = (
        (np.nanmin(x), np.nanmax(y)),
        (max(np.ptp(x[np.isfinite(x)]), 1e-9), max(np.ptp(y[np.isfinite(y)]), 1e-9)),
    )
    scale = min(MAX_WIDTH_PX / size[0], MAX_HEIGHT_PX / size[1])
    width, height = (scale * s + 2 * MARGIN_PX for s in size)
    paths = "".join(_path(line, low, scale) for line in lines)
    return (
        f'<svg role="img" aria-label="{html_text(label)}" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" fill="none" stroke="currentColor">{paths}</svg>'
    )


def _path(line: Line, low: tuple[float, float], scale: float) -> str:
    """Return an SVG path that is interrupted at NaN coordinates."""
    commands, is_down = [], False
    for u, v in zip(
        MARGIN_PX + (line.x - low[0]) * scale, MARGIN_PX + (low[1] - line.y) * scale, strict=True
    ):
        is_finite = bool(np.isfinite(u) and np.isfinite(v))
        if is_finite:
            commands.append(f"{'L' if is_down else 'M'}{u:.1f} {v:.1f}")
        is_down = is_finite
    return f'<path d="{"".join(commands)}" {LINE_STYLES[line.style]}/>'


def field_range(low_rad: float, high_rad: float) -> str:
    """Format a range of field angles.

    >>> field_range(0.0, np.pi / 2)
    '0 to 90° from the axis'
    """
    return f"{np.degrees(low_rad):.4g} to {np.degrees(high_rad):.4g}° from the axis"


def origin(notes: str, calibrated_parameters: int) -> str:
    """Describe the origin of a camera: its notes and the number of calibrated parameters."""
    parts = [notes] if notes else []
    if calibrated_parameters:
        parts.append(f"Calibrated parameters: {calibrated_parameters}, with covariance.")
    return " ".join(parts)
