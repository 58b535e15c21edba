"""Figures in the image plane: objects, blur, dewarped views and maps (Figs. 3, 8, 10, 11, 17)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle, Ellipse, Polygon, Rectangle
from numpy.typing import NDArray

from ...base.typing import Array
from ...cameras.camera import camera_direction
from .style import (
    COLUMN,
    GREY,
    INK,
    PAGE,
    PALE,
    axis_label,
    bare,
    new_figure,
    panel_title,
    panels,
    styled,
    text_size,
)
from .subjects import Subject, widest

# -- Objects and blur in the image and in object space ---------------------------------------------

OBJECT_DEG = 15.0  # side of the drawn objects
BLUR_MAGNIFICATION = 10.0  # magnification of blur spots relative to the objects
SPOT = "#B2182B"


# -- Fig. 3: viewing sphere ------------------------------------------------------------------------


def viewing_sphere(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 3: objects of 15 x 15 deg on the viewing sphere, and their images."""
    count = len(subjects) + 1
    columns = min(count, 4)
    rows = -(-count // columns)
    size = (PAGE * columns / 4, rows * PAGE / 4 * 1.12)
    figure, panel_axes = panels(size, (rows, columns), count, axes)
    _draw_sphere(panel_axes[0], subjects)
    panel_title(panel_axes[0], 0, "Viewing sphere", count)
    for i, (ax, s) in enumerate(zip(panel_axes[1:], subjects, strict=True), start=1):
        _draw_image_circle(ax, s)
        panel_title(ax, i, s.name, count)
    return figure


def object_outline(
    omega_deg: float, phi_deg: float, side_deg: float = OBJECT_DEG, points: int = 25
) -> Array:
    """Return the outline of a square object: directions (4 points, 3) in the camera frame.

    Its sides are great circles and its centre lines ``side_deg`` long; therefore all objects are
    congruent, and neighbours touch at the centre of a side.
    """
    omega, phi = np.radians(omega_deg), np.radians(phi_deg)
    t = np.linspace(-1, 1, points)
    one = np.ones_like(t)
    a = np.concatenate([t, one, -t, -one]) * np.tan(np.radians(side_deg / 2))
    b = np.concatenate([-one, t, one, -t]) * np.tan(np.radians(side_deg / 2))
    centre = camera_direction(omega, phi)
    up = np.array([np.cos(omega) * np.cos(phi), np.cos(omega) * np.sin(phi), np.sin(omega)])
    along = np.array([-np.sin(phi), np.cos(phi), 0.0])
    d = centre + a[:, None] * up + b[:, None] * along
    outline: Array = d / np.linalg.norm(d, axis=1, keepdims=True)
    return outline


def _objects(subject: Subject) -> list[tuple[float, float, Array]]:
    """Return (Omega, phi, outline) of all objects completely within the field, at four azimuths."""
    low, high = np.cos(np.radians(subject.sensor.field_deg)) + np.array([1e-9, -1e-9])
    outlines = []
    for omega in np.arange(0, 181, OBJECT_DEG):
        for phi in (0.0, 90.0, 180.0, 270.0) if omega else (0.0,):
            outline = object_outline(omega, phi)
            cosines = -outline[:, 2]
            if (cosines <= low).all() and (cosines >= high).all():
                outlines.append((float(omega), phi, outline))
    return outlines


def _draw_sphere(ax: Axes, subjects: Sequence[Subject]) -> None:
    """Draw the sphere in parallel projection from slightly below; hidden parts are pale."""
    to_viewer, right, up = _view(azimuth_deg=-35.0, elevation_deg=-24.0)

    def flat(d: Array) -> Array:
        return np.stack([d @ right, d @ up], axis=-1)

    bare(ax)
    ax.add_patch(Circle((0, 0), 1, facecolor="#FAFAFA", edgecolor=INK, linewidth=0.7, zorder=0))
    field = widest(subjects)
    around = np.radians(np.linspace(0, 360, 361))
    for omega in [*np.arange(OBJECT_DEG, field, OBJECT_DEG), field]:
        ring = camera_direction(np.full_like(around, np.radians(omega)), around)
        colour, thickness = (INK, 0.9) if omega == field else (GREY, 0.35)
        front = np.where((ring @ to_viewer >= 0)[:, None], flat(ring), np.nan)
        ax.plot(*flat(ring).T, color=PALE, linewidth=0.35, zorder=1)
        ax.plot(*front.T, color=colour, linewidth=thickness, zorder=3)
    largest = max(subjects, key=lambda s: s.sensor.field_deg[1])
    for omega, phi, outline in _objects(largest):
        behind = bool((outline @ to_viewer).mean() < 0)
        odd = round(omega / OBJECT_DEG) % 2 == 1
        fill = "none" if behind else (GREY if odd else "#C4C4C4")
        edge = PALE if behind else INK
        patch = Polygon(
            flat(outline), facecolor=fill, edgecolor=edge, linewidth=0.5, zorder=2 if behind else 4
        )
        ax.add_patch(patch)
        if phi == 270 and not behind and odd and omega > OBJECT_DEG:
            beside = np.radians(phi - 9 / np.sin(np.radians(omega)))
            x, y = flat(camera_direction(np.radians(omega), beside))
            paper = {"facecolor": "#FAFAFA", "edgecolor": "none", "pad": 0.6}
            ax.text(
                x,
                y,
                f"{omega:g}°",
                size=text_size(5.5),
                ha="right",
                va="center",
                zorder=5,
                bbox=paper,
            )
    ax.annotate(
        "",
        (0, 1.22),
        (0, 0.99 * up[2]),
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.6},
    )
    ax.text(0.05, 1.16, "mirror axis", size=text_size(6), va="center")
    ax.text(0, -1.13, f"field ends at Ω = {field:g}°", size=text_size(6), ha="center", va="center")
    ax.set_xlim(-1.12, 1.12)
    ax.set_ylim(-1.22, 1.25)


