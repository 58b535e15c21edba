"""What of a set is done: dataset.json as it grows, so that a set that was ended goes on where it stopped."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...base.errors import InvalidParameter, MediaError
from ...base.files import LARGEST_TEXT, parse_json, read_bytes, write_text
from ..scenes.sources import sha256_of

DESCRIPTION = "dataset.json"
FRAMES = "frames"
LEFTOVER = re.compile(r"\.(view-\d+|frame-\d+|dataset|sensor|poses|video)-\w{8}\.(png|exr|json|toml|csv|mp4)")
AT_LEAST = 50  # dataset.json is written again when this part of it is new: once for each file of small sets


class Ledger:
    """The files of a set that are done, by their SHA-256, and what describes them.

    Parameters
    ----------
    folder
        Of the set. Files that are there and are what its dataset.json says are kept; others are made again.
    described
        Entries of dataset.json that do not change, with the set's ``recipe``.

    Raises
    ------
    InvalidParameter
        The folder holds another set.
    """

    def __init__(self, folder: Path, described: dict[str, Any]) -> None:
        self.folder, self.described = folder, described
        self.entries: dict[str, Any] = {}
        self.files: dict[str, str] = {}
        before = _description(folder)
        self.is_new = before is None
        self.is_complete = False
        if before is not None:
            _check_same(folder, before, described["recipe"])
            _remove_leftovers(folder)
            named = before.get("files", {})
            self.files = {name: sha for name, sha in named.items() if _is_the_same(folder / name, sha)}
            changing = before.keys() - described.keys() - {"files", "complete"}
            self.entries = {name: before[name] for name in before if name in changing}
            self.is_complete = bool(before.get("complete")) and len(self.files) == len(named)
        self._noted = len(self.files)
        if self.is_new:
            self.write()

    def has(self, *names: str) -> bool:
        """Whether files are there, as they were made."""
        return all(name in self.files for name in names)

    def add(self, *names: str) -> None:
        """Take in files that were just written."""
        self.files |= {name: sha256_of(self.folder / name) for name in names}
        if len(self.files) - self._noted > len(self.files) // AT_LEAST:
            self.write()

    def drop(self, names: Sequence[str]) -> None:
        """Forget files, and remove them."""
        for name in names:
            self.files.pop(name, None)
        self.write()
        for name in names:
            (self.folder / name).unlink(missing_ok=True)

    def write(self) -> None:
        """Write dataset.json as things are: at once or not at all."""
        whole = (
            self.described | {"complete": self.is_complete} | self.entries | {"files": dict(sorted(self.files.items()))}
        )
        write_text(self.folder / DESCRIPTION, json.dumps(whole) + "\n")
        self._noted = len(self.files)

    def finish(self, complete: bool) -> None:
        """Write it for the last time."""
        self.is_complete = complete
        self.write()

    def end(self, beginning: Sequence[str]) -> None:
        """Write what is there; of a set that had only begun nothing stays, nor of its files of the ``beginning``."""
        if not self.is_new or self.files.keys() - {*beginning}:
            self.write()
            return
        for name in (DESCRIPTION, *beginning):
            (self.folder / name).unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()


def _remove_leftovers(folder: Path) -> None:
    """Take away half-written files of a process that was killed."""
    for place in (folder, folder / FRAMES):
        for path in place.glob(".*") if place.is_dir() else ():
            if LEFTOVER.fullmatch(path.name):
                path.unlink(missing_ok=True)


def _description(folder: Path) -> dict[str, Any] | None:
    try:
        found = parse_json(read_bytes(folder / DESCRIPTION, 16 * LARGEST_TEXT))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as e:
        raise MediaError(f"{folder / DESCRIPTION} cannot be read, and is not written over: {e}") from None
    return found if isinstance(found, dict) else {}


def _check_same(folder: Path, before: dict[str, Any], recipe: dict[str, Any]) -> None:
    old = before.get("recipe", {})
    different = [name for name in (*recipe, *(old.keys() - recipe.keys())) if old.get(name) != recipe.get(name)]
    if different:
        raise InvalidParameter(
            f"{folder} holds another set, which differs in {', '.join(different)}; take another folder or remove it"
        )


def _is_the_same(path: Path, sha256: str) -> bool:
    return path.is_file() and sha256_of(path) == sha256
