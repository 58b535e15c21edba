"""The drawing: a sheet of the sensor, with rays and housing, and one of each mirror, from which a shop quotes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from ...errors import InvalidParameter
from ...figures.style import render, styled
from ...housing import Housing
from ...sensor import Sensor
from ..body import Body, Part, housed, parts_of
from ..workshop import Making, TitleBlock, Workshop
from .mirror_view import draw_mirror
from .sensor_view import Assembly, draw_sensor
from .sheet import SCALES, TABLE_ROW, Region, Sheet, SheetFacts, draw_frame, draw_title, scale_words
from .tables import (
    DataFile,
    Rows,
    allocated_rows,
    form_rms_um,
    hidden_rows,
    indication_rows,
    mass_words,
    mirror_rows,
    sag_rows,
    sensor_rows,
    tolerance_rows,
)

LEAST_SCALE, LARGEST_SCALE = SCALES[-1], SCALES[0]
GAP = 5.0
"""Between tables, mm."""
NOTES = (
    "z from the vertex, away from the lens",
    "Ω from the axis, back past the lens",
    "each error alone, where it does most",
    "form: a bump from axis to rim, P-V",
)
NOTES_OF_TWO = (
    "z from the vertex, away from the lens",
    "Ω from the axis, past the secondary",
    "each error alone, where it does most",
)


@dataclass(frozen=True)
class SheetLayout:
    """Where a size of paper has its view and its tables, mm."""

    view: Region
    columns: tuple[Region, ...]


SENSOR_LAYOUTS = {
    "A3": SheetLayout(
        Region(24.0, 129.0, 408.0, 284.0),
        (Region(24, 13, 117, 126), Region(124, 13, 223, 126), Region(231, 53, 318, 126), Region(324, 53, 408, 126)),
    ),
    "A4": SheetLayout(Region(23.0, 175.0, 198.0, 284.0), (Region(23, 53, 107, 172), Region(113, 53, 198, 172))),
}
MIRROR_LAYOUTS = {
    "A3": SheetLayout(Region(24.0, 60.0, 218.0, 284.0), (Region(226, 53, 314, 282), Region(320, 53, 408, 282))),
    "A4": SheetLayout(Region(23.0, 168.0, 198.0, 284.0), (Region(23, 53, 107, 166), Region(113, 53, 198, 166))),
}


@dataclass(frozen=True)
class Drawing:
    """Finished sheets: that of the sensor, then one of each mirror.

    Attributes
    ----------
    figures
    names
        "sensor", "mirror" and "secondary", of the sheets that there are.
    scales
        Of the sheets' views, paper over nature.
    """

    figures: tuple[Figure, ...]
    names: tuple[str, ...]
    scales: tuple[float, ...]

    def render(self, kind: str = "pdf", sheet: int = 0) -> bytes:
        """The bytes of a .pdf file of all sheets, or of an .svg or .png of one; as large as the paper.

        Parameters
        ----------
        kind
            "pdf", "svg" or "png".
        sheet
            Which sheet, of pictures.

        Returns
        -------
        bytes
            The same for the same drawing.
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
    """Draw the sensor and its mirrors, each on a sheet of paper.

    Parameters
    ----------
    sensor
    body : optional
        The solid of the mirror, by default as the rim of the sensor's housing says, or ``Body()``.
    housing : optional
        Housing that is drawn, by default the sensor's own. Its rims are those of the bodies.
    sheet : "A3" or "A4"
        A3 lies, A4 stands upright.
    scale : optional
        Of the sensor's view, paper over nature; by default the largest standard one that fits.
    secondary_body : optional
        The same of a second mirror.
    workshop : optional
        What a shop is told beside shapes: title block, material, texture, tolerances.
    data_files : optional
        Sag table of each mirror, named on its sheet; by default the sheets name none.

    Raises
    ------
    InvalidParameter
        A sheet that is not known, a scale outside 1:50000 to 500:1, or parts that do not fit each other.

    Examples
    --------
    >>> import omnimirror as om
    >>> drawing = draw_sheets(om.load_sensor("paper-spherical"))
    >>> drawing.names, drawing.scales
    (('sensor', 'mirror'), (1.0, 1.0))
    """
    if scale is not None and not LEAST_SCALE <= scale <= LARGEST_SCALE:
        raise InvalidParameter(f"scale = {scale:g} is outside {LEAST_SCALE:g} to {LARGEST_SCALE:g}")
    parts = parts_of(sensor, body, secondary_body)
    sensor, workshop = housed(parts, housing), workshop or Workshop()
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
    """Write it as the path's suffix says: all sheets to a .pdf, one to an .svg or .png."""
    path.write_bytes(drawing.render(path.suffix.lstrip(".").lower(), sheet))


