"""Metadata of finished MP4 and MOV files that FFmpeg does not write: duration and panorama metadata."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..base.errors import MediaError
from ._panorama import GPano

# -- Boxes of MP4 and MOV files (ISO/IEC 14496-12) ---------------------------------------------------


def change_index(path: Path, change: Callable[[bytes], bytes]) -> None:
    """Change the body of the index (``moov``) at the end of a finished file, in place.

    Raises
    ------
    MediaError
        If the file has no index at its end.
    OSError
        If the file cannot be written.
    """
    with path.open("r+b") as file:
        at = _last_box(file)
        file.seek(at)
        kind, index = next(iterate_boxes(file.read()))
        if kind != b"moov":
            raise MediaError(f"{path} must have its index (moov) at the end")
        changed = change(index)
        if changed != index:
            file.seek(at)
            file.write(make_box(b"moov", changed))
            file.truncate()


def _last_box(file: BinaryIO) -> int:
    """Return the offset of the last box of a file; only headers are read, since bodies may be
    large.
    """
    end = file.seek(0, os.SEEK_END)
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


def is_video(track: bytes) -> bool:
    """Return whether the body of a ``trak`` box is that of a video track."""
    media = dict(iterate_boxes(dict(iterate_boxes(track))[b"mdia"]))
    return media[b"hdlr"][8:12] == b"vide"


def iterate_boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kinds and bodies of consecutive boxes; four zero bytes may end them (QuickTime)."""
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


def make_box(kind: bytes, body: bytes) -> bytes:
    """Return a box of a kind."""
    return struct.pack(">I", 8 + len(body)) + kind + body


def change_box(body: bytes, path: list[bytes], change: Callable[[bytes], bytes]) -> bytes:
    """Return the body of a box in which the first box at a path of box types is changed."""
    if not path:
        return change(body)
    parts, is_changed = [], False
    for kind, part in iterate_boxes(body):
        if kind == path[0] and not is_changed:
            part, is_changed = change_box(part, path[1:], change), True
        parts.append(make_box(kind, part))
    return b"".join(parts)


# -- Duration of fragmented MP4 files ----------------------------------------------------------------
#
# FFmpeg writes too short a duration: at the end of a fragment the muxer (``mov_write_packet`` of
# movenc.c, FFmpeg 8.1) discards the maximum presentation time and continues from the next packet.
# Packets are in decoding order: this one may be presented before others in the file (B-frames). If
# none is presented after those, the edit list ends before them, and players omit the last frames of a
# video. The index contains the correct times.

TIME_SCALE_LAYOUT = {0: (12, ">I", 16), 1: (20, ">Q", 24)}
"""Layout of mvhd and mdhd by version: offset of the time scale, format and offset of the duration.
"""
TRACK_HEADER_LAYOUT = {0: (">I", 20), 1: (">Q", 28)}
"""Layout of tkhd likewise; its duration has the time scale of the movie."""
EDIT_LIST_LAYOUT = {0: (">I", 12), 1: (">Q", 20)}
"""Layout of elst: format of a duration, at the start of each entry, and size of an entry in bytes.
"""
FIRST_EDIT_OFFSET = 8


def extend_duration(path: Path) -> None:
    """Extend the duration of a finished MP4 or MOV, its index at its end, to its last frame, in
    place.

    Raises
    ------
    MediaError
        If the file has no index at its end.
    OSError
        If the file cannot be written.
    """
    change_index(path, _with_extended_durations)


def _with_extended_durations(index: bytes) -> bytes:
    """Return the index of a movie with durations that include all frames of its video tracks."""
    scale, duration, changed = _scale(dict(iterate_boxes(index))[b"mvhd"]), 0, b""
    for kind, body in iterate_boxes(index):
        if kind == b"trak" and is_video(body):
            body, length = _track(body, scale)
            duration = max(duration, length)
        changed += make_box(kind, body)
    return change_box(
        changed, [b"mvhd"], lambda head: _at_least(head, *TIME_SCALE_LAYOUT[head[0]][1:], duration)
    )


