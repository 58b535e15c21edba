"""PNG headers, checked before decompression: a damaged header must not cause huge memory
allocations.
"""

from __future__ import annotations

import struct
import zlib

SIGNATURE = b"\x89PNG\r\n\x1a\n"
HEADER_END = 33  # signature, length, "IHDR", 13 bytes, checksum
SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # samples per pixel, by colour type
MOST_UNPACKED = 1032  # maximum compression ratio of deflate: 258 bytes by 2 bits


def damage(data: bytes) -> str:
    """Describe the damage of a PNG header, to follow the name of the file; "" if there is none.

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
    """Return the size in memory of the image that the header declares; a palette is expanded to
    colours.
    """
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    return int(width * height * (2 if depth == 16 else 1) * (4 if colour == 3 else SAMPLES.get(colour, 4)))
