"""Metadata of image files: colour profile (ICC), EXIF and orientation.

As in :mod:`omnimirror.io.pictures.xmp`, the pixels are unchanged, and each format stores metadata
at the position of its standard.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.files import decompressed
from .exif import EXPOSURE, PLACE, Directory, Entry, Exif, parse_exif, written
from .orientation import ORIENTATION, TIFF, UPRIGHT, orientation_of_block
from .xmp import tiff_with, webp_header

EXIF_NAME, ICC_NAME = b"Exif\0\0", b"ICC_PROFILE\0"
LONGEST_SEGMENT = 65_533
ICC_PIECE = LONGEST_SEGMENT - len(ICC_NAME) - 2
ICC_TAG = 34_675
LARGEST_PROFILE = 16 << 20
SPACES = {1: b"GRAY", 3: b"RGB ", 4: b"RGB "}
"""Colour space signature of a profile, by the number of channels."""
AVIF = (b"avif", b"avis")
WEBP_HAS_ICC, WEBP_HAS_EXIF = 0x20, 0x08


class Carried(NamedTuple):
    """Metadata of an image file."""

    profile: bytes | None = None
    """ICC profile."""
    exif: Exif | None = None
    orientation: int = UPRIGHT
    """Orientation of the stored pixels, 1 to 8, as in EXIF; never written."""

    def __bool__(self) -> bool:
        return self.profile is not None or self.exif is not None

    def that_fits(self, path: str | Path, image: NDArray[np.generic], recoded: bool = False) -> tuple[Carried, str]:
        """Return the metadata that a file can hold for an image, and a description of what is
        dropped, or "".

        ``recoded``: the values were converted from or to linear light, which invalidates a colour
        profile.
        """
        suffix = Path(path).suffix.lower()
        profile, exif = self.profile, self.exif
        why = []
        if suffix not in CARRIERS:
            names = [name for name, part in (("the colour profile", profile), ("EXIF", exif)) if part is not None]
            return Carried(), f"without {' and '.join(names)}, which {suffix} cannot hold" if names else ""
        channels = image.shape[2] if image.ndim == 3 else 1
        if profile is not None and recoded:
            profile, why = None, ["without the colour profile, which is not of light, or of light alone"]
        elif profile is not None and profile[16:20] != SPACES[channels]:
            had = profile[16:20].decode("ascii", "replace").strip()
            profile, why = None, [f"without the colour profile, which is of {had} and not of these colours"]
        if exif is not None and suffix in (".jpg", ".jpeg") and len(exif.block()) > LONGEST_SEGMENT - len(EXIF_NAME):
            exif, why = None, [*why, f"without EXIF, which is longer than {suffix} can hold"]
        return Carried(profile, exif), ", ".join(why)


def read_carried(data: bytes) -> Carried:
    """Return the metadata in the bytes of an image file; none for formats without it and for
    damaged files.
    """
    try:
        if data.startswith(b"\xff\xd8"):
            profile, block = _of_jpeg(data)
        elif data.startswith(b"\x89PNG"):
            profile, block = _of_png(data)
        elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            profile, block = _of_webp(data)
        elif data[:4] in TIFF:
            profile, block = None, data
            if data[:4] in (b"II*\0", b"MM\0*"):
                profile = _profile_of_tiff(data)
        else:
            return Carried(orientation=_orientation_of_avif(data))
    except (struct.error, zlib.error, ValueError, KeyError, IndexError):
        return Carried(orientation=orientation_of_block(data))  # TIFF, invalid profile
    return Carried(profile, parse_exif(block), orientation_of_block(block))


def embed(suffix: str, data: bytes, carried: Carried) -> bytes:
    """Return the file with a profile and EXIF embedded; ``suffix`` is one of :data:`CARRIERS`."""
    return CARRIERS[suffix](data, carried)


# -- JPEG ----------------------------------------------------------------------------------------


def _of_jpeg(data: bytes) -> tuple[bytes | None, bytes]:
    """Return the colour profile and the EXIF block."""
    block, pieces = b"", {}
    at = 2
    while data[at] == 0xFF and data[at + 1] != 0xDA:
        if data[at + 1] == 0xFF:
            at += 1
            continue
        body = data[at + 4 : at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")]
        if data[at + 1] == 0xE1 and body.startswith(EXIF_NAME) and not block:
            block = body[len(EXIF_NAME) :]
        elif data[at + 1] == 0xE2 and body.startswith(ICC_NAME):
            pieces[body[len(ICC_NAME)]] = body[len(ICC_NAME) + 2 :]
        at += 4 + len(body)
    return b"".join(pieces[k] for k in sorted(pieces)) or None, block


def _in_jpeg(data: bytes, carried: Carried) -> bytes:
    segments = b""
    if carried.exif is not None:
        segments += _segment(0xE1, EXIF_NAME + carried.exif.block())
    profile = carried.profile or b""
    pieces = [profile[k : k + ICC_PIECE] for k in range(0, len(profile), ICC_PIECE)]
    for number, piece in enumerate(pieces, start=1):
        segments += _segment(0xE2, ICC_NAME + bytes([number, len(pieces)]) + piece)
    at = 2
    if data[2:4] == b"\xff\xe0":  # after the JFIF header
        at += 2 + int.from_bytes(data[4:6], "big")
    return data[:at] + segments + data[at:]


def _segment(kind: int, body: bytes) -> bytes:
    return bytes([0xFF, kind]) + struct.pack(">H", 2 + len(body)) + body


# -- PNG -----------------------------------------------------------------------------------------


def _of_png(data: bytes) -> tuple[bytes | None, bytes]:
    """Return the colour profile and the EXIF block."""
    profile, block, at = None, b"", 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"iCCP":
            profile = decompressed(body[body.index(b"\0") + 2 :], LARGEST_PROFILE)
        elif kind == b"eXIf":
            block = body
        at += 12 + length
    return profile, block


def _in_png(data: bytes, carried: Carried) -> bytes:
    chunks = b""
    if carried.profile is not None:
        chunks += _chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(carried.profile))
    if carried.exif is not None:
        chunks += _chunk(b"eXIf", carried.exif.block())
    after_header = 8 + 12 + 13
    return data[:after_header] + chunks + data[after_header:]


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


# -- WebP ----------------------------------------------------------------------------------------


def _of_webp(data: bytes) -> tuple[bytes | None, bytes]:
    """Return the colour profile and the EXIF block."""
    found = dict(_webp_chunks(data[12:]))
    return found.get(b"ICCP"), found.get(b"EXIF", b"").removeprefix(EXIF_NAME)


def _webp_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 8 <= len(data):
        length = int.from_bytes(data[at + 4 : at + 8], "little")
        yield data[at : at + 4], data[at + 8 : at + 8 + length]
        at += 8 + length + length % 2


def _in_webp(data: bytes, carried: Carried) -> bytes:
    flags, canvas, chunks = webp_header(data)
    before = after = b""
    if carried.profile is not None:
        flags, before = flags | WEBP_HAS_ICC, _webp_chunk(b"ICCP", carried.profile)
    if carried.exif is not None:
        flags, after = flags | WEBP_HAS_EXIF, _webp_chunk(b"EXIF", carried.exif.block())
    body = b"WEBP" + _webp_chunk(b"VP8X", bytes([flags, 0, 0, 0]) + canvas) + before + chunks + after
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _webp_chunk(kind: bytes, body: bytes) -> bytes:
    return kind + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


# -- TIFF ----------------------------------------------------------------------------------------


def _profile_of_tiff(data: bytes) -> bytes | None:
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    for i in range(count):
        tag, _, length, place = struct.unpack_from(order + "HHII", data, at + 2 + 12 * i)
        if tag == ICC_TAG:
            return data[place : place + length]
    return None


def _in_tiff(data: bytes, carried: Carried) -> bytes:
    """Add the tags to the first directory, rewritten at the end of the file; OpenCV writes
    little-endian files.
    """
    more: Directory = {}
    if carried.profile is not None:
        more[ICC_TAG] = Entry(7, len(carried.profile), carried.profile)
    if carried.exif is not None:
        more |= carried.exif.picture
        for tag, directory in ((EXPOSURE, carried.exif.exposure), (PLACE, carried.exif.place)):
            if directory:
                data += b"\0" * (len(data) % 2)
                more[tag] = Entry(4, 1, struct.pack("<I", len(data)))
                data += written(directory, len(data))
    return tiff_with(data, more)


def _orientation_of_avif(data: bytes) -> int:
    """Return the orientation in the properties irot and imir of an AVIF file, which OpenCV does not
    apply.
    """
    if data[4:8] != b"ftyp" or data[8:12] not in AVIF:
        return UPRIGHT
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("AVIF",)) as image:
            return int(image.getexif().get(ORIENTATION, UPRIGHT))
    except Exception:  # invalid; the decoder reports it
        return UPRIGHT


CARRIERS: dict[str, Callable[[bytes, Carried], bytes]] = {
    ".jpg": _in_jpeg,
    ".jpeg": _in_jpeg,
    ".png": _in_png,
    ".webp": _in_webp,
    ".tif": _in_tiff,
    ".tiff": _in_tiff,
}
"""Functions that embed metadata, by suffix."""
