"""Half-section of a mirror with dimensions, datums and tolerances."""

from __future__ import annotations

import numpy as np

from ...base.typing import Array
from ...optics.mirrors import Mirror
from ..body import Body
from ..surface_approximation import chords, conic_parameters, is_straight
from ..workshop import PartSpecification
from .sheet import (
    CHAIN,
    FRAME_HEIGHT,
    LETTERS,
    THICK,
    THIN,
    Region,
    Sheet,
    View,
    datum,
    fitting_scale,
    frame_width,
    scale_words,
    surface_sign,
    tolerance_frame,
)

ROW = 8.0
"""Distance between dimension lines, mm."""


def section_outline(mirror: Mirror, body: Body) -> Array:
    """Return the closed half-section (n, 2) as (z, x) in mm, with chords within 1 um of the
    meridian.
    """
    x = chords(mirror, 1.0, body.start_mm())
    meridian = np.stack([mirror.sag(x), x], axis=-1)
    return np.concatenate([meridian, body.outline(mirror)[1:, ::-1]])


def length_words(mm: float) -> str:
    """Format a length with up to three decimals.

    >>> length_words(180.429), length_words(5.0), length_words(-0.0001)
    ('180.429', '5', '0')
    """
    return fixed_words(mm, 3).rstrip("0").rstrip(".")


def fixed_words(value: float, digits: int) -> str:
    """Format a number with a fixed number of decimals; zero has no sign.

    >>> fixed_words(-1e-9, 4), fixed_words(2.0, 1)
    ('0.0000', '2.0')
    """
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def plus_minus(text: str, tolerance: float | None) -> str:
    """Append a symmetric tolerance to a dimension, if given.

    >>> plus_minus("Ø87.81", 0.05), plus_minus("5", None)
    ('Ø87.81 ± 0.05', '5')
    """
    return text if tolerance is None else f"{text} ± {tolerance:.3g}"


def draw_mirror(
    sheet: Sheet,
    mirror: Mirror,
    body: Body,
    region: Region,
    making: PartSpecification,
    form_um: float | None,
    title: str,
) -> float:
    """Draw a mirror in half-section with dimensions, datums and tolerances, and return the scale.

    The back is datum A, the axis of the rim or flange datum B. ``form_um`` (peak to valley) is the
    profile tolerance of the mirror surface, independent of its position.
    """
    back, outer = body.back_mm(mirror), body.outer_radius_mm(mirror)
    left, right, below, above = 62, 46, 34, 18
    room = region.right - region.left - left - right, region.top - region.bottom - below - above
    scale = fitting_scale(back, 2 * outer, *room)
    shift = (room[0] - scale * back) / 2
    view = View(region.left + left + shift, region.bottom + below + room[1] / 2, scale)
    sheet.text(region.left, region.top - 4, f"{title}  {scale_words(scale)}", height=3.5)
    sheet.line(view.at([-8 / scale, back + 10 / scale], 0.0), THIN, CHAIN)
    outline = section_outline(mirror, body)
    upper = view.at(outline[:, 0], outline[:, 1])
    sheet.hatch(upper)
    sheet.line(upper if body.bore_goes_through else upper[:-1], THICK)
    _draw_outside(sheet, view, mirror, body)
    surface = outline[: len(chords(mirror, 1.0, body.start_mm()))]
    for side in (1, -1):
        sheet.line(view.at(surface[:, 0], side * surface[:, 1]), 2 * THICK, solid_capstyle="butt")
    _dimension_mirror(sheet, view, mirror, body, making)
    _draw_surface(sheet, view, mirror, form_um)
    _draw_datums(sheet, view, mirror, body, making)
    _draw_textures(sheet, region, making)
    return scale


def _draw_surface(sheet: Sheet, view: View, mirror: Mirror, form_um: float | None) -> None:
    """Draw the description and the profile tolerance of the mirror surface."""
    rim = mirror.rim_radius_mm
    edge = float(mirror.sag(rim))
    tip, lines = view.at(mirror.sag(0.62 * rim), 0.62 * rim), surface_lines(mirror)
    highest = view.at(edge, rim)[1] - (4 * len(lines) + 1)  # clear of the extension line at the rim
    bend = np.array([view.x - 4, min(tip[1] + 7, highest)])
    sheet.leader(tip, bend, lines, rightwards=False)
    if form_um is not None:
        cells = [f"{form_um / 1000:.3g}"]  # form only; code 4/ specifies the position
        tolerance_frame(
            sheet,
            bend[0] - frame_width(sheet, cells),
            bend[1] - FRAME_HEIGHT - 1,
            "surface profile",
            cells,
        )


