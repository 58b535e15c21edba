"""EXIF metadata: parsing, writing without entries that are invalid for a dewarped image, and
orientation of the stored pixels.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

# -- EXIF directories ------------------------------------------------------------------------------
#
# An EXIF block is a TIFF file without pixels: a directory of tags, and two more, for exposure and GPS
# position. Entries on the stored pixels (orientation, size, thumbnail, resolution), on positions in
# the image, and entries that cannot be relocated (maker notes with their own offsets) are dropped.

EXPOSURE, PLACE = 0x8769, 0x8825
"""Tags of the offsets of the two other directories."""
KEPT_IMAGE_TAGS = frozenset({0x010E, 0x010F, 0x0110, 0x0132, 0x013B, 0x8298})
"""Tags kept from the first directory: description, make, model, time, artist and copyright."""
DROPPED_EXPOSURE_TAGS = frozenset({0x927C, 0x9214, 0xA002, 0xA003, 0xA005, 0xA214, 0xA405, 0xEA1C})
"""Dropped tags of the exposure: maker notes, positions in the image, its size, other directories,
focal length in 35 mm film.
"""
TYPE_SIZES = {
    1: (1, 1), 2: (1, 1), 3: (2, 2), 4: (4, 4), 5: (8, 4), 6: (1, 1),
    7: (1, 1), 8: (2, 2), 9: (4, 4), 10: (8, 4), 11: (4, 4), 12: (8, 8),
}  # fmt: skip
"""Size of a value of each type in bytes, and of the units to which the byte order applies."""
MAX_ENTRIES = 1000


F_NUMBER, SUBJECT_DISTANCE = 0x829D, 0x9206
"""Aperture, and distance of the plane in focus in metres."""
INFINITE = 0xFFFFFFFF
NUMBERS = {3: "<H", 4: "<I", 5: "<II", 10: "<ii", 11: "<f", 12: "<d"}
"""Forms of numbers, by type; the specification requires 5, and some programs write others."""


class Entry(NamedTuple):
    """Values of a tag, in little-endian byte order."""

    kind: int
    number: int
    values: bytes


Directory = dict[int, Entry]


class Exif(NamedTuple):
    """EXIF entries that are valid for a dewarped image."""

    image: Directory
    exposure: Directory
    place: Directory

    def block(self) -> bytes:
        """Return the block for JPEG, PNG and WebP."""
        head = 8
        first = self.image | {tag: Entry(4, 1, bytes(4)) for tag in self._others}
        end = head + len(serialised_directory(first, head))
        pointers, rest = {}, b""
        for tag, directory in self._others.items():
            pointers[tag] = Entry(4, 1, struct.pack("<I", end + len(rest)))
            rest += serialised_directory(directory, end + len(rest))
        return (
            b"II*\0"
            + struct.pack("<I", head)
            + serialised_directory(self.image | pointers, head)
            + rest
        )

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

    >>> from omnimirror.io.exif import Entry, Exif
    >>> exposure_of(Exif({}, {0x829D: Entry(5, 1, struct.pack("<II", 56, 10))}, {})).f_number
    5.6
    """
    if exif is None:
        return Exposure()
    f_number, metres = (_number(exif.exposure.get(tag)) for tag in (F_NUMBER, SUBJECT_DISTANCE))
    finite = f_number if f_number is not None and f_number != float("inf") else None
    return Exposure(finite, None if metres is None else 1000 * metres)


def _number(entry: Entry | None) -> float | None:
    """Return a positive number, or infinity as encoded by EXIF; None for unknown (0) or invalid
    values.
    """
    form = None if entry is None else NUMBERS.get(entry.kind)
    if entry is None or form is None or len(entry.values) != struct.calcsize(form):
        return None
    numerator, denominator = (*struct.unpack(form, entry.values), 1)[:2]
    if form == "<II" and numerator == INFINITE:
        return float("inf")
    number = numerator / denominator if denominator else 0.0
    return number if 0 < number < float("inf") else None


def parse_exif(block: bytes) -> Exif | None:
    """Parse the valid entries of a block or of a TIFF file; None if it is damaged or has none.

    >>> from omnimirror.io.exif import Entry, Exif
    >>> exif = Exif({0x010F: Entry(2, 5, b"Ours\\0"), 0x0112: Entry(3, 1, b"\\6\\0")}, {}, {})
    >>> parse_exif(exif.block()).image  # without the orientation
    {271: Entry(kind=2, number=5, values=b'Ours\\x00')}
    """
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None:
        return None
    try:
        first = _directory(block, order, struct.unpack_from(order + "I", block, 4)[0])
        exposure, location = (
            _directory(block, order, struct.unpack("<I", first[tag].values)[0])
            if tag in first
            else {}
            for tag in (EXPOSURE, PLACE)
        )
    except (struct.error, KeyError, ValueError):
        return None
    tags = {tag: entry for tag, entry in first.items() if tag in KEPT_IMAGE_TAGS}
    exposure = {tag: entry for tag, entry in exposure.items() if tag not in DROPPED_EXPOSURE_TAGS}
    return Exif(tags, exposure, location) if tags or exposure or location else None


