"""Uploads: sanitised file names, and images whose size is checked before decompression."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.errors import MediaError
from ...io import exr, images
from ...io.image_metadata import ImageMetadata, embed_metadata
from ...io.images import decode_image_and_metadata

if TYPE_CHECKING:
    from starlette.requests import Request

MAX_DECODED_BYTES = 512 << 20
"""Maximum size of a decoded image in memory, bytes."""
STRIP = 256
"""Rows per conversion step."""


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


def browser_image(
    data: bytes, name: str, *, stored_orientation: bool = False, max_side_px: int | None = None
) -> tuple[bytes, tuple[int, int]]:
    """Convert an image that browsers cannot read (TIFF, 16 bits, HDR, ...) to an 8-bit PNG with its
    EXIF data.

    Parameters
    ----------
    data, name
        Uploaded file and its name.
    stored_orientation
        As for :func:`omnimirror.read_image`.
    max_side_px
        Maximum width and height of the PNG; larger images are reduced.

    Returns
    -------
    bytes
        PNG file.
    (int, int)
        Width and height of the original image, px.

    Raises
    ------
    MediaError
        If the format is unknown, or the image damaged or too large after decoding.
    """
    image, metadata = uploaded(data, name, stored_orientation=stored_orientation)
    height, width = image.shape[:2]
    if is_radiance(data):
        image = display_levels(image)
    if max_side_px is not None and max(width, height) > max_side_px:
        scale = max_side_px / max(width, height)
        size = max(1, round(width * scale)), max(1, round(height * scale))
        image = cv2.resize(eight_bits(image), size, interpolation=cv2.INTER_AREA)
    return png_of(image, metadata), (width, height)


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
    size = images.decoded_bytes(data)
    if size > MAX_DECODED_BYTES:
        raise MediaError(
            f"the decoded pixels of {name} must take at most {MAX_DECODED_BYTES >> 20} MB; got "
            f"{-(-size >> 20)} MB; reduce the image, or use the command line"
        )
    if not size:  # the header is not understood: nothing is decoded
        raise MediaError(images.decoding_failure(name, data))
    return decode_image_and_metadata(name, data, stored_orientation=stored_orientation)


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


def is_radiance(data: bytes) -> bool:
    """Return True for the bytes of a file with linear light values (Radiance HDR, OpenEXR)."""
    return data.startswith((b"#?", exr.MAGIC))


def display_levels(radiance: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert linear light to 8 bits with gamma 2; the brightest 1 % is clipped."""
    from ...calibration.edge_detection import levels_of

    levels: NDArray[np.uint8] = np.rint(levels_of(radiance)).astype(np.uint8)
    return levels


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
