"""Diagrams and cross-section of the sensor, to scale (Figs. 1, 2, 4, 13, 14, 16 and 18)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Polygon, Rectangle
from numpy.typing import NDArray

from ...base.escaping import plot_text
from ...base.typing import Array
from ...optics.housing import Dome, Housing
from ...optics.sensor import Sensor
from ..cross_section import (
    NEAR_OBJECTS,
    SectionCurve,
    focus_band,
    image_curves,
    is_undistorted,
    lens_half_width,
    lens_height,
    mirror_curve,
    paths_to_lens,
    secondary_curve,
    top_height,
)
from ..evaluation import evaluate
from .style import (
    COLUMN,
    GREY,
    INK,
    PAGE,
    PALE,
    PALETTE,
    EndLabels,
    bare,
    displayed_points,
    new_figure,
    panel_title,
    panels,
    styled,
    text_size,
)
from .subjects import Subject

# -- Fig. 4: cross-section -------------------------------------------------------------------------

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
        """Ratio of height to width."""
        return (self.top - self.bottom) / (self.right - self.left)

    def apply(self, ax: Axes, M: float) -> None:
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlim(self.left * M, self.right * M)
        ax.set_ylim(self.bottom * M, self.top * M)


def ray_traces(subjects: Sequence[Subject], axes: Sequence[Axes] | None = None) -> Figure:
    """Draw Fig. 4: for each sensor the cross-section, and the mirror with virtual images."""
    columns = min(len(subjects), 3)
    blocks = -(-len(subjects) // columns)
    overview, close_up = _overview_window(subjects), _close_up_window(subjects)
    width = (PAGE if columns > 1 else COLUMN) if columns != 2 else 0.7 * PAGE
    panel = width / columns - 0.9  # remaining width for labels
    heights = [panel * overview.shape, panel * close_up.shape]
    cells = 2 * (blocks * columns if axes is None else len(subjects))
    figure, panel_axes = panels(
        (width, blocks * (sum(heights) + 0.95)),
        (2 * blocks, columns),
        cells,
        axes,
        height_ratios=heights * blocks,
    )
    labels = EndLabels(figure, size=text_size(6), follows_layout=axes is None)
    across = columns if axes is None else len(subjects)
    grid = np.array(panel_axes).reshape(-1, across)
    for i, s in enumerate(subjects):
        block, column = divmod(i, across)
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
    for spare in range(len(subjects), grid.size // 2):
        grid[-2, spare % columns].remove()
        grid[-1, spare % columns].remove()
    return labels.settle()


def cross_section(subject: Subject, axes: Sequence[Axes] | None = None) -> Figure:
    """Draw the cross-section of a sensor, the first panel of Fig. 4."""
    window = _overview_window([subject])
    figure, (ax,) = panels((COLUMN, (COLUMN - 0.9) * window.shape + 0.6), (1, 1), 1, axes)
    labels = EndLabels(figure, size=text_size(6), follows_layout=axes is None)
    window.apply(ax, subject.rim_mm)
    _draw_overview(ax, subject, labels)
    panel_title(ax, 0, subject.name, 1)
    ax.set(xlabel="x (mm)", ylabel="z (mm)")
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
    heights = [top_height(subject.sensor), lens_height(subject.sensor)]
    if is_undistorted(subject.sensor):
        heights.append(min(focus_band(subject.curve).far, FAR_AWAY * subject.rim_mm))
    return max(heights)


def _close_up_window(subjects: Sequence[Subject]) -> PanelLimits:
    """Return the limits of mirror, depth of field and virtual images up to :data:`FAR_AWAY`."""
    points = []
    for s in subjects:
        heights = [curve.z for _, curve, _ in _virtual_images(s)]
        points += [
            z / s.rim_mm
            for z in (*heights, np.array([0.0, top_height(s.sensor), *focus_band(s.curve)]))
        ]
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
    if is_undistorted(subject.sensor):
        _draw_band(ax, subject)
    _draw_mirrors(ax, subject)
    _draw_lens(ax, subject)
    marks = subject.marks
    paths = paths_to_lens(subject.sensor, marks.x_mm)
    for x, z, omega, to_lens in zip(marks.x_mm, marks.z_mm, marks.omega_deg, paths, strict=True):
        xs, zs = _incoming(x, z, np.radians(omega), right, bottom, top)
        path = [(xs, zs), (x, z), *to_lens]
        ax.plot(
            *np.transpose(path),
            color=subject.colour,
            linewidth=0.6,
            gid=f"{subject.name}:ray:{omega:g}",
        )
        if xs >= right * (1 - 1e-9):
            labels.at(ax, right, zs, f"{omega:g}°", subject.colour)
        else:
            y, va = (bottom + 0.04 * M, "bottom") if omega < 90 else (top - 0.02 * M, "top")
            ax.text(xs + 0.05 * M, y, f"{omega:g}°", size=text_size(6), va=va, color=subject.colour)


def _incoming(
    x: float, z: float, omega: float, right: float, bottom: float, top: float
) -> tuple[float, float]:
    """Return the intersection of the ray from the object with the border of the panel."""
    dx, dz = np.sin(omega), -np.cos(omega)
    lengths = [(right - x) / dx] if dx > 0 else []
    lengths += [(bottom - z) / dz] if dz < 0 else [(top - z) / dz] if dz > 0 else []
    t = min(lengths)
    return float(x + t * dx), float(z + t * dz)


def _draw_lens(ax: Axes, subject: Subject) -> None:
    """Draw the lens as a double arrow, with the width of the mirror if telecentric."""
    telecentric, M = subject.sensor.lens.TELECENTRIC, subject.rim_mm
    z, half = lens_height(subject.sensor), lens_half_width(subject.sensor)
    arrow = {
        "arrowstyle": "<->",
        "color": INK,
        "linewidth": 1.0,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 7,
    }
    ax.annotate("", (half, z), (-half, z), arrowprops=arrow, zorder=5)
    if telecentric:
        ax.text(-half, z - 0.08 * M, "telecentric lens", size=text_size(6), va="top")
    else:
        beside = subject.sensor.secondary is None  # otherwise the mirror is there
        x, y, ha, va = (
            (-half - 0.06 * M, z, "right", "center")
            if beside
            else (0.0, z + 0.08 * M, "center", "bottom")
        )
        ax.text(x, y, "lens", size=text_size(6), ha=ha, va=va)


def _draw_band(ax: Axes, subject: Subject) -> None:
    focus, near, far = focus_band(subject.curve)
    top = ax.get_ylim()[1]
    ax.axhspan(
        near, min(far, top), color=BAND, linewidth=0, zorder=0, gid=f"{subject.name}:depth-of-field"
    )
    ax.axhline(focus, color=BAND_INK, linewidth=0.6, zorder=1)


def _draw_close_up(ax: Axes, subject: Subject, labels: EndLabels) -> None:
    """Draw the mirror with T and S images of far objects (thick) and near objects (thin).

    A fold is unfolded. With a curved second mirror, the images are drawn at their positions seen by
    the lens, and the first mirror, which would be distorted, is omitted.
    """
    _draw_band(ax, subject)
    if is_undistorted(subject.sensor):
        _draw_mirrors(ax, subject, with_second=False)
    beyond = []
    for name, (x, z), style in _virtual_images(subject):
        label = f"{name[0]}$_{{{name[1:]}}}$"
        (line,) = ax.plot(x, z, color=subject.colour, gid=f"{subject.name}:{name}", **style)  # type: ignore[arg-type]  # types of the keywords depend on their names
        ax.plot(-x, z, color=subject.colour, **style)  # type: ignore[arg-type]  # types of the keywords depend on their names
        if displayed_points(ax, line).any():
            labels.of_line(ax, line, label)
        else:
            beyond.append(label)
    if beyond:
        note = f"{', '.join(beyond)}\nbeyond {FAR_AWAY:g} M"
        ax.text(
            0.98,
            0.03,
            note,
            transform=ax.transAxes,
            ha="right",
            size=text_size(6),
            color=subject.colour,
        )
    f_number = getattr(subject.sensor.lens, "f_number", subject.sensor.lens.image_f_number())
    near, far = subject.curve.depth_of_field_mm
    text = f"DF$_{{{f_number:.3g}}}$ = {far - near:.1f} mm about L$_0$ = {subject.curve.focus_mm:.4g} mm"
    ax.set_title(text, fontsize=text_size(6), fontweight="normal", color=BAND_INK, pad=3)


def _virtual_images(subject: Subject) -> list[tuple[str, SectionCurve, dict[str, object]]]:
    """Return name, positions and style of four image curves, for far and near objects."""
    p = subject.conditions.object_distance_mm
    distance_text = "∞" if np.isinf(p) else f"{p:g}mm"
    strong: dict[str, object] = {"linewidth": 1.3}
    fine: dict[str, object] = {"linewidth": 0.7}
    dashed: dict[str, object] = {"linestyle": (0, (4, 2))}
    t_far, s_far = image_curves(subject.curve)
    t_near, s_near = image_curves(subject.curve, NEAR_OBJECTS * subject.rim_mm)
    return [
        (f"T{distance_text}", t_far, strong),
        (f"T{NEAR_OBJECTS:g}M", t_near, fine),
        (f"S{distance_text}", s_far, strong | dashed),
        (f"S{NEAR_OBJECTS:g}M", s_near, fine | dashed),
    ]


# -- Diagrams drawn to scale from traced rays ------------------------------------------------------

ImageArray = NDArray[Any]

RAY, OTHER, WALL = PALETTE[0], PALETTE[1], PALETTE[5]
ABOVE_MM = 4.0  # extension of a tube above its mirror


class Ray(NamedTuple):
    """Chief ray in the meridian, mm: mirror point P, Omega in radians, viewpoint height."""

    x: float
    z: float
    omega: float
    viewpoint: float

    @property
    def towards(self) -> Array:
        """Unit vector (2,) from the mirror to the object."""
        return np.array([np.sin(self.omega), -np.cos(self.omega)])

    def at(self, distance: float) -> tuple[float, float]:
        """Return the point at a distance from the mirror."""
        x, z = np.array([self.x, self.z]) + distance * self.towards
        return float(x), float(z)


def chief_ray(sensor: Sensor, omega_deg: float) -> Ray:
    """Return the chief ray of a field angle, from the evaluation."""
    result = evaluate(sensor, omega_deg)
    return Ray(
        float(result.x_mm[0]),
        float(result.z_mm[0]),
        np.radians(omega_deg),
        float(result.viewpoint_z_mm[0]),
    )


# -- Figs. 1 and 2: sensor -------------------------------------------------------------------------


def principle(sensor: Sensor, circle: ImageArray) -> Figure:
    """Draw Fig. 1: optical paths via mirror and lens, and the circular image (n, n, 3)."""
    M = sensor.mirror.rim_radius_mm
    with styled():
        figure = new_figure(PAGE, 3.4)
        left, right = figure.subplots(1, 2, width_ratios=[1.15, 1])
        bare(left)
        for side, colour in ((1, RAY), (-1, OTHER)):
            for omega in (30.0, 60.0, 90.0, 110.0, 130.0):
                ray = chief_ray(sensor, omega)
                xs, zs = np.transpose([ray.at(2.4 * M), (ray.x, ray.z), (0.0, -sensor.meridian.m)])
                left.plot(side * xs, zs, color=colour, linewidth=0.8)
                left.text(
                    side * xs[0],
                    zs[0],
                    f"{omega:g}°",
                    size=text_size(6),
                    color=colour,
                    ha="center",
                    va="center",
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                )
        _mirror(left, sensor)
        _camera(left, sensor, 0.55 * M)
        left.text(0.25 * M, -sensor.meridian.m, "lens", size=text_size(6.5), va="center")
        left.text(
            0.42 * M,
            -sensor.meridian.m - 0.55 * M,
            "image sensor",
            size=text_size(6.5),
            va="center",
        )
        left.text(0, _top(sensor) + 0.12 * M, "curved mirror", size=text_size(6.5), ha="center")
        panel_title(left, 0, "Mirror sensor: all azimuths in one image")
        right.imshow(circle, interpolation="antialiased")
        right.set_axis_off()
        panel_title(right, 1, "Circular image (simulated)")
    return figure


def design(sensor: Sensor, omega_deg: float = 100.0) -> Figure:
    """Draw Fig. 2: the quantities of Eqs. 1 to 6 for one chief ray."""
    M, m = sensor.mirror.rim_radius_mm, sensor.meridian.m
    ray = chief_ray(sensor, omega_deg)
    result = evaluate(sensor, omega_deg)
    P, V, lens = np.array([ray.x, ray.z]), np.array([0.0, ray.viewpoint]), np.array([0.0, -m])
    Q = np.array([0.0, -m]) + float(result.distance_t_mm[0]) * np.array(
        [np.tan(np.radians(result.theta_deg[0])), 1.0]
    )
    T = np.array(ray.at(2.1 * M))
    with styled():
        figure = new_figure(0.75 * PAGE, 5.2)
        ax = figure.subplots()
        bare(ax)
        _axis(ax, -m - 1.1 * M, _top(sensor) + 0.5 * M)
        _mirror(ax, sensor)
        _camera(ax, sensor, 0.75 * M)
        _line(ax, T, P, RAY)
        _line(ax, P, lens - 0.75 * M * (P - lens) / (P - lens)[1], RAY)
        _line(ax, P, V, RAY, dashed=True)
        _line(ax, P, Q, RAY, dashed=True)
        normal = np.array(
            [np.sin(np.radians(result.beta_deg[0])), -np.cos(np.radians(result.beta_deg[0]))]
        )
        _line(ax, P, P + 1.1 * M * normal, GREY)
        beside = {
            "T": (T, 0.08, 0.0),
            "P": (P, -0.06, -0.02),
            "V": (V, -0.14, 0.0),
            "Q": (Q, 0.06, 0.06),
        }
        for name, (point, dx, dz) in beside.items():
            _dot(ax, point, name, dx * M, dz * M)
        ax.text(0.22 * M, -m, "lens, (0, -m)", size=text_size(6.5), va="center")
        to_lens = float(np.degrees(np.arctan2(*(lens - P)[::-1])))
        to_object = float(np.degrees(np.arctan2(*(T - P)[::-1])))
        along = float(np.degrees(np.arctan2(normal[1], normal[0])))
        _angle(ax, P, 0.8 * M, to_lens, along, "γ")
        _angle(ax, P, 0.95 * M, along, to_object, "γ")
        _angle(ax, lens, 1.5 * M, 90 - float(result.theta_deg[0]), 90, "θ")
        _angle(ax, V, 0.75 * M, -90, to_object, "Ω")
        ax.annotate(
            "", (1.75 * M, -m), (1.75 * M, 0.0), arrowprops={"arrowstyle": "<->", "linewidth": 0.6}
        )
        ax.text(1.8 * M, -m / 2, "m", size=text_size(7), va="center")
        for z in (-m, 0.0):
            ax.plot([1.65 * M, 1.82 * M], [z, z], color=GREY, linewidth=0.4)
        equations = (
            "tan β = dz/dx     γ = β + θ     Ω = 2β + θ\ntan θ = x/(m + z)     z$_v$ = z + x/tan Ω"
        )
        ax.set_title(
            f"{plot_text(sensor.name)}, Ω = {omega_deg:g}°\n{equations}",
            fontsize=text_size(6.5),
            fontweight="normal",
            loc="center",
        )
    return figure


# -- Figs. 13 and 14: dewarping --------------------------------------------------------------------


def virtual_screens(sensor: Sensor, images: Sequence[ImageArray]) -> Figure:
    """Draw Fig. 13: a virtual projector with a cylindrical and a spherical screen."""
    M = sensor.mirror.rim_radius_mm
    with styled():
        figure = new_figure(PAGE, 4.6)
        grid = figure.add_gridspec(2, 2, height_ratios=[1.25, 1])
        names = ("Cylindrical screen", "Spherical screen")
        flat = ("unrolled: a panorama of 360°", "flattened: radius proportional to Ω")
        for i, name in enumerate(names):
            ax = figure.add_subplot(grid[0, i])
            bare(ax)
            _screen(ax, sensor, 2.6 * M, is_sphere=i == 1)
            panel_title(ax, i, name)
            below = figure.add_subplot(grid[1, i])
            below.set_axis_off()
            below.imshow(images[i], interpolation="antialiased")
            below.set_title(flat[i], fontsize=text_size(6.5), fontweight="normal", loc="center")
    return figure


def _screen(ax: Axes, sensor: Sensor, radius: float, is_sphere: bool) -> None:
    """Draw a projector at the mirror, and rays of the whole field to the screen."""
    _mirror(ax, sensor)
    centre = chief_ray(sensor, 90.0).viewpoint
    ends = []
    for omega in np.arange(15.0 if is_sphere else 60.0, 136.0, 15.0 if is_sphere else 12.5):
        ray = chief_ray(sensor, float(omega))
        end = np.array(ray.at(_reach(ray, centre, radius, is_sphere)))
        ends.append(end)
        for side in (1, -1):
            ax.plot([side * ray.x, side * end[0]], [ray.z, end[1]], color=RAY, linewidth=0.6)
    if is_sphere:
        omega = np.radians(np.linspace(-135, 135, 201))
        ax.plot(radius * np.sin(omega), centre - radius * np.cos(omega), color=OTHER, linewidth=1.6)
    else:
        low, high = ends[0][1], ends[-1][1]
        for side in (-1, 1):
            ax.plot([side * radius] * 2, [low, high], color=OTHER, linewidth=1.6)
        for z in (low, high):
            angle = np.linspace(0, 2 * np.pi, 201)
            ax.plot(
                radius * np.cos(angle),
                z + 0.12 * radius * np.sin(angle),
                color=OTHER,
                linewidth=0.6,
            )
    ax.text(0, _top(sensor) + 0.1 * radius, "virtual projector", size=text_size(6.5), ha="center")
    ax.text(1.06 * radius, centre, "virtual\nscreen", size=text_size(6.5), color=OTHER, va="center")


def _reach(ray: Ray, centre: float, radius: float, is_sphere: bool) -> float:
    """Return the ray length from the mirror to a cylinder or a sphere on the axis."""
    d = ray.towards
    if not is_sphere:
        return float((radius - ray.x) / d[0])
    offset = np.array([ray.x, ray.z - centre])
    b = float(offset @ d)
    return -b + float(np.sqrt(b * b - offset @ offset + radius**2))


def single_viewpoint(
    sensor: Sensor, viewpoint_z_mm: float, omega_deg: float = 60.0, distance: float = 3.0
) -> Figure:
    """Draw Fig. 14: single-viewpoint error for an object at ``distance`` rim radii (Eq. 23)."""
    M = sensor.mirror.rim_radius_mm
    ray = chief_ray(sensor, omega_deg)
    P, T = np.array([ray.x, ray.z]), np.array(ray.at(distance * M))
    V, V0 = np.array([0.0, ray.viewpoint]), np.array([0.0, viewpoint_z_mm])
    with styled():
        figure = new_figure(0.75 * PAGE, 3.8)
        ax = figure.subplots()
        bare(ax)
        _axis(ax, -1.9 * M, 1.0 * M)
        _mirror(ax, sensor)
        _line(ax, V, P, RAY, dashed=True)
        _line(ax, P, T, RAY)
        _line(ax, V0, T, OTHER)
        _dot(ax, T, "T", 0.06 * M, 0)
        _dot(ax, P, "P", 0.0, -0.16 * M)
        _dot(ax, V, "V", -0.12 * M, -0.04 * M)
        _dot(ax, V0, "V$_0$", -0.17 * M, 0.05 * M)
        arrow = {"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", (-0.45 * M, V0[1]), (-0.45 * M, V[1]), arrowprops=arrow)
        ax.text(-0.5 * M, (V + V0)[1] / 2, "v", size=text_size(7), ha="right", va="center")
        centre = 0.7 * P + 0.3 * T
        ax.text(centre[0] + 0.08 * M, centre[1] + 0.1 * M, "n M", size=text_size(7), color=RAY)
        true, apparent = (float(np.degrees(np.arctan2(*(o - T)[::-1]))) for o in (V, V0))
        epsilon = (apparent - true + 180) % 360 - 180
        low, high = sorted((apparent, apparent - epsilon))
        _angle(ax, T, 1.2 * M, low, high, "ε")
        ax.text(
            T[0] - 0.9 * M,
            T[1] - 0.05 * M,
            f"ε = {abs(epsilon):.2f}°",
            size=text_size(7),
            ha="right",
        )
        _angle(ax, V, 0.5 * M, -90, -90 + omega_deg, "Ω")
        name = plot_text(sensor.name)
        text = f"{name}: V$_0$ = {viewpoint_z_mm / M:.3f} M, object at {distance:g} M, Ω = {omega_deg:g}°"
        ax.set_title(text, fontsize=text_size(6.5), fontweight="normal")
    return figure


# -- Fig. 18: blur ---------------------------------------------------------------------------------


def blur_geometry(
    focal_length: float = 1.0, aperture: float = 1.1, focus: float = 3.2, object_at: float = 6.0
) -> Figure:
    """Draw Fig. 18: the triangles of Eqs. 24 to 28, with a close object."""
    b0, b = (1 / (1 / focal_length - 1 / L) for L in (focus, object_at))
    blur = aperture * (b0 - b) / b
    with styled():
        figure = new_figure(PAGE, 2.4)
        ax = figure.subplots()
        bare(ax)
        ax.plot(
            [-object_at - 0.3, 1.25 * b0], [0, 0], color=GREY, linewidth=0.4, dashes=(8, 2, 1, 2)
        )
        for side in (-1, 1):
            edge = side * aperture / 2
            ax.plot([-object_at, 0, b0], [0, edge, edge * (1 - b0 / b)], color=RAY, linewidth=0.9)
            ax.plot([-focus, 0, b0], [0, edge, 0], color=OTHER, linewidth=0.9)
        ax.annotate(
            "",
            (0, aperture / 2 + 0.08),
            (0, -aperture / 2 - 0.08),
            arrowprops={"arrowstyle": "<->", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0},
        )
        ax.plot([b0, b0], [-0.75, 0.75], color=INK, linewidth=1.6)
        ax.plot([b0, b0], [-blur / 2, blur / 2], color=RAY, linewidth=3.5, solid_capstyle="butt")
        ax.text(b0 + 0.08, 0.08, "Δ", size=text_size(8), color=RAY)
        ax.text(b0, 0.8, "image sensor", size=text_size(6.5), ha="center", va="bottom")
        ax.text(0.0, 0.75, "lens f, D", size=text_size(6.5), ha="center", va="bottom")
        for position, name, z in (
            (-focus, "L$_0$", -0.85),
            (-object_at, "L", -1.1),
            (b0, "b$_0$", -1.1),
            (b, "b", -0.85),
        ):
            arrow = {"arrowstyle": "<->", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", (0, z), (position, z), arrowprops=arrow)
            ax.text(position / 2, z + 0.02, name, size=text_size(7), ha="center", va="bottom")
            ax.plot([position, position], [0, z - 0.05], color=GREY, linewidth=0.4)
        for position, name, colour in ((-focus, "in focus", OTHER), (-object_at, "object", RAY)):
            ax.plot(position, 0, "o", color=colour, markersize=3)
            ax.text(position, 0.1, name, size=text_size(6.5), ha="center", color=colour)
        text = "1/L$_0$ + 1/b$_0$ = 1/L + 1/b = 1/f     F = f/D     Δ/D = (b$_0$ - b)/b     Δ > 0 beyond the focus"
        ax.set_title(text, fontsize=text_size(6.5), fontweight="normal")
    return figure


# -- Fig. 16: prototypes ---------------------------------------------------------------------------


class Prototype(NamedTuple):
    """Prototype to be drawn: its sensor, title, image (n, n, 3), and housing with given sizes."""

    sensor: Sensor
    title: str
    image: ImageArray
    housing: Housing


def prototypes(items: Sequence[Prototype]) -> Figure:
    """Draw Fig. 16: each prototype in cross-section, with a simulated image."""
    with styled():
        figure = new_figure(PAGE, 5.3)
        grid = figure.subplots(2, len(items), height_ratios=[1.25, 1], squeeze=False)
        for i, p in enumerate(items):
            above, below = grid[0, i], grid[1, i]
            bare(above)
            _draw_prototype(above, p)
            panel_title(above, i, p.title, len(items))
            below.set_axis_off()
            below.imshow(p.image, interpolation="antialiased")
            below.set_title(
                "simulated", fontsize=text_size(6), fontweight="normal", loc="center", pad=2
            )
    return figure


def _draw_prototype(ax: Axes, p: Prototype) -> None:
    """Draw the sensor and its housing with transparent supports."""
    M, m, top = p.sensor.mirror.rim_radius_mm, p.sensor.meridian.m, _top(p.sensor)
    rod, shell, camera = p.housing.rod, p.housing.shell, p.housing.camera
    if rod is not None and rod.gap_mm is not None and rod.end_diameter_mm is not None:
        foot, end = rod.diameter_mm / 2, rod.end_diameter_mm / 2
        corners = [(-foot, rod.gap_mm - m), (foot, rod.gap_mm - m), (end, 0.0), (-end, 0.0)]
        ax.add_patch(Polygon(corners, facecolor=WALL, alpha=0.35, edgecolor=INK))
    if shell is not None and shell.diameter_mm is not None:
        outer, inner = shell.diameter_mm / 2, shell.diameter_mm / 2 - shell.wall_mm
        if isinstance(shell, Dome):
            centre = (0.0, shell.centre_mm or 0.0)
            ax.add_patch(
                Circle(centre, outer, facecolor=WALL, alpha=0.35, edgecolor=INK, linewidth=0.5)
            )
            ax.add_patch(Circle(centre, inner, facecolor="white", edgecolor=INK, linewidth=0.5))
        else:
            wall: dict[str, Any] = {
                "facecolor": WALL,
                "alpha": 0.6,
                "edgecolor": INK,
                "linewidth": 0.5,
            }
            for x in (-outer, inner):
                ax.add_patch(Rectangle((x, -m), shell.wall_mm, m + top + ABOVE_MM, **wall))
    _mirror(ax, p.sensor)
    _camera(ax, p.sensor, 0.75 * M, camera.diameter_mm / 2 if camera else None)


# -- drawing elements ------------------------------------------------------------------------------


def _top(sensor: Sensor) -> float:
    """Return the maximum z (mm) of the mirror."""
    return float(sensor.mirror.bounds[1][1])


def _mirror(ax: Axes, sensor: Sensor) -> None:
    """Draw the cross-section of the mirror with a filled back."""
    M = sensor.mirror.rim_radius_mm
    x = np.linspace(-M, M, 201)
    z = sensor.mirror.sag(np.abs(x))
    back = float(z.max()) + 0.03 * M
    ax.fill(np.r_[x, x[::-1]], np.r_[z, np.full_like(x, back)], color=PALE, linewidth=0, zorder=2)
    ax.plot(x, z, color=INK, linewidth=1.5, zorder=3)


def _camera(ax: Axes, sensor: Sensor, behind: float, radius: float | None = None) -> None:
    """Draw the lens as a double arrow, the image sensor behind it, and an optional body."""
    m, half = sensor.meridian.m, 0.2 * sensor.mirror.rim_radius_mm
    if radius is not None:
        ax.add_patch(
            Rectangle(
                (-radius, -m - 1.2 * behind),
                2 * radius,
                1.2 * behind,
                facecolor=PALE,
                edgecolor=INK,
            )
        )
    arrow = {
        "arrowstyle": "<->",
        "color": INK,
        "linewidth": 1.0,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 7,
    }
    ax.annotate("", (half, -m), (-half, -m), arrowprops=arrow, zorder=5)
    ax.plot(
        [-1.6 * half, 1.6 * half],
        [-m - behind] * 2,
        color=INK,
        linewidth=2.2,
        solid_capstyle="butt",
    )


def _axis(ax: Axes, low: float, high: float) -> None:
    ax.plot([0, 0], [low, high], color=GREY, linewidth=0.4, dashes=(8, 2, 1, 2), zorder=0)


def _line(ax: Axes, a: Array, b: Array, colour: str, dashed: bool = False) -> None:
    ax.plot(
        [a[0], b[0]],
        [a[1], b[1]],
        color=colour,
        linewidth=0.9,
        linestyle=(0, (4, 2)) if dashed else "-",
        zorder=4,
    )


def _dot(ax: Axes, at: Array, name: str, dx: float, dz: float) -> None:
    ax.plot(*at, "o", color=INK, markersize=3, zorder=6)
    ax.text(
        at[0] + dx,
        at[1] + dz,
        name,
        size=text_size(8),
        va="center",
        ha="left" if dx >= 0 else "right",
        zorder=6,
    )


def _angle(ax: Axes, vertex: Array, radius: float, start: float, end: float, name: str) -> None:
    """Draw an arc between two directions (deg, counter-clockwise from +x), with its label."""
    ax.add_patch(
        Arc(
            tuple(vertex),
            2 * radius,
            2 * radius,
            theta1=start,
            theta2=end,
            color=INK,
            linewidth=0.6,
            zorder=5,
        )
    )
    mid_angle = np.radians((start + end) / 2)
    label_radius = 1.16 * radius
    ax.text(
        vertex[0] + label_radius * np.cos(mid_angle),
        vertex[1] + label_radius * np.sin(mid_angle),
        name,
        size=text_size(7.5),
        ha="center",
        va="center",
    )
