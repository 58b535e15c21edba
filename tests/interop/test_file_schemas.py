"""JSON Schemas of TOML files: valid files conform, and single invalid entries do not."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import tomli_w

import omnimirror as om
from omnimirror.base import project
from omnimirror.base.errors import SpecError
from omnimirror.design import parse_requirements
from omnimirror.interop.batch.job import parse_job
from omnimirror.interop.file_schemas import KINDS
from omnimirror.manufacturing.tolerancing.tolerance_file import TOLERANCE_ENTRIES, parse_tolerances
from omnimirror.optics.camera_files import format_camera
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.sensor_files import (
    HOUSING_PARTS,
    SENSOR_FOLDER,
    format_sensor,
    parse_sensor,
    tables_of,
)
from tests.commands import omnimirror
from tests.conftest import MIRRORS, sensor_of
from tests.contracts.test_camera_models import MODELS

REQUIREMENTS = """
[field]
omega_max_deg = 120
object_distance_mm = [500, inf]
[mirror]
family = "sphere"
rim_radius_mm = [30, 40.5]
[lens]
focal_length_mm = 11.6
focus_mm = [250, inf]
theta_max_deg = [10, 14]
[parts]
extras = "arm"
[[limit]]
quantity = "total_blur_px"
at_most = 4.0
omega_deg = 30
"""
VIEWS = """
[front]
size = [640, 360]
steerable = true
[wall]
view = "panorama"
elevation_deg = [-20, 30]
rows = "height"
[floor]
view = "ground"
height_mm = 1200
"""

BATCH_JOB = """
[inputs]
files = ["raw/*.png"]
time = "%Y%m%d"
[[sensor]]
file = "paper-spherical"
since = 2024-03-01
until = 2025-03-01T12:00:00Z
[view.north]
size = [64, 48]
[output]
url = "views"
[execution]
retries = 2
[storage]
client_kwargs = {endpoint_url = "http://127.0.0.1:9000"}
"""


def problems(kind: str, data: dict[str, Any]) -> list[str]:
    """Return the violations of the schema of a kind."""
    validator = jsonschema_rs.validator_for(finite(om.schema(kind)), validate_formats=True)
    return [error.message for error in validator.iter_errors(finite(data))]


def finite(value: Any) -> Any:
    """Replace infinity and dates, which TOML contains and JSON does not, by a large number and
    text.
    """
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, dict):
        return {name: finite(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    return 1e300 if value == float("inf") else value


def with_entry(data: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Return a copy with one entry changed, or removed if the value is None."""
    result: Any = copy.deepcopy(data)
    *tables, name = path.split(".")
    table = result
    for key in tables:
        table = table[int(key)] if isinstance(table, list) else table.setdefault(key, {})
    if value is None:
        del table[name]
    else:
        table[name] = value
    return result  # type: ignore[no-any-return]


