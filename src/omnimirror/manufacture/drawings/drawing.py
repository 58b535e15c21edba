"""The drawing sheet: sensor and mirror to scale with dimensions, tables and a title block, on A3 or A4."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure

from ... import __version__
from ...errors import InvalidParameter
from ...figures.style import render, styled
from ...housing import Housing, Tube
from ...lenses import GaussianLens, Orthographic
from ...mirrors import Mirror
from ...sensor import Sensor
from ...tracing.walls import tube_shift_mm, tube_transmission
from ..body import Body
from ..parts import Part, housed, omega_of, parts_of
from ..reference_sphere import best_sphere
from ..sensitivity import sensitivities
from .sheet import FINE, FRAME, SCALES, THIN, Sheet, scale_words
from .views import MIRROR_REGION, SECONDARY_REGION, Assembly, draw_mirror, draw_sensor, length_words

LEAST_SCALE, LARGEST_SCALE = SCALES[-1], SCALES[0]
TABLE_TOP = 129.0
NOTES = (
    "z counts from the vertex, away from the lens.",
    "Ω counts from the axis, back past the lens.",
    "Each error alone; where it moves the picture most.",
    "Surface form: one bump between axis and rim, P-V.",
)


NOTES_OF_TWO = (
    "z counts from the vertex, away from what the mirror looks at.",
    "Ω counts from the axis, down past the secondary.",
    "Each error alone; where it moves the picture most.",
    "Both mirrors are centred and square to the axis.",
)


@dataclass(frozen=True)
class Drawing:
    """A finished sheet.

    Attributes
    ----------
    figure
    sensor_scale, mirror_scale : of the two views, paper over nature
    """

    figure: Figure
    sensor_scale: float
    mirror_scale: float

    def render(self, kind: str = "pdf") -> bytes:
        """The bytes of a .pdf, .svg or .png file; PDF and SVG are as large as the paper."""
        return render(self.figure, kind)


def draw_sheet(
    sensor: Sensor,
    body: Body | None = None,
    housing: Housing | None = None,
    sheet: str = "A3",
    scale: float | None = None,
    secondary_body: Body | None = None,
) -> Drawing:
    """Draw the sensor on a sheet of paper.

    Parameters
    ----------
    sensor
    body : optional
        The solid of the mirror, by default as the rim of the sensor's housing says, or ``Body()``.
    housing : optional
        What stands around it, by default the sensor's own, and where that says nothing a transparent tube to fit. Its
        rims are those of the bodies.
    sheet : "A3" or "A4"
        In landscape.
    scale : optional
        Of the sensor's view, paper over nature; by default the largest standard one that fits.
    secondary_body : optional
        The same of a second mirror.

    Raises
    ------
    InvalidParameter
        A sheet that is not known, a scale outside 1:50000 to 500:1, or parts that do not fit each other.

    Examples
    --------
    >>> import omnimirror as om
    >>> drawing = draw_sheet(om.load_sensor("paper-spherical"))
    >>> drawing.sensor_scale, drawing.mirror_scale
    (1.0, 1.0)
    """
    if scale is not None and not LEAST_SCALE <= scale <= LARGEST_SCALE:
        raise InvalidParameter(f"scale = {scale:g} is outside {LEAST_SCALE:g} to {LARGEST_SCALE:g}")
    parts = parts_of(sensor, body, secondary_body)
    sensor = housed(parts, housing)
    with styled():
        paper = Sheet(sheet)
        sensor_scale = draw_sensor(paper, Assembly.of(sensor, *(part.body for part in parts)), scale)
        mirror_scale = _draw_mirrors(paper, parts)
        _draw_frame(paper)
        _draw_tables(paper, sensor)
        _draw_title(paper, sensor, sensor_scale, mirror_scale)
    return Drawing(paper.figure, sensor_scale, mirror_scale)


def _draw_mirrors(sheet: Sheet, parts: list[Part]) -> float:
    """Each mirror in half-section; the scale of the first."""
    for part in parts[1:]:
        draw_mirror(sheet, part.mirror, part.body, SECONDARY_REGION.on(sheet), "SECONDARY")
    return draw_mirror(sheet, parts[0].mirror, parts[0].body, MIRROR_REGION.on(sheet))


def write_drawing(path: Path, drawing: Drawing) -> None:
    """Write the sheet as the path's suffix says: .pdf, .svg or .png."""
    path.write_bytes(drawing.render(path.suffix.lstrip(".").lower()))


# -- tables --------------------------------------------------------------------------------------------


