"""Survey files: pixels with the surveyed points or star directions that they show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ....base.arguments import checked, shown
from ....base.errors import InvalidParameter
from ....base.files import read_text
from ...tables import cells_of, number_of
from .observations import Sighting

PIXEL = ("u_px", "v_px")
POINT = ("x_mm", "y_mm", "z_mm")
DIRECTION = ("x", "y", "z")
ANGLES = ("azimuth_deg", "elevation_deg")
PICTURE = "picture"
ONLY = "survey"  # name of the image if no column names images


class Surveys(NamedTuple):
    """Contents of survey files."""

    sightings: tuple[Sighting, ...]
    """One sighting per image."""
    places: dict[str, tuple[str, ...]]
    """File and line of each point, by image."""


class _Row(NamedTuple):
    """Line of a survey file."""

    place: str
    """File and line number."""
    picture: str
    pixel: tuple[float, float]
    target: tuple[float, float, float]
    is_distant: bool


@checked
def read_surveys(points: Sequence[str | Path] = (), directions: Sequence[str | Path] = ()) -> Surveys:
    """Read surveyed points and directions with their pixels from CSV tables with a header line.

    Lines with the same image name, in all files, belong to one camera pose: a camera that did not
    move between images has one name for all of them. All files of an image share one right-handed
    coordinate system with arbitrary origin. The camera pose in it is not required.

    Parameters
    ----------
    points
        CSV files with the columns ``u_px``, ``v_px``, ``x_mm``, ``y_mm``, ``z_mm``, and ``picture``
        for several images.
    directions
        CSV files with ``u_px``, ``v_px`` and either ``x``, ``y``, ``z`` of any length, or
        ``azimuth_deg`` (clockwise from above, for example from north) and ``elevation_deg``. X has
        azimuth 0, Y points to its left, and Z up.

    Returns
    -------
    Surveys
        One sighting per image, with the file and line of each point.

    Raises
    ------
    InvalidParameter
        If a column is missing or unknown, or a value is not a number; the message names the line.

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
    """Return the lines of a file with pixel columns and one of several sets of target columns."""
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
