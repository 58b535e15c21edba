"""Frame and title block (ISO 5457, ISO 7200) of a sheet."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from ... import __version__
from ..workshop import TitleBlock
from .sheet import FRAME, LETTERS, MARGINS, THIN, Sheet
from .symbols import first_angle

WIDTH, ROW = 180.0, 10.0
"""Of the title block and of its rows, mm."""
HEIGHT = 4 * ROW
BOTTOM = MARGINS[1]


@dataclass(frozen=True)
class SheetFacts:
    """What the title block says of one sheet.

    Attributes
    ----------
    title, kind
        Of the sheet, and what kind of drawing it is.
    scale
        Of its main view, in words.
    place
        Which sheet of how many.
    material, mass
        Of the part; empty on that of the sensor.
    """

    title: str
    kind: str
    scale: str
    place: tuple[int, int]
    material: str = ""
    mass: str = ""


def draw_frame(sheet: Sheet) -> None:
    """The frame, and the centring marks by which a sheet is copied."""
    wide, narrow = MARGINS
    left, bottom, right, top = wide, narrow, sheet.width - narrow, sheet.height - narrow
    corners = [(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)]
    sheet.line(corners, FRAME, solid_joinstyle="miter")
    across, along = sheet.height / 2, (left + right) / 2
    for edge, out in ((left, left - 5), (right, right + 5)):
        sheet.line([(out, across), (edge, across)], FRAME)
    for edge, out in ((bottom, bottom - 5), (top, top + 5)):
        sheet.line([(along, out), (along, edge)], FRAME)


def draw_title(sheet: Sheet, block: TitleBlock, facts: SheetFacts) -> None:
    """The title block, at the right lower corner of the frame."""
    left, right = sheet.width - MARGINS[1] - WIDTH, sheet.width - MARGINS[1]
    sheet.line([(left, BOTTOM), (left, BOTTOM + HEIGHT), (right, BOTTOM + HEIGHT)], FRAME)
    name = block.title or " ".join(facts.title.split())
    rows: list[list[tuple[str, str, float]]] = [
        [
            ("NUMBER", block.number or "-", 60), ("REVISION", block.revision, 24), ("DATE", block.date or "-", 30),
            ("SHEET", f"{facts.place[0]}/{facts.place[1]}", 18), ("SIZE", sheet.size, 16), ("SCALE", facts.scale, 32),
        ],
        [
            ("OWNER", block.owner or "-", 60), ("CREATED BY", block.created_by or f"omnimirror {__version__}", 60),
            ("APPROVED BY", block.approved_by or "-", 60),
        ],
        [("TITLE", name, 130), ("DOCUMENT", facts.kind, 50)],
        [
            ("MATERIAL", facts.material or "-", 60), ("GENERAL TOLERANCES", block.general_tolerances, 60),
            ("MASS", facts.mass or "-", 34), ("", "", 26),
        ],
    ]  # fmt: skip
    for i, cells in enumerate(rows):
        y, x = BOTTOM + ROW * i, left
        if i:
            sheet.line([(left, y), (right, y)], THIN)
        for label, value, width in cells:
            if x > left:
                sheet.line([(x, y), (x, y + ROW)], THIN)
            sheet.text(x + 1.5, y + ROW - LETTERS - 1.2, label, color="#555555")
            height = 3.5 if label == "TITLE" else LETTERS
            sheet.text(x + 1.5, y + 1.6, shortened(sheet, value, width - 3, height), height)
            x += width
    first_angle(sheet, right - 12.5, BOTTOM + 3.5 * ROW)


def shortened(sheet: Sheet, words: str, room: float, height: float = LETTERS) -> str:
    """As many letters of the words as fit the room, mm."""
    if sheet.text_width(words, height) <= room:
        return words
    cuts = [words[:n].rstrip() + " .." for n in range(1, len(words))]
    fitting = bisect_right(cuts, room, key=lambda cut: sheet.text_width(cut, height))
    return cuts[fitting - 1] if fitting else ""
