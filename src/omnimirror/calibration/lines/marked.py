"""Tables of points on straight edges, marked manually or by another program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...base.arguments import checked, shown
from ...base.errors import InvalidParameter
from ...base.files import read_text
from ...base.typing import Array
from ..tables import cells_of, number_of

COLUMNS = ("line", "u_px", "v_px")
PICTURE, ONLY = "picture", "picture"  # column, and the default name of a single image
LEAST_POINTS = 3
"""Minimum number of points on an edge; two always fit the image of a straight line."""


@checked
def read_lines(paths: Sequence[str | Path]) -> dict[str, tuple[Array, ...]]:
    """Read points on straight edges from CSV tables with a header line.

    Parameters
    ----------
    paths
        CSV files with the columns ``line`` (name or number of the edge), ``u_px``, ``v_px``, and
        ``picture`` for several images.

    Returns
    -------
    dict
        Edges of each image by its name: points (n, 2) px.

    Raises
    ------
    InvalidParameter
        If a column is missing or unknown, a value is not a number, or an edge has fewer than three
        points; the message names the line.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/edges.csv", "w") as file:
    ...         _ = file.write("line,u_px,v_px\\ndoor,10,20\\ndoor,11,40.5\\ndoor,13,61\\n")
    ...     om.read_lines([f"{folder}/edges.csv"])["picture"][0].tolist()
    [[10.0, 20.0], [11.0, 40.5], [13.0, 61.0]]
    """
    points: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for path in map(Path, paths):
        for picture, edge, pixel in _points(path):
            points.setdefault(picture, {}).setdefault(edge, []).append(pixel)
        for picture, edges in points.items():
            for edge, marked in edges.items():
                if len(marked) < LEAST_POINTS:
                    raise InvalidParameter(
                        f"{path.name}: line {edge} of {picture} has {len(marked)} points, and {LEAST_POINTS} are "
                        "the fewest"
                    )
    return {picture: tuple(np.array(marked) for marked in edges.values()) for picture, edges in points.items()}


def _points(path: Path) -> list[tuple[str, str, tuple[float, float]]]:
    """Return image, edge and pixel of each line of a file."""
    text = read_text(path, "points on lines", InvalidParameter, f"there is no file {path}")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if len(lines) < 2:
        raise InvalidParameter(f"{path} holds no points; its first line should be {','.join(COLUMNS)}")
    (number, head), *rest = lines
    columns = cells_of(head, f"line {number} of {path}")
    if set(columns) - {PICTURE} != set(COLUMNS) or len(set(columns)) < len(columns):
        raise InvalidParameter(
            f"line {number} of {path} names {shown(head)}; valid is {','.join(COLUMNS)}, and {PICTURE} if several"
        )
    return [_point(f"{path.name} line {n}", columns, line) for n, line in rest]


def _point(place: str, columns: list[str], line: str) -> tuple[str, str, tuple[float, float]]:
    cells = cells_of(line, place)
    if len(cells) != len(columns):
        raise InvalidParameter(f"{place} has {len(cells)} values, and the first line names {len(columns)}")
    entries = dict(zip(columns, cells, strict=True))
    return (
        entries.get(PICTURE) or ONLY,
        entries["line"],
        (number_of(entries, "u_px", place), number_of(entries, "v_px", place)),
    )
