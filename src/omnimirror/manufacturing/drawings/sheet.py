"""A sheet of drawing paper: lines, hatching, dimensions, text and tables, placed in millimetres of the paper.

Line widths, dash patterns and arrows follow ISO 128 and 129, letters are 2.5 mm high at least (ISO 3098), on every
sheet: A4 stands upright and A3 lies, so that both are as high and the title block is as wide as an A4 sheet's frame.
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
from numpy.typing import ArrayLike, NDArray

from ... import __version__
from ...errors import InvalidParameter
from ...escaping import label
from ...figures.style import INK
from ..workshop import TitleBlock

Array = NDArray[np.float64]

SHEETS = {"A3": (420.0, 297.0), "A4": (210.0, 297.0)}
"""Width and height, mm (ISO 5457)."""
MARGINS = (20.0, 10.0)
"""From the edge of the paper to the frame, on the left and elsewhere, mm."""
LETTERS = 2.5
"""Height of the smallest letters, mm (ISO 3098)."""
FRAME, THICK, THIN, FINE = 0.7, 0.5, 0.25, 0.18
"""Line widths, mm."""
CHAIN, DASHED, PHANTOM = (20, 4, 2, 4), (8, 4), (20, 4, 2, 4, 2, 4)
"""Dash patterns in line widths: centre lines, hidden edges, neighbouring parts."""
ARROW = 2.5
"""Length of an arrow, mm; it is a third as wide."""
TABLE_ROW, GUTTER = 4.8, 3.0
"""Height of a table's row, and room between its columns, mm."""
CLEAR = 0.5
"""Between letters and the lines that make way for them, mm."""
CAPITAL = 0.729
"""Height of capitals over font size, DejaVu Sans."""
MEASURED_AT = 256.0
"""Size of letters whose width is measured, in points."""
POINT = 72 / 25.4
SCALES = [10.0**n * a for n in range(2, -5, -1) for a in (5, 2, 1)]
"""Of ISO 5455, from 500:1 down."""


def fitting_scale(width: float, height: float, room_width: float, room_height: float) -> float:
    """The largest standard scale at which something of this size fits the room, all mm.

    >>> fitting_scale(225.0, 100.0, 380.0, 130.0), fitting_scale(500.0, 100.0, 380.0, 130.0)
    (1.0, 0.5)
    """
    fit = min(room_width / width, room_height / height)
    return next((s for s in SCALES if s <= fit * (1 + 1e-9)), SCALES[-1])


def scale_words(scale: float) -> str:
    """
    >>> scale_words(1.0), scale_words(0.5), scale_words(5.0)
    ('1:1', '1:2', '5:1')
    """
    return f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"


@dataclass(frozen=True)
class View:
    """A place on the sheet where a part is drawn to scale, its axis along the paper."""

    x: float
    y: float
    scale: float

    def at(self, z: ArrayLike, x: ArrayLike) -> Array:
        """Points (.., 2) on the paper of points z along the axis and x from it, mm."""
        z, x = np.broadcast_arrays(np.asarray(z, dtype=float), np.asarray(x, dtype=float))
        return np.stack([self.x + self.scale * z, self.y + self.scale * x], axis=-1)


class Region(NamedTuple):
    """A rectangle of a sheet, mm."""

    left: float
    bottom: float
    right: float
    top: float


