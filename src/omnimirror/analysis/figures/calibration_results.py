"""Figures of a calibration: residuals, coverage, and the detected mirror outline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from ...base.escaping import escape_invisible, plot_text
from ...base.typing import Array
from .style import COLUMN, GREY, INK, PAGE, PALE, PALETTE, grid_of_axes, new_figure, panels, styled

__all__ = [
    "coverage_map",
    "residual_histograms",
    "residual_vectors",
    "residuals_by_image",
    "residuals_by_radius",
]


# -- Calibration residuals -------------------------------------------------------------------------

RELATIVE_ARROW_LENGTH = 0.03  # relative to the image width, for a residual of the median length
BINS = 12
MAX_LABELS = 30  # labelled images


def residual_vectors(
    pixels: Array,
    residuals: Array,
    image_size: tuple[int, int],
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Draw magnified arrows from observed corners to their predicted positions.

    Parameters
    ----------
    pixels : (n, 2)
        Corners, px.
    residuals : (n, 2)
        Predicted minus observed position, px.
    image_size
        Width and height of the image.
    """
    width, height = image_size
    figure, (ax,) = panels((PAGE, PAGE * height / width + 0.3), (1, 1), 1, axes)
    lengths = np.hypot(*residuals.T)
    median = float(np.median(lengths)) or 1.0
    factor = RELATIVE_ARROW_LENGTH * width / median
    ax.quiver(
        *pixels.T,
        *(residuals * factor).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.0012,
        color=PALETTE[0],
        headwidth=4,
        headlength=4,
    )
    u, v = 0.02 * width, 0.97 * height
    ax.plot([u, u + RELATIVE_ARROW_LENGTH * width], [v, v], color=INK, linewidth=1.5)
    ax.text(u + 1.3 * RELATIVE_ARROW_LENGTH * width, v, f"{median:.2g} px", va="center")
    ax.set(
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
        aspect="equal",
        xlabel="u (px)",
        ylabel="v (px)",
    )
    ax.set_title(f"Residuals, enlarged {factor:.0f} times")
    ax.grid(visible=False)
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
    return figure


def residuals_by_radius(
    radii: Array, radial: Array, across: Array, axes: Sequence[Axes] | None = None
) -> Figure:
    """Draw radial and tangential residuals against the radius; a trend indicates a model error.

    Parameters
    ----------
    radii : (n,)
        Radii of the corners from the centre, px.
    radial, across : (n,)
        Residuals, px.
    """
    figure, both = panels((PAGE, 0.75 * COLUMN), (1, 2), 2, axes, sharey=True)
    limit = 1.05 * float(np.percentile(np.abs([radial, across]), 99.5))
    edges = np.quantile(radii, np.linspace(0, 1, BINS + 1))
    cell = np.clip(np.searchsorted(edges, radii, side="right") - 1, 0, BINS - 1)
    for ax, values, title in zip(both, (radial, across), ("Radial", "Tangential"), strict=True):
        ax.plot(radii, values, ".", markersize=1.5, color=PALE, rasterized=True)
        middles, means, spreads = [], [], []
        for i in range(BINS):
            inside = values[cell == i]
            if len(inside) > 1:
                middles.append(float(radii[cell == i].mean()))
                means.append(float(inside.mean()))
                spreads.append(float(inside.std() / np.sqrt(len(inside))))
        ax.errorbar(middles, means, spreads, fmt="o", markersize=3, linewidth=0.8, color=PALETTE[0])
        ax.axhline(0.0, color=INK, linewidth=0.5)
        ax.set(xlabel="radius (px)", title=title, ylim=(-limit, limit))
    both[0].set_ylabel("residual (px)")
    return figure


