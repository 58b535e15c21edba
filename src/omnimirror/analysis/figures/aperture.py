"""Figures of the whole-aperture analysis: spots, PSF, MTF, encircled energy, illumination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ...base.quantities import QUANTITIES
from ...base.typing import Array
from ..psf_mtf import Mtf, Psf
from ..relative_illumination import Illumination
from ..spot_diagrams import Spots
from .style import (
    COLUMN,
    GREY,
    INK,
    PAGE,
    PALETTE,
    EndLabels,
    angle_axis,
    axis_title,
    new_figure,
    panels,
    styled,
    text_size,
)

RMS = QUANTITIES["rms_radius_px"]
MAX_GRID_PX = 12  # px to each side; the lines of a larger pixel grid would merge
DARKEST_SHADE = 1e-4  # relative to the peak, the darkest shade of a PSF


def spot_matrix(spots: Spots, axes: Sequence[Axes] | None = None) -> Figure:
    """Draw spots at one scale with pixel grid and Airy disc, by field angle and focus."""
    objects, focuses, _ = spots.t_px.shape
    sensor = spots.bundles.sensor
    airy_px = sensor.lens.airy_diameter() / sensor.imager.pitch_mm
    cells = [(i, j) for i in range(objects) for j in range(focuses)]
    columns = focuses if focuses > 1 else min(objects, 5)
    rows = -(-len(cells) // columns)
    half = max(1.15 * _half_extent(spots), 0.8 * airy_px, 1.0)
    with styled():
        side = min(1.25, (PAGE - 0.5) / columns)
        size = max(COLUMN, side * columns + 0.5), (side + 0.2) * rows + 0.5
        figure, cell_axes = panels(size, (rows, columns), len(cells), axes)
        for ax, (i, j) in zip(cell_axes, cells, strict=True):
            _pixel_grid(ax, half)
            _spot(ax, spots, i, j, airy_px)
            ax.set(xlim=(-half, half), ylim=(half, -half), aspect="equal", xticks=[], yticks=[])
            name = f"{spots.omega_deg[i]:.4g}°" if focuses == 1 or j == 0 else ""
            ax.set_title(name, fontsize=text_size(6.5), pad=2)
            ax.set_title(
                f"{RMS.symbol} {spots.rms_radius_px()[i, j]:.2f} {RMS.unit}",
                fontsize=text_size(6),
                fontweight="normal",
                loc="right",
                pad=2,
            )
            if focuses > 1 and i == objects - 1:
                ax.set_xlabel(f"L$_0$ = {spots.focus_mm[j]:.5g} mm")
        grid = "squares are pixels, " if half <= MAX_GRID_PX else f"side {2 * half:.3g} px, "
        if axes is None:
            figure.supxlabel(
                f"tangential → right; {grid}circle: Airy disc", fontsize=text_size(6), color=GREY
            )
    return figure


def _half_extent(spots: Spots) -> float:
    """Return half the largest width of all spots, px."""
    return float(max(a.max() for a in spots.extent_px())) / 2


def _spot(ax: Axes, spots: Spots, i: int, j: int, airy_px: float) -> None:
    """Draw the rays of one spot about its centre."""
    passes = spots.bundles.passes[i]
    t, s = (a[i, j, passes] for a in (spots.t_px, spots.s_px))
    t, s = (a - (a.max() + a.min()) / 2 for a in (t, s))
    ax.plot(t, s, ".", markersize=1.1, color=PALETTE[0], gid=f"spot:{i}:{j}")
    angle = np.linspace(0, 2 * np.pi, 90)
    ax.plot(
        airy_px / 2 * np.cos(angle), airy_px / 2 * np.sin(angle), color=PALETTE[1], linewidth=0.7
    )


def _pixel_grid(ax: Axes, half: float) -> None:
    ax.grid(False)
    for spine in ax.spines.values():
        spine.set_visible(True)
        spine.set_color("#BBBBBB")
    if half <= MAX_GRID_PX:  # the lines of larger grids would merge
        for line in np.arange(-np.floor(half + 0.5) + 0.5, half):
            ax.axhline(line, color="#EEEEEE", linewidth=0.5, zorder=0)
            ax.axvline(line, color="#EEEEEE", linewidth=0.5, zorder=0)


def mtf_curves(mtf: Mtf, axes: Sequence[Axes] | None = None) -> Figure:
    """Draw tangential (solid) and sagittal (dashed) MTF with the Nyquist frequency."""
    with styled():
        figure, (ax,) = panels((0.75 * PAGE, 3.0), (1, 1), 1, axes)
        for i, (omega, colour) in enumerate(
            zip(mtf.omega_deg, _shades(len(mtf.omega_deg)), strict=True)
        ):
            ax.plot(
                mtf.cycles_per_px,
                mtf.tangential[i],
                color=colour,
                gid=f"mtf_t:{omega:g}",
                label=f"{omega:.4g}°",
            )
            ax.plot(
                mtf.cycles_per_px,
                mtf.sagittal[i],
                "--",
                dashes=(4, 2),
                color=colour,
                gid=f"mtf_s:{omega:g}",
            )
        for style, name in (("-", "tangential"), ("--", "sagittal")):
            ax.plot([], [], style, color=INK, label=name)
        ax.legend(
            loc="upper right",
            frameon=False,
            fontsize=text_size(6.5),
            ncols=2 if len(mtf.omega_deg) > 6 else 1,
        )
        ax.set(
            xlim=(0, mtf.cycles_per_px[-1]),
            ylim=(0, 1.02),
            xlabel=axis_title("cycles_per_px"),
            ylabel="MTF",
        )
        ax.axvline(0.5, color=GREY, linewidth=0.6)
        ax.text(0.5, 0.01, " Nyquist", size=text_size(6), color=GREY, va="bottom")
        per_px = mtf.pixel_pitch_um * 1e-3

        def line_pairs(cycles: ArrayLike) -> Array:
            return np.asarray(cycles, dtype=float) / per_px

        def cycles(line_pairs: ArrayLike) -> Array:
            return np.asarray(line_pairs, dtype=float) * per_px

        above = ax.secondary_xaxis("top", functions=(line_pairs, cycles))
        above.set_xlabel(axis_title("lp_per_mm"))
        above.spines["top"].set_visible(True)
    return figure


def encircled_energy(psfs: Sequence[Psf]) -> Figure:
    """Draw the encircled energy within a radius of the centroid, one line per PSF."""
    with styled():
        figure = new_figure(COLUMN + 0.5, 2.6)
        ax, labels = figure.subplots(), EndLabels(figure)
        radius_95 = max(
            float(np.interp(0.95, p.encircled_energy(p.offset_px.clip(0)), p.offset_px.clip(0)))
            for p in psfs
        )
        radius = np.linspace(0, max(1.5 * radius_95, 1.0), 400)
        lines = []
        for p, colour in zip(psfs, _shades(len(psfs)), strict=True):
            (line,) = ax.plot(
                radius, p.encircled_energy(radius), color=colour, gid=f"energy:{p.omega_deg:g}"
            )
            lines.append((line, f"{p.omega_deg:.4g}°"))
        ax.set(xlim=(0, radius[-1]), ylim=(0, 1.02), xlabel=axis_title("encircled_radius_px"))
        ax.set_ylabel(axis_title("encircled_energy"))
        for line, text in lines:
            labels.of_line(ax, line, text)
        return labels.settle()


def psf_images(psfs: Sequence[Psf], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw PSFs at a common length scale, with logarithmic intensity."""
    columns = min(len(psfs), 5)
    rows = -(-len(psfs) // columns)
    with styled():
        side = min(1.9, (PAGE - 0.3) / columns)
        size = max(COLUMN, side * columns + 0.5), (side + 0.3) * rows
        figure, psf_axes = panels(size, (rows, columns), len(psfs), axes)
        half = max(float(p.offset_px[-1]) for p in psfs)
        for i, (ax, p) in enumerate(zip(psf_axes, psfs, strict=True)):
            edge = float(p.offset_px[-1]) * (1 + 1 / (len(p.offset_px) - 1))
            peak = float(p.density.max())
            ax.set_facecolor("black")
            ax.imshow(
                np.maximum(p.density, DARKEST_SHADE * peak),
                extent=(-edge, edge, edge, -edge),
                cmap="inferno",
                norm=LogNorm(DARKEST_SHADE * peak, peak),
                interpolation="nearest",
            )
            ax.set(xlim=(-half, half), ylim=(half, -half))
            ax.grid(False)
            strehl = (
                f", {QUANTITIES['strehl'].title} {p.strehl:.2g}" if p.kind == "diffraction" else ""
            )
            ax.set_title(f"{p.omega_deg:.4g}°{strehl}")
            ax.set_xlabel(axis_title("offset_t_px"))
            if i % columns == 0:
                ax.set_ylabel(axis_title("offset_s_px"))
    return figure


def illumination_curves(results: Sequence[tuple[str, Illumination]]) -> Figure:
    """Draw the relative illumination over the field, one line per sensor."""
    with styled():
        figure = new_figure(COLUMN + 0.5, 2.5)
        ax, labels = figure.subplots(), EndLabels(figure)
        lines = []
        for (name, result), colour in zip(results, PALETTE, strict=False):
            (line,) = ax.plot(
                result.omega_deg, result.relative, color=colour, gid=f"{name}:relative"
            )
            lines.append((line, name))
        angle_axis(ax, max(float(result.omega_deg.max()) for _, result in results))
        ax.set(ylim=(0, 1.05), ylabel=axis_title("relative"))
        for line, text in lines:
            labels.of_line(ax, line, text)
        return labels.settle()


def _shades(count: int) -> list[str]:
    """Return distinct colours in the order of the field: the palette, then greys."""
    return [*PALETTE, INK, GREY, *["#AAAAAA"] * count][:count]
