"""Longitudinal section of a sensor with rays, mirrors, camera and housing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from ...analysis.figures.style import PALETTE
from ...base.typing import Array
from ...optics.housing import Dome, FlatWindow, Housing, Rod, Tube, wall_description
from ...optics.lenses import GaussianLens
from ...optics.sensor import Sensor
from ...optics.tracing.meridian import ChiefRays
from ..body import Body
from .mirror_view import length_words, plus_minus, section_outline
from .sheet import (
    CHAIN,
    DASHED,
    FINE,
    FRAME_HEIGHT,
    PHANTOM,
    THICK,
    THIN,
    Region,
    Sheet,
    View,
    datum,
    fitting_scale,
    scale_words,
    tolerance_frame,
)

RAY = PALETTE[0]
HEADING = 56.0
"""Space for the heading and the label of a tube at the left, mm."""
MAX_WINDOW_RADIUS = 8.0
"""Maximum drawn radius of a window without a diameter, in radii of the sensor."""
STEPS_DEG = (30.0, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Candidate steps of the drawn rays; the largest step with at least two rays is used."""


# -- sensor ------------------------------------------------------------------------------------------


class Assembly(NamedTuple):
    """Components of the sensor view; lengths in mm."""

    sensor: Sensor
    body: Body
    housing: Housing
    """Housing fitted to the sensor, with heights relative to the vertex."""
    lens: float
    imager: float
    back: float
    base: float
    """Start of the tube: at the lens, or at the back of a secondary mirror."""
    end: float
    """End of the tube or dome; the back of the mirror without one."""
    outer: float
    """Maximum radius."""
    secondary_body: Body

    @classmethod
    def of(cls, sensor: Sensor, body: Body, secondary_body: Body | None = None) -> Assembly:
        obstructions, shift = sensor.obstructions, sensor.mirror_pose.displacement_mm
        housing, lens, base = (
            obstructions.housing,
            obstructions.envelope.lens_mm - shift,
            obstructions.envelope.base_mm - shift,
        )
        away = 0.0 if sensor.lens.TELECENTRIC else cast(GaussianLens, sensor.lens).imager_mm
        if sensor.secondary is not None:  # opposite viewing direction of the camera
            away = -away
            lens = (
                -lens
                if sensor.lens.TELECENTRIC
                else sensor.secondary.lens_height(sensor.mirror_distance_mm)
            )
        if isinstance(housing.shell, Dome):
            housing = replace(
                housing, shell=replace(housing.shell, centre_mm=housing.shell.centres_mm[1] - shift)
            )
        if isinstance(housing.shell, FlatWindow):
            housing = replace(
                housing, shell=replace(housing.shell, height_mm=housing.shell.heights_mm[0] - shift)
            )
        back = body.back_mm(sensor.mirror)
        radii = [
            body.outer_radius_mm(sensor.mirror),
            housing.camera.diameter_mm / 2 if housing.camera else 0.0,
        ]
        wall = housing.shell if isinstance(housing.shell, Tube | Dome) else None
        radii += [] if wall is None else [wall.radii_mm[1]]
        if isinstance(housing.shell, FlatWindow):
            base = min(base, housing.shell.heights_mm[1])
            passing = float(
                sensor.meridian.trace(np.array([sensor.mirror.rim_radius_mm])).last[0][0]
            )
            width = (housing.shell.diameter_mm or 0.0) / 2 or min(
                passing, MAX_WINDOW_RADIUS * max(radii)
            )
            radii += [width]
        end = back if wall is None else shell_end_mm(sensor, wall, back)
        return cls(
            sensor,
            body,
            housing,
            lens,
            lens - away,
            back,
            base,
            end,
            max(radii),
            secondary_body or Body(),
        )

    @property
    def ends(self) -> tuple[float, float]:
        """Minimum and maximum height of all components."""
        positions = (self.imager, self.lens, self.base, self.back, self.end)
        return min(positions), max(positions)


