"""Boxes of MP4 and MOV files (ISO/IEC 14496-12), and the index at the end of a finished file."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from ....base.errors import MediaError


def change_index(path: Path, change: Callable[[bytes], bytes]) -> None:
    """Change the body of the index (``moov``) at the end of a finished file, in place.

    Raises
    ------
    MediaError
        The file has no index at its end.
    OSError
        The file cannot be written.
    """
    with path.open("r+b") as file:
        at = _last_box(file)
        file.seek(at)
        kind, index = next(boxes(file.read()))
        if kind != b"moov":
            raise MediaError(f"{path} has no index at its end, where it could be changed")
        changed = change(index)
        if changed != index:
            file.seek(at)
            file.write(box(b"moov", changed))
            file.truncate()


def _last_box(file: BinaryIO) -> int:
    """Return the offset of the last box of a file; only headers are read, since bodies may be
    large.
    """
    end = file.seek(0, os.SEEK_END)
    at = last = 0
    while at < end:
        last = at
        file.seek(at)
        head = file.read(16)
        size = int.from_bytes(head[:4], "big")
        if size == 1:
            size = int.from_bytes(head[8:16], "big")
        at = at + size if size >= 8 else end
    return last


def is_video(track: bytes) -> bool:
    """Return whether the body of a ``trak`` box is that of a video track."""
    media = dict(boxes(dict(boxes(track))[b"mdia"]))
    return media[b"hdlr"][8:12] == b"vide"


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kinds and bodies of consecutive boxes; four zero bytes may end them (QuickTime)."""
    at = 0
    while at + 8 <= len(data):
        size, head = int.from_bytes(data[at : at + 4], "big"), 8
        if size == 1:
            size, head = int.from_bytes(data[at + 8 : at + 16], "big"), 16
        elif size == 0:
            size = len(data) - at
        if size < head:
            return
        yield data[at + 4 : at + 8], data[at + head : at + size]
        at += size


def box(kind: bytes, body: bytes) -> bytes:
    """Return a box of a kind."""
    return struct.pack(">I", 8 + len(body)) + kind + body


def inside(body: bytes, path: list[bytes], change: Callable[[bytes], bytes]) -> bytes:
    """Return the body of a box with the first box at a path of kinds changed."""
    if not path:
        return change(body)
    parts, is_done = [], False
    for kind, part in boxes(body):
        if kind == path[0] and not is_done:
            part, is_done = inside(part, path[1:], change), True
        parts.append(box(kind, part))
    return b"".join(parts)
