"""Camera files: lossless conversion between TOML and camera models; readers for other formats."""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import tomli_w
from pydantic import Field, create_model

from ...base.arguments import checked, file_name, instance
from ...base.errors import OmnimirrorError, SpecError
from ...base.escaping import line_comment
from ...base.files import parse_toml, read_text, write_text
from ...cameras.frames import Mount
from ...cameras.models import CAMERAS, CalibratedCamera, RadialModel, load_ocam, parse_ocam
from ..sensor import Sensor
from .sensor_file import (
    find,
    format_sensor,
    mount_table,
    sensor_of,
    uncertainty_of,
    uncertainty_table,
)
from .tables import Places, StandTable, Table, check_entries, class_of, validated

AnyCamera: TypeAlias = Sensor | CalibratedCamera

FORMAT = 1
NUMBERS_OF_A_CALIBRATION = '"held_out_rms_px":'  # in its JSON
APART = ("mount", "uncertainty")  # fields of a model with separate tables


def load_camera(name_or_path: str | Path) -> AnyCamera:
    """Read a camera file, a sensor file, an OCamCalib file, or a bundled sensor.

    OCamCalib's file does not distinguish mirrors from fisheyes; a mirror is assumed. Use
    :func:`omnimirror.load_ocam` for either.

    Parameters
    ----------
    name_or_path
        File, or one of :func:`omnimirror.bundled_sensors`.

    Returns
    -------
    Sensor or camera model
        Camera of the file.

    Raises
    ------
    SpecError
        If the file or name does not exist, or an entry is unknown, missing or invalid. The message
        gives the file, the line and the valid values.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> camera = om.Unified(0.96, (220.0, 220.0), (319.5, 239.5), (640, 480))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.save_camera(camera, f"{folder}/mine.toml")
    ...     om.load_camera(f"{folder}/mine.toml") == camera
    True
    """
    path, absent = find("sensor file, camera file", name_or_path)
    text = read_text(path, "camera file", SpecError, absent)
    return load_ocam(path) if is_ocam_text(text) else parse_camera(text, str(path), path.parent)


@checked
def parse_camera(text: str, source: str = "camera file", folder: Path | None = None) -> AnyCamera:
    """Parse a camera from the text of its file; see :func:`load_camera`.

    Parameters
    ----------
    text
        TOML, or OCamCalib's format.
    source
        Name of the text in errors.
    folder
        Folder of the files that a sensor names; with None it must not name a file.

    Returns
    -------
    Sensor or camera model
        Camera of the text.

    Raises
    ------
    SpecError
        If an entry is unknown, missing or invalid. The message gives the line and the valid values.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.parse_camera("3 -100 0 2.5e-3 \\n 2 100 50 \\n 239.5 319.5 \\n 1 0 0 \\n 480 640").image_size
    (640, 480)
    """
    if is_ocam_text(text):
        return parse_ocam(text, source)
    try:
        data, where = parse_toml(text, source), Places(text, source)
    except SpecError as e:
        raise SpecError(f"{e}{_hint(text, source)}") from None
    return camera_of(data, where) if "camera" in data else sensor_of(data, where, folder)


def _hint(text: str, source: str) -> str:
    """Return a hint for a file in another format, as the end of a sentence."""
    if NUMBERS_OF_A_CALIBRATION in text:
        return "; it holds the numbers of a calibration, and not its camera, which is in the file of its -o"
    if Path(source).suffix.lower() in ("", ".toml"):
        return ""
    return "; of another program's camera file omnimirror convert makes one of ours"


def is_ocam_text(text: str) -> bool:
    """Return True if the first content line is purely numeric, as in OCamCalib's file.

    >>> is_ocam_text("#polynomial\\n\\n5 -131.4 0 1e-3"), is_ocam_text("format = 1")
    (True, False)
    """
    first = next((words for line in text.splitlines() if (words := line.split("#")[0].split())), ["none"])
    return all(re.fullmatch(r"[-+.\deE]+|[+-]?(nan|inf)", word, re.I) for word in first)