def _draw_tables(sheet: Sheet, sensor: Sensor) -> None:
    k = sheet.k
    y = sheet.table(152 * k, TABLE_TOP * k, (38, 36), mirror_rows(sensor.mirror), "MIRROR")
    if sensor.secondary is not None:
        y = sheet.table(152 * k, y - 4 * k, (38, 36), mirror_rows(sensor.secondary.mirror), "SECONDARY")
    rows = int((y - 20 * k) / (4.4 * k)) - 2
    if rows > 4:
        sheet.table(152 * k, y - 4 * k, (20, 20, 16, 18), sag_rows(sensor, min(rows, 14)), "SURFACE")
    y = sheet.table(232 * k, TABLE_TOP * k, (40, 44), sensor_rows(sensor), "SENSOR")
    sheet.table(232 * k, y - 4 * k, (38, 28, 18), hidden_rows(sensor), "HIDDEN FROM THE PICTURE")
    y = sheet.table(
        324 * k, TABLE_TOP * k, (38, 28, 18), tolerance_rows(sensor), "ERROR THAT MOVES THE PICTURE BY 0.5 px"
    )
    for i, note in enumerate(NOTES if sensor.secondary is None else NOTES_OF_TWO):
        sheet.text(324 * k, y - (6 + 3.8 * i) * k, note, height=1.8)


def mirror_rows(mirror: Mirror) -> list[tuple[str, str]]:
    """The mirror's own parameters, and the sphere nearest to it."""
    rows = [("kind", mirror.KIND)]
    for f in fields(cast(Any, mirror)):
        value, p = getattr(mirror, f.name), mirror.PARAMETERS[f.name]
        name = f.name.removesuffix("_mm").removesuffix("_deg").replace("_", " ")
        if isinstance(value, tuple):
            many = len(value) > 6
            rows += [(name, f"{len(value)} values")] if many else [
                (f"{name} {i}", f"{v:.9g}") for i, v in enumerate(value, start=1)
            ]  # fmt: skip
        elif isinstance(value, str):
            rows.append((name, value))
        elif value is not None and not (f.name == "normalization_radius_mm" and value == 1.0):
            rows.append((name, f"{value:.9g} {p.unit}".strip()))
    radius = float(mirror.radius_t(0.0))
    words = f"{radius:.9g} mm"
    if not mirror.is_pointed and np.isfinite(radius) and words not in (value for _, value in rows):
        rows.append(("vertex radius", words))
    sphere = best_sphere(mirror)
    if sphere.peak_to_valley_um < 1e-3:
        return rows
    return [
        *rows,
        ("best-fit sphere, radius", f"{sphere.radius_mm:.4f} mm"),
        ("departure from it, P-V", _departure_words(sphere.peak_to_valley_um)),
        ("RMS", _departure_words(sphere.rms_um)),
    ]


def _departure_words(um: float) -> str:
    return f"{um:.4g} µm" if um < 1000 else f"{um / 1000:.4g} mm"


def sag_rows(sensor: Sensor, count: int) -> list[tuple[str, ...]]:
    """A few points of the surface, the rim among them, to check a part by."""
    rim = sensor.mirror.rim_radius_mm
    steps = (a * 10.0**n for n in range(-6, 6) for a in (1, 2, 5))
    step = next(s for s in steps if rim / s <= max(count - 1, 1))
    x = np.append(step * np.arange(int(np.ceil(rim / step - 0.2))), rim)  # none close to the rim
    z, slope, _ = sensor.mirror.profile(x)
    rows = zip(x, z, np.degrees(np.arctan(slope)), np.degrees(omega_of(sensor, x)), strict=True)
    head = ("x mm", "z mm", "slope °", "Ω °")
    return [
        head,
        *((length_words(a), f"{b:.4f}", f"{c:.3f}", f"{d:.2f}" if np.isfinite(d) else "hidden") for a, b, c, d in rows),
    ]


def sensor_rows(sensor: Sensor) -> list[tuple[str, str]]:
    low, high = sensor.field_deg
    if sensor.lens.TELECENTRIC:
        wide = cast(Orthographic, sensor.lens)
        lens = [("lens", f"telecentric, {wide.magnification:g} ×"), ("working F-number", f"{wide.working_f_number:g}")]
        lens.append(("in focus, from the vertex", f"{wide.focus_distance_mm:g} mm"))
    else:
        near = cast(GaussianLens, sensor.lens)
        lens = [("lens", f"f = {near.focal_length_mm:g} mm, F/{near.f_number:g}")]
        lens.append(("focused at", f"{near.focus_distance_mm:g} mm from it"))
    imager = sensor.imager
    return [
        *lens,
        ("imager", f"{imager.width_px} × {imager.height_px} of {imager.pixel_pitch_um:g} µm"),
        ("field Ω from the axis", f"{low:.4g}° to {high:.6g}°"),
        ("image of the rim, radius", f"{sensor.rim_radius_px:.1f} px"),
    ]


def hidden_rows(sensor: Sensor) -> list[tuple[str, str, str]]:
    """What is hidden, and what a tube does to the rest."""
    rows = [
        (ring.part, f"Ω {ring.omega_deg[0]:.1f}° to {ring.omega_deg[1]:.1f}°", f"{ring.picture_percent:.2f} %")
        for ring in sensor.obscurations
    ]
    rows.append(("in all, at every azimuth", "", f"{sum(ring.picture_percent for ring in sensor.obscured):.2f} %"))
    if isinstance(tube := sensor.housing.shell, Tube):
        for omega in sorted({min(90.0, sensor.field_deg[1]), sensor.field_deg[1]}):
            passed = 100 * float(tube_transmission(omega, tube.refractive_index))
            shift = float(tube_shift_mm(omega, tube.wall_mm, tube.refractive_index))
            rows.append((f"tube at Ω = {omega:.4g}°", f"shift {shift:.2f} mm", f"{passed:.1f} %"))
    return rows


