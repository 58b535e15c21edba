"""Sensor and camera files: lossless conversion between TOML and sensors or camera models.

The tables of mirror, lens and imager are derived from the parameter descriptions of their classes;
a new mirror needs no code here.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import numpy as np
import tomli_w
from pydantic import Field, create_model

from ..base.arguments import file_name, format_value, instance, validate_arguments
from ..base.errors import OmnimirrorError, SpecError
from ..base.escaping import line_comment
from ..base.files import parse_toml, read_text, write_text
from ..base.parameters import Uncertainty
from ..base.toml_validation import (
    SourceLocator,
    Table,
    check_entries,
    class_of,
    did_you_mean,
    merge_tables,
    table_model,
    validated,
)
from ..cameras.camera import CameraLooks, Mount
from ..cameras.models import CAMERAS, CalibratedCamera, RadialModel, load_ocam, parse_ocam
from .housing import NO_HOUSING, SHELLS, CameraBody, Housing, Rim, Rod
from .image_sensor import Imager, ImagerPose
from .lenses import LENSES, Lens
from .mirrors import MIRRORS, SECONDARIES, Mirror, Secondary
from .mirrors.mirror import MirrorForm, MirrorPose
from .sensor import Sensor, check_sensor
from .thermal import Thermal

__all__ = [
    "HOUSING_PARTS",
    "AnyCamera",
    "bundled_sensors",
    "format_camera",
    "format_sensor",
    "housing_of",
    "housing_tables",
    "is_ocam_text",
    "lens_of",
    "lens_table",
    "load_camera",
    "load_sensor",
    "parse_camera",
    "parse_sensor",
    "save_camera",
    "save_sensor",
    "sensor_of",
    "tables_of",
]


# -- Sensor files ----------------------------------------------------------------------------------

SENSOR_FOLDER = Path(__file__).with_name("bundled_sensors")
SENSOR_FILE_FORMAT = 1
SENSOR_ENTRIES: dict[str, type] = {
    "format": int,
    "name": str,
    "notes": str,
    "mirror": dict,
    "secondary": dict,
    "lens": dict,
    "imager": dict,
    "mount": dict,
    "mirror_pose": dict,
    "mirror_form": dict,
    "imager_pose": dict,
    "housing": dict,
    "uncertainty": dict,
    "thermal": dict,
}
"""Entries and tables of a sensor file with their types."""
REQUIRED_TABLES = ("mirror", "lens", "imager")
T = TypeVar("T")


def bundled_sensors() -> list[str]:
    """Return the names of the bundled sensors.

    Returns
    -------
    list of str
        Names for :func:`load_sensor`.

    Examples
    --------
    >>> "paper-spherical" in bundled_sensors()
    True
    """
    return sorted(p.stem for p in SENSOR_FOLDER.glob("*.toml"))


def load_sensor(name_or_path: str | Path, changes: dict[str, Any] | None = None) -> Sensor:
    """Read a sensor file, or a bundled sensor by name.

    Parameters
    ----------
    name_or_path
        File, or one of :func:`bundled_sensors`.
    changes
        Replacements for entries of the file: ``{"lens": {"f_number": 5.6}}``; None removes an
        entry or a table.

    Returns
    -------
    Sensor
        Sensor of the file.

    Raises
    ------
    SpecError
        If the file or name does not exist, the text is not TOML, or an entry is unknown, missing or
        invalid. The message states the file, the line and the valid values.

    Examples
    --------
    >>> sensor = load_sensor("paper-spherical")
    >>> sensor.mirror.KIND, round(sensor.field_deg[1], 3)
    ('sphere', 135.005)
    """
    path, absent = find("sensor file", name_or_path)
    text = read_text(path, "sensor file", SpecError, absent)
    return parse_sensor(text, str(path), path.parent, changes)


def find(kinds: str, name_or_path: str | Path) -> tuple[Path, str]:
    """Locate a file or bundled sensor; also return the error message if there is none.

    >>> find("sensor file", "paper-spherical")[0].name
    'paper-spherical.toml'
    """
    path, bundled = file_name("name_or_path", name_or_path), bundled_sensors()
    if not path.is_file() and str(name_or_path) in bundled:
        path = SENSOR_FOLDER / f"{name_or_path}.toml"
    hint = did_you_mean(str(name_or_path), bundled)
    others = f"{hint} The bundled sensors are" if hint else "; the bundled sensors are"
    return (
        path,
        f"{kinds} or bundled sensor {str(name_or_path)!r} does not exist{others} {', '.join(bundled)}",
    )


@validate_arguments
def parse_sensor(
    text: str,
    source: str = "sensor file",
    folder: Path | None = None,
    changes: dict[str, Any] | None = None,
) -> Sensor:
    """Parse a Sensor from the text of a sensor file.

    ``folder`` is the folder of files named in the text; with None the text must not name a file,
    which makes untrusted text safe to read.

    Parameters
    ----------
    text
        TOML text.
    source
        Name of the text in errors.
    folder
        Folder of the files named in the text; with None it must not name a file.
    changes
        Replacements for entries of the text, as for :func:`load_sensor`.

    Returns
    -------
    Sensor
        Sensor of the text.

    Raises
    ------
    SpecError
        If the text is not TOML, or an entry is unknown, missing or invalid. The message states the
        line and the valid values.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.parse_sensor(om.sensor_template("mine")).name
    'mine'
    """
    where = SourceLocator(text, source)
    data = parse_toml(text, source)
    if "camera" in data and "mirror" not in data:
        raise SpecError(
            f"{source} must be a sensor file; got a camera file, which describes "
            "directions of pixels without mirror and lens; estimate a sensor with "
            "omnimirror calibrate --model sensor"
        )
    return sensor_of(merge_tables(data, changes or {}), where, folder)


def sensor_of(data: dict[str, Any], where: SourceLocator, folder: Path | None = None) -> Sensor:
    """Create a Sensor from the tables of a sensor file."""
    _check_table_names(data, where)
    parts: dict[str, Any] = {
        "mirror": _part("mirror", data, MIRRORS, folder, where),
        "lens": lens_of(data["lens"], where, folder),
        "imager": _build("imager", Imager, data["imager"], where),
        "mirror_pose": _build("mirror_pose", MirrorPose, data.get("mirror_pose", {}), where),
        "imager_pose": _build("imager_pose", ImagerPose, data.get("imager_pose", {}), where),
    }
    if "mirror_form" in data:
        parts["mirror_form"] = _build("mirror_form", MirrorForm, data["mirror_form"], where)
    if "secondary" in data:
        parts["secondary"] = _secondary(data, folder, where)
    if "housing" in data:
        parts["housing"] = housing_of(data["housing"], where)
    mount = validated(SensorMountTable, "mount", data.get("mount", {}), where).model_dump()
    distance = mount.pop("mirror_distance_mm")
    make = partial(
        Sensor,
        **parts,
        mount=Mount(**mount),
        mirror_distance_mm=np.inf if distance is None else distance,
        name=data.get("name", "sensor"),
        notes=data.get("notes", ""),
        uncertainty=uncertainty_of(data["uncertainty"], where) if "uncertainty" in data else None,
        thermal=_build("thermal", Thermal, data["thermal"], where) if "thermal" in data else None,
    )
    sensor = where.wrap(("mount", "mirror_distance_mm"), make)
    if "housing" in data:
        _check_fit(sensor, data["housing"], where)
    return sensor


def format_sensor(sensor: Sensor) -> str:
    """Format a sensor as the text of its file; reading it returns an equal sensor.

    >>> sensor = load_sensor("paper-hyperboloidal")
    >>> parse_sensor(format_sensor(sensor)) == sensor
    True
    """
    return tomli_w.dumps(tables_of(sensor))


def tables_of(sensor: Sensor) -> dict[str, Any]:
    """Return the tables of the sensor's file, as plain data."""
    mount = mount_table(sensor.mount)
    if np.isfinite(sensor.mirror_distance_mm):
        mount = {"mirror_distance_mm": sensor.mirror_distance_mm, **mount}
    data: dict[str, Any] = {
        "format": SENSOR_FILE_FORMAT,
        "name": sensor.name,
        "notes": sensor.notes,
        "mirror": {"kind": sensor.mirror.KIND, **_table(sensor.mirror)},
    }
    if (second := sensor.secondary) is not None:
        data["secondary"] = {"kind": second.mirror.KIND, **_table(second.mirror), **_table(second)}
    data |= {"lens": lens_table(sensor.lens), "imager": _table(sensor.imager), "mount": mount}
    if sensor.mirror_pose != MirrorPose():
        data["mirror_pose"] = _table(sensor.mirror_pose)
    if sensor.mirror_form != MirrorForm():
        data["mirror_form"] = _table(sensor.mirror_form)
    if sensor.imager_pose != ImagerPose():
        data["imager_pose"] = _table(sensor.imager_pose)
    if sensor.housing != NO_HOUSING:
        data["housing"] = housing_tables(sensor.housing)
    if sensor.uncertainty is not None:
        data["uncertainty"] = uncertainty_table(sensor.uncertainty)
    if sensor.thermal is not None:
        data["thermal"] = _table(sensor.thermal)
    return data


