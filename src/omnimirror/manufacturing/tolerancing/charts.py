"""Drawings of what tolerances do: a tornado chart of the errors, and cumulative curves of the sensors built."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...escaping import plot_text, visible
from ...figures.style import GREY, INK, PAGE, PALETTE, new_figure
from .compensation import CALIBRATIONS, after
from .monte_carlo import Tally
from .requirement_merits import is_least
from .sensitivity import ErrorEffect, VarianceShares

MOST_BARS = 24
ROW = 0.19  # inches of a bar
MOST_SHARES = 12
HEIGHT, ACROSS, NAME_LETTERS = 2.9, 3, 30
SMALLEST = 1e-4
"""Share of the widest bar under which none is drawn: scales are logarithmic."""


def tornado(rows: Sequence[ErrorEffect]) -> Figure:
    """How far each error alone moves the picture at its tolerance, and what calibrations leave; the worst on top.

    Parameters
    ----------
    rows
        Of the errors.

    Returns
    -------
    Figure
        A chart of bars.
    """
    ranked = sorted(rows, key=lambda row: -row.merits["motion_px"])[:MOST_BARS]
    figure = new_figure(PAGE * 0.8, 0.9 + ROW * len(ranked))
    ax = figure.subplots()
    places = np.arange(len(ranked))
    shown = [("none", PALETTE[0], 0.8), ("affine", PALETTE[4], 0.5), ("pose", PALETTE[1], 0.22)]
    widest = max((m for row in ranked if np.isfinite(m := row.merits["motion_px"])), default=0.0) or 1.0
    for depth, colour, height in shown:
        name = after("motion_px", depth)  # type: ignore[arg-type]  # one of them
        sizes = [min(row.merits[name], 2 * widest) for row in ranked]
        words = "as built" if depth == "none" else f"after a calibration: {depth}"
        ax.barh(places, np.maximum(sizes, SMALLEST * widest), height, color=colour, label=words)
    ax.set_yticks(places, [f"{plot_text(row.name)}  ±{row.tolerance:.3g}" for row in ranked])
    ax.set(xscale="log", xlabel="largest motion of the picture, px")
    ax.set_xlim(SMALLEST * widest, 1.3 * widest)
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3)
    return figure


def curves(tally: Tally) -> Figure:
    """How many of the sensors built stay under which motion and blur, and keep what else is limited, with the limits.

    Parameters
    ----------
    tally
        What became of trials.

    Returns
    -------
    Figure
        A plot of motions, one of blur, and one of each other limit.
    """
    others = [name for name in tally.limits if not name.startswith("motion_px") and name != "blur_px"]
    rows = -(-len(others) // ACROSS)
    figure = new_figure(PAGE, HEIGHT * (1 + 0.8 * rows))
    grid = figure.add_gridspec(1 + rows, 2 * ACROSS)
    motion = figure.add_subplot(grid[0, : 2 * ACROSS - 2])
    blur = figure.add_subplot(grid[0, 2 * ACROSS - 2 :], sharey=motion)
    for k, name in enumerate(others):
        place = 2 * (k % ACROSS)
        _kept(figure.add_subplot(grid[1 + k // ACROSS, place : place + 2], sharey=motion), tally, name)
    for depth, colour in zip(CALIBRATIONS, PALETTE, strict=False):
        name = after("motion_px", depth)
        values, shares = tally.curve(name)
        motion.plot(values, 100 * shares, color=colour, label="as built" if depth == "none" else depth)
        if name in tally.limits:
            motion.axvline(tally.limits[name], color=colour, linewidth=0.8, linestyle=":")
    motion.set(xscale="log", xlabel="largest motion of the picture, px", ylabel="sensors under it, %")
    motion.set_title("motion, and what calibrations leave")
    blur.tick_params(labelleft=False)
    figure.legend(*motion.get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=5)
    values, shares = tally.curve("blur_px")
    blur.plot(values, 100 * shares, color=INK)
    if "blur_px" in tally.limits:
        blur.axvline(tally.limits["blur_px"], color=GREY, linewidth=0.8, linestyle=":")
    blur.set(xlabel="worst blur, px")
    blur.set_title("blur")
    blur.set_ylim(0, 101)
    return figure


def _kept(ax: Axes, tally: Tally, name: str) -> None:
    """How many sensors keep which limit of a merit."""
    values, shares = tally.curve(name)
    kept = 1 - tally.lost / tally.trials - shares if is_least(name) else shares
    ax.plot(values, 100 * kept, color=INK)
    ax.axvline(tally.limits[name], color=GREY, linewidth=0.8, linestyle=":")
    ax.set_xlabel(textwrap.fill(visible(name), NAME_LETTERS), parse_math=False)
    ax.set_title("sensors above it, %" if is_least(name) else "sensors under it, %")


def variance_chart(found: VarianceShares) -> Figure:
    """What groups and single errors have of the variance of each merit: alone, and with all that they do together.

    Parameters
    ----------
    found
        Their shares.

    Returns
    -------
    Figure
        A plot for each merit.
    """
    merits = list(found.shares)
    rows = min(MOST_SHARES, max(len(shares) for shares in found.shares.values()))
    figure = new_figure(PAGE, 0.9 + len(merits) * (0.5 + ROW * rows))
    for ax, merit in zip(np.ravel(figure.subplots(len(merits), 1, squeeze=False)), merits, strict=True):
        ranked = sorted(found.shares[merit].items(), key=lambda item: -item[1].total)[:MOST_SHARES]
        places = np.arange(len(ranked))
        total, first = ([100 * getattr(share, what) for _, share in ranked] for what in ("total", "first"))
        errors = [200 * share.total_error for _, share in ranked]
        ax.barh(places, total, 0.8, color=PALETTE[5], label="with all that it does together with others", xerr=errors,
                error_kw={"ecolor": GREY, "elinewidth": 0.8})  # fmt: skip
        ax.barh(places, np.maximum(first, 0.0), 0.35, color=PALETTE[0], label="alone")
        ax.set_yticks(places, [_told(name, found) for name, _ in ranked])
        for label, (name, _) in zip(ax.get_yticklabels(), ranked, strict=True):
            label.set_fontweight("bold" if name in found.groups else "normal")
        ax.set_xlim(0.0, None)
        ax.set_title(f"share of the variance of {merit}, %")
        ax.invert_yaxis()
        ax.grid(visible=False, axis="y")
    figure.legend(*ax.get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=2)
    return figure


def _told(name: str, found: VarianceShares) -> str:
    words = plot_text(name)
    return f"{words} ({len(found.groups[name])})" if name in found.groups else words
