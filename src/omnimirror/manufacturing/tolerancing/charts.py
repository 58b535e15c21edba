"""Charts of a tolerance analysis: tornado chart, cumulative yield curves, and variance
decomposition.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...analysis.figures.style import GREY, INK, PAGE, PALETTE, new_figure, panels
from ...base.escaping import escape_invisible, plot_text
from .compensation import CALIBRATIONS, after
from .evaluator import is_lower_limit
from .monte_carlo import YieldStatistics
from .sensitivity import ErrorSensitivity, VarianceDecomposition

MAX_BARS = 24
ROW = 0.19  # height of a bar, inches
MAX_SHARES = 12
HEIGHT, ACROSS, NAME_LETTERS = 2.9, 3, 30
MIN_BAR_FRACTION = 1e-4
"""Minimum bar length as a fraction of the longest bar on the logarithmic scale."""


def plot_tornado(rows: Sequence[ErrorSensitivity], axes: Sequence[Axes] | None = None) -> Figure:
    """Plot the image motion of each error at its tolerance, and residuals after calibrations.

    Parameters
    ----------
    rows
        Effects of the errors.
    axes
        One panel; by default that of a new figure.

    Returns
    -------
    Figure
        Tornado chart, largest effect on top.
    """
    ranked = sorted(rows, key=lambda row: -row.merits["motion_px"])[:MAX_BARS]
    figure, (ax,) = panels((PAGE * 0.8, 0.9 + ROW * len(ranked)), (1, 1), 1, axes)
    positions = np.arange(len(ranked))
    imaged = [("none", PALETTE[0], 0.8), ("affine", PALETTE[4], 0.5), ("pose", PALETTE[1], 0.22)]
    max_tolerances = (
        max((m for row in ranked if np.isfinite(m := row.merits["motion_px"])), default=0.0) or 1.0
    )
    for depth, colour, height in imaged:
        name = after("motion_px", depth)  # type: ignore[arg-type]  # one of them
        sizes = [min(row.merits[name], 2 * max_tolerances) for row in ranked]
        description = "as built" if depth == "none" else f"after calibration: {depth}"
        ax.barh(
            positions,
            np.maximum(sizes, MIN_BAR_FRACTION * max_tolerances),
            height,
            color=colour,
            label=description,
        )
    ax.set_yticks(positions, [f"{plot_text(row.name)}  ±{row.tolerance:.3g}" for row in ranked])
    ax.set(xscale="log", xlabel="maximum image motion, px")
    ax.set_xlim(MIN_BAR_FRACTION * max_tolerances, 1.3 * max_tolerances)
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3)
    return figure


def motion_curves(statistics: YieldStatistics, axes: Sequence[Axes] | None = None) -> Figure:
    """Plot cumulative distributions of the image motion, as built and after calibrations.

    Parameters
    ----------
    statistics
        Statistics of the trials.
    axes
        One panel; by default that of a new figure.

    Returns
    -------
    Figure
        The first panel of :func:`curves`, with a legend.
    """
    figure, (ax,) = panels((PAGE * 0.6, HEIGHT), (1, 1), 1, axes)
    _draw_motion(ax, statistics)
    ax.set_ylim(0, 101)
    ax.legend(frameon=False, loc="lower right")
    return figure


def _draw_motion(ax: Axes, statistics: YieldStatistics) -> None:
    for depth, colour in zip(CALIBRATIONS, PALETTE, strict=False):
        name = after("motion_px", depth)
        values, fractions = statistics.curve(name)
        label = "as built" if depth == "none" else depth
        ax.plot(values, 100 * fractions, color=colour, label=label)
        if name in statistics.limits:
            ax.axvline(statistics.limits[name], color=colour, linewidth=0.8, linestyle=":")
    ax.set(xscale="log", xlabel="maximum image motion, px", ylabel="sensors below, %")
    ax.set_title("motion, as built and after calibration")


def curves(statistics: YieldStatistics) -> Figure:
    """Plot cumulative distributions of motion, blur and other limited merits with their limits.

    Parameters
    ----------
    statistics
        Statistics of the trials.

    Returns
    -------
    Figure
        One plot for motions, one for blur, and one per other limit.
    """
    others = [
        name for name in statistics.limits if not name.startswith("motion_px") and name != "blur_px"
    ]
    rows = -(-len(others) // ACROSS)
    figure = new_figure(PAGE, HEIGHT * (1 + 0.8 * rows))
    grid = figure.add_gridspec(1 + rows, 2 * ACROSS)
    motion = figure.add_subplot(grid[0, : 2 * ACROSS - 2])
    blur = figure.add_subplot(grid[0, 2 * ACROSS - 2 :], sharey=motion)
    for k, name in enumerate(others):
        column = 2 * (k % ACROSS)
        _kept(
            figure.add_subplot(grid[1 + k // ACROSS, column : column + 2], sharey=motion),
            statistics,
            name,
        )
    _draw_motion(motion, statistics)
    blur.tick_params(labelleft=False)
    figure.legend(
        *motion.get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=5
    )
    values, fractions = statistics.curve("blur_px")
    blur.plot(values, 100 * fractions, color=INK)
    if "blur_px" in statistics.limits:
        blur.axvline(statistics.limits["blur_px"], color=GREY, linewidth=0.8, linestyle=":")
    blur.set(xlabel="maximum blur, px")
    blur.set_title("blur")
    blur.set_ylim(0, 101)
    return figure


def _kept(ax: Axes, statistics: YieldStatistics, name: str) -> None:
    """Plot the fraction of sensors within a limit of a merit."""
    values, fractions = statistics.curve(name)
    retained = (
        1 - statistics.lost / statistics.trials - fractions if is_lower_limit(name) else fractions
    )
    ax.plot(values, 100 * retained, color=INK)
    ax.axvline(statistics.limits[name], color=GREY, linewidth=0.8, linestyle=":")
    ax.set_xlabel(textwrap.fill(escape_invisible(name), NAME_LETTERS), parse_math=False)
    ax.set_title("sensors above, %" if is_lower_limit(name) else "sensors below, %")


def plot_variance(result: VarianceDecomposition) -> Figure:
    """Plot first-order and total Sobol indices of groups and errors for each merit.

    Parameters
    ----------
    result
        Variance decomposition.

    Returns
    -------
    Figure
        One plot per merit.
    """
    merits = list(result.indices)
    rows = min(MAX_SHARES, max(len(fractions) for fractions in result.indices.values()))
    figure = new_figure(PAGE, 0.9 + len(merits) * (0.5 + ROW * rows))
    for ax, merit in zip(
        np.ravel(figure.subplots(len(merits), 1, squeeze=False)), merits, strict=True
    ):
        ranked = sorted(result.indices[merit].items(), key=lambda item: -item[1].total)[:MAX_SHARES]
        positions = np.arange(len(ranked))
        total, first = (
            [100 * getattr(share, what) for _, share in ranked] for what in ("total", "first")
        )
        errors = [200 * share.total_error for _, share in ranked]
        ax.barh(
            positions,
            total,
            0.8,
            color=PALETTE[5],
            label="total",
            xerr=errors,
            error_kw={"ecolor": GREY, "elinewidth": 0.8},
        )
        ax.barh(positions, np.maximum(first, 0.0), 0.35, color=PALETTE[0], label="max_tolerance")
        ax.set_yticks(positions, [_label(name, result) for name, _ in ranked])
        for label, (name, _) in zip(ax.get_yticklabels(), ranked, strict=True):
            label.set_fontweight("bold" if name in result.groups else "normal")
        ax.set_xlim(0.0, None)
        ax.set_title(f"Sobol indices of {merit}, %")
        ax.invert_yaxis()
        ax.grid(visible=False, axis="y")
    figure.legend(
        *ax.get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=2
    )
    return figure


def _label(name: str, result: VarianceDecomposition) -> str:
    text = plot_text(name)
    return f"{text} ({len(result.groups[name])})" if name in result.groups else text
