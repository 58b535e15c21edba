"""Uploads: sanitised file names, and images whose size is checked before decompression."""

from __future__ import annotations

import io
import re
import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.errors import MediaError
from ...io import images
from ...io.image_metadata import ImageMetadata, embed_metadata
from ...io.images import read_image_and_metadata

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile
    from starlette.requests import Request

MAX_DECODED_BYTES = 256 << 20
"""Maximum size of a decoded image in memory, bytes."""
STRIP = 256
"""Rows per conversion step."""
BITS_PER_SAMPLE = 258  # TIFF tag
KINDS = {
    "PNG": ".png",
    "JPEG": ".jpg",
    "TIFF": ".tif",
    "WEBP": ".webp",
    "BMP": ".bmp",
    "GIF": ".gif",
    "PPM": ".pnm",
}


async def uploaded_file(request: Request) -> bytes:
    """Return the uploaded file of a request.

    Raises
    ------
    MediaError
        If the request is empty.
    """
    data = await request.body()
    if not data:
        raise MediaError("the uploaded file is empty")
    return data


def safe_name(name: str) -> str:
    """Return the last component of a name, reduced to characters that are safe in messages and on
    command lines.

    >>> safe_name("../../etc/pass wd"), safe_name("C:\\\\rooms\\\\hall.toml"), safe_name("..")
    ('pass_wd', 'hall.toml', 'file')
    """
    last = re.split(r"[\\/]", name)[-1]
    return re.sub(r"[^\w.-]", "_", last).strip("._-")[:80] or "file"


def browser_image(data: bytes, name: str, *, stored_orientation: bool = False) -> bytes:
    """Convert an image that browsers cannot read (TIFF, 16 bits, ...) to 8-bit PNG with its EXIF
    data.

    Raises
    ------
    MediaError
        If the format is unknown, or the image damaged or too large after decoding.
    """
    return png_of(*uploaded(data, name, stored_orientation=stored_orientation))


def image_in(data: bytes, name: str, *, stored_orientation: bool = False) -> NDArray[Any]:
    """Decode an uploaded image of any format, as :func:`uploaded` without its metadata."""
    return uploaded(data, name, stored_orientation=stored_orientation)[0]


def uploaded(
    data: bytes, name: str, *, stored_orientation: bool = False
) -> tuple[NDArray[Any], ImageMetadata]:
    """Decode an uploaded image of any format, with its metadata; ``stored_orientation`` as for
    :func:`omnimirror.read_image`.

    The decoded size is computed from the header and checked before decompression.

    Raises
    ------
    MediaError
        If the format is unknown, or the image damaged or too large after decoding.
    """
    suffix = _checked_kind(data, name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"image{suffix}"
        path.write_bytes(data)
        try:
            return read_image_and_metadata(path, stored_orientation=stored_orientation)
        except MediaError as e:
            raise MediaError(str(e).replace(str(path), name)) from None


def encoded(image: NDArray[np.uint8], suffix: str, quality: int = 90) -> bytes:
    """Encode a grey, RGB or RGBA image as a file."""
    parameters = (
        [cv2.IMWRITE_JPEG_QUALITY, quality]
        if suffix == ".jpg"
        else [cv2.IMWRITE_PNG_COMPRESSION, 2]
    )
    return images.encoded(image, suffix, parameters)


def png_of(image: NDArray[np.generic], metadata: ImageMetadata) -> bytes:
    """Encode an image as 8-bit PNG with its EXIF data, which restoration requires."""
    data = encoded(eight_bits(image), ".png")
    return (
        data
        if metadata.exif is None
        else embed_metadata(".png", data, ImageMetadata(exif=metadata.exif))
    )


def eight_bits(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Convert an image to 8 bits; floating-point values range from 0 to 1."""
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    scale = 255.0 if image.dtype.kind == "f" else 255.0 / 65535
    shallow = np.empty(image.shape, np.uint8)
    for start in range(0, len(image), STRIP):
        strip = np.nan_to_num(image[start : start + STRIP].astype(np.float64) * scale)
        shallow[start : start + STRIP] = strip.clip(0, 255).round()
    return shallow


def _checked_kind(data: bytes, name: str) -> str:
    """Check the decoded size in the image header; return the suffix of the format."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # Pillow warns of large or damaged images; both are rejected below
            with Image.open(io.BytesIO(data), formats=list(KINDS)) as image:
                kind, unpacked = str(image.format), _unpacked_bytes(image, data)
        is_huge = unpacked > MAX_DECODED_BYTES
    except Image.DecompressionBombError:
        is_huge = True
    except (OSError, ValueError, SyntaxError):  # OSError includes unknown formats
        raise MediaError(
            f"{name} must be an image in a supported format ({', '.join(KINDS)})"
        ) from None
    if is_huge:
        raise MediaError(
            f"the decoded pixels of {name} must take at most {MAX_DECODED_BYTES >> 20} MB"
        )
    return KINDS[kind]


def _unpacked_bytes(file: ImageFile, data: bytes) -> int:
    """Return the decoded size of an image in bytes, from its header."""
    width, height = file.size
    channels = (
        4 if file.mode in ("P", "PA") else len(file.getbands())
    )  # palettes are expanded to colours
    depth = 8
    if file.format == "PNG":
        depth = data[24]
    elif file.format == "TIFF":
        depth = max(file.tag_v2.get(BITS_PER_SAMPLE, (8,)))  # type: ignore[attr-defined]  # a TIFF file
    elif file.format == "PPM":
        depth = 16  # maximum value up to 65535
    return width * height * channels * -(-depth // 8)