def hatching(outline: Array, spacing: float, rising: bool = True) -> list[Array]:
    """Lines at 45 degrees inside a closed outline (n, 2), each as its ends (2, 2).

    They are counted from the sheet's corner, so that neighbouring areas of a part match.

    >>> square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    >>> [line.round(6).tolist() for line in hatching(square, 2.0 * np.sqrt(2))]
    [[[0.0, 0.0], [4.0, 4.0]]]
    """
    turn = np.array([[1.0, 1.0], [-1.0, 1.0]] if rising else [[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2)
    along, across = turn @ outline.T  # the lines run along the first
    lines = []
    for at in spacing * np.arange(np.ceil(across.min() / spacing), np.floor(across.max() / spacing) + 1):
        above = across > at
        cut = np.flatnonzero(above != np.roll(above, -1))
        after = (cut + 1) % len(across)
        share = (at - across[cut]) / (across[after] - across[cut])
        ends = np.sort(along[cut] + share * (along[after] - along[cut]))
        pairs = np.stack([ends, np.full_like(ends, at)], axis=-1).reshape(-1, 2, 2)
        lines += [pair @ turn for pair in pairs if np.ptp(pair[:, 0]) > 0]
    return lines


@cache
def _width_over_height(words: str, weight: str) -> float:
    """Of words that are set, over the height of their capitals."""
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.ft2font import LoadFlags

    font = get_font(findfont(FontProperties(family="DejaVu Sans", weight=weight)))
    font.set_size(MEASURED_AT, 72)
    font.set_text(words, 0.0, flags=LoadFlags.NO_HINTING)
    return float(font.get_width_height()[0]) / 64 / MEASURED_AT / CAPITAL


def outside_of(points: Array, boxes: Sequence[Region]) -> list[Array] | None:
    """The pieces of a line (n, 2) outside some boxes; None where it meets none.

    >>> [piece.tolist() for piece in outside_of(np.array([[0.0, 0.0], [9.0, 0.0]]), [Region(2.0, -1.0, 4.0, 1.0)])]
    [[[0.0, 0.0], [2.0, 0.0]], [[4.0, 0.0], [9.0, 0.0]]]
    """
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    near = [b for b in boxes if b.left < x1 and b.right > x0 and b.bottom < y1 and b.top > y0]
    segments = [np.stack(ends) for ends in pairwise(points)]
    whole = len(segments)
    for box in near:
        segments = [piece for segment in segments for piece in _cut(segment, box)]
    if len(segments) == whole and all(np.array_equal(s, points[i : i + 2]) for i, s in enumerate(segments)):
        return None
    joined: list[Array] = []
    for segment in segments:
        if joined and np.array_equal(joined[-1][-1], segment[0]):
            joined[-1] = np.concatenate([joined[-1], segment[1:]])
        else:
            joined.append(segment)
    return joined


def _cut(segment: Array, box: Region) -> list[Array]:
    """A straight line (2, 2) without what lies inside a box."""
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
    """A figure as large as the paper; every method draws in millimetres from its lower left corner."""

    def __init__(self, size: str = "A3") -> None:
        if size not in SHEETS:
            raise InvalidParameter(f"sheet = {size!r} is not one of {', '.join(SHEETS)}")
        self.size = size
        self.width, self.height = SHEETS[size]
        self.figure = Figure(figsize=(self.width / 25.4, self.height / 25.4))
        self.ax = self.figure.add_axes((0, 0, 1, 1))
        self.ax.set_axis_off()
        self.ax.set_xlim(0, self.width)
        self.ax.set_ylim(0, self.height)

    # -- lines -----------------------------------------------------------------------------------

    def line(self, points: ArrayLike, width: float = THIN, dashes: Sequence[float] = (), **look: Any) -> None:
        """An open line through points (n, 2)."""
        x, y = np.asarray(points, dtype=float).T
        look = {"color": INK, "solid_capstyle": "round", "dash_capstyle": "butt", **look}
        line = Line2D(x, y, linewidth=width * POINT, **look)
        if dashes:
            line.set_dashes(dashes)
        self.ax.add_artist(line)  # not plot: the paper's limits stand, no line moves them

    def hatch(self, outline: ArrayLike, spacing: float = 3.0, rising: bool = True) -> None:
        """Hatching at 45 degrees inside a closed outline (n, 2)."""
        for start, end in hatching(np.asarray(outline, dtype=float), spacing, rising):
            self.line([start, end], FINE, solid_capstyle="butt")

    def arrow(self, tip: ArrayLike, direction: ArrayLike, color: str = INK) -> None:
        """A filled arrow head whose tip points along a direction."""
        tip, along = np.asarray(tip, dtype=float), np.asarray(direction, dtype=float)
        along = along / np.hypot(*along) * ARROW
        across = np.array([-along[1], along[0]]) / 6
        corners = [tip, tip - along + across, tip - along - across]
        self.fill(corners, color)

    def fill(self, corners: Sequence[ArrayLike], color: str = INK) -> None:
        """A filled area."""
        self.ax.add_artist(Polygon(np.asarray(corners), closed=True, facecolor=color, edgecolor="none", zorder=3))

    # -- text ------------------------------------------------------------------------------------

    def text(self, x: float, y: float, words: str, height: float = LETTERS, **look: Any) -> None:
        """Words whose capitals are so many mm high."""
        look = {"ha": "left", "va": "baseline", "color": INK, **look}
        self.ax.text(x, y, label(words), fontsize=height / CAPITAL * POINT, parse_math=False, **look)

    def text_width(self, words: str, height: float = LETTERS, weight: Any = "normal") -> float:
        """How wide words would come out, mm."""
        return _width_over_height(label(words), str(weight)) * height

    def words_boxes(self) -> list[Region]:
        """Where letters stand, mm."""
        boxes = []
        for text in self.ax.texts:
            (x, y), high = text.get_position(), float(text.get_fontsize()) / POINT * CAPITAL
            wide = self.text_width(text.get_text(), high, text.get_fontweight())
            before = {"left": 0.0, "center": 0.5, "right": 1.0}[text.get_horizontalalignment()]
            if text.get_rotation():  # upright: right of its letters is the reader's lower side
                boxes.append(Region(x - 1.4 * high, y - wide / 2, x, y + wide / 2))
            else:
                boxes.append(Region(x - before * wide, y, x + (1 - before) * wide, y + high))
        return boxes

    def interrupt_lines(self) -> None:
        """Leave thin lines out where letters stand (ISO 129-1)."""
        boxes = [Region(b.left - CLEAR, b.bottom - CLEAR, b.right + CLEAR, b.top + CLEAR) for b in self.words_boxes()]
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
        self, start: ArrayLike, end: ArrayLike, at: float, words: str, upright: bool = False, before: bool = False
    ) -> None:
        """A length between two points, its line at the height ``at``, or at that x where ``upright``.

        Arrows stand inside where there is room for them and outside elsewhere; words that do not fit between
        the ends stand past the second one, or ``before`` the first.
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
        width = self.text_width(words)
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
        self.text(x, y, words, ha="right" if upright else "center", va="center" if upright else "baseline",
                  rotation=90 if upright else 0)  # fmt: skip

    def leader(self, tip: ArrayLike, bend: ArrayLike, words: Sequence[str], rightwards: bool = True) -> None:
        """A line with an arrow from words to what they are about; the words stand on its level part."""
        tip, bend = np.asarray(tip, dtype=float), np.asarray(bend, dtype=float)
        width = max(self.text_width(w) for w in words) + 2
        end = bend + np.array([width if rightwards else -width, 0.0])
        self.line([tip, bend, end], FINE)
        self.arrow(tip, tip - bend)
        left = min(bend[0], end[0]) + 1
        for i, line in enumerate(reversed(words)):
            self.text(left, bend[1] + (1 + 4 * i), line)

    # -- tables ----------------------------------------------------------------------------------

    def table(
        self, x: float, top: float, width: float, rows: Sequence[Sequence[str]], title: str, note: str = ""
    ) -> float:
        """A titled table from its upper left corner, all columns but the first to the right; its lower edge."""
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
"""Of a frame of a tolerance."""
PAD = 1.2


def _circle(radius: float, start: float = 0.0, end: float = 360.0) -> Array:
    angle = np.radians(np.linspace(start, end, 49))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


CHARACTERISTICS: dict[str, list[Array]] = {
    "flatness": [np.array([(-1.9, -0.9), (0.7, -0.9), (1.9, 0.9), (-0.7, 0.9), (-1.9, -0.9)])],
    "perpendicularity": [np.array([(-1.5, -1.2), (1.5, -1.2)]), np.array([(0.0, -1.2), (0.0, 1.5)])],
    "coaxiality": [_circle(0.8), _circle(1.6)],
    "surface profile": [np.concatenate([_circle(1.6, 0.0, 180.0) - [0.0, 0.7], [(1.6, -0.7)]])],
}
"""Lines of each sign about its middle."""


def tolerance_frame(sheet: Sheet, x: float, y: float, characteristic: str, cells: Sequence[str]) -> float:
    """A frame from its lower left corner: the sign, the width of the zone, and the datums; its right edge."""
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
    """How long a frame becomes."""
    return FRAME_HEIGHT + sum(max(sheet.text_width(cell) + 2 * PAD, FRAME_HEIGHT) for cell in cells)


def datum(sheet: Sheet, foot: ArrayLike, direction: ArrayLike, letter: str, reach: float = 6.0) -> None:
    """A datum: a filled triangle that stands on an edge, and its letter in a box so far along a direction."""
    at, along = np.asarray(foot, dtype=float), np.asarray(direction, dtype=float)
    across = np.array([-along[1], along[0]])
    sheet.fill([at + 1.25 * across, at - 1.25 * across, at + 2.2 * along])
    middle = at + (reach + FRAME_HEIGHT / 2) * along
    sheet.line([at + 2.2 * along, at + reach * along], THIN)
    half = FRAME_HEIGHT / 2
    box = np.array([(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)])
    sheet.line(box + middle, THIN)
    sheet.text(middle[0], middle[1] - LETTERS / 2, letter, ha="center")


def surface_sign(sheet: Sheet, x: float, y: float, words: str, removed: bool = True) -> float:
    """The sign of a surface's texture with its tip at (x, y), words beneath its arm; its right edge."""
    low, high = np.array([-2.2, 3.8]), np.array([4.4, 7.6])
    width = sheet.text_width(words)
    at = np.array([x, y])
    sheet.line([at + low, at, at + high, at + high + [width + 2.0, 0.0]], THIN)
    if removed:
        sheet.line([at + low, at + low * [-1.0, 1.0]], THIN)
    sheet.text(x + high[0] + 0.8, y + high[1] - LETTERS - 1.0, words)
    return float(x + high[0] + width + 2.0)


def first_angle(sheet: Sheet, x: float, y: float) -> None:
    """The sign of first-angle projection about (x, y): a cone, and behind it what its left side shows."""
    cone = [(-9.0, -1.5), (-9.0, 1.5), (-2.0, 3.0), (-2.0, -3.0), (-9.0, -1.5)]
    sheet.line(np.add(cone, [x, y]), THIN)
    for radius in (1.5, 3.0):
        sheet.line(np.add(_circle(radius), [x + 5.0, y]), THIN)
    for ends in ([(-10.5, 0.0), (-0.5, 0.0)], [(1.0, 0.0), (9.0, 0.0)], [(5.0, -4.0), (5.0, 4.0)]):
        sheet.line(np.add(ends, [x, y]), FINE, (8, 2, 1, 2))


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
        for heading, value, width in cells:
            if x > left:
                sheet.line([(x, y), (x, y + ROW)], THIN)
            sheet.text(x + 1.5, y + ROW - LETTERS - 1.2, heading, color="#555555")
            height = 3.5 if heading == "TITLE" else LETTERS
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
