"""DXF: dimensioned half-section of a mirror, and its drawing sheet as a layout.

In model space, the axis is horizontal: X is z (lens on the left), Y the distance from the axis. The
upper half is a hatched section, the lower half an exterior view, both at full size in mm. The
layout has the paper size of the drawing sheet.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.text import Text

from ...base.escaping import dxf_mtext, dxf_text
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ..body import Body, Part
from ..surface_approximation import ProfileCurve, chords, conic_parameters, profile_curve
from ..workshop import PartSpecification, Workshop
from .drawing import draw_part_sheet
from .sheet import CAPITAL, POINT, Sheet
from .tables import DataFile


class Layer(NamedTuple):
    """Name, colour (AutoCAD index), line width (1/100 mm) and line type of a layer."""

    name: str
    colour: int
    width: int
    linetype: str = "Continuous"


MIRROR = Layer("MIRROR", 5, 70)
OUTLINE = Layer("OUTLINE", 7, 50)
CENTRE = Layer("CENTRE", 1, 25, "CENTER")
HATCH = Layer("HATCH", 8, 18)
DIMENSIONS = Layer("DIMENSIONS", 3, 25)
NOTES = Layer("NOTES", 7, 25)
LAYERS = (MIRROR, OUTLINE, CENTRE, HATCH, DIMENSIONS, NOTES)

TEXT_MM = 3.5
STYLE = "OMNIMIRROR"
BY_LAYER = 256


def write_dxf(
    path: Path,
    part: Part,
    workshop: Workshop | None = None,
    file: DataFile | None = None,
    *,
    sheet: str = "A3",
    sheet_number: tuple[int, int] = (2, 2),
) -> ProfileCurve:
    """Write the half-section with an exact arc, conic or line, or with the spline of the STEP file.

    The layout is the part sheet of the drawing; ``file`` is the referenced sag table.
    """
    import ezdxf.filemanagement
    from ezdxf.units import MM

    mirror, body, workshop = part.mirror, part.body, workshop or Workshop()
    specification = workshop.secondary if part.is_secondary else workshop.mirror
    curve = profile_curve(mirror, body.start_mm())
    doc = ezdxf.filemanagement.new("R2010", setup=["linetypes", "styles"], units=MM)
    for layer in LAYERS:
        doc.layers.add(
            layer.name, color=layer.colour, linetype=layer.linetype, lineweight=layer.width
        )
    size = _text_size(mirror)
    doc.header["$LTSCALE"] = size / TEXT_MM / 2
    doc.header["$LWDISPLAY"] = 1
    _dimension_style(doc, size)
    page = doc.modelspace()
    section = body.outline(mirror)
    _draw_outline(page, curve, section)
    _draw_hatch(page, mirror, body, section, size)
    _draw_axis(page, mirror, body, size)
    _draw_dimensions(page, mirror, body, size, specification)
    _draw_notes(page, mirror, body, curve, part.name, size)
    paper = Sheet(sheet)
    draw_part_sheet(paper, part, workshop, file, sheet_number)
    add_layout(doc, paper)
    doc.saveas(path)
    return curve


def _text_size(mirror: Mirror) -> float:
    """Return the text height in mm: 3.5 for mirrors of a few centimetres, in steps of 1, 2 and 5."""
    steps = np.array([a * 10.0**n for n in range(-4, 4) for a in (1, 2, 5)])
    return TEXT_MM * float(steps[np.argmin(np.abs(np.log(steps * 45.0 / mirror.rim_radius_mm)))])


def _dimension_style(doc: Any, size: float) -> None:
    """Define dimensions by ISO 129: closed arrows, text above the line, up to three decimals."""
    style = doc.dimstyles.add(STYLE)
    style.dxf.dimtxt = size
    style.dxf.dimasz = size
    style.dxf.dimexo = size / 3  # gap between part and extension lines
    style.dxf.dimexe = size / 2
    style.dxf.dimgap = size / 3
    style.dxf.dimtad = 1  # text above the line
    style.dxf.dimtih = 0  # parallel to the line
    style.dxf.dimtoh = 0
    style.dxf.dimdec = 3
    style.dxf.dimzin = 8
    style.dxf.dimdsep = ord(".")
    style.dxf.dimlunit = 2
    style.dxf.dimtxsty = "OpenSans"
    style.dxf.dimclrd = style.dxf.dimclre = style.dxf.dimclrt = BY_LAYER


# -- part ------------------------------------------------------------------------------------------


def _draw_outline(page: Any, curve: ProfileCurve, section: Array) -> None:
    for side in (1.0, -1.0):
        _draw_curve(page, curve, side)
        corners = [(float(z), side * float(x)) for x, z in section]
        if side < 0:  # exterior view: only the contour beyond the rim, and the back
            back = max(z for z, _ in corners)
            outside = [c for c in corners if c[1] <= -curve.ends[1][0] * (1 - 1e-12)]
            corners = [*outside, (back, 0.0)]
            start, rim = curve.ends
            for x, z in [rim, start] if start[0] else [rim]:
                page.add_line((z, -x), (z, 0.0), dxfattribs=_on(OUTLINE))
        elif not curve.ends[0][0]:
            corners = corners[:-1]  # the axis is not an edge
        page.add_lwpolyline(corners, dxfattribs=_on(OUTLINE))


def _draw_curve(page: Any, curve: ProfileCurve, side: float) -> None:
    """Draw the meridian as exactly as DXF permits; ``side`` -1 mirrors it at the axis."""
    (x0, z0), (x1, z1) = curve.ends
    if curve.kind == "line":
        page.add_line((z0, side * x0), (z1, side * x1), dxfattribs=_on(MIRROR))
    elif curve.kind == "arc":
        # angles of the arc about (R, 0), counterclockwise from +X; the vertex is at 180 deg
        R = curve.radius_mm
        angles = sorted(180.0 - side * np.degrees(np.arctan2(x, R - z)) for x, z in curve.ends)
        page.add_arc((R, 0.0), R, *map(float, angles), dxfattribs=_on(MIRROR))
    else:
        poles = [(z, side * x) for x, z in curve.poles]
        spline = page.add_open_spline(
            poles, degree=curve.degree, knots=curve.knots, dxfattribs=_on(MIRROR)
        )
        if curve.weights:
            spline.weights = list(curve.weights)


def _draw_hatch(page: Any, mirror: Mirror, body: Body, section: Array, size: float) -> None:
    x = chords(mirror, 1.0, body.start_mm())
    boundary = np.concatenate([np.stack([x, mirror.sag(x)], axis=-1), section[1:]])
    hatch = page.add_hatch(color=BY_LAYER, dxfattribs=_on(HATCH))
    hatch.set_pattern_fill("ANSI31", scale=size / TEXT_MM)
    hatch.paths.add_polyline_path([(float(pz), float(px)) for px, pz in boundary], is_closed=True)


def _draw_axis(page: Any, mirror: Mirror, body: Body, size: float) -> None:
    page.add_line((-3 * size, 0.0), (body.back_mm(mirror) + 3 * size, 0.0), dxfattribs=_on(CENTRE))


# -- dimensions and notes --------------------------------------------------------------------------


def _draw_dimensions(
    page: Any, mirror: Mirror, body: Body, size: float, specification: PartSpecification
) -> None:
    rim, back = mirror.rim_radius_mm, body.back_mm(mirror)
    edge, outer = float(mirror.sag(rim)), body.outer_radius_mm(mirror)
    row = 2.6 * size

    def along(z0: float, z1: float, x0: float, x1: float, at: float, **override: Any) -> None:
        """Draw an axial dimension from (z0, x0) to (z1, x1), its line at the distance ``at`` from
        the axis.
        """
        _linear(page, (z0, at), (z0, x0), (z1, x1), 0.0, override)

    def diameter(x: float, z: float, at: float, **override: Any) -> None:
        _linear(page, (at, 0.0), (z, -x), (z, x), 90.0, {"dimpost": "Ø<>"} | override)

    along(
        edge,
        back,
        -rim,
        -outer,
        -outer - 1.5 * row,
        **_allowed(specification.thickness_tolerance_mm),
    )
    if edge:  # constant thickness of a plane mirror
        along(0.0, edge, 0.0, -rim, -outer - 1.5 * row)
        along(0.0, back, 0.0, -outer, -outer - 2.5 * row)
    at = back
    if body.bore_mm:
        at += 2 * row
        diameter(body.bore_mm / 2, back, at)
        if not body.bore_goes_through:
            along(back - body.bore_depth_mm, back, body.bore_mm / 2, body.bore_mm / 2, outer + row)
    if wide := body.counterbore_diameter_mm:
        at += row
        diameter(wide / 2, back, at)
        along(back - body.counterbore_depth_mm, back, wide / 2, wide / 2, outer + row)
    if body.flange_width_mm:
        at += row if body.bore_mm else 2 * row
        diameter(outer, back, at)
        along(back - body.flange_thickness_mm, back, outer, outer, outer + 2 * row)
    diameter(rim, edge, -2 * row, **_allowed(specification.diameter_tolerance_mm))


def _allowed(tolerance: float | None) -> dict[str, Any]:
    """Return dimension overrides for a symmetric tolerance."""
    if tolerance is None:
        return {}
    decimals = max(0, min(8, 1 - int(np.floor(np.log10(tolerance)))))
    return {"dimtol": 1, "dimtp": tolerance, "dimtm": tolerance, "dimtdec": decimals, "dimtzin": 8}


def _linear(page: Any, base: Any, p1: Any, p2: Any, angle: float, override: dict[str, Any]) -> None:
    page.add_linear_dim(
        base=base,
        p1=p1,
        p2=p2,
        angle=angle,
        dimstyle=STYLE,
        override=override,
        dxfattribs=_on(DIMENSIONS),
    ).render()


def _draw_notes(
    page: Any, mirror: Mirror, body: Body, curve: ProfileCurve, name: str, size: float
) -> None:
    deviation = (
        f"within {curve.deviation_um:.2g} um of the mirror" if curve.deviation_um else "exact"
    )
    lines = [
        name,
        *surface_words(mirror),
        f"Mirror surface: {curve.words}, {deviation}",
        f"Body: {body.words()}",
    ]
    top = -body.outer_radius_mm(mirror) - 10 * size
    note_text = "\n".join(map(dxf_mtext, lines))
    text = page.add_mtext(
        note_text, dxfattribs={"char_height": size, "style": "OpenSans", **_on(NOTES)}
    )
    text.set_location((0.0, top))


def surface_words(mirror: Mirror) -> list[str]:
    """Describe a surface line by line: type, vertex radius and conic constant.

    >>> from omnimirror.optics.mirrors import Cone
    >>> surface_words(Cone(45.0, 20.0))
    ['Surface: cone, 45 deg from the plane across the axis']
    """
    if mirror.is_pointed:
        beta = float(np.degrees(np.arctan(mirror.slope(0.0))))
        return [f"Surface: {mirror.KIND}, {beta:.6g} deg from the plane across the axis"]
    conic, R = conic_parameters(mirror), float(mirror.radius_t(0.0))
    if np.isinf(R):
        return [f"Surface: {mirror.KIND}"]
    k = f", conic constant k = {conic[1]:.9g}" if conic else ""
    return [f"Surface: {mirror.KIND}, vertex radius R = {R:.9g} mm{k}"]


def _on(layer: Layer) -> dict[str, str]:
    return {"layer": layer.name}


PAPER_LAYER, PAPER_STYLE = "SHEET", "OpenSans"
ALIGNMENTS = {"left": "", "center": "CENTER", "right": "RIGHT"}
UPRIGHT = {"baseline": "left", "bottom": "left", "center": "center", "top": "right"}
WIDTHS = (18, 25, 35, 50, 70, 100)
"""Line widths of the DXF format, 1/100 mm."""


def add_layout(doc: Any, sheet: Sheet) -> None:
    """Add a sheet to an ezdxf document as a layout of paper size."""
    doc.layers.add(PAPER_LAYER)
    layout = doc.layouts.new(sheet.size)
    layout.page_setup(size=(sheet.width, sheet.height), margins=(0, 0, 0, 0), units="mm")
    for line in sheet.ax.lines:
        _add_line(doc, layout, line)
    for patch in sheet.ax.patches:
        corners = np.asarray(patch.get_path().vertices)[:-1]
        layout.add_solid([*map(tuple, corners)], dxfattribs=_line_attributes(patch.get_facecolor()))
    for text in sheet.ax.texts:
        _add_text(layout, text)
    doc.layouts.delete("Layout1")  # default layout


def _add_line(doc: Any, layout: Any, line: Line2D) -> None:
    points = np.stack([line.get_xdata(), line.get_ydata()], axis=-1)
    wide = line.get_linewidth() / POINT
    appearance = _line_attributes(line.get_color()) | {
        "lineweight": min(WIDTHS, key=lambda w: abs(w - 100 * wide))
    }
    _, dashes = line._unscaled_dash_pattern  # type: ignore[attr-defined]  # pattern passed to set_dashes
    if dashes:
        appearance["linetype"] = _linetype(doc, [d * wide for d in dashes])
        appearance["ltscale"] = 1.0 / doc.header["$LTSCALE"]
    layout.add_lwpolyline([*map(tuple, points)], dxfattribs=appearance)


def _linetype(doc: Any, dashes: list[float]) -> str:
    """Return the name of a line type for a pattern of dashes and gaps, mm."""
    name = "SHEET_" + "_".join(f"{100 * d:.0f}" for d in dashes)
    if name not in doc.linetypes:
        signed = [d if i % 2 == 0 else -d for i, d in enumerate(dashes)]
        doc.linetypes.add(name, [sum(dashes), *signed])
    return name


def _add_text(layout: Any, text: Text) -> None:
    from ezdxf.enums import TextEntityAlignment

    across: str = text.get_horizontalalignment()
    along: str = text.get_verticalalignment()
    if text.get_rotation():  # Matplotlib aligns rotated text, DXF aligns before rotation
        across, along = (
            UPRIGHT[along],
            {"right": "bottom", "center": "center", "left": "top"}[across],
        )
    level = {"baseline": "", "center": "MIDDLE", "bottom": "BOTTOM", "top": "TOP"}[along]
    side = ALIGNMENTS[across]
    name = f"{level}_{side or 'LEFT'}" if level else side or "LEFT"
    text_entity = layout.add_text(
        dxf_text(text.get_text()),
        height=float(text.get_fontsize()) / POINT * CAPITAL,
        rotation=text.get_rotation(),
        dxfattribs={"style": PAPER_STYLE, **_line_attributes(text.get_color())},
    )
    text_entity.set_placement(text.get_position(), align=TextEntityAlignment[name])


def _line_attributes(colour: Any) -> dict[str, Any]:
    red, green, blue = (round(255 * c) for c in to_rgb(colour))
    return {"layer": PAPER_LAYER, "true_color": red << 16 | green << 8 | blue}