def serialised_directory(directory: Directory, at: int) -> bytes:
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
    if count > MAX_ENTRIES:
        raise ValueError(count)
    entries: Directory = {}
    for i in range(count):
        offset = at + 2 + 12 * i
        tag, kind, number = struct.unpack_from(order + "HHI", block, offset)
        size, unit = TYPE_SIZES[kind]
        length = size * number
        start = offset + 8 if length <= 4 else struct.unpack_from(order + "I", block, offset + 8)[0]
        data = block[start : start + length]
        if len(data) != length:
            raise ValueError(tag)
        if order == ">" and unit > 1:
            data = b"".join(data[k : k + unit][::-1] for k in range(0, length, unit))
        entries[tag] = Entry(kind, number, data)
    return entries


# -- Orientation of the stored pixels (tag 0x0112) -------------------------------------------------

Pixels = TypeVar("Pixels", bound=np.generic)

ORIENTATION_TAG = 0x0112
UPRIGHT = 1
SHORT, LONG = 3, 4
TIFF_SIGNATURES = {
    b"II*\0": ("<", False),
    b"MM\0*": (">", False),
    b"II+\0": ("<", True),
    b"MM\0+": (">", True),
}
"""Byte order and whether it is a BigTIFF file, by signature."""
ORIENTATION_NAMES = {
    1: "as stored",
    2: "mirrored left to right",
    3: "rotated by 180 deg",
    4: "mirrored top to bottom",
    5: "mirrored along the diagonal from top left to bottom right",
    6: "rotated by 90 deg clockwise",
    7: "mirrored along the diagonal from top right to bottom left",
    8: "rotated by 90 deg counter-clockwise",
}
"""Operation that each orientation requires for display."""
STORED_ORIENTATION_HINT = (
    "--set input.stored_orientation=true (stored_orientation=True in Python) keeps the stored "
    "orientation"
)
TRANSPOSING_ORIENTATIONS = (5, 6, 7, 8)
"""Orientations that exchange width and height."""


def oriented(image: NDArray[Pixels], orientation: int) -> NDArray[Pixels]:
    """Return a view of an image with an orientation applied; the first two axes are rows and
    columns.

    >>> oriented(np.array([[1, 2, 3], [4, 5, 6]]), 6).tolist()
    [[4, 1], [5, 2], [6, 3]]
    """
    view: NDArray[Any] = (
        np.swapaxes(image, 0, 1) if orientation in TRANSPOSING_ORIENTATIONS else image
    )
    if orientation in (2, 3, 6, 7):
        view = view[:, ::-1]
    if orientation in (3, 4, 7, 8):
        view = view[::-1]
    return view


def applied(orientation: int, is_stored: bool) -> str:
    """Return a phrase that reports an orientation other than 1, and the option for the other
    choice.

    >>> applied(3, True)
    'as stored; the EXIF orientation is: rotated by 180 deg'
    """
    if is_stored:
        return f"as stored; the EXIF orientation is: {ORIENTATION_NAMES[orientation]}"
    return f"{ORIENTATION_NAMES[orientation]} according to EXIF; {STORED_ORIENTATION_HINT}"


def orientation_of_block(block: bytes) -> int:
    """Return the orientation, 1 to 8, in an EXIF block or a TIFF file; 1 if there is none, or no
    valid one.
    """
    return _found(block)[0]


def without_orientation(data: bytes) -> bytes:
    """Return a TIFF file with orientation 1, which prevents decoders from rotating its pixels."""
    orientation, at, kind = _found(data)
    if orientation == UPRIGHT:
        return data
    return data[:at] + struct.pack(kind, UPRIGHT) + data[at + struct.calcsize(kind) :]


def _found(block: bytes) -> tuple[int, int, str]:
    """Return the orientation in the first directory of a TIFF structure, its offset and type."""
    default = UPRIGHT, 0, "<H"
    if block[:4] not in TIFF_SIGNATURES:
        return default
    order, is_big = TIFF_SIGNATURES[block[:4]]
    size, head, value = (20, 8, 12) if is_big else (12, 2, 8)
    try:
        (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), block, 8 if is_big else 4)
        (count,) = struct.unpack_from(order + ("Q" if is_big else "H"), block, at)
        for entry in range(at + head, at + head + size * min(count, 4096), size):
            tag, kind = struct.unpack_from(order + "HH", block, entry)
            if tag == ORIENTATION_TAG and kind in (SHORT, LONG):
                number = order + ("H" if kind == SHORT else "I")
                (orientation,) = struct.unpack_from(number, block, entry + value)
                return (
                    (orientation, entry + value, number)
                    if orientation in ORIENTATION_NAMES
                    else default
                )
    except struct.error:
        pass
    return default
