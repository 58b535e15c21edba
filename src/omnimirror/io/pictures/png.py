"""What a PNG says of itself before it is unpacked: a damaged header must not cost the memory that it asks for."""

from __future__ import annotations

import struct
import zlib

SIGNATURE = b"\x89PNG\r\n\x1a\n"
HEADER_END = 33  # signature, length, "IHDR", 13 bytes, check sum
SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # of a pixel, by colour type
MOST_UNPACKED = 1032  # bytes that deflate makes of one: 258 by two bits


def damage(data: bytes) -> str:
    """What is wrong with the header of a PNG, in words that follow the name of the file; nothing if it may be right.

    >>> damage(SIGNATURE + bytes(25))
    'has a damaged header'
    """
    header = data[12 : HEADER_END - 4]
    if len(data) < HEADER_END or header[:4] != b"IHDR" or data[29:HEADER_END] != zlib.crc32(header).to_bytes(4, "big"):
        return "has a damaged header"
    width, height, depth, colour = struct.unpack(">IIBB", header[4:14])
    if width * height * depth * SAMPLES.get(colour, 1) > 8 * MOST_UNPACKED * len(data):
        return f"says that it has {width} x {height} px, and {len(data)} bytes cannot hold so many"
    return ""


def decoded_bytes(data: bytes) -> int:
    """Return the size in memory of the image that the header declares; a palette is expanded to colours."""
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    return int(width * height * (2 if depth == 16 else 1) * (4 if colour == 3 else SAMPLES.get(colour, 4)))
