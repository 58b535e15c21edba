"""SMPTE timecodes of frames (ST 12)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction


def timecode_of(notes: Iterable[Mapping[str, str]]) -> str | None:
    """Return the first timecode in the metadata of a file and its streams."""
    told = (text for note in notes for key, text in note.items() if key.lower() == "timecode")
    return next(told, None)


def later(timecode: str, frames: int, rate: Fraction) -> str:
    """Add a number of frames to a timecode; a semicolon marks drop-frame timecode.

    >>> later("00:00:59;29", 1, Fraction(30000, 1001)), later("00:09:59;29", 1, Fraction(30000, 1001))
    ('00:01:00;02', '00:10:00;00')
    >>> later("23:59:59:24", 26, Fraction(25))
    '00:00:01:00'
    """
    parts = re.fullmatch(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d+)", timecode)
    if parts is None:
        return timecode
    hours, minutes, seconds, frame = (int(parts[i]) for i in (1, 2, 3, 5))
    a_second = round(rate)
    dropped = a_second // 15 if parts[4] != ":" else 0  # per minute, except every tenth
    a_minute, ten_minutes = 60 * a_second - dropped, 600 * a_second - 9 * dropped
    minutes += 60 * hours
    count = (60 * minutes + seconds) * a_second + frame - dropped * (minutes - minutes // 10) + frames
    tens, rest = divmod(count % (144 * ten_minutes), ten_minutes)
    number = rest + tens * 9 * dropped + tens * ten_minutes + (max(0, rest - dropped) // a_minute) * dropped
    seconds, frame = divmod(number, a_second)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{parts[4]}{frame:02}"
