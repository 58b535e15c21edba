"""The two views of the drawing: the sensor with its rays and housing, and the mirror in half-section."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ...figures.style import PALETTE
from ...housing import Dome, Housing, Rod, Tube
from ...lenses import GaussianLens
from ...mirrors import Mirror
from ...sensor import Sensor
from ..body import Body
from ..forms import chords, conic_of, is_straight
from .sheet import CHAIN, DASHED, FINE, PHANTOM, THICK, THIN, Sheet, View, fitting_scale, scale_words

Array = NDArray[np.float64]

RAY = PALETTE[0]
STEPS_DEG = (30.0, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Steps of the rays that are drawn, the largest first that shows two."""
ROW = 8.0
"""Distance of dimension lines on A3, mm."""


class Region(NamedTuple):
    """A rectangle of an A3 sheet, mm; other sheets are like it."""

    left: float
    bottom: float
    right: float
    top: float

    def on(self, sheet: Sheet) -> Region:
        return Region(*(sheet.k * v for v in self))


SENSOR_REGION = Region(24.0, 136.0, 408.0, 284.0)
MIRROR_REGION = Region(24.0, 13.0, 148.0, 132.0)
SECONDARY_REGION = Region(24.0, 165.0, 144.0, 284.0)
"""To the left of the sensor, which is short where it is folded."""


def section_outline(mirror: Mirror, body: Body) -> Array:
    """Closed half-section (n, 2) as (z, x) in mm, its meridian by chords within a micrometre."""
    x = chords(mirror, 1.0, body.start_mm())
    meridian = np.stack([mirror.sag(x), x], axis=-1)
    return np.concatenate([meridian, body.outline(mirror)[1:, ::-1]])


# -- the sensor --------------------------------------------------------------------------------------


class Assembly(NamedTuple):
    """What the view of the sensor is made of; lengths in mm."""

    sensor: Sensor
    body: Body
    housing: Housing
    """Fitted to the sensor; its heights are as in the drawing, over the vertex where it is."""
    lens: float
    imager: float
    back: float
    base: float
    """Where the tube begins: at the lens, or at the back of a second mirror."""
    end: float
    """Where the tube or the dome ends; the back without one."""
    outer: float
    """Radius of the widest part."""
    secondary_body: Body

    @classmethod
    def of(cls, sensor: Sensor, body: Body, secondary_body: Body | None = None) -> Assembly:
        standing, shift = sensor.obstructions, sensor.mirror_pose.displacement_mm
        housing, lens, base = standing.housing, standing.envelope.lens_mm - shift, standing.envelope.base_mm - shift
        away = 0.0 if sensor.lens.TELECENTRIC else cast(GaussianLens, sensor.lens).image_distance
        if sensor.secondary is not None:  # the camera looks the other way
            away = -away
            lens = -lens if sensor.lens.TELECENTRIC else sensor.secondary.lens_height(sensor.mirror_distance_mm)
        if isinstance(housing.shell, Dome):
            housing = replace(housing, shell=replace(housing.shell, centre_mm=housing.shell.centres_mm[1] - shift))
        back = body.back_mm(sensor.mirror)
        radii = [body.outer_radius_mm(sensor.mirror), housing.camera.diameter_mm / 2 if housing.camera else 0.0]
        wall = housing.shell if isinstance(housing.shell, Tube | Dome) else None
        radii += [] if wall is None else [wall.radii_mm[1]]
        end = back if wall is None else shell_end_mm(sensor, wall, back)
        return cls(sensor, body, housing, lens, lens - away, back, base, end, max(radii), secondary_body or Body())

    @property
    def ends(self) -> tuple[float, float]:
        """Heights between which everything stands."""
        places = (self.imager, self.lens, self.base, self.back, self.end)
        return min(places), max(places)


def shell_end_mm(sensor: Sensor, shell: Tube | Dome, back: float) -> float:
    """Height z (mm) where a dome ends, or a tube: at the mirror's back, or where the rim's ray has left the wall."""
    radius = shell.radii_mm[1]
    if isinstance(shell, Dome):
        return radius + shell.centres_mm[1]
    rim = sensor.meridian.trace(np.array(sensor.mirror.rim_radius_mm))
    left = float(rim.z - (radius - rim.x) / np.tan(rim.reflected)) if rim.reflected > 0 else -np.inf
    return max(back, left)


