"""What all messages between server and page share; those of a tab stand beside its routes.

The page's types are made from them (``web/message_types.py``).
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict


class Message(BaseModel):
    """Something told."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ClientMessage(Message):
    """Message of a client; its numbers are finite."""

    model_config = ConfigDict(allow_inf_nan=False)


class Problem(Message):
    """Why something was refused, in a sentence."""

    detail: str


class Health(Message):
    """That the server is there."""

    status: Literal["ok"] = "ok"
    version: str