def nodes(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield all schemas within a schema."""
    if isinstance(schema, dict):
        yield schema
        for value in schema.values():
            yield from nodes(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from nodes(value)


@pytest.mark.parametrize("kind", KINDS)
def test_schemas_are_valid_and_self_contained(kind):
    text = json.dumps(om.schema(kind), allow_nan=False)
    jsonschema_rs.meta.validate(json.loads(text))
    assert om.schema(kind)["$id"].endswith(f"schemas/{kind}.json")
    assert not [n for n in nodes(om.schema(kind)) if "$ref" in n or n.get("type") == "null"]


@pytest.mark.parametrize("name", om.bundled_sensors())
def test_bundled_sensors_conform(name):
    text = (SENSOR_FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    assert problems("sensor", tomllib.loads(text)) == []


@pytest.mark.parametrize("kind", MIRRORS)
def test_sensors_with_all_kinds_of_mirrors_conform(kind):
    assert problems("sensor", tables_of(sensor_of(kind))) == []


@pytest.mark.parametrize("name", MODELS)
def test_camera_files_conform(name):
    data = tomllib.loads(format_camera(MODELS[name]))
    assert problems("camera", data) == []
    assert problems("camera", with_entry(data, "camera.radius", 1.0))
    assert problems("camera", with_entry(data, "camera.image_size", [640]))


def test_documented_batch_jobs_conform():
    page = (Path(__file__).parents[2] / "docs" / "batch.md").read_text(encoding="utf-8")
    jobs = [tomllib.loads(block) for block in re.findall(r"^```toml\n(.*?)^```", page, re.M | re.S)]
    assert len(jobs) == 4
    for job in jobs:
        assert problems("batch", job) == []


def test_templates_conform_and_link_their_schema(monkeypatch):
    monkeypatch.setattr(project, "documentation_address", lambda: "https://example.com/docs/")
    sensor = om.load_sensor("paper-spherical")
    templates = {"sensor": om.sensor_template(), "tolerances": om.tolerance_template(sensor)}
    for kind, text in templates.items():
        assert problems(kind, tomllib.loads(text)) == []
        assert text.startswith(f"#:schema https://example.com/docs/schemas/{kind}.json\n")


def test_bundled_sensors_link_their_schema():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    address = tomllib.loads(text)["project"]["urls"]["Documentation"]
    for name in om.bundled_sensors():
        lines = (SENSOR_FOLDER / f"{name}.toml").read_text(encoding="utf-8").splitlines()
        assert lines[0] == f"#:schema {address}schemas/sensor.json"


FILE_ENTRIES = [
    {"kind": "sampled", "rim_radius_mm": 40.0, "profile_csv": "mirror.csv"},
    {"kind": "sampled", "rim_radius_mm": 40.0, "x_mm": [0.0, 1.0], "z_mm": [0.0, 1.0]},
]


@pytest.mark.parametrize("table", FILE_ENTRIES)
def test_a_file_replaces_the_columns_of_a_mirror(table):
    data = tables_of(om.load_sensor("paper-spherical")) | {"mirror": table}
    assert problems("sensor", data) == []
    columns = [name for name in ("profile_csv", "x_mm") if name in table]
    assert problems("sensor", with_entry(data, f"mirror.{columns[0]}", None))


def test_a_file_replaces_the_surfaces_of_a_lens():
    data = tables_of(om.load_sensor("paper-spherical")) | {"lens": {"kind": "surfaces"}}
    assert problems("sensor", data)
    assert problems("sensor", with_entry(data, "lens.file", "lens.zmx")) == []


INVALID_SENSORS = {
    "colour": "red",
    "format": 2,
    "name": 3,
    "lens": None,
    "mirror.kind": "spheroid",
    "mirror.raduis_mm": 50.0,
    "mirror.radius_mm": -1.0,
    "mirror.rim_radius_mm": "44",
    "lens.f_number": 1e9,
    "lens.focal_length_mm": None,
    "imager.width_px": 0.5,
    "imager.centre_px": 3.0,
    "mount.camera_looks": "sideways",
    "mount.pitch_deg": 91.0,
    "mount.image_flipped": 1,
    "housing.roof": {},
    "housing.rod": {"diameter_mm": -1.0},
    "thermal.mirror_material": 1,
    "uncertainty": {"names": ["lens.k1"]},
}
INVALID_REQUIREMENTS = {
    "field.omega_max_deg": 200,
    "field.elevation_deg": [-10, 20],
    "mirror.mapping": "equidistent",
    "mirror.rim_radius_mm": [30, 40, 50],
    "mirror.apex": "round",
    "lens.focal_length_mm": [1, 1e9],
    "lens.optics": {"kind": "perspective"},
    "parts.mirror": "bought",
    "limit.0.quantity": "blurriness",
    "limit.0.omega_deg": [1, 2, 3],
    "thermal.range_c": [20],
    "mirror": None,
}
INVALID_TOLERANCES = {
    "error.0.tolerance": -0.1,
    "error.0.distribution": "triangular",
    "error.0.name": None,
    "correlation": [{"between": ["lens.k1"], "value": 0.5}],
    "objects.angles": 0,
    "objects.refocus": "best",
    "limit.0.after": "lunch",
    "figure": [{"rms": 1.0}],
    "measured": [{"name": "lathe"}],
}
INVALID_VIEWS = {
    "front.pan": 3.0,
    "front.size": [640],
    "front.pan_deg": "30",
    "wall.rows": "width",
    "wall.steerable": True,
    "wall.view": "postcard",
    "floor.height_mm": None,
    "1st": {},
}


INVALID_BATCH_JOBS = {
    "inputs.flies": ["*.png"],
    "inputs.identity": "checksum",
    "inputs": None,
    "sensor.0.since": "yesterday",
    "sensor.0.file": None,
    "sensor": None,
    "view.north.pan": 3.0,
    "view.north.view": "postcard",
    "output.kind": "tape",
    "output.url": None,
    "output.per_shard": 0,
    "execution.retries": 99,
    "cache": {},
}


def _read(kind: str, data: dict[str, Any], folder: Any) -> Any:
    text = tomli_w.dumps(data)
    if kind == "sensor":
        return parse_sensor(text)
    if kind == "requirements":
        return parse_requirements(text)
    if kind == "batch":
        return parse_job(text)
    if kind == "tolerances":
        return parse_tolerances(text, om.load_sensor("paper-spherical"))
    (folder / "views.toml").write_text(text)
    sensor = om.load_sensor("paper-spherical")
    return [view(sensor) for view in om.load_views(folder / "views.toml").values()]


def valid_files() -> dict[str, dict[str, Any]]:
    sensor = om.load_sensor("paper-spherical")
    return {
        "sensor": tomllib.loads(format_sensor(sensor)),
        "requirements": tomllib.loads(REQUIREMENTS),
        "tolerances": tomllib.loads(om.tolerance_template(sensor)),
        "views": tomllib.loads(VIEWS),
        "batch": tomllib.loads(BATCH_JOB),
    }


INVALID = {
    "sensor": INVALID_SENSORS,
    "requirements": INVALID_REQUIREMENTS,
    "tolerances": INVALID_TOLERANCES,
    "views": INVALID_VIEWS,
    "batch": INVALID_BATCH_JOBS,
}


@pytest.mark.parametrize("kind", INVALID)
def test_valid_files_conform(kind, tmp_path):
    data = valid_files()[kind]
    assert problems(kind, data) == []
    assert _read(kind, data, tmp_path)


@pytest.mark.parametrize(
    ("kind", "path"), [(kind, path) for kind, entries in INVALID.items() for path in entries]
)
def test_readers_and_schemas_reject_the_same_entries(kind, path, tmp_path):
    data = with_entry(valid_files()[kind], path, INVALID[kind][path])
    assert problems(kind, data)
    with pytest.raises((SpecError, om.OmnimirrorError)):
        _read(kind, data, tmp_path)


def test_ranges_and_units_are_those_of_the_parameters():
    variants = om.schema("sensor")["properties"]["mirror"]["oneOf"]
    sphere = next(v for v in variants if v["properties"]["kind"] == {"const": "sphere"})
    for name, parameter in Sphere.PARAMETERS.items():
        entry = sphere["properties"][name]
        assert (entry["minimum"], entry["maximum"]) == (parameter.low, parameter.high)
        assert entry["unit"] == parameter.unit
    imager = om.schema("sensor")["properties"]["imager"]
    assert imager["properties"].keys() == Imager.PARAMETERS.keys()
    assert om.schema("sensor")["properties"]["housing"]["properties"].keys() == {*HOUSING_PARTS}
    assert om.schema("tolerances")["properties"].keys() == TOLERANCE_ENTRIES.keys()


def test_command_writes_the_schema(tmp_path):
    result = omnimirror("schema", "views", "-o", str(tmp_path / "views.json"))
    assert result.returncode == 0
    assert json.loads((tmp_path / "views.json").read_text()) == json.loads(
        json.dumps(om.schema("views"))
    )
    assert json.loads(omnimirror("schema", "tolerances").stdout)["title"] == "Tolerance file"


def test_unknown_kinds_are_rejected():
    with pytest.raises(om.OmnimirrorError, match="kind must be one of sensor, camera"):
        om.schema("catalogue")
