"""Binary messages: a header in words, and the bytes that it tells of.

A message is the length of a JSON text (4 bytes, little-endian), the text padded with blanks to a multiple of 4
bytes, and the bytes.
"""

from __future__ import annotations

import struct

from .messages import Message


def framed(header: Message, *parts: bytes) -> bytes:
    """A message and the bytes it tells of.

    >>> from .bench.messages import Trouble
    >>> framed(Trouble(path=(), sentence="no"), b"abcd")
    b'\\x1c\\x00\\x00\\x00{"path":[],"sentence":"no"} abcd'
    """
    text = header.model_dump_json().encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(parts)
