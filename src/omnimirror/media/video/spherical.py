"""What tells a player that an MP4 holds a panorama: Spherical Video, version 1 and version 2.

https://github.com/google/spatial-media describes both: version 1 is an XML text in a uuid box of the
track, version 2 are boxes in the description of its samples. Both are written, since players read the
one or the other. The boxes go into the finished file, whose pictures are not touched.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from ...errors import MediaError
from ..pictures.panorama import GPano

SUFFIXES = (".mp4", ".m4v", ".mov")
V1_UUID = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
SOURCE = b"omnimirror"
SAMPLE_ENTRY_BYTES = 78  # fixed fields of a picture's sample entry, before its boxes
MONOSCOPIC = 0


def can_be_spherical(path: str | Path) -> bool:
    """Whether a video file of that name can say that it is a panorama.

    >>> can_be_spherical("room.mp4"), can_be_spherical("room.mkv")
    (True, False)
    """
    return Path(path).suffix.lower() in SUFFIXES


def make_spherical(path: Path, panorama: GPano) -> None:
    """Put the metadata into a finished file whose index stands at its end, in place.

    Raises
    ------
    MediaError
        The file has no index at its end, or no video.
    OSError
        The file cannot be written.
    """
    with path.open("r+b") as file:
        at = _index_at(path)
        file.seek(at)
        kind, index = next(_boxes(file.read()))
        if kind != b"moov":
            raise MediaError(f"{path} has no index at its end, where spherical metadata can be added")
        file.seek(at)
        file.write(_box(b"moov", _with_metadata(index, panorama)))
        file.truncate()


def _index_at(path: Path) -> int:
    """Where the last box of a file begins; only heads are read, since what they hold may be large."""
    with path.open("rb") as file:
        end = path.stat().st_size
        at = last = 0
        while at < end:
            last = at
            file.seek(at)
            head = file.read(16)
            size = int.from_bytes(head[:4], "big")
            if size == 1:
                size = int.from_bytes(head[8:16], "big")
            at = at + size if size >= 8 else end
        return last


def _with_metadata(index: bytes, panorama: GPano) -> bytes:
    """The movie's index with the metadata in its first video track."""
    parts, is_done = [], False
    for kind, body in _boxes(index):
        if kind == b"trak" and not is_done and _is_video(body):
            body = _inside(body, [b"mdia", b"minf", b"stbl", b"stsd"], lambda stsd: _described(stsd, panorama))
            body += _box(b"uuid", V1_UUID + v1_text(panorama))
            is_done = True
        parts.append(_box(kind, body))
    if not is_done:
        raise MediaError("there is no video track to add spherical metadata to")
    return b"".join(parts)


def _is_video(track: bytes) -> bool:
    media = dict(_boxes(dict(_boxes(track))[b"mdia"]))
    return media[b"hdlr"][8:12] == b"vide"


def _described(stsd: bytes, panorama: GPano) -> bytes:
    """The sample descriptions, the first with the boxes of version 2."""
    (kind, entry), *others = _boxes(stsd[8:])
    codec, *optional = (_box(*part) for part in _boxes(entry[SAMPLE_ENTRY_BYTES:]))
    # Version 2 asks for a place after the codec's own box and before the optional ones.
    first = _box(kind, entry[:SAMPLE_ENTRY_BYTES] + codec + v2_boxes(panorama) + b"".join(optional))
    return stsd[:8] + first + b"".join(_box(*other) for other in others)


def v2_boxes(panorama: GPano) -> bytes:
    """The boxes st3d and sv3d: one eye, equirectangular, pose and bounds."""
    heading = panorama.pose_heading_deg or 0.0
    # Poses are in 16.16 degrees, the yaw counter-clockwise and so the other way round from a heading; a pitch
    # counter-clockwise about the right side lifts the centre, and a roll is clockwise.
    yaw = round(((180.0 - heading) % 360.0 - 180.0) * 65536)
    pitch, roll = round(panorama.pitch_deg * 65536), round(panorama.roll_deg * 65536)
    bounds = panorama.bounds
    shares = (min(round(share * 2**32), 2**32 - 1) for share in (bounds.top, bounds.bottom, bounds.left, bounds.right))
    projection = _box(b"prhd", _full(struct.pack(">iii", yaw, pitch, roll))) + _box(
        b"equi", _full(struct.pack(">4I", *shares))
    )
    spherical = _box(b"svhd", _full(SOURCE + b"\0")) + _box(b"proj", projection)
    return _box(b"st3d", _full(bytes([MONOSCOPIC]))) + _box(b"sv3d", spherical)


def v1_text(panorama: GPano) -> bytes:
    """The XML text of version 1, UTF-8."""
    fields: dict[str, object] = {
        "Spherical": "true",
        "Stitched": "true",
        "StitchingSoftware": SOURCE.decode(),
        **panorama.area(),
    }
    elements = "".join(f"<GSpherical:{name}>{value}</GSpherical:{name}>" for name, value in fields.items())
    return (
        '<?xml version="1.0"?><rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
        f'xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/">{elements}</rdf:SphericalVideo>'
    ).encode()


# -- boxes -------------------------------------------------------------------------------------------


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kinds and bodies of boxes that follow one another; four zero bytes may end them, as in QuickTime."""
    at = 0
    while at + 8 <= len(data):
        size, head = int.from_bytes(data[at : at + 4], "big"), 8
        if size == 1:
            size, head = int.from_bytes(data[at + 8 : at + 16], "big"), 16
        elif size == 0:
            size = len(data) - at
        if size < head:
            return
        yield data[at + 4 : at + 8], data[at + head : at + size]
        at += size


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", 8 + len(body)) + kind + body


def _full(body: bytes) -> bytes:
    """A box's body with version 0 and no flags before it."""
    return b"\0\0\0\0" + body


def _inside(body: bytes, path: list[bytes], change: Callable[[bytes], bytes]) -> bytes:
    """A box's body with the first box at a path of kinds changed."""
    if not path:
        return change(body)
    parts, is_done = [], False
    for kind, part in _boxes(body):
        if kind == path[0] and not is_done:
            part, is_done = _inside(part, path[1:], change), True
        parts.append(_box(kind, part))
    return b"".join(parts)