def residuals_by_image(
    names: Sequence[str],
    fit_px: Array,
    held_out_px: Array,
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Draw the RMS residual of each image, in the fit and in cross-validation.

    Parameters
    ----------
    names
        Names of the images.
    fit_px, held_out_px : (n,)
        RMS residuals, px; NaN without a value.
    """
    count = len(names)
    figure, (ax,) = panels((PAGE, 0.7 * COLUMN), (1, 1), 1, axes)
    positions = np.arange(count)
    ax.bar(positions, np.nan_to_num(fit_px), width=0.7, color=PALE, label="fit")
    if np.isfinite(held_out_px).any():
        ax.plot(positions, held_out_px, "o", markersize=3.5, color=PALETTE[1], label="held out")
    step = max(1, count // MAX_LABELS)
    ax.set_xticks(
        positions[::step],
        [_short(n) for n in names][::step],
        rotation=60,
        ha="right",
        rotation_mode="anchor",
    )
    ax.set(ylabel="RMS (px)", title="Residuals by image", xlim=(-0.6, count - 0.4))
    ax.grid(visible=False, axis="x")
    ax.legend(frameon=False, loc="upper left", ncols=2)
    ax.set_ylim(0, 1.25 * max(float(np.nanmax(fit_px)), float(np.nanmax([*held_out_px, 0.0]))))
    return figure


def residual_histograms(
    residuals: Array, noise_px: float, axes: Sequence[Axes] | None = None
) -> Figure:
    """Draw histograms of the residuals in both directions, with a normal distribution.

    Parameters
    ----------
    residuals : (n, 2)
        Predicted minus observed position, px.
    noise_px
        Standard deviation of a coordinate.
    """
    figure, both = panels((PAGE, 0.65 * COLUMN), (1, 2), 2, axes, sharey=True)
    limit = 4.5 * noise_px
    edges = np.linspace(-limit, limit, 46)
    x = np.linspace(-limit, limit, 200)
    normal = (
        np.exp(-0.5 * (x / noise_px) ** 2)
        / (noise_px * np.sqrt(2 * np.pi))
        * len(residuals)
        * (edges[1] - edges[0])
    )
    for ax, values, name in zip(both, residuals.T, "uv", strict=True):
        ax.hist(np.clip(values, -limit, limit), edges.tolist(), color=PALE)
        ax.plot(x, normal, color=PALETTE[0])
        ax.set(xlabel=f"residual in {name} (px)", xlim=(-limit, limit))
        ax.text(
            0.98,
            0.95,
            f"mean {values.mean():+.3f} px",
            transform=ax.transAxes,
            ha="right",
            va="top",
            color=GREY,
        )
    both[0].set_ylabel("corners")
    return figure


def _short(name: str) -> str:
    """Return the distinguishing end of a long name."""
    stem = escape_invisible(name.rsplit("/", 1)[-1])
    return plot_text(stem if len(stem) <= 16 else f"…{stem[-15:]}")


# -- Coverage and direction uncertainty ------------------------------------------------------------


def coverage_map(
    boards: Sequence[Array],
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    radii_px: Array,
    sigma_deg: Array | None = None,
    axes: Sequence[Axes] | None = None,
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
    figure, (ax,) = panels((PAGE, 0.86 * PAGE * height / width + 0.3), (1, 1), 1, axes)
    if sigma_deg is not None and np.isfinite(sigma_deg).any():
        image = ax.imshow(
            sigma_deg,
            extent=(-0.5, width - 0.5, height - 0.5, -0.5),
            cmap="Greys",
            vmin=0.0,
            vmax=float(np.nanpercentile(sigma_deg, 98)),
            interpolation="bilinear",
            alpha=0.7,
        )
        figure.colorbar(image, ax=ax, label="direction error, 1 sigma (deg)", shrink=0.7, pad=0.01)
    for i, corners in enumerate(boards):
        colour = PALETTE[i % len(PALETTE)]
        ax.plot(*corners.T, ".", markersize=1.5, color=colour)
        if len(corners) > 2:
            ax.add_patch(
                Polygon(_hull(corners), closed=True, fill=False, edgecolor=colour, linewidth=0.6)
            )
    angle = np.linspace(0, 2 * np.pi, 181)
    for radius in radii_px[1:]:
        ax.plot(
            centre_px[0] + radius * np.cos(angle),
            centre_px[1] + radius * np.sin(angle),
            color=GREY,
            linewidth=0.5,
            linestyle=":",
        )
    ax.plot(*centre_px, "+", color=INK)
    ax.set(
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
        aspect="equal",
        xlabel="u (px)",
        ylabel="v (px)",
    )
    ax.set_title("Detected corners")
    ax.grid(visible=False)
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
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


# -- Mirror-outline detection ----------------------------------------------------------------------

MAX_SIDE_PX = 1200  # maximum side length as drawn
MAX_COLUMNS = 4


class RimDrawing(NamedTuple):
    """Image with its detected outline."""

    image: NDArray[Any]
    """Image (rows, columns[, 3]), RGB."""
    rim_px: NDArray[np.float64]
    """Points (n, 2) of the rim, a closed curve."""
    centre_px: tuple[float, float]
    camera_px: tuple[float, float, float] | None
    """Centre and radius of the image of the camera."""
    is_sure: bool
    title: str


def detected_rims(drawings: Sequence[RimDrawing]) -> Figure:
    """Draw each image with its rim, dashed if uncertain, and the image of the camera dotted."""
    columns = min(len(drawings), MAX_COLUMNS)
    rows = -(-len(drawings) // columns)
    aspect = max(drawing.image.shape[0] / drawing.image.shape[1] for drawing in drawings)
    with styled():
        figure = new_figure(PAGE, rows * (PAGE / columns * aspect + 0.2))
        for ax, drawing in zip(
            grid_of_axes(figure, rows, columns, len(drawings)), drawings, strict=True
        ):
            _draw_rim(ax, drawing)
    return figure


def _draw_rim(ax: Axes, drawing: RimDrawing) -> None:
    height, width = drawing.image.shape[:2]
    every = max(1, max(height, width) // MAX_SIDE_PX)
    image = drawing.image[::every, ::every]
    low, high = -0.5, 0.5
    ax.imshow(
        image,
        extent=(low, width - high, height - high, low),
        cmap="gray",
        interpolation="antialiased",
    )
    closed = np.concatenate([drawing.rim_px, drawing.rim_px[:1]])
    for colour, thickness in (("white", 2.2), (PALETTE[1], 1.1)):
        ax.plot(
            closed[:, 0],
            closed[:, 1],
            "-" if drawing.is_sure else "--",
            color=colour,
            linewidth=thickness,
        )
    if drawing.camera_px is not None:
        u, v, radius = drawing.camera_px
        ax.add_patch(
            Circle((u, v), radius, fill=False, color=PALETTE[5], linewidth=1.1, linestyle=":")
        )
    ax.plot(*drawing.centre_px, "+", color=PALETTE[1], markersize=6)
    ax.set_xlim(low, width - high)
    ax.set_ylim(height - high, low)
    ax.set_axis_off()
    ax.set_title(plot_text(drawing.title))
