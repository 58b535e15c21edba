"""What designs trade for what: a front of designs, with known sensors marked on the same two scales."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from .labels import spread
from .style import GREY, INK, PAGE, PALETTE, new_figure

Array = NDArray[np.float64]

TEXT = 6.5


def front(points: ArrayLike, labels: tuple[str, str], marks: Mapping[str, tuple[float, float]]) -> Figure:
    """Two merits of a front's designs (n, 2), both the better the smaller, and those of named sensors.

    What lies above and to the right of the line is beaten by a design on it.
    """
    at = np.asarray(points, dtype=float)
    known = np.array([*marks.values()]).reshape(-1, 2)
    figure = new_figure(PAGE * 0.72, 3.2)
    ax = figure.subplots()
    ax.set(xlabel=labels[0], ylabel=labels[1])
    _scales(ax, np.vstack([at, known]))
    ax.plot(*at.T, color=INK, linewidth=1.0, marker="o", markersize=2.2, markeredgewidth=0, zorder=3)
    ax.annotate("best designs", at[len(at) // 2], xytext=(6, 6), textcoords="offset points", size=TEXT, color=INK)
    ax.set_title("better: down and to the left", size=TEXT, weight="normal", color=GREY)
    for colour, place in zip(PALETTE * len(known), known, strict=False):
        ax.plot(*place, color=colour, marker="D", markersize=4.5, linestyle="none", zorder=4)
    _names(figure, ax, list(marks), known)
    return figure


def _scales(ax: Axes, values: Array) -> None:
    """Logarithmic scales with plain numbers, a little wider than the values (n, 2)."""
    low, high = values.min(axis=0), values.max(axis=0)
    room = (high / low) ** 0.07
    ax.set(xscale="log", yscale="log", xlim=(low[0] / room[0], high[0] * room[0]))
    ax.set_ylim(low[1] / room[1], high[1] * room[1])
    for axis, span in zip((ax.xaxis, ax.yaxis), high / low, strict=True):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if span > 8 else (1, 1.5, 2, 3, 4, 5, 6, 8)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(which="minor", length=0)


def _names(figure: Figure, ax: Axes, names: list[str], places: Array) -> None:
    """A name beside each mark, on its side with more room, moved up or down where names would meet."""
    figure.draw_without_rendering()
    point = figure.dpi / 72
    shown = ax.transData.transform(places) / point if len(places) else places
    box = ax.get_window_extent()
    middle = (box.x0 + box.x1) / 2 / point
    for on_left in (False, True):
        chosen = [i for i in range(len(names)) if (shown[i, 0] > middle) == on_left]
        heights = spread([shown[i, 1] for i in chosen], 1.25 * TEXT, box.y0 / point, box.y1 / point)
        for i, y in zip(chosen, heights, strict=True):
            ax.annotate(
                names[i], places[i], xytext=(-8 if on_left else 8, y - shown[i, 1]), textcoords="offset points",
                size=TEXT, color=PALETTE[i % len(PALETTE)], ha="right" if on_left else "left", va="center",
            )  # fmt: skip
