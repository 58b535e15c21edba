"""Names of image sequences that are read and written as videos, and videos on standard input."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..base.errors import MediaError
from ..base.files import is_same_file

SEQUENCE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
MAX_INPUT_BYTES = 64 << 30
"""Maximum size in bytes of a video on standard input, which is stored in a temporary file."""
CHUNK_BYTES = 1 << 20
NUMBER_PATTERN = re.compile(r"%(0?)(\d*)d")


def is_sequence(name: str | Path) -> bool:
    """Return whether a name is the pattern of an image sequence.

    >>> is_sequence("shots/f%04d.png"), is_sequence("shots/100%.png"), is_sequence("f%d.mp4")
    (True, False, False)
    """
    path = Path(name)
    return (
        len(NUMBER_PATTERN.findall(path.name)) == 1
        and path.suffix.lower() in SEQUENCE_SUFFIXES
        and not path.exists()
    )


def first_number(pattern: Path) -> int:
    """Return the number of the first image of a sequence.

    Raises
    ------
    MediaError
        If there is no image, or numbers are missing between the first and the last.
    """
    numbers = sorted(numbers_of(pattern))
    if not numbers:
        raise MediaError(f"the image sequence must have at least one image; got none for {pattern}")
    if len(numbers) != numbers[-1] - numbers[0] + 1:
        missing = next(n for n, number in enumerate(numbers, numbers[0]) if n != number)
        raise MediaError(
            f"the images {pattern} must be numbered without gaps; {numbered(pattern, missing)} is missing"
        )
    return numbers[0]


def numbers_of(pattern: Path) -> Iterator[int]:
    """Yield the numbers of the existing images of a sequence, unsorted."""
    before, *_, after = NUMBER_PATTERN.split(pattern.name)
    digits = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    folder = pattern.parent
    for path in folder.iterdir() if folder.is_dir() else ():
        name = digits.fullmatch(path.name)
        if name and path == numbered(pattern, int(name[1])):
            yield int(name[1])


def numbered_files(pattern: Path) -> Iterator[Path]:
    """Yield the existing images of a sequence, unsorted."""
    return (numbered(pattern, number) for number in numbers_of(pattern))


def numbered(pattern: Path, number: int) -> Path:
    """Return the name of the image with a number.

    >>> numbered(Path("shots/f%04d.png"), 7).as_posix(), numbered(Path("%d.jpg"), 12).as_posix()
    ('shots/f0007.png', '12.jpg')
    """
    before, zero, width, after = NUMBER_PATTERN.split(pattern.name)
    return pattern.with_name(f"{before}{number:0{int(width or 1) if zero else 1}}{after}")


def may_share_a_name(a: str | Path, b: str | Path) -> bool:
    """Return whether images of two sequences may have the same name.

    >>> may_share_a_name("f%04d.png", "./f%03d.png"), may_share_a_name("f%d.png", "out/f%d.png")
    (True, False)
    """
    first, second = Path(a), Path(b)
    (prefix, *_, suffix), (other_prefix, *_, other_suffix) = (
        NUMBER_PATTERN.split(first.name),
        NUMBER_PATTERN.split(second.name),
    )
    if not is_same_file(first.parent, second.parent) or suffix != other_suffix:
        return False
    return prefix.startswith(other_prefix) or other_prefix.startswith(prefix)


@contextmanager
def standard_input() -> Iterator[Path]:
    """Yield a temporary file with the whole standard input: the index may be at its end.

    Raises
    ------
    MediaError
        If the input is empty, exceeds :data:`MAX_INPUT_BYTES`, or is a terminal.
    """
    if sys.stdin is None or sys.stdin.isatty():
        raise MediaError("standard input must be a video; got a terminal")
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        path, size = Path(folder) / "standard input", 0
        with path.open("wb") as file:
            while piece := sys.stdin.buffer.read(CHUNK_BYTES):
                size += len(piece)
                if size > MAX_INPUT_BYTES:
                    raise MediaError(
                        f"standard input must have at most {MAX_INPUT_BYTES >> 30} GB; specify a file name instead"
                    )
                file.write(piece)
        if not size:
            raise MediaError("standard input must be a video; got no data")
        yield path
