"""Job files of batch processing: inputs, sensors, views and outputs of an image archive."""

from __future__ import annotations

import fnmatch
import glob
import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from string import Formatter
from typing import Annotated, Any, Literal

from pydantic import Field

from ...base.arguments import file_name, validate_arguments
from ...base.block_runner import Retries
from ...base.caching import cached_property
from ...base.errors import InvalidParameter, SpecError
from ...base.files import json_plain, parse_toml, read_text
from ...base.table_models import Table, validated
from ...base.toml_validation import SourceLocator, did_you_mean, merge_tables
from ...io.batch import IMAGE_SUFFIXES, WRITABLE_VIDEO_SUFFIXES
from ...optics.camera_files import format_camera, load_camera
from ..named_views import MAX_VIEWS, NamedView, parse_view
from .stores import Store, is_remote, join_url

OutputKind = Literal["files", "webdataset", "zarr", "video"]
Count = Annotated[int, Field(ge=1, le=1_000_000)]


class InputTable(Table):
    """Inputs and the parts of their names."""

    files: list[str] = Field(default=[], description="globs, folders or URLs of images")
    list_file: str | None = Field(default=None, description="text file with one name per line")
    table: str | None = Field(default=None, description="CSV or Parquet file with the column path")
    shards: list[str] = Field(
        default=[], description="globs of tar, tar.gz, zip and WebDataset files"
    )
    arrays: list[str] = Field(
        default=[], description="Zarr arrays with images along the first axis"
    )
    videos: list[str] = Field(default=[], description="globs of videos")
    segment_s: float = Field(
        default=60.0, gt=0, description="minimum duration of a video segment, s"
    )
    camera: str | None = Field(
        default=None, description="regular expression with a group for the camera"
    )
    time: str | None = Field(
        default=None, description="time format in the names, such as %Y%m%d_%H%M%S"
    )
    identity: Literal["stat", "name"] = Field(
        default="stat", description="whether size and modification time identify an input"
    )


class SensorRule(Table):
    """Sensor of the inputs of a camera from a mounting date."""

    file: str = Field(description="sensor file, camera file or bundled sensor")
    camera: str = Field(default="*", description="camera id or pattern")
    since: datetime | date | None = Field(default=None, description="mounting date")
    until: datetime | date | None = Field(default=None, description="end of use, exclusive")


class DewarpTable(Table):
    """Dewarping settings, as in ``omnimirror dewarp``."""

    interpolation: str = "auto"
    viewpoint: str | float = "exact"
    border: str | float | None = None
    keep_tilt: bool = False
    stored_orientation: bool = False
    transparent: bool | None = None


class RestorationTable(Table):
    """Deblurring before dewarping, as by :class:`omnimirror.Restoration`."""

    noise: float | None = None
    object_distance_mm: float | None = None
    blur_px: float | str | None = None


class RenderTable(Table):
    """Training dataset, as by :func:`omnimirror.write_training_dataset`."""

    path: str = Field(description="CSV or TOML file with poses over time")
    scene: str = "room"
    texel_mm: float | None = None
    frame_rate: float = Field(default=25.0, gt=0)
    duration_s: float | None = None
    samples: Count = 4
    blur: bool = False
    seed: int = 0


class OutputTable(Table):
    """Location and format of the outputs."""

    url: str = Field(description="folder or URL")
    kind: OutputKind = "files"
    format: str = Field(default=".png", description="suffix of images or videos")
    name: str = Field(
        default="{folder}{stem}-{view}-{digest}",
        description="template of file names without suffix",
    )
    per_shard: Count = Field(
        default=1000, description="samples per WebDataset shard or frames per video"
    )
    chunk: Count = Field(default=16, description="images per Zarr chunk")
    frame_rate: float = Field(default=25.0, gt=0)
    codec: str | None = None
    crf: int | None = None
    pixel_format: str | None = None


