"""Files: read whole, never more than was allowed; written whole, or not touched."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import OmnimirrorError

LARGEST_TEXT = 64 << 20
"""Bytes of a table, a sensor file or the like; a million points of a measured profile are half of it."""
SMALLEST_BUFFER = 1 << 20


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary name beside ``path`` that takes its place when the block ends without an error.

    The temporary name keeps the suffix, which picture writers look at. Missing folders are made.

    Raises
    ------
    OmnimirrorError
        The folder cannot be written, or the disk is full; an earlier file at ``path`` is left as it was.
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(21, "it is a folder, and a file name is needed")
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:60]}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
        temporary = None
    except OSError as e:
        raise OmnimirrorError(f"cannot write {path}: {e.strerror or e}") from None
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()


def read_bytes(path: str | Path, most: int) -> bytes:
    """The bytes of an ordinary file of at most so many.

    A pipe would keep its reader waiting and a device may never end, so both are refused unread.

    Raises
    ------
    OSError
        There is no such file, it is no ordinary one, or larger; ``strerror`` says which.
    """
    try:
        found = os.stat(path)
    except ValueError:  # a null character in the name
        raise OSError(errno.EINVAL, "no file can have that name") from None
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is a pipe or a device, and a file is needed")
    # files made as they are read, as in /proc, say that they are empty
    room = min(most, max(found.st_size, SMALLEST_BUFFER))
    with open(path, "rb") as file:
        data = file.read(room + 1)
    if found.st_size > most or len(data) > room:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MB, which is the most that is read")
    return data


def read_text(
    path: str | Path, noun: str, error: type[OmnimirrorError] = OmnimirrorError, absent: str | None = None
) -> str:
    """The text of an ordinary file in UTF-8, with or without a byte order mark.

    Parameters
    ----------
    path
    noun
        What the file is, for messages: "sensor file".
    error
        Raised where it cannot be read.
    absent
        The sentence where there is no such file, in place of the operating system's.

    Raises
    ------
    OmnimirrorError
        There is no such file, it is a folder, a pipe or a device, larger than :data:`LARGEST_TEXT`, or no text.
    """
    try:
        return read_bytes(path, LARGEST_TEXT).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError as e:
        raise error(absent or f"cannot read the {noun} {path}: {e.strerror}") from None
    except OSError as e:
        raise error(f"cannot read the {noun} {path}: {e.strerror or e}") from None
    except UnicodeDecodeError:
        raise error(f"cannot read the {noun} {path}: it is not a text file") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole, or leave an earlier one as it was."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
