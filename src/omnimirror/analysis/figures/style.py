"""Common style of all figures: sizes, colours, axes and output.

Figures are created with :class:`matplotlib.figure.Figure` directly instead of pyplot; therefore no
global state is changed, and a server may draw in any thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase, get_registered_canvas_class
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...base.errors import InvalidParameter
from ...base.files import replacing
from .labels import axis_label

COLUMN, PAGE = 3.46, 7.2  # widths in inches of one and of two columns of a journal

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colour-blind-safe palette of Okabe and Ito, in the order of the sensors."""

INK, GREY, PALE = "#222222", "#777777", "#D9D9D9"

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": 7,
    "axes.titlesize": 7.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 7,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "figure.constrained_layout.h_pad": 0.04,
    "figure.constrained_layout.w_pad": 0.04,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "savefig.dpi": 200,
    "svg.fonttype": "none",  # text remains searchable, editable and accessible
    "svg.hashsalt": "omnimirror",  # reproducible files
    "path.simplify": False,
    "axes.unicode_minus": True,
}

FORMATS = {"svg": 72, "png": STYLE["savefig.dpi"], "pdf": 72}
"""Output formats with the resolution, in dpi, of text measurements."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches, with a layout that keeps labels within its bounds."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)  # its renderer persists with all measured texts
    return figure


def grid_of_axes(figure: Figure, rows: int, columns: int, count: int, **options: Any) -> list[Axes]:
    """Return ``count`` axes that fill rows from the left; remaining cells are empty."""
    axes: list[Axes] = list(np.ravel(figure.subplots(rows, columns, squeeze=False, **options)))
    for spare in axes[count:]:
        spare.remove()
    return axes[:count]


def panel_title(ax: Axes, index: int, text: str, of: int = 2) -> None:
    """Set a title such as "(b) Aspect"; a single panel has no letter."""
    ax.set_title(f"({chr(ord('a') + index)}) {text}" if of > 1 else text)


def angle_axis(ax: Axes, high_deg: float, most_ticks: int = 10) -> None:
    """Set the horizontal axis to field angles from 0 to the largest one."""
    step = next((s for s in (1, 5, 15, 30) if high_deg / s <= most_ticks), 45)
    ax.set_xlim(0, high_deg)
    ax.set_xticks(step * np.arange(np.floor(high_deg / step + 1e-3) + 1))
    ax.set_xlabel(axis_label("omega_deg", titled=True))


def zero_line(ax: Axes) -> None:
    ax.axhline(0.0, color=GREY, linewidth=0.5, zorder=1)


def bare(ax: Axes) -> None:
    """Remove frame, ticks and grid, for a drawing instead of a plot."""
    ax.set_axis_off()
    ax.set_aspect("equal")


def styled() -> AbstractContextManager[None]:
    """Return a context with the figure style, without a permanent global change."""
    return mpl.rc_context(cast(Any, STYLE))


def render(figure: Figure, kind: str = "svg") -> bytes:
    """Return the bytes of an image file, reproducible for the same figure.

    Raises
    ------
    InvalidParameter
        Unknown format.
    """
    if kind not in FORMATS:
        raise InvalidParameter(f"figures are written as {', '.join(FORMATS)}, not as {kind or 'nothing'}")
    undated: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    data = BytesIO()
    with styled(), _laid_out(figure, kind) as canvas:
        getattr(canvas, f"print_{kind}")(data, metadata=undated[kind])
    return data.getvalue()


@contextmanager
def _laid_out(figure: Figure, kind: str) -> Iterator[FigureCanvasBase]:
    """Provide the canvas of a format, with the figure laid out for its text widths.

    ``figure.savefig`` would draw the whole figure twice.
    """
    layout, before, dpi = figure.get_layout_engine(), figure.canvas, figure.dpi
    canvas = get_registered_canvas_class(kind)(figure)
    try:
        if layout is not None:
            figure.dpi = FORMATS[kind]
            layout.execute(figure)
            figure.set_layout_engine("none")
        figure.dpi = STYLE["savefig.dpi"]
        yield canvas
    finally:
        figure.set_layout_engine(layout)
        figure.dpi, figure.canvas = dpi, before


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure in the format of the file extension.

    Raises
    ------
    InvalidParameter
        Unknown format.
    OmnimirrorError
        File that cannot be written.
    """
    path = Path(path)
    data = render(figure, path.suffix.lstrip(".").lower())
    with replacing(path) as temporary:
        temporary.write_bytes(data)
    return path
