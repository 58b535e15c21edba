"""Curves against the field angle (Figs. 5, 6, 7, 9, 12, 15), and comparison of mirrors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...base.quantities import QUANTITIES
from ...base.typing import Array
from ...optics.lenses import Lens, Orthographic, Perspective
from ...optics.mirrors import Sphere
from ...optics.sensor import Sensor
from ...optics.tracing.meridian import Meridian
from ..focus import best_viewpoint
from .style import (
    COLUMN,
    GREY,
    INK,
    PAGE,
    PALETTE,
    EndLabels,
    angle_axis,
    axis_label,
    axis_of_both,
    axis_title,
    grid_of_axes,
    new_figure,
    panel_title,
    panels,
    styled,
    text_size,
    zero_line,
)
from .subjects import Subject, widest

# -- Curves against the field angle ----------------------------------------------------------------

OBJECT_DISTANCES = (7, 10, 20, 40)  # object distances of Fig. 15, in rim radii
VIEWING_ANGLES = (12.0, 8.0, 4.0, 2.0, 0.0)  # viewing angles of Fig. 12, deg; 0 is orthographic
SINGLE_VIEWPOINT_PX = (
    1e-6  # smaller viewpoint errors are due to rounding: the sensor has a single viewpoint
)


def mapping(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 5: image height and its derivative."""
    return _column_panels(subjects, axes, "h_px", "dh_domega_px_per_deg")


