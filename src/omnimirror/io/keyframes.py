"""Keyframes of moving views, and interpolation between them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ..base import files
from ..base.arguments import format_value, parse_float
from ..base.caching import cached_property
from ..base.errors import MediaError, SpecError, abbreviate

Interpolation = Literal["smooth", "linear"]

TIME_NAME = "time_s"
VALUE_NAMES = ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg", "distance_mm")
"""Valid names, unless the caller specifies others."""
PERIODIC_NAMES = ("pan_deg", "roll_deg")
"""Angles with a period of 360 deg: interpolated along the shorter arc, and returned in -180 to 180
deg.
"""
NAMES_WITHOUT_DEFAULT = ("hfov_deg", "distance_mm")
"""Names without a default of 0: the first keyframe must contain them if a later one does."""


@dataclass(frozen=True)
class Keyframes:
    """Values as functions of time.

    Parameters
    ----------
    tracks
        Pairs of time (s) and value by name, in the order of time. The value is constant before the
        first and after the last pair.
    interpolation
        ``"smooth"``: smooth acceleration at every keyframe, without overshoot beyond neighbouring
        values; ``"linear"``.

    Examples
    --------
    >>> turn = Keyframes({"pan_deg": ((0.0, 170.0), (2.0, -170.0))}, "linear")
    >>> turn.at(0.5), turn.at(9.0)  # 20 deg to the right, and not 340 to the left
    ({'pan_deg': 175.0}, {'pan_deg': -170.0})
    """

    tracks: Mapping[str, Sequence[tuple[float, float]]]
    interpolation: Interpolation = "smooth"

    @classmethod
    def load(cls, path: str | Path, names: Sequence[str] = VALUE_NAMES) -> Keyframes:
        """Read a CSV or a TOML file.

        A CSV file has a header with ``time_s`` and any of ``names``. A TOML file has
        ``[[keyframe]]`` tables with the same entries, optionally preceded by ``interpolation =
        "linear"``.

        A position or angle missing in the first keyframe is 0 there; a field of view or a distance
        must be given in the first keyframe if a later one contains it. A value missing in a later
        keyframe is interpolated between the neighbouring keyframes that contain it, and is constant
        after the last of them.

        Raises
        ------
        MediaError
            If the file does not exist, or an entry is missing, unknown or invalid; the message
            names the line.

        Examples
        --------
        >>> parse_csv("time_s,pan_deg,tilt_deg\\n0,10,\\n2,10,-30").at(0.0)
        {'pan_deg': 10.0, 'tilt_deg': 0.0}
        """
        path = Path(path)
        text = files.read_text(
            path,
            "keyframes",
            MediaError,
            f"path must be an existing keyframe file; got {format_value(str(path))}",
        )
        if path.suffix.lower() not in (".csv", ".toml"):
            raise MediaError(f"keyframes must be a .csv or .toml file; got {path}")
        return (parse_csv if path.suffix.lower() == ".csv" else parse_toml)(text, str(path), names)

    def at(self, time_s: float) -> dict[str, float]:
        """Interpolate the values at a time (s), by name."""
        return {name: self._value(name, time_s) for name in self.tracks}

    def _value(self, name: str, time_s: float) -> float:
        times, _, interpolate = self._curves[name]
        value = interpolate(min(max(time_s, times[0]), times[-1]))
        if name in PERIODIC_NAMES:
            value = 180.0 - (180.0 - value) % 360.0
        return value

    @cached_property
    def _curves(self) -> dict[str, tuple[list[float], list[float], Callable[[float], float]]]:
        """Times, values without jumps of 360 deg, and their interpolants."""
        curves = {}
        for name, points in self.tracks.items():
            times, values = [time for time, _ in points], [value for _, value in points]
            if name in PERIODIC_NAMES:
                values = np.unwrap(values, period=360.0).tolist()
            curves[name] = (times, values, _curve(times, values, self.interpolation))
        return curves


def _curve(
    times: list[float], values: list[float], interpolation: Interpolation
) -> Callable[[float], float]:
    if interpolation == "smooth" and len(times) > 1:
        # Slopes without overshoot (Fritsch and Butland), zero at both ends: the motion starts and
        # stops smoothly, and angles stay within the given range.
        points = list(zip(times, values, strict=True))
        slopes = [0.0, *(_slope(*points[i - 1 : i + 2]) for i in range(1, len(points) - 1)), 0.0]
        return lambda time: _hermite(time, times, values, slopes)
    return lambda time: float(np.interp(time, times, values))


def _slope(
    before: tuple[float, float], here: tuple[float, float], after: tuple[float, float]
) -> float:
    h0, h1 = here[0] - before[0], after[0] - here[0]
    d0, d1 = (here[1] - before[1]) / h0, (after[1] - here[1]) / h1
    if d0 * d1 <= 0:
        return 0.0
    w0, w1 = 2 * h1 + h0, h1 + 2 * h0
    return (w0 + w1) / (w0 / d0 + w1 / d1)


def _hermite(time: float, times: list[float], values: list[float], slopes: list[float]) -> float:
    i = min(max(int(np.searchsorted(times, time, side="right")) - 1, 0), len(times) - 2)
    step = times[i + 1] - times[i]
    t = (time - times[i]) / step
    rest = 1 - t
    return (
        (1 + 2 * t) * rest**2 * values[i]
        + t * rest**2 * step * slopes[i]
        + t**2 * (3 - 2 * t) * values[i + 1]
        - t**2 * rest * step * slopes[i + 1]
    )


# -- Keyframe files ---------------------------------------------------------------------------------------


def parse_csv(
    text: str, source: str = "keyframes", names: Sequence[str] = VALUE_NAMES
) -> Keyframes:
    """Parse keyframes of a CSV text; lines that start with # are comments.

    >>> parse_csv("time_s,pan_deg\\n0,0\\n2,90").at(1.0)
    {'pan_deg': 45.0}
    """
    source = abbreviate(source)
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and line[0] != "#"
    ]
    if not lines:
        raise MediaError(
            f"{source} must contain keyframes, with a header such as {TIME_NAME},{','.join(names[:2])}"
        )
    (head_line, head), *rows = lines
    columns = [name.strip() for name in next(csv.reader([head]))]
    _check_names(columns, names, f"line {head_line} of {source}")
    points = []
    for number, line in rows:
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        where = f"line {number} of {source}"
        if len(cells) > len(columns):
            raise MediaError(
                f"{where} must have at most {len(columns)} values, as the header; got {len(cells)}"
            )
        entries = {name: cell for name, cell in zip(columns, cells, strict=False) if cell}
        points.append((where, entries))
    return _keyframes(points, source, "smooth")


def parse_toml(
    text: str, source: str = "keyframes", names: Sequence[str] = VALUE_NAMES
) -> Keyframes:
    """Parse keyframes of a TOML text.

    >>> parse_toml("[[keyframe]]\\ntime_s = 0\\npan_deg = 5").at(1.0)
    {'pan_deg': 5.0}
    """
    source = abbreviate(source)
    try:
        data = files.parse_toml(text, source)
    except SpecError as e:
        raise MediaError(str(e)) from None
    heads = [
        n
        for n, line in enumerate(text.splitlines(), 1)
        if re.match(r"\s*\[\[\s*keyframe\s*\]\]", line)
    ]
    return keyframes_of(data, source, names, heads)


def keyframes_of(
    data: dict[str, Any],
    source: str = "keyframes",
    names: Sequence[str] = VALUE_NAMES,
    lines: Sequence[int] = (),
) -> Keyframes:
    """Convert a table of a TOML file to keyframes, optionally with their line numbers.

    >>> keyframes_of({"keyframe": [{"time_s": 0, "pan_deg": 5}]}).at(1.0)
    {'pan_deg': 5.0}
    """
    data = dict(data)
    interpolation = data.pop("interpolation", "smooth")
    if interpolation not in get_args(Interpolation):
        raise MediaError(
            f"{source}: interpolation must be smooth or linear; got {format_value(interpolation)}"
        )
    tables = data.pop("keyframe", [])
    if data or not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise MediaError(
            f"{source} must contain only [[keyframe]] tables and optionally interpolation"
        )
    points = []
    for i, table in enumerate(tables):
        where = (
            f"the keyframe in line {lines[i]} of {source}"
            if i < len(lines)
            else f"keyframe {i + 1} of {source}"
        )
        _check_names(list(table), names, where)
        points.append((where, table))
    return _keyframes(points, source, interpolation)


def _check_names(entries: list[str], names: Sequence[str], where: str) -> None:
    if TIME_NAME not in entries:
        raise MediaError(f"{where} must contain {TIME_NAME}")
    for name in entries:
        if name != TIME_NAME and name not in names:
            raise MediaError(
                f"{where}: the names must be from {', '.join((TIME_NAME, *names))}; got {name!r}"
            )


def _keyframes(
    points: list[tuple[str, dict[str, Any]]], source: str, interpolation: Interpolation
) -> Keyframes:
    """Return the tracks of the keyframes, whose times must increase."""
    tracks: dict[str, list[tuple[float, float]]] = {}
    first, latest = math.nan, -math.inf
    for where, entries in points:
        if TIME_NAME not in entries:
            raise MediaError(f"{where} must contain {TIME_NAME}")
        numbers = {name: _number(name, value, where) for name, value in entries.items()}
        time = numbers.pop(TIME_NAME)
        if time <= latest:
            raise MediaError(
                f"{where}: time_s must be greater than that of the previous keyframe, {latest:g} s; got {time:g} s"
            )
        if latest == -math.inf:
            first = time
        latest = time
        for name, value in numbers.items():
            if name not in tracks and time > first:
                if name in NAMES_WITHOUT_DEFAULT:
                    raise MediaError(
                        f"{name} must be in the first keyframe of {source}; got it only from {where}"
                    )
                tracks[name] = [(first, 0.0)]
            tracks.setdefault(name, []).append((time, value))
    if not tracks:
        raise MediaError(f"{source} must contain keyframes")
    return Keyframes({name: tuple(values) for name, values in tracks.items()}, interpolation)


def _number(name: str, value: Any, where: str) -> float:
    try:
        number = (
            parse_float(value)
            if isinstance(value, str)
            else math.nan
            if isinstance(value, bool)
            else float(value)
        )
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise MediaError(f"{where}: {name} must be a number; got {format_value(value)}")
    return number
