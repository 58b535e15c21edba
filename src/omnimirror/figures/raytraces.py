"""Fig. 4: the sensor in cross-section, with chief rays, virtual images and the depth of field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..analysis import Evaluation
from ..lenses import Perspective
from ..mirrors import Flat
from .labels import EndLabels, shown_points
from .style import COLUMN, GREY, INK, PAGE, new_figure, panel_title
from .subjects import Subject

Array = NDArray[np.float64]

NEAR = 5.0  # distance of the near objects, in rim radii
FAR_AWAY = 2.5  # virtual images farther than this from the vertex, in rim radii, are cut
BAND, BAND_INK = "#F3E3B3", "#8A6A00"  # depth of field


class Window(NamedTuple):
    """Limits of a panel in rim radii, common to all sensors so that their scales agree."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def shape(self) -> float:
        """Height over width."""
        return (self.top - self.bottom) / (self.right - self.left)

    def apply(self, ax: Axes, M: float) -> None:
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlim(self.left * M, self.right * M)
        ax.set_ylim(self.bottom * M, self.top * M)


def ray_traces(subjects: Sequence[Subject]) -> Figure:
    """Fig. 4: for each sensor the whole cross-section, and below it the mirror with its virtual images."""
    columns = min(len(subjects), 3)
    blocks = -(-len(subjects) // columns)
    overview, close_up = _overview_window(subjects), _close_up_window(subjects)
    width = (PAGE if columns > 1 else COLUMN) if columns != 2 else 0.7 * PAGE
    panel = width / columns - 0.75
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


def lens_height(subject: Subject) -> float:
    """Height z (mm) at which the lens is drawn; a telecentric one stands anywhere."""
    m, second = subject.sensor.meridian.m, subject.sensor.secondary
    if second is not None:
        return second.lens_height(m) if np.isfinite(m) else _top(subject) + 0.5 * subject.rim_mm
    return -m if np.isfinite(m) else -2.5 * subject.rim_mm


def _top(subject: Subject) -> float:
    """Highest z (mm) of the mirror."""
    return subject.sensor.mirror.bounds[1][1]


def reference_height(subject: Subject) -> float:
    """Height z (mm) from which the lens's object distances count; a fold in between taken out."""
    m, second = subject.sensor.meridian.m, subject.sensor.secondary
    if np.isfinite(m):
        return -m
    return -subject.sensor.mirror_pose.displacement_mm if second is None else -second.distance_mm


def focus_band(subject: Subject) -> tuple[float, float, float]:
    """Heights z (mm) of the focus and of the near and far ends of the depth of field (Eqs. 30, 31)."""
    near, far = subject.curve.depth_of_field_mm
    zero = reference_height(subject)
    return subject.curve.focus_mm + zero, near + zero, far + zero


def _overview_window(subjects: Sequence[Subject]) -> Window:
    bottom = min(_lowest(s) / s.rim_mm for s in subjects) - 0.3
    tops = [_highest(s) / s.rim_mm for s in subjects]
    return Window(-1.2, 1.75, bottom, max(tops) + 0.35)


def _lowest(subject: Subject) -> float:
    """Lowest z (mm) of the sensor: its lens, or its second mirror."""
    second = subject.sensor.secondary
    if second is None:
        return lens_height(subject)
    rim = second.mirror.rim_radius_mm
    return min(lens_height(subject), float(second.height(np.linspace(0, rim, 65)).min()))


def _highest(subject: Subject) -> float:
    """Highest z (mm) of what the overview shows: the mirror, its depth of field, a lens behind it."""
    shown = [_top(subject), lens_height(subject)]
    if is_as_seen(subject):
        shown.append(min(focus_band(subject)[2], FAR_AWAY * subject.rim_mm))
    return max(shown)


def is_as_seen(subject: Subject) -> bool:
    """Whether the lens sees the mirror undistorted: directly, or in a flat one."""
    second = subject.sensor.secondary
    return second is None or isinstance(second.mirror, Flat)


def _close_up_window(subjects: Sequence[Subject]) -> Window:
    """Everything up to :data:`FAR_AWAY`: mirror, depth of field and virtual images."""
    points = []
    for s in subjects:
        heights = [z for _, _, z, _ in image_curves(s)]
        points += [z / s.rim_mm for z in (*heights, np.array([0.0, _top(s), *focus_band(s)]))]
    z = np.concatenate(points)
    z = z[np.isfinite(z) & (np.abs(z) < FAR_AWAY)]
    return Window(-1.35, 1.35, float(z.min()) - 0.06, float(z.max()) + 0.06)


def _draw_mirror(ax: Axes, subject: Subject) -> None:
    """The mirror, with its bore where the camera looks through one."""
    x, second = np.linspace(-subject.rim_mm, subject.rim_mm, 401), subject.sensor.secondary
    bored = second is not None and lens_height(subject) > 0
    hole = np.abs(x) < (second.bore_radius_mm if second is not None and bored else 0.0)
    z = np.where(hole, np.nan, subject.sensor.mirror.sag(np.abs(x)))
    ax.plot(x, z, color=INK, linewidth=1.6, zorder=4, gid=f"{subject.name}:mirror")


def _draw_secondary(ax: Axes, subject: Subject) -> None:
    second = subject.sensor.secondary
    if second is None:
        return
    rim = second.mirror.rim_radius_mm
    x = np.linspace(-rim, rim, 201)
    ax.plot(x, second.height(np.abs(x)), color=INK, linewidth=1.6, zorder=4, gid=f"{subject.name}:secondary")


def _draw_overview(ax: Axes, subject: Subject, labels: EndLabels) -> None:
    M, lens = subject.rim_mm, lens_height(subject)
    right, (bottom, top) = ax.get_xlim()[1], ax.get_ylim()
    ax.grid(False)
    ax.plot([0, 0], [bottom, top], color=GREY, linewidth=0.4, dashes=(8, 2, 1, 2))
    if is_as_seen(subject):
        _draw_band(ax, subject)
    _draw_mirror(ax, subject)
    _draw_secondary(ax, subject)
    _draw_lens(ax, subject, lens)
    marks = subject.marks
    ways = ways_to_lens(subject, marks.x_mm, lens)
    for x, z, omega, to_lens in zip(marks.x_mm, marks.z_mm, marks.omega_deg, ways, strict=True):
        xs, zs = _incoming(x, z, np.radians(omega), right, bottom, top)
        way = [(xs, zs), (x, z), *to_lens]
        ax.plot(*np.transpose(way), color=subject.colour, linewidth=0.6, gid=f"{subject.name}:ray:{omega:g}")
        if xs >= right * (1 - 1e-9):
            labels.at(ax, right, zs, f"{omega:g}°", subject.colour)
        else:
            y, va = (bottom + 0.04 * M, "bottom") if omega < 90 else (top - 0.02 * M, "top")
            ax.text(xs + 0.05 * M, y, f"{omega:g}°", size=6, va=va, color=subject.colour)


def ways_to_lens(subject: Subject, x_mm: Array, lens: float) -> list[list[tuple[float, float]]]:
    """Places (x, z) that the chief rays of mirror points (n,) go by to the lens."""
    second = subject.sensor.secondary
    at = subject.sensor.meridian.trace(x_mm).first.x
    ends = np.zeros_like(at) if isinstance(subject.sensor.lens, Perspective) else at
    ways = [[(float(end), lens)] for end in ends]
    if second is None:
        return ways
    return [[(float(x), float(z)), *way] for x, z, way in zip(at, second.height(at), ways, strict=True)]


def _incoming(x: float, z: float, omega: float, right: float, bottom: float, top: float) -> tuple[float, float]:
    """Where the ray from the object enters the panel."""
    dx, dz = np.sin(omega), -np.cos(omega)
    reach = [(right - x) / dx] if dx > 0 else []
    reach += [(bottom - z) / dz] if dz < 0 else [(top - z) / dz] if dz > 0 else []
    t = min(reach)
    return float(x + t * dx), float(z + t * dz)


def _draw_lens(ax: Axes, subject: Subject, z: float) -> None:
    """A lens as a double arrow, as wide as the mirror when telecentric."""
    telecentric, M = subject.sensor.lens.TELECENTRIC, subject.rim_mm
    half = float(subject.sensor.meridian.trace(M).first.x[()]) if telecentric else 0.18 * M
    arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    ax.annotate("", (half, z), (-half, z), arrowprops=arrow, zorder=5)
    if telecentric:
        ax.text(-half, z - 0.08 * M, "telecentric lens", size=6, va="top")
    else:
        beside = subject.sensor.secondary is None  # else the mirror is there
        x, y, ha, va = (-half - 0.06 * M, z, "right", "center") if beside else (0.0, z + 0.08 * M, "center", "bottom")
        ax.text(x, y, "lens", size=6, ha=ha, va=va)


def _draw_band(ax: Axes, subject: Subject) -> None:
    focus, near, far = focus_band(subject)
    top = ax.get_ylim()[1]
    ax.axhspan(near, min(far, top), color=BAND, linewidth=0, zorder=0, gid=f"{subject.name}:depth-of-field")
    ax.axhline(focus, color=BAND_INK, linewidth=0.6, zorder=1)


def _draw_close_up(ax: Axes, subject: Subject, labels: EndLabels) -> None:
    """The mirror and behind it T and S images of far objects (strong) and near ones (fine).

    A fold is taken out of the way. Through a curved second mirror the lens sees the images elsewhere than
    the first mirror makes them: they are drawn where it sees them, and the first mirror, bent too, is not.
    """
    _draw_band(ax, subject)
    if is_as_seen(subject):
        _draw_mirror(ax, subject)
    beyond = []
    for name, x, z, look in image_curves(subject):
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


def image_curves(subject: Subject) -> list[tuple[str, Array, Array, dict[str, object]]]:
    """Name, x and z (mm) and look of the four curves of virtual images as the lens sees them; NaN at infinity.

    Those of the objects that are asked for, distant ones unless said otherwise, and of near ones.
    """
    p = subject.basis.object_distance_mm
    asked = "∞" if np.isinf(p) else f"{p:g}mm"
    far, near = subject.curve, subject.curve_at(NEAR * subject.rim_mm)
    strong: dict[str, object] = {"linewidth": 1.3}
    fine: dict[str, object] = {"linewidth": 0.7}
    dashed: dict[str, object] = {"linestyle": (0, (4, 2))}
    curves = [
        (f"T{asked}", *_seen(subject, far, far.distance_t_mm), strong),
        (f"T{NEAR:g}M", *_seen(subject, near, near.distance_t_mm), fine),
        (f"S{asked}", *_seen(subject, far, far.distance_s_mm), strong | dashed),
        (f"S{NEAR:g}M", *_seen(subject, near, near.distance_s_mm), fine | dashed),
    ]
    return [(n, np.where(np.isfinite(z), x, np.nan), np.where(np.isfinite(z), z, np.nan), k) for n, x, z, k in curves]


def _seen(subject: Subject, result: Evaluation, distance: Array) -> tuple[Array, Array]:
    """Places x and z (n,), mm, of images at distances from the lens along its axis, on the lines it sees them in."""
    if subject.sensor.lens.TELECENTRIC:
        x = subject.sensor.meridian.trace(result.x_mm).first.x
    else:
        with np.errstate(invalid="ignore"):  # an infinite image seen exactly along the axis
            x = distance * np.tan(np.radians(result.theta_deg))
    return x, distance + reference_height(subject)
