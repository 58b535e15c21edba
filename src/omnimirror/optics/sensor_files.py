"""Sensor files: lossless conversion between TOML and sensors.

The tables of mirror, lens and imager are derived from the parameter descriptions of their classes;
a new mirror needs no code here.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomli_w

from ..base.arguments import file_name, format_value, validate_arguments
from ..base.errors import SpecError
from ..base.files import parse_toml, read_text, write_text
from ..base.parameters import Parameter, Uncertainty
from ..base.toml_validation import (
    SourceLocator,
    check_entries,
    class_of,
    did_you_mean,
    merge_tables,
    plain_value,
    plain_values,
)
from ..cameras.camera import (
    FULL_TURN_DEG,
    MAX_PITCH_DEG,
    MAX_ROLL_DEG,
    CameraLooks,
    Mount,
)
from .housing import NO_HOUSING, SHELLS, CameraBody, Housing, Rim, Rod
from .image_sensor import Imager, ImagerPose
from .lenses import LENSES, Lens
from .mirrors import MIRRORS, SECONDARIES, Mirror, Secondary
from .mirrors.mirror import MirrorForm, MirrorPose
from .sensor import MAX_MIRROR_DISTANCE_MM, Sensor, check_sensor
from .thermal import Thermal

__all__ = [
    "HOUSING_PARTS",
    "bundled_sensors",
    "format_sensor",
    "housing_of",
    "housing_tables",
    "lens_of",
    "lens_table",
    "load_sensor",
    "parse_sensor",
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
    mount = _mount_values(data.get("mount", {}), where)
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


MOUNT_RANGES = {
    "forward_azimuth_deg": Parameter("deg", -FULL_TURN_DEG, FULL_TURN_DEG),
    "pitch_deg": Parameter("deg", -MAX_PITCH_DEG, MAX_PITCH_DEG),
    "roll_deg": Parameter("deg", -MAX_ROLL_DEG, MAX_ROLL_DEG),
    "mirror_distance_mm": Parameter("mm", np.nextafter(0, 1), MAX_MIRROR_DISTANCE_MM),
}


def _mount_values(table: dict[str, Any], where: SourceLocator) -> dict[str, Any]:
    """Return the entries of the table [mount] with defaults."""
    values: dict[str, Any] = {**dataclasses.asdict(Mount()), "mirror_distance_mm": None}
    for name, value in table.items():
        if name in MOUNT_RANGES:
            number = plain_value(value, "float", MOUNT_RANGES[name])
        else:
            is_plain = name == "image_flipped" and isinstance(value, bool)
            is_word = name == "camera_looks" and value in typing.get_args(CameraLooks)
            number = value if is_plain or is_word else None
        if number is None:
            from ..base.table_models import validated
            from .sensor_tables import SensorMountTable

            return validated(SensorMountTable, "mount", table, where).model_dump()
        values[name] = number
    return values


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
    mirror = plain_values(cls, {k: v for k, v in table.items() if k not in Secondary.PARAMETERS})
    pose = plain_values(Secondary, {k: v for k, v in table.items() if k in Secondary.PARAMETERS})
    if mirror is None or pose is None:
        from ..base.table_models import validated
        from .sensor_tables import secondary_model

        values = _tuples(validated(secondary_model(cls), "secondary", table, where).model_dump())
    else:
        values = {**mirror, **pose}
    position = {name: values.pop(name) for name in Secondary.PARAMETERS}
    return where.wrap(("secondary",), lambda: Secondary(cls(**values), **position))


def _build(section: str, cls: type[Any], table: dict[str, Any], where: SourceLocator) -> Any:
    """Create a part from its validated table."""
    values = plain_values(cls, table)
    if values is None:
        from ..base.table_models import table_model, validated

        values = _tuples(validated(table_model(cls), section, table, where).model_dump())  # type: ignore[arg-type]  # the cache requires Hashable
    return where.wrap((section,), lambda: cls(**values))


def uncertainty_of(table: dict[str, Any], where: SourceLocator) -> Uncertainty:
    """Create a covariance from the table ``[uncertainty]``."""
    from ..base.table_models import validated
    from .sensor_tables import UncertaintyTable

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


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    """Return validated entries with lists as tuples."""
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
