"""Coverage of the image by board corners, with the uncertainty of directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ....base.typing import Array
from ..style import GREY, INK, PAGE, PALETTE, new_figure


def coverage_map(
    boards: Sequence[Array],
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    radii_px: Array,
    sigma_deg: Array | None = None,
) -> Figure:
    """Draw the corners of all boards and the counting rings over the direction uncertainty.

    Parameters
    ----------
    boards
        Corners (n, 2) of each board, px.
    image_size
        Width and height of the image.
    centre_px
        Pixel of the optical axis.
    radii_px : (rings + 1,)
        Edges of the rings.
    sigma_deg : (rows, columns), optional
        Standard deviation of directions on a grid over the image; NaN outside the field of view.
    """
    width, height = image_size
    figure = new_figure(PAGE, 0.86 * PAGE * height / width + 0.3)
    axes = figure.subplots()
    if sigma_deg is not None and np.isfinite(sigma_deg).any():
        shown = axes.imshow(
            sigma_deg, extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="Greys", vmin=0.0,
            vmax=float(np.nanpercentile(sigma_deg, 98)), interpolation="bilinear", alpha=0.7,
        )  # fmt: skip
        figure.colorbar(shown, ax=axes, label="error of a direction, 1 sigma (deg)", shrink=0.7, pad=0.01)
    for i, corners in enumerate(boards):
        colour = PALETTE[i % len(PALETTE)]
        axes.plot(*corners.T, ".", markersize=1.5, color=colour)
        if len(corners) > 2:
            axes.add_patch(Polygon(_hull(corners), closed=True, fill=False, edgecolor=colour, linewidth=0.6))
    angle = np.linspace(0, 2 * np.pi, 181)
    for radius in radii_px[1:]:
        axes.plot(
            centre_px[0] + radius * np.cos(angle), centre_px[1] + radius * np.sin(angle), color=GREY, linewidth=0.5,
            linestyle=":",
        )  # fmt: skip
    axes.plot(*centre_px, "+", color=INK)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u (px)", ylabel="v (px)")
    axes.set_title("Where corners were seen")
    axes.grid(visible=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    return figure


def _hull(points: Array) -> Array:
    """Return the convex hull (k, 2) of points, in order (Andrew's monotone chain)."""
    rows = points[np.lexsort(points.T[::-1])]
    chains = []
    for row in (rows, rows[::-1]):
        chain: list[Array] = []
        for p in row:
            while len(chain) > 1 and _turns_right(chain[-2], chain[-1], p):
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turns_right(a: Array, b: Array, c: Array) -> bool:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) <= 0
