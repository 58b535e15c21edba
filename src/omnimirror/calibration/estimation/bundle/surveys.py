"""Files of what is known: pixels beside the points of a room, or the directions of stars, that they show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import checked, shown
from ....base.errors import InvalidParameter
from ....base.files import read_text
from ...tables import cells_of, number_of
from .observations import Sighting

Array = NDArray[np.float64]

PIXEL = ("u_px", "v_px")
POINT = ("x_mm", "y_mm", "z_mm")
DIRECTION = ("x", "y", "z")
ANGLES = ("azimuth_deg", "elevation_deg")
PICTURE = "picture"
ONLY = "survey"  # the name of the one picture where no column names pictures


class Surveys(NamedTuple):
    """What files know."""

    sightings: tuple[Sighting, ...]
    """one for each picture"""
    places: dict[str, tuple[str, ...]]
    """of each picture, file and line of its points, in their order"""


class _Row(NamedTuple):
    """A line of a file."""

    place: str
    """file and line"""
    picture: str
    pixel: tuple[float, float]
    target: tuple[float, float, float]
    is_distant: bool


@checked
def read_surveys(points: Sequence[str | Path] = (), directions: Sequence[str | Path] = ()) -> Surveys:
    """Read what pixels are known to show, from tables with a head.

    Lines of one picture, of all files, were seen from one place: a camera that did not move between pictures has one
    name for all of them. All files of a picture share axes, which are right-handed, wherever they begin; where the
    camera stood in them, and how, is not asked for.

    Parameters
    ----------
    points
        CSV files with the columns ``u_px``, ``v_px``, ``x_mm``, ``y_mm``, ``z_mm``, and ``picture`` if there are
        several.
    directions
        CSV files with ``u_px``, ``v_px`` and either ``x``, ``y``, ``z`` of any length, or ``azimuth_deg`` (clockwise
        from above, such as from north) and ``elevation_deg``: X is then at azimuth 0, Y to the left of it, Z up.

    Returns
    -------
    Surveys
        A sighting for each picture, and where in the files its points are.

    Raises
    ------
    InvalidParameter
        A column that is missing or unknown, a value that is no number; the message names the line.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/stars.csv", "w") as file:
    ...         _ = file.write("u_px,v_px,azimuth_deg,elevation_deg\\n412.5,88.25,90,0\\n310.0,95.5,120,30\\n")
    ...     sightings, places = om.read_surveys(directions=[f"{folder}/stars.csv"])
    >>> (sightings[0].points.round(3)[0] + 0.0).tolist(), places["survey"]
    ([0.0, -1.0, 0.0], ('stars.csv line 2', 'stars.csv line 3'))
    """
    rows = [row for path in points for row in _rows(Path(path), (POINT,), is_distant=False)]
    rows += [row for path in directions for row in _rows(Path(path), (DIRECTION, ANGLES), is_distant=True)]
    sightings, places = [], {}
    for name in dict.fromkeys(row.picture for row in rows):
        own = [row for row in rows if row.picture == name]
        pixels, targets = np.array([row.pixel for row in own]), np.array([row.target for row in own])
        distant = np.array([row.is_distant for row in own])
        sightings.append(Sighting(name, pixels, targets, is_distant=distant, is_surveyed=True))
        places[name] = tuple(row.place for row in own)
    return Surveys(tuple(sightings), places)


def _rows(path: Path, valid: Sequence[tuple[str, ...]], *, is_distant: bool) -> list[_Row]:
    """Lines of a file whose columns are pixels and one of several ways to say what they show."""
    text = read_text(path, "points and directions", InvalidParameter, f"there is no file {path}")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if len(lines) < 2:
        raise InvalidParameter(f"{path} holds no points; its first line should be {','.join((*PIXEL, *valid[0]))}")
    (number, head), *rest = lines
    columns = cells_of(head, f"line {number} of {path}")
    target = next((names for names in valid if set(columns) - {PICTURE} == {*PIXEL, *names}), None)
    if target is None or len(set(columns)) < len(columns):
        ways = " or ".join(",".join((*PIXEL, *names)) for names in valid)
        raise InvalidParameter(
            f"line {number} of {path} names {shown(head)}; valid is {ways}, and {PICTURE} if several"
        )
    return [_row(f"{path.name} line {n}", columns, line, target, is_distant) for n, line in rest]


def _row(place: str, columns: list[str], line: str, target: tuple[str, ...], is_distant: bool) -> _Row:
    cells = cells_of(line, place)
    if len(cells) != len(columns):
        raise InvalidParameter(f"{place} has {len(cells)} values, and the first line names {len(columns)}")
    entries = dict(zip(columns, cells, strict=True))
    u, v = (number_of(entries, name, place) for name in PIXEL)
    numbers = [number_of(entries, name, place) for name in target]
    if target == ANGLES:
        azimuth, elevation = np.radians(numbers)
        if abs(elevation) > np.pi / 2:
            raise InvalidParameter(f"{place}: elevation_deg = {numbers[1]:g} is not within -90 to 90")
        level = np.cos(elevation)
        numbers = [level * np.cos(azimuth), -level * np.sin(azimuth), np.sin(elevation)]
    if is_distant and not np.linalg.norm(numbers) > 0:
        raise InvalidParameter(f"{place}: 0, 0, 0 is no direction")
    x, y, z = numbers
    return _Row(place, entries.get(PICTURE) or ONLY, (u, v), (float(x), float(y), float(z)), is_distant)
