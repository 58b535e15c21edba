"""Strict parsing of JSON bodies and WebSocket messages.

Python's parser accepts more than JSON: NaN and infinity, lone surrogates, integers of any length
and duplicate names. These values cannot be stored or returned, so they are refused here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Coroutine, Iterable, Mapping
from typing import Any, TypeVar

from fastapi import FastAPI, HTTPException, Request, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from starlette.websockets import WebSocketDisconnect

from ...base.arguments import format_value
from ...base.errors import InvalidParameter
from ...base.files import MAX_NESTING

M = TypeVar("M", bound=BaseModel)

MAX_REASON_BYTES = 123
"""Maximum length of the reason in a closing frame of a WebSocket (RFC 6455, 5.5)."""
UNSUPPORTED_DATA = 1003
"""Close code after a message that cannot be accepted."""

# -- parsing -------------------------------------------------------------------------------------


class InvalidMessage(InvalidParameter):
    """Raised for a body or message that is not valid JSON or not of the expected type."""


def parse_body(data: bytes | str) -> Any:
    """Parse a JSON body strictly.

    Raises
    ------
    InvalidMessage
        If the body is not JSON in UTF-8, or contains a non-finite number, an integer beyond 64
        bits, a lone surrogate, a duplicate name, or more than
        :data:`~omnimirror.base.files.MAX_NESTING` nested levels.

    Examples
    --------
    >>> parse_body(b'{"pan_deg": 40}')
    {'pan_deg': 40}
    >>> parse_body("[NaN]")
    Traceback (most recent call last):
    ...
    omnimirror.interop.http_server.request_bodies.InvalidMessage: numbers in the body must be
    finite; got nan
    """
    try:
        text = data.decode("utf-8") if isinstance(data, bytes) else data
        value = json.loads(text, object_pairs_hook=_unique_names)
    except UnicodeDecodeError:
        raise InvalidMessage("the body must be JSON in UTF-8") from None
    except json.JSONDecodeError as e:
        raise InvalidMessage(f"the body must be JSON: {e.msg} at character {e.pos}") from None
    except RecursionError:
        raise InvalidMessage(f"the body must have at most {MAX_NESTING} nested levels") from None
    except ValueError as e:  # an integer with more digits than Python converts
        if isinstance(e, InvalidMessage):
            raise
        raise InvalidMessage("integers in the body must have at most 64 bits") from None
    _check_values(value)
    return value


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        duplicate = next(name for name in names if names.count(name) > 1)
        raise InvalidMessage(
            f"names in the body must be unique; got {format_value(duplicate)} twice"
        )
    return table


def _check_values(value: Any) -> None:
    """Check the values of parsed JSON, level by level."""
    level = [value]
    for _ in range(MAX_NESTING + 1):
        for item in level:
            if isinstance(item, float) and not math.isfinite(item):
                raise InvalidMessage(f"numbers in the body must be finite; got {item}")
            if isinstance(item, int) and not -(2**63) <= item < 2**63:
                raise InvalidMessage(
                    f"integers in the body must have at most 64 bits; got {format_value(item)}"
                )
            if isinstance(item, str) and not _is_encodable(item):
                raise InvalidMessage(
                    f"text in the body must be valid Unicode; got a surrogate in {format_value(item)}"
                )
        level = [part for item in level for part in _items(item)]
        if not level:
            return
    raise InvalidMessage(f"the body must have at most {MAX_NESTING} nested levels")


def _items(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return (*value, *value.values())
    return value if isinstance(value, list) else ()


def _is_encodable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def parse_message(data: bytes | str, model: type[M]) -> M:
    """Parse a JSON message as a pydantic model.

    Raises
    ------
    InvalidMessage
        If the message is invalid; the text names the entry.
    """
    try:
        return model.model_validate(parse_body(data))
    except ValidationError as e:
        errors = [{**error, "loc": ("body", *error["loc"])} for error in e.errors()]
        raise InvalidMessage(validation_message(errors)) from None


def validation_message(errors: Iterable[Mapping[str, Any]]) -> str:
    """Return a sentence about the first validation error of pydantic.

    >>> error = {"type": "greater_than", "loc": ("body", "terms"),
    ...          "msg": "Input should be greater than 0", "input": -1}
    >>> validation_message([error])
    'terms must be greater than 0; got -1'
    """
    first = next(iter(errors))
    path = first["loc"]
    if path[:1] in (("body",), ("query",), ("path",)):
        path = path[1:]
    name, condition = ".".join(map(str, path)) or "the body", str(first["msg"])
    if first["type"] == "missing":
        return f"{name} must be given"
    if first["type"] == "extra_forbidden":
        return f"{name} is unknown; remove it"
    message = condition.replace("Input should ", "must ", 1)
    if not condition.startswith("Input should "):  # another message than that of a simple check
        message = f"is invalid: {condition[0].lower()}{condition[1:]}"
    return f"{name} {message}; got {format_value(first.get('input'))}"


# -- WebSocket -----------------------------------------------------------------------------------


async def receive_message(socket: WebSocket, model: type[M]) -> M:
    """Wait for the next message of a WebSocket and parse it.

    Raises
    ------
    InvalidMessage
        As for :func:`parse_message`, or if the message is binary.
    WebSocketDisconnect
        If the client has closed the WebSocket.
    """
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005), message.get("reason"))
    text = message.get("text")
    if text is None:
        raise InvalidMessage("the message must be JSON text; got a binary message")
    return parse_message(text, model)


async def close_invalid(socket: WebSocket, error: InvalidMessage) -> None:
    """Close the WebSocket of a client that sent an invalid message, with the reason."""
    reason = str(error).encode()[:MAX_REASON_BYTES].decode(errors="ignore")
    await socket.close(UNSUPPORTED_DATA, reason)


# -- HTTP ----------------------------------------------------------------------------------------


class _StrictRequest(Request):
    async def json(self) -> Any:
        try:
            return parse_body(await self.body())
        except InvalidMessage as e:  # FastAPI turns other exceptions into status 400
            raise HTTPException(422, str(e)) from None


class _StrictRoute(APIRoute):
    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle = super().get_route_handler()

        async def handle_strictly(request: Request) -> Response:
            return await handle(_StrictRequest(request.scope, request.receive))

        return handle_strictly


def reject_invalid_bodies(
    app: FastAPI,
    message: Callable[[RequestValidationError], str] = lambda error: validation_message(
        error.errors()
    ),
) -> None:
    """Answer invalid bodies and parameters with status 422 and a sentence.

    Parameters
    ----------
    app
        Application; applies to routes added after this call.
    message
        Returns the sentence for a validation error.
    """
    app.router.route_class = _StrictRoute

    @app.exception_handler(RequestValidationError)
    async def on_validation_error(request: Request, error: RequestValidationError) -> Response:
        return JSONResponse({"detail": message(error)}, 422)

    @app.exception_handler(InvalidMessage)
    async def on_invalid_message(request: Request, error: InvalidMessage) -> Response:
        return JSONResponse({"detail": str(error)}, 422)
