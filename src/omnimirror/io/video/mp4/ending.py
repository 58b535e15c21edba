"""Correction of the duration of fragmented MP4 files, for which FFmpeg writes too small a value.

At the end of a fragment the muxer (``mov_write_packet`` of movenc.c, FFmpeg 8.1) discards the
maximum presentation time and continues from the next packet. Packets are in decoding order: this
one may be presented before others in the file (B-frames). If none is presented after those, the
edit list ends before them, and players omit the last frames of a video. The index contains the
correct times.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .index import box, boxes, change_index, inside, is_video

SCALED = {0: (12, ">I", 16), 1: (20, ">Q", 24)}
"""Layout of mvhd and mdhd by version: offset of the time scale, format and offset of the duration.
"""
TRACK = {0: (">I", 20), 1: (">Q", 28)}
"""Layout of tkhd likewise; its duration has the time scale of the movie."""
EDIT = {0: (">I", 12), 1: (">Q", 20)}
"""Layout of elst: format of a duration, at the start of each entry, and size of an entry in bytes.
"""
FIRST_EDIT = 8


def show_to_the_last(path: Path) -> None:
    """Extend the duration of a finished MP4 or MOV, its index at its end, to its last frame, in
    place.

    Raises
    ------
    MediaError
        The file has no index at its end.
    OSError
        The file cannot be written.
    """
    change_index(path, _lasting)


def _lasting(index: bytes) -> bytes:
    """Return the index of a movie with durations that include all frames of its video tracks."""
    scale, latest, told = _scale(dict(boxes(index))[b"mvhd"]), 0, b""
    for kind, body in boxes(index):
        if kind == b"trak" and is_video(body):
            body, length = _track(body, scale)
            latest = max(latest, length)
        told += box(kind, body)
    return inside(told, [b"mvhd"], lambda head: _at_least(head, *SCALED[head[0]][1:], latest))


def _track(body: bytes, scale: int) -> tuple[bytes, int]:
    """Return a video track with the duration of its frames, and this duration (movie units)."""
    media = dict(boxes(dict(boxes(body))[b"mdia"]))
    units = _shown(media)
    shown = -(-units * scale // _scale(media[b"mdhd"]))  # rounded up, as in FFmpeg
    body = inside(body, [b"mdia", b"mdhd"], lambda head: _at_least(head, *SCALED[head[0]][1:], units))
    body = inside(body, [b"edts", b"elst"], lambda edits: _edited(edits, shown))
    length = _length(body, shown)
    return inside(body, [b"tkhd"], lambda head: _at_least(head, *TRACK[head[0]], length)), length


def _shown(media: dict[bytes, bytes]) -> int:
    """Return the presentation duration of the frames of a track, in its own units."""
    samples = dict(boxes(dict(boxes(media[b"minf"]))[b"stbl"]))
    durations = _repeated(samples[b"stts"])
    decoded = np.concatenate([[0], np.cumsum(durations)[:-1]])
    shifts = _repeated(samples[b"ctts"]) if b"ctts" in samples else np.zeros_like(durations)
    begins = decoded + shifts
    return int((begins + durations).max() - begins.min())


def _repeated(body: bytes) -> NDArray[np.int64]:
    """Expand a run-length table: stts, and ctts with signed values."""
    counts, values = np.frombuffer(body[8:], ">i4").reshape(-1, 2).astype(np.int64).T
    return np.repeat(values, counts)


def _scale(head: bytes) -> int:
    return int(struct.unpack_from(">I", head, SCALED[head[0]][0])[0])


def _edited(edits: bytes, shown: int) -> bytes:
    """Return an edit list whose last entry, with the frames, covers all of them."""
    form, step = EDIT[edits[0]]
    return _at_least(edits, form, FIRST_EDIT + step * (int.from_bytes(edits[4:8], "big") - 1), shown)


def _length(track: bytes, shown: int) -> int:
    """Return the duration of a track, including an initial empty edit, in units of the movie."""
    edits = dict(boxes(dict(boxes(track)).get(b"edts", b""))).get(b"elst")
    if edits is None:
        return shown
    form, step = EDIT[edits[0]]
    return sum(struct.unpack_from(form, edits, at)[0] for at in range(FIRST_EDIT, len(edits), step))


def _at_least(body: bytes, form: str, at: int, least: int) -> bytes:
    """Return the body of a box with the number at an offset raised to a minimum."""
    found = struct.unpack_from(form, body, at)[0]
    return body if found >= least else body[:at] + struct.pack(form, least) + body[at + struct.calcsize(form) :]
