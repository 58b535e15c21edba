"""A sheet of drawing paper: lines, hatching, dimensions, text and tables, placed in millimetres of the paper.

Line widths, dash patterns and arrows follow ISO 128 and 129; sizes are those of an A3 sheet and shrink with
the paper, so that one layout serves A3 and A4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidParameter
from ...figures.style import INK

Array = NDArray[np.float64]

SHEETS = {"A3": (420.0, 297.0), "A4": (297.0, 210.0)}
"""Width and height in landscape, mm."""
FRAME, THICK, THIN, FINE = 0.7, 0.5, 0.25, 0.18
"""Line widths on A3, mm."""
CHAIN, DASHED, PHANTOM = (20, 4, 2, 4), (8, 4), (20, 4, 2, 4, 2, 4)
"""Dash patterns in line widths: centre lines, hidden edges, neighbouring parts."""
ARROW = 2.5
"""Length of an arrow on A3, mm; it is a third as wide."""
CAPITAL = 0.729
"""Height of capitals over font size, DejaVu Sans."""
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


class Sheet:
    """A figure as large as the paper; every method draws in millimetres from its lower left corner."""

    def __init__(self, size: str = "A3") -> None:
        if size not in SHEETS:
            raise InvalidParameter(f"sheet = {size!r} is not one of {', '.join(SHEETS)}")
        self.size = size
        self.width, self.height = SHEETS[size]
        self.k = self.width / SHEETS["A3"][0]
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
        (line,) = self.ax.plot(x, y, linewidth=width * self.k * POINT, **look)
        if dashes:
            line.set_dashes(dashes)

    def hatch(self, outline: ArrayLike, spacing: float = 3.0, rising: bool = True) -> None:
        """Hatching at 45 degrees inside a closed outline (n, 2)."""
        outline = np.asarray(outline, dtype=float)
        inside = PathPatch(Outline(outline, closed=False), facecolor="none", edgecolor="none")
        self.ax.add_patch(inside)
        (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
        step, tall = spacing * self.k * np.sqrt(2), y1 - y0
        # counted from the sheet's corner, so that neighbouring areas of a part match
        first = np.floor((x0 - tall - y0) / step) * step + y0
        for start in np.arange(first - tall, x1 + tall, step):
            ends = [(start, y0), (start + tall, y1)] if rising else [(start + tall, y0), (start, y1)]
            (line,) = self.ax.plot(*zip(*ends, strict=True), color=INK, linewidth=FINE * self.k * POINT)
            line.set_clip_path(inside)

    def arrow(self, tip: ArrayLike, direction: ArrayLike, color: str = INK) -> None:
        """A filled arrow head whose tip points along a direction."""
        tip, along = np.asarray(tip, dtype=float), np.asarray(direction, dtype=float)
        along = along / np.hypot(*along) * ARROW * self.k
        across = np.array([-along[1], along[0]]) / 6
        corners = [tip, tip - along + across, tip - along - across]
        self.ax.add_patch(Polygon(corners, closed=True, facecolor=color, edgecolor="none", zorder=3))

    # -- text ------------------------------------------------------------------------------------

    def text(self, x: float, y: float, words: str, height: float = 2.5, **look: Any) -> None:
        """Words whose capitals are so many mm high on A3."""
        look = {"ha": "left", "va": "baseline", "color": INK, **look}
        self.ax.text(x, y, words, fontsize=height * self.k / CAPITAL * POINT, parse_math=False, **look)

    def text_width(self, words: str, height: float = 2.5, **look: Any) -> float:
        """How wide words would come out, mm."""
        from matplotlib.font_manager import FontProperties

        font = FontProperties(family="DejaVu Sans", **look)
        size = height * self.k / CAPITAL
        words = words.replace("$", r"\$")  # a dollar is a dollar
        return float(TextPath((0, 0), words, size=size, prop=font).get_extents().width) if words.strip() else 0.0

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
        k, side = self.k, 1 - along
        room = b[along] - a[along]

        def place(position: float, across: float) -> Array:
            return np.array([across, position] if upright else [position, across])

        for point in (a, b):
            if abs(at - point[side]) > 2 * k:
                away = np.sign(at - point[side])
                ends = (point[side] + away * k, at + away * 1.5 * k)
                self.line([place(point[along], e) for e in ends], FINE)
        inside = room > 2.6 * ARROW * k
        reach = 0.0 if inside else 2.2 * ARROW * k
        width = self.text_width(words)
        fits = width + 1.5 * k < room - (2 * ARROW * k if inside else 0)
        low, high = a[along] - reach, b[along] + reach
        middle = (a[along] + b[along]) / 2
        if not fits and before:
            low = a[along] - max(reach, ARROW * k) - width - 2 * k
            middle = low + (width + k) / 2
        elif not fits:
            high = b[along] + max(reach, ARROW * k) + width + 2 * k
            middle = high - (width + k) / 2
        self.line([place(low, at), place(high, at)], FINE)
        towards = place(1.0, 0.0) if inside else place(-1.0, 0.0)
        self.arrow(place(a[along], at), -towards)
        self.arrow(place(b[along], at), towards)
        x, y = place(middle, at - k if upright else at + k)
        self.text(x, y, words, ha="right" if upright else "center", va="center" if upright else "baseline",
                  rotation=90 if upright else 0)  # fmt: skip

    def leader(self, tip: ArrayLike, bend: ArrayLike, words: Sequence[str], rightwards: bool = True) -> None:
        """A line with an arrow from words to what they are about; the words stand on its level part."""
        tip, bend = np.asarray(tip, dtype=float), np.asarray(bend, dtype=float)
        width = max(self.text_width(w) for w in words) + 2 * self.k
        end = bend + np.array([width if rightwards else -width, 0.0])
        self.line([tip, bend, end], FINE)
        self.arrow(tip, tip - bend)
        left = min(bend[0], end[0]) + self.k
        for i, line in enumerate(reversed(words)):
            self.text(left, bend[1] + (1 + 4 * i) * self.k, line)

    # -- tables ----------------------------------------------------------------------------------

    def table(
        self,
        x: float,
        top: float,
        widths: Sequence[float],
        rows: Sequence[Sequence[str]],
        title: str,
        height: float = 2.0,
    ) -> float:
        """A titled table from its upper left corner, all columns but the first to the right; its lower edge."""
        k = self.k
        row, total = 4.4 * k, sum(widths) * k
        self.text(x, top - 3.0 * k, title, height=2.2, fontweight="bold")
        y = top - 4.4 * k
        self.line([(x, y), (x + total, y)], THIN)
        for cells in rows:
            right = x
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True)):
                right += width * k
                place = {"ha": "left"} if i == 0 else {"ha": "right"}
                self.text(right - width * k if i == 0 else right - 0.6 * k, y - 3.2 * k, cell, height=height, **place)
            y -= row
            self.line([(x, y), (x + total, y)], FINE, color="#B0B0B0")
        return y
