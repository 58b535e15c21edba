"""Dataset manifest: dataset.json lists completed files to resume interrupted datasets."""

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
AT_LEAST = 50  # dataset.json is rewritten when 1/50 of it is new: once per file for small datasets


class Ledger:
    """Manifest of the completed files of a dataset with their SHA-256 and metadata.

    Parameters
    ----------
    folder
        Folder of the dataset. Existing files that match its dataset.json are kept; others are
        rewritten.
    described
        Constant entries of dataset.json, including the ``recipe`` of the dataset.

    Raises
    ------
    InvalidParameter
        If the folder contains another dataset.
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
        """Return True if the files exist unchanged."""
        return all(name in self.files for name in names)

    def add(self, *names: str) -> None:
        """Add files that were just written."""
        self.files |= {name: sha256_of(self.folder / name) for name in names}
        if len(self.files) - self._noted > len(self.files) // AT_LEAST:
            self.write()

    def drop(self, names: Sequence[str]) -> None:
        """Remove files and their entries."""
        for name in names:
            self.files.pop(name, None)
        self.write()
        for name in names:
            (self.folder / name).unlink(missing_ok=True)

    def write(self) -> None:
        """Write dataset.json in its current state, atomically."""
        whole = (
            self.described | {"complete": self.is_complete} | self.entries | {"files": dict(sorted(self.files.items()))}
        )
        write_text(self.folder / DESCRIPTION, json.dumps(whole) + "\n")
        self._noted = len(self.files)

    def finish(self, complete: bool) -> None:
        """Write the final dataset.json."""
        self.is_complete = complete
        self.write()

    def end(self, beginning: Sequence[str]) -> None:
        """Write the current state; a dataset without completed files is removed, including its
        ``beginning`` files.
        """
        if not self.is_new or self.files.keys() - {*beginning}:
            self.write()
            return
        for name in (DESCRIPTION, *beginning):
            (self.folder / name).unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()


def _remove_leftovers(folder: Path) -> None:
    """Remove incomplete files of a terminated process."""
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
