"""Binary messages: a header in words, and the bytes that it tells of.

A message is the length of a JSON text (4 bytes, little-endian), the text padded with blanks to a multiple of 4
bytes, and the bytes.
"""

from __future__ import annotations

import struct
from typing import TypeVar

from pydantic import ValidationError

from ..errors import InvalidParameter
from .messages import Message

M = TypeVar("M", bound=Message)


def framed(header: Message, *parts: bytes) -> bytes:
    """A message and the bytes it tells of.

    >>> from .bench.messages import Trouble
    >>> framed(Trouble(path=(), sentence="no"), b"abcd")
    b'\\x1c\\x00\\x00\\x00{"path":[],"sentence":"no"} abcd'
    """
    text = header.model_dump_json().encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(parts)


def unframed(data: bytes, kind: type[M]) -> tuple[M, bytes]:
    """The message and the bytes after it, of a message that came.

    Raises
    ------
    InvalidParameter
        It is none.

    >>> from .bench.messages import Trouble
    >>> unframed(framed(Trouble(path=(), sentence="no"), b"abcd"), Trouble)
    (Trouble(path=(), sentence='no'), b'abcd')
    """
    try:
        (length,) = struct.unpack_from("<I", data)
        return kind.model_validate_json(data[4 : 4 + length]), data[4 + length :]
    except (struct.error, ValidationError):
        raise InvalidParameter("what was sent is no question with a file behind it") from None
