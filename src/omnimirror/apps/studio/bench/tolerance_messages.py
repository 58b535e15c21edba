"""What the server and the bench's tolerances tell each other; the page's types are made from these."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..messages import ClientMessage, Message
from .messages import Tables

Refocus = Literal["none", "rms", "worst"]


class ErrorOf(Message):
    """An error that a sensor can have, and how shops hold it."""

    name: str
    unit: str
    meaning: str
    group: str
    coarse: float
    medium: float
    fine: float


class ErrorsAsk(ClientMessage):
    """Which errors a sensor can have."""

    tables: Tables


class ErrorsOf(Message):
    """The errors of a sensor, and what calibrations are called."""

    errors: tuple[ErrorOf, ...]
    calibrations: tuple[str, ...]
    is_quick: bool = Field(description="whether sensors are traced by the thousand")


class BuiltAsk(ClientMessage):
    """A sensor with errors."""

    tables: Tables
    values: dict[str, float]
    refocus: Refocus


class Built(Message):
    """What errors do; float32 values follow: x, y px of objects, and by calibrations dx, dy px of what is left."""

    objects: int
    lost: int = Field(description="objects that are not shown")
    radius_px: float = Field(description="of the picture without errors")
    motion_px: tuple[float | None, ...] = Field(description="the largest, by calibrations")
    direction_error_deg: tuple[float | None, ...]
    straightness_deg: tuple[float | None, ...]
    blur_px: tuple[float | None, float | None] = Field(description="meant and built")
    focus_mm: tuple[float | None, float | None] = Field(description="meant and built")
    tables: Tables | None = Field(description="the sensor with its errors, if there can be one")


class ToleranceOf(ClientMessage):
    """An error and its tolerance."""

    name: str
    tolerance: float = Field(ge=0)


class YieldAsk(ClientMessage):
    """How many sensors will be good."""

    tables: Tables
    errors: tuple[ToleranceOf, ...] = Field(max_length=200)
    refocus: Refocus
    merit: str = Field(max_length=80)
    limit: float
    trials: int = Field(ge=1, le=100_000)
    seed: int = Field(ge=0)


class ErrorAlone(Message):
    """What an error does alone at its tolerance: the largest motion in px by calibrations, and the limited merit."""

    name: str
    tolerance: float
    motion_px: tuple[float | None, ...]
    merit: float | None


class YieldOf(Message):
    """How many of the sensors built are good, with a confidence of .95."""

    trials: int
    lost: int
    share: float
    low: float
    high: float
    median: float | None
    most: float | None = Field(description="within which 95 % stay")
    rows: tuple[ErrorAlone, ...] = Field(description="the worst first")