# -- the sheets ----------------------------------------------------------------------------------------


def _draw_sensor_sheet(
    paper: Sheet, sensor: Sensor, parts: list[Part], workshop: Workshop, scale: float | None
) -> float:
    layout, told = SENSOR_LAYOUTS[paper.size], workshop.tolerances
    scale = draw_sensor(paper, Assembly.of(sensor, *(part.body for part in parts)), layout.view, scale, told)
    paper.interrupt_lines()
    draw_frame(paper)
    flow = Flow(paper, layout.columns)
    flow.table(sensor_rows(sensor), "SENSOR")
    flow.table(hidden_rows(sensor), "HIDDEN FROM THE PICTURE")
    flow.next_column()
    if allocated := allocated_rows(told):
        flow.table(allocated, "TOLERANCES AS ALLOCATED")
    else:
        flow.table(tolerance_rows(sensor), "MOVES THE PICTURE BY 0.5 px")
        flow.lines(NOTES if sensor.secondary is None else NOTES_OF_TWO)
    draw_title(
        paper, workshop.title, SheetFacts(sensor.name, "assembly drawing", scale_words(scale), (1, 1 + len(parts)))
    )
    return scale


def draw_part_sheet(
    paper: Sheet, part: Part, workshop: Workshop, file: DataFile | None, place: tuple[int, int]
) -> float:
    """Draw the sheet of one mirror and return the scale of its view."""
    layout = MIRROR_LAYOUTS[paper.size]
    making: Making = workshop.secondary if part.is_secondary else workshop.mirror
    told = {} if part.is_secondary else dict(workshop.tolerances)
    word = "SECONDARY" if part.is_secondary else "MIRROR"
    scale = draw_mirror(paper, part.mirror, part.body, layout.view, making, making.form_um, word)
    paper.interrupt_lines()
    draw_frame(paper)
    mass, indications = mass_words(part, making), indication_rows(part, making, told, workshop.title)
    flow = Flow(paper, layout.columns)
    flow.table(mirror_rows(part.mirror, told, has_data_file=file is not None), "MIRROR SURFACE")
    if file is not None:
        flow.table(file.rows(), "DATA FILE")
    flow.next_column()
    flow.table(indications, "INDICATIONS", "ISO 10110")
    if form_rms_um(told) is not None and making.form_um is None:
        flow.lines(("form error along z, after alignment",))
    room = flow.rows_left - 1
    if room > 4:
        flow.table(sag_rows(part, min(room - 1, 14)), "POINTS OF THE SURFACE")
    title: TitleBlock = workshop.title
    facts = SheetFacts(
        part.name if part.is_secondary else f"{part.name} mirror", "part drawing", scale_words(scale), place,
        making.material, mass,
    )  # fmt: skip
    draw_title(paper, title, facts)
    return scale


class Flow:
    """Tables below each other in columns, each in the next one with room for it."""

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
        kept = rows if len(rows) <= self.rows_left else [*rows[: self.rows_left - 1], (f"and {len(rows)} more", "")]
        self.y = self.paper.table(column.left, self.y, column.right - column.left, kept, title, note) - GAP

    def lines(self, words: Sequence[str]) -> None:
        for line in words:
            self.y -= 4.2
            self.paper.text(self.columns[self.at].left, self.y + GAP - 1.5, line)
        self.y -= GAP / 2
