"""Files named in lens tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ....base.arguments import shown
from ....base.errors import SpecError


def followed(table: dict[str, Any], folder: Path | None, entry: str, noun: str) -> tuple[dict[str, Any], Path | None]:
    """Return the table without an entry that names a file, and the file; None if it names none.

    Only files named on the user's command line have a ``folder``; with None, the table must not
    name a file.

    Raises
    ------
    SpecError
        If the table must not name a file, or the name is not a string.

    Examples
    --------
    >>> followed({"file": "/etc/passwd"}, None, "file", "the surfaces")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.SpecError: lens.file names another file; put the surfaces themselves in
    """
    if entry not in table:
        return dict(table), None
    if folder is None:
        raise SpecError(f"lens.{entry} names another file; put {noun} themselves in")
    name = table[entry]
    if not isinstance(name, str):
        raise SpecError(f"lens.{entry} = {shown(name)} is not the name of a file in quotes")
    return {k: v for k, v in table.items() if k != entry}, folder / name
