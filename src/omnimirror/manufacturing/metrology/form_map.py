"""Figures of a form error: map, residuals, meridian and largest terms."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...analysis.figures.style import GREY, INK, PAGE, PALETTE, new_figure
from ...base.numerics import noll
from ...base.typing import Array
from .form_errors import FormError

MAX_DOTS = 20_000
GRID = 301
MAX_BARS = 12


def plot_form_error(form: FormError) -> Figure:
    """Plot the fitted form, residuals of the points, the meridian, and the largest terms.

    Parameters
    ----------
    form
        Form error of a measured mirror.

    Returns
    -------
    Figure
        Four panels, in um along the axis.
    """
    figure = new_figure(PAGE, 6.2)
    (fitted, left), (meridian, terms) = figure.subplots(2, 2)
    axis = np.linspace(-form.mirror.rim_radius_mm, form.mirror.rim_radius_mm, GRID)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= form.mirror.rim_radius_mm
    height = np.full(x.shape, np.nan)
    height[inside] = form.at(x[inside], y[inside])
    height -= np.nanmean(height)
    extent = (axis[0], axis[-1], axis[0], axis[-1])
    imaged = fitted.imshow(
        height, origin="lower", extent=extent, cmap="RdBu_r", **_limits(height[inside])
    )
    figure.colorbar(imaged, ax=fitted, label="um")
    fitted.set_title(f"form: {form.peak_to_valley_um:.3g} um PV, {form.rms_um:.3g} um rms")
    some = slice(None, None, max(len(form.x_mm) // MAX_DOTS, 1))
    residual = form.residual_um[some]
    dots = left.scatter(
        form.x_mm[some],
        form.y_mm[some],
        c=residual,
        s=1.5,
        cmap="RdBu_r",
        linewidths=0,
        rasterized=True,
        **_limits(residual),
    )
    figure.colorbar(dots, ax=left, label="um")
    left.set_title(
        f"residual: noise {form.noise_um:.2g} um, unexplained {form.unexplained_um:.2g} um"
    )
    for ax in (fitted, left):
        ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", xlim=extent[:2], ylim=extent[2:])
        ax.grid(visible=False)
    _draw_meridian(meridian, form)
    _draw_terms(terms, form)
    return figure


def _limits(values: Array) -> dict[str, float]:
    limit = float(np.percentile(np.abs(values), 99.5)) or 1e-6
    return {"vmin": -limit, "vmax": limit}


def _draw_meridian(ax: Axes, form: FormError) -> None:
    r = np.linspace(0.0, form.mirror.rim_radius_mm, GRID)
    around = np.linspace(0.0, 2 * np.pi, 73)[:-1, None]
    height = form.at((r * np.cos(around)).ravel(), (r * np.sin(around)).ravel()).reshape(
        len(around), -1
    )
    height = height - height.mean()
    ax.fill_between(
        r,
        height.min(axis=0),
        height.max(axis=0),
        color=GREY,
        alpha=0.3,
        linewidth=0,
        label="all azimuths",
    )
    ax.plot(r, height.mean(axis=0), color=INK, label="symmetric part")
    ax.set(xlabel="distance from the axis, mm", ylabel="form, um")
    ax.set_title("meridian")
    ax.legend(frameon=False)


def _draw_terms(ax: Axes, form: FormError) -> None:
    ranked = sorted((t for t in form.terms if t.noll > 1), key=lambda term: -abs(term.um))[
        :MAX_BARS
    ]
    positions = np.arange(len(ranked))
    colours = [PALETTE[0] if noll(t.noll)[1] == 0 else PALETTE[1] for t in ranked]
    ax.barh(
        positions,
        [t.um for t in ranked],
        xerr=[t.sigma_um for t in ranked],
        color=colours,
        ecolor=INK,
    )
    ax.set_yticks(positions, [f"{t.noll} {t.name}" for t in ranked])
    ax.invert_yaxis()
    ax.set(xlabel="um rms")
    ax.set_title("largest terms")
