"""EXIF: what a camera noted of a picture, taken apart and put together again without what no longer holds.

An EXIF block is a TIFF file without pixels: a directory of tags, and two more, of the exposure and of the place. What
tells of the stored pixels (orientation, size, thumbnail, resolution), of places in them, or cannot be moved (notes of
the maker with offsets of their own) is left out.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

EXPOSURE, PLACE = 0x8769, 0x8825
"""Tags that point to the two other directories."""
OF_THE_PICTURE = frozenset({0x010E, 0x010F, 0x0110, 0x0132, 0x013B, 0x8298})
"""Description, make, model, time, artist and copyright: what is kept of the first directory."""
NO_LONGER = frozenset({0x927C, 0x9214, 0xA002, 0xA003, 0xA005, 0xA214, 0xA405, 0xEA1C})
"""Of the exposure: the maker's notes, places in the picture, its size, other directories, focal length at 35 mm."""
UNITS = {1: (1, 1), 2: (1, 1), 3: (2, 2), 4: (4, 4), 5: (8, 4), 6: (1, 1), 7: (1, 1), 8: (2, 2), 9: (4, 4), 10: (8, 4),
         11: (4, 4), 12: (8, 8)}  # fmt: skip
"""Bytes of a value of each type, and of the units in which they are ordered."""
MOST_ENTRIES = 1000


F_NUMBER, SUBJECT_DISTANCE = 0x829D, 0x9206
"""Aperture, and distance of the plane in focus in metres."""
RATIONAL, INFINITE = 5, 0xFFFFFFFF


class Entry(NamedTuple):
    """A tag's values, in the byte order of Intel."""

    kind: int
    number: int
    values: bytes


Directory = dict[int, Entry]


class Exif(NamedTuple):
    """What still holds of a straightened picture."""

    picture: Directory
    exposure: Directory
    place: Directory

    def block(self) -> bytes:
        """The block as JPEG, PNG and WebP carry it."""
        head = 8
        first = self.picture | {tag: Entry(4, 1, bytes(4)) for tag in self._others}
        end = head + len(written(first, head))
        pointers, rest = {}, b""
        for tag, directory in self._others.items():
            pointers[tag] = Entry(4, 1, struct.pack("<I", end + len(rest)))
            rest += written(directory, end + len(rest))
        return b"II*\0" + struct.pack("<I", head) + written(self.picture | pointers, head) + rest

    @property
    def _others(self) -> dict[int, Directory]:
        return {tag: d for tag, d in ((EXPOSURE, self.exposure), (PLACE, self.place)) if d}


class Exposure(NamedTuple):
    """Settings of the lens for an exposure; None where EXIF does not contain them."""

    f_number: float | None = None
    focus_distance_mm: float | None = None
    """From the camera to the plane in focus; infinity is possible."""


def exposure_of(exif: Exif | None) -> Exposure:
    """Return the settings of the lens that EXIF contains.

    >>> from omnimirror.io.pictures.exif import Entry, Exif
    >>> exposure_of(Exif({}, {0x829D: Entry(5, 1, struct.pack("<II", 56, 10))}, {})).f_number
    5.6
    """
    if exif is None:
        return Exposure()
    f_number, metres = (_rational(exif.exposure.get(tag)) for tag in (F_NUMBER, SUBJECT_DISTANCE))
    finite = f_number if f_number is not None and f_number != float("inf") else None
    return Exposure(finite, None if metres is None else 1000 * metres)


def _rational(entry: Entry | None) -> float | None:
    """Return a positive number, or infinity as EXIF notes it; None for unknown (0) or invalid values."""
    if entry is None or entry.kind != RATIONAL or len(entry.values) != 8:
        return None
    above, below = struct.unpack("<II", entry.values)
    if above == INFINITE:
        return float("inf")
    return above / below if above and below else None


def parse_exif(block: bytes) -> Exif | None:
    """What still holds of a block, or of a TIFF file; None where it is damaged, or nothing does.

    >>> from omnimirror.io.pictures.exif import Entry, Exif
    >>> made = Exif({0x010F: Entry(2, 5, b"Ours\\0"), 0x0112: Entry(3, 1, b"\\6\\0")}, {}, {})
    >>> parse_exif(made.block()).picture  # the orientation of the stored pixels does not hold
    {271: Entry(kind=2, number=5, values=b'Ours\\x00')}
    """
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None:
        return None
    try:
        first = _directory(block, order, struct.unpack_from(order + "I", block, 4)[0])
        exposure, place = (
            _directory(block, order, struct.unpack("<I", first[tag].values)[0]) if tag in first else {}
            for tag in (EXPOSURE, PLACE)
        )
    except (struct.error, KeyError, ValueError):
        return None
    picture = {tag: entry for tag, entry in first.items() if tag in OF_THE_PICTURE}
    exposure = {tag: entry for tag, entry in exposure.items() if tag not in NO_LONGER}
    return Exif(picture, exposure, place) if picture or exposure or place else None


def written(directory: Directory, at: int) -> bytes:
    """The bytes of a directory that begins at a place of the file, its values behind it."""
    values_at = at + 2 + 12 * len(directory) + 4
    entries, values = b"", b""
    for tag, (kind, number, data) in sorted(directory.items()):
        inline = len(data) <= 4
        field = data.ljust(4, b"\0") if inline else struct.pack("<I", values_at + len(values))
        entries += struct.pack("<HHI", tag, kind, number) + field
        values += b"" if inline else data + b"\0" * (len(data) % 2)
    return struct.pack("<H", len(directory)) + entries + bytes(4) + values


def _directory(block: bytes, order: str, at: int) -> Directory:
    (count,) = struct.unpack_from(order + "H", block, at)
    if count > MOST_ENTRIES:
        raise ValueError(count)
    found: Directory = {}
    for i in range(count):
        place = at + 2 + 12 * i
        tag, kind, number = struct.unpack_from(order + "HHI", block, place)
        size, unit = UNITS[kind]
        length = size * number
        start = place + 8 if length <= 4 else struct.unpack_from(order + "I", block, place + 8)[0]
        data = block[start : start + length]
        if len(data) != length:
            raise ValueError(tag)
        if order == ">" and unit > 1:
            data = b"".join(data[k : k + unit][::-1] for k in range(0, length, unit))
        found[tag] = Entry(kind, number, data)
    return found