def draw_sensor(sheet: Sheet, assembly: Assembly, scale: float | None = None) -> float:
    """The sensor along its axis, the lens to the left; the scale it is drawn at."""
    k, region = sheet.k, SENSOR_REGION.on(sheet)
    if assembly.sensor.secondary is not None:
        region = region._replace(left=SECONDARY_REGION.right * k)
    low, high = assembly.ends
    length, left, right, below, above = high - low, 40 * k, 36 * k, 26 * k, 14 * k
    room = region.right - region.left - left - right, region.top - region.bottom - below - above
    scale = scale or fitting_scale(length, 2 * assembly.outer, *room)
    x = region.left + left + max(room[0] - scale * length, 0.0) / 2 - scale * low
    view = View(x, region.bottom + below + room[1] / 2, scale)
    sheet.text(region.left, region.top - 4 * k, f"SENSOR  {scale_words(scale)}", height=3.5)
    sheet.line(view.at([low - 8 * k / scale, max(assembly.back, assembly.imager) + 8 * k / scale], 0.0), THIN, CHAIN)
    _draw_rays(sheet, view, assembly, region)
    _draw_housing(sheet, view, assembly)
    for outline, body in _sections(assembly):
        for side in (1, -1):
            corners = view.at(outline[:, 0], side * outline[:, 1])
            sheet.hatch(corners, rising=side > 0)
            sheet.line(corners[:-1] if not body.bore_goes_through else corners, THICK)
    _draw_camera(sheet, view, assembly)
    _dimension_sensor(sheet, view, assembly)
    return scale


def _sections(assembly: Assembly) -> list[tuple[Array, Body]]:
    """Half-sections (z, x) of the mirrors where they stand, each with its body."""
    sensor = assembly.sensor
    sections = [(section_outline(sensor.mirror, assembly.body), assembly.body)]
    if sensor.secondary is not None:
        outline = section_outline(sensor.secondary.mirror, assembly.secondary_body)
        there = outline * [-1.0, 1.0] - [sensor.secondary.distance_mm, 0.0]
        sections.append((there, assembly.secondary_body))
    return sections


def shown_angles(sensor: Sensor) -> list[float]:
    """Field angles (deg) whose rays are drawn: full steps that nothing hides, and the rim."""
    low, high = sensor.field_deg
    hidden = [ring.omega_deg for ring in sensor.obscured]
    full: list[float] = []
    for step in STEPS_DEG if high > 90 else STEPS_DEG[1:]:
        angles = (float(a) for a in np.arange(step, high - 0.4 * step, step) if a > low)
        full = [a for a in angles if not any(r[0] <= a <= r[1] for r in hidden)]
        if len(full) >= 2:
            break
    return [*full, high]


def _draw_rays(sheet: Sheet, view: View, assembly: Assembly, region: Region) -> None:
    """Chief rays from the world over the mirror through the lens; above all of them, below the rim's."""
    sensor, k = assembly.sensor, sheet.k
    angles = shown_angles(sensor)
    x = sensor.meridian.x_from_omega(np.radians(np.minimum(angles, sensor.field_deg[1])))
    rays = sensor.meridian.trace(x)
    heights = sensor.lens.image_height(rays.first.x, rays.first.w)
    tangent = np.tan(rays.first.theta)
    at_lens = -tangent * sensor.lens.pupil.place(tangent)  # where rays on their way to the pupil, or from it, pass it
    labels: list[tuple[float, float, str]] = []
    for i, omega in enumerate(angles):
        met, seen_at = [(float(rays.z[i]), x[i])], rays.first.x[i]
        if sensor.secondary is not None:
            met.append((float(sensor.secondary.height(seen_at)), seen_at))
        tail = (
            [(assembly.lens, seen_at)]
            if sensor.lens.TELECENTRIC
            else [(assembly.lens, at_lens[i]), (assembly.imager, -heights[i])]
        )
        inner = np.array([*met, *tail])
        for side in (1, -1) if omega == angles[-1] else (1,):
            points = view.at(inner[:, 0], side * inner[:, 1])
            away = np.array([-np.cos(rays.omega[i]), side * np.sin(rays.omega[i])])
            top = (region.top - 8 * k - points[0, 1]) if side > 0 else view.scale * (assembly.outer - x[i]) + 5 * k
            reach = top / abs(away[1])
            if away[0]:
                reach = min(reach, ((region.right if away[0] > 0 else region.left) - points[0, 0]) / away[0])
            start = points[0] + reach * away
            sheet.line([start, *points], FINE, color=RAY)
            if reach > 8 * k:
                sheet.arrow(points[0] + 0.55 * reach * away, -away, RAY)
            if side > 0:
                labels.append((*(start + k * away), f"{omega:.4g}°"))
    free = np.inf
    for x_text, y_text, words in reversed(labels):  # of two that would overlap the one nearer to the rim is said
        half = sheet.text_width(words) / 2 + k / 2
        if x_text + half < free:
            sheet.text(x_text, y_text, words, color=RAY, ha="center", va="bottom")
            free = x_text - half