def camera_of(data: dict[str, Any], where: Places) -> CalibratedCamera:
    """Create a camera model from the tables of a camera file; ``where`` locates errors."""
    check_entries(data, {"format": int, "camera": dict, "mount": dict, "uncertainty": dict}, FORMAT, where)
    cls: type[CalibratedCamera] = class_of("camera", data, CAMERAS, where)
    table = {k: v for k, v in data["camera"].items() if k != "kind"}
    values = _tuples(validated(_table_of(cls), "camera", table, where).model_dump())
    mount = Mount(**validated(StandTable, "mount", data.get("mount", {}), where).model_dump())
    try:
        camera = cls(**values, mount=mount)
    except OmnimirrorError as e:
        named = re.match(r"\w+", str(e))
        entry = ("camera", named[0]) if named and named[0] in table else ("camera",)
        raise where.error(entry, f"camera.{e}" if len(entry) > 1 else str(e)) from None
    if "uncertainty" not in data:
        return camera
    known = uncertainty_of(data["uncertainty"], where)
    where.wrap(("uncertainty",), lambda: known.of([p.name for p in camera.parameters]))
    return dataclasses.replace(camera, uncertainty=known)


def format_camera(camera: Sensor | RadialModel, notes: str = "") -> str:
    """Format a camera as the text of its file; reading it returns an equal camera.

    Parameters
    ----------
    camera
        Camera model, or sensor; for a sensor, see :func:`omnimirror.save_sensor`.
    notes
        Text of a comment at the top.

    Returns
    -------
    str
        TOML text.

    Raises
    ------
    InvalidParameter
        If the camera cannot be stored in a file.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.KannalaBrandt((170.0, 170.0), (319.5, 239.5), (640, 480))
    >>> parse_camera(format_camera(camera, "seen twice")) == camera
    True
    """
    kinds: tuple[type[Any], ...] = (Sensor, *CAMERAS.values())
    instance("camera", camera, kinds, f"a camera that a file holds, a sensor or one of {', '.join(CAMERAS)}")
    instance("notes", notes, str, "text")
    comment = "".join(f"# {line_comment(line)}\n" for line in notes.splitlines())
    return comment + (format_sensor(camera) if isinstance(camera, Sensor) else tomli_w.dumps(camera_tables(camera)))


def camera_tables(camera: RadialModel) -> dict[str, Any]:
    """Return the tables of a camera's file, as plain data."""
    table: dict[str, Any] = {"kind": camera.KIND}
    for f in _fields_of(type(camera)):
        value = getattr(camera, f.name)
        if value is not None and (f.default != 0.0 or value != 0.0):
            table[f.name] = _plain(value)
    tables = {"format": FORMAT, "camera": table, "mount": mount_table(camera.mount)}
    if (known := camera.uncertainty) is not None:
        tables["uncertainty"] = uncertainty_table(known)
    return tables


def save_camera(camera: Sensor | RadialModel, path: str | Path, notes: str = "") -> None:
    """Write a camera's file atomically.

    Parameters
    ----------
    camera
        Camera model, or sensor; for a sensor, see :func:`omnimirror.save_sensor`.
    path
        Name of the file.
    notes
        Text of a comment at the top.

    Raises
    ------
    OmnimirrorError
        If the file cannot be written, or the camera cannot be stored in a file.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> camera = om.RadialSpline((100.0, 200.0, 300.0), 270.0, (319.5, 319.5), (640, 640))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.save_camera(camera, f"{folder}/mine.toml", "calibrated today")
    ...     om.load_camera(f"{folder}/mine.toml") == camera
    True
    """
    write_text(file_name("path", path), format_camera(camera, notes))


@cache
def _table_of(cls: type[RadialModel]) -> type[Table]:
    """Create the pydantic model of the table [camera] of a kind from its fields."""
    hints = typing.get_type_hints(cls)
    entries: dict[str, Any] = {}
    for f in _fields_of(cls):
        default = ... if f.default is dataclasses.MISSING else f.default
        entries[f.name] = (_annotation(hints[f.name]), default)
    model: type[Table] = create_model(cls.__name__, __base__=Table, **entries)
    return model


def _fields_of(cls: type[Any]) -> list[dataclasses.Field[Any]]:
    """Return the fields stored in a camera's table."""
    return [f for f in dataclasses.fields(cls) if f.init and f.name not in APART]


def _annotation(hint: Any) -> Any:
    """Return the annotation of a TOML array of fixed length for a tuple."""
    args = typing.get_args(hint)
    if isinstance(hint, types.UnionType):
        return _annotation(args[0]) | None
    if typing.get_origin(hint) is not tuple:
        return hint
    if args[1:] == (...,):
        return list[args[0]]  # type: ignore[valid-type]
    return Annotated[list[args[0]], Field(min_length=len(args), max_length=len(args))]  # type: ignore[valid-type]


def _tuples(value: Any) -> Any:
    """Convert lists to tuples, recursively."""
    if isinstance(value, dict):
        return {k: _tuples(v) for k, v in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    return list(map(_plain, value)) if isinstance(value, tuple) else value