def shell_end_mm(sensor: Sensor, shell: Tube | Dome, back: float) -> float:
    """Return the height z (mm) of the end of a dome or tube.

    A tube ends at the back of the mirror, or beyond it where the ray of the rim has passed the wall.
    """
    radius = shell.radii_mm[1]
    if isinstance(shell, Dome):
        return radius + shell.centres_mm[1]
    rim = sensor.meridian.trace(np.array(sensor.mirror.rim_radius_mm))
    end_mm = (
        float(rim.z - (radius - rim.x) / np.tan(rim.reflected)) if rim.reflected > 0 else -np.inf
    )
    return max(back, end_mm)


def draw_sensor(
    sheet: Sheet,
    assembly: Assembly,
    region: Region,
    scale: float | None = None,
    tolerances: Mapping[str, float] | None = None,
) -> float:
    """Draw the longitudinal section, with the lens on the left, and return the scale."""
    low, high = assembly.ends
    left, right = (31, 29) if assembly.sensor.secondary is None else (60, 40)
    length, below, above = high - low, 27, 20
    room = region.right - region.left - left - right, region.top - region.bottom - below - above
    scale = scale or fitting_scale(length, 2 * assembly.outer, *room)
    x = region.left + left + max(room[0] - scale * length, 0.0) / 2 - scale * low
    view = View(x, region.bottom + below + room[1] / 2, scale)
    sheet.text(region.left, region.top - 4, f"SENSOR  {scale_words(scale)}", height=3.5)
    sheet.line(
        view.at([low - 8 / scale, max(assembly.back, assembly.imager) + 8 / scale], 0.0),
        THIN,
        CHAIN,
    )
    _draw_rays(sheet, view, assembly, region)
    _draw_housing(sheet, view, assembly, region)
    for outline, body in _sections(assembly):
        for side in (1, -1):
            corners = view.at(outline[:, 0], side * outline[:, 1])
            sheet.hatch(corners, rising=side > 0)
            sheet.line(corners[:-1] if not body.bore_goes_through else corners, THICK)
    _draw_camera(sheet, view, assembly)
    _dimension_sensor(sheet, view, assembly, tolerances or {})
    return scale


def _sections(assembly: Assembly) -> list[tuple[Array, Body]]:
    """Return half-sections (z, x) of the mirrors at their positions, with their bodies."""
    sensor = assembly.sensor
    sections = [(section_outline(sensor.mirror, assembly.body), assembly.body)]
    if sensor.secondary is not None:
        outline = section_outline(sensor.secondary.mirror, assembly.secondary_body)
        there = outline * [-1.0, 1.0] - [sensor.secondary.distance_mm, 0.0]
        sections.append((there, assembly.secondary_body))
    return sections


def shown_angles(sensor: Sensor) -> list[float]:
    """Return field angles (deg) of the drawn rays: unobscured multiples of a step, and the rim."""
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
    """Draw chief rays from the object space to the lens: all above the axis, the rim ray below it."""
    sensor = assembly.sensor
    angles = shown_angles(sensor)
    x = sensor.meridian.x_from_omega(np.radians(np.minimum(angles, sensor.field_deg[1])))
    rays = sensor.meridian.trace(x)
    heights = sensor.lens.image_height(rays.first.x, rays.first.w)
    tangent = np.tan(rays.first.theta)
    at_lens = -tangent * sensor.lens.pupil.position(
        tangent
    )  # intersections of rays with it on both paths
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
        wall, outwards = _through_wall(rays, i), rays.omega[i]
        if wall and view.scale * wall[0][1] > min(region.top - 8 - view.y, view.y - region.bottom):
            wall, outwards = [], rays.reflected[i]  # the ray leaves the sheet before the wall
        inner = np.array([*wall, *met, *tail])
        for side in (1, -1) if omega == angles[-1] else (1,):
            points = view.at(inner[:, 0], side * inner[:, 1])
            away = np.array([-np.cos(outwards), side * np.sin(outwards)])
            outermost = float(inner[0, 1])
            top = (
                (region.top - 8 - points[0, 1])
                if side > 0
                else view.scale * (assembly.outer - outermost) + 5
            )
            reach = max(top, 0.0) / max(abs(away[1]), 1e-9)
            if away[0]:
                edge = region.right if away[0] > 0 else region.left + HEADING
                reach = min(reach, max((edge - points[0, 0]) / away[0], 0.0))
            start = points[0] + reach * away
            sheet.line([start, *points], FINE, color=RAY)
            if reach > 8:
                sheet.arrow(points[0] + 0.55 * reach * away, -away, RAY)
            if side > 0:
                labels.append((*(start + away), f"{omega:.4g}°"))
    free = np.inf
    for x_text, y_text, text in reversed(
        labels
    ):  # of overlapping labels, keep the one closer to the rim
        half = sheet.text_width(text) / 2 + 0.5
        if x_text + half < free:
            sheet.text(x_text, y_text, text, color=RAY, ha="center", va="bottom")
            free = x_text - half


