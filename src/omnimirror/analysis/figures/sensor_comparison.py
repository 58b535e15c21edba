"""Figures of a comparison: curves, cross-sections, images and Pareto fronts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from ...base.escaping import label, plot_text
from ...base.quantities import QUANTITIES
from ...base.typing import Array
from ...optics.sensor import Sensor
from ..cross_section import lens_height
from .curves import obscured_bands, value_limits
from .style import (
    GREY,
    INK,
    PAGE,
    PALETTE,
    angle_axis,
    axis_label,
    bare,
    new_figure,
    panel_title,
    separated_positions,
    styled,
    zero_line,
)
from .subjects import EXACT, Subject, subjects_of, widest

# -- Comparison of sensors -------------------------------------------------------------------------

PANELS = ("h_px", "dh_domega_px_per_deg", "blur_t_deg", "blur_s_deg", "aspect", "viewpoint_z_mm")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 2)),
    (0, (2, 1.4)),
    (0, (6, 1.5, 1.5, 1.5)),
    (0, (1, 1.2)),
    (0, (8, 2, 2, 2, 2, 2)),
)
"""Dash pattern of each sensor, which keeps coincident curves distinguishable."""


def side_by_side(sensors: Sequence[Sensor]) -> Figure:
    """Draw six quantities against the field angle, and the cross-sections, for one to six sensors.

    Raises
    ------
    InvalidParameter
        If there are too few or too many sensors.
    """
    with styled():
        subjects = subjects_of(sensors, EXACT)
        figure = new_figure(PAGE, 6.4)
        grid = figure.add_gridspec(3, 3, width_ratios=(1, 1, 0.72))
        for i, column in enumerate(PANELS):
            ax = figure.add_subplot(grid[i // 2, i % 2])
            panel_title(ax, i, QUANTITIES[column].title)
            _panel(ax, subjects, column)
            ax.set_ylabel(axis_label(column))
        section = figure.add_subplot(grid[:, 2])
        panel_title(section, len(PANELS), "Cross-sections")
        _cross_sections(section, subjects)
        handles = [
            Line2D([], [], color=s.colour, linestyle=d, label=s.name) for s, d in _styles(subjects)
        ]
        columns = min(len(handles), 3)
        figure.legend(
            handles=handles,
            loc="outside upper center",
            ncols=columns,
            frameon=False,
            handlelength=3.4,
        )
    return figure


def _styles(subjects: Sequence[Subject]) -> list[tuple[Subject, Any]]:
    return list(zip(subjects, DASHES, strict=False))


def _panel(ax: Axes, subjects: Sequence[Subject], column: str) -> None:
    """Draw one column of the evaluation table for all sensors."""
    zero_line(ax)
    for s, dash in _styles(subjects):
        ax.plot(
            s.curve.omega_deg,
            getattr(s.curve, column),
            color=s.colour,
            linestyle=dash,
            gid=f"{s.name}:{column}",
        )
    value_limits(ax, [getattr(s.curve, column) for s in subjects])
    angle_axis(ax, widest(subjects), max_ticks=9)
    obscured_bands(ax, subjects)


def _cross_sections(ax: Axes, subjects: Sequence[Subject]) -> None:
    """Draw mirrors and lenses at one scale with a common vertex, and the rim ray to each lens."""
    ax.set_aspect("equal", adjustable="datalim", anchor="N")
    for s, dash in _styles(subjects):
        rim, second = s.rim_mm, s.sensor.secondary
        x = np.linspace(-rim, rim, 201)
        style = {"color": s.colour, "linestyle": dash}
        ax.plot(x, s.sensor.mirror.sag(np.abs(x)), gid=f"{s.name}:section", **style)
        first = s.sensor.meridian.trace(rim).first
        lens_x = float(first.x)
        path = [(rim, float(s.sensor.mirror.sag(rim)))]
        if second is not None:
            half = second.mirror.rim_radius_mm
            x = np.linspace(-half, half, 101)
            ax.plot(x, second.height(np.abs(x)), **style)
            path.append((lens_x, float(second.height(first.x))))
        lens = (lens_x if s.sensor.lens.TELECENTRIC else 0.0, lens_height(s.sensor))
        ax.plot(*np.transpose([*path, lens]), color=s.colour, linewidth=0.5)
        if not s.sensor.lens.TELECENTRIC:
            ax.plot(*lens, "o", color=s.colour, markersize=3.2, clip_on=False)
    ax.set_xlabel("x (mm)")
    ax.set_ylabel("z (mm)")


def image_sheet(
    names: Sequence[str], circles: Sequence[NDArray[Any]], panoramas: Sequence[NDArray[Any]]
) -> Figure:
    """Draw the images of one scene by several sensors, and their panoramas, at one scale.

    Images are (rows, columns, 3) uint8 in RGB order.
    """
    columns, count = min(len(names), 3), len(names)
    rows = -(-count // columns)
    inner = PAGE - 0.15
    tall, wide = inner / columns, inner * max(p.shape[0] / p.shape[1] for p in panoramas)
    heights = [tall] * rows + [wide] * count
    with styled():
        figure = new_figure(PAGE, sum(heights) + 0.24 * len(heights))
        grid = figure.add_gridspec(rows + count, columns, height_ratios=heights)
        for i, name in enumerate(names):
            _show(figure.add_subplot(grid[i // columns, i % columns]), circles[i], name)
            _show(figure.add_subplot(grid[rows + i, :]), panoramas[i], name)
    return figure


def _show(ax: Axes, image: NDArray[Any], name: str) -> None:
    bare(ax)
    ax.imshow(image, interpolation="antialiased")
    ax.set_title(plot_text(name))


def table_sheet(
    header: Sequence[str], lines: Sequence[Sequence[str]], is_best: Sequence[Sequence[bool]]
) -> Figure:
    """Draw a table: title, unit and one cell for each sensor, with the best of each row in bold.

    ``lines`` contains title, unit and cells; ``best`` is the mask of marked cells.
    """
    row = 0.165
    with styled():
        figure = Figure(figsize=(PAGE, row * (len(lines) + 3.2)))
        ax = figure.add_axes((0, 0, 1, 1))
        ax.set_axis_off()
        ax.set_xlim(0, 1)
        ax.set_ylim(len(lines) + 0.4, -2.8)
        left, width = 0.28, 0.71 / len(header)
        for j, name in enumerate(header):
            right_edge = left + (j + 1) * width
            fitting = int(width * PAGE / 0.062)  # characters
            ax.text(
                right_edge,
                -0.8,
                fill(label(name), fitting),
                parse_math=False,
                ha="right",
                va="baseline",
                weight="bold",
                linespacing=1.1,
            )
        for i, (title, unit, *cells) in enumerate(lines):
            if i % 2 == 0:
                ax.axhspan(i - 0.5, i + 0.5, color="#F5F7F8", linewidth=0)
            ax.text(0.01, i, title, va="center")
            ax.text(left, i, unit, va="center", ha="right", color="#777777")
            for j, cell in enumerate(cells):
                mark: dict[str, Any] = (
                    {"weight": "bold", "color": "#006B4A"} if is_best[i][j] else {}
                )
                ax.text(left + (j + 1) * width, i, cell, ha="right", va="center", **mark)
    return figure


# -- Pareto fronts ---------------------------------------------------------------------------------

LABEL_SIZE = 6.5
LABEL_DISTANCE, LABEL_SEARCH_RANGE = (
    8.0,
    30.0,
)  # points: distance of a label from its mark, and search range for neighbouring marks
LEFT_LABEL_FROM = 0.65  # relative to the width: marks beyond it have their labels on the left
LEADER_STYLE: dict[str, Any] = {
    "arrowstyle": "-",
    "color": GREY,
    "linewidth": 0.4,
    "shrinkA": 1.0,
    "shrinkB": 4.0,
}
REFERENCE_MARKS: dict[str, Any] = {"markersize": 4.5, "markeredgewidth": 0.8}


def front(
    points: ArrayLike,
    labels: tuple[str, str],
    marks: Mapping[str, tuple[float, float]],
    references: Mapping[str, tuple[float, float]],
) -> Figure:
    """Draw two merits of the designs (n, 2) of a front, and those of named sensors.

    ``marks`` are drawn as coloured diamonds, ``others`` as rings, which keeps coincident marks
    visible. Points above and to the right of the line are dominated by a design on it.
    """
    designs = np.asarray(points, dtype=float)
    sensor_points = np.array([*marks.values(), *references.values()]).reshape(-1, 2)
    colours = [PALETTE[i % len(PALETTE)] for i in range(len(marks))] + [INK] * len(references)
    figure = new_figure(PAGE * 0.72, 3.2)
    ax = figure.subplots()
    ax.set(xlabel=labels[0], ylabel=labels[1])
    _scales(ax, np.vstack([designs, sensor_points]))
    ax.plot(
        *designs.T,
        color=INK,
        linewidth=1.0,
        marker="o",
        markersize=2.2,
        markeredgewidth=0,
        zorder=3,
    )
    ax.annotate(
        "best designs",
        designs[0],
        xytext=(6, 4),
        textcoords="offset points",
        size=LABEL_SIZE,
        color=INK,
    )
    ax.set_title("better: lower left", size=LABEL_SIZE, weight="normal", color=GREY)
    for i, (colour, point) in enumerate(zip(colours, sensor_points, strict=True)):
        ring_style = {} if i < len(marks) else {"markerfacecolor": "none", "markersize": 8.0}
        ax.plot(
            *point,
            color=colour,
            marker="o" if ring_style else "D",
            linestyle="none",
            zorder=4,
            **REFERENCE_MARKS | ring_style,
        )
    _draw_names(figure, ax, [*marks, *references], sensor_points, colours)
    return figure


def _scales(ax: Axes, values: Array) -> None:
    """Set logarithmic scales with plain numbers and a margin around the values (n, 2)."""
    low, high = values.min(axis=0), values.max(axis=0)
    margin = (high / low) ** 0.07
    ax.set(xscale="log", yscale="log", xlim=(low[0] / margin[0], high[0] * margin[0]))
    ax.set_ylim(low[1] / margin[1], high[1] * margin[1])
    for axis, span in zip((ax.xaxis, ax.yaxis), high / low, strict=True):
        axis.set_major_locator(
            LogLocator(subs=(1, 2, 5) if span > 8 else (1, 1.5, 2, 3, 4, 5, 6, 8))
        )
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(which="minor", length=0)


def _draw_names(
    figure: Figure, ax: Axes, names: list[str], points: Array, colours: list[str]
) -> None:
    """Draw a label next to each mark, shifted to avoid other marks and labels."""
    if not names:
        return
    figure.draw_without_rendering()
    point = figure.dpi / 72
    positions = ax.transData.transform(points) / point
    box = ax.get_window_extent()
    turn = (box.x0 + LEFT_LABEL_FROM * box.width) / point
    heights = separated_positions(
        positions[:, 1], 1.25 * LABEL_SIZE, box.y0 / point, box.y1 / point
    )
    texts = [plot_text(name) for name in names]
    for i, y in enumerate(heights):
        side = 1 if positions[i, 0] <= turn else -1
        along = side * (positions[:, 0] - positions[i, 0])
        is_beside = (
            (np.abs(positions[:, 1] - y) < LABEL_SIZE) & (along >= 0) & (along < LABEL_SEARCH_RANGE)
        )
        offset = float(along[is_beside].max(initial=0.0))
        is_far = abs(y - positions[i, 1]) > 1.5 * LABEL_SIZE
        ax.annotate(
            texts[i],
            points[i],
            xytext=(side * (offset + LABEL_DISTANCE), y - positions[i, 1]),
            textcoords="offset points",
            size=LABEL_SIZE,
            color=colours[i],
            ha="left" if side > 0 else "right",
            va="center",
            arrowprops=LEADER_STYLE | {"relpos": (0.5 - side / 2, 0.5)} if is_far else None,
        )
