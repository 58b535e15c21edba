"""Files of two numeric columns, and mirror-table entries that name them."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....base.arguments import float_of, shown
from ....base.errors import OmnimirrorError, SpecError
from ....base.files import read_text
from .clouds import read_cloud, read_grid

Columns = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class ColumnFile:
    """Table entry that names a file; its two columns replace the entry."""

    entry: str
    columns: tuple[str, str]
    noun: str
    read: Callable[[Path, str], Columns]
    """Reader of the file, given its path and noun."""

    def followed(self, table: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Return the table with the columns of the file instead of its name.

        This is the only place that opens a file named in another file. Only files named on the
        user's command line have a ``folder``; with None, the table must not name a file.

        Raises
        ------
        OmnimirrorError
            If the table must not name a file, also has the columns, or the file is missing or
            invalid.

        Examples
        --------
        >>> PROFILE_FILE.followed({"profile_csv": "/etc/passwd"}, None)
        Traceback (most recent call last):
        ...
        omnimirror.base.errors.SpecError: profile_csv names another file; put the profile itself in, as x_mm and z_mm
        """
        if self.entry not in table:
            return dict(table)
        if folder is None:
            columns = " and ".join(self.columns)
            raise SpecError(f"{self.entry} names another file; put the {self.noun} itself in, as {columns}")
        if clash := set(self.columns) & set(table):
            raise SpecError(f"mirror has both {self.entry} and {' and '.join(sorted(clash))}; give one or the other")
        name = table[self.entry]
        if not isinstance(name, str):
            raise SpecError(f"{self.entry} = {shown(name)} is not the name of a file in quotes")
        found = self.read(folder / name, self.noun)
        rest = {k: v for k, v in table.items() if k != self.entry}
        return rest | dict(zip(self.columns, map(list, found), strict=True))


def read_columns(
    path: Path, noun: str = "profile", names: str = "x_mm, z_mm"
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read two numeric columns of a CSV file; header and comment lines are skipped.

    Raises
    ------
    OmnimirrorError
        If the file is missing, or a line after the first number does not hold two numbers.
    """
    points: list[tuple[float, float]] = []
    for number, row in enumerate(_rows(read_text(path, noun), path), start=1):
        try:
            first, second = float_of(row[0]), float_of(row[1])
        except (ValueError, IndexError):
            if points and row and not row[0].lstrip().startswith("#"):
                raise OmnimirrorError(
                    f"{path} line {number}: {shown(','.join(row))} is not two numbers {names}"
                ) from None
            continue
        points.append((first, second))
    if not points:
        raise OmnimirrorError(f"{path} holds no line of two numbers {names}")
    firsts, seconds = zip(*points, strict=True)
    return firsts, seconds


def _rows(text: str, path: Path) -> list[list[str]]:
    try:
        return list(csv.reader(text.splitlines()))
    except csv.Error as e:  # an entry of more than 128 kB
        raise OmnimirrorError(f"{path} is not a table of two columns: {e}") from None


PROFILE_FILE = ColumnFile("profile_csv", ("x_mm", "z_mm"), "profile", read_columns)
CLOUD_FILE = ColumnFile("cloud_csv", ("x_mm", "z_mm"), "cloud", read_cloud)
GRID_FILE = ColumnFile("grid_sag", ("x_mm", "z_mm"), "grid", read_grid)
MAPPING_FILE = ColumnFile(
    "mapping_csv",
    ("omega_deg", "height"),
    "mapping",
    lambda path, noun: read_columns(path, noun, "omega_deg, height"),
)