def _through_wall(rays: ChiefRays, i: int) -> list[tuple[float, float]]:
    """Return the points (z, x) at which ray ``i`` leaves the cover and enters its wall; empty
    without a cover.
    """
    outside = rays.outside
    if outside is None or not outside.refractions[0].path_mm[i]:
        return []
    way, angle = float(outside.refractions[0].path_mm[i]), float(rays.reflected[i])
    x, z = rays.last
    return [
        (float(z[i]), float(x[i])),
        (float(rays.z[i]) - way * np.cos(angle), float(rays.x[i]) + way * np.sin(angle)),
    ]


def _draw_housing(sheet: Sheet, view: View, assembly: Assembly, region: Region) -> None:
    """Draw tube or dome, rod, and the front of the camera."""
    housing = assembly.housing
    if isinstance(housing.shell, Tube):
        _draw_tube(sheet, view, assembly, housing.shell, region)
    if isinstance(housing.shell, Dome):
        _draw_dome(sheet, view, assembly, housing.shell)
    if isinstance(housing.shell, FlatWindow):
        _draw_window(sheet, view, assembly, housing.shell)
    if housing.rod is not None:
        _draw_rod(sheet, view, assembly, housing.rod)
    if housing.camera is not None:
        half, front = housing.camera.diameter_mm / 2, assembly.lens + housing.camera.height_mm
        sheet.line(view.at([front] * 2, [-half, half]), THIN, PHANTOM)


def _draw_tube(sheet: Sheet, view: View, assembly: Assembly, tube: Tube, region: Region) -> None:
    inner, outer = tube.radii_mm
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
    else:  # disc that carries the secondary mirror
        brim = assembly.secondary_body.outer_radius_mm(second.mirror)
        for side in (1, -1):
            sheet.line(view.at([assembly.base] * 2, [side * brim, side * inner]), THIN)
    tip, bend = view.at(0.98 * assembly.base, outer), np.array([-4, 5])
    if second is not None:  # rays above it
        tip, bend = view.at(assembly.base, outer - tube.wall_mm / 2), np.array([-12, -8])
    lines = [f"transparent tube Ø{2 * outer:g} × {tube.wall_mm:g}", wall_description(tube)]
    left = region.left + sheet.text_width(lines[0]) + 3  # keep the label on the sheet
    sheet.leader(tip, [max(tip[0] + bend[0], left), tip[1] + bend[1]], lines, rightwards=False)


def _draw_rod(sheet: Sheet, view: View, assembly: Assembly, rod: Rod) -> None:
    assert rod.gap_mm is not None
    assert rod.end_diameter_mm is not None
    sensor = assembly.sensor
    radius, end, foot = rod.diameter_mm / 2, rod.end_diameter_mm / 2, assembly.lens + rod.gap_mm
    tip_z = float(sensor.mirror.sag(min(end, sensor.mirror.rim_radius_mm)))
    outline = view.at(np.array([tip_z, foot, foot, tip_z]), np.array([end, radius, -radius, -end]))
    sheet.hatch(outline, spacing=1.6)
    sheet.line(outline, THICK)
    width = f"{rod.diameter_mm:g}" + (f" to {rod.end_diameter_mm:g}" if end != radius else "")
    tip, lines = view.at(0.6 * assembly.lens, -radius), [f"rod Ø{width} × {-foot:.4g}"]
    # below the rim ray at the end of the label, and below the lens label
    y = _below_rays(view, assembly, tip[0] + 8 + sheet.text_width(lines[0])) - 6
    if not sensor.lens.TELECENTRIC:
        y = min(y, _lens_words_y(sheet, view, assembly) - 6)
    sheet.leader(tip, [tip[0] + 6, y], lines)


