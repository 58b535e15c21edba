"""Drawing sheet: lines, hatching, dimensions, symbols, tables and title block in paper millimetres.

Line widths, dash patterns and arrows conform to ISO 128 and ISO 129, letters of at least 2.5 mm to
ISO 3098. A4 is portrait and A3 landscape: both have the same height, and the title block has the
width of the A4 frame.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from ... import __version__
from ...analysis.figures.style import INK
from ...base.errors import InvalidParameter
from ...base.escaping import label
from ...base.typing import Array
from ..workshop import TitleBlock

SHEETS = {"A3": (420.0, 297.0), "A4": (210.0, 297.0)}
"""Width and height, mm (ISO 5457)."""
MARGINS = (20.0, 10.0)
"""Left margin and other margins between paper edge and frame, mm."""
LETTERS = 2.5
"""Minimum letter height, mm (ISO 3098)."""
FRAME, THICK, THIN, FINE = 0.7, 0.5, 0.25, 0.18
"""Line widths, mm."""
CHAIN, DASHED, PHANTOM = (20, 4, 2, 4), (8, 4), (20, 4, 2, 4, 2, 4)
"""Dash patterns in line widths: centre lines, hidden edges, neighbouring parts."""
ARROW = 2.5
"""Arrow length, mm; the width is 1/3 of it."""
TABLE_ROW, GUTTER = 4.8, 3.0
"""Row height of tables and gap between columns, mm."""
CLEAR = 0.5
"""Clearance between letters and interrupted lines, mm."""
CAPITAL = 0.729
"""Ratio of capital height to font size of DejaVu Sans."""
REFERENCE_FONT_SIZE = 256.0
"""Font size for measuring text widths, points."""
POINT = 72 / 25.4
SCALES = [10.0**n * a for n in range(2, -5, -1) for a in (5, 2, 1)]
"""Standard scales (ISO 5455), from 500:1 downwards."""


def fitting_scale(width: float, height: float, room_width: float, room_height: float) -> float:
    """Return the largest standard scale at which an object fits the available space, all in mm.

    >>> fitting_scale(225.0, 100.0, 380.0, 130.0), fitting_scale(500.0, 100.0, 380.0, 130.0)
    (1.0, 0.5)
    """
    fit = min(room_width / width, room_height / height)
    return next((s for s in SCALES if s <= fit * (1 + 1e-9)), SCALES[-1])


def scale_words(scale: float) -> str:
    """Format a scale.

    >>> scale_words(1.0), scale_words(0.5), scale_words(5.0)
    ('1:1', '1:2', '5:1')
    """
    return f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"


@dataclass(frozen=True)
class View:
    """Position and scale of a part on the sheet, with its axis along the paper."""

    x: float
    y: float
    scale: float

    def at(self, z: ArrayLike, x: ArrayLike) -> Array:
        """Convert axial (z) and radial (x) coordinates in mm to points (..., 2) on the paper."""
        z, x = np.broadcast_arrays(np.asarray(z, dtype=float), np.asarray(x, dtype=float))
        return np.stack([self.x + self.scale * z, self.y + self.scale * x], axis=-1)


class Region(NamedTuple):
    """Rectangle on a sheet, mm."""

    left: float
    bottom: float
    right: float
    top: float


def hatching(outline: Array, spacing: float, rising: bool = True) -> list[Array]:
    """Return hatch lines at 45 deg inside a closed outline (n, 2), each as end points (2, 2).

    Lines are aligned to the corner of the sheet, so that adjacent areas of a part match.

    >>> square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    >>> [line.round(6).tolist() for line in hatching(square, 2.0 * np.sqrt(2))]
    [[[0.0, 0.0], [4.0, 4.0]]]
    """
    turn = np.array([[1.0, 1.0], [-1.0, 1.0]] if rising else [[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2)
    along, across = turn @ outline.T  # lines are parallel to the first row
    lines = []
    for at in spacing * np.arange(
        np.ceil(across.min() / spacing), np.floor(across.max() / spacing) + 1
    ):
        above = across > at
        cut = np.flatnonzero(above != np.roll(above, -1))
        after = (cut + 1) % len(across)
        share = (at - across[cut]) / (across[after] - across[cut])
        ends = np.sort(along[cut] + share * (along[after] - along[cut]))
        pairs = np.stack([ends, np.full_like(ends, at)], axis=-1).reshape(-1, 2, 2)
        lines += [pair @ turn for pair in pairs if np.ptp(pair[:, 0]) > 0]
    return lines


@cache
def _width_over_height(text: str, weight: str) -> float:
    """Return the ratio of text width to capital height."""
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.ft2font import LoadFlags

    font = get_font(findfont(FontProperties(family="DejaVu Sans", weight=weight)))
    font.set_size(REFERENCE_FONT_SIZE, 72)
    font.set_text(text, 0.0, flags=LoadFlags.NO_HINTING)
    return float(font.get_width_height()[0]) / 64 / REFERENCE_FONT_SIZE / CAPITAL


def outside_of(points: Array, boxes: Sequence[Region]) -> list[Array] | None:
    """Return the pieces of a polyline (n, 2) outside boxes, or None if it intersects none.

    >>> [piece.tolist() for piece in outside_of(np.array([[0.0, 0.0], [9.0, 0.0]]), [Region(2.0, -1.0, 4.0, 1.0)])]
    [[[0.0, 0.0], [2.0, 0.0]], [[4.0, 0.0], [9.0, 0.0]]]
    """
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    near = [b for b in boxes if b.left < x1 and b.right > x0 and b.bottom < y1 and b.top > y0]
    segments = [np.stack(ends) for ends in pairwise(points)]
    whole = len(segments)
    for box in near:
        segments = [piece for segment in segments for piece in _cut(segment, box)]
    if len(segments) == whole and all(
        np.array_equal(s, points[i : i + 2]) for i, s in enumerate(segments)
    ):
        return None
    joined: list[Array] = []
    for segment in segments:
        if joined and np.array_equal(joined[-1][-1], segment[0]):
            joined[-1] = np.concatenate([joined[-1], segment[1:]])
        else:
            joined.append(segment)
    return joined


def _cut(segment: Array, box: Region) -> list[Array]:
    """Remove the part of a segment (2, 2) inside a box."""
    start, along = segment[0], segment[1] - segment[0]
    enter, leave = 0.0, 1.0
    for i, (low, high) in enumerate(((box.left, box.right), (box.bottom, box.top))):
        if along[i] == 0:
            if not low < start[i] < high:
                return [segment]
            continue
        ends = sorted(((low - start[i]) / along[i], (high - start[i]) / along[i]))
        enter, leave = max(enter, ends[0]), min(leave, ends[1])
    if enter >= leave:
        return [segment]
    pieces = [np.stack([start, start + enter * along])] if enter > 0 else []
    return [*pieces, np.stack([start + leave * along, segment[1]])] if leave < 1 else pieces


class Sheet:
    """Figure of paper size; methods draw in millimetres from the lower left corner."""

    def __init__(self, size: str = "A3") -> None:
        if size not in SHEETS:
            raise InvalidParameter(f"sheet must be one of {', '.join(SHEETS)}; got {size!r}")
        self.size = size
        self.width, self.height = SHEETS[size]
        self.figure = Figure(figsize=(self.width / 25.4, self.height / 25.4))
        self.ax = self.figure.add_axes((0, 0, 1, 1))
        self.ax.set_axis_off()
        self.ax.set_xlim(0, self.width)
        self.ax.set_ylim(0, self.height)

    # -- lines -----------------------------------------------------------------------------------

    def line(
        self, points: ArrayLike, width: float = THIN, dashes: Sequence[float] = (), **style: Any
    ) -> None:
        """Draw a polyline through points (n, 2)."""
        x, y = np.asarray(points, dtype=float).T
        style = {"color": INK, "solid_capstyle": "round", "dash_capstyle": "butt", **style}
        line = Line2D(x, y, linewidth=width * POINT, **style)
        if dashes:
            line.set_dashes(dashes)
        self.ax.add_artist(line)  # unlike plot, add_artist keeps the axis limits

    def hatch(self, outline: ArrayLike, spacing: float = 3.0, rising: bool = True) -> None:
        """Hatch a closed outline (n, 2) at 45 deg."""
        for start, end in hatching(np.asarray(outline, dtype=float), spacing, rising):
            self.line([start, end], FINE, solid_capstyle="butt")

    def arrow(self, tip: ArrayLike, direction: ArrayLike, color: str = INK) -> None:
        """Draw a filled arrow head with the tip in a given direction."""
        tip, along = np.asarray(tip, dtype=float), np.asarray(direction, dtype=float)
        along = along / np.hypot(*along) * ARROW
        across = np.array([-along[1], along[0]]) / 6
        corners = [tip, tip - along + across, tip - along - across]
        self.fill(corners, color)

    def fill(self, corners: Sequence[ArrayLike], color: str = INK) -> None:
        """Fill a polygon."""
        self.ax.add_artist(
            Polygon(np.asarray(corners), closed=True, facecolor=color, edgecolor="none", zorder=3)
        )

    # -- text ------------------------------------------------------------------------------------

    def text(self, x: float, y: float, string: str, height: float = LETTERS, **style: Any) -> None:
        """Draw text with a given capital height in mm."""
        style = {"ha": "left", "va": "baseline", "color": INK, **style}
        self.ax.text(
            x, y, label(string), fontsize=height / CAPITAL * POINT, parse_math=False, **style
        )

    def text_width(self, text: str, height: float = LETTERS, weight: Any = "normal") -> float:
        """Return the width of a text, mm."""
        return _width_over_height(label(text), str(weight)) * height

    def words_boxes(self) -> list[Region]:
        """Return the bounding boxes of all texts, mm."""
        boxes = []
        for text in self.ax.texts:
            (x, y), high = text.get_position(), float(text.get_fontsize()) / POINT * CAPITAL
            wide = self.text_width(text.get_text(), high, text.get_fontweight())
            before = {"left": 0.0, "center": 0.5, "right": 1.0}[text.get_horizontalalignment()]
            if text.get_rotation():  # upright text: its baseline is on the right
                boxes.append(Region(x - 1.4 * high, y - wide / 2, x, y + wide / 2))
            else:
                boxes.append(Region(x - before * wide, y, x + (1 - before) * wide, y + high))
        return boxes

    def interrupt_lines(self) -> None:
        """Interrupt thin lines behind text (ISO 129-1)."""
        boxes = [
            Region(b.left - CLEAR, b.bottom - CLEAR, b.right + CLEAR, b.top + CLEAR)
            for b in self.words_boxes()
        ]
        for line in list(self.ax.lines):
            if line.get_linewidth() > 1.01 * THIN * POINT:
                continue
            points = np.stack([line.get_xdata(), line.get_ydata()], axis=-1)
            pieces = outside_of(points, boxes)
            if pieces is None:
                continue
            for piece in pieces:
                (copy,) = self.ax.plot(*piece.T)
                copy.update_from(line)
            line.remove()

    # -- dimensions ------------------------------------------------------------------------------

    def dimension(
        self,
        start: ArrayLike,
        end: ArrayLike,
        at: float,
        text: str,
        upright: bool = False,
        before: bool = False,
    ) -> None:
        """Draw a linear dimension between two points, its line at height ``at``, or at x if ``upright``.

        Arrows are placed inside if there is space and outside otherwise. Text that does not fit is placed
        after the second point, or ``before`` the first.
        """
        a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        along = 1 if upright else 0
        if a[along] > b[along]:
            a, b = b, a
        side = 1 - along
        room = b[along] - a[along]

        def place(position: float, across: float) -> Array:
            return np.array([across, position] if upright else [position, across])

        for point in (a, b):
            if abs(at - point[side]) > 2:
                away = np.sign(at - point[side])
                ends = (point[side] + away, at + away * 1.5)
                self.line([place(point[along], e) for e in ends], FINE)
        inside = room > 2.6 * ARROW
        reach = 0.0 if inside else 2.2 * ARROW
        width = self.text_width(text)
        fits = width + 1.5 < room - (2 * ARROW if inside else 0)
        low, high = a[along] - reach, b[along] + reach
        middle = (a[along] + b[along]) / 2
        if not fits and before:
            low = a[along] - max(reach, ARROW) - width - 2
            middle = low + (width + 1) / 2
        elif not fits:
            high = b[along] + max(reach, ARROW) + width + 2
            middle = high - (width + 1) / 2
        self.line([place(low, at), place(high, at)], FINE)
        towards = place(1.0, 0.0) if inside else place(-1.0, 0.0)
        self.arrow(place(a[along], at), -towards)
        self.arrow(place(b[along], at), towards)
        x, y = place(middle, at - 1 if upright else at + 1)
        self.text(
            x,
            y,
            text,
            ha="right" if upright else "center",
            va="center" if upright else "baseline",
            rotation=90 if upright else 0,
        )

    def leader(
        self, tip: ArrayLike, bend: ArrayLike, lines: Sequence[str], rightwards: bool = True
    ) -> None:
        """Draw a leader line with an arrow and text on its horizontal part."""
        tip, bend = np.asarray(tip, dtype=float), np.asarray(bend, dtype=float)
        width = max(self.text_width(w) for w in lines) + 2
        end = bend + np.array([width if rightwards else -width, 0.0])
        self.line([tip, bend, end], FINE)
        self.arrow(tip, tip - bend)
        left = min(bend[0], end[0]) + 1
        for i, line in enumerate(reversed(lines)):
            self.text(left, bend[1] + (1 + 4 * i), line)

    # -- tables ----------------------------------------------------------------------------------

    def table(
        self,
        x: float,
        top: float,
        width: float,
        rows: Sequence[Sequence[str]],
        title: str,
        note: str = "",
    ) -> float:
        """Draw a titled table and return its lower edge; all columns except the first are right-
        aligned.
        """
        self.text(x, top - 3.4, title, fontweight="bold")
        if note:
            self.text(x + width - 0.6, top - 3.4, note, ha="right")
        y = top - TABLE_ROW
        self.line([(x, y), (x + width, y)], THIN)
        columns = list(zip(*rows, strict=True))[1:]
        widths = [max(self.text_width(cell) for cell in cells) + GUTTER for cells in columns]
        rights = x + width - np.cumsum([0.0, *widths[:0:-1]])[::-1]
        for first, *others in rows:
            self.text(x, y - 3.5, first)
            for cell, right in zip(others, rights, strict=True):
                if cell:
                    self.text(right - 0.6, y - 3.5, cell, ha="right")
            y -= TABLE_ROW
            self.line([(x, y), (x + width, y)], FINE, color="#B0B0B0")
        return y


FRAME_HEIGHT = 2 * LETTERS
"""Height of a tolerance frame, mm."""
PAD = 1.2


def _circle(radius: float, start: float = 0.0, end: float = 360.0) -> Array:
    angle = np.radians(np.linspace(start, end, 49))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


CHARACTERISTICS: dict[str, list[Array]] = {
    "flatness": [np.array([(-1.9, -0.9), (0.7, -0.9), (1.9, 0.9), (-0.7, 0.9), (-1.9, -0.9)])],
    "perpendicularity": [
        np.array([(-1.5, -1.2), (1.5, -1.2)]),
        np.array([(0.0, -1.2), (0.0, 1.5)]),
    ],
    "coaxiality": [_circle(0.8), _circle(1.6)],
    "surface profile": [np.concatenate([_circle(1.6, 0.0, 180.0) - [0.0, 0.7], [(1.6, -0.7)]])],
}
"""Lines of each geometric characteristic symbol, relative to its centre."""


def tolerance_frame(
    sheet: Sheet, x: float, y: float, characteristic: str, cells: Sequence[str]
) -> float:
    """Draw a tolerance frame (symbol, zone, datums) and return its right edge."""
    for line in CHARACTERISTICS[characteristic]:
        sheet.line(np.add(line, [x + FRAME_HEIGHT / 2, y + FRAME_HEIGHT / 2]), THIN)
    edges = [x, x + FRAME_HEIGHT]
    for cell in cells:
        edges.append(max(edges[-1] + sheet.text_width(cell) + 2 * PAD, edges[-1] + FRAME_HEIGHT))
        sheet.text((edges[-2] + edges[-1]) / 2, y + (FRAME_HEIGHT - LETTERS) / 2, cell, ha="center")
    for edge in edges:
        sheet.line([(edge, y), (edge, y + FRAME_HEIGHT)], THIN)
    for height in (y, y + FRAME_HEIGHT):
        sheet.line([(x, height), (edges[-1], height)], THIN)
    return edges[-1]


def frame_width(sheet: Sheet, cells: Sequence[str]) -> float:
    """Return the width of a tolerance frame."""
    return FRAME_HEIGHT + sum(max(sheet.text_width(cell) + 2 * PAD, FRAME_HEIGHT) for cell in cells)


def datum(
    sheet: Sheet, foot: ArrayLike, direction: ArrayLike, letter: str, reach: float = 6.0
) -> None:
    """Draw a datum: a filled triangle on an edge and its letter in a box at a given distance."""
    at, along = np.asarray(foot, dtype=float), np.asarray(direction, dtype=float)
    across = np.array([-along[1], along[0]])
    sheet.fill([at + 1.25 * across, at - 1.25 * across, at + 2.2 * along])
    middle = at + (reach + FRAME_HEIGHT / 2) * along
    sheet.line([at + 2.2 * along, at + reach * along], THIN)
    half = FRAME_HEIGHT / 2
    box = np.array([(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)])
    sheet.line(box + middle, THIN)
    sheet.text(middle[0], middle[1] - LETTERS / 2, letter, ha="center")


def surface_sign(sheet: Sheet, x: float, y: float, text: str, removed: bool = True) -> float:
    """Draw a surface texture symbol with its tip at (x, y) and return its right edge."""
    low, high = np.array([-2.2, 3.8]), np.array([4.4, 7.6])
    width = sheet.text_width(text)
    at = np.array([x, y])
    sheet.line([at + low, at, at + high, at + high + [width + 2.0, 0.0]], THIN)
    if removed:
        sheet.line([at + low, at + low * [-1.0, 1.0]], THIN)
    sheet.text(x + high[0] + 0.8, y + high[1] - LETTERS - 1.0, text)
    return float(x + high[0] + width + 2.0)


def first_angle(sheet: Sheet, x: float, y: float) -> None:
    """Draw the symbol of first-angle projection at (x, y)."""
    cone = [(-9.0, -1.5), (-9.0, 1.5), (-2.0, 3.0), (-2.0, -3.0), (-9.0, -1.5)]
    sheet.line(np.add(cone, [x, y]), THIN)
    for radius in (1.5, 3.0):
        sheet.line(np.add(_circle(radius), [x + 5.0, y]), THIN)
    for ends in ([(-10.5, 0.0), (-0.5, 0.0)], [(1.0, 0.0), (9.0, 0.0)], [(5.0, -4.0), (5.0, 4.0)]):
        sheet.line(np.add(ends, [x, y]), FINE, (8, 2, 1, 2))


WIDTH, ROW = 180.0, 10.0
"""Width of the title block and height of its rows, mm."""
HEIGHT = 4 * ROW
BOTTOM = MARGINS[1]


@dataclass(frozen=True)
class SheetFacts:
    """Sheet-specific entries of the title block.

    Attributes
    ----------
    title, kind
        Title and type of the drawing.
    scale
        Scale of the main view as text.
    place
        Sheet number and number of sheets.
    material, mass
        Material and mass of the part; empty on the assembly sheet.
    """

    title: str
    kind: str
    scale: str
    place: tuple[int, int]
    material: str = ""
    mass: str = ""


def draw_frame(sheet: Sheet) -> None:
    """Draw the frame and the centring marks."""
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
    """Draw the title block at the lower right corner of the frame."""
    left, right = sheet.width - MARGINS[1] - WIDTH, sheet.width - MARGINS[1]
    sheet.line([(left, BOTTOM), (left, BOTTOM + HEIGHT), (right, BOTTOM + HEIGHT)], FRAME)
    name = block.title or " ".join(facts.title.split())
    rows: list[list[tuple[str, str, float]]] = [
        [
            ("NUMBER", block.number or "-", 60),
            ("REVISION", block.revision, 24),
            ("DATE", block.date or "-", 30),
            ("SHEET", f"{facts.place[0]}/{facts.place[1]}", 18),
            ("SIZE", sheet.size, 16),
            ("SCALE", facts.scale, 32),
        ],
        [
            ("OWNER", block.owner or "-", 60),
            ("CREATED BY", block.created_by or f"omnimirror {__version__}", 60),
            ("APPROVED BY", block.approved_by or "-", 60),
        ],
        [("TITLE", name, 130), ("DOCUMENT", facts.kind, 50)],
        [
            ("MATERIAL", facts.material or "-", 60),
            ("GENERAL TOLERANCES", block.general_tolerances, 60),
            ("MASS", facts.mass or "-", 34),
            ("", "", 26),
        ],
    ]
    for i, cells in enumerate(rows):
        y, x = BOTTOM + ROW * i, left
        if i:
            sheet.line([(left, y), (right, y)], THIN)
        for heading, value, width in cells:
            if x > left:
                sheet.line([(x, y), (x, y + ROW)], THIN)
            sheet.text(x + 1.5, y + ROW - LETTERS - 1.2, heading, color="#555555")
            height = 3.5 if heading == "TITLE" else LETTERS
            sheet.text(x + 1.5, y + 1.6, shortened(sheet, value, width - 3, height), height)
            x += width
    first_angle(sheet, right - 12.5, BOTTOM + 3.5 * ROW)


def shortened(sheet: Sheet, text: str, room: float, height: float = LETTERS) -> str:
    """Truncate a text to a width in mm."""
    if sheet.text_width(text, height) <= room:
        return text
    cuts = [text[:n].rstrip() + " .." for n in range(1, len(text))]
    fitting = bisect_right(cuts, room, key=lambda cut: sheet.text_width(cut, height))
    return cuts[fitting - 1] if fitting else ""