def tolerance_rows(sensor: Sensor) -> list[tuple[str, str, str]]:
    """The errors that move the picture by half a pixel where it moves most."""
    rows = [("", "", "at Ω")]
    for s in sensitivities(sensor):
        unit = {"um": "µm", "deg": "°"}.get(s.unit, s.unit)
        if s.px_per_unit:
            rows.append((s.name, f"± {s.tolerance(0.5):.3g} {unit}", f"{s.omega_deg:.0f}°"))
        else:
            rows.append((s.name, "no effect", ""))
    return rows


# -- frame and title block -------------------------------------------------------------------------------


def _draw_frame(sheet: Sheet) -> None:
    k = sheet.k
    left, bottom, right, top = 20 * k, 10 * k, sheet.width - 10 * k, sheet.height - 10 * k
    sheet.line(
        [(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)], FRAME, solid_joinstyle="miter"
    )
    for x in (left, right):  # centring marks
        sheet.line([(x - 5 * k, sheet.height / 2), (x + 5 * k, sheet.height / 2)], FRAME)
    for y in (bottom, top):
        sheet.line([(sheet.width / 2, y - 5 * k), (sheet.width / 2, y + 5 * k)], FRAME)


def _draw_title(sheet: Sheet, sensor: Sensor, sensor_scale: float, mirror_scale: float) -> None:
    k = sheet.k
    left, right, bottom = 232 * k, sheet.width - 10 * k, 10 * k
    rows = [bottom, bottom + 12 * k, bottom + 24 * k, bottom + 42 * k]
    for y in rows[1:]:
        sheet.line([(left, y), (right, y)], FRAME if y == rows[-1] else THIN)
    sheet.line([(left, bottom), (left, rows[-1])], FRAME)
    columns = [left + (right - left) * f for f in (0.0, 0.25, 0.5, 0.75)]
    for x in columns[1:]:
        sheet.line([(x, bottom), (x, rows[2])], THIN)
    room = right - left - 6 * k
    name = " ".join(sensor.name.split())
    height = min(5.0, 5.0 * room / max(sheet.text_width(name, 5.0, weight="bold"), 1e-9))
    sheet.text(left + 3 * k, rows[2] + 9 * k, name, height=height, fontweight="bold")
    notes = sensor.notes.strip().splitlines()
    words = f"{sensor.mirror.KIND} mirror, {sensor.lens.KIND} lens" if not notes else notes[0]
    sheet.text(left + 3 * k, rows[2] + 3 * k, _shortened(sheet, words, room))
    cells = [
        ("SENSOR", scale_words(sensor_scale)),
        ("MIRROR", scale_words(mirror_scale)),
        ("SHEET", sheet.size),
        ("LENGTHS", "mm"),
        ("MIRROR SURFACE", sensor.mirror.KIND),
        ("RIM", f"Ø{length_words(2 * sensor.mirror.rim_radius_mm)}"),
        ("PROJECTION", ""),
        ("DRAWN BY", f"omnimirror {__version__}"),
    ]
    for i, (name, value) in enumerate(cells):
        x, y = columns[i % 4], rows[1 - i // 4]
        sheet.text(x + 2 * k, y + 8.6 * k, name, height=1.6, color="#555555")
        sheet.text(x + 2 * k, y + 2.6 * k, value, height=3.0)
    _draw_projection(sheet, columns[2] + 24 * k, rows[0] + 4.6 * k)


def _shortened(sheet: Sheet, words: str, room: float) -> str:
    """As many of the words as fit the room, mm."""
    if sheet.text_width(words) <= room:
        return words
    parts = words.split(" ")
    cuts = [" ".join(parts[:n]).rstrip(" .,:;") + " ..." for n in range(1, len(parts))]
    fitting = bisect_right(cuts, room, key=sheet.text_width)
    return cuts[fitting - 1] if fitting else ""


def _draw_projection(sheet: Sheet, x: float, y: float) -> None:
    """The sign of first-angle projection: a cone from the side, and what is seen from its left behind it."""
    k = sheet.k
    sheet.line([(x - 9 * k, y - 1.5 * k), (x - 9 * k, y + 1.5 * k), (x - 2 * k, y + 3 * k), (x - 2 * k, y - 3 * k),
                (x - 9 * k, y - 1.5 * k)], THIN)  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 73)
    for radius in (1.5, 3.0):
        sheet.line(np.stack([x + 5 * k + radius * k * np.cos(angle), y + radius * k * np.sin(angle)], axis=-1), THIN)
    for points in (
        [(x - 10.5 * k, y), (x - 0.5 * k, y)],
        [(x + k, y), (x + 9 * k, y)],
        [(x + 5 * k, y - 4 * k), (x + 5 * k, y + 4 * k)],
    ):
        sheet.line(points, FINE, (8, 2, 1, 2))
