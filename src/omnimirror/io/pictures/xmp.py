"""XMP packets in finished image files, at the position of the standard of each format.

The pixels are unchanged: a packet is added to the output of any encoder.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from .exif import Directory, Entry

JPEG_NAME = b"http://ns.adobe.com/xap/1.0/\0"
PNG_NAME = b"XML:com.adobe.xmp"
TIFF_TAG = 700
TIFF_BYTE = 1  # type of the values of the tag

WEBP_HAS_XMP = 0x04
WEBP_HAS_ALPHA = 0x10


def embed(suffix: str, data: bytes, packet: bytes) -> bytes:
    """Return the file with an XMP packet; ``suffix`` is one of :data:`CARRIERS`."""
    return CARRIERS[suffix](data, packet)


def in_jpeg(data: bytes, packet: bytes) -> bytes:
    """Insert the packet in an APP1 segment, after the JFIF header if there is one."""
    body = JPEG_NAME + packet
    at = 2
    if data[2:4] == b"\xff\xe0":
        at += 2 + int.from_bytes(data[4:6], "big")
    return data[:at] + b"\xff\xe1" + struct.pack(">H", 2 + len(body)) + body + data[at:]


def in_png(data: bytes, packet: bytes) -> bytes:
    """Insert the packet in an uncompressed iTXt chunk after the header chunk."""
    body = PNG_NAME + b"\0\0\0\0\0" + packet  # not compressed, no language, no translated keyword
    chunk = b"iTXt" + body
    after_header = 8 + 12 + 13
    written = struct.pack(">I", len(body)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return data[:after_header] + written + data[after_header:]


def in_webp(data: bytes, packet: bytes) -> bytes:
    """Append the packet in an XMP chunk, with the extended header that it requires."""
    flags, canvas, chunks = webp_header(data)
    header = b"VP8X" + struct.pack("<I", 10) + bytes([flags | WEBP_HAS_XMP, 0, 0, 0]) + canvas
    body = b"WEBP" + header + chunks + b"XMP " + struct.pack("<I", len(packet)) + packet + b"\0" * (len(packet) % 2)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def webp_header(data: bytes) -> tuple[int, bytes, bytes]:
    """Return the flags, the canvas size minus one in 3 + 3 bytes, and the chunks after an extended
    header.
    """
    chunks = data[12:]
    if chunks[:4] == b"VP8X":
        return chunks[8], chunks[12:18], chunks[18:]
    if chunks[:4] == b"VP8L":  # lossless: 14 bits each, minus one, then one bit for alpha
        bits = int.from_bytes(chunks[9:13], "little")
        width, height, alpha = bits & 0x3FFF, bits >> 14 & 0x3FFF, bits >> 28 & 1
    else:  # lossy: 14 bits each after a start code
        width, height, alpha = (int.from_bytes(chunks[at : at + 2], "little") & 0x3FFF for at in (14, 16, 18))
        width, height, alpha = width - 1, height - 1, 0
    return WEBP_HAS_ALPHA * alpha, width.to_bytes(3, "little") + height.to_bytes(3, "little"), chunks


def in_tiff(data: bytes, packet: bytes) -> bytes:
    """Add the packet as tag 700 of the first directory."""
    return tiff_with(data, {TIFF_TAG: Entry(TIFF_BYTE, len(packet), packet)})


def tiff_with(data: bytes, more: Directory) -> bytes:
    """Add tags to the first directory of a little-endian file, rewritten at the end of the file."""
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    entries = {
        struct.unpack_from("<H", data, at + 2 + 12 * i)[0]: data[at + 2 + 12 * i : at + 14 + 12 * i]
        for i in range(count)
    }
    following = data[at + 2 + 12 * count : at + 6 + 12 * count]
    data += b"\0" * (len(data) % 2)  # directories start at even offsets
    values_at, values = len(data) + 2 + 12 * len(entries | dict.fromkeys(more, b"")) + 4, b""
    for tag, (kind, number, content) in more.items():
        field = content.ljust(4, b"\0") if len(content) <= 4 else struct.pack("<I", values_at + len(values))
        values += b"" if len(content) <= 4 else content + b"\0" * (len(content) % 2)
        entries[tag] = struct.pack("<HHI", tag, kind, number) + field
    directory = struct.pack("<H", len(entries)) + b"".join(entries[tag] for tag in sorted(entries)) + following
    return data[:4] + struct.pack("<I", len(data)) + data[8:] + directory + values


CARRIERS: dict[str, Callable[[bytes, bytes], bytes]] = {
    ".jpg": in_jpeg,
    ".jpeg": in_jpeg,
    ".png": in_png,
    ".webp": in_webp,
    ".tif": in_tiff,
    ".tiff": in_tiff,
}
"""Functions that embed a packet, by suffix."""
