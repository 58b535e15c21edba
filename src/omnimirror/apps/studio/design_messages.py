"""Messages between server and Design tab; the TypeScript types of the page are generated from them.

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


Tables = dict[str, Any]
Part = Literal["mirror", "lens"]


class ParameterInfo(Message):
    """Metadata of a parameter for its slider, number field and tooltip."""

    name: str
    unit: str
    low: float
    high: float
    description: str
    choices: tuple[str, ...]
    is_list: bool
    is_integer: bool
    is_optional: bool
    default: float | None = Field(description="default of an optional number; null if it has none")


class PartInfo(Message):
    """Selectable part with its parameters in order."""

    kind: str
    parameters: tuple[ParameterInfo, ...]


class QuantityInfo(Message):
    """Quantity of the vocabulary of plots, requirements and optimiser."""

    name: str
    symbol: str
    unit: str
    title: str
    meaning: str
    equation: str


class DesignStart(Message):
    """Initial data of the Design tab."""

    mirrors: tuple[PartInfo, ...]
    secondaries: tuple[PartInfo, ...]
    lenses: tuple[PartInfo, ...]
    imager: PartInfo
    secondary_position: PartInfo = Field(description="position of a second mirror")
    mount: PartInfo = Field(description="mirror distance")
    pose: PartInfo = Field(description="misalignment of the mirror")
    columns: tuple[QuantityInfo, ...] = Field(
        description="quantities that can be plotted over the field angle"
    )
    quantities: tuple[QuantityInfo, ...] = Field(
        description="quantities that requirements can limit"
    )
    of_frequency: tuple[str, ...] = Field(
        description="quantities whose limits specify a spatial frequency"
    )
    merits: tuple[QuantityInfo, ...]
    shapes: tuple[str, ...] = Field(description="freeform parametrisations for mirror optimisation")
    sensors: tuple[str, ...]


class ApiError(Message):
    """Error message with the entry that it concerns, if any."""

    path: tuple[str, ...]
    message: str


class DesignSensor(Message):
    """Sensor in the Design tab."""

    tables: Tables
    follows_mapping: bool = Field(
        description="whether the lens position follows the mapping of the mirror"
    )


class StandaloneDesign(Message):
    """Design data of a page without a server."""

    start: DesignStart
    sensors: tuple[DesignSensor, ...] = Field(
        description="sensors in the order of their names in start"
    )
    search: tuple[float, ...] = Field(
        description="parameters of the focus search of the compiled evaluator"
    )
    kernel: str = Field(description="compiled evaluator, WebAssembly in base64")
    script: str = Field(description="script of the Design tab")


class ImportedFile(Message):
    """Imported file: a sensor or requirements."""

    sensor: DesignSensor | None
    requirements: Tables | None


class DesignChange(ClientMessage):
    """Change of the kind of mirror or lens, or refocus by a merit."""

    tables: Tables
    target: Literal["mirror", "lens", "focus"]
    to: str = Field(max_length=60)
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")


class CurveEdit(ClientMessage):
    """Manual deformation of a design curve through a point."""

    of: Literal["profile", "mapping"]
    at: float = Field(
        description="position of the handle: distance from the axis, mm, or field angle, deg"
    )
    to: float = Field(
        description="new value at the handle: height of the profile, mm, or image height, px"
    )


class DesignRequest(ClientMessage):
    """Evaluation request for a design."""

    slot: int = Field(ge=0, le=8, description="index of the displayed design")
    number: int
    tables: Tables
    follows_mapping: bool
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")
    include_section: bool
    include_squares: bool
    include_3d: bool = Field(
        default=False, description="whether to return parts and rays for the 3-D view"
    )
    requirements: Tables | None
    edit: CurveEdit | None = Field(
        default=None, description="manual deformation applied before the evaluation"
    )


class DesignSummary(Message):
    """Scalar properties of a design."""

    name: str
    field_deg: tuple[float, float]
    rim_radius_mm: float
    rim_radius_px: float
    imager_radius_px: float = Field(
        description="radius of the largest circle inscribed in the imager"
    )
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
        description="reason for which the mirror cannot be optimised; null if it can"
    )


class RequirementResult(Message):
    """Requirement with its achieved value."""

    name: str
    unit: str
    at_least: float | None
    at_most: float | None
    value: float | None
    margin: float | None
    is_met: bool
    omega_deg: float | None = Field(description="field angle of the critical value")
    part_deg: tuple[float, float] | None
    limit: int | None = Field(description="index of the limit")


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


class DesignResponse(Message):
    """Evaluation of a design; followed by float32 values block by block, non-finite if undefined."""

    slot: int
    number: int
    error: ApiError | None
    note: str | None = Field(description="properties of the sensor that the plots do not include")
    summary: DesignSummary | None
    rows: tuple[RequirementResult, ...]
    requirements_error: str | None
    blocks: tuple[Block, ...]
    edited: DesignSensor | None = Field(description="deformed design")


class SliderValues(ClientMessage):
    """Number of a design with its candidate values."""

    path: tuple[str, ...] = Field(
        min_length=2, max_length=3, description="table, entry, and index in a list"
    )
    values: tuple[float, ...] = Field(min_length=1, max_length=33)


class SliderRequest(ClientMessage):
    """Request for the feasible ranges of sliders."""

    tables: Tables
    follows_mapping: bool
    requirements: Tables
    sliders: tuple[SliderValues, ...] = Field(max_length=60)


class SliderViolations(Message):
    """Relative violation of each requirement, negative if satisfied; null for an invalid design."""

    violations: tuple[tuple[tuple[float, ...] | None, ...], ...] = Field(
        description="violations by slider and value"
    )


class RenderRequest(ClientMessage):
    """Request for a rendered image of the room and its panorama."""

    tables: Tables
    width_px: int = Field(ge=32, le=1024)
    samples: int = Field(ge=1, le=4)


class RenderHeader(Message):
    """Header of two JPEG files: image and panorama."""

    image_bytes: int
    panorama_bytes: int


class FileRequest(ClientMessage):
    """Download request for a small file of a design."""

    tables: Tables
    kind: Literal["sensor", "table"]
    object_distance_mm: float | None = Field(gt=0)


class RequirementFileRequest(ClientMessage):
    """Export request for a requirement file of a sensor."""

    requirements: Tables
    tables: Tables


class SearchTask(ClientMessage):
    """Long-running task: mirror optimisation or design from requirements."""

    kind: Literal["optimise", "design"]
    tables: Tables
    requirements: Tables | None
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")
    merit: str = Field(max_length=40)
    shape: str = Field(max_length=40, description="freeform parametrisation of the mirror")
    keeps_limits: bool = Field(
        default=False,
        description="whether the optimised mirror must meet the limits of the requirements",
    )
    terms: int = Field(ge=1, le=32)
    starts: int = Field(ge=1, le=8)


class RelaxedValue(Message):
    """Relaxed value of one requirement."""

    name: str
    unit: str
    requested: float
    needed: float


class RelaxationOption(Message):
    """Relaxation of one or several requirements with which a design meets all of them."""

    values: tuple[RelaxedValue, ...]
    requirements: Tables = Field(description="relaxed requirements")


class TaskStatus(Message):
    """Progress of a task."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null")

    state: Literal["waiting", "running", "done", "failed"]
    message: str
    fraction: float | None = Field(description="completed fraction")
    value: float | None = Field(description="current merit")
    sensor: DesignSensor | None = Field(description="result; without relaxations while running")
    relaxations: tuple[RelaxationOption, ...]


