"""Pareto fronts of designs, with reference sensors on the same axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from ...base.escaping import plot_text
from ...base.typing import Array
from .labels import spread
from .style import GREY, INK, PAGE, PALETTE, new_figure

TEXT = 6.5
BESIDE, NEAR = 8.0, 30.0  # points: distance of a label from its mark, and search range for neighbouring marks
RIGHT = 0.65  # relative to the width: marks beyond it have their labels on the left
LEADER: dict[str, Any] = {"arrowstyle": "-", "color": GREY, "linewidth": 0.4, "shrinkA": 1.0, "shrinkB": 4.0}
RINGED: dict[str, Any] = {"markersize": 4.5, "markeredgewidth": 0.8}


def front(
    points: ArrayLike,
    labels: tuple[str, str],
    marks: Mapping[str, tuple[float, float]],
    others: Mapping[str, tuple[float, float]],
) -> Figure:
    """Draw two merits of the designs (n, 2) of a front, and those of named sensors.

    ``marks`` are drawn as coloured diamonds, ``others`` as rings, which keeps coincident marks
    visible. Points above and to the right of the line are dominated by a design on it.
    """
    at = np.asarray(points, dtype=float)
    known = np.array([*marks.values(), *others.values()]).reshape(-1, 2)
    colours = [PALETTE[i % len(PALETTE)] for i in range(len(marks))] + [INK] * len(others)
    figure = new_figure(PAGE * 0.72, 3.2)
    ax = figure.subplots()
    ax.set(xlabel=labels[0], ylabel=labels[1])
    _scales(ax, np.vstack([at, known]))
    ax.plot(*at.T, color=INK, linewidth=1.0, marker="o", markersize=2.2, markeredgewidth=0, zorder=3)
    ax.annotate("best designs", at[0], xytext=(6, 4), textcoords="offset points", size=TEXT, color=INK)
    ax.set_title("better: down and to the left", size=TEXT, weight="normal", color=GREY)
    for i, (colour, place) in enumerate(zip(colours, known, strict=True)):
        ring = {} if i < len(marks) else {"markerfacecolor": "none", "markersize": 8.0}
        ax.plot(*place, color=colour, marker="o" if ring else "D", linestyle="none", zorder=4, **RINGED | ring)
    _names(figure, ax, [*marks, *others], known, colours)
    return figure


def _scales(ax: Axes, values: Array) -> None:
    """Set logarithmic scales with plain numbers and a margin around the values (n, 2)."""
    low, high = values.min(axis=0), values.max(axis=0)
    room = (high / low) ** 0.07
    ax.set(xscale="log", yscale="log", xlim=(low[0] / room[0], high[0] * room[0]))
    ax.set_ylim(low[1] / room[1], high[1] * room[1])
    for axis, span in zip((ax.xaxis, ax.yaxis), high / low, strict=True):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if span > 8 else (1, 1.5, 2, 3, 4, 5, 6, 8)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(which="minor", length=0)


def _names(figure: Figure, ax: Axes, names: list[str], places: Array, colours: list[str]) -> None:
    """Draw a label next to each mark, shifted to avoid other marks and labels."""
    if not names:
        return
    figure.draw_without_rendering()
    point = figure.dpi / 72
    shown = ax.transData.transform(places) / point
    box = ax.get_window_extent()
    turn = (box.x0 + RIGHT * box.width) / point
    heights = spread(shown[:, 1], 1.25 * TEXT, box.y0 / point, box.y1 / point)
    texts = [plot_text(name) for name in names]
    for i, y in enumerate(heights):
        side = 1 if shown[i, 0] <= turn else -1
        along = side * (shown[:, 0] - shown[i, 0])
        beside = (np.abs(shown[:, 1] - y) < TEXT) & (along >= 0) & (along < NEAR)
        reach = float(along[beside].max(initial=0.0))
        is_far = abs(y - shown[i, 1]) > 1.5 * TEXT
        ax.annotate(
            texts[i], places[i], xytext=(side * (reach + BESIDE), y - shown[i, 1]), textcoords="offset points",
            size=TEXT, color=colours[i], ha="left" if side > 0 else "right", va="center",
            arrowprops=LEADER | {"relpos": (0.5 - side / 2, 0.5)} if is_far else None,
        )  # fmt: skip
