"""Lines of user-written tables, with errors that name file and line."""

from __future__ import annotations

import csv

import numpy as np

from ..base.arguments import float_of, shown
from ..base.errors import InvalidParameter


def cells_of(line: str, place: str) -> list[str]:
    """Return the cells of a line."""
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as e:
        raise InvalidParameter(f"{place} is no line of a CSV file: {e}") from None


def number_of(entries: dict[str, str], name: str, place: str) -> float:
    """Return the number in a cell."""
    try:
        value = float_of(entries[name])
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InvalidParameter(f"{place}: {name} = {shown(entries[name])} is no number")
    return value
