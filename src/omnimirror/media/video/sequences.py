"""Numbered pictures that are read as a video, and videos that come on standard input."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...errors import MediaError

SEQUENCES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
NUMBER = re.compile(r"%(0?)(\d*)d")


def is_sequence(name: str | Path) -> bool:
    """Whether a name stands for numbered pictures.

    >>> is_sequence("shots/f%04d.png"), is_sequence("shots/100%.png"), is_sequence("f%d.mp4")
    (True, False, False)
    """
    path = Path(name)
    return len(NUMBER.findall(path.name)) == 1 and path.suffix.lower() in SEQUENCES and not path.exists()


def first_number(pattern: Path) -> int:
    """The number of a sequence's first picture.

    Raises
    ------
    MediaError
        There is none, or numbers are missing between the first and the last.
    """
    before, zero, width, after = NUMBER.split(pattern.name)
    digits = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    folder = pattern.parent
    found = [digits.fullmatch(path.name) for path in folder.iterdir()] if folder.is_dir() else []
    least = int(width or 1) if zero else 1
    numbers = sorted(int(name[1]) for name in found if name and name[1] == f"{int(name[1]):0{least}}")
    if not numbers:
        raise MediaError(f"there is no picture {pattern}")
    if len(numbers) != numbers[-1] - numbers[0] + 1:
        missing = next(n for n, number in enumerate(numbers, numbers[0]) if n != number)
        name = f"{before}{missing:0{least}}{after}"
        raise MediaError(f"{folder / name} is missing among the pictures {pattern}; number them without gaps")
    return numbers[0]


@contextmanager
def standard_input() -> Iterator[Path]:
    """A file of what comes on standard input, all of it: an index may stand at its end.

    Raises
    ------
    MediaError
        Nothing comes, or it is a terminal.
    """
    if sys.stdin is None or sys.stdin.isatty():
        raise MediaError("standard input is a terminal; send a video to it")
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        path = Path(folder) / "standard input"
        with path.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        if not path.stat().st_size:
            raise MediaError("there is no video on standard input, which is empty")
        yield path
