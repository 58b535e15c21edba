"""Metadata of image files: EXIF, orientation, XMP packets and colour profile (ICC).

The pixels are unchanged: metadata is added to the output of any encoder, at the position that the
standard of each format defines. EXIF is written without entries that are invalid for a dewarped
image.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.files import decompress

# -- EXIF ------------------------------------------------------------------------------------------
#
# An EXIF block is a TIFF file without pixels: a directory of tags, and two more, for exposure and GPS
# position. Entries on the stored pixels (orientation, size, thumbnail, resolution), on positions in
# the image, and entries that cannot be relocated (maker notes with their own offsets) are dropped.

EXPOSURE, PLACE = 0x8769, 0x8825
"""Tags of the offsets of the two other directories."""
KEPT_IMAGE_TAGS = frozenset({0x010E, 0x010F, 0x0110, 0x0132, 0x013B, 0x8298})
"""Tags kept from the first directory: description, make, model, time, artist and copyright."""
DROPPED_EXPOSURE_TAGS = frozenset({0x927C, 0x9214, 0xA002, 0xA003, 0xA005, 0xA214, 0xA405, 0xEA1C})
"""Dropped tags of the exposure: maker notes, positions in the image, its size, other directories,
focal length in 35 mm film.
"""
TYPE_SIZES = {
    1: (1, 1), 2: (1, 1), 3: (2, 2), 4: (4, 4), 5: (8, 4), 6: (1, 1),
    7: (1, 1), 8: (2, 2), 9: (4, 4), 10: (8, 4), 11: (4, 4), 12: (8, 8),
}  # fmt: skip
"""Size of a value of each type in bytes, and of the units to which the byte order applies."""
MAX_ENTRIES = 1000


F_NUMBER, APERTURE, SUBJECT_DISTANCE = 0x829D, 0x9202, 0x9206
"""Aperture, and distance of the plane in focus in metres."""
INFINITE = 0xFFFFFFFF
NUMBERS = {3: "<H", 4: "<I", 5: "<II", 10: "<ii", 11: "<f", 12: "<d"}
"""Forms of numbers, by type; the specification requires 5, and some programs write others."""


class Entry(NamedTuple):
    """Values of a tag, in little-endian byte order."""

    kind: int
    number: int
    values: bytes


Directory = dict[int, Entry]


class Exif(NamedTuple):
    """EXIF entries that are valid for a dewarped image."""

    image: Directory
    exposure: Directory
    place: Directory

    def block(self) -> bytes:
        """Return the block for JPEG, PNG and WebP."""
        head = 8
        first = self.image | {tag: Entry(4, 1, bytes(4)) for tag in self._others}
        end = head + len(serialised_directory(first, head))
        pointers, rest = {}, b""
        for tag, directory in self._others.items():
            pointers[tag] = Entry(4, 1, struct.pack("<I", end + len(rest)))
            rest += serialised_directory(directory, end + len(rest))
        return (
            b"II*\0"
            + struct.pack("<I", head)
            + serialised_directory(self.image | pointers, head)
            + rest
        )

    @property
    def _others(self) -> dict[int, Directory]:
        return {tag: d for tag, d in ((EXPOSURE, self.exposure), (PLACE, self.place)) if d}


class Exposure(NamedTuple):
    """Settings of the lens for an exposure; None if EXIF does not contain them."""

    f_number: float | None = None
    focus_distance_mm: float | None = None
    """Distance from the camera to the plane in focus, possibly infinite."""


def exposure_of(exif: Exif | None) -> Exposure:
    """Return the settings of the lens that EXIF contains.

    >>> from omnimirror.io.image_metadata import Entry, Exif
    >>> exposure_of(Exif({}, {0x829D: Entry(5, 1, struct.pack("<II", 56, 10))}, {})).f_number
    5.6
    """
    if exif is None:
        return Exposure()
    f_number, aperture, metres = (
        _number(exif.exposure.get(tag)) for tag in (F_NUMBER, APERTURE, SUBJECT_DISTANCE)
    )
    if f_number is None and aperture is not None and aperture < MAX_APERTURE:
        f_number = 2.0 ** (aperture / 2)  # APEX value, EXIF 2.32, annex C
    finite = f_number if f_number is not None and f_number != float("inf") else None
    return Exposure(finite, None if metres is None else 1000 * metres)


MAX_APERTURE = 20.0  # F/1024


def _number(entry: Entry | None) -> float | None:
    """Return a positive number, or infinity as encoded by EXIF; None for unknown (0) or invalid
    values.
    """
    form = None if entry is None else NUMBERS.get(entry.kind)
    if entry is None or form is None or len(entry.values) != struct.calcsize(form):
        return None
    numerator, denominator = (*struct.unpack(form, entry.values), 1)[:2]
    if form == "<II" and numerator == INFINITE:
        return float("inf")
    number = numerator / denominator if denominator else 0.0
    return number if 0 < number < float("inf") else None


def parse_exif(block: bytes) -> Exif | None:
    """Parse the valid entries of a block or of a TIFF file; None if it is damaged or has none.

    >>> from omnimirror.io.image_metadata import Entry, Exif
    >>> exif = Exif({0x010F: Entry(2, 5, b"Ours\\0"), 0x0112: Entry(3, 1, b"\\6\\0")}, {}, {})
    >>> parse_exif(exif.block()).image  # without the orientation
    {271: Entry(kind=2, number=5, values=b'Ours\\x00')}
    """
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None:
        return None
    try:
        first = _directory(block, order, struct.unpack_from(order + "I", block, 4)[0])
        exposure, location = (
            _directory(block, order, struct.unpack("<I", first[tag].values)[0])
            if tag in first
            else {}
            for tag in (EXPOSURE, PLACE)
        )
    except (struct.error, KeyError, ValueError):
        return None
    tags = {tag: entry for tag, entry in first.items() if tag in KEPT_IMAGE_TAGS}
    exposure = {tag: entry for tag, entry in exposure.items() if tag not in DROPPED_EXPOSURE_TAGS}
    return Exif(tags, exposure, location) if tags or exposure or location else None


def serialised_directory(directory: Directory, at: int) -> bytes:
    """Return the bytes of a directory at an offset of the file, followed by its values."""
    values_at = at + 2 + 12 * len(directory) + 4
    entries, values = b"", b""
    for tag, (kind, number, data) in sorted(directory.items()):
        inline = len(data) <= 4
        field = data.ljust(4, b"\0") if inline else struct.pack("<I", values_at + len(values))
        entries += struct.pack("<HHI", tag, kind, number) + field
        values += b"" if inline else data + b"\0" * (len(data) % 2)
    return struct.pack("<H", len(directory)) + entries + bytes(4) + values


def _directory(block: bytes, order: str, at: int) -> Directory:
    (count,) = struct.unpack_from(order + "H", block, at)
    if count > MAX_ENTRIES:
        raise ValueError(count)
    entries: Directory = {}
    for i in range(count):
        offset = at + 2 + 12 * i
        tag, kind, number = struct.unpack_from(order + "HHI", block, offset)
        size, unit = TYPE_SIZES[kind]
        length = size * number
        start = offset + 8 if length <= 4 else struct.unpack_from(order + "I", block, offset + 8)[0]
        data = block[start : start + length]
        if len(data) != length:
            raise ValueError(tag)
        if order == ">" and unit > 1:
            data = b"".join(data[k : k + unit][::-1] for k in range(0, length, unit))
        entries[tag] = Entry(kind, number, data)
    return entries


# -- Orientation of the stored pixels (tag 0x0112) -------------------------------------------------

Pixels = TypeVar("Pixels", bound=np.generic)

ORIENTATION_TAG = 0x0112
UPRIGHT = 1
SHORT, LONG = 3, 4
TIFF_SIGNATURES = {
    b"II*\0": ("<", False),
    b"MM\0*": (">", False),
    b"II+\0": ("<", True),
    b"MM\0+": (">", True),
}
"""Byte order and whether it is a BigTIFF file, by signature."""
ORIENTATION_NAMES = {
    1: "as stored",
    2: "mirrored left to right",
    3: "rotated by 180 deg",
    4: "mirrored top to bottom",
    5: "mirrored along the diagonal from top left to bottom right",
    6: "rotated by 90 deg clockwise",
    7: "mirrored along the diagonal from top right to bottom left",
    8: "rotated by 90 deg counter-clockwise",
}
"""Operation that each orientation requires for display."""
STORED_ORIENTATION_HINT = (
    "--set input.stored_orientation=true (stored_orientation=True in Python) keeps the stored "
    "orientation"
)
TRANSPOSING_ORIENTATIONS = (5, 6, 7, 8)
"""Orientations that exchange width and height."""


def oriented(image: NDArray[Pixels], orientation: int) -> NDArray[Pixels]:
    """Return a view of an image with an orientation applied; the first two axes are rows and
    columns.

    >>> oriented(np.array([[1, 2, 3], [4, 5, 6]]), 6).tolist()
    [[4, 1], [5, 2], [6, 3]]
    """
    view: NDArray[Any] = (
        np.swapaxes(image, 0, 1) if orientation in TRANSPOSING_ORIENTATIONS else image
    )
    if orientation in (2, 3, 6, 7):
        view = view[:, ::-1]
    if orientation in (3, 4, 7, 8):
        view = view[::-1]
    return view


def applied(orientation: int, is_stored: bool) -> str:
    """Return a phrase that reports an orientation other than 1, and the option for the other
    choice.

    >>> applied(3, True)
    'as stored; the EXIF orientation is: rotated by 180 deg'
    """
    if is_stored:
        return f"as stored; the EXIF orientation is: {ORIENTATION_NAMES[orientation]}"
    return f"{ORIENTATION_NAMES[orientation]} according to EXIF; {STORED_ORIENTATION_HINT}"


def orientation_of_block(block: bytes) -> int:
    """Return the orientation, 1 to 8, in an EXIF block or a TIFF file; 1 if there is none, or no
    valid one.
    """
    return _found(block)[0]


def without_orientation(data: bytes) -> bytes:
    """Return a TIFF file with orientation 1, which prevents decoders from rotating its pixels."""
    orientation, at, kind = _found(data)
    if orientation == UPRIGHT:
        return data
    return data[:at] + struct.pack(kind, UPRIGHT) + data[at + struct.calcsize(kind) :]


def _found(block: bytes) -> tuple[int, int, str]:
    """Return the orientation in the first directory of a TIFF structure, its offset and type."""
    default = UPRIGHT, 0, "<H"
    if block[:4] not in TIFF_SIGNATURES:
        return default
    order, is_big = TIFF_SIGNATURES[block[:4]]
    size, head, value = (20, 8, 12) if is_big else (12, 2, 8)
    try:
        (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), block, 8 if is_big else 4)
        (count,) = struct.unpack_from(order + ("Q" if is_big else "H"), block, at)
        for entry in range(at + head, at + head + size * min(count, 4096), size):
            tag, kind = struct.unpack_from(order + "HH", block, entry)
            if tag == ORIENTATION_TAG and kind in (SHORT, LONG):
                number = order + ("H" if kind == SHORT else "I")
                (orientation,) = struct.unpack_from(number, block, entry + value)
                return (
                    (orientation, entry + value, number)
                    if orientation in ORIENTATION_NAMES
                    else default
                )
    except struct.error:
        pass
    return default


# -- XMP packets, colour profile and orientation in image files ------------------------------------

XMP_JPEG_NAME = b"http://ns.adobe.com/xap/1.0/\0"
XMP_PNG_NAME = b"XML:com.adobe.xmp"
XMP_TAG = 700
XMP_TAG_TYPE = 1  # type of the values of the tag

WEBP_HAS_XMP = 0x04
WEBP_HAS_ALPHA = 0x10


def embed_xmp(suffix: str, data: bytes, packet: bytes) -> bytes:
    """Return the file with an XMP packet; ``suffix`` is one of :data:`XMP_WRITERS`."""
    return XMP_WRITERS[suffix](data, packet)


def _xmp_in_jpeg(data: bytes, packet: bytes) -> bytes:
    """Insert the packet in an APP1 segment, after the JFIF header if there is one."""
    body = XMP_JPEG_NAME + packet
    at = 2
    if data[2:4] == b"\xff\xe0":
        at += 2 + int.from_bytes(data[4:6], "big")
    return data[:at] + b"\xff\xe1" + struct.pack(">H", 2 + len(body)) + body + data[at:]


def _xmp_in_png(data: bytes, packet: bytes) -> bytes:
    """Insert the packet in an uncompressed iTXt chunk after the header chunk."""
    body = (
        XMP_PNG_NAME + b"\0\0\0\0\0" + packet
    )  # not compressed, no language, no translated keyword
    chunk = b"iTXt" + body
    after_header = 8 + 12 + 13
    written = struct.pack(">I", len(body)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return data[:after_header] + written + data[after_header:]


def _xmp_in_webp(data: bytes, packet: bytes) -> bytes:
    """Append the packet in an XMP chunk, with the extended header that it requires."""
    flags, canvas, chunks = _webp_header(data)
    header = b"VP8X" + struct.pack("<I", 10) + bytes([flags | WEBP_HAS_XMP, 0, 0, 0]) + canvas
    body = (
        b"WEBP"
        + header
        + chunks
        + b"XMP "
        + struct.pack("<I", len(packet))
        + packet
        + b"\0" * (len(packet) % 2)
    )
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _webp_header(data: bytes) -> tuple[int, bytes, bytes]:
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
        width, height, alpha = (
            int.from_bytes(chunks[at : at + 2], "little") & 0x3FFF for at in (14, 16, 18)
        )
        width, height, alpha = width - 1, height - 1, 0
    return (
        WEBP_HAS_ALPHA * alpha,
        width.to_bytes(3, "little") + height.to_bytes(3, "little"),
        chunks,
    )


def _xmp_in_tiff(data: bytes, packet: bytes) -> bytes:
    """Add the packet as tag 700 of the first directory."""
    return _tiff_with(data, {XMP_TAG: Entry(XMP_TAG_TYPE, len(packet), packet)})


def _tiff_with(data: bytes, more: Directory) -> bytes:
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
        field = (
            content.ljust(4, b"\0")
            if len(content) <= 4
            else struct.pack("<I", values_at + len(values))
        )
        values += b"" if len(content) <= 4 else content + b"\0" * (len(content) % 2)
        entries[tag] = struct.pack("<HHI", tag, kind, number) + field
    directory = (
        struct.pack("<H", len(entries))
        + b"".join(entries[tag] for tag in sorted(entries))
        + following
    )
    return data[:4] + struct.pack("<I", len(data)) + data[8:] + directory + values


XMP_WRITERS: dict[str, Callable[[bytes, bytes], bytes]] = {
    ".jpg": _xmp_in_jpeg,
    ".jpeg": _xmp_in_jpeg,
    ".png": _xmp_in_png,
    ".webp": _xmp_in_webp,
    ".tif": _xmp_in_tiff,
    ".tiff": _xmp_in_tiff,
}
"""Functions that embed a packet, by suffix."""


# -- Colour profile (ICC), EXIF and orientation ------------------------------------------------------

EXIF_NAME, ICC_NAME = b"Exif\0\0", b"ICC_PROFILE\0"
MAX_SEGMENT_BYTES = 65_533
MAX_ICC_PIECE_BYTES = MAX_SEGMENT_BYTES - len(ICC_NAME) - 2
ICC_TAG = 34_675
MAX_PROFILE_BYTES = 16 << 20
COLOUR_SPACES = {1: b"GRAY", 3: b"RGB ", 4: b"RGB "}
"""Colour space signature of a profile, by the number of channels."""
AVIF_BRANDS = (b"avif", b"avis")
WEBP_HAS_ICC, WEBP_HAS_EXIF = 0x20, 0x08


class ImageMetadata(NamedTuple):
    """Metadata of an image file."""

    profile: bytes | None = None
    """ICC profile."""
    exif: Exif | None = None
    orientation: int = UPRIGHT
    """Orientation of the stored pixels, 1 to 8, as in EXIF; never written."""

    def __bool__(self) -> bool:
        return self.profile is not None or self.exif is not None

    def supported_by(
        self, path: str | Path, image: NDArray[np.generic], recoded: bool = False
    ) -> tuple[ImageMetadata, str]:
        """Return the metadata that a file can hold for an image, and a description of what is
        dropped, or "".

        ``recoded``: the values were converted from or to linear light, which invalidates a colour
        profile.
        """
        suffix = Path(path).suffix.lower()
        profile, exif = self.profile, self.exif
        why = []
        if suffix not in METADATA_WRITERS:
            names = [
                name
                for name, part in (("the colour profile", profile), ("EXIF", exif))
                if part is not None
            ]
            return (
                ImageMetadata(),
                f"without {' and '.join(names)}, which {suffix} does not support" if names else "",
            )
        channels = image.shape[2] if image.ndim == 3 else 1
        if profile is not None and recoded:
            profile, why = (
                None,
                [
                    "without the colour profile, which is invalid after conversion from or to linear light"
                ],
            )
        elif profile is not None and profile[16:20] != COLOUR_SPACES[channels]:
            space = profile[16:20].decode("ascii", "replace").strip()
            profile, why = (
                None,
                [f"without the colour profile, whose colour space is {space}"],
            )
        if (
            exif is not None
            and suffix in (".jpg", ".jpeg")
            and len(exif.block()) > MAX_SEGMENT_BYTES - len(EXIF_NAME)
        ):
            exif, why = None, [*why, f"without EXIF, which exceeds the limit of {suffix}"]
        return ImageMetadata(profile, exif), ", ".join(why)


def read_metadata(data: bytes) -> ImageMetadata:
    """Return the metadata in the bytes of an image file; none for formats without it and for
    damaged files.
    """
    try:
        if data.startswith(b"\xff\xd8"):
            profile, block = _metadata_of_jpeg(data)
        elif data.startswith(b"\x89PNG"):
            profile, block = _metadata_of_png(data)
        elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            profile, block = _metadata_of_webp(data)
        elif data[:4] in TIFF_SIGNATURES:
            profile, block = None, data
            if data[:4] in (b"II*\0", b"MM\0*"):
                profile = _profile_of_tiff(data)
        else:
            return ImageMetadata(orientation=_orientation_of_avif(data))
    except (struct.error, zlib.error, ValueError, KeyError, IndexError):
        return ImageMetadata(orientation=orientation_of_block(data))  # TIFF, invalid profile
    return ImageMetadata(profile, parse_exif(block), orientation_of_block(block))


def embed_metadata(suffix: str, data: bytes, metadata: ImageMetadata) -> bytes:
    """Return the file with a profile and EXIF embedded; ``suffix`` is one of :data:`METADATA_WRITERS`."""
    return METADATA_WRITERS[suffix](data, metadata)


# -- JPEG ----------------------------------------------------------------------------------------


def _metadata_of_jpeg(data: bytes) -> tuple[bytes | None, bytes]:
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


def _in_jpeg(data: bytes, metadata: ImageMetadata) -> bytes:
    segments = b""
    if metadata.exif is not None:
        segments += _segment(0xE1, EXIF_NAME + metadata.exif.block())
    profile = metadata.profile or b""
    pieces = [
        profile[k : k + MAX_ICC_PIECE_BYTES] for k in range(0, len(profile), MAX_ICC_PIECE_BYTES)
    ]
    for number, piece in enumerate(pieces, start=1):
        segments += _segment(0xE2, ICC_NAME + bytes([number, len(pieces)]) + piece)
    at = 2
    if data[2:4] == b"\xff\xe0":  # after the JFIF header
        at += 2 + int.from_bytes(data[4:6], "big")
    return data[:at] + segments + data[at:]


def _segment(kind: int, body: bytes) -> bytes:
    return bytes([0xFF, kind]) + struct.pack(">H", 2 + len(body)) + body


# -- PNG -----------------------------------------------------------------------------------------


def _metadata_of_png(data: bytes) -> tuple[bytes | None, bytes]:
    """Return the colour profile and the EXIF block."""
    profile, block, at = None, b"", 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"iCCP":
            profile = decompress(body[body.index(b"\0") + 2 :], MAX_PROFILE_BYTES)
        elif kind == b"eXIf":
            block = body
        at += 12 + length
    return profile, block


def _in_png(data: bytes, metadata: ImageMetadata) -> bytes:
    chunks = b""
    if metadata.profile is not None:
        chunks += _chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(metadata.profile))
    if metadata.exif is not None:
        chunks += _chunk(b"eXIf", metadata.exif.block())
    after_header = 8 + 12 + 13
    return data[:after_header] + chunks + data[after_header:]


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


# -- WebP ----------------------------------------------------------------------------------------


def _metadata_of_webp(data: bytes) -> tuple[bytes | None, bytes]:
    """Return the colour profile and the EXIF block."""
    chunks = dict(_webp_chunks(data[12:]))
    return chunks.get(b"ICCP"), chunks.get(b"EXIF", b"").removeprefix(EXIF_NAME)


def _webp_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 8 <= len(data):
        length = int.from_bytes(data[at + 4 : at + 8], "little")
        yield data[at : at + 4], data[at + 8 : at + 8 + length]
        at += 8 + length + length % 2


def _in_webp(data: bytes, metadata: ImageMetadata) -> bytes:
    flags, canvas, chunks = _webp_header(data)
    before = after = b""
    if metadata.profile is not None:
        flags, before = flags | WEBP_HAS_ICC, _webp_chunk(b"ICCP", metadata.profile)
    if metadata.exif is not None:
        flags, after = flags | WEBP_HAS_EXIF, _webp_chunk(b"EXIF", metadata.exif.block())
    body = (
        b"WEBP" + _webp_chunk(b"VP8X", bytes([flags, 0, 0, 0]) + canvas) + before + chunks + after
    )
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _webp_chunk(kind: bytes, body: bytes) -> bytes:
    return kind + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


# -- TIFF ----------------------------------------------------------------------------------------


def _profile_of_tiff(data: bytes) -> bytes | None:
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    for i in range(count):
        tag, _, length, offset = struct.unpack_from(order + "HHII", data, at + 2 + 12 * i)
        if tag == ICC_TAG:
            return data[offset : offset + length]
    return None


def _in_tiff(data: bytes, metadata: ImageMetadata) -> bytes:
    """Add the tags to the first directory, rewritten at the end of the file; OpenCV writes
    little-endian files.
    """
    more: Directory = {}
    if metadata.profile is not None:
        more[ICC_TAG] = Entry(7, len(metadata.profile), metadata.profile)
    if metadata.exif is not None:
        more |= metadata.exif.image
        for tag, directory in ((EXPOSURE, metadata.exif.exposure), (PLACE, metadata.exif.place)):
            if directory:
                data += b"\0" * (len(data) % 2)
                more[tag] = Entry(4, 1, struct.pack("<I", len(data)))
                data += serialised_directory(directory, len(data))
    return _tiff_with(data, more)


def _orientation_of_avif(data: bytes) -> int:
    """Return the orientation in the properties irot and imir of an AVIF file, which OpenCV does not
    apply.
    """
    if data[4:8] != b"ftyp" or data[8:12] not in AVIF_BRANDS:
        return UPRIGHT
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("AVIF",)) as image:
            return int(image.getexif().get(ORIENTATION_TAG, UPRIGHT))
    except Exception:  # invalid; the decoder reports it
        return UPRIGHT


METADATA_WRITERS: dict[str, Callable[[bytes, ImageMetadata], bytes]] = {
    ".jpg": _in_jpeg,
    ".jpeg": _in_jpeg,
    ".png": _in_png,
    ".webp": _in_webp,
    ".tif": _in_tiff,
    ".tiff": _in_tiff,
}
"""Functions that embed metadata, by suffix."""
