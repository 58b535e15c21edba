"""Fig. 4: cross-section of the sensor, with chief rays, virtual images and depth of field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..section import (
    NEAR_OBJECTS,
    SectionCurve,
    focus_band,
    image_curves,
    is_as_seen,
    lens_half_width,
    lens_height,
    mirror_curve,
    secondary_curve,
    top_height,
    ways_to_lens,
)
from .labels import EndLabels, shown_points
from .style import COLUMN, GREY, INK, PAGE, new_figure, panel_title
from .subjects import Subject

FAR_AWAY = 2.5  # virtual images farther from the vertex, in rim radii, are clipped
BAND, BAND_INK = "#F3E3B3", "#8A6A00"  # depth of field


class PanelLimits(NamedTuple):
    """Limits of a panel in rim radii, common to all sensors for equal scales."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def shape(self) -> float:
        """Return the ratio of height to width."""
        return (self.top - self.bottom) / (self.right - self.left)

    def apply(self, ax: Axes, M: float) -> None:
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlim(self.left * M, self.right * M)
        ax.set_ylim(self.bottom * M, self.top * M)


def ray_traces(subjects: Sequence[Subject]) -> Figure:
    """Draw Fig. 4: for each sensor the cross-section, and the mirror with virtual images."""
    columns = min(len(subjects), 3)
    blocks = -(-len(subjects) // columns)
    overview, close_up = _overview_window(subjects), _close_up_window(subjects)
    width = (PAGE if columns > 1 else COLUMN) if columns != 2 else 0.7 * PAGE
    panel = width / columns - 0.9  # remaining width for labels
    heights = [panel * overview.shape, panel * close_up.shape]
    figure = new_figure(width, blocks * (sum(heights) + 0.95))
    grid = figure.subplots(2 * blocks, columns, squeeze=False, height_ratios=heights * blocks)
    labels = EndLabels(figure, size=6)
    for i, s in enumerate(subjects):
        block, column = divmod(i, columns)
        above, below = grid[2 * block, column], grid[2 * block + 1, column]
        panel_title(above, i, s.name, len(subjects))
        overview.apply(above, s.rim_mm)
        close_up.apply(below, s.rim_mm)
        _draw_overview(above, s, labels)
        _draw_close_up(below, s, labels)
        below.set_xlabel("x (mm)")
        if column == 0:
            above.set_ylabel("z (mm)")
            below.set_ylabel("z (mm)")
    for spare in range(len(subjects), blocks * columns):
        grid[-2, spare % columns].remove()
        grid[-1, spare % columns].remove()
    return labels.settle()


def _overview_window(subjects: Sequence[Subject]) -> PanelLimits:
    bottom = min(_lowest(s) / s.rim_mm for s in subjects) - 0.3
    tops = [_highest(s) / s.rim_mm for s in subjects]
    return PanelLimits(-1.2, 1.75, bottom, max(tops) + 0.35)


def _lowest(subject: Subject) -> float:
    """Return the minimum z (mm) of the sensor: its lens, or its second mirror."""
    second = secondary_curve(subject.sensor)
    lens = lens_height(subject.sensor)
    return lens if second is None else min(lens, float(second.z.min()))


def _highest(subject: Subject) -> float:
    """Return the maximum z (mm) of the overview: mirror, depth of field, or a lens behind it."""
    shown = [top_height(subject.sensor), lens_height(subject.sensor)]
    if is_as_seen(subject.sensor):
        shown.append(min(focus_band(subject.curve).far, FAR_AWAY * subject.rim_mm))
    return max(shown)


def _close_up_window(subjects: Sequence[Subject]) -> PanelLimits:
    """Return the limits of mirror, depth of field and virtual images up to :data:`FAR_AWAY`."""
    points = []
    for s in subjects:
        heights = [curve.z for _, curve, _ in _virtual_images(s)]
        points += [z / s.rim_mm for z in (*heights, np.array([0.0, top_height(s.sensor), *focus_band(s.curve)]))]
    z = np.concatenate(points)
    z = z[np.isfinite(z) & (np.abs(z) < FAR_AWAY)]
    return PanelLimits(-1.35, 1.35, float(z.min()) - 0.06, float(z.max()) + 0.06)


def _draw_mirrors(ax: Axes, subject: Subject, with_second: bool = True) -> None:
    second = secondary_curve(subject.sensor) if with_second else None
    for name, curve in (("mirror", mirror_curve(subject.sensor)), ("secondary", second)):
        if curve is not None:
            ax.plot(*curve, color=INK, linewidth=1.6, zorder=4, gid=f"{subject.name}:{name}")


def _draw_overview(ax: Axes, subject: Subject, labels: EndLabels) -> None:
    M = subject.rim_mm
    right, (bottom, top) = ax.get_xlim()[1], ax.get_ylim()
    ax.grid(False)
    ax.plot([0, 0], [bottom, top], color=GREY, linewidth=0.4, dashes=(8, 2, 1, 2))
    if is_as_seen(subject.sensor):
        _draw_band(ax, subject)
    _draw_mirrors(ax, subject)
    _draw_lens(ax, subject)
    marks = subject.marks
    ways = ways_to_lens(subject.sensor, marks.x_mm)
    for x, z, omega, to_lens in zip(marks.x_mm, marks.z_mm, marks.omega_deg, ways, strict=True):
        xs, zs = _incoming(x, z, np.radians(omega), right, bottom, top)
        way = [(xs, zs), (x, z), *to_lens]
        ax.plot(*np.transpose(way), color=subject.colour, linewidth=0.6, gid=f"{subject.name}:ray:{omega:g}")
        if xs >= right * (1 - 1e-9):
            labels.at(ax, right, zs, f"{omega:g}°", subject.colour)
        else:
            y, va = (bottom + 0.04 * M, "bottom") if omega < 90 else (top - 0.02 * M, "top")
            ax.text(xs + 0.05 * M, y, f"{omega:g}°", size=6, va=va, color=subject.colour)


def _incoming(x: float, z: float, omega: float, right: float, bottom: float, top: float) -> tuple[float, float]:
    """Return the intersection of the ray from the object with the border of the panel."""
    dx, dz = np.sin(omega), -np.cos(omega)
    reach = [(right - x) / dx] if dx > 0 else []
    reach += [(bottom - z) / dz] if dz < 0 else [(top - z) / dz] if dz > 0 else []
    t = min(reach)
    return float(x + t * dx), float(z + t * dz)


def _draw_lens(ax: Axes, subject: Subject) -> None:
    """Draw the lens as a double arrow, with the width of the mirror if telecentric."""
    telecentric, M = subject.sensor.lens.TELECENTRIC, subject.rim_mm
    z, half = lens_height(subject.sensor), lens_half_width(subject.sensor)
    arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    ax.annotate("", (half, z), (-half, z), arrowprops=arrow, zorder=5)
    if telecentric:
        ax.text(-half, z - 0.08 * M, "telecentric lens", size=6, va="top")
    else:
        beside = subject.sensor.secondary is None  # otherwise the mirror is there
        x, y, ha, va = (-half - 0.06 * M, z, "right", "center") if beside else (0.0, z + 0.08 * M, "center", "bottom")
        ax.text(x, y, "lens", size=6, ha=ha, va=va)


def _draw_band(ax: Axes, subject: Subject) -> None:
    focus, near, far = focus_band(subject.curve)
    top = ax.get_ylim()[1]
    ax.axhspan(near, min(far, top), color=BAND, linewidth=0, zorder=0, gid=f"{subject.name}:depth-of-field")
    ax.axhline(focus, color=BAND_INK, linewidth=0.6, zorder=1)


def _draw_close_up(ax: Axes, subject: Subject, labels: EndLabels) -> None:
    """Draw the mirror with T and S images of far objects (thick) and near objects (thin).

    A fold is unfolded. With a curved second mirror, the images are drawn at their positions seen by
    the lens, and the first mirror, which would be distorted, is omitted.
    """
    _draw_band(ax, subject)
    if is_as_seen(subject.sensor):
        _draw_mirrors(ax, subject, with_second=False)
    beyond = []
    for name, (x, z), look in _virtual_images(subject):
        label = f"{name[0]}$_{{{name[1:]}}}$"
        (line,) = ax.plot(x, z, color=subject.colour, gid=f"{subject.name}:{name}", **look)  # type: ignore[arg-type]
        ax.plot(-x, z, color=subject.colour, **look)  # type: ignore[arg-type]
        if shown_points(ax, line).any():
            labels.of_line(ax, line, label)
        else:
            beyond.append(label)
    if beyond:
        note = f"{', '.join(beyond)}\nbeyond {FAR_AWAY:g} M"
        ax.text(0.98, 0.03, note, transform=ax.transAxes, ha="right", size=6, color=subject.colour)
    f_number = getattr(subject.sensor.lens, "f_number", subject.sensor.lens.image_f_number())
    near, far = subject.curve.depth_of_field_mm
    text = f"DF$_{{{f_number:.3g}}}$ = {far - near:.1f} mm about L$_0$ = {subject.curve.focus_mm:.4g} mm"
    ax.set_title(text, fontsize=6, fontweight="normal", color=BAND_INK, pad=3)


def _virtual_images(subject: Subject) -> list[tuple[str, SectionCurve, dict[str, object]]]:
    """Return name, positions and style of four image curves, for far and near objects."""
    p = subject.conditions.object_distance_mm
    asked = "∞" if np.isinf(p) else f"{p:g}mm"
    strong: dict[str, object] = {"linewidth": 1.3}
    fine: dict[str, object] = {"linewidth": 0.7}
    dashed: dict[str, object] = {"linestyle": (0, (4, 2))}
    t_far, s_far = image_curves(subject.curve)
    t_near, s_near = image_curves(subject.curve, NEAR_OBJECTS * subject.rim_mm)
    return [
        (f"T{asked}", t_far, strong),
        (f"T{NEAR_OBJECTS:g}M", t_near, fine),
        (f"S{asked}", s_far, strong | dashed),
        (f"S{NEAR_OBJECTS:g}M", s_near, fine | dashed),
    ]