def _view(azimuth_deg: float, elevation_deg: float) -> tuple[Array, Array, Array]:
    """Return unit vectors to the viewer, to the right and up."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    to_viewer = np.array([np.cos(e) * np.sin(a), -np.cos(e) * np.cos(a), np.sin(e)])
    right = np.array([np.cos(a), np.sin(a), 0.0])
    return to_viewer, right, np.cross(to_viewer, right)


def _draw_image_circle(ax: Axes, subject: Subject) -> None:
    """Draw the image circle with the images of the objects."""
    bare(ax)
    N = subject.radius_px
    ax.add_patch(Circle((0, 0), N, facecolor="none", edgecolor=INK, linewidth=0.7))
    inner = float(subject.curve.h_px[0])
    if inner > 0:
        ax.add_patch(Circle((0, 0), inner, facecolor="#F2F2F2", edgecolor=INK, linewidth=0.5))
    objects = _objects(subject)
    if not objects:
        low, high = subject.sensor.field_deg
        note = f"no object fits into\nthe field of {low:.3g}° to {high:.3g}°"
        ax.text(0, 0, note, size=text_size(6), ha="center", va="center", color=subject.colour)
    for omega, phi, outline in objects:
        omegas = np.arccos(np.clip(-outline[:, 2], -1, 1))
        h = subject.at(np.degrees(omegas)).h_px
        azimuth = np.arctan2(outline[:, 1], outline[:, 0])
        odd = round(omega / OBJECT_DEG) % 2 == 1
        points = np.stack([h * np.cos(azimuth), h * np.sin(azimuth)], axis=-1)
        patch = Polygon(
            points,
            facecolor=to_rgba(subject.colour, 0.75 if odd else 0.3),
            edgecolor=INK,
            linewidth=0.4,
        )
        patch.set_gid(f"{subject.name}:object:{omega:g}:{phi:g}")
        ax.add_patch(patch)
    for inside, outside in _hidden_px(subject):
        ring = Annulus((0, 0), outside, outside - inside) if inside else Circle((0, 0), outside)
        ring.set(
            facecolor=to_rgba(GREY, 0.55),
            edgecolor=INK,
            linewidth=0.4,
            gid=f"{subject.name}:hidden",
        )
        ax.add_patch(ring)
        ax.text(
            0,
            -outside,
            "obscured",
            size=text_size(5),
            ha="center",
            va="bottom",
            color=INK,
            zorder=6,
        )
    _scale_bar(ax, -0.71 * N, -1.17 * N, 0.2 * N)
    ax.set_xlim(-1.12 * N, 1.12 * N)
    ax.set_ylim(-1.22 * N, 1.25 * N)


def _hidden_px(subject: Subject) -> list[tuple[float, float]]:
    """Return the radii of the obscured rings of the image, px; two mirrors obscure the centre."""
    low, _ = subject.sensor.field_deg
    rings = []
    for inside, outside in subject.obscured_deg:
        radii = subject.at([max(inside, low), max(outside, low)]).h_px
        rings.append((0.0 if inside < low else float(radii[0]), float(radii[1])))
    return rings


def _scale_bar(ax: Axes, x: float, y: float, about: float) -> None:
    """Draw a scale bar with a round number of pixels near ``about``."""
    step = 10.0 ** np.floor(np.log10(about))
    length = float(step * max(m for m in (1, 2, 5) if m * step <= about))
    ax.plot([x - length, x], [y, y], color=INK, linewidth=1.2, solid_capstyle="butt")
    ax.text(x + 0.1 * about, y, f"{length:g} px", size=text_size(6), va="center")


# -- Figs. 8 and 10: image radius ------------------------------------------------------------------


def image_forming(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 8: the image of one square degree, magnified 15 times, along the image radius."""
    return _strips(subjects, axes, _draw_rectangles)


