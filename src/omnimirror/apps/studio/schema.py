"""What the server's own description, ``/openapi.json``, says of files handed up and down, and of refusals."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Query

from .messages import Problem

BYTES: dict[str, Any] = {"content": {"application/octet-stream": {}}}
PNG: dict[str, Any] = {"content": {"image/png": {}}}
FILE_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
FileName = Annotated[str, Query(max_length=200)]
# Refusals are JSON, whatever the answer would have been.
REFUSED: dict[str, Any] = {
    "model": Problem,
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
REFUSALS: dict[int | str, dict[str, Any]] = dict.fromkeys((400, 403, 404, 408, 413, 422, 503, 507), REFUSED)