def _draw_dome(sheet: Sheet, view: View, assembly: Assembly, dome: Dome) -> None:
    radii, centres = np.array(dome.radii_mm), np.array(dome.centres_mm)
    foot = np.arccos((assembly.lens - centres) / radii)  # angle from the axis at the centre
    arcs = [np.linspace(0, end, 181) for end in foot]
    for side in (1, -1):
        inner, outer = (
            view.at(c + r * np.cos(arc), side * r * np.sin(arc))
            for c, r, arc in zip(centres, radii, arcs, strict=True)
        )
        wall = np.concatenate([inner, outer[::-1]])
        sheet.hatch(wall, spacing=1.6, rising=side < 0)
        sheet.line(inner, THIN)
        sheet.line(outer, THIN)
    base = float(radii[0] * np.sin(foot[0]))
    sheet.line(view.at([assembly.lens] * 2, [-base, base]), THIN, DASHED)
    tip = view.at(centres[1] + radii[1] * np.cos(0.9 * foot[1]), -radii[1] * np.sin(0.9 * foot[1]))
    lines = [f"transparent dome SØ{2 * radii[1]:g} × {dome.wall_mm:g}", wall_description(dome)]
    sheet.leader(tip, tip + np.array([-14, -6]), lines, rightwards=False)


def _draw_window(sheet: Sheet, view: View, assembly: Assembly, window: FlatWindow) -> None:
    inner, outer = window.heights_mm
    half = assembly.outer if window.diameter_mm is None else window.diameter_mm / 2
    pane = view.at(
        np.array([inner, inner, outer, outer, inner]), np.array([-half, half, half, -half, -half])
    )
    sheet.hatch(pane, spacing=1.6)
    sheet.line(pane, THIN)
    size = "" if window.diameter_mm is None else f" Ø{window.diameter_mm:g} ×"
    lines = [f"window{size} {window.wall_mm:g}", wall_description(window)]
    tip = view.at(outer, -0.8 * half)
    sheet.leader(tip, tip + np.array([-7, -6]), lines, rightwards=False)


def _draw_camera(sheet: Sheet, view: View, assembly: Assembly) -> None:
    """Draw lens and imager with labels."""
    sensor = assembly.sensor
    rim, imager = sensor.mirror.rim_radius_mm, sensor.imager
    half = (
        rim if sensor.lens.TELECENTRIC else max(imager.height_px * imager.pitch_mm, 8 / view.scale)
    )
    if sensor.secondary is not None and assembly.lens < assembly.back:
        half = min(half, 0.9 * max(sensor.secondary.bore_radius_mm, 1.0))  # in the bore
    top, bottom = view.at(assembly.lens, half), view.at(assembly.lens, -half)
    sheet.line([bottom, top], THICK)
    for tip, up in ((top, 1.0), (bottom, -1.0)):
        sheet.arrow(tip, (0.0, up))
    if sensor.lens.TELECENTRIC:
        lines = ["telecentric lens,", "at any distance"]
        sheet.leader(
            view.at(assembly.lens, 0.5 * half),
            view.at(assembly.lens, 0.5 * half) + np.array([-6, 8]),
            lines,
            False,
        )
        return
    lens = cast(GaussianLens, sensor.lens)
    lines = lens_words(lens)
    size = imager.height_px * imager.pitch_mm / 2
    sheet.line(view.at([assembly.imager] * 2, [-size, size]), 2 * THICK, solid_capstyle="butt")
    tip = view.at(assembly.imager, size)
    about = ["imager", f"{imager.width_px} × {imager.height_px}", f"{imager.pixel_pitch_um:g} µm"]
    if sensor.secondary is not None:  # camera on the right
        right = view.at(max(assembly.back, assembly.imager), 0.0)[0] + 9
        sheet.leader(tip, [right, view.y + 12], about)
        sheet.leader(bottom, [right, view.y - 18], lines)
        return
    if isinstance(assembly.housing.shell, Dome):  # to the left, clear of the wall
        sheet.leader(bottom, bottom - np.array([10, 3]), lines, rightwards=False)
        sheet.leader(tip, tip + np.array([-7, 12]), about, rightwards=False)
        return
    sheet.leader(bottom, [bottom[0] + 7, _lens_words_y(sheet, view, assembly)], lines)
    sheet.leader(
        view.at(assembly.imager, -size), tip + np.array([-7, -20]), about, rightwards=False
    )


