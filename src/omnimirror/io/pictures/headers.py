"""Size of an image in memory, from the header of its file: a few bytes can declare gigabytes of
pixels.
"""

from __future__ import annotations

import io
import re
import struct
import warnings

from . import exr, png

LARGEST_DECODED = 2 << 30
"""Maximum size of the pixels of an image in bytes; OpenCV rejects more than 2^30 pixels on its own.
"""
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
RADIANCE = re.compile(rb"\n[-+][XY] +(\d+) +[-+][XY] +(\d+)\n")
TIFF = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
TAG_WIDTH, TAG_HEIGHT, TAG_BITS, TAG_SAMPLES = 256, 257, 258, 277
TIFF_NUMBERS = {3: "H", 4: "I", 16: "Q"}
BY_PILLOW = ("BMP", "GIF", "WEBP", "PPM", "JPEG2000", "AVIF")


def decoded_bytes(data: bytes) -> int:
    """Return the size in memory of the image in a file's bytes; 0 if the header is not understood.

    Parameters
    ----------
    data
        The whole file.

    Returns
    -------
    int
        Width times height times channels times bytes of a sample.

    Examples
    --------
    >>> import cv2, numpy as np
    >>> image = np.zeros((20, 30, 3), np.uint16)
    >>> [decoded_bytes(cv2.imencode(suffix, image)[1].tobytes()) for suffix in (".png", ".tif", ".ppm")]
    [3600, 3600, 3600]
    """
    try:
        if data.startswith(png.SIGNATURE):
            return png.decoded_bytes(data)
        if data.startswith(b"\xff\xd8\xff"):
            return _of_jpeg(data)
        if data[:4] in TIFF:
            return _of_tiff(data)
        if data.startswith(b"#?"):
            size = RADIANCE.search(data[:65536])
            return int(size[1]) * int(size[2]) * 3 * 4 if size else 0
        if data.startswith(exr.MAGIC):
            return exr.decoded_bytes(data)
    except (struct.error, IndexError, ValueError, KeyError):
        return 0
    return _by_pillow(data)


def _of_jpeg(data: bytes) -> int:
    at = 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker in JPEG_FRAMES:
            depth, height, width, channels = struct.unpack_from(">BHHB", data, at + 4)
            return int(width * height * channels * -(-depth // 8))
        at += 1 if marker == 0xFF else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return 0


def _of_tiff(data: bytes) -> int:
    """Read the first directory of a TIFF or BigTIFF file."""
    order, is_big = TIFF[data[:4]], data[:4] in (b"II+\0", b"MM\0+")
    (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), data, 8 if is_big else 4)
    (count,) = struct.unpack_from(order + ("Q" if is_big else "H"), data, at)
    size, head, room = (20, 8, 8) if is_big else (12, 2, 4)
    tags: dict[int, tuple[int, ...]] = {}
    for i in range(min(count, 4096)):
        entry = at + head + size * i
        tag, kind, length = struct.unpack_from(order + ("HHQ" if is_big else "HHI"), data, entry)
        if tag in (TAG_WIDTH, TAG_HEIGHT, TAG_BITS, TAG_SAMPLES) and kind in TIFF_NUMBERS and 1 <= length <= 64:
            numbers = struct.Struct(f"{order}{length}{TIFF_NUMBERS[kind]}")
            place = entry + size - room
            if numbers.size > room:
                (place,) = struct.unpack_from(order + ("Q" if is_big else "I"), data, place)
            tags[tag] = numbers.unpack_from(data, place)
    depth = max(tags.get(TAG_BITS, (1,)))
    (channels,) = tags.get(TAG_SAMPLES, (1,))[:1]
    return tags[TAG_WIDTH][0] * tags[TAG_HEIGHT][0] * channels * max(1, -(-depth // 8))


def _by_pillow(data: bytes) -> int:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=BY_PILLOW) as picture:
                width, height = picture.size
                is_palette, channels, kind = picture.mode in ("P", "PA"), len(picture.getbands()), picture.format
    except Image.DecompressionBombError:
        return LARGEST_DECODED + 1
    except Exception:  # damaged or of another type: the decoder reports the reason
        return 0
    is_deep = kind in ("PPM", "JPEG2000") and data[:2] not in (b"P1", b"P4")  # up to 16 bits
    return width * height * (4 if is_palette else channels) * (2 if is_deep else 1)
