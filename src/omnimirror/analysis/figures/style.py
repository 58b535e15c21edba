"""One style for every figure: sizes, colours, axes, saving.

Figures are drawn with :class:`matplotlib.figure.Figure` directly and never through pyplot, so nothing
global changes and a server may draw in any thread.
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
"""Okabe and Ito's colours, told apart by the colour-blind too; the order is that of the sensors."""

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
    "svg.fonttype": "none",  # text stays text: it can be searched, edited and read aloud
    "svg.hashsalt": "omnimirror",  # the same figure gives the same file
    "path.simplify": False,
    "axes.unicode_minus": True,
}

FORMATS = {"svg": 72, "png": STYLE["savefig.dpi"], "pdf": 72}
"""What figures are written as, and at how many dots to the inch texts are measured there."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, whose layout keeps labels from being cut off."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)  # whose renderer stays, with all texts that it has measured
    return figure


def grid_of_axes(figure: Figure, rows: int, columns: int, count: int, **options: Any) -> list[Axes]:
    """``count`` axes filling rows from the left; places left over stay empty."""
    axes: list[Axes] = list(np.ravel(figure.subplots(rows, columns, squeeze=False, **options)))
    for spare in axes[count:]:
        spare.remove()
    return axes[:count]


def panel_title(ax: Axes, index: int, text: str, of: int = 2) -> None:
    """Title such as "(b) Aspect"; a lone panel needs no letter."""
    ax.set_title(f"({chr(ord('a') + index)}) {text}" if of > 1 else text)


def angle_axis(ax: Axes, high_deg: float, most_ticks: int = 10) -> None:
    """Horizontal axis of field angles, from 0 to the largest one."""
    step = next((s for s in (1, 5, 15, 30) if high_deg / s <= most_ticks), 45)
    ax.set_xlim(0, high_deg)
    ax.set_xticks(step * np.arange(np.floor(high_deg / step + 1e-3) + 1))
    ax.set_xlabel(axis_label("omega_deg", titled=True))


def zero_line(ax: Axes) -> None:
    ax.axhline(0.0, color=GREY, linewidth=0.5, zorder=1)


def bare(ax: Axes) -> None:
    """No frame, ticks or grid: a drawing, not a plot."""
    ax.set_axis_off()
    ax.set_aspect("equal")


def styled() -> AbstractContextManager[None]:
    """The style for as long as a block lasts; nothing global stays changed."""
    return mpl.rc_context(cast(Any, STYLE))


def render(figure: Figure, kind: str = "svg") -> bytes:
    """The bytes of a picture file, the same ones for the same figure.

    Raises
    ------
    InvalidParameter
        A format that is not known.
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
    """The canvas of a format, its figure laid out for the widths that texts have there.

    ``figure.savefig`` would draw all of it twice for that.
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
    """Write a figure in the format that its file name ends in.

    Raises
    ------
    InvalidParameter
        A format that is not known.
    OmnimirrorError
        The file cannot be written.
    """
    path = Path(path)
    data = render(figure, path.suffix.lstrip(".").lower())
    with replacing(path) as temporary:
        temporary.write_bytes(data)
    return path