def lens_words(lens: GaussianLens) -> list[str]:
    """Return the label of the lens."""
    return [
        f"lens f = {lens.focal_length_mm:g}, F/{lens.f_number:g}",
        f"focused at {lens.focus_distance_mm:g}",
    ]


def _below_rays(view: View, assembly: Assembly, x: float) -> float:
    """Return the height on the sheet of the rim ray between mirror and lens, at x."""
    theta = assembly.sensor.meridian.theta_max
    reach = (
        (x - view.at(assembly.lens, 0.0)[0]) * np.tan(theta)
        if theta
        else view.scale * assembly.outer
    )
    return float(view.y - reach)


def _lens_words_y(sheet: Sheet, view: View, assembly: Assembly) -> float:
    """Return the height of the lens label, below the rim ray."""
    width = max(map(sheet.text_width, lens_words(cast(GaussianLens, assembly.sensor.lens))))
    end = view.at(assembly.lens, 0.0)[0] + 9 + width
    beside = _below_rays(view, assembly, end) - 10
    vertex = view.at(0.0, -assembly.outer)
    return float(
        beside if end < vertex[0] - 2 else min(beside, vertex[1] - 11)
    )  # or below the mirror


def _words_floor(sheet: Sheet, view: View, assembly: Assembly) -> float:
    """Return the height below which no labels are placed in the view of a single-mirror sensor."""
    if assembly.sensor.lens.TELECENTRIC or isinstance(assembly.housing.shell, Dome):
        return float(view.y)
    return _lens_words_y(sheet, view, assembly) - (6 if assembly.housing.rod else 0)


def _dimension_sensor(
    sheet: Sheet, view: View, assembly: Assembly, allocated: Mapping[str, float]
) -> None:
    sensor = assembly.sensor
    _place_mirror(sheet, view, assembly, allocated)
    if sensor.secondary is not None:
        _dimension_two(sheet, view, assembly)
        return
    lower = min(view.at(0.0, -assembly.outer)[1], _words_floor(sheet, view, assembly) + 5)
    vertex, back = view.at(0.0, 0.0), view.at(assembly.back, -assembly.outer)
    if not sensor.lens.TELECENTRIC:
        lens, imager = view.at(assembly.lens, 0.0), view.at(assembly.imager, 0.0)
        edge = view.at(
            assembly.lens, -assembly.outer if isinstance(assembly.housing.shell, Tube) else 0.0
        )
        spacing = plus_minus(length_words(-assembly.lens), allocated.get("mirror.displacement_mm"))
        sheet.dimension(edge, vertex, lower - 10, spacing)
        sheet.dimension(
            imager, lens, lower - 10, length_words(assembly.lens - assembly.imager), before=True
        )
        sheet.dimension(
            imager, back, lower - 18, f"({length_words(assembly.back - assembly.imager)})"
        )
    _dimension_width(sheet, view, assembly, view.at(assembly.end, 0.0)[0] + 16)