def _draw_datums(
    sheet: Sheet, view: View, mirror: Mirror, body: Body, making: PartSpecification
) -> None:
    """Draw datum A and the flatness of the back."""
    back, outer = body.back_mm(mirror), body.outer_radius_mm(mirror)
    low = view.at(back, -0.72 * outer)
    datum(sheet, low, (1.0, 0.0), "A")
    if making.back_flatness_mm is not None:
        foot = view.at(back, 0.8 * outer)
        x, y = foot[0] + 8.0, _flatness_y(view, mirror, body)
        sheet.line([tuple(foot), (x, y)], THIN)
        tolerance_frame(
            sheet, x, y - FRAME_HEIGHT / 2, "flatness", [f"{making.back_flatness_mm:.3g}"]
        )


def _flatness_y(view: View, mirror: Mirror, body: Body) -> float:
    """Return the height of the flatness frame, above the text of a bore."""
    back, outer = body.back_mm(mirror), body.outer_radius_mm(mirror)
    beside = float(view.at(back, 0.8 * outer)[1])
    if not body.bore_mm:
        return beside
    return max(
        beside, float(view.at(back, (body.counterbore_diameter_mm or body.bore_mm) / 2)[1]) + 24
    )


def _draw_textures(sheet: Sheet, region: Region, making: PartSpecification) -> None:
    """Draw the general surface texture and, in brackets, that of the mirror."""
    special = making.surface_roughness_nm
    text, x, y = (
        f"Ra {making.roughness_um:g}",
        region.right - (62 if special is not None else 24),
        region.top - 10,
    )
    end = surface_sign(sheet, x, y, text)
    if special is not None:
        sheet.text(end + 2, y + 2, "(", height=2 * LETTERS)
        end = surface_sign(sheet, end + 7, y, f"Rq {special / 1000:.3g}")
        sheet.text(end + 1, y + 2, ")", height=2 * LETTERS)


def _draw_outside(sheet: Sheet, view: View, mirror: Mirror, body: Body) -> None:
    """Draw the exterior view of the lower half: silhouette and edge of the rim."""
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


def _dimension_mirror(
    sheet: Sheet, view: View, mirror: Mirror, body: Body, making: PartSpecification
) -> None:
    rim, back, outer = mirror.rim_radius_mm, body.back_mm(mirror), body.outer_radius_mm(mirror)
    edge, low, left = float(mirror.sag(rim)), view.at(0.0, -outer)[1], view.x - 46
    wide = plus_minus(f"Ø{length_words(2 * rim)}", making.diameter_tolerance_mm)
    sheet.dimension(view.at(edge, -rim), view.at(edge, rim), left, wide, upright=True)
    datum(sheet, (left, view.at(edge, -rim)[1]), (0.0, -1.0), "B")
    thick = plus_minus(length_words(back - edge), making.thickness_tolerance_mm)
    sheet.dimension(view.at(edge, -rim), view.at(back, -outer), low - ROW, thick)
    if edge:
        sag = f"({length_words(abs(edge))})"  # auxiliary dimension, from surface and rim
        sheet.dimension(view.at(0.0, 0.0), view.at(edge, -rim), low - ROW, sag, before=True)
        sheet.dimension(
            view.at(0.0, 0.0), view.at(back, -outer), low - 2 * ROW, f"({length_words(back)})"
        )
    if body.bore_mm:
        wide_bore = body.counterbore_diameter_mm or body.bore_mm
        tip = view.at(back, wide_bore / 2)
        sheet.leader(tip, tip + np.array([6, 6]), _bore_words(body))
    if body.flange_width_mm:
        tip = view.at(back, outer - body.flange_width_mm / 2)
        lines = ["flange", f"Ø{length_words(2 * outer)} × {length_words(body.flange_thickness_mm)}"]
        above = _flatness_y(view, mirror, body) + 4 if making.back_flatness_mm is not None else 0.0
        sheet.leader(tip, [tip[0] + 8, max(tip[1] + 6, above)], lines)


def _bore_words(body: Body) -> list[str]:
    depth = "through" if body.bore_goes_through else f"{length_words(body.bore_depth_mm)} deep"
    if body.thread:
        return [f"{body.thread}, {depth}", f"drill Ø{length_words(body.bore_mm)}"]
    bore = [f"Ø{length_words(body.bore_mm)} {depth}"]
    if body.counterbore_diameter_mm:
        wide, deep = (
            length_words(body.counterbore_diameter_mm),
            length_words(body.counterbore_depth_mm),
        )
        return [*bore, "counterbore", f"Ø{wide}, {deep} deep"]
    return [f"Ø{length_words(body.bore_mm)}", depth]


def surface_lines(mirror: Mirror) -> list[str]:
    """Return the text lines at the mirror surface."""
    conic = conic_parameters(mirror)
    if is_straight(mirror) and not mirror.is_pointed:
        return ["mirror surface", "flat"]
    if mirror.is_pointed:
        return [
            "mirror surface",
            f"{np.degrees(np.arctan(float(mirror.slope(0.0)))):.4f}° at the tip",
        ]
    lines = ["mirror surface", f"R = {float(mirror.radius_t(0.0)):.7g}"]
    return [*lines, f"k = {conic[1]:.6g}"] if conic else [*lines, "at the vertex"]