def mount_table(mount: Mount) -> dict[str, Any]:
    """Return the table [mount], without pitch and roll if they are 0."""
    table = dataclasses.asdict(mount)
    if not (mount.pitch_deg or mount.roll_deg):
        del table["pitch_deg"], table["roll_deg"]
    return table


@validate_arguments
def save_sensor(sensor: Sensor, path: str | Path) -> None:
    """Write the sensor's file atomically.

    Parameters
    ----------
    sensor
        Sensor to write.
    path
        Name of the file.

    Raises
    ------
    OmnimirrorError
        If the file cannot be written.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> sensor = om.load_sensor("paper-hyperboloidal")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.save_sensor(sensor, f"{folder}/mine.toml")
    ...     om.load_sensor(f"{folder}/mine.toml") == sensor
    True
    """
    check_sensor(sensor)
    write_text(file_name("path", path), format_sensor(sensor))


class MountTable(Table):
    """Orientation of a sensor: optical axis, pitch and roll."""

    camera_looks: CameraLooks = "up"
    forward_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = -90.0
    image_flipped: bool = False
    pitch_deg: Annotated[
        float, Field(ge=-90, le=90, description="elevation of the forward direction")
    ] = 0.0
    roll_deg: Annotated[
        float, Field(ge=-180, le=180, description="clockwise rotation about the forward direction")
    ] = 0.0