def _draw_housing(sheet: Sheet, view: View, assembly: Assembly) -> None:
    """Tube or dome, rod, and the camera's front."""
    housing = assembly.housing
    if isinstance(housing.shell, Tube):
        _draw_tube(sheet, view, assembly, housing.shell)
    if isinstance(housing.shell, Dome):
        _draw_dome(sheet, view, assembly, housing.shell)
    if housing.rod is not None:
        _draw_rod(sheet, view, assembly, housing.rod)
    if housing.camera is not None:
        half, front = housing.camera.diameter_mm / 2, assembly.lens + housing.camera.height_mm
        sheet.line(view.at([front] * 2, [-half, half]), THIN, PHANTOM)


def _draw_tube(sheet: Sheet, view: View, assembly: Assembly, tube: Tube) -> None:
    k, (inner, outer) = sheet.k, tube.radii_mm
    rim, second = assembly.body.outer_radius_mm(assembly.sensor.mirror), assembly.sensor.secondary
    for side in (1, -1):
        wall = view.at(
            np.array([assembly.base, assembly.end, assembly.end, assembly.base, assembly.base]),
            side * np.array([inner, inner, outer, outer, inner]),
        )
        sheet.hatch(wall, spacing=1.6, rising=side < 0)
        sheet.line(wall, THIN)
        sheet.line(view.at([assembly.back] * 2, [side * rim, side * inner]), THIN)
    if second is None:
        sheet.line(view.at([assembly.base] * 2, [-inner, inner]), THIN, DASHED)
    else:  # the disc that carries the second mirror
        brim = assembly.secondary_body.outer_radius_mm(second.mirror)
        for side in (1, -1):
            sheet.line(view.at([assembly.base] * 2, [side * brim, side * inner]), THIN)
    tip, bend = view.at(0.98 * assembly.base, outer), np.array([-4, 5]) * k
    if second is not None:  # above it are rays
        tip, bend = view.at(assembly.base, outer - tube.wall_mm / 2), np.array([-12, -8]) * k
    words = [f"transparent tube Ø{2 * outer:g} × {tube.wall_mm:g}", f"n = {tube.refractive_index:g}"]
    sheet.leader(tip, tip + bend, words, rightwards=False)


def _draw_rod(sheet: Sheet, view: View, assembly: Assembly, rod: Rod) -> None:
    assert rod.gap_mm is not None
    assert rod.end_diameter_mm is not None
    k, sensor = sheet.k, assembly.sensor
    radius, end, foot = rod.diameter_mm / 2, rod.end_diameter_mm / 2, assembly.lens + rod.gap_mm
    tip_z = float(sensor.mirror.sag(min(end, sensor.mirror.rim_radius_mm)))
    outline = view.at(np.array([tip_z, foot, foot, tip_z]), np.array([end, radius, -radius, -end]))
    sheet.hatch(outline, spacing=1.6)
    sheet.line(outline, THICK)
    width = f"{rod.diameter_mm:g}" + (f" to {rod.end_diameter_mm:g}" if end != radius else "")
    tip, words = view.at(0.6 * assembly.lens, -radius), [f"rod Ø{width} × {-foot:.4g}"]
    # below the rim's ray, where the words end
    right = tip[0] + 8 * k + sheet.text_width(words[0])
    theta = sensor.meridian.theta_max
    ray = (right - view.at(assembly.lens, 0.0)[0]) * np.tan(theta) if theta else view.scale * assembly.outer
    sheet.leader(tip, [tip[0] + 6 * k, view.y - ray - 6 * k], words)


