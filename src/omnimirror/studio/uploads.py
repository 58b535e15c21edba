"""What is handed up: taken in pieces, never more than was allowed, and looked at before it is unpacked."""

from __future__ import annotations

import io
import re
import tempfile
import warnings
from collections.abc import AsyncIterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import MediaError
from ..media import images, read_image

LARGEST_CALIBRATION = 1 << 20
LARGEST_PICTURE = 128 << 20
MOST_PIXELS = 100_000_000
KINDS = {"PNG": ".png", "JPEG": ".jpg", "TIFF": ".tif", "WEBP": ".webp", "BMP": ".bmp"}


class TooLarge(MediaError):
    """More was handed up than is allowed."""


async def collected(pieces: AsyncIterator[bytes], most: int, announced: str | None) -> bytes:
    """All pieces, given up as soon as they are more than ``most`` bytes or announce that they will be.

    Raises
    ------
    TooLarge
        They are.
    MediaError
        Nothing came.
    """
    refusal = TooLarge(f"the file is larger than {_words(most)}, which is the most that is taken here")
    if announced is not None and announced.isdigit() and int(announced) > most:
        raise refusal
    data = bytearray()
    async for piece in pieces:
        data += piece
        if len(data) > most:
            raise refusal
    if not data:
        raise MediaError("the file is empty")
    return bytes(data)


def safe_name(name: str) -> str:
    """The last part of a name, of harmless characters, for people and for command lines.

    >>> safe_name("../../etc/pass wd"), safe_name("C:\\\\rooms\\\\hall.toml"), safe_name("..")
    ('pass_wd', 'hall.toml', 'file')
    """
    last = re.split(r"[\\/]", name)[-1]
    return re.sub(r"[^\w.-]", "_", last).strip("._-")[:80] or "file"


def browser_picture(data: bytes, name: str) -> bytes:
    """A picture that browsers do not read (TIFF, 16 bits ..) as 8-bit PNG.

    Its size is read from its header, and refused, before anything is unpacked.

    Raises
    ------
    MediaError
        It is no picture, is damaged, or would unfold to too many pixels.
    """
    suffix = _checked_kind(data, name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{suffix}"
        path.write_bytes(data)
        try:
            image = read_image(path)
        except MediaError as e:
            raise MediaError(str(e).replace(str(path), name)) from None
    return encoded(eight_bits(image), ".png")


def encoded(image: NDArray[np.uint8], suffix: str, quality: int = 90) -> bytes:
    """The bytes of a file of a picture, grey, RGB or RGBA."""
    parameters = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else [cv2.IMWRITE_PNG_COMPRESSION, 2]
    return images.encoded(image, suffix, parameters)


def eight_bits(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """The picture in 8 bits; floating values from 0 to 1."""
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    scale = 255.0 if image.dtype == np.float32 else 255.0 / 65535
    return (np.nan_to_num(image.astype(np.float32)) * scale).clip(0, 255).round().astype(np.uint8)


def _checked_kind(data: bytes, name: str) -> str:
    """The suffix of the picture's kind, once its header promises a reasonable size."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=list(KINDS)) as picture:
                kind, (width, height) = str(picture.format), picture.size
        is_huge = width * height > MOST_PIXELS
    except Image.DecompressionBombError:
        is_huge = True
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        raise MediaError(f"{name} is not a picture that can be read; valid are {', '.join(KINDS)}") from None
    if is_huge:
        raise MediaError(f"{name} unfolds to too many pixels; at most {MOST_PIXELS // 10**6} million are valid")
    return KINDS[kind]


def _words(size: int) -> str:
    return f"{size >> 20} MB" if size >= 1 << 20 else f"{size >> 10} kB"