def _place_mirror(
    sheet: Sheet, view: View, assembly: Assembly, allocated: Mapping[str, float]
) -> None:
    """Draw position tolerances of the mirror relative to the optical axis of the lens, datum C."""
    frames = place_frames(assembly.sensor, allocated)
    if not frames:
        return
    low, high = assembly.ends
    datum(sheet, view.at(low, 0.0) - [8.0, 0.0], (-1.0, 0.0), "C", reach=4.0)
    x, y = view.at(high, 0.0)[0] + 3, view.at(0.0, -assembly.outer)[1] - 14
    if assembly.sensor.secondary is not None:  # below the labels of lens and imager
        x, y = view.at(max(assembly.back, assembly.imager), 0.0)[0] + 9, view.y - 22
    tip = view.at(assembly.back, -0.55 * assembly.sensor.mirror.rim_radius_mm)
    bend = max(tip[1] - (x - tip[0]), y)
    sheet.line([tuple(tip), (x, bend), (x, y)], FINE)
    sheet.arrow(tip, tip - [x, bend])
    for i, (sign, cells) in enumerate(frames):
        tolerance_frame(sheet, x, y - (i + 1) * FRAME_HEIGHT, sign, cells)


def place_frames(sensor: Sensor, allocated: Mapping[str, float]) -> list[tuple[str, list[str]]]:
    """Return tolerance frames of the mirror position (ISO 1101): coaxiality and perpendicularity."""
    away = [
        allocated[name]
        for name in ("mirror.decentre_x_mm", "mirror.decentre_y_mm")
        if allocated.get(name)
    ]
    tilts = [
        allocated[name]
        for name in ("mirror.tilt_x_deg", "mirror.tilt_y_deg")
        if allocated.get(name)
    ]
    frames = [("coaxiality", [f"Ø{2 * min(away):.3g}", "C"])] if away else []
    if tilts:
        zone = 2 * sensor.mirror.rim_radius_mm * float(np.tan(np.radians(min(tilts))))
        frames.append(("perpendicularity", [f"{zone:.3g}", "C"]))
    return frames


def _dimension_two(sheet: Sheet, view: View, assembly: Assembly) -> None:
    """Draw the dimensions of a folded sensor: mirror spacing, lens, imager and total length."""
    second = assembly.sensor.secondary
    assert second is not None
    lower, (low, high) = view.at(0.0, -assembly.outer)[1], assembly.ends
    vertex, there = view.at(0.0, 0.0), view.at(-second.distance_mm, 0.0)
    sheet.dimension(there, vertex, lower - 10, length_words(second.distance_mm))
    if not assembly.sensor.lens.TELECENTRIC:
        lens, imager = view.at(assembly.lens, 0.0), view.at(assembly.imager, 0.0)
        if abs(assembly.lens) > 1e-3:
            sheet.dimension(vertex, lens, lower - 10, length_words(abs(assembly.lens)))
        sheet.dimension(lens, imager, lower - 18, length_words(assembly.imager - assembly.lens))
        sheet.dimension(
            view.at(low, -assembly.outer), view.at(high, 0.0), lower - 26, length_words(high - low)
        )
    _dimension_width(sheet, view, assembly, view.at(low, 0.0)[0] - 8)


def _dimension_width(sheet: Sheet, view: View, assembly: Assembly, side: float) -> None:
    """Draw the largest diameter at x = ``side``, of the tube or of the mirror."""
    sensor = assembly.sensor
    shell = assembly.housing.shell
    if isinstance(shell, Tube):
        at = assembly.end if assembly.sensor.secondary is None else assembly.base
        half, text = assembly.outer, f"Ø{2 * assembly.outer:g}"
    elif isinstance(shell, Dome):
        at, half, text = shell.centres_mm[1], assembly.outer, f"SØ{2 * assembly.outer:g}"
    else:
        half = sensor.mirror.rim_radius_mm
        at, text = float(sensor.mirror.sag(half)), f"Ø{length_words(2 * half)}"
    sheet.dimension(view.at(at, -half), view.at(at, half), side, text, upright=True)
