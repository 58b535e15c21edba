"""HTTP messages: binary messages of a JSON header with a payload, and OpenAPI fragments (``/openapi.json``)."""

from __future__ import annotations

import struct
from typing import Annotated, Any, TypeVar

import numpy as np
from fastapi import Query

from ...base.typing import Array
from ...interop.http_server.request_bodies import InvalidMessage, parse_message
from .messages import Message, Problem

# -- Binary messages -------------------------------------------------------------------------------
#
# A message consists of the length of a JSON text (4 bytes, little-endian), the text padded with
# blanks to a multiple of 4 bytes, and the payload.

M = TypeVar("M", bound=Message)


def framed(header: Message, *parts: bytes | Array) -> bytes:
    """Encode a header and its payload as one message.

    Arrays are encoded in float32; values beyond its range become infinite.

    >>> from .design_messages import ApiError
    >>> framed(ApiError(path=(), message="no"), b"abcd")
    b'\\x1c\\x00\\x00\\x00{"path":[],"message":"no"}  abcd'
    """
    text = header.model_dump_json().encode()
    text += b" " * (-len(text) % 4)
    with np.errstate(over="ignore"):
        payload = [p if isinstance(p, bytes) else p.astype("<f4").tobytes() for p in parts]
    return struct.pack("<I", len(text)) + text + b"".join(payload)


def unframed(data: bytes, kind: type[M]) -> tuple[M, bytes]:
    """Parse the header of a message; return it with the payload.

    Raises
    ------
    InvalidMessage
        If the message is invalid.

    >>> from .design_messages import ApiError
    >>> unframed(framed(ApiError(path=(), message="no"), b"abcd"), ApiError)
    (ApiError(path=(), message='no'), b'abcd')
    """
    if len(data) < 4:
        raise InvalidMessage(
            "the body must be the length of a JSON message, the message and a file"
        )
    (length,) = struct.unpack_from("<I", data)
    return parse_message(data[4 : 4 + length], kind), data[4 + length :]


# -- OpenAPI fragments -----------------------------------------------------------------------------

BYTES: dict[str, Any] = {"content": {"application/octet-stream": {}}}
PNG: dict[str, Any] = {"content": {"image/png": {}}}
STATUS_MEDIA_TYPE = "application/x-ndjson"
STATUS_LINES: dict[str, Any] = {"content": {STATUS_MEDIA_TYPE: {}}}
FILE_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
FileName = Annotated[str, Query(max_length=200)]
# Error responses are JSON for every content type.
REFUSED: dict[str, Any] = {
    "model": Problem,
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
REFUSALS: dict[int | str, dict[str, Any]] = dict.fromkeys(
    (400, 403, 404, 408, 413, 422, 503, 507), REFUSED
)
