"""Camera files: lossless conversion between TOML and camera models, and files of OCamCalib."""

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

from ..base.arguments import file_name, instance, validate_arguments
from ..base.errors import OmnimirrorError, SpecError
from ..base.escaping import line_comment
from ..base.files import parse_toml, read_text, write_text
from ..base.table_models import Table, validated
from ..base.toml_validation import SourceLocator, check_entries, class_of, merge_tables
from ..cameras.camera import Mount
from ..cameras.models import CAMERAS, CalibratedCamera, RadialModel, load_ocam, parse_ocam
from .sensor import Sensor
from .sensor_files import (
    find,
    format_sensor,
    mount_table,
    sensor_of,
    uncertainty_of,
    uncertainty_table,
)
from .sensor_tables import MountTable

__all__ = [
    "AnyCamera",
    "format_camera",
    "is_ocam_text",
    "load_camera",
    "parse_camera",
    "save_camera",
]

AnyCamera: TypeAlias = Sensor | CalibratedCamera

CAMERA_FILE_FORMAT = 1
CAMERA_ENTRIES: dict[str, type] = {
    "format": int,
    "camera": dict,
    "mount": dict,
    "uncertainty": dict,
}
"""Entries and tables of a camera file with their types."""
CALIBRATION_MARK = '"held_out_rms_px":'  # in its JSON
OCAM_ENTRIES = ("optics", "rim_radius_px")  # not in its file
SEPARATE_TABLES = ("mount", "uncertainty")  # fields of a model with separate tables


def load_camera(name_or_path: str | Path, changes: dict[str, Any] | None = None) -> AnyCamera:
    """Read a camera file, a sensor file, an OCamCalib file, or a bundled sensor.

    OCamCalib's file does not distinguish mirrors from fisheyes; a mirror is assumed. Specify a
    fisheye, or the radius of the field, with the changes ``{"camera": {"optics": "fisheye",
    "rim_radius_px": 400.0}}``, or use :func:`omnimirror.load_ocam`.

    Parameters
    ----------
    name_or_path
        File, or one of :func:`omnimirror.bundled_sensors`.
    changes
        Replacements for entries of the file, as for :func:`load_sensor`.

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
    >>> camera = om.Unified(
    ...     xi=0.96, focal_px=(220.0, 220.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.save_camera(camera, f"{folder}/mine.toml")
    ...     om.load_camera(f"{folder}/mine.toml") == camera
    True
    """
    path, absent = find("sensor file, camera file", name_or_path)
    text = read_text(path, "camera file", SpecError, absent)
    if is_ocam_text(text):
        return load_ocam(path, **_ocam_entries(changes, str(path)))
    return parse_camera(text, str(path), path.parent, changes)


@validate_arguments
def parse_camera(
    text: str,
    source: str = "camera file",
    folder: Path | None = None,
    changes: dict[str, Any] | None = None,
) -> AnyCamera:
    """Parse a camera from the text of its file; see :func:`load_camera`.

    Parameters
    ----------
    text
        TOML, or OCamCalib's format.
    source
        Name of the text in errors.
    folder
        Folder of the files that a sensor names; with None it must not name a file.
    changes
        Replacements for entries of the text, as for :func:`load_sensor`.

    Returns
    -------
    Sensor or camera model
        Camera of the text.

    Raises
    ------
    SpecError
        If an entry is unknown, missing or invalid. The message states the line and the valid
        values.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.parse_camera("3 -100 0 2.5e-3 \\n 2 100 50 \\n 239.5 319.5 \\n 1 0 0 \\n 480 640").image_size
    (640, 480)
    """
    if is_ocam_text(text):
        return parse_ocam(text, source, **_ocam_entries(changes, source))
    try:
        data, where = parse_toml(text, source), SourceLocator(text, source)
    except SpecError as e:
        raise SpecError(f"{e}{_hint(text, source)}") from None
    is_camera_file = "camera" in data
    if changes and "camera" in changes and not is_camera_file:
        raise SpecError(f"entries of camera require a camera file; {source} is a sensor file")
    data = merge_tables(data, changes or {})
    return camera_of(data, where) if is_camera_file else sensor_of(data, where, folder)


def _ocam_entries(changes: dict[str, Any] | None, source: str) -> dict[str, Any]:
    """Return the changes of an OCamCalib file, which are entries that it does not contain."""
    for table, entries in (changes or {}).items():
        for name in entries if isinstance(entries, dict) else [""]:
            if table != "camera" or name not in OCAM_ENTRIES:
                raise SpecError(
                    f"entries of {source}, an OCamCalib file, must be from "
                    f"{', '.join(f'camera.{entry}' for entry in OCAM_ENTRIES)}; "
                    f"got {f'{table}.{name}'.rstrip('.')}; convert it with omnimirror convert"
                )
    return dict((changes or {}).get("camera", {}))


def _hint(text: str, source: str) -> str:
    """Return a hint for a file in another format, as the end of a sentence."""
    if CALIBRATION_MARK in text:
        return "; the file contains the results of a calibration; the camera is in the output file of its -o option"
    if Path(source).suffix.lower() in ("", ".toml"):
        return ""
    return "; convert camera files of other programs with omnimirror convert"