class SensorMountTable(MountTable):
    mirror_distance_mm: Annotated[float, Field(gt=0, le=1e7)] | None = None


def _table(part: Any) -> dict[str, Any]:
    """Return a part's parameters for the file; default zeros and None values are omitted."""
    values = {name: getattr(part, name) for name in part.PARAMETERS}
    unset = {
        f.name
        for f in dataclasses.fields(part)
        if f.default in (None, 0.0) and values.get(f.name) == f.default
    }
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items() if k not in unset}


def _check_table_names(data: dict[str, Any], where: SourceLocator) -> None:
    check_entries(data, SENSOR_ENTRIES, SENSOR_FILE_FORMAT, where)
    for key in REQUIRED_TABLES:
        if key not in data:
            raise where.error(
                (),
                f"the table [{key}] is missing; a sensor file requires [mirror], [lens] and [imager]",
            )


def _part(
    section: str,
    data: dict[str, Any],
    registry: Mapping[str, type[T]],
    folder: Path | None,
    where: SourceLocator,
) -> T:
    """Create the part that a table describes."""
    part: T = _build(section, *_class_and_table(section, data, registry, folder, where), where)
    return part


def lens_of(
    table: dict[str, Any], where: SourceLocator, folder: Path | None, section: str = "lens"
) -> Lens:
    """Create the lens of a table such as ``[lens]`` of a sensor file."""
    return _part(section, {section: table}, LENSES, folder, where)


def lens_table(lens: Lens) -> dict[str, Any]:
    """Return the table ``[lens]`` of a lens, as plain data."""
    return {"kind": lens.KIND, **_table(lens)}


def _class_and_table(
    section: str,
    data: dict[str, Any],
    registry: Mapping[str, type[T]],
    folder: Path | None,
    where: SourceLocator,
) -> tuple[type[T], dict[str, Any]]:
    """Return the class named by a table's kind, and its other entries."""
    cls = class_of(section, data, registry, where)
    table = {k: v for k, v in data[section].items() if k != "kind"}
    if issubclass(cls, Mirror | Lens):
        table = where.wrap((section,), partial(cls.from_spec, table, folder))
    return cls, table


def _secondary(data: dict[str, Any], folder: Path | None, where: SourceLocator) -> Secondary:
    """Create the second mirror: its table has the entries of its kind and of its position."""
    cls, table = _class_and_table("secondary", data, SECONDARIES, folder, where)
    values = _values(secondary_model(cls), "secondary", table, where)
    position = {name: values.pop(name) for name in Secondary.PARAMETERS}
    return where.wrap(("secondary",), lambda: Secondary(cls(**values), **position))


