"""Lens tables in CSV files: columns with a header, one row per viewing angle."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from ....base.arguments import float_of, shown
from ....base.errors import SpecError
from ....base.files import read_text
from .files import followed


def read_lens_table(table: dict[str, Any], folder: Path | None, columns: tuple[str, ...]) -> dict[str, Any]:
    """Return a lens table with the columns of its CSV ``file`` instead of the file name.

    Raises
    ------
    OmnimirrorError
        If the table must not name a file, or the file is missing, has other columns, or has rows
        that are not numeric.
    """
    rest, path = followed(table, folder, "file", "its columns")
    if path is None:
        return rest
    text = read_text(path, "lens table", SpecError)
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise SpecError(f"{path} holds no line; a lens table begins with the names of its columns")
    rows = [(number, row) for (number, _), row in zip(lines, csv.reader(line for _, line in lines), strict=True)]
    names = [name.strip() for name in rows[0][1]]
    for name in names:
        if name not in columns:
            valid = ", ".join(columns)
            raise SpecError(f"{path} line {rows[0][0]}: column {shown(name)} is not known; valid are {valid}")
    found: dict[str, list[float]] = {name: [] for name in names}
    for number, row in rows[1:]:
        try:
            for name, cell in zip(names, row, strict=True):
                found[name].append(float_of(cell))
        except ValueError:
            raise SpecError(
                f"{path} line {number}: {shown(','.join(row))} is not {len(names)} numbers, one for each column"
            ) from None
    return found | rest
