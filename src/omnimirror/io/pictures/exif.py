"""EXIF metadata: parsing, and writing without entries that are invalid for a dewarped image.

An EXIF block is a TIFF file without pixels: a directory of tags, and two more, for exposure and GPS
position. Entries on the stored pixels (orientation, size, thumbnail, resolution), on positions in
the image, and entries that cannot be relocated (maker notes with their own offsets) are dropped.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

EXPOSURE, PLACE = 0x8769, 0x8825
"""Tags of the offsets of the two other directories."""
OF_THE_PICTURE = frozenset({0x010E, 0x010F, 0x0110, 0x0132, 0x013B, 0x8298})
"""Tags kept from the first directory: description, make, model, time, artist and copyright."""
NO_LONGER = frozenset({0x927C, 0x9214, 0xA002, 0xA003, 0xA005, 0xA214, 0xA405, 0xEA1C})
"""Dropped tags of the exposure: maker notes, positions in the image, its size, other directories,
focal length in 35 mm film.
"""
UNITS = {1: (1, 1), 2: (1, 1), 3: (2, 2), 4: (4, 4), 5: (8, 4), 6: (1, 1), 7: (1, 1), 8: (2, 2), 9: (4, 4), 10: (8, 4),
         11: (4, 4), 12: (8, 8)}  # fmt: skip
"""Size of a value of each type in bytes, and of the units to which the byte order applies."""
MOST_ENTRIES = 1000


F_NUMBER, SUBJECT_DISTANCE = 0x829D, 0x9206
"""Aperture, and distance of the plane in focus in metres."""
RATIONAL, INFINITE = 5, 0xFFFFFFFF


class Entry(NamedTuple):
    """Values of a tag, in little-endian byte order."""

    kind: int
    number: int
    values: bytes


Directory = dict[int, Entry]


class Exif(NamedTuple):
    """EXIF entries that are valid for a dewarped image."""

    picture: Directory
    exposure: Directory
    place: Directory

    def block(self) -> bytes:
        """Return the block for JPEG, PNG and WebP."""
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
    """Settings of the lens for an exposure; None if EXIF does not contain them."""

    f_number: float | None = None
    focus_distance_mm: float | None = None
    """Distance from the camera to the plane in focus, possibly infinite."""


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
    """Return a positive number, or infinity as EXIF notes it; None for unknown (0) or invalid
    values.
    """
    if entry is None or entry.kind != RATIONAL or len(entry.values) != 8:
        return None
    above, below = struct.unpack("<II", entry.values)
    if above == INFINITE:
        return float("inf")
    return above / below if above and below else None


def parse_exif(block: bytes) -> Exif | None:
    """Parse the valid entries of a block or of a TIFF file; None if it is damaged or has none.

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
    """Return the bytes of a directory at an offset of the file, followed by its values."""
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
