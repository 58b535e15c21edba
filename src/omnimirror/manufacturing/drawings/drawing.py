"""Drawing of a sensor: an assembly sheet with rays and housing, and a part sheet for each mirror."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from ...analysis.figures.style import render, styled
from ...base.errors import InvalidParameter
from ...optics.housing import Housing
from ...optics.sensor import Sensor
from ..body import Body, Part, parts_of, with_housing
from ..workshop import PartSpecification, TitleBlock, Workshop
from .mirror_view import draw_mirror
from .sensor_view import Assembly, draw_sensor
from .sheet import SCALES, TABLE_ROW, Region, Sheet, SheetFacts, draw_frame, draw_title, scale_words
from .tables import (
    DataFile,
    Rows,
    allocated_rows,
    form_rms_um,
    indication_rows,
    mass_words,
    mirror_rows,
    obscuration_rows,
    sag_rows,
    sensor_rows,
    tolerance_rows,
)

MIN_SCALE, MAX_SCALE = SCALES[-1], SCALES[0]
GAP = 5.0
"""Gap between tables, mm."""
NOTES = (
    "z: from the vertex, away from the lens",
    "Ω: from the axis, on the lens side",
    "single errors, maximum over the field",
    "form: bump between axis and rim, P-V",
)
NOTES_OF_TWO = (
    "z: from the vertex, away from the lens",
    "Ω: from the axis, past the secondary",
    "single errors, maximum over the field",
)


@dataclass(frozen=True)
class SheetLayout:
    """Regions of the view and the tables on a sheet, mm."""

    view: Region
    columns: tuple[Region, ...]


SENSOR_LAYOUTS = {
    "A3": SheetLayout(
        Region(24.0, 129.0, 408.0, 284.0),
        (
            Region(24, 13, 117, 126),
            Region(124, 13, 223, 126),
            Region(231, 53, 318, 126),
            Region(324, 53, 408, 126),
        ),
    ),
    "A4": SheetLayout(
        Region(23.0, 175.0, 198.0, 284.0), (Region(23, 53, 107, 172), Region(113, 53, 198, 172))
    ),
}
MIRROR_LAYOUTS = {
    "A3": SheetLayout(
        Region(24.0, 60.0, 218.0, 284.0), (Region(226, 53, 314, 282), Region(320, 53, 408, 282))
    ),
    "A4": SheetLayout(
        Region(23.0, 168.0, 198.0, 284.0), (Region(23, 53, 107, 166), Region(113, 53, 198, 166))
    ),
}


@dataclass(frozen=True)
class Drawing:
    """Finished drawing: the assembly sheet, then one sheet per mirror.

    Attributes
    ----------
    figures
        Matplotlib figures of the sheets.
    names
        Names of the sheets: "sensor", "mirror" and, if present, "secondary".
    scales
        Scales of the views, paper over actual size.
    """

    figures: tuple[Figure, ...]
    names: tuple[str, ...]
    scales: tuple[float, ...]

    def render(self, kind: str = "pdf", sheet: int = 0) -> bytes:
        """Render all sheets as PDF, or one sheet as SVG or PNG, at paper size.

        Parameters
        ----------
        kind
            "pdf", "svg" or "png".
        sheet
            Index of the sheet for SVG and PNG.

        Returns
        -------
        bytes
            File content, identical for identical drawings.
        """
        if kind != "pdf":
            return render(self.figures[sheet], kind)
        data = BytesIO()
        with styled(), PdfPages(data, metadata={"CreationDate": None}) as pages:
            for figure in self.figures:
                pages.savefig(figure)
        return data.getvalue()


def draw_sheets(
    sensor: Sensor,
    body: Body | None = None,
    housing: Housing | None = None,
    sheet: str = "A3",
    scale: float | None = None,
    secondary_body: Body | None = None,
    *,
    workshop: Workshop | None = None,
    data_files: Sequence[DataFile] | None = None,
) -> Drawing:
    """Draw a sensor and its mirrors on separate sheets.

    Parameters
    ----------
    sensor
    body : optional
        Body of the mirror, by default from the rim of the housing, or ``Body()``.
    housing : optional
        Housing to draw, by default that of the sensor. Its rims are those of the bodies.
    sheet : "A3" or "A4"
        Paper size; A3 is landscape, A4 portrait.
    scale : optional
        Scale of the sensor view, by default the largest standard scale that fits.
    secondary_body : optional
        Body of the secondary mirror.
    workshop : optional
        Title block, material, texture and tolerances.
    data_files : optional
        Sag table of each mirror, to be referenced on its sheet; none by default.

    Raises
    ------
    InvalidParameter
        If the sheet is unknown, the scale is not between 1:50000 and 500:1, or parts do not fit.

    Examples
    --------
    >>> import omnimirror as om
    >>> drawing = draw_sheets(om.load_sensor("paper-spherical"))
    >>> drawing.names, drawing.scales
    (('sensor', 'mirror'), (1.0, 1.0))
    """
    if scale is not None and not MIN_SCALE <= scale <= MAX_SCALE:
        raise InvalidParameter(
            f"scale must be between {MIN_SCALE:g} and {MAX_SCALE:g}; got {scale:g}"
        )
    parts = parts_of(sensor, body, secondary_body)
    sensor, workshop = with_housing(parts, housing), workshop or Workshop()
    files: Sequence[DataFile | None] = data_files or [None] * len(parts)
    count = 1 + len(parts)
    with styled():
        papers = [Sheet(sheet) for _ in range(count)]
        scales = [_draw_sensor_sheet(papers[0], sensor, parts, workshop, scale)]
        for i, (part, file) in enumerate(zip(parts, files, strict=True), start=1):
            scales.append(draw_part_sheet(papers[i], part, workshop, file, (i + 1, count)))
    names = ("sensor", "mirror", "secondary")[:count]
    return Drawing(tuple(paper.figure for paper in papers), names, tuple(scales))


def write_drawing(path: Path, drawing: Drawing, sheet: int = 0) -> None:
    """Write all sheets to a .pdf file, or one sheet to .svg or .png."""
    path.write_bytes(drawing.render(path.suffix.lstrip(".").lower(), sheet))


# -- sheets --------------------------------------------------------------------------------------------


def _draw_sensor_sheet(
    paper: Sheet, sensor: Sensor, parts: list[Part], workshop: Workshop, scale: float | None
) -> float:
    layout, stated = SENSOR_LAYOUTS[paper.size], workshop.tolerances
    scale = draw_sensor(
        paper, Assembly.of(sensor, *(part.body for part in parts)), layout.view, scale, stated
    )
    paper.interrupt_lines()
    draw_frame(paper)
    flow = Flow(paper, layout.columns)
    flow.table(sensor_rows(sensor), "SENSOR")
    flow.table(obscuration_rows(sensor), "OBSCURATIONS")
    flow.next_column()
    if allocated := allocated_rows(stated):
        flow.table(allocated, "ALLOCATED TOLERANCES")
    else:
        flow.table(tolerance_rows(sensor), "IMAGE SHIFT OF 0.5 px")
        flow.lines(NOTES if sensor.secondary is None else NOTES_OF_TWO)
    draw_title(
        paper,
        workshop.title,
        SheetFacts(sensor.name, "assembly drawing", scale_words(scale), (1, 1 + len(parts))),
    )
    return scale


def draw_part_sheet(
    paper: Sheet,
    part: Part,
    workshop: Workshop,
    file: DataFile | None,
    sheet_number: tuple[int, int],
) -> float:
    """Draw the sheet of one mirror and return the scale of its view."""
    layout = MIRROR_LAYOUTS[paper.size]
    making: PartSpecification = workshop.secondary if part.is_secondary else workshop.mirror
    stated = {} if part.is_secondary else dict(workshop.tolerances)
    word = "SECONDARY" if part.is_secondary else "MIRROR"
    scale = draw_mirror(paper, part.mirror, part.body, layout.view, making, making.form_um, word)
    paper.interrupt_lines()
    draw_frame(paper)
    mass, indications = (
        mass_words(part, making),
        indication_rows(part, making, stated, workshop.title),
    )
    flow = Flow(paper, layout.columns)
    flow.table(mirror_rows(part.mirror, stated, has_data_file=file is not None), "MIRROR SURFACE")
    if file is not None:
        flow.table(file.rows(), "DATA FILE")
    flow.next_column()
    flow.table(indications, "INDICATIONS", "ISO 10110")
    if form_rms_um(stated) is not None and making.form_um is None:
        flow.lines(("form error along z, after alignment",))
    room = flow.rows_left - 1
    if room > 4:
        flow.table(sag_rows(part, min(room - 1, 14)), "POINTS OF THE SURFACE")
    title: TitleBlock = workshop.title
    facts = SheetFacts(
        part.name if part.is_secondary else f"{part.name} mirror",
        "part drawing",
        scale_words(scale),
        sheet_number,
        making.material,
        mass,
    )
    draw_title(paper, title, facts)
    return scale


class Flow:
    """Layout of tables in columns; a table moves to the next column with sufficient space."""

    def __init__(self, paper: Sheet, columns: Sequence[Region]) -> None:
        self.paper, self.columns, self.at = paper, list(columns), 0
        self.y = columns[0].top

    @property
    def rows_left(self) -> int:
        return int((self.y - self.columns[self.at].bottom) / TABLE_ROW) - 1

    def next_column(self) -> None:
        if self.at + 1 < len(self.columns):
            self.at += 1
            self.y = self.columns[self.at].top

    def table(self, rows: Rows, title: str, note: str = "") -> None:
        if len(rows) > self.rows_left:
            self.next_column()
        column = self.columns[self.at]
        retained = (
            rows
            if len(rows) <= self.rows_left
            else [*rows[: self.rows_left - 1], (f"and {len(rows)} more", "")]
        )
        self.y = (
            self.paper.table(column.left, self.y, column.right - column.left, retained, title, note)
            - GAP
        )

    def lines(self, texts: Sequence[str]) -> None:
        for line in texts:
            self.y -= 4.2
            self.paper.text(self.columns[self.at].left, self.y + GAP - 1.5, line)
        self.y -= GAP / 2
