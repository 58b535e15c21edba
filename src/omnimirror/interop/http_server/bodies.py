"""JSON bodies and messages from clients, parsed strictly in one place.

Python's parser accepts more than JSON: NaN and infinity, lone surrogates, whole numbers of any length, names that occur
twice. None of these can be stored, computed with or sent back, so that they are refused before anything else sees them.
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

from ...arguments import shown
from ...errors import InvalidParameter
from ...files import MOST_NESTED

M = TypeVar("M", bound=BaseModel)

MAX_REASON_BYTES = 123
"""Length of the reason in a closing frame of a WebSocket (RFC 6455, 5.5)."""
UNACCEPTABLE = 1003
"""Code that closes a WebSocket after a message that cannot be accepted."""


class InvalidMessage(InvalidParameter):
    """A body or message is not valid JSON, or not what the route expects."""


def parse_body(data: bytes | str) -> Any:
    """Parse a JSON body, and refuse what Python's parser accepts beyond JSON.

    Raises
    ------
    InvalidMessage
        It is not JSON in UTF-8; or it holds a number that is not finite or a whole number beyond 64 bits, a lone
        surrogate, a name twice, or more than :data:`~omnimirror.files.MOST_NESTED` nested levels.

    Examples
    --------
    >>> parse_body(b'{"pan_deg": 40}')
    {'pan_deg': 40}
    >>> parse_body("[NaN]")
    Traceback (most recent call last):
    ...
    omnimirror.interop.http_server.bodies.InvalidMessage: the body must hold finite numbers; got nan
    """
    try:
        text = data.decode("utf-8") if isinstance(data, bytes) else data
        value = json.loads(text, object_pairs_hook=_unique)
    except UnicodeDecodeError:
        raise InvalidMessage("the body must be JSON in UTF-8; it holds other bytes") from None
    except json.JSONDecodeError as e:
        raise InvalidMessage(f"the body must be JSON: {e.msg} at character {e.pos}") from None
    except RecursionError:
        raise InvalidMessage(f"the body must have at most {MOST_NESTED} nested levels") from None
    except ValueError as e:  # a whole number of more digits than Python converts
        if isinstance(e, InvalidMessage):
            raise
        raise InvalidMessage("the body must hold whole numbers of at most 64 bits") from None
    _check(value)
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidMessage(f"the body must hold every name once; {shown(twice)} occurs more often")
    return table


def _check(value: Any) -> None:
    """Check the values of parsed JSON, level by level."""
    level = [value]
    for _ in range(MOST_NESTED + 1):
        for item in level:
            if isinstance(item, float) and not math.isfinite(item):
                raise InvalidMessage(f"the body must hold finite numbers; got {item}")
            if isinstance(item, int) and not -(2**63) <= item < 2**63:
                raise InvalidMessage(f"the body must hold whole numbers of at most 64 bits; got {shown(item)}")
            if isinstance(item, str) and not _is_text(item):
                raise InvalidMessage(f"the body must hold whole characters; got the surrogate in {shown(item)}")
        level = [part for item in level for part in _parts(item)]
        if not level:
            return
    raise InvalidMessage(f"the body must have at most {MOST_NESTED} nested levels")


def _parts(item: Any) -> Iterable[Any]:
    if isinstance(item, dict):
        return (*item, *item.values())
    return item if isinstance(item, list) else ()


def _is_text(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def message_from(data: bytes | str, kind: type[M]) -> M:
    """Parse a JSON message of one kind.

    Raises
    ------
    InvalidMessage
        It is not valid JSON, or not of that kind; the message names the entry.
    """
    try:
        return kind.model_validate(parse_body(data))
    except ValidationError as e:
        raise InvalidMessage(
            invalid_entry([{**error, "loc": ("body", *error["loc"])} for error in e.errors()])
        ) from None


async def received(socket: WebSocket, kind: type[M]) -> M:
    """Wait for the next message of a WebSocket, and parse it.

    Raises
    ------
    InvalidMessage
        As for :func:`message_from`; or the message is binary.
    WebSocketDisconnect
        The client has closed the WebSocket.
    """
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005), message.get("reason"))
    text = message.get("text")
    if text is None:
        raise InvalidMessage("the message must be JSON text; got a binary one")
    return message_from(text, kind)


async def close_refused(socket: WebSocket, error: InvalidMessage) -> None:
    """Close a WebSocket whose client sent an invalid message, with the reason."""
    reason = str(error).encode()[:MAX_REASON_BYTES].decode(errors="ignore")
    await socket.close(UNACCEPTABLE, reason)


def invalid_entry(errors: Iterable[Mapping[str, Any]]) -> str:
    """Return a sentence about the first entry that is not valid.

    >>> error = {"type": "greater_than", "loc": ("body", "terms"), "msg": "Input should be greater than 0", "input": -1}
    >>> invalid_entry([error])
    'terms must be greater than 0; got -1'
    """
    first = next(iter(errors))
    path = first["loc"][1:] if first["loc"][:1] in (("body",), ("query",), ("path",)) else first["loc"]
    name, condition, given = ".".join(map(str, path)) or "the body", str(first["msg"]), first.get("input")
    if first["type"] == "missing":
        return f"{name} must be given"
    if first["type"] == "extra_forbidden":
        return f"{name} is not known here; leave it out"
    words = condition[0].lower() + condition[1:]
    words = (
        words.replace("input should ", "must ", 1) if words.startswith("input should ") else f"is not valid: {words}"
    )
    return f"{name} {words}; got {shown(given)}"


# -- HTTP ----------------------------------------------------------------------------------------------


class _StrictRequest(Request):
    async def json(self) -> Any:
        try:
            return parse_body(await self.body())
        except InvalidMessage as e:  # FastAPI makes 400 of any other error
            raise HTTPException(422, str(e)) from None


class _StrictRoute(APIRoute):
    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle = super().get_route_handler()

        async def strictly(request: Request) -> Response:
            return await handle(_StrictRequest(request.scope, request.receive))

        return strictly


def refuse_invalid_bodies(
    app: FastAPI, sentence: Callable[[RequestValidationError], str] = lambda error: invalid_entry(error.errors())
) -> None:
    """Answer invalid bodies and parameters with 422 and a sentence, on every route that is added from here on.

    Parameters
    ----------
    app
    sentence
        Explains what the framework found to be wrong.
    """
    app.router.route_class = _StrictRoute

    @app.exception_handler(RequestValidationError)
    async def misread(request: Request, error: RequestValidationError) -> Response:
        return JSONResponse({"detail": sentence(error)}, 422)

    @app.exception_handler(InvalidMessage)
    async def invalid(request: Request, error: InvalidMessage) -> Response:
        return JSONResponse({"detail": str(error)}, 422)
