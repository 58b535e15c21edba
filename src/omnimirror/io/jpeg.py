"""JPEG coding parameters: quantisation tables and chroma subsampling (ITU-T T.81)."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import MediaError
from ..base.files import read_bytes
from .images import MAX_FILE_BYTES

BLOCK = 8


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
        If the file does not exist, or cannot be read.
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
    from PIL.JpegImagePlugin import JpegImageFile

    if not data.startswith(b"\xff\xd8\xff"):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged EXIF data
            with JpegImageFile(io.BytesIO(data)) as image:
                tables_by_number, components = image.quantization, image.layer
    except (SyntaxError, ValueError, OSError):  # damaged
        return None
    names = bytes(name for name, *_ in components)
    numbers = [number for *_, number in components]
    if (
        len(components) not in (1, 3)
        or names == b"RGB"
        or any(number not in tables_by_number for number in numbers)
    ):
        return None
    tables = tuple(
        np.maximum(np.array(tables_by_number[number], float).reshape(BLOCK, BLOCK), 1.0)
        for number in numbers
    )
    (_, luma_x, luma_y, _), (_, chroma_x, chroma_y, _) = components[0], components[-1]
    across, down = luma_x / max(chroma_x, 1), luma_y / max(chroma_y, 1)
    if not (across in (1, 2, 4) and down in (1, 2, 4)):
        return None
    return JpegCoding(tables, (int(down), int(across)))
