"""Residuals of a calibration: over the image, against the radius, and per image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ....base.escaping import plot_text, visible
from ....base.typing import Array
from ..style import COLUMN, GREY, INK, PAGE, PALE, PALETTE, new_figure

LENGTH = 0.03  # relative to the image width, for a residual of the median length
BINS = 12
LABELLED = 30  # labelled images


def residual_vectors(pixels: Array, residuals: Array, image_size: tuple[int, int]) -> Figure:
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
    figure = new_figure(PAGE, PAGE * height / width + 0.3)
    axes = figure.subplots()
    lengths = np.hypot(*residuals.T)
    median = float(np.median(lengths)) or 1.0
    factor = LENGTH * width / median
    axes.quiver(
        *pixels.T, *(residuals * factor).T, angles="xy", scale_units="xy", scale=1, width=0.0012, color=PALETTE[0],
        headwidth=4, headlength=4,
    )  # fmt: skip
    u, v = 0.02 * width, 0.97 * height
    axes.plot([u, u + LENGTH * width], [v, v], color=INK, linewidth=1.5)
    axes.text(u + 1.3 * LENGTH * width, v, f"{median:.2g} px", va="center")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u (px)", ylabel="v (px)")
    axes.set_title(f"Residuals, {factor:.0f} times enlarged")
    axes.grid(visible=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    return figure


def residuals_by_radius(radii: Array, radial: Array, across: Array) -> Figure:
    """Draw radial and tangential residuals against the radius; a trend indicates a model error.

    Parameters
    ----------
    radii : (n,)
        Radii of the corners from the centre, px.
    radial, across : (n,)
        Residuals, px.
    """
    figure = new_figure(PAGE, 0.75 * COLUMN)
    limit = 1.05 * float(np.percentile(np.abs([radial, across]), 99.5))
    edges = np.quantile(radii, np.linspace(0, 1, BINS + 1))
    cell = np.clip(np.searchsorted(edges, radii, side="right") - 1, 0, BINS - 1)
    for axes, values, title in zip(
        figure.subplots(1, 2, sharey=True), (radial, across), ("Along the radius", "Across the radius"), strict=True
    ):
        axes.plot(radii, values, ".", markersize=1.5, color=PALE, rasterized=True)
        middles, means, spreads = [], [], []
        for i in range(BINS):
            inside = values[cell == i]
            if len(inside) > 1:
                middles.append(float(radii[cell == i].mean()))
                means.append(float(inside.mean()))
                spreads.append(float(inside.std() / np.sqrt(len(inside))))
        axes.errorbar(middles, means, spreads, fmt="o", markersize=3, linewidth=0.8, color=PALETTE[0])
        axes.axhline(0.0, color=INK, linewidth=0.5)
        axes.set(xlabel="radius (px)", title=title, ylim=(-limit, limit))
    figure.axes[0].set_ylabel("residual (px)")
    return figure


def residuals_by_picture(names: Sequence[str], fit_px: Array, held_out_px: Array) -> Figure:
    """Draw the RMS residual of each image, in the fit and in cross-validation.

    Parameters
    ----------
    names
        Names of the images.
    fit_px, held_out_px : (n,)
        RMS residuals, px; NaN without a value.
    """
    count = len(names)
    figure = new_figure(PAGE, 0.7 * COLUMN)
    axes = figure.subplots()
    places = np.arange(count)
    axes.bar(places, np.nan_to_num(fit_px), width=0.7, color=PALE, label="in the fit")
    if np.isfinite(held_out_px).any():
        axes.plot(places, held_out_px, "o", markersize=3.5, color=PALETTE[1], label="left out of it")
    step = max(1, count // LABELLED)
    axes.set_xticks(places[::step], [_short(n) for n in names][::step], rotation=60, ha="right", rotation_mode="anchor")
    axes.set(ylabel="RMS (px)", title="Picture by picture", xlim=(-0.6, count - 0.4))
    axes.grid(visible=False, axis="x")
    axes.legend(frameon=False, loc="upper left", ncols=2)
    axes.set_ylim(0, 1.25 * max(float(np.nanmax(fit_px)), float(np.nanmax([*held_out_px, 0.0]))))
    return figure


def residual_histograms(residuals: Array, noise_px: float) -> Figure:
    """Draw histograms of the residuals in both directions, with a normal distribution.

    Parameters
    ----------
    residuals : (n, 2)
        Predicted minus observed position, px.
    noise_px
        Standard deviation of a coordinate.
    """
    figure = new_figure(PAGE, 0.65 * COLUMN)
    reach = 4.5 * noise_px
    edges = np.linspace(-reach, reach, 46)
    x = np.linspace(-reach, reach, 200)
    normal = (
        np.exp(-0.5 * (x / noise_px) ** 2) / (noise_px * np.sqrt(2 * np.pi)) * len(residuals) * (edges[1] - edges[0])
    )
    for axes, values, name in zip(figure.subplots(1, 2, sharey=True), residuals.T, "uv", strict=True):
        axes.hist(np.clip(values, -reach, reach), edges, color=PALE)
        axes.plot(x, normal, color=PALETTE[0])
        axes.set(xlabel=f"residual in {name} (px)", xlim=(-reach, reach))
        axes.text(
            0.98, 0.95, f"mean {values.mean():+.3f} px", transform=axes.transAxes, ha="right", va="top", color=GREY
        )
    figure.axes[0].set_ylabel("corners")
    return figure


def _short(name: str) -> str:
    """Return the distinguishing end of a long name."""
    stem = visible(name.rsplit("/", 1)[-1])
    return plot_text(stem if len(stem) <= 16 else f"…{stem[-15:]}")