def _draw_dome(sheet: Sheet, view: View, assembly: Assembly, dome: Dome) -> None:
    k, radii, centres = sheet.k, np.array(dome.radii_mm), np.array(dome.centres_mm)
    foot = np.arccos((assembly.lens - centres) / radii)  # from the axis, seen from the centre
    arcs = [np.linspace(0, end, 181) for end in foot]
    for side in (1, -1):
        inner, outer = (
            view.at(c + r * np.cos(arc), side * r * np.sin(arc)) for c, r, arc in zip(centres, radii, arcs, strict=True)
        )
        wall = np.concatenate([inner, outer[::-1]])
        sheet.hatch(wall, spacing=1.6, rising=side < 0)
        sheet.line(inner, THIN)
        sheet.line(outer, THIN)
    base = float(radii[0] * np.sin(foot[0]))
    sheet.line(view.at([assembly.lens] * 2, [-base, base]), THIN, DASHED)
    tip = view.at(centres[1] + radii[1] * np.cos(0.9 * foot[1]), -radii[1] * np.sin(0.9 * foot[1]))
    words = [f"transparent dome SØ{2 * radii[1]:g} × {dome.wall_mm:g}", f"n = {dome.refractive_index:g}"]
    sheet.leader(tip, tip + np.array([-14, 2]) * k, words, rightwards=False)


def _draw_camera(sheet: Sheet, view: View, assembly: Assembly) -> None:
    """Lens and imager, with what they are."""
    sensor, k = assembly.sensor, sheet.k
    rim, imager = sensor.mirror.rim_radius_mm, sensor.imager
    half = rim if sensor.lens.TELECENTRIC else max(imager.height_px * imager.pitch_mm, 8 * k / view.scale)
    if sensor.secondary is not None and assembly.lens < assembly.back:
        half = min(half, 0.9 * max(sensor.secondary.bore_radius_mm, 1.0))  # in the bore
    top, bottom = view.at(assembly.lens, half), view.at(assembly.lens, -half)
    sheet.line([bottom, top], THICK)
    for tip, up in ((top, 1.0), (bottom, -1.0)):
        sheet.arrow(tip, (0.0, up))
    if sensor.lens.TELECENTRIC:
        words = ["telecentric lens,", "at any distance"]
        sheet.leader(
            view.at(assembly.lens, 0.5 * half), view.at(assembly.lens, 0.5 * half) + np.array([-6, 8]) * k, words, False
        )
        return
    lens = cast(GaussianLens, sensor.lens)
    words = [f"lens f = {lens.focal_length_mm:g}, F/{lens.f_number:g}", f"focused at {lens.focus_distance_mm:g}"]
    size = imager.height_px * imager.pitch_mm / 2
    sheet.line(view.at([assembly.imager] * 2, [-size, size]), 2 * THICK, solid_capstyle="butt")
    tip = view.at(assembly.imager, size)
    about = ["imager", f"{imager.width_px} × {imager.height_px}", f"{imager.pixel_pitch_um:g} µm"]
    if sensor.secondary is not None:  # the camera's side is the right one
        right = view.at(max(assembly.back, assembly.imager), 0.0)[0] + 12 * k
        sheet.leader(tip, [right, view.y + 12 * k], about)
        sheet.leader(bottom, [right, view.y - 18 * k], words)
        return
    # below the rim's ray, where the words end
    ray = (9 * k + max(map(sheet.text_width, words))) * np.tan(sensor.meridian.theta_max)
    sheet.leader(bottom, [bottom[0] + 7 * k, view.y - ray - 10 * k], words)
    sheet.leader(tip, tip + np.array([-7, 12]) * k, about, rightwards=False)


