"""JSON Schemas of TOML files, generated from the models and parameters that validate the files."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from ..base.arguments import choice
from ..base.project import schema_address
from ..base.table_models import Table, table_model
from ..cameras.models import CAMERAS
from ..design import requirement_files
from ..design.limits import LIMITABLE
from ..design.merits import DESIGN_MERITS
from ..design.requirement_files import (
    REQUIREMENT_ENTRIES,
    ElevationTable,
    LimitTable,
    TemperatureTable,
)
from ..design.requirements import (
    FieldRequirements,
    LensRequirements,
    MirrorRequirements,
    PartsRequirements,
    entries_model,
)
from ..dewarp import views
from ..manufacturing.tolerancing import tolerance_file
from ..manufacturing.tolerancing.tolerance_file import TOLERANCE_ENTRIES
from ..optics import camera_files, sensor_files
from ..optics.camera_files import CAMERA_ENTRIES, camera_model
from ..optics.image_sensor import Imager, ImagerPose
from ..optics.lenses import LENSES
from ..optics.mirrors import MIRRORS, SECONDARIES
from ..optics.mirrors.mappings import MAPPINGS
from ..optics.mirrors.measured import MAPPING_FILE
from ..optics.mirrors.mirror import MirrorForm, MirrorPose
from ..optics.sensor_files import HOUSING_PARTS, SENSOR_ENTRIES
from ..optics.sensor_tables import MountTable, SensorMountTable, UncertaintyTable, secondary_model
from ..optics.thermal import Thermal
from .batch import job
from .named_views import MAX_VIEWS, NAME, STEERABLE_KIND, options_model

Schema: TypeAlias = dict[str, Any]

DIALECT = "http://json-schema.org/draft-07/schema#"  # the dialect of TOML editors
TYPES = {int: "integer", str: "string"}
FILE_NAME = {"type": "string", "description": "file name, relative to the folder of this file"}


def schema(kind: str) -> Schema:
    """Return the JSON Schema of a kind of TOML file, for editors and validators.

    The schema contains names, types, ranges, units and descriptions of all entries, including those
    of registered mirrors and views. Relations between entries are checked only when a file is read.

    Parameters
    ----------
    kind
        ``"sensor"``, ``"camera"``, ``"requirements"``, ``"tolerances"``, ``"views"`` or ``"batch"``.

    Returns
    -------
    dict
        Schema in the dialect of draft 7, as plain data for :func:`json.dumps`.

    Raises
    ------
    InvalidParameter
        If the kind is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> imager = om.schema("sensor")["properties"]["imager"]
    >>> imager["properties"]["pixel_pitch_um"]["unit"], imager["required"]
    ('um', ['width_px', 'height_px', 'pixel_pitch_um'])
    """
    choice("kind", kind, tuple(KINDS))
    return {"$schema": DIALECT, "$id": schema_address(kind), **KINDS[kind]()}


# -- Files -----------------------------------------------------------------------------------------


def _sensor() -> Schema:
    tables = {
        "mirror": _variants(MIRRORS, table_model),
        "secondary": _variants(SECONDARIES, secondary_model),
        "lens": _variants(LENSES, table_model),
        "imager": _part(Imager),
        "mount": _table(SensorMountTable),
        "mirror_pose": _part(MirrorPose),
        "mirror_form": _part(MirrorForm),
        "imager_pose": _part(ImagerPose),
        "housing": _housing(),
        "uncertainty": _table(UncertaintyTable),
        "thermal": _part(Thermal),
    }
    return _file(
        "Sensor file",
        SENSOR_ENTRIES,
        tables,
        sensor_files.SENSOR_FILE_FORMAT,
        sensor_files.REQUIRED_TABLES,
    )


def _camera() -> Schema:
    tables = {
        "camera": _variants(CAMERAS, camera_model),
        "mount": _table(MountTable),
        "uncertainty": _table(UncertaintyTable),
    }
    return _file(
        "Camera file", CAMERA_ENTRIES, tables, camera_files.CAMERA_FILE_FORMAT, ("camera",)
    )


def _requirements() -> Schema:
    by_field, by_elevation = _table(entries_model(FieldRequirements)), _table(ElevationTable)
    field = _joined(by_field, by_elevation, required=())
    field["oneOf"] = [
        {"required": by_field["required"]},
        {"required": by_elevation["required"]},
    ]
    mirror = _table(entries_model(MirrorRequirements))
    mirror["properties"][MAPPING_FILE.entry] = FILE_NAME
    mirror["properties"]["mapping"]["enum"] = list(MAPPINGS)
    mirror["properties"]["optimise"]["enum"] = list(DESIGN_MERITS)
    lens = _table(entries_model(LensRequirements))
    real_lenses = {kind: cls for kind, cls in LENSES.items() if not cls.IS_THIN}
    lens["properties"]["optics"] = _variants(real_lenses, table_model)
    limit = _table(LimitTable)
    limit["properties"]["quantity"]["enum"] = list(LIMITABLE)
    tables = {
        "field": field,
        "mirror": mirror,
        "lens": lens,
        "imager": _part(Imager),
        "mount": _table(MountTable),
        "housing": _housing(),
        "limit": limit,
        "parts": _table(entries_model(PartsRequirements)),
        "thermal": _joined(_part(Thermal), _table(TemperatureTable)),
    }
    return _file(
        "Requirement file",
        REQUIREMENT_ENTRIES,
        tables,
        requirement_files.FORMAT,
        requirement_files.REQUIRED_TABLES,
    )


def _tolerances() -> Schema:
    tables = {
        "objects": _table(tolerance_file.ObjectsTable),
        "error": _table(tolerance_file.ErrorTable),
        "correlation": _table(tolerance_file.CorrelationTable),
        "limit": _table(tolerance_file.BoundTable),
        "figure": _table(tolerance_file.FigureTable),
        "measured": _table(tolerance_file.MeasuredTable),
    }
    return _file("Tolerance file", TOLERANCE_ENTRIES, tables, tolerance_file.FORMAT)


def _views() -> Schema:
    return {"title": "View file", **_view_tables(), "minProperties": 1}


def _view_tables() -> Schema:
    return {
        "type": "object",
        "patternProperties": {
            f"^{NAME.pattern}$": {"oneOf": [_view(kind) for kind in views.VIEWS]}
        },
        "additionalProperties": False,
        "maxProperties": MAX_VIEWS,
    }


def _view(kind: str) -> Schema:
    """Return the schema of the table of one view; the kind is optional for perspective views."""
    table = _table(options_model(kind))
    steerable = {"type": "boolean"} if kind == STEERABLE_KIND else {"const": False}
    table["properties"] = {"view": {"const": kind}, "steerable": steerable, **table["properties"]}
    if kind != STEERABLE_KIND:
        table["required"] = ["view", *table.get("required", [])]
    return _described(table, views.VIEWS[kind] if kind != STEERABLE_KIND else views.perspective)


def _batch() -> Schema:
    tables = {name: _table(model) for name, model in job.TABLES.items()}
    tables["sensor"] = {"type": "array", "items": _table(job.SensorRule), "minItems": 1}
    return {
        "title": "Batch job file",
        "type": "object",
        "properties": tables | {"view": _view_tables(), "storage": {"type": "object"}},
        "required": ["sensor", "output"],
        "anyOf": [{"required": ["inputs"]}, {"required": ["render"]}],
        "additionalProperties": False,
    }


KINDS: dict[str, Callable[[], Schema]] = {
    "sensor": _sensor,
    "camera": _camera,
    "requirements": _requirements,
    "tolerances": _tolerances,
    "views": _views,
    "batch": _batch,
}
"""Generators of the schemas by kind of file."""


# -- Tables ----------------------------------------------------------------------------------------


def _file(
    title: str,
    entries: Mapping[str, type],
    tables: Mapping[str, Schema],
    file_format: int,
    required: Iterable[str] = (),
) -> Schema:
    """Return the schema of a file from its entries and the schemas of its tables."""
    properties: dict[str, Schema] = {}
    for name, kind in entries.items():
        if kind is list:
            properties[name] = {"type": "array", "items": tables[name]}
        else:
            properties[name] = tables[name] if kind is dict else {"type": TYPES[kind]}
    properties["format"]["const"] = file_format
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _housing() -> Schema:
    parts = {name: _part(cls) for name, cls in HOUSING_PARTS.items()}
    return {"type": "object", "properties": parts, "additionalProperties": False}


def _part(cls: type[Any]) -> Schema:
    return _described(_table(table_model(cls)), cls)  # type: ignore[arg-type]  # the cache requires Hashable


def _variants(registry: Mapping[str, type[Any]], model: Callable[[Any], type[Table]]) -> Schema:
    """Return the schema of a table whose entry ``kind`` selects the other entries."""
    variants = []
    for kind, cls in registry.items():
        table = _with_files(_table(model(cls)), cls)
        table["properties"] = {"kind": {"const": kind}, **table["properties"]}
        table["required"] = ["kind", *table.get("required", [])]
        variants.append(_described(table, cls))
    return {"type": "object", "oneOf": variants}


def _with_files(table: Schema, cls: type[Any]) -> Schema:
    """Add the entries that name a file; a file replaces the required entries that it provides."""
    files: dict[str, tuple[str, ...]] = getattr(cls, "file_entries", dict)()
    if not files:
        return table
    required = table.get("required", [])
    provided = {name for names in files.values() for name in names}
    alternatives = [
        {"required": [entry, *(name for name in required if name in provided - {*names})]}
        for entry, names in files.items()
        if names
    ]
    return table | {
        "properties": table["properties"] | dict.fromkeys(files, FILE_NAME),
        "required": [name for name in required if name not in provided],
        "anyOf": [{"required": [n for n in required if n in provided]}, *alternatives],
    }


def _joined(first: Schema, second: Schema, required: Iterable[str] | None = None) -> Schema:
    """Return the schema of a table with the entries of two models."""
    names = [*first.get("required", []), *second.get("required", [])]
    return first | {
        "properties": first["properties"] | second["properties"],
        "required": names if required is None else list(required),
    }


def _described(table: Schema, documented: Any) -> Schema:
    """Add the summary of a docstring."""
    summary = (inspect.getdoc(documented) or "").split("\n\n")[0].replace("\n", " ")
    return {"description": summary, **table} if summary else table


def _table(model: type[Table]) -> Schema:
    return _plain(model.model_json_schema())


def _plain(node: Schema) -> Schema:
    """Remove what TOML and JSON cannot contain (null, infinity), and generated titles."""
    result = {key: value for key, value in node.items() if key not in ("title", "anyOf")}
    options = [_plain(option) for option in node.get("anyOf", ()) if option.get("type") != "null"]
    if len(options) == 1:
        result = options[0] | result
    elif options:
        result["anyOf"] = options
    for key in ("default", "minimum", "maximum"):
        values = result.get(key)
        if any(v in (None, math.inf, -math.inf) for v in _sequence(values)):
            result.pop(key, None)
    if "prefixItems" in result:  # all items of a tuple have the same type
        result["items"] = result.pop("prefixItems")[0]
    if "items" in result:
        result["items"] = _plain(result["items"])
    if "properties" in result:
        result["properties"] = {k: _plain(v) for k, v in result["properties"].items()}
    return result


def _sequence(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else (value,)
