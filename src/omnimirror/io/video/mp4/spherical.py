"""Panorama metadata of MP4 files: Spherical Video, version 1 and version 2.

https://github.com/google/spatial-media specifies both: version 1 is an XML text in a uuid box of
the track, version 2 consists of boxes in the sample description. Both are written, since players
support one or the other. The boxes are inserted into the finished file without changes to its
frames.
"""

from __future__ import annotations

import struct
from pathlib import Path

from ....base.errors import MediaError
from ...pictures.panorama import GPano
from .index import box, boxes, change_index, inside, is_video

SUFFIXES = (".mp4", ".m4v", ".mov")
V1_UUID = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
SOURCE = b"omnimirror"
SAMPLE_ENTRY_BYTES = 78  # fixed fields of a video sample entry, before its boxes
MONOSCOPIC = 0


def can_be_spherical(path: str | Path) -> bool:
    """Return whether a video file of that name can store panorama metadata.

    >>> can_be_spherical("room.mp4"), can_be_spherical("room.mkv")
    (True, False)
    """
    return Path(path).suffix.lower() in SUFFIXES


def make_spherical(path: Path, panorama: GPano) -> None:
    """Insert the metadata into a finished file whose index is at its end, in place.

    Raises
    ------
    MediaError
        The file has no index at its end, or no video.
    OSError
        The file cannot be written.
    """
    change_index(path, lambda index: _with_metadata(index, panorama))


def _with_metadata(index: bytes, panorama: GPano) -> bytes:
    """Return the index of the movie with the metadata in its first video track."""
    parts, is_done = [], False
    for kind, body in boxes(index):
        if kind == b"trak" and not is_done and is_video(body):
            body = inside(body, [b"mdia", b"minf", b"stbl", b"stsd"], lambda stsd: _described(stsd, panorama))
            body += box(b"uuid", V1_UUID + v1_text(panorama))
            is_done = True
        parts.append(box(kind, body))
    if not is_done:
        raise MediaError("there is no video track to add spherical metadata to")
    return b"".join(parts)


def _described(stsd: bytes, panorama: GPano) -> bytes:
    """Return the sample descriptions, the first with the boxes of version 2."""
    (kind, entry), *others = boxes(stsd[8:])
    codec, *optional = (box(*part) for part in boxes(entry[SAMPLE_ENTRY_BYTES:]))
    # Version 2 requires a position after the codec's own box and before the optional ones.
    first = box(kind, entry[:SAMPLE_ENTRY_BYTES] + codec + v2_boxes(panorama) + b"".join(optional))
    return stsd[:8] + first + b"".join(box(*other) for other in others)


def v2_boxes(panorama: GPano) -> bytes:
    """Return the boxes st3d and sv3d: monoscopic, equirectangular, pose and bounds."""
    heading = panorama.pose_heading_deg or 0.0
    # Poses are 16.16 degrees: yaw is counter-clockwise, opposite to a heading; pitch is
    # counter-clockwise about the right axis and raises the centre; roll is clockwise.
    yaw = round(((180.0 - heading) % 360.0 - 180.0) * 65536)
    pitch, roll = round(panorama.pitch_deg * 65536), round(panorama.roll_deg * 65536)
    bounds = panorama.bounds
    shares = (min(round(share * 2**32), 2**32 - 1) for share in (bounds.top, bounds.bottom, bounds.left, bounds.right))
    projection = box(b"prhd", _full(struct.pack(">iii", yaw, pitch, roll))) + box(
        b"equi", _full(struct.pack(">4I", *shares))
    )
    spherical = box(b"svhd", _full(SOURCE + b"\0")) + box(b"proj", projection)
    return box(b"st3d", _full(bytes([MONOSCOPIC]))) + box(b"sv3d", spherical)


def v1_text(panorama: GPano) -> bytes:
    """Return the XML text of version 1, UTF-8."""
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


def _full(body: bytes) -> bytes:
    """Return the body of a box with version 0 and no flags."""
    return b"\0\0\0\0" + body
