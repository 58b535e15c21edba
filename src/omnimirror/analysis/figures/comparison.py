"""Figures of a comparison: curves with a common legend, cross-sections at one scale, images."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ...base.escaping import label, plot_text
from ...base.quantities import QUANTITIES
from ...optics.sensor import Sensor
from ..section import lens_height
from .curves import hidden_bands, value_limits
from .labels import axis_label
from .style import PAGE, angle_axis, bare, new_figure, panel_title, styled, zero_line
from .subjects import EXACT, Subject, subjects_of, widest

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
        Too few or too many sensors.
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
        handles = [Line2D([], [], color=s.colour, linestyle=d, label=s.name) for s, d in _styles(subjects)]
        columns = min(len(handles), 3)
        figure.legend(handles=handles, loc="outside upper center", ncols=columns, frameon=False, handlelength=3.4)
    return figure


def _styles(subjects: Sequence[Subject]) -> list[tuple[Subject, Any]]:
    return list(zip(subjects, DASHES, strict=False))


def _panel(ax: Axes, subjects: Sequence[Subject], column: str) -> None:
    """Draw one column of the evaluation table for all sensors."""
    zero_line(ax)
    for s, dash in _styles(subjects):
        ax.plot(s.curve.omega_deg, getattr(s.curve, column), color=s.colour, linestyle=dash, gid=f"{s.name}:{column}")
    value_limits(ax, [getattr(s.curve, column) for s in subjects])
    angle_axis(ax, widest(subjects), most_ticks=9)
    hidden_bands(ax, subjects)


def _cross_sections(ax: Axes, subjects: Sequence[Subject]) -> None:
    """Draw mirrors and lenses at one scale with a common vertex, and the rim ray to each lens."""
    ax.set_aspect("equal", adjustable="datalim", anchor="N")
    for s, dash in _styles(subjects):
        rim, second = s.rim_mm, s.sensor.secondary
        x = np.linspace(-rim, rim, 201)
        look = {"color": s.colour, "linestyle": dash}
        ax.plot(x, s.sensor.mirror.sag(np.abs(x)), gid=f"{s.name}:section", **look)
        first = s.sensor.meridian.trace(rim).first
        at = float(first.x)
        way = [(rim, float(s.sensor.mirror.sag(rim)))]
        if second is not None:
            half = second.mirror.rim_radius_mm
            x = np.linspace(-half, half, 101)
            ax.plot(x, second.height(np.abs(x)), **look)
            way.append((at, float(second.height(first.x))))
        lens = (at if s.sensor.lens.TELECENTRIC else 0.0, lens_height(s.sensor))
        ax.plot(*np.transpose([*way, lens]), color=s.colour, linewidth=0.5)
        if not s.sensor.lens.TELECENTRIC:
            ax.plot(*lens, "o", color=s.colour, markersize=3.2, clip_on=False)
    ax.set_xlabel("x (mm)")
    ax.set_ylabel("z (mm)")


def picture_sheet(names: Sequence[str], circles: Sequence[NDArray[Any]], panoramas: Sequence[NDArray[Any]]) -> Figure:
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


def _show(ax: Axes, picture: NDArray[Any], name: str) -> None:
    bare(ax)
    ax.imshow(picture, interpolation="antialiased")
    ax.set_title(plot_text(name))


def table_sheet(header: Sequence[str], lines: Sequence[Sequence[str]], best: Sequence[Sequence[bool]]) -> Figure:
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
            at = left + (j + 1) * width
            fitting = int(width * PAGE / 0.062)  # characters
            ax.text(
                at,
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
                mark: dict[str, Any] = {"weight": "bold", "color": "#006B4A"} if best[i][j] else {}
                ax.text(left + (j + 1) * width, i, cell, ha="right", va="center", **mark)
    return figure
