"""Signs of drawings that fonts lack: frames of tolerances (ISO 1101), datums (ISO 5459), surfaces (ISO 21920-1),
and first-angle projection (ISO 5456-2). All in mm of the paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .sheet import FINE, LETTERS, THIN, Sheet

Array = NDArray[np.float64]

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