def image_height(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw the image height, the first panel of Fig. 5."""
    return _column_panels(subjects, axes, "h_px")


def viewpoints(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 6: intersections of the chief rays with the axis."""
    return _column_panels(subjects, axes, "viewpoint_z_mm")


def area_and_aspect(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 7: image area and aspect of one square degree."""
    return _column_panels(subjects, axes, "area_px2", "aspect")


def _column_panels(
    subjects: Sequence[Subject], axes: Sequence[Axes] | None, *columns: str
) -> Figure:
    """Draw one panel per column of the evaluation table, one line per sensor."""
    count = len(columns)
    size = (COLUMN if count == 1 else PAGE, 2.5)
    figure, panel_axes = panels(size, (1, count), count, axes)
    labels = EndLabels(figure, follows_layout=axes is None)
    for i, (ax, column) in enumerate(zip(panel_axes, columns, strict=True)):
        panel_title(ax, i, QUANTITIES[column].title if count > 1 else "", count)
        ax.set_ylabel(axis_label(column, titled=count == 1))
        angle_axis(ax, widest(subjects))
        lines = [_line(ax, s, column) for s in subjects]
        _limits(ax, lines)
        obscured_bands(ax, subjects)
        for line, s in zip(lines, subjects, strict=True):
            labels.of_line(ax, line, s.name)
    return labels.settle()


def obscured_bands(ax: Axes, subjects: Sequence[Subject]) -> None:
    """Draw the obscured parts of the field as pale bands in the colour of each sensor."""
    is_labelled = False
    for s in subjects:
        for low, high in s.obscured_deg:
            ax.axvspan(
                low, high, color=s.colour, alpha=0.12, linewidth=0, zorder=0, gid=f"{s.name}:hidden"
            )
            if not is_labelled:
                ax.text(
                    low,
                    0.985,
                    " hidden",
                    transform=ax.get_xaxis_transform(),
                    rotation=90,
                    size=text_size(5),
                    color=GREY,
                    va="top",
                )
            is_labelled = True


def _line(
    ax: Axes, subject: Subject, column: str, values: Array | None = None, **style: object
) -> Line2D:
    """Draw a column of the subject's table as a line with the gid "name:column"."""
    y = getattr(subject.curve, column) if values is None else values
    style = {"color": subject.colour, **style}
    (line,) = ax.plot(subject.curve.omega_deg, y, gid=f"{subject.name}:{column}", **style)  # type: ignore[arg-type]  # types of the keywords depend on their names
    return line


def _limits(ax: Axes, lines: Sequence[Line2D], from_zero: bool = True) -> None:
    """Set the limits for lines already drawn."""
    value_limits(ax, [np.asarray(line.get_ydata(), float) for line in lines], from_zero)


def value_limits(ax: Axes, values: Sequence[Array], from_zero: bool = True) -> None:
    """Set limits from 0 if possible, with a margin of 4 %; poles (tip of a cone) are clipped."""
    y = np.concatenate(values)
    y = y[np.isfinite(y)]
    low, high = np.quantile(y, [0.0, 1.0])
    typical = np.quantile(np.abs(y), 0.98)
    low, high = max(low, -4 * typical), min(high, 4 * typical)
    if from_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    air = 0.04 * ((high - low) or abs(high) or 1.0)
    ax.set_ylim(low if low == 0 else low - air, high if high == 0 else high + air)


# -- Fig. 9: blur ----------------------------------------------------------------------------------


def blur(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 9: blur in pixels, in degrees, and its area in square degrees."""
    is_narrow = max(len(_prefix(s, subjects)) for s in subjects) < 10
    size = (COLUMN if is_narrow else 0.7 * PAGE, 6.6)
    figure, panel_axes = panels(size, (3, 1), 3, axes, sharex=True)
    labels = EndLabels(figure, follows_layout=axes is None)
    _blur_panel(panel_axes[0], subjects, "px", labels)
    _blur_panel(panel_axes[1], subjects, "deg", labels)
    _blur_area_panel(panel_axes[2], subjects, labels)
    for i, title in enumerate(
        ("Blur in the image", "Blur in object space", "Blur area in object space")
    ):
        panel_title(panel_axes[i], i, title if i else title + subjects[0].objects, 3)
        angle_axis(panel_axes[i], widest(subjects))
        obscured_bands(panel_axes[i], subjects)
        panel_axes[i].set_xlabel("" if i < 2 else panel_axes[i].get_xlabel())
    return labels.settle()


def blur_in_pixels(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw the blur in pixels, the first panel of Fig. 9."""
    figure, (ax,) = panels((COLUMN, 2.5), (1, 1), 1, axes)
    labels = EndLabels(figure, follows_layout=axes is None)
    _blur_panel(ax, subjects, "px", labels)
    panel_title(ax, 0, f"Blur in the image{subjects[0].objects}", 1)
    angle_axis(ax, widest(subjects))
    obscured_bands(ax, subjects)
    return labels.settle()


def _blur_panel(ax: Axes, subjects: Sequence[Subject], unit: str, labels: EndLabels) -> None:
    """Draw tangential blur solid, sagittal dashed."""
    zero_line(ax)
    lines = [
        (
            _line(ax, s, f"blur_{direction}_{unit}", linestyle=style),
            f"{_prefix(s, subjects)}{direction.upper()}",
        )
        for s in subjects
        for direction, style in (("t", "-"), ("s", (0, (4, 2))))
    ]
    _limits(ax, [line for line, _ in lines])
    ax.set_xlim(0, widest(subjects))
    ax.set_ylabel(axis_of_both(f"blur_{unit}", f"blur_t_{unit}", f"blur_s_{unit}"))
    if unit == "px":
        tolerance = subjects[0].conditions.tolerance_px
        ax.axhspan(-tolerance, tolerance, color="#F2F2F2", zorder=0)
        ax.text(
            0.02,
            tolerance + 0.1,
            f"±{tolerance:g} px",
            transform=ax.get_yaxis_transform(),
            size=text_size(6),
            color=GREY,
            va="bottom",
        )
    for (line_t, text), (line_s, text_s) in zip(lines[::2], lines[1::2], strict=True):
        if _coincide(ax, line_t, line_s):  # for example with a single viewpoint
            labels.of_line(ax, line_t, f"{text}, S")
        else:
            labels.of_line(ax, line_t, text)
            labels.of_line(ax, line_s, text_s)


def _prefix(subject: Subject, subjects: Sequence[Subject]) -> str:
    """Return the name before "T" and "S", if there is more than one sensor."""
    return f"{subject.name} " if len(subjects) > 1 else ""


def _coincide(ax: Axes, first: Line2D, second: Line2D) -> bool:
    """Return whether two lines coincide within a line width."""
    bottom, top = ax.get_ylim()
    difference = np.abs(
        np.asarray(first.get_ydata(), float) - np.asarray(second.get_ydata(), float)
    )
    return bool(np.nanmax(difference) < 0.01 * (top - bottom))


def _blur_area_panel(ax: Axes, subjects: Sequence[Subject], labels: EndLabels) -> None:
    """Draw the blur area of the paper (solid) and the floored area (dotted), logarithmic."""
    ax.set_yscale("log")
    lines = []
    for s in subjects:
        product = np.abs(s.curve.blur_area_deg2)
        name = _prefix(s, subjects)
        lines.append((_line(ax, s, "blur_area_deg2", product), f"{name}T×S"))
        floored = _line(ax, s, "floored_area_deg2", linestyle=(0, (1, 1.6)))
        lines.append((floored, f"{name}floored"))
    max_area = max(
        np.nanmax(np.where(np.isfinite(y), y, 0.0)) for y in (line.get_ydata() for line, _ in lines)
    )
    ax.set_ylim(1e-3, min(10 * float(np.ceil(max_area / 5)) / 2 + 1, 1e3))
    ax.set_xlim(0, widest(subjects))
    ax.set_ylabel(axis_title("blur_area_deg2"))
    for line, text in lines:
        labels.of_line(ax, line, text)


# -- Fig. 12: lens of a spherical mirror -----------------------------------------------------------


def viewing_angle(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 12: image area of spherical mirrors at different viewing angles.

    The family has the rim, field and image circle of the first sensor with a spherical mirror, or
    of the first sensor.
    """
    subject = next((s for s in subjects if isinstance(s.sensor.mirror, Sphere)), subjects[0])
    field = round(subject.sensor.field_deg[1], 1)
    figure, (ax,) = panels((COLUMN, 2.6), (1, 1), 1, axes)
    labels = EndLabels(figure, follows_layout=axes is None)
    lines = []
    angles = [a for a in VIEWING_ANGLES if a < min(field, 180 - field)]
    for shade, theta in zip(np.linspace(1.0, 0.35, len(angles)), angles, strict=True):
        member = Subject(
            sphere_for(subject.sensor, field, theta, subject.radius_px),
            subject.colour,
            replace(subject.conditions, image_radius_px=subject.radius_px),
        )
        style = (
            {"alpha": shade, "linewidth": 1.2}
            if theta
            else {"color": INK, "linestyle": (0, (4, 2))}
        )
        line = _line(ax, member, "area_px2", **style)
        rim_ratio = member.curve.area_px2[-1] / member.curve.area_px2[0]
        name = f"Θ = {theta:g}°" if theta else "orthographic"
        lines.append((line, f"{name} ({rim_ratio:.0%})"))
    angle_axis(ax, field)
    _limits(ax, [line for line, _ in lines])
    ax.set_ylabel(axis_label("area_px2"))
    ax.set_title(
        f"Spheres with a field of {field:g}°; in brackets: rim / centre", fontweight="normal"
    )
    for line, text in lines:
        labels.of_line(ax, line, text)
    return labels.settle()


def sphere_for(sensor: Sensor, omega_max_deg: float, theta_deg: float, radius_px: float) -> Sensor:
    """Return the spherical mirror of the same rim for a field and viewing angle, in closed form.

    ``A = M / sin(beta)``, ``beta = (Omega_max - Theta)/2``, ``m = M/tan(Theta) - A (1 -
    cos(beta))``; a viewing angle of 0 selects an orthographic lens. The parameters of the paper
    were found by trial and error.

    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> sphere = sphere_for(load_sensor("paper-spherical"), 135.0, 12.0, 500.0)
    >>> M = sphere.mirror.rim_radius_mm
    >>> round(sphere.mirror.radius_mm / M, 3), round(sphere.mirror_distance_mm / M, 2)
    (1.138, 4.11)
    """
    M, pitch = sensor.mirror.rim_radius_mm, sensor.imager.pitch_mm
    theta, beta = np.radians(theta_deg), np.radians(omega_max_deg - theta_deg) / 2
    A = float(M / np.sin(beta))
    lens: Lens
    if theta_deg == 0:
        lens, m = Orthographic(radius_px * pitch / M, sensor.lens.image_f_number(), A / 2), np.inf
    else:
        m = float(M / np.tan(theta) - A * (1 - np.cos(beta)))
        lens = Perspective(float(radius_px * pitch / np.tan(theta)), 4.0, 1e6)
    name = f"Θ = {theta_deg:g} deg"
    return replace(
        sensor, mirror=Sphere(A, M), lens=lens, mirror_distance_mm=m, name=name, secondary=None
    )


# -- Fig. 15: single viewpoint ---------------------------------------------------------------------


def viewpoint_error(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 15: error of the best single viewpoint, for objects at 7 to 40 rim radii."""
    columns = min(len(subjects), 3)
    rows = -(-len(subjects) // columns)
    size = (COLUMN if columns == 1 else PAGE, 2.5 * rows)
    figure, panel_axes = panels(size, (rows, columns), len(subjects), axes, sharey=True)
    labels = EndLabels(figure, follows_layout=axes is None)
    max_error = max(_viewpoint_panel(ax, s) for ax, s in zip(panel_axes, subjects, strict=True))
    panel_axes[0].set_ylim(
        -1.1 * max(max_error, 0.5), 1.5 * max(max_error, 0.5)
    )  # space for the viewpoint values
    for i, (ax, s) in enumerate(zip(panel_axes, subjects, strict=True)):
        panel_title(ax, i, s.name, len(subjects))
        angle_axis(ax, widest(subjects), max_ticks=10 if columns == 1 else 4)
        obscured_bands(ax, [s])
        if i % columns == 0:
            ax.set_ylabel(axis_title("viewpoint_error_px"))
        for line in ax.get_lines():
            if not str(line.get_label()).startswith("_"):
                labels.of_line(ax, line, str(line.get_label()))
    return labels.settle()


def _viewpoint_panel(ax: Axes, subject: Subject) -> float:
    """Draw the lines of one sensor and return the largest error, px."""
    zero_line(ax)
    M, max_error, texts = subject.rim_mm, 0.0, []
    omega = subject.curve.omega_deg
    for shade, n in zip(
        np.linspace(1.0, 0.4, len(OBJECT_DISTANCES)), OBJECT_DISTANCES, strict=True
    ):
        radius = subject.conditions.image_radius_px
        viewpoint = best_viewpoint(subject.sensor, n * M, omega_deg=omega, image_radius_px=radius)
        style = {"color": subject.colour, "alpha": shade, "gid": f"{subject.name}:error_px:{n}M"}
        if viewpoint.worst_px < SINGLE_VIEWPOINT_PX:
            ax.plot(omega, np.zeros_like(omega), **style)
            texts = [
                f"V$_0$ = {viewpoint.z_mm / M:.4f} M:",
                "single viewpoint,",
                "no error at any distance",
            ]
            break
        ax.plot(omega, viewpoint.error_px, label=f"{n} M: ±{viewpoint.worst_px:.2f} px", **style)
        max_error = max(max_error, viewpoint.worst_px)
        texts.append(f"V$_0$ = {viewpoint.z_mm / M:.4f} M for {n} M")
    ax.text(
        0.04,
        0.98,
        "\n".join(texts),
        transform=ax.transAxes,
        va="top",
        size=text_size(6),
        color=subject.colour,
    )
    return max_error


# -- Comparison of mirrors -------------------------------------------------------------------------

PROFILE_POINTS = 400


def meridian_curves(mirrors: Mapping[str, Meridian]) -> Figure:
    """Draw up to six mirrors by name, with lengths in rim radii."""
    with styled():
        figure = new_figure(PAGE, 2.9)
        sections, heights = grid_of_axes(figure, 1, 2, 2)
        labels = EndLabels(figure)
        for (name, meridian), colour in zip(mirrors.items(), PALETTE, strict=False):
            M = meridian.mirror.rim_radius_mm
            rays = meridian.trace(np.linspace(0.0, M, PROFILE_POINTS))
            h = rays.x / M if np.isinf(meridian.m) else rays.x / rays.w / np.tan(meridian.theta_max)
            (section,) = sections.plot(rays.x / M, rays.z / M, color=colour, gid=f"{name}:section")
            heights.plot(np.degrees(rays.omega), h, color=colour, gid=f"{name}:height")
            labels.of_line(sections, section, name)
        panel_title(sections, 0, "Sections, the lens far below")
        sections.set_xlim(0, 1)
        sections.set_xlabel("Distance from the axis x/M")
        sections.set_ylabel("Height above the vertex z/M")
        panel_title(heights, 1, "Image height")
        angle_axis(heights, max(float(np.degrees(m.omega_max)) for m in mirrors.values()))
        heights.set_ylim(0, 1)
        heights.set_ylabel("h / h of the rim")
        return labels.settle()