def _dimension_sensor(sheet: Sheet, view: View, assembly: Assembly) -> None:
    k, sensor = sheet.k, assembly.sensor
    if sensor.secondary is not None:
        _dimension_two(sheet, view, assembly)
        return
    lower = view.at(0.0, -assembly.outer)[1]
    vertex, back = view.at(0.0, 0.0), view.at(assembly.back, -assembly.outer)
    if not sensor.lens.TELECENTRIC:
        lens, imager = view.at(assembly.lens, 0.0), view.at(assembly.imager, 0.0)
        edge = view.at(assembly.lens, -assembly.outer if isinstance(assembly.housing.shell, Tube) else 0.0)
        sheet.dimension(edge, vertex, lower - 10 * k, length_words(-assembly.lens))
        sheet.dimension(imager, lens, lower - 10 * k, length_words(assembly.lens - assembly.imager), before=True)
        sheet.dimension(imager, back, lower - 18 * k, length_words(assembly.back - assembly.imager))
    _dimension_width(sheet, view, assembly, view.at(assembly.end, 0.0)[0] + 16 * k)


def _dimension_two(sheet: Sheet, view: View, assembly: Assembly) -> None:
    """Of a folded sensor: from mirror to mirror, to the lens, to the imager, and all of it."""
    k, second = sheet.k, assembly.sensor.secondary
    assert second is not None
    lower, (low, high) = view.at(0.0, -assembly.outer)[1], assembly.ends
    vertex, there = view.at(0.0, 0.0), view.at(-second.distance_mm, 0.0)
    sheet.dimension(there, vertex, lower - 10 * k, length_words(second.distance_mm))
    if not assembly.sensor.lens.TELECENTRIC:
        lens, imager = view.at(assembly.lens, 0.0), view.at(assembly.imager, 0.0)
        if abs(assembly.lens) > 1e-3:
            sheet.dimension(vertex, lens, lower - 10 * k, length_words(abs(assembly.lens)))
        sheet.dimension(lens, imager, lower - 18 * k, length_words(assembly.imager - assembly.lens))
        sheet.dimension(view.at(low, -assembly.outer), view.at(high, 0.0), lower - 26 * k, length_words(high - low))
    _dimension_width(sheet, view, assembly, view.at(low, 0.0)[0] - 8 * k)


def _dimension_width(sheet: Sheet, view: View, assembly: Assembly, side: float) -> None:
    """The largest diameter, its line at x = ``side``: of the tube, or of the mirror."""
    sensor = assembly.sensor
    shell = assembly.housing.shell
    if isinstance(shell, Tube):
        at = assembly.end if assembly.sensor.secondary is None else assembly.base
        half, words = assembly.outer, f"Ø{2 * assembly.outer:g}"
    elif isinstance(shell, Dome):
        at, half, words = shell.centres_mm[1], assembly.outer, f"SØ{2 * assembly.outer:g}"
    else:
        half = sensor.mirror.rim_radius_mm
        at, words = float(sensor.mirror.sag(half)), f"Ø{length_words(2 * half)}"
    sheet.dimension(view.at(at, -half), view.at(at, half), side, words, upright=True)


def length_words(mm: float) -> str:
    """A length to the micrometre, without idle zeros.

    >>> length_words(180.429), length_words(5.0), length_words(-0.0001)
    ('180.429', '5', '0')
    """
    words = f"{mm:.3f}".rstrip("0").rstrip(".")
    return "0" if words == "-0" else words


# -- the mirror --------------------------------------------------------------------------------------


def draw_mirror(
    sheet: Sheet,
    mirror: Mirror,
    body: Body,
    region: Region,
    title: str = "MIRROR",
) -> float:
    """A mirror in half-section with its dimensions; the scale it is drawn at."""
    k, back, outer = sheet.k, body.back_mm(mirror), body.outer_radius_mm(mirror)
    left, right, below, above = 48 * k, 36 * k, 22 * k, 6 * k
    room = region.right - region.left - left - right, region.top - region.bottom - below - above
    scale = fitting_scale(back, 2 * outer, *room)
    view = View(region.left + left, region.bottom + below + room[1] / 2, scale)
    sheet.text(region.left, region.top - 4 * k, f"{title}  {scale_words(scale)}", height=3.5)
    sheet.line(view.at([-8 * k / scale, back + 10 * k / scale], 0.0), THIN, CHAIN)
    outline = section_outline(mirror, body)
    upper = view.at(outline[:, 0], outline[:, 1])
    sheet.hatch(upper)
    sheet.line(upper if body.bore_goes_through else upper[:-1], THICK)
    _draw_outside(sheet, view, mirror, body)
    surface = outline[: len(chords(mirror, 1.0, body.start_mm()))]
    for side in (1, -1):
        sheet.line(view.at(surface[:, 0], side * surface[:, 1]), 2 * THICK, solid_capstyle="butt")
    _dimension_mirror(sheet, view, mirror, body, region.left + 8 * k)
    return scale


