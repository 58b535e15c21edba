"""Fig. 17: the picture of a sensor, and what straightening makes of it."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import PAGE, new_figure, panel_title, styled


def three_pictures(circle: NDArray[Any], panorama: NDArray[Any], zoom: NDArray[Any]) -> Figure:
    """Fig. 17: circular picture, panorama and zoom, each (rows, columns, 3) uint8 in RGB order.

    The panorama takes the whole width; above it stand the other two, equally high.
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


def _show(ax: Axes, picture: NDArray[Any]) -> None:
    ax.set_axis_off()
    ax.imshow(picture, interpolation="antialiased")