def secondary_model(cls: type[Mirror]) -> type[Table]:
    """Create the pydantic model of the table [secondary] of a kind of mirror."""
    return create_model("secondary", __base__=(table_model(cls), table_model(Secondary)))


def _build(section: str, cls: type[Any], table: dict[str, Any], where: SourceLocator) -> Any:
    """Create a part from its validated table."""
    values = _values(table_model(cls), section, table, where)  # type: ignore[arg-type]  # the cache requires Hashable
    return where.wrap((section,), lambda: cls(**values))


class UncertaintyTable(Table):
    """Covariance of the parameters of a sensor or camera, by rows."""

    names: list[str]
    covariance: list[list[float]]
    field_deg: float | None = None
    marginal_sigmas: list[float] | None = None


def uncertainty_of(table: dict[str, Any], where: SourceLocator) -> Uncertainty:
    """Create a covariance from the table ``[uncertainty]``."""
    values = validated(UncertaintyTable, "uncertainty", table, where).model_dump()
    return where.wrap(("uncertainty",), partial(Uncertainty, **values))


def uncertainty_table(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return the table ``[uncertainty]`` as plain data."""
    table: dict[str, Any] = {
        "names": list(uncertainty.names),
        "covariance": [list(row) for row in uncertainty.covariance],
    }
    if uncertainty.field_deg is not None:
        table["field_deg"] = uncertainty.field_deg
    if uncertainty.marginal_sigmas is not None:
        table["marginal_sigmas"] = list(uncertainty.marginal_sigmas)
    return table


HOUSING_PARTS: dict[str, type[Any]] = {
    "camera": CameraBody,
    "rod": Rod,
    **SHELLS,
    "rim": Rim,
    "secondary_rim": Rim,
}
"""Housing parts by their tables, ``[housing.camera]`` and so on."""


def housing_of(table: dict[str, Any], where: SourceLocator) -> Housing:
    """Create a housing from the tables of ``[housing]``, with missing values None."""
    for name, part in table.items():
        if name not in HOUSING_PARTS:
            valid = ", ".join(f"housing.{part_name}" for part_name in HOUSING_PARTS)
            raise where.error(
                ("housing", name),
                f"unknown entry housing.{name}{did_you_mean(name, HOUSING_PARTS)}; use {valid}",
            )
        if not isinstance(part, dict):
            raise where.error(
                ("housing", name),
                f"housing.{name} must be a table [housing.{name}]; got {format_value(part)}",
            )
    if len(shells := [name for name in SHELLS if name in table]) > 1:
        raise where.error(
            ("housing", shells[1]),
            f"housing must not have both a {' and a '.join(shells)}; remove one",
        )
    parts = {
        name: _build(f"housing.{name}", HOUSING_PARTS[name], part, where)
        for name, part in table.items()
    }
    shell = next((parts.pop(name) for name in SHELLS if name in parts), None)
    return Housing(shell=shell, **parts)


def _check_fit(sensor: Sensor, tables: dict[str, Any], where: SourceLocator) -> None:
    """Check that each housing part fits the sensor and its mirror rim."""
    body = Housing(rim=sensor.housing.rim, secondary_rim=sensor.housing.secondary_rim)
    for name in tables:
        field = "shell" if name in SHELLS else name
        alone = dataclasses.replace(body, **{field: getattr(sensor.housing, field)})
        where.wrap(
            (f"housing.{name}",),
            partial(getattr, dataclasses.replace(sensor, housing=alone), "obstructions"),
        )


def housing_tables(housing: Housing) -> dict[str, Any]:
    """Return the tables of ``[housing]``, as plain data."""
    parts = {name: getattr(housing, name) for name in ("camera", "rod", "rim", "secondary_rim")}
    if housing.shell is not None:
        parts[housing.shell.KIND] = housing.shell
    return {name: _table(part) for name, part in parts.items() if part is not None}


def _values(
    model: type[Table], section: str, table: dict[str, Any], where: SourceLocator
) -> dict[str, Any]:
    """Return the validated entries of a table, with lists as tuples."""
    values = validated(model, section, table, where).model_dump()
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


# -- Camera files ----------------------------------------------------------------------------------

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
