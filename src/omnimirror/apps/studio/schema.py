"""OpenAPI fragments (``/openapi.json``) of uploads, downloads and error responses."""

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
# Error responses are JSON for every content type.
REFUSED: dict[str, Any] = {
    "model": Problem,
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
REFUSALS: dict[int | str, dict[str, Any]] = dict.fromkeys((400, 403, 404, 408, 413, 422, 503, 507), REFUSED)