# -- Export ----------------------------------------------------------------------------------------


class ExportableFile(Message):
    """File that the export offers."""

    name: str
    title: str
    is_for_manufacturing: bool = Field(description="whether it is part of the archive by default")
    missing: tuple[str, ...] = Field(description="required packages that are not installed")


class WorkshopEntry(Message):
    """Entry of the workshop data: text with a maximum length, or number with a range."""

    name: str
    label: str
    unit: str
    description: str
    default: str | float | None
    max_length: int | None = Field(description="maximum length of a text; null for a number")
    low: float | None
    high: float | None


class WorkshopSection(Message):
    """Table of the workshop data."""

    name: str
    title: str
    entries: tuple[WorkshopEntry, ...]


class ExportStart(Message):
    """Formats of the export, and entries of the workshop data."""

    formats: tuple[ExportableFile, ...]
    workshop: tuple[WorkshopSection, ...]
    remedy: str | None = Field(description="how to install the missing packages")


class ToleranceValue(ClientMessage):
    """Error source with its tolerance."""

    name: str
    tolerance: float = Field(ge=0)


Refocus = Literal["none", "rms", "worst"]


class TolerancePlanMessage(ClientMessage):
    """Tolerances and the limit of one merit."""

    errors: tuple[ToleranceValue, ...] = Field(max_length=200)
    refocus: Refocus
    merit: str = Field(max_length=80)
    limit: float


