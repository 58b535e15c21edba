"""JPEG coding parameters: quantisation tables and chroma subsampling (ITU-T T.81)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import MediaError
from ..base.files import read_bytes
from .images import MAX_FILE_BYTES

BLOCK = 8
START_OF_SCAN, TABLES = 0xDA, 0xDB
SUPPORTED_FRAMES = {0xC0, 0xC1, 0xC2, 0xC9, 0xCA}  # baseline, extended, progressive
MARKERS_WITHOUT_SEGMENT = {0x01, *range(0xD0, 0xD9)}


class JpegCoding(NamedTuple):
    """Coding parameters of an image."""

    tables: tuple[NDArray[np.float64], ...]
    """Quantisation steps (8, 8) of Y, or of Y, Cb and Cr: by vertical and horizontal frequency."""
    subsampling: tuple[int, int] = (1, 1)
    """Chroma subsampling: luma pixels per chroma sample, vertically and horizontally."""


def read_jpeg_coding(path: str | Path) -> JpegCoding | None:
    """Read the coding of a file; None if it is not a JPEG file of grey or Y, Cb, Cr.

    Raises
    ------
    MediaError
        The file does not exist, or cannot be read.
    """
    try:
        return parse_jpeg_coding(read_bytes(path, MAX_FILE_BYTES))
    except OSError as e:
        raise MediaError(f"cannot read the image {path}: {e.strerror or e}") from None


def parse_jpeg_coding(data: bytes) -> JpegCoding | None:
    """Read the coding of the bytes of a JPEG file; None for other files, and for colours other than
    grey or Y, Cb, Cr.

    >>> import cv2
    >>> data = cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 50])[1].tobytes()
    >>> coding = parse_jpeg_coding(data)
    >>> coding.tables[0][0, :4], coding.subsampling
    (array([16., 11., 10., 16.]), (2, 2))
    """
    if not data.startswith(b"\xff\xd8\xff"):
        return None
    tables_by_number: dict[int, NDArray[np.float64]] = {}
    frame = b""
    for marker, segment in _segments(data):
        if marker == TABLES:
            tables_by_number |= _tables(segment)
        elif marker in SUPPORTED_FRAMES:
            frame = segment
    count = frame[5] if len(frame) > 5 else 0
    parts = [frame[6 + 3 * i : 9 + 3 * i] for i in range(count)]
    names = bytes(part[0] for part in parts if part)
    if (
        count not in (1, 3)
        or names == b"RGB"
        or any(len(part) < 3 or part[2] not in tables_by_number for part in parts)
    ):
        return None
    tables = tuple(tables_by_number[part[2]] for part in parts)
    finest, coarse = parts[0][1], parts[-1][1]
    across, down = (finest >> 4) / max(coarse >> 4, 1), (finest & 15) / max(coarse & 15, 1)
    if not (across in (1, 2, 4) and down in (1, 2, 4)):
        return None
    return JpegCoding(tables, (int(down), int(across)))


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield markers with their segments, up to the first scan."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != START_OF_SCAN:
        marker = data[at + 1]
        if marker == 0xFF or marker in MARKERS_WITHOUT_SEGMENT:
            at += 1 if marker == 0xFF else 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        yield marker, data[at + 4 : at + 2 + length]
        at += 2 + length


def _tables(segment: bytes) -> dict[int, NDArray[np.float64]]:
    tables = {}
    while segment:
        wide, number = segment[0] >> 4, segment[0] & 15
        size = BLOCK**2 * (2 if wide else 1)
        steps = np.frombuffer(segment[1 : 1 + size], ">u2" if wide else "u1")
        if len(steps) < BLOCK**2:
            break
        table = np.empty((BLOCK, BLOCK))
        table.ravel()[ZIGZAG] = steps
        tables[number] = np.maximum(table, 1.0)
        segment = segment[1 + size :]
    return tables


def _zigzag() -> NDArray[np.intp]:
    """Return the position in a block, row by row, of each of the 64 coefficients of a file (zigzag
    order).
    """
    rows, columns = np.divmod(np.arange(BLOCK**2), BLOCK)
    diagonal = rows + columns
    along = np.where(diagonal % 2, rows, columns)
    return np.lexsort((along, diagonal))


ZIGZAG = _zigzag()
