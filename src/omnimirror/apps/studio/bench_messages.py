"""Messages between server and design bench; the TypeScript types of the page are generated from them.

Sensors are transferred as the tables of their file, requirements as those of a requirement file,
non-finite numbers as null.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field

from .messages import ClientMessage, Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


# -- Messages between server and design bench; the TypeScript types of the page are generated from them
#
# Sensors are transferred as the tables of their file (``specs.tables_of``), requirements as those of
# a requirement file, non-finite numbers as null.

Tables = dict[str, Any]
Part = Literal["mirror", "lens"]


class ParameterOf(Message):
    """Metadata of a parameter for its slider, number field and tooltip."""

    name: str
    unit: str
    low: float
    high: float
    description: str
    choices: tuple[str, ...]
    is_list: bool
    is_whole: bool
    is_optional: bool
    default: float | None = Field(description="of an optional number, where it is a number")


class PartOf(Message):
    """Selectable part with its parameters in order."""

    kind: str
    parameters: tuple[ParameterOf, ...]


class QuantityOf(Message):
    """Quantity of the vocabulary of plots, requirements and optimiser."""

    name: str
    symbol: str
    unit: str
    title: str
    meaning: str
    equation: str


class BenchStart(Message):
    """Initial data of the bench."""

    mirrors: tuple[PartOf, ...]
    secondaries: tuple[PartOf, ...]
    lenses: tuple[PartOf, ...]
    imager: PartOf
    place: PartOf = Field(description="of a second mirror")
    mount: PartOf = Field(description="how far the mirror stands")
    pose: PartOf = Field(description="how far the mirror is out of its place")
    columns: tuple[QuantityOf, ...] = Field(
        description="what plots can show against the field angle"
    )
    quantities: tuple[QuantityOf, ...] = Field(description="what a requirement can limit")
    of_frequency: tuple[str, ...] = Field(
        description="those of which a limit says at which spatial frequency"
    )
    merits: tuple[QuantityOf, ...]
    shapes: tuple[str, ...] = Field(description="free forms in which a mirror can be sought")
    sensors: tuple[str, ...]


class Trouble(Message):
    """Error message with the entry that it concerns, if any."""

    path: tuple[str, ...]
    sentence: str


class BenchSensor(Message):
    """Sensor on the bench."""

    tables: Tables
    follows: bool = Field(description="whether the lens stands where the mirror's mapping needs it")


class BenchAlone(Message):
    """Bench data of a page without a server."""

    start: BenchStart
    sensors: tuple[BenchSensor, ...] = Field(description="in the order of their names in start")
    search: tuple[float, ...] = Field(
        description="how a best focus is looked for, as the compiled evaluator takes it"
    )
    kernel: str = Field(description="the compiled evaluator, WebAssembly in base64")
    script: str = Field(description="of the bench")


class Opened(Message):
    """Imported file: a sensor or requirements."""

    sensor: BenchSensor | None
    requirements: Tables | None


class Change(ClientMessage):
    """Change of the kind of mirror or lens, or refocus by a merit."""

    tables: Tables
    what: Literal["mirror", "lens", "focus"]
    to: str = Field(max_length=60)
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")


class Bend(ClientMessage):
    """Manual deformation of a design curve through a point."""

    of: Literal["profile", "mapping"]
    at: float = Field(
        description="where it is held: distance from the axis, mm, or field angle, deg"
    )
    to: float = Field(
        description="where it is pulled: height of the profile, mm, or image height, px"
    )


class Ask(ClientMessage):
    """Evaluation request for a design."""

    slot: int = Field(ge=0, le=8, description="which of the designs shown")
    number: int
    tables: Tables
    follows: bool
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")
    section: bool
    squares: bool
    space: bool = Field(default=False, description="its parts and rays in three dimensions")
    requirements: Tables | None
    bend: Bend | None = Field(
        default=None, description="of which it is answered as it is bent by hand"
    )


class Facts(Message):
    """Scalar properties of a design."""

    name: str
    field_deg: tuple[float, float]
    rim_radius_mm: float
    rim_radius_px: float
    imager_radius_px: float = Field(description="largest circle that the imager holds")
    mirror_distance_mm: float | None
    focus_mm: float
    depth_of_field_mm: tuple[float, float | None]
    airy_px: float
    length_mm: float
    viewpoint_spread_mm: float
    worst_blur_px: float | None
    worst_floored_area_deg2: float | None
    resolution_px_per_deg: tuple[float, float | None]
    not_optimised: str | None = Field(
        description="why its mirror cannot be optimised, if it cannot"
    )


class JudgementOf(Message):
    """Requirement with its achieved value."""

    name: str
    unit: str
    at_least: float | None
    at_most: float | None
    reached: float | None
    margin: float | None
    is_met: bool
    omega_deg: float | None = Field(description="where the worst value is")
    part_deg: tuple[float, float] | None
    limit: int | None = Field(description="which of the limits it is")


class Block(Message):
    """Block of float32 values: named columns of equal length, stored column by column."""

    name: str
    columns: tuple[str, ...]
    rows: int


class BlockValues(NamedTuple):
    """Block with its values, (columns, rows)."""

    block: Block
    values: NDArray[np.float64]


def columns_of(name: str, columns: tuple[str, ...], values: NDArray[np.float64]) -> BlockValues:
    """Return a block of values (columns, rows)."""
    return BlockValues(Block(name=name, columns=columns, rows=values.shape[1]), values)


class Answer(Message):
    """Evaluation of a design; followed by float32 values block by block, non-finite if undefined."""

    slot: int
    number: int
    trouble: Trouble | None
    remark: str | None = Field(description="what of the sensor the plots do not show")
    facts: Facts | None
    rows: tuple[JudgementOf, ...]
    requirements_trouble: str | None
    blocks: tuple[Block, ...]
    bent: BenchSensor | None = Field(description="the design as it was bent")


class Slide(ClientMessage):
    """Number of a design with its candidate values."""

    path: tuple[str, ...] = Field(
        min_length=2, max_length=3, description="table, entry, and which of a list"
    )
    values: tuple[float, ...] = Field(min_length=1, max_length=33)


class SlidesAsk(ClientMessage):
    """Request for the feasible ranges of sliders."""

    tables: Tables
    follows: bool
    requirements: Tables
    slides: tuple[Slide, ...] = Field(max_length=60)


class SlidesOf(Message):
    """Relative violation of each requirement, negative if satisfied; null for an invalid design."""

    missed: tuple[tuple[tuple[float, ...] | None, ...], ...] = Field(
        description="of each slide at each value"
    )


class PictureAsk(ClientMessage):
    """Request for a rendered image of the room and its panorama."""

    tables: Tables
    width_px: int = Field(ge=32, le=1024)
    samples: int = Field(ge=1, le=4)


class Taken(Message):
    """Header of two JPEG files: image and panorama."""

    picture_bytes: int
    panorama_bytes: int


class Download(ClientMessage):
    """Download request for a file of a design."""

    tables: Tables
    kind: Literal["sensor", "table", "sag", "drawing", "report"]
    object_distance_mm: float | None = Field(gt=0)


class FileUnderWay(Message):
    """Progress of a file export."""

    sentence: str
    share: float = Field(description="how much is done")


class RequirementFile(ClientMessage):
    """Export request for a requirement file of a sensor."""

    requirements: Tables
    tables: Tables


class Task(ClientMessage):
    """Long-running task: mirror optimisation or design from requirements."""

    what: Literal["optimise", "design"]
    tables: Tables
    requirements: Tables | None
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")
    merit: str = Field(max_length=40)
    shape: str = Field(max_length=40, description="the free form in which the mirror is sought")
    keeps_limits: bool = Field(
        default=False,
        description="whether an optimised mirror keeps the limits of the requirements",
    )
    terms: int = Field(ge=1, le=32)
    starts: int = Field(ge=1, le=8)


class News(Message):
    """Progress of a task."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null")

    state: Literal["running", "done", "failed"]
    sentence: str
    share: float | None = Field(description="how much is done")
    value: float | None = Field(description="the merit by now")
    sensor: BenchSensor | None


def distance_of(value_mm: float | None) -> float:
    """Decode a transferred distance, mm; null is infinite."""
    return math.inf if value_mm is None else value_mm


# -- Messages between server and tolerance panel of the bench; the types of the page are generated from them

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
