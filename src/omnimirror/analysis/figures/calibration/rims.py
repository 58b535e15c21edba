"""Figures of mirror-outline detection: the rim, and the image of the camera at its centre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from ....base.escaping import plot_text
from ..style import PAGE, PALETTE, grid_of_axes, new_figure, styled

LARGEST_PX = 1200  # maximum side length as drawn
MOST_COLUMNS = 4


class DrawnRim(NamedTuple):
    """Image with its detected outline."""

    picture: NDArray[Any]
    """Image (rows, columns[, 3]), RGB."""
    rim_px: NDArray[np.float64]
    """Points (n, 2) of the rim, a closed curve."""
    centre_px: tuple[float, float]
    camera_px: tuple[float, float, float] | None
    """Centre and radius of the image of the camera."""
    is_sure: bool
    title: str


def found_rims(found: Sequence[DrawnRim]) -> Figure:
    """Draw each image with its rim, dashed if uncertain, and the image of the camera dotted."""
    columns = min(len(found), MOST_COLUMNS)
    rows = -(-len(found) // columns)
    aspect = max(one.picture.shape[0] / one.picture.shape[1] for one in found)
    with styled():
        figure = new_figure(PAGE, rows * (PAGE / columns * aspect + 0.2))
        for ax, one in zip(grid_of_axes(figure, rows, columns, len(found)), found, strict=True):
            _draw(ax, one)
    return figure


def _draw(ax: Axes, one: DrawnRim) -> None:
    height, width = one.picture.shape[:2]
    every = max(1, max(height, width) // LARGEST_PX)
    shown = one.picture[::every, ::every]
    low, high = -0.5, 0.5
    ax.imshow(shown, extent=(low, width - high, height - high, low), cmap="gray", interpolation="antialiased")
    closed = np.concatenate([one.rim_px, one.rim_px[:1]])
    for colour, thickness in (("white", 2.2), (PALETTE[1], 1.1)):
        ax.plot(closed[:, 0], closed[:, 1], "-" if one.is_sure else "--", color=colour, linewidth=thickness)
    if one.camera_px is not None:
        u, v, radius = one.camera_px
        ax.add_patch(Circle((u, v), radius, fill=False, color=PALETTE[5], linewidth=1.1, linestyle=":"))
    ax.plot(*one.centre_px, "+", color=PALETTE[1], markersize=6)
    ax.set_xlim(low, width - high)
    ax.set_ylim(height - high, low)
    ax.set_axis_off()
    ax.set_title(plot_text(one.title))