class ExportTask(ClientMessage):
    """Export of one or several files of a design."""

    tables: Tables
    requirements: Tables | None
    object_distance_mm: float | None = Field(gt=0, description="null: infinite")
    formats: tuple[str, ...] = Field(min_length=1, max_length=60)
    is_archive: bool = Field(description="whether to return an archive with a README")
    workshop: dict[str, dict[str, str | float | None]] = Field(
        description="workshop data by section; null and missing entries have their defaults"
    )
    tolerances: TolerancePlanMessage | None = Field(
        description="tolerances of the report and of drawings; null: medium grade in the report, "
        "and none in drawings"
    )


class ExportStatus(Message):
    """Progress of an export; the last one is followed by the bytes of the file."""

    state: Literal["waiting", "running", "done", "failed"]
    message: str
    fraction: float | None = Field(description="completed fraction")
    entry: tuple[str, str] | None = Field(
        description="section and entry of the workshop data that an error concerns"
    )
    name: str | None = Field(description="name of the file")
    remarks: tuple[str, ...] = Field(description="missing entries, conflicts and inaccuracies")


def distance_of(value_mm: float | None) -> float:
    """Decode a transferred distance, mm; null is infinite."""
    return math.inf if value_mm is None else value_mm


# -- Tolerances ------------------------------------------------------------------------------------


class ErrorSourceInfo(Message):
    """Error source of a sensor with its typical manufacturing tolerance."""

    name: str
    unit: str
    meaning: str
    group: str
    coarse: float
    medium: float
    fine: float


class ErrorSourcesRequest(ClientMessage):
    """Request for the error sources of a sensor."""

    tables: Tables


class ErrorSourceList(Message):
    """Error sources of a sensor and names of the calibration models."""

    errors: tuple[ErrorSourceInfo, ...]
    calibrations: tuple[str, ...]
    is_vectorised: bool = Field(description="whether ray tracing is vectorised over sensors")


class AsBuiltRequest(ClientMessage):
    """Sensor with errors."""

    tables: Tables
    values: dict[str, float]
    refocus: Refocus


class AsBuiltResult(Message):
    """Effect of errors; followed by float32 values: x, y px of objects, and residuals dx, dy px for
    each calibration."""

    objects: int
    lost: int = Field(description="number of objects that are not imaged")
    radius_px: float = Field(description="image radius without errors")
    motion_px: tuple[float | None, ...] = Field(
        description="maximum displacement after each calibration"
    )
    direction_error_deg: tuple[float | None, ...]
    straightness_deg: tuple[float | None, ...]
    blur_px: tuple[float | None, float | None] = Field(description="nominal and as-built value")
    focus_mm: tuple[float | None, float | None] = Field(description="nominal and as-built value")
    tables: Tables | None = Field(description="sensor with errors; null if it is invalid")


class YieldRequest(ClientMessage):
    """Request for a yield prediction."""

    tables: Tables
    errors: tuple[ToleranceValue, ...] = Field(max_length=200)
    refocus: Refocus
    merit: str = Field(max_length=80)
    limit: float
    trials: int = Field(ge=1, le=100_000)
    seed: int = Field(ge=0)


class SingleErrorEffect(Message):
    """Effect of a single error at its tolerance: largest motion in px for each calibration, and the
    limited merit."""

    name: str
    tolerance: float
    motion_px: tuple[float | None, ...]
    merit: float | None


class YieldResult(Message):
    """Predicted yield with its 0.95 confidence interval."""

    trials: int
    lost: int
    fraction: float
    low: float
    high: float
    median: float | None
    quantile_95: float | None = Field(description="95 % quantile")
    rows: tuple[SingleErrorEffect, ...] = Field(description="in descending order")