def is_ocam_text(text: str) -> bool:
    """Return True if the first content line is purely numeric, as in OCamCalib's file.

    >>> is_ocam_text("#polynomial\\n\\n5 -131.4 0 1e-3"), is_ocam_text("format = 1")
    (True, False)
    """
    first = next(
        (words for line in text.splitlines() if (words := line.split("#")[0].split())), ["none"]
    )
    return all(re.fullmatch(r"[-+.\deE]+|[+-]?(nan|inf)", word, re.I) for word in first)


def camera_of(data: dict[str, Any], where: SourceLocator) -> CalibratedCamera:
    """Create a camera model from the tables of a camera file; ``where`` locates errors."""
    check_entries(data, CAMERA_ENTRIES, CAMERA_FILE_FORMAT, where)
    cls: type[CalibratedCamera] = class_of("camera", data, CAMERAS, where)
    table = {k: v for k, v in data["camera"].items() if k != "kind"}
    values = _tuples(validated(camera_model(cls), "camera", table, where).model_dump())
    mount = Mount(**validated(MountTable, "mount", data.get("mount", {}), where).model_dump())
    try:
        camera = cls(**values, mount=mount)
    except OmnimirrorError as e:
        entry_name = re.match(r"\w+", str(e))
        entry = ("camera", entry_name[0]) if entry_name and entry_name[0] in table else ("camera",)
        raise where.error(entry, f"camera.{e}" if len(entry) > 1 else str(e)) from None
    if "uncertainty" not in data:
        return camera
    uncertainty = uncertainty_of(data["uncertainty"], where)
    where.wrap(("uncertainty",), lambda: uncertainty.of([p.name for p in camera.parameters]))
    return dataclasses.replace(camera, uncertainty=uncertainty)


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
    >>> camera = om.KannalaBrandt(
    ...     focal_px=(170.0, 170.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> parse_camera(format_camera(camera, "seen twice")) == camera
    True
    """
    types: tuple[type[Any], ...] = (Sensor, *CAMERAS.values())
    instance("camera", camera, types, f"a sensor, or a camera of kind {', '.join(CAMERAS)}")
    instance("notes", notes, str, "text")
    comment = "".join(f"# {line_comment(line)}\n" for line in notes.splitlines())
    return comment + (
        format_sensor(camera)
        if isinstance(camera, Sensor)
        else tomli_w.dumps(camera_tables(camera))
    )


def camera_tables(camera: RadialModel) -> dict[str, Any]:
    """Return the tables of a camera's file, as plain data."""
    table: dict[str, Any] = {"kind": camera.KIND}
    for f in _fields_of(type(camera)):
        value = getattr(camera, f.name)
        if value is not None and (f.default != 0.0 or value != 0.0):
            table[f.name] = _plain(value)
    tables = {"format": CAMERA_FILE_FORMAT, "camera": table, "mount": mount_table(camera.mount)}
    if (uncertainty := camera.uncertainty) is not None:
        tables["uncertainty"] = uncertainty_table(uncertainty)
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
    >>> camera = om.RadialSpline(
    ...     radii_px=(100.0, 200.0, 300.0),
    ...     field_deg=270.0,
    ...     centre_px=(319.5, 319.5),
    ...     image_size=(640, 640),
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.save_camera(camera, f"{folder}/mine.toml", "calibrated today")
    ...     om.load_camera(f"{folder}/mine.toml") == camera
    True
    """
    write_text(file_name("path", path), format_camera(camera, notes))


@cache
def camera_model(cls: type[RadialModel]) -> type[Table]:
    """Create the pydantic model of the table [camera] of a kind from its fields."""
    hints = typing.get_type_hints(cls)
    entries: dict[str, Any] = {}
    for f in _fields_of(cls):
        default = ... if f.default is dataclasses.MISSING else _plain(f.default)
        entries[f.name] = (_annotation(hints[f.name]), default)
    model: type[Table] = create_model(cls.__name__, __base__=Table, **entries)
    return model


def _fields_of(cls: type[Any]) -> list[dataclasses.Field[Any]]:
    """Return the fields stored in a camera's table."""
    return [f for f in dataclasses.fields(cls) if f.init and f.name not in SEPARATE_TABLES]


def _annotation(hint: Any) -> Any:
    """Return the annotation of a TOML array of fixed length for a tuple."""
    args = typing.get_args(hint)
    if isinstance(hint, types.UnionType):
        return _annotation(args[0]) | None
    if typing.get_origin(hint) is not tuple:
        return hint
    if args[1:] == (...,):
        return list[args[0]]  # type: ignore[valid-type]  # type computed at run time
    return Annotated[list[args[0]], Field(min_length=len(args), max_length=len(args))]  # type: ignore[valid-type]  # type computed at run time


def _tuples(value: Any) -> Any:
    """Convert lists to tuples, recursively."""
    if isinstance(value, dict):
        return {k: _tuples(v) for k, v in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    return list(map(_plain, value)) if isinstance(value, tuple) else value
