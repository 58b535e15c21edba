"""Common style of all figures: sizes, colours, axes, labels and output.

Figures are created with :class:`matplotlib.figure.Figure` directly; therefore no global state is
changed, and a server may draw in any thread. Only :mod:`omnimirror.apps.plot` uses pyplot.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase, get_registered_canvas_class
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from ...base.arguments import choice
from ...base.errors import InvalidParameter
from ...base.files import atomic_output
from ...base.quantities import QUANTITIES
from ...base.typing import Array

# -- Axis and line labels --------------------------------------------------------------------------

LABEL_INDENT_PT = 7.0  # distance of line labels from the axes


def axis_label(name: str, titled: bool = False) -> str:
    """Return symbol and unit of a quantity for an axis, optionally with its title.

    >>> axis_label("distance_t_mm"), axis_label("h_px", titled=True)
    ('L$_t$ (mm)', 'Image height h (px)')
    """
    q = QUANTITIES[name]
    symbol = re.sub(r"_(\w)", r"$_\1$", q.symbol)
    parts = [q.title] * titled + [symbol] + [f"({q.unit})"] * bool(q.unit)
    return " ".join(parts)


def axis_title(name: str) -> str:
    """Return title and unit of a quantity, for an axis with several symbols or none.

    >>> axis_title("blur_area_deg2"), axis_title("relative")
    ('Blur area (deg²)', 'Relative illumination')
    """
    q = QUANTITIES[name]
    return f"{q.title} ({q.unit})" if q.unit else q.title


def axis_of_both(name: str, *parts: str) -> str:
    """Return the title of a quantity, the symbols of its parts, and their unit.

    >>> axis_of_both("blur_px", "blur_t_px", "blur_s_px")
    'Blur Δ$_t$, Δ$_s$ (px)'
    """
    symbols = (axis_label(part).split(" (")[0] for part in parts)
    return f"{QUANTITIES[name].title} {', '.join(symbols)} ({QUANTITIES[name].unit})"


def separated_positions(desired_positions: ArrayLike, gap: float, low: float, high: float) -> Array:
    """Return positions (n,) with a minimum distance ``gap`` between low and high, as near as
    possible to the desired ones.

    The order is preserved. Least squares with these constraints are an isotonic regression after
    subtraction of the gaps. If the range is too small, the gap is reduced.

    >>> separated_positions([0.0, 1.0, 1.0, 9.0], gap=2.0, low=-5.0, high=9.0)
    array([-1.3..., 0.6..., 2.6..., 9. ])
    """
    desired: Array = np.asarray(desired_positions, dtype=float)
    if desired.size < 2:
        return np.clip(desired, low, high)
    order = np.argsort(desired, kind="stable")
    gap = min(gap, (high - low) / (desired.size - 1))
    offsets = gap * np.arange(desired.size)
    free: Array = isotonic_regression(desired[order] - offsets).x
    positions = np.empty_like(desired)
    positions[order] = np.clip(free, low, high - offsets[-1]) + offsets
    return positions


def displayed_points(ax: Axes, line: Line2D) -> NDArray[np.bool_]:
    """Return the mask of the points of a line within the axis limits."""
    x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
    (left, right), (bottom, top) = sorted(ax.get_xlim()), sorted(ax.get_ylim())
    return (x >= left) & (x <= right) & (y >= bottom) & (y <= top)


@dataclass
class EndLabels:
    """Labels to the right of the axes, one per line; call :meth:`settle` after drawing."""

    figure: Figure
    size: float = field(default_factory=lambda: text_size(6.5))
    follows_layout: bool = True
    """True to place the labels at each layout; False for once, in a figure of the caller."""
    _labels: dict[Axes, list[Annotation]] = field(default_factory=dict)

    def of_line(self, ax: Axes, line: Line2D, text: str) -> None:
        """Label the last visible point of a line in its colour."""
        visible = np.flatnonzero(displayed_points(ax, line))
        if visible.size:
            x, y = (
                float(np.asarray(v, float)[visible[-1]])
                for v in (line.get_xdata(), line.get_ydata())
            )
            self.at(ax, x, y, text, str(line.get_color()))

    def at(self, ax: Axes, x: float, y: float, text: str, colour: str) -> None:
        """Label a point (data coordinates), connected to it by a thin line."""
        hairline = {
            "arrowstyle": "-",
            "color": colour,
            "linewidth": 0.4,
            "shrinkA": 0.5,
            "shrinkB": 1,
            "relpos": (0, 0.5),
        }
        label = ax.annotate(
            text,
            (x, y),
            xytext=(1.0, y),
            textcoords=ax.get_yaxis_transform()
            + ScaledTranslation(LABEL_INDENT_PT / 72, 0, self.figure.dpi_scale_trans),
            color=colour,
            size=self.size,
            va="center",
            annotation_clip=False,
            arrowprops=hairline,
        )
        self._labels.setdefault(ax, []).append(label)

    def settle(self) -> Figure:
        """Place all labels at each layout of the figure; call it last, with final limits."""
        if self.follows_layout:
            self.figure.set_layout_engine(_LayoutWithLabels(self))
        elif (layout := self.figure.get_layout_engine()) is not None:
            layout.execute(self.figure)
        self.place()
        return self.figure

    def place(self) -> None:
        """Place all labels for the current positions of the axes."""
        for ax, labels in self._labels.items():
            ax.apply_aspect()
            box = ax.get_window_extent()
            desired = [float(ax.transData.transform(label.xy)[1]) for label in labels]
            line_height = 1.18 * self.size * self.figure.dpi / 72
            positions = separated_positions(desired, line_height, box.y0, box.y1)
            for label, y in zip(labels, positions, strict=True):
                inverse = ax.transData.inverted().transform((0.0, float(y)))
                label.set_position((label.get_position()[0], float(inverse[1])))


class _LayoutWithLabels(ConstrainedLayoutEngine):
    """Matplotlib layout followed by the placement of the labels."""

    def __init__(self, labels: EndLabels) -> None:
        super().__init__()
        self._labels = labels

    def execute(self, fig: Figure) -> Any:
        grids = super().execute(fig)
        self._labels.place()
        return grids


# -- Sizes, colours, axes and output ---------------------------------------------------------------

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

STYLES: dict[str, dict[str, Any]] = {
    "paper": {},
    "slides": {
        "font.size": 10,
        "axes.linewidth": 0.9,
        "grid.linewidth": 0.7,
        "xtick.major.width": 0.9,
        "ytick.major.width": 0.9,
        "lines.linewidth": 2.0,
    },
}
"""Changes of :data:`STYLE` by name: for journals, and larger text and lines for slides."""

TEXT_SIZES = ("axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize")
"""Settings that are proportional to the font size."""

FORMATS = {"svg": 72, "png": STYLE["savefig.dpi"], "pdf": 72}
"""Output formats with the resolution, in dpi, of text measurements."""


_uses_pyplot: ContextVar[bool] = ContextVar("_uses_pyplot", default=False)


@contextmanager
def pyplot_figures() -> Iterator[None]:
    """Register new figures with pyplot, for ``plt.show()`` and display in notebooks."""
    token = _uses_pyplot.set(True)
    try:
        yield
    finally:
        _uses_pyplot.reset(token)


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches, with a layout that keeps labels within its bounds."""
    if _uses_pyplot.get():
        from matplotlib import pyplot

        return pyplot.figure(figsize=(width, height), layout="constrained")
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)  # its renderer persists with all measured texts
    return figure