class ExecutionTable(Table):
    """Execution; without effect on the outputs."""

    workers: Count | None = Field(
        default=None, description="number of processes; all cores by default"
    )
    retries: Annotated[int, Field(ge=0, le=20)] = 4
    retry_delay_s: Annotated[float, Field(ge=0, le=60)] = 0.5
    per_block: Count = Field(default=32, description="images per block of file outputs")
    read_ahead: Annotated[int, Field(ge=0, le=256)] | None = Field(
        default=None, description="images read ahead per worker; 0 for local files, 8 for URLs"
    )
    write_behind: Annotated[int, Field(ge=0, le=256)] | None = Field(
        default=None, description="images written in the background; 0 for local files, 8 for URLs"
    )
    reconnect_s: Annotated[float, Field(ge=0)] = 120.0


TABLES: dict[str, type[Table]] = {
    "inputs": InputTable,
    "dewarp": DewarpTable,
    "restoration": RestorationTable,
    "render": RenderTable,
    "output": OutputTable,
    "execution": ExecutionTable,
}
JOB_ENTRIES = (*TABLES, "sensor", "view", "storage")
"""Tables of a job file."""


@dataclass(frozen=True)
class AssignedSensor:
    """Sensor of a rule, as text without reference to files."""

    rule: SensorRule
    name: str
    text: str

    @property
    def digest(self) -> str:
        """Digest of the sensor, independent of comments and the file name."""
        return digest_of(self.text)

    def applies(self, camera: str, time: float | None) -> bool:
        """Return whether the rule applies to an input of a camera at a time (s since 1970)."""
        if not fnmatch.fnmatchcase(camera, self.rule.camera):
            return False
        since, until = _timestamp(self.rule.since), _timestamp(self.rule.until)
        if since is None and until is None:
            return True
        return time is not None and (since or time) <= time and (until is None or time < until)


@dataclass(frozen=True)
class BatchJob:
    """Batch job: the content of a job file.

    Parameters
    ----------
    folder
        Folder of relative names.
    inputs, dewarp, output, execution
        Tables of the file.
    sensors
        Sensors with their rules, in the order of the file; the first that applies is used.
    views
        Views by name.
    restoration, render
        Optional tables.
    storage
        Options of fsspec file systems.

    Examples
    --------
    >>> job = parse_job(
    ...     "[inputs]\\nfiles = ['raw/*.jpg']\\n[[sensor]]\\nfile = 'paper-spherical'\\n"
    ...     "[view.panorama]\\nview = 'panorama'\\n[output]\\nurl = 'out'"
    ... )
    >>> job.output.kind, list(job.views)
    ('files', ['panorama'])
    """

    folder: Path
    inputs: InputTable
    sensors: tuple[AssignedSensor, ...]
    views: Mapping[str, NamedView]
    output: OutputTable
    dewarp: DewarpTable = field(default_factory=DewarpTable)
    restoration: RestorationTable | None = None
    render: RenderTable | None = None
    execution: ExecutionTable = field(default_factory=ExecutionTable)
    storage: Mapping[str, Any] = field(default_factory=dict)

    @property
    def output_url(self) -> str:
        """Absolute URL of the outputs."""
        return self.resolve(self.output.url)

    def resolve(self, name: str, is_pattern: bool = False) -> str:
        """Return the absolute form of a name in the file, or of a pattern."""
        folder = str(self.folder.absolute())
        url = join_url(glob.escape(folder) if is_pattern else folder, name)
        return url if is_remote(url) else os.path.normpath(url)

    def sensor_of(self, camera: str, time: float | None) -> AssignedSensor | None:
        """Return the sensor of an input; None if no rule applies."""
        return next((each for each in self.sensors if each.applies(camera, time)), None)

    def missing_sensor_message(self, camera: str, time: float | None) -> str:
        """Return why no rule applies to an input, and the remedy."""
        of_camera = f" to camera {camera!r}" if camera else ""
        if time is None and any(each.rule.since or each.rule.until for each in self.sensors):
            form = f" of the format {self.inputs.time}" if self.inputs.time else ""
            return (
                f"no [[sensor]] applies{of_camera}: since and until require a time, and the name "
                f"contains none{form}; correct inputs.time, or add a [[sensor]] without dates"
            )
        when = "" if time is None else f" at {datetime.fromtimestamp(time, UTC):%Y-%m-%d %H:%M:%S}"
        return f"no [[sensor]] applies{of_camera}{when}; add one"

    @property
    def retries(self) -> Retries:
        """Repetition after transient errors."""
        return Retries(1 + self.execution.retries, self.execution.retry_delay_s)

    def store(self, url: str | None = None) -> Store:
        """Return the store of a URL, by default of the outputs."""
        return Store(url or self.output_url, self.storage, self.retries)

    @cached_property
    def view_digests(self) -> dict[str, str]:
        """Digests of the views with all settings that affect their pixels."""
        common: list[Any] = [
            self.dewarp.model_dump(),
            self.restoration and self.restoration.model_dump(),
            self.render and self.render.model_dump(),
            self.output.kind,
            self.output.format,
        ]
        if self.output.kind == "video":
            common += [self.output.frame_rate, self.output.codec, self.output.crf]
            common.append(self.output.pixel_format)
        return {
            name: digest_of([view and [view.kind, dict(view.options)], common])
            for name, view in self.tasks.items()
        }

    @property
    def tasks(self) -> dict[str, NamedView | None]:
        """Views by name; ``restored`` or ``rendered`` for jobs without views."""
        if self.views:
            return dict(self.views)
        return {"rendered" if self.render else "restored": None}


