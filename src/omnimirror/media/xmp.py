"""An XMP packet put into the bytes of a finished picture file, each format in the place its standard names.

The pixels are not touched: a packet is added to what the encoder wrote, whichever encoder it was.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

JPEG_NAME = b"http://ns.adobe.com/xap/1.0/\0"
PNG_NAME = b"XML:com.adobe.xmp"
TIFF_TAG = 700
TIFF_BYTE = 1  # the type of a tag's values

WEBP_HAS_XMP = 0x04
WEBP_HAS_ALPHA = 0x10


def embed(suffix: str, data: bytes, packet: bytes) -> bytes:
    """The file with an XMP packet in it; ``suffix`` is one of :data:`CARRIERS`."""
    return CARRIERS[suffix](data, packet)


def in_jpeg(data: bytes, packet: bytes) -> bytes:
    """In an APP1 segment, after the JFIF header where there is one."""
    body = JPEG_NAME + packet
    at = 2
    if data[2:4] == b"\xff\xe0":
        at += 2 + int.from_bytes(data[4:6], "big")
    return data[:at] + b"\xff\xe1" + struct.pack(">H", 2 + len(body)) + body + data[at:]


def in_png(data: bytes, packet: bytes) -> bytes:
    """In an uncompressed iTXt chunk after the header chunk."""
    body = PNG_NAME + b"\0\0\0\0\0" + packet  # not compressed, no language, no translated keyword
    chunk = b"iTXt" + body
    after_header = 8 + 12 + 13
    written = struct.pack(">I", len(body)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return data[:after_header] + written + data[after_header:]


def in_webp(data: bytes, packet: bytes) -> bytes:
    """In an XMP chunk at the end, announced by the extended header that such a file must begin with."""
    chunks = data[12:]
    if chunks[:4] == b"VP8X":
        flags, canvas, chunks = chunks[8], chunks[12:18], chunks[18:]
    else:
        flags, canvas = _webp_header(chunks)
    header = b"VP8X" + struct.pack("<I", 10) + bytes([flags | WEBP_HAS_XMP, 0, 0, 0]) + canvas
    body = b"WEBP" + header + chunks + b"XMP " + struct.pack("<I", len(packet)) + packet + b"\0" * (len(packet) % 2)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _webp_header(chunks: bytes) -> tuple[int, bytes]:
    """Flags, and the canvas less one in 3 + 3 bytes, of a file with nothing but a picture."""
    if chunks[:4] == b"VP8L":  # lossless: 14 bits each less one, then one bit for alpha
        bits = int.from_bytes(chunks[9:13], "little")
        width, height, alpha = bits & 0x3FFF, bits >> 14 & 0x3FFF, bits >> 28 & 1
    else:  # the key frame of a lossy picture: 14 bits each after a start code
        width, height, alpha = (int.from_bytes(chunks[at : at + 2], "little") & 0x3FFF for at in (14, 16, 18))
        width, height, alpha = width - 1, height - 1, 0
    return WEBP_HAS_ALPHA * alpha, width.to_bytes(3, "little") + height.to_bytes(3, "little")


def in_tiff(data: bytes, packet: bytes) -> bytes:
    """In tag 700 of the first directory, which is written anew at the end since it grows."""
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    entries = [data[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    following = data[at + 2 + 12 * count : at + 6 + 12 * count]
    data += b"\0" * (len(data) % 2)  # a directory begins on an even byte
    packet_at = len(data) + 2 + 12 * (count + 1) + 4
    entries.append(struct.pack(order + "HHII", TIFF_TAG, TIFF_BYTE, len(packet), packet_at))
    entries.sort(key=lambda entry: struct.unpack_from(order + "H", entry))
    directory = struct.pack(order + "H", count + 1) + b"".join(entries) + following
    return data[:4] + struct.pack(order + "I", len(data)) + data[8:] + directory + packet


CARRIERS: dict[str, Callable[[bytes, bytes], bytes]] = {
    ".jpg": in_jpeg,
    ".jpeg": in_jpeg,
    ".png": in_png,
    ".webp": in_webp,
    ".tif": in_tiff,
    ".tiff": in_tiff,
}
"""What can carry a packet, by suffix."""
