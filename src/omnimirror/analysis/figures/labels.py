"""Axis labels, and line labels at the right edge without overlap."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from ...base.quantities import QUANTITIES
from ...base.typing import Array

INDENT_PT = 7.0  # distance of line labels from the axes


def axis_label(name: str, titled: bool = False) -> str:
    """Return symbol and unit of a quantity for an axis, optionally with its title.

    >>> axis_label("distance_t_mm"), axis_label("h_px", titled=True)
    ('L$_t$ (mm)', 'Image height h (px)')
    """
    q = QUANTITIES[name]
    symbol = re.sub(r"_(\w)", r"$_\1$", q.symbol)
    words = [q.title] * titled + [symbol] + [f"({q.unit})"] * bool(q.unit)
    return " ".join(words)


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


def spread(sought: ArrayLike, gap: float, low: float, high: float) -> Array:
    """Return positions (n,) with a minimum distance ``gap`` between low and high, as near as
    possible to the desired ones.

    The order is preserved. Least squares with these constraints are an isotonic regression after
    subtraction of the gaps. If the range is too small, the gap is reduced.

    >>> spread([0.0, 1.0, 1.0, 9.0], gap=2.0, low=-5.0, high=9.0)
    array([-1.3..., 0.6..., 2.6..., 9. ])
    """
    at: Array = np.asarray(sought, dtype=float)
    if at.size < 2:
        return np.clip(at, low, high)
    order = np.argsort(at, kind="stable")
    gap = min(gap, (high - low) / (at.size - 1))
    taken = gap * np.arange(at.size)
    free: Array = isotonic_regression(at[order] - taken).x
    placed = np.empty_like(at)
    placed[order] = np.clip(free, low, high - taken[-1]) + taken
    return placed


def shown_points(ax: Axes, line: Line2D) -> NDArray[np.bool_]:
    """Return the mask of the points of a line within the axis limits."""
    x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
    (left, right), (bottom, top) = sorted(ax.get_xlim()), sorted(ax.get_ylim())
    return (x >= left) & (x <= right) & (y >= bottom) & (y <= top)


@dataclass
class EndLabels:
    """Labels to the right of the axes, one per line; call :meth:`settle` after drawing."""

    figure: Figure
    size: float = 6.5
    _labels: dict[Axes, list[Annotation]] = field(default_factory=dict)

    def of_line(self, ax: Axes, line: Line2D, text: str) -> None:
        """Label the last visible point of a line in its colour."""
        shown = np.flatnonzero(shown_points(ax, line))
        if shown.size:
            x, y = (float(np.asarray(v, float)[shown[-1]]) for v in (line.get_xdata(), line.get_ydata()))
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
            textcoords=ax.get_yaxis_transform() + ScaledTranslation(INDENT_PT / 72, 0, self.figure.dpi_scale_trans),
            color=colour,
            size=self.size,
            va="center",
            annotation_clip=False,
            arrowprops=hairline,
        )
        self._labels.setdefault(ax, []).append(label)

    def settle(self) -> Figure:
        """Place all labels at each layout of the figure; call it last, with final limits."""
        self.place()
        self.figure.set_layout_engine(_LayoutWithLabels(self))
        return self.figure

    def place(self) -> None:
        """Place all labels for the current positions of the axes."""
        for ax, labels in self._labels.items():
            ax.apply_aspect()
            box = ax.get_window_extent()
            sought = [float(ax.transData.transform(label.xy)[1]) for label in labels]
            line_height = 1.18 * self.size * self.figure.dpi / 72
            placed = spread(sought, line_height, box.y0, box.y1)
            for label, y in zip(labels, placed, strict=True):
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