def _track(body: bytes, scale: int) -> tuple[bytes, int]:
    """Return a video track with the duration of its frames, and this duration (movie units)."""
    media = dict(iterate_boxes(dict(iterate_boxes(body))[b"mdia"]))
    units = _presentation_duration(media)
    duration = -(-units * scale // _scale(media[b"mdhd"]))  # rounded up, as in FFmpeg
    body = change_box(
        body,
        [b"mdia", b"mdhd"],
        lambda head: _at_least(head, *TIME_SCALE_LAYOUT[head[0]][1:], units),
    )
    body = change_box(body, [b"edts", b"elst"], lambda edits: _extended_edit_list(edits, duration))
    length = _track_duration(body, duration)
    return change_box(
        body, [b"tkhd"], lambda head: _at_least(head, *TRACK_HEADER_LAYOUT[head[0]], length)
    ), length


def _presentation_duration(media: dict[bytes, bytes]) -> int:
    """Return the presentation duration of the frames of a track, in its own units."""
    samples = dict(iterate_boxes(dict(iterate_boxes(media[b"minf"]))[b"stbl"]))
    durations = _expanded_runs(samples[b"stts"])
    decoded = np.concatenate([[0], np.cumsum(durations)[:-1]])
    shifts = _expanded_runs(samples[b"ctts"]) if b"ctts" in samples else np.zeros_like(durations)
    starts = decoded + shifts
    return int((starts + durations).max() - starts.min())


def _expanded_runs(body: bytes) -> NDArray[np.int64]:
    """Expand a run-length table: stts, and ctts with signed values."""
    counts, values = np.frombuffer(body[8:], ">i4").reshape(-1, 2).astype(np.int64).T
    return np.repeat(values, counts)


def _scale(head: bytes) -> int:
    return int(struct.unpack_from(">I", head, TIME_SCALE_LAYOUT[head[0]][0])[0])


def _extended_edit_list(edits: bytes, duration: int) -> bytes:
    """Return an edit list whose last entry, with the frames, covers all of them."""
    form, step = EDIT_LIST_LAYOUT[edits[0]]
    return _at_least(
        edits, form, FIRST_EDIT_OFFSET + step * (int.from_bytes(edits[4:8], "big") - 1), duration
    )


def _track_duration(track: bytes, duration: int) -> int:
    """Return the duration of a track, including an initial empty edit, in units of the movie."""
    edits = dict(iterate_boxes(dict(iterate_boxes(track)).get(b"edts", b""))).get(b"elst")
    if edits is None:
        return duration
    form, step = EDIT_LIST_LAYOUT[edits[0]]
    return sum(
        struct.unpack_from(form, edits, at)[0] for at in range(FIRST_EDIT_OFFSET, len(edits), step)
    )


def _at_least(body: bytes, form: str, at: int, minimum: int) -> bytes:
    """Return the body of a box with the number at an offset raised to a minimum."""
    value = struct.unpack_from(form, body, at)[0]
    return (
        body
        if value >= minimum
        else body[:at] + struct.pack(form, minimum) + body[at + struct.calcsize(form) :]
    )


# -- Panorama metadata (Spherical Video, version 1 and version 2) ------------------------------------
#
# https://github.com/google/spatial-media specifies both: version 1 is an XML text in a uuid box of
# the track, version 2 consists of boxes in the sample description. Both are written, since players
# support one or the other. The boxes are inserted into the finished file without changes to its
# frames.

SPHERICAL_SUFFIXES = (".mp4", ".m4v", ".mov")
V1_UUID = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
SOURCE_NAME = b"omnimirror"
SAMPLE_ENTRY_BYTES = 78  # fixed fields of a video sample entry, before its boxes
MONOSCOPIC = 0


def can_be_spherical(path: str | Path) -> bool:
    """Return whether a video file of that name can store panorama metadata.

    >>> can_be_spherical("room.mp4"), can_be_spherical("room.mkv")
    (True, False)
    """
    return Path(path).suffix.lower() in SPHERICAL_SUFFIXES


def make_spherical(path: Path, panorama: GPano) -> None:
    """Insert the metadata into a finished file whose index is at its end, in place.

    Raises
    ------
    MediaError
        If the file has no index at its end, or no video.
    OSError
        If the file cannot be written.
    """
    change_index(path, lambda index: _with_metadata(index, panorama))


def _with_metadata(index: bytes, panorama: GPano) -> bytes:
    """Return the index of the movie with the metadata in its first video track."""
    parts, is_changed = [], False
    for kind, body in iterate_boxes(index):
        if kind == b"trak" and not is_changed and is_video(body):
            body = change_box(
                body,
                [b"mdia", b"minf", b"stbl", b"stsd"],
                lambda stsd: _sample_descriptions(stsd, panorama),
            )
            body += make_box(b"uuid", V1_UUID + v1_text(panorama))
            is_changed = True
        parts.append(make_box(kind, body))
    if not is_changed:
        raise MediaError("the file must have a video track for spherical metadata")
    return b"".join(parts)


def _sample_descriptions(stsd: bytes, panorama: GPano) -> bytes:
    """Return the sample descriptions, the first with the boxes of version 2."""
    (kind, entry), *others = iterate_boxes(stsd[8:])
    codec, *optional = (make_box(*part) for part in iterate_boxes(entry[SAMPLE_ENTRY_BYTES:]))
    # Version 2 requires a position after the codec's own box and before the optional ones.
    first = make_box(
        kind, entry[:SAMPLE_ENTRY_BYTES] + codec + v2_boxes(panorama) + b"".join(optional)
    )
    return stsd[:8] + first + b"".join(make_box(*other) for other in others)


def v2_boxes(panorama: GPano) -> bytes:
    """Return the boxes st3d and sv3d: monoscopic, equirectangular, pose and bounds."""
    heading = panorama.pose_heading_deg or 0.0
    # Poses are 16.16 degrees: yaw is counter-clockwise, opposite to a heading; pitch is
    # counter-clockwise about the right axis and raises the centre; roll is clockwise.
    yaw = round(((180.0 - heading) % 360.0 - 180.0) * 65536)
    pitch, roll = round(panorama.pitch_deg * 65536), round(panorama.roll_deg * 65536)
    bounds = panorama.bounds
    fractions = (
        min(round(fraction * 2**32), 2**32 - 1)
        for fraction in (bounds.top, bounds.bottom, bounds.left, bounds.right)
    )
    projection = make_box(b"prhd", _full_box(struct.pack(">iii", yaw, pitch, roll))) + make_box(
        b"equi", _full_box(struct.pack(">4I", *fractions))
    )
    spherical = make_box(b"svhd", _full_box(SOURCE_NAME + b"\0")) + make_box(b"proj", projection)
    return make_box(b"st3d", _full_box(bytes([MONOSCOPIC]))) + make_box(b"sv3d", spherical)


def v1_text(panorama: GPano) -> bytes:
    """Return the XML text of version 1, UTF-8."""
    fields: dict[str, object] = {
        "Spherical": "true",
        "Stitched": "true",
        "StitchingSoftware": SOURCE_NAME.decode(),
        **panorama.area(),
    }
    elements = "".join(
        f"<GSpherical:{name}>{value}</GSpherical:{name}>" for name, value in fields.items()
    )
    return (
        '<?xml version="1.0"?><rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
        f'xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/">{elements}</rdf:SphericalVideo>'
    ).encode()


def _full_box(body: bytes) -> bytes:
    """Return the body of a box with version 0 and no flags."""
    return b"\0\0\0\0" + body
