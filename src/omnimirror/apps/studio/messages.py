"""Base classes of all messages between server and page; the messages of a tab are defined in its
package.

The types of the page are generated from them (``web/message_types.py``).
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict


class Message(BaseModel):
    """Base of all messages."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ClientMessage(Message):
    """Message of a client; its numbers are finite."""

    model_config = ConfigDict(allow_inf_nan=False)


class Problem(Message):
    """Error response with the reason."""

    detail: str


class Health(Message):
    """Status of the server."""

    status: Literal["ok"] = "ok"
    version: str
