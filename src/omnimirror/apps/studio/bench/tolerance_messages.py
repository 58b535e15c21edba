"""Messages between server and tolerance panel of the bench; the types of the page are generated
from them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..messages import ClientMessage, Message
from .messages import Tables

Refocus = Literal["none", "rms", "worst"]


class ErrorOf(Message):
    """Error source of a sensor with its typical manufacturing tolerance."""

    name: str
    unit: str
    meaning: str
    group: str
    coarse: float
    medium: float
    fine: float


class ErrorsAsk(ClientMessage):
    """Request for the error sources of a sensor."""

    tables: Tables


class ErrorsOf(Message):
    """Error sources of a sensor and names of the calibration models."""

    errors: tuple[ErrorOf, ...]
    calibrations: tuple[str, ...]
    is_quick: bool = Field(description="whether sensors are traced by the thousand")


class BuiltAsk(ClientMessage):
    """Sensor with errors."""

    tables: Tables
    values: dict[str, float]
    refocus: Refocus


class Built(Message):
    """Effect of errors; followed by float32 values: x, y px of objects, and residuals dx, dy px for
    each calibration."""

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
    """Error source with its tolerance."""

    name: str
    tolerance: float = Field(ge=0)


class YieldAsk(ClientMessage):
    """Request for a yield prediction."""

    tables: Tables
    errors: tuple[ToleranceOf, ...] = Field(max_length=200)
    refocus: Refocus
    merit: str = Field(max_length=80)
    limit: float
    trials: int = Field(ge=1, le=100_000)
    seed: int = Field(ge=0)


class ErrorAlone(Message):
    """Effect of a single error at its tolerance: largest motion in px for each calibration, and the
    limited merit."""

    name: str
    tolerance: float
    motion_px: tuple[float | None, ...]
    merit: float | None


class YieldOf(Message):
    """Predicted yield with its 0.95 confidence interval."""

    trials: int
    lost: int
    share: float
    low: float
    high: float
    median: float | None
    most: float | None = Field(description="within which 95 % stay")
    rows: tuple[ErrorAlone, ...] = Field(description="the worst first")