def grid_of_axes(figure: Figure, rows: int, columns: int, count: int, **options: Any) -> list[Axes]:
    """Return ``count`` axes that fill rows from the left; remaining cells are empty."""
    axes: list[Axes] = list(np.ravel(figure.subplots(rows, columns, squeeze=False, **options)))
    for spare in axes[count:]:
        spare.remove()
    return axes[:count]


def panels(
    size: tuple[float, float],
    shape: tuple[int, int],
    count: int,
    axes: Sequence[Axes] | None = None,
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """Return figure and axes of ``count`` panels: those of the caller, or of a new figure.

    Raises
    ------
    InvalidParameter
        If the number of axes differs from ``count``.
    """
    if axes is None:
        figure = new_figure(*size)
        return figure, grid_of_axes(figure, *shape, count, **options)
    if len(axes) != count:
        raise InvalidParameter(
            f"ax must be {'an array of ' * (count > 1)}{count} axes, one for each panel of the "
            f"figure; got {len(axes)}"
        )
    return axes[0].figure.figure, list(axes)


def panel_title(ax: Axes, index: int, text: str, of: int = 2) -> None:
    """Set a title such as "(b) Aspect"; a single panel has no letter."""
    ax.set_title(f"({chr(ord('a') + index)}) {text}" if of > 1 else text)


def angle_axis(ax: Axes, high_deg: float, max_ticks: int = 10) -> None:
    """Set the horizontal axis to field angles from 0 to the largest one."""
    step = next((s for s in (1, 5, 15, 30) if high_deg / s <= max_ticks), 45)
    ax.set_xlim(0, high_deg)
    ax.set_xticks(step * np.arange(np.floor(high_deg / step + 1e-3) + 1))
    ax.set_xlabel(axis_label("omega_deg", titled=True))


def zero_line(ax: Axes) -> None:
    ax.axhline(0.0, color=GREY, linewidth=0.5, zorder=1)


def bare(ax: Axes) -> None:
    """Remove frame, ticks and grid, for a drawing instead of a plot."""
    ax.set_axis_off()
    ax.set_aspect("equal")


def styled(style: str = "paper") -> AbstractContextManager[None]:
    """Return a context with a style of :data:`STYLES`, without a permanent global change.

    Settings (``matplotlib.rcParams``) that differ from the defaults of Matplotlib are retained.

    Raises
    ------
    InvalidParameter
        If the style is unknown.
    """
    choice("style", style, STYLES)
    settings = {**STYLE, **STYLES[style]}
    retained = {
        name: value
        for name, value in mpl.rcParams.items()
        if name in settings and value != mpl.rcParamsDefault[name]
    }
    scale = float(retained.get("font.size", settings["font.size"])) / STYLE["font.size"]
    scaled = {name: scale * STYLE[name] for name in TEXT_SIZES}
    return mpl.rc_context(cast(Any, {**settings, **scaled, **retained}))


def text_size(points: float) -> float:
    """Return a text size for the current font size, given the size for the default of 7 pt."""
    return points * float(mpl.rcParams["font.size"]) / float(STYLE["font.size"])


def render(figure: Figure, kind: str = "svg") -> bytes:
    """Return the bytes of an image file, reproducible for the same figure.

    Raises
    ------
    InvalidParameter
        If the format is unknown.
    """
    if kind not in FORMATS:
        raise InvalidParameter(
            f"the format of a figure must be one of {', '.join(FORMATS)}; got {kind or 'none'}"
        )
    undated: dict[str, dict[str, Any]] = {
        "svg": {"Date": None},
        "pdf": {"CreationDate": None},
        "png": {},
    }
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
        If the format is unknown.
    OmnimirrorError
        If the file cannot be written.
    """
    path = Path(path)
    data = render(figure, path.suffix.lstrip(".").lower())
    with atomic_output(path) as temporary:
        temporary.write_bytes(data)
    return path
