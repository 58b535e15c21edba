"""Sources that the server may serve: its given sources and the files of given folders."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ....io.batch import PICTURES, VIDEOS
from .messages import Source

MOST_LISTED = 2000


@dataclass(frozen=True)
class Shown:
    """Source with its location; the page receives only its ``id``."""

    id: str
    name: str
    kind: Literal["picture", "video", "live"]
    place: str

    @property
    def message(self) -> Source:
        return Source(id=self.id, name=self.name, kind=self.kind, command=self.command)

    @property
    def command(self) -> str:
        """Location of the source, relative to the working directory if shorter."""
        here = Path.cwd()
        is_near = self.kind != "live" and Path(self.place).is_relative_to(here)
        return str(Path(self.place).relative_to(here)) if is_near else self.place


class Sources:
    """Available sources. A page selects from the list and never sends a path.

    Parameters
    ----------
    given
        Images, videos, cameras and streams; the page opens the first.
    folders
        Folders of additional images and videos.
    live
        Given sources that are cameras or streams.

    Raises
    ------
    MediaError
        Invalid address of a live camera or stream.
    """

    def __init__(self, given: Sequence[str] = (), folders: Iterable[Path] = (), live: Container[str] = ()) -> None:
        places = list(dict.fromkeys(given))
        ids = ["source", *(f"source-{number}" for number in range(2, len(places) + 1))]
        self.given = [_shown(id, place, place in live) for id, place in zip(ids, places, strict=False)]
        self._folders = [folder.resolve() for folder in folders]

    def list(self) -> list[Shown]:
        """Return all currently available sources."""
        found = list(self.given)
        for number, folder in enumerate(self._folders):
            for path in sorted(folder.iterdir()):
                inside = path.resolve().is_relative_to(folder)  # symbolic links can point outside the folder
                if inside and path.is_file() and kind_of_file(path) and len(found) < MOST_LISTED:
                    shown = _shown(f"{number}/{path.name}", str(path), False)
                    found.append(shown)
        return found

    def find(self, id: str) -> Shown:
        """Return a source by id.

        Raises
        ------
        KeyError
            Unknown id.
        """
        for shown in self.list():
            if shown.id == id:
                return shown
        raise KeyError(id)


def kind_of_file(path: Path) -> Literal["picture", "video"] | None:
    """Return the kind of a file by its suffix.

    >>> kind_of_file(Path("room.PNG")), kind_of_file(Path("ride.mp4")), kind_of_file(Path("notes.txt"))
    ('picture', 'video', None)
    """
    suffix = path.suffix.lower()
    return "picture" if suffix in PICTURES else "video" if suffix in VIDEOS else None


def _shown(id: str, place: str, is_live: bool) -> Shown:
    if is_live:
        from ....io.live.sources import checked, named

        checked(place)
        return Shown(id, named(place), "live", place)
    path = Path(place)
    return Shown(id, path.name, kind_of_file(path) or "picture", place)
