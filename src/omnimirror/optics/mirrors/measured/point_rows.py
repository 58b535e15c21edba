"""Parser for point rows of measuring machines: headers, row numbers, labels and decimal signs.

Separator and decimal sign apply to the whole file and are inferred from all rows; columns of labels
and of row numbers are dropped; a header naming x, y and z selects the columns.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from ....base.arguments import shown
from ....base.errors import OmnimirrorError
from ....base.typing import Array

Line = tuple[int, str]
"""Line number and text."""
Table = tuple[list[str], list[bool], Array]
"""Header lines, mask of numeric columns, and their values (n, columns)."""

STYLE_LINES = 2000  # used to infer separator and decimal sign
COMMENTS = ("#", "!", "%", "//", "*")
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
COMMA_NUMBER = NUMBER.replace(r"\.", ",")
UNMEASURED = {"nan", "inf", "-inf", "+inf", "none", "null", "---", "****", "bad"}
PREFIXED = re.compile(r"[xyzXYZ]\s*[=:]?\s*(?=[+-]?[\d.,])")
UNIT_WORDS = {"mm": "mm", "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um", "m": "m", "in": "inch",
              "inch": "inch"}  # fmt: skip
AXES = ("x", "y", "z")


def parsed_points(text: str, path: Path, unit: str | None = None) -> Array:
    """Parse the points of a text, (n, 3) of x, y, z or (n, 2) of x, z.

    Parameters
    ----------
    text
    path
        Name of the file, for messages.
    unit : optional
        Unit assumed by the caller; a header naming another one is an error.

    Raises
    ------
    OmnimirrorError
        If there are no numeric rows, a row differs from the others, or the separators are
        ambiguous; the message gives the line.

    Examples
    --------
    >>> parsed_points("Nr;X;Y;Z\\n1;1,5;2,0;-1,0D-02\\n2;2,5;2,0;3,0D-02", Path("cmm.csv"))
    array([[ 1.5 ,  2.  , -0.01],
           [ 2.5 ,  2.  ,  0.03]])
    """
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1)]
    lines = [(i, line) for i, line in lines if line and not line.startswith(COMMENTS)]
    style = _Style.of([line for _, line in lines[:STYLE_LINES]], path)
    header, kinds, table = _plain_table(lines, style) or _labelled_table(lines, style, path)
    _check_unit(header, unit, path)
    names = _named_columns(header, len(kinds))
    has_decimals = any(sign in style.words(line)[0] for _, line in lines[len(header) :][:1] for sign in ".,")
    table = table[np.isfinite(table).all(axis=1)]
    if names is not None and all(kinds[column] for column in names.values()):
        columns = [sum(kinds[: names[axis]]) for axis in AXES if axis in names]
        return np.asarray(table[:, columns])
    if table.shape[1] >= 3 and not has_decimals and _are_row_numbers(table[:, 0]):
        table = table[:, 1:]
    if table.shape[1] < 2:
        raise OmnimirrorError(f"{path} holds one column of numbers; valid are rows of x, y, z, or of x, z of a profile")
    return np.asarray(table[:, :3])


def _plain_table(lines: list[Line], style: _Style) -> Table | None:
    """Return header, column kinds and values of numeric rows; else None."""
    if style.has_decimal_comma:
        return None
    rows = [line.replace(",", " ").replace(";", " ").split() for _, line in lines]
    first = next((k for k, row in enumerate(rows) if len(row) > 1 and all(map(style.is_number, row))), None)
    if first is None or len({len(row) for row in rows[first:]}) > 1 or any("_" in line for _, line in lines[first:]):
        return None
    try:
        table = np.array(rows[first:], dtype=float)
    except ValueError:
        return None
    return [line for _, line in lines[:first]], [True] * table.shape[1], table


def _labelled_table(lines: list[Line], style: _Style, path: Path) -> Table:
    """Return header, column kinds (number or label) and values of rows of any kind.

    Raises
    ------
    OmnimirrorError
        If there are no numeric rows, or a row differs from the others.
    """
    rows = [style.words(line) for _, line in lines]
    widths = [len(words) if sum(map(style.is_number, words)) >= 2 else 0 for words in rows]
    counts = Counter(width for width in widths if width)
    if not counts:
        raise OmnimirrorError(f"{path} holds no rows of numbers; valid are rows of x, y, z, or of x, z of a profile")
    usual, count = counts.most_common(1)[0]
    first = next(k for k, width in enumerate(widths) if width and (width == usual or 2 * count <= counts.total()))
    width = widths[first]
    kinds = [style.is_number(word) for word in rows[first]]
    values: list[list[float]] = []
    for (number, line), words in zip(lines[first:], rows[first:], strict=True):
        found = [style.value(word) for word, is_number in zip(words, kinds, strict=False) if is_number]
        if len(words) < width or None in found:
            names = "x, y, z" if sum(kinds) > 2 else "x, z"
            raise OmnimirrorError(f"{path} line {number}: {shown(line)} is not {names} as in the other rows")
        values.append([value for value in found if value is not None])
    return [line for _, line in lines[:first]], kinds, np.array(values)


class _Style:
    """Separator and decimal sign of a file."""

    def __init__(self, separator: str, has_decimal_comma: bool) -> None:
        self.separator, self.has_decimal_comma = re.compile(separator), has_decimal_comma
        self.number = re.compile(COMMA_NUMBER if has_decimal_comma else NUMBER)

    @classmethod
    def of(cls, lines: list[str], path: Path) -> _Style:
        """Infer the separator and the decimal sign from all lines with numbers.

        Raises
        ------
        OmnimirrorError
            If commas are used for both.
        """
        text = "\n".join(line for line in lines if len(re.findall(r"\d", line)) >= 2)
        has_point = re.search(r"(?<![A-Za-z\d])[+-]?\d*\.\d", text) is not None
        has_semicolons = any(sign in text for sign in (";", "\t"))
        if has_point or "," not in text:
            return cls(r"\s*[,;\t]\s*|\s+", has_decimal_comma=False)
        if has_semicolons:
            return cls(r"\s*[;\t]\s*|\s+", has_decimal_comma=True)
        digits = [line for line in lines if re.search(r"\d", line)]
        if any(re.search(r"\d,\d", line) and re.search(r"\S\s+\S", line) for line in digits):
            return cls(r",?\s+", has_decimal_comma=True)  # such as "1,5 2,0 3,1"
        rows = [line.split(",") for line in digits]
        counts = Counter(map(len, rows))
        if (
            counts
            and counts.most_common(1)[0][0] in (4, 6)
            and all(
                re.fullmatch(r"\d+", row[k].strip())
                for row in rows
                if len(row) in (4, 6)
                for k in range(1, len(row), 2)
            )
        ):
            raise OmnimirrorError(
                f"{path} separates columns and decimals by commas; write it with semicolons or tabs between columns, "
                "or with decimal points"
            )
        return cls(r"\s*,\s*", has_decimal_comma=False)

    def words(self, line: str) -> list[str]:
        """Return the words of a line, without quotes and axis names."""
        return [word.strip("\"'") for word in self.separator.split(PREFIXED.sub("", line)) if word]

    def is_number(self, word: str) -> bool:
        """Return True for a number, or a marker of a missing point."""
        return word.lower() in UNMEASURED or self.number.fullmatch(word) is not None

    def value(self, word: str) -> float | None:
        """Return the value of a word, NaN for a missing point; None for a label."""
        if word.lower() in UNMEASURED:
            return float("nan")
        if not self.number.fullmatch(word):
            return None
        return float(word.replace(",", ".").replace("D", "e").replace("d", "e"))


def _named_columns(header: list[str], width: int) -> dict[str, int] | None:
    """Return the columns of x, (y) and z from the last header line that names them."""
    for line in reversed(header):
        words = [re.sub(r"[\[(/_ ].*", "", word.strip("\"' ").lower()) for word in re.split(r"[;,\t]|\s+", line)]
        words = [word for word in words if word]
        found = {axis: words.index(axis) for axis in AXES if words.count(axis) == 1}
        if len(words) == width and {"x", "z"} <= set(found):
            return found
    return None


def _check_unit(header: list[str], unit: str | None, path: Path) -> None:
    """Check that the header does not name another unit than that assumed by the caller."""
    words = [word for line in header for word in re.findall(r"[\[(/_]\s*([A-Za-zµμ]+)\s*[\])\s,;]?", line)]
    named = {UNIT_WORDS[word.lower()] for word in words if word.lower() in UNIT_WORDS}
    if unit is not None and len(named) == 1 and unit not in named:
        (found,) = named
        raise OmnimirrorError(
            f"{path} gives its points in {found}, and the unit is {unit}; give unit {found} (--unit {found})"
        )


def _are_row_numbers(first: Array) -> bool:
    """Return True if a column (n,) holds row numbers: integers with (almost) unit increments."""
    if len(first) < 2 or np.any(first != np.round(first)):
        return False
    steps = np.diff(first)
    return bool(np.all(steps > 0) and np.median(steps) == 1 and steps.max() <= max(10.0, 0.05 * len(first)))