def digest_of(data: Any) -> str:
    """Return a digest of JSON data in 32 hexadecimal digits.

    >>> digest_of(["a", 1]) == digest_of(("a", 1)), len(digest_of("a"))
    (True, 32)
    """
    text = json.dumps(json_plain(data), sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@validate_arguments
def load_job(path: str | Path, changes: Mapping[str, Any] | None = None) -> BatchJob:
    """Read a job file.

    Parameters
    ----------
    path
        Name of the TOML file.
    changes
        Replacements for entries: ``{"output": {"kind": "zarr"}}``; None removes an entry.

    Returns
    -------
    BatchJob
        Job with loaded sensors.

    Raises
    ------
    SpecError
        If the file or a sensor does not exist, or an entry is unknown, missing or invalid.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.batch.load_job("missing.toml")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.SpecError: path must be an existing job file; got 'missing.toml'
    """
    path = file_name("path", path)
    absent = f"path must be an existing job file; got {str(path)!r}"
    text = read_text(path, "job file", SpecError, absent)
    return parse_job(text, str(path), path.parent, changes)


def parse_job(
    text: str,
    source: str = "job file",
    folder: Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> BatchJob:
    """Parse the text of a job file; names are relative to ``folder``, as in :func:`load_job`."""
    where = SourceLocator(text, source)
    data = merge_tables(parse_toml(text, source), changes or {})
    for name, value in data.items():
        if name not in JOB_ENTRIES:
            raise where.error(
                (name,),
                f"unknown table {name}{did_you_mean(name, JOB_ENTRIES)}; "
                f"use {', '.join(JOB_ENTRIES)}",
            )
        if not isinstance(value, list if name == "sensor" else dict):
            noun = "[[sensor]]" if name == "sensor" else f"[{name}]"
            raise where.error((name,), f"{name} must be a table {noun}")
    tables: dict[str, Any] = {
        name: validated(model, name, data[name], where)
        for name, model in TABLES.items()
        if name in data
    }
    if "inputs" not in tables and "render" not in tables:
        raise where.error((), "the table inputs is missing, or render for a training dataset")
    tables.setdefault("inputs", InputTable())
    if "output" not in tables:
        raise where.error((), "the table output is missing; it requires url")
    folder = folder or Path()
    views = {
        name: where.wrap(("view", name), lambda n=name, t=table: _view(n, t))  # type: ignore[misc]  # lambda with defaults
        for name, table in data.get("view", {}).items()
    }
    rules = [
        validated(SensorRule, f"sensor.{number}", table, where)
        for number, table in enumerate(data.get("sensor", []))
    ]
    sensors = tuple(
        where.wrap((f"sensor.{number}",), lambda r=rule: _assigned(r, folder))  # type: ignore[misc]  # lambda with defaults
        for number, rule in enumerate(rules)
    )
    job = BatchJob(folder, sensors=sensors, views=views, storage=data.get("storage", {}), **tables)
    where.wrap((), lambda: _check(job))
    return job


def _check_period(rule: SensorRule, number: int) -> None:
    since, until = _timestamp(rule.since), _timestamp(rule.until)
    if since is not None and until is not None and since >= until:
        raise SpecError(
            f"sensor.{number}.until must be after since; got {rule.until} and {rule.since}"
        )


def _view(name: str, table: Any) -> NamedView:
    if not isinstance(table, dict):
        raise InvalidParameter(f"view.{name} must be a table [view.{name}]")
    return parse_view(name, table)


def _assigned(rule: SensorRule, folder: Path) -> AssignedSensor:
    file = folder / rule.file
    camera = load_camera(file if file.is_file() else rule.file)
    return AssignedSensor(rule, Path(rule.file).stem, format_camera(camera))


def _check(job: BatchJob) -> None:
    """Raise SpecError for incompatible tables."""
    inputs, output = job.inputs, job.output
    if not job.sensors:
        raise SpecError("the table [[sensor]] is missing; it requires file")
    if len(job.views) > MAX_VIEWS:
        raise SpecError(f"view must contain at most {MAX_VIEWS} tables; got {len(job.views)}")
    if job.render is None and not job.views and job.restoration is None:
        raise SpecError("the table view is missing, or restoration without views")
    if job.render is not None and (job.views or job.restoration or output.kind == "zarr"):
        raise SpecError(
            "render must not be combined with view, restoration or output.kind 'zarr'; process the "
            "rendered images in a second job"
        )
    if job.render is None and not any(
        (inputs.files, inputs.list_file, inputs.table, inputs.shards, inputs.arrays, inputs.videos)
    ):
        raise SpecError(
            "inputs must contain files, list_file, table, shards, arrays or videos; got none of them"
        )
    if inputs.videos and (output.kind != "video" or _has_images(inputs)):
        raise SpecError("inputs.videos requires output.kind 'video' and no other inputs")
    if inputs.videos and job.restoration:
        raise SpecError("restoration requires images; extract the frames of videos to files")
    suffixes = WRITABLE_VIDEO_SUFFIXES if output.kind == "video" else IMAGE_SUFFIXES
    if output.kind != "zarr" and output.format not in suffixes:
        raise SpecError(
            f"output.format must be one of {', '.join(suffixes)}; got {output.format!r}"
        )
    if inputs.camera is not None:
        try:
            groups = re.compile(inputs.camera).groups
        except re.error as e:
            raise SpecError(f"inputs.camera must be a regular expression: {e}") from None
        if groups < 1:
            raise SpecError(
                f"inputs.camera must contain a group, such as 'cam-(\\d+)'; got {inputs.camera!r}"
            )
    for number, each in enumerate(job.sensors):
        _check_period(each.rule, number)
    dated = [each.rule for each in job.sensors if each.rule.since or each.rule.until]
    if dated and inputs.time is None and inputs.table is None:
        raise SpecError("sensor.since and sensor.until require inputs.time or a table with time")
    _check_template(output.name)


NAME_FIELDS = ("folder", "stem", "view", "digest", "camera", "time", "sensor")


def _check_template(template: str) -> None:
    """Raise SpecError unless a template of output names has valid fields and stays in the folder."""
    try:
        fields = {field for _, field, _, _ in Formatter().parse(template) if field is not None}
        name = template.format(**dict.fromkeys(NAME_FIELDS, "x"))
    except (KeyError, IndexError, ValueError, AttributeError, TypeError):
        fields, name = {""}, ""
    if not fields <= {*NAME_FIELDS}:
        names = "}, {".join(NAME_FIELDS[:-1])
        raise SpecError(
            f"output.name must contain only {{{names}}} and {{{NAME_FIELDS[-1]}}}; got {template!r}"
        )
    if "\0" in name or any(part in ("", ".", "..") for part in name.split("/")):
        raise SpecError(
            f"output.name must be a relative name without empty or parent folders; got {template!r}"
        )


def _has_images(inputs: InputTable) -> bool:
    return bool(inputs.files or inputs.list_file or inputs.table or inputs.shards or inputs.arrays)


def _timestamp(moment: datetime | date | None) -> float | None:
    if moment is None:
        return None
    if not isinstance(moment, datetime):
        moment = datetime(moment.year, moment.month, moment.day)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
