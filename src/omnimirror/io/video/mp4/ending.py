"""The end of an MP4 that was written in fragments, where FFmpeg takes it for earlier than it is.

Where a fragment ends, its muxer (``mov_write_packet`` of movenc.c, FFmpeg 8.1) forgets how far the pictures reached and
goes on from the one that comes next. Pictures are stored as decoders need them, so that this one may be shown before
others that are in the file already (B-frames); if none is shown after those, the edit list ends before them, and
players leave out the last of a video. Its index knows better.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .index import box, boxes, change_index, inside, is_video

SCALED = {0: (12, ">I", 16), 1: (20, ">Q", 24)}
"""Of mvhd and mdhd by version: where units a second stand, how a duration is written, and where."""
TRACK = {0: (">I", 20), 1: (">Q", 28)}
"""The same of tkhd, which counts in the movie's units."""
EDIT = {0: (">I", 12), 1: (">Q", 20)}
"""Of elst: how a duration is written, with which each entry begins, and the bytes of an entry."""
FIRST_EDIT = 8


def show_to_the_last(path: Path) -> None:
    """Let a finished MP4 or MOV, its index at its end, last until its last picture was shown, in place.

    Raises
    ------
    MediaError
        The file has no index at its end.
    OSError
        The file cannot be written.
    """
    change_index(path, _lasting)


def _lasting(index: bytes) -> bytes:
    """A movie's index in which no video track ends before its pictures do."""
    scale, latest, told = _scale(dict(boxes(index))[b"mvhd"]), 0, b""
    for kind, body in boxes(index):
        if kind == b"trak" and is_video(body):
            body, length = _track(body, scale)
            latest = max(latest, length)
        told += box(kind, body)
    return inside(told, [b"mvhd"], lambda head: _at_least(head, *SCALED[head[0]][1:], latest))


def _track(body: bytes, scale: int) -> tuple[bytes, int]:
    """A video track that lasts as long as its pictures, and how long that is, in the movie's units."""
    media = dict(boxes(dict(boxes(body))[b"mdia"]))
    units = _shown(media)
    shown = -(-units * scale // _scale(media[b"mdhd"]))  # rounded up, as FFmpeg does
    body = inside(body, [b"mdia", b"mdhd"], lambda head: _at_least(head, *SCALED[head[0]][1:], units))
    body = inside(body, [b"edts", b"elst"], lambda edits: _edited(edits, shown))
    length = _length(body, shown)
    return inside(body, [b"tkhd"], lambda head: _at_least(head, *TRACK[head[0]], length)), length


def _shown(media: dict[bytes, bytes]) -> int:
    """How long the pictures of a track are shown, in its own units."""
    samples = dict(boxes(dict(boxes(media[b"minf"]))[b"stbl"]))
    durations = _repeated(samples[b"stts"])
    decoded = np.concatenate([[0], np.cumsum(durations)[:-1]])
    shifts = _repeated(samples[b"ctts"]) if b"ctts" in samples else np.zeros_like(durations)
    begins = decoded + shifts
    return int((begins + durations).max() - begins.min())


def _repeated(body: bytes) -> NDArray[np.int64]:
    """Values of a table of how often each comes: stts, and ctts, whose are signed."""
    counts, values = np.frombuffer(body[8:], ">i4").reshape(-1, 2).astype(np.int64).T
    return np.repeat(values, counts)


def _scale(head: bytes) -> int:
    return int(struct.unpack_from(">I", head, SCALED[head[0]][0])[0])


def _edited(edits: bytes, shown: int) -> bytes:
    """An edit list whose last entry, which shows the pictures, lasts for all of them."""
    form, step = EDIT[edits[0]]
    return _at_least(edits, form, FIRST_EDIT + step * (int.from_bytes(edits[4:8], "big") - 1), shown)


def _length(track: bytes, shown: int) -> int:
    """How long a track is, waiting for its first picture included, in the movie's units."""
    edits = dict(boxes(dict(boxes(track)).get(b"edts", b""))).get(b"elst")
    if edits is None:
        return shown
    form, step = EDIT[edits[0]]
    return sum(struct.unpack_from(form, edits, at)[0] for at in range(FIRST_EDIT, len(edits), step))


def _at_least(body: bytes, form: str, at: int, least: int) -> bytes:
    """A box's body in which the number at a place is no less than that."""
    found = struct.unpack_from(form, body, at)[0]
    return body if found >= least else body[:at] + struct.pack(form, least) + body[at + struct.calcsize(form) :]
