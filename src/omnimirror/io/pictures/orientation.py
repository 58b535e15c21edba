"""Orientation of an image: how its stored pixels are turned or mirrored for display (EXIF, tag
0x0112).
"""

from __future__ import annotations

import struct
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Pixels = TypeVar("Pixels", bound=np.generic)

ORIENTATION = 0x0112
UPRIGHT = 1
SHORT, LONG = 3, 4
TIFF = {b"II*\0": ("<", False), b"MM\0*": (">", False), b"II+\0": ("<", True), b"MM\0+": (">", True)}
"""Byte order and whether it is a BigTIFF file, by signature."""
WORDS = {
    1: "as stored",
    2: "mirrored left to right",
    3: "turned by 180 deg",
    4: "mirrored top to bottom",
    5: "mirrored along the diagonal from top left to bottom right",
    6: "turned by 90 deg clockwise",
    7: "mirrored along the diagonal from top right to bottom left",
    8: "turned by 90 deg anticlockwise",
}
"""Operation that each orientation requires for display."""
STORED = "--stored-orientation (stored_orientation=True in Python) keeps the stored orientation"
QUARTER_TURNS = (5, 6, 7, 8)
"""Orientations that exchange width and height."""


def oriented(image: NDArray[Pixels], orientation: int) -> NDArray[Pixels]:
    """Return a view of an image with an orientation applied; the first two axes are rows and
    columns.

    >>> oriented(np.array([[1, 2, 3], [4, 5, 6]]), 6).tolist()
    [[4, 1], [5, 2], [6, 3]]
    """
    turned: NDArray[Any] = np.swapaxes(image, 0, 1) if orientation in QUARTER_TURNS else image
    if orientation in (2, 3, 6, 7):
        turned = turned[:, ::-1]
    if orientation in (3, 4, 7, 8):
        turned = turned[::-1]
    return turned


def applied(orientation: int, is_stored: bool) -> str:
    """Return a phrase that reports an orientation other than 1, and the option for the other
    choice.

    >>> applied(3, True)
    'as stored; their EXIF data requires that they are turned by 180 deg'
    """
    if is_stored:
        return f"as stored; their EXIF data requires that they are {WORDS[orientation]}"
    return f"{WORDS[orientation]}, as their EXIF data requires; {STORED}"


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
    nothing = UPRIGHT, 0, "<H"
    if block[:4] not in TIFF:
        return nothing
    order, is_big = TIFF[block[:4]]
    size, head, value = (20, 8, 12) if is_big else (12, 2, 8)
    try:
        (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), block, 8 if is_big else 4)
        (count,) = struct.unpack_from(order + ("Q" if is_big else "H"), block, at)
        for entry in range(at + head, at + head + size * min(count, 4096), size):
            tag, kind = struct.unpack_from(order + "HH", block, entry)
            if tag == ORIENTATION and kind in (SHORT, LONG):
                number = order + ("H" if kind == SHORT else "I")
                (orientation,) = struct.unpack_from(number, block, entry + value)
                return (orientation, entry + value, number) if orientation in WORDS else nothing
    except struct.error:
        pass
    return nothing