def blur_in_image(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 10: the image of one square degree with blur spots magnified ten times."""

    def draw(ax: Axes, subject: Subject) -> None:
        _draw_rectangles(ax, subject)
        marks = subject.marks
        for h, t, s in zip(marks.h_px, marks.blur_t_px, marks.blur_s_px, strict=True):
            _spot(
                ax,
                (h, 0.0),
                t * BLUR_MAGNIFICATION,
                s * BLUR_MAGNIFICATION,
                smallest=0.006 * subject.radius_px,
            )

    return _strips(subjects, axes, draw, "blur spots × 10")


def _strips(
    subjects: Sequence[Subject],
    axes: Sequence[Axes] | None,
    draw: Callable[[Axes, Subject], None],
    note: str = "",
) -> Figure:
    """Draw one strip per sensor, from the image centre on the left to the rim on the right."""
    half = [_half_width(s) / s.radius_px for s in subjects]
    left, right = (float(f) for f in np.max([_reach(s) for s in subjects], axis=0))
    width = 0.86 * PAGE  # three strips fill a page
    inches = (width - 0.15) / (left + right)
    same_scale = len({round(s.radius_px, 3) for s in subjects}) == 1
    between = 0.22 if same_scale else 0.36
    count = len(subjects)
    size = (width, 0.45 + sum(2 * h * inches + between for h in half))
    figure, panel_axes = panels(size, (count, 1), count, axes, height_ratios=half)
    for i, (ax, s, h) in enumerate(zip(panel_axes, subjects, half, strict=True)):
        N = s.radius_px
        panel_title(ax, i, s.name, len(subjects))
        if note:
            ax.set_title(
                note + s.objects,
                loc="right",
                fontweight="normal",
                fontsize=text_size(6.5),
                color=SPOT,
            )
        ax.set_aspect("equal")
        ax.set_xlim(-left * N, right * N)
        ax.set_ylim(-h * N, h * N)
        ax.grid(False)
        ax.axhline(0, color=PALE, linewidth=0.5, zorder=0)
        end = np.arcsin(h - 0.05)
        rim = np.linspace(-end, end, 61)
        ax.plot(N * np.cos(rim), N * np.sin(rim), color=GREY, linewidth=0.7, zorder=0)
        ax.tick_params(labelbottom=not same_scale or s is subjects[-1])
        ax.spines["left"].set_visible(False)
        ax.set_yticks([])
        draw(ax, s)
        for inside, outside in _hidden_px(s):
            ax.axvspan(
                inside,
                outside,
                color=GREY,
                alpha=0.4,
                linewidth=0,
                zorder=4,
                gid=f"{s.name}:hidden",
            )
            ax.text(
                outside,
                -h * N,
                "obscured ",
                size=text_size(5.5),
                ha="right",
                va="bottom",
                rotation=90,
                zorder=5,
            )
    panel_axes[-1].set_xlabel(axis_label("h_px", titled=True))
    return figure


def _reach(subject: Subject) -> tuple[float, float]:
    """Return the extent of the rectangles left and right of the centre, in image radii."""
    half = OBJECT_DEG * subject.marks.dh_domega_px_per_deg / 2 / subject.radius_px
    h = subject.marks.h_px / subject.radius_px
    return max(0.02, 0.02 - float((h - half).min())), max(
        1.02, min(0.02 + float((h + half).max()), 1.4)
    )


def _half_width(subject: Subject) -> float:
    """Return half the height of a strip, px: the widest rectangle with a margin for the angles."""
    widths = subject.marks.width_px_per_deg
    largest = float(np.nanmax(np.where(np.isfinite(widths), widths, 0.0)))
    return min(OBJECT_DEG * largest / 2, 0.3 * subject.radius_px) + 0.045 * subject.radius_px


def _draw_rectangles(ax: Axes, subject: Subject) -> None:
    marks = subject.marks
    top = _half_width(subject)
    for omega, h, height, width in zip(
        marks.omega_deg, marks.h_px, marks.dh_domega_px_per_deg, marks.width_px_per_deg, strict=True
    ):
        if not np.isfinite(width):  # the tip of a cone
            continue
        dh, dw = OBJECT_DEG * height, OBJECT_DEG * width
        patch = Rectangle(
            (h - dh / 2, -dw / 2), dh, dw, facecolor=subject.colour, edgecolor="none", alpha=0.16
        )
        ax.add_patch(patch)
        outline = Rectangle(
            (h - dh / 2, -dw / 2), dh, dw, facecolor="none", edgecolor=subject.colour, linewidth=0.9
        )
        outline.set_gid(f"{subject.name}:rectangle:{omega:g}")
        ax.add_patch(outline)
        ax.text(
            h,
            min(dw / 2, top * 0.86),
            f"{omega:g}°",
            size=text_size(6),
            ha="center",
            va="bottom",
            zorder=5,
        )


def _spot(
    ax: Axes, centre: tuple[float, float], along_x: float, along_y: float, smallest: float
) -> Ellipse:
    """Draw a blur spot, with a minimum size."""
    width, height = max(abs(along_x), smallest), max(abs(along_y), smallest)
    spot = Ellipse(
        centre,
        width,
        height,
        facecolor=to_rgba(SPOT, 0.45),
        edgecolor=SPOT,
        linewidth=0.5,
        zorder=3,
    )
    ax.add_patch(spot)
    return spot


# -- Fig. 11: blur in object space -----------------------------------------------------------------


def blur_in_object_space(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 11: blur relative to squares of 15 x 15 deg, all drawn at the same size."""
    count = len(subjects)
    longest = max(len(s.marks) for s in subjects)
    pitch = 18.0
    span = pitch * (longest + 1.1)
    row = 26.0 / span * (PAGE - 0.2)
    size = (PAGE, count * (row + 0.2) + 0.15)
    figure, panel_axes = panels(size, (count, 1), count, axes)
    for i, (ax, s) in enumerate(zip(panel_axes, subjects, strict=True)):
        panel_title(ax, i, s.name + s.objects, count)
        bare(ax)
        for j, omega in enumerate(s.marks.omega_deg):
            _draw_square(ax, s, j, (pitch * j, 0.0))
            hidden = any(low <= omega < high for low, high in s.obscured_deg)
            ax.text(
                pitch * j,
                8.4,
                f"{omega:g}°{', obscured' if hidden else ''}",
                size=text_size(6),
                ha="center",
                va="bottom",
            )
        _draw_mean_pixel(ax, s.mean_pixel_deg(), pitch * longest)
        ax.set_xlim(-pitch / 2, span - pitch / 2)
        ax.set_ylim(-13.5, 12.5)
    return figure


def _draw_square(ax: Axes, subject: Subject, j: int, centre: tuple[float, float]) -> None:
    x, y = centre
    half = OBJECT_DEG / 2
    square = Rectangle(
        (x - half, y - half), OBJECT_DEG, OBJECT_DEG, facecolor=subject.colour, alpha=0.16
    )
    frame = Rectangle(
        (x - half, y - half), OBJECT_DEG, OBJECT_DEG, facecolor="none", edgecolor=subject.colour
    )
    frame.set_linewidth(0.9)
    ax.add_patch(square)
    ax.add_patch(frame)
    t, s = subject.marks.blur_t_deg[j], subject.marks.blur_s_deg[j]
    if not (np.isfinite(t) and np.isfinite(s)):
        ax.text(x, y, "–", ha="center", va="center")
        return
    spot = _spot(ax, centre, s * BLUR_MAGNIFICATION, t * BLUR_MAGNIFICATION, smallest=0.3)
    spot.set_clip_path(square)
    spot.set_gid(f"{subject.name}:spot:{subject.marks.omega_deg[j]:g}")
    ax.text(
        x,
        y - half - 0.9,
        f"{abs(t):.2f} × {abs(s):.2f}",
        size=text_size(5.5),
        ha="center",
        va="top",
        color=SPOT,
    )


def _draw_mean_pixel(ax: Axes, side_deg: float, x: float) -> None:
    side = side_deg * BLUR_MAGNIFICATION
    ax.add_patch(Rectangle((x - side / 2, -side / 2), side, side, facecolor=INK))
    ax.text(x, 8.4, "mean pixel", size=text_size(6), ha="center", va="bottom")
    ax.text(
        x, -OBJECT_DEG / 2 - 0.9, f"({side_deg:.3f}°)²", size=text_size(5.5), ha="center", va="top"
    )


# -- Fig. 17 and error maps ------------------------------------------------------------------------


def image_and_views(circle: NDArray[Any], panorama: NDArray[Any], zoom: NDArray[Any]) -> Figure:
    """Draw Fig. 17: circular image, panorama and zoom, each (rows, columns, 3) uint8 in RGB order.

    The panorama has the full width, below the other two, which have equal heights.
    """
    inner = PAGE - 0.15
    shapes = [image.shape[1] / image.shape[0] for image in (circle, zoom)]
    above, below = inner / sum(shapes), inner * panorama.shape[0] / panorama.shape[1]
    with styled():
        figure = new_figure(PAGE, above + below + 0.55)
        grid = figure.add_gridspec(2, 2, width_ratios=shapes, height_ratios=[above, below])
        cells = ((grid[0, 0], circle), (grid[1, :], panorama), (grid[0, 1], zoom))
        titles = ("Circular image", "Panorama, 360°", "Zoom")
        for i, ((cell, image), title) in enumerate(zip(cells, titles, strict=True)):
            ax = figure.add_subplot(cell)
            _show(ax, image)
            panel_title(ax, i, title)
    return figure


def error_map(
    columns: NDArray[Any], rows: NDArray[Any], error: NDArray[Any], unit: str, title: str
) -> Figure:
    """Draw errors (rows, columns), NaN without a value, over an image, with contour lines."""
    in_field = error[np.isfinite(error) & (error > 0)]
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
        if in_field.size:
            low, high = np.percentile(
                in_field, [0.5, 95.0]
            )  # the errors of a floor diverge towards the horizon
            scale = LogNorm(low, max(high, 1.01 * low))
            contours = ax.pcolormesh(
                columns, rows, np.ma.masked_invalid(error), norm=scale, cmap="viridis_r"
            )
            contours.set_rasterized(True)
            levels = _round_levels(low, high)
            if len(levels):
                lines = ax.contour(columns, rows, error, levels=levels, colors=INK, linewidths=0.4)
                ax.clabel(lines, fontsize=text_size(6), fmt="%g")
            bar = figure.colorbar(contours, ax=ax, shrink=0.7, extend="max")
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


def _show(ax: Axes, image: NDArray[Any]) -> None:
    ax.set_axis_off()
    ax.imshow(image, interpolation="antialiased")
