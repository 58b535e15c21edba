"""Fig. 17, the image of a sensor with its dewarped views, and maps over the image."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import COLUMN, INK, PAGE, new_figure, panel_title, styled


def three_pictures(circle: NDArray[Any], panorama: NDArray[Any], zoom: NDArray[Any]) -> Figure:
    """Draw Fig. 17: circular image, panorama and zoom, each (rows, columns, 3) uint8 in RGB order.

    The panorama has the full width, below the other two, which have equal heights.
    """
    inner = PAGE - 0.15
    shapes = [picture.shape[1] / picture.shape[0] for picture in (circle, zoom)]
    above, below = inner / sum(shapes), inner * panorama.shape[0] / panorama.shape[1]
    with styled():
        figure = new_figure(PAGE, above + below + 0.55)
        grid = figure.add_gridspec(2, 2, width_ratios=shapes, height_ratios=[above, below])
        places = ((grid[0, 0], circle), (grid[1, :], panorama), (grid[0, 1], zoom))
        titles = ("Circular picture", "Panorama, 360°", "Zoom")
        for i, ((place, picture), title) in enumerate(zip(places, titles, strict=True)):
            ax = figure.add_subplot(place)
            _show(ax, picture)
            panel_title(ax, i, title)
    return figure


def error_map(columns: NDArray[Any], rows: NDArray[Any], error: NDArray[Any], unit: str, title: str) -> Figure:
    """Draw errors (rows, columns), NaN without a value, over an image, with contour lines."""
    seen = error[np.isfinite(error) & (error > 0)]
    with styled():
        figure = new_figure(COLUMN * 1.5, COLUMN * 1.5 * len(rows) / len(columns) + 0.3)
        ax = figure.subplots()
        ax.set_aspect("equal")
        ax.grid(visible=False)
        ax.set_title(title)
        ax.set_xlabel("u (px)")
        ax.set_ylabel("v (px)")
        ax.set_xlim(columns[0], columns[-1])
        ax.set_ylim(rows[-1], rows[0])
        if seen.size:
            low, high = np.percentile(seen, [0.5, 95.0])  # the errors of a floor diverge towards the horizon
            scale = LogNorm(low, max(high, 1.01 * low))
            drawn = ax.pcolormesh(columns, rows, np.ma.masked_invalid(error), norm=scale, cmap="viridis_r")
            drawn.set_rasterized(True)
            levels = _round_levels(low, high)
            if len(levels):
                lines = ax.contour(columns, rows, error, levels=levels, colors=INK, linewidths=0.4)
                ax.clabel(lines, fontsize=6, fmt="%g")
            bar = figure.colorbar(drawn, ax=ax, shrink=0.7, extend="max")
            bar.set_label(f"standard deviation ({unit})")
            bar.ax.minorticks_off()
            ticks = levels if len(levels) > 1 else np.array([low, high])
            bar.set_ticks([float(tick) for tick in ticks], labels=[f"{tick:.3g}" for tick in ticks])
    return figure


def _round_levels(low: float, high: float) -> NDArray[Any]:
    """Return the numbers 1, 2 and 5 times powers of ten in a range."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    levels = np.sort(np.outer(decades, [1.0, 2.0, 5.0]).ravel())
    return levels[(levels > low) & (levels < high)]


def _show(ax: Axes, picture: NDArray[Any]) -> None:
    ax.set_axis_off()
    ax.imshow(picture, interpolation="antialiased")