def _draw_outside(sheet: Sheet, view: View, mirror: Mirror, body: Body) -> None:
    """The lower half as seen from outside: its silhouette, and the edge of the rim."""
    corners = body.outline(mirror)
    outside = corners[corners[:, 0] >= mirror.rim_radius_mm * (1 - 1e-12)]
    silhouette = [*outside, (0.0, body.back_mm(mirror))]
    points = np.array(silhouette)
    sheet.line(view.at(points[:, 1], -points[:, 0]), THICK)
    x = chords(mirror, 1.0, body.start_mm())
    sheet.line(view.at(mirror.sag(x), -x), THICK)
    if start := body.start_mm():
        sheet.line(view.at([float(mirror.sag(start))] * 2, [-start, 0.0]), THICK)
    edges = {float(z) for z in outside[:, 1]} - {body.back_mm(mirror)}
    for z in edges:
        reach = max(r for r, height in outside if height == z)
        sheet.line(view.at([z, z], [-reach, 0.0]), THIN)


def _dimension_mirror(sheet: Sheet, view: View, mirror: Mirror, body: Body, left: float) -> None:
    k = sheet.k
    rim, back, outer = mirror.rim_radius_mm, body.back_mm(mirror), body.outer_radius_mm(mirror)
    edge, low = float(mirror.sag(rim)), view.at(0.0, -outer)[1]
    sheet.dimension(view.at(edge, -rim), view.at(edge, rim), left, f"Ø{length_words(2 * rim)}", upright=True)
    sheet.dimension(view.at(edge, -rim), view.at(back, -outer), low - ROW * k, length_words(back - edge))
    if edge:
        sheet.dimension(view.at(0.0, 0.0), view.at(edge, -rim), low - ROW * k, length_words(abs(edge)), before=True)
        sheet.dimension(view.at(0.0, 0.0), view.at(back, -outer), low - 2 * ROW * k, length_words(back))
    tip, words = view.at(mirror.sag(0.62 * rim), 0.62 * rim), surface_lines(mirror)
    highest = view.at(edge, rim)[1] - (4 * len(words) + 1) * k  # clear of the extension line at the rim
    sheet.leader(tip, [view.x - 4 * k, min(tip[1] + 7 * k, highest)], words, rightwards=False)
    if body.bore_mm:
        tip = view.at(back, body.bore_mm / 2)
        sheet.leader(tip, tip + np.array([6, 10]) * k, _bore_words(body))
    if body.flange_width_mm:
        tip = view.at(back, -outer + body.flange_width_mm / 2)
        words = ["flange", f"Ø{length_words(2 * outer)} × {length_words(body.flange_thickness_mm)}"]
        sheet.leader(tip, tip + np.array([6, 6]) * k, words)


def _bore_words(body: Body) -> list[str]:
    depth = "through" if body.bore_goes_through else f"{length_words(body.bore_depth_mm)} deep"
    if body.thread:
        return [f"{body.thread}, {depth}", f"drill Ø{length_words(body.bore_mm)}"]
    return [f"Ø{length_words(body.bore_mm)}", depth]


def surface_lines(mirror: Mirror) -> list[str]:
    """What to write at the mirror surface."""
    conic = conic_of(mirror)
    if is_straight(mirror) and not mirror.is_pointed:
        return ["mirror surface", "flat"]
    if mirror.is_pointed:
        return ["mirror surface", f"{np.degrees(np.arctan(float(mirror.slope(0.0)))):.4f}° at the tip"]
    lines = ["mirror surface", f"R = {float(mirror.radius_t(0.0)):.7g}"]
    return [*lines, f"k = {conic[1]:.6g}"] if conic else [*lines, "at the vertex"]
