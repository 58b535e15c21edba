"""Export of the Design tab: files equal to those of the command line, progress, cancellation and
errors of the workshop data."""

from __future__ import annotations

import io
import re
import time
import tomllib
import zipfile

import pytest
import tomli_w
from click.testing import CliRunner
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.cli import app
from omnimirror.apps.studio import _export_process, _workers
from omnimirror.apps.studio._export_form import InvalidEntry, export_start
from omnimirror.apps.studio._export_process import export_files
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.design_messages import ExportTask
from omnimirror.manufacturing import FORMATS, exporter
from omnimirror.manufacturing.tolerancing.tolerance_file import tolerance_template
from omnimirror.optics.sensor_files import parse_sensor, tables_of

RUN = "ws://127.0.0.1/api/design/export/run"
WORKSHOP = {
    "title": {"number": "OM-0042", "owner": "Optics", "date": "2026-11-22"},
    "mirror": {"material": "brass", "coating": "protected aluminium", "form_um": 0.5},
}
TOLERANCES = {
    "paper-spherical": {"mirror.tilt_x_deg": 0.1, "mirror.decentre_x_mm": 0.05},
    "folded-spherical": {"imager.tilt_x_deg": 0.1},
}


def task(sensor: str = "paper-spherical", *formats: str, **changes) -> ExportTask:
    return ExportTask.model_validate(
        {
            "tables": tables_of(om.load_sensor(sensor)),
            "requirements": None,
            "object_distance_mm": None,
            "formats": formats or ("csv",),
            "is_archive": False,
            "workshop": {},
            "tolerances": None,
            **changes,
        }
    )


def unpacked(data: bytes) -> dict[str, bytes]:
    """Return the files of an archive without their folder."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name.rpartition("/")[2]: archive.read(name) for name in archive.namelist()}


def without_times(name: str, data: bytes) -> object:
    """Return the content of a file without the time of its creation."""
    if name.endswith(".step"):
        numbered = rb"FILE_NAME\(.*|(?<=PRODUCT\('paper-spherical) \d+','paper-spherical \d+"
        return re.sub(numbered, b"", data)  # products are numbered within a process
    if name.endswith(".dxf"):  # Julian dates, identifiers, and the remark of ezdxf
        return re.sub(rb"24\d{5}\.\d+|\{[0-9A-F-]{36}\}|\d{4}-\d\d-\d\dT[\d:.+]+", b"", data)
    if name.endswith(".3mf"):
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = {name: archive.read(name) for name in archive.namelist()}
        return {
            name: re.sub(rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", b"", part)
            for name, part in parts.items()
        }
    return data


def run_command(*arguments: object) -> None:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("sensor", ["paper-spherical", "folded-spherical"])
def test_exported_files_match_command_line(sensor, tmp_path):
    """All formats except tool paths, the tolerance report and the sensor file."""
    names = [name for name in FORMATS if name not in ("gcode", "points")]
    if sensor == "folded-spherical":
        names = ["dxf", "csv", "pdf"]
    errors = [{"name": name, "tolerance": size} for name, size in TOLERANCES[sensor].items()]
    tolerances = {
        "errors": errors,
        "refocus": "none",
        "merit": "motion_px",
        "limit": 3.0,
    }
    request = task(sensor, *names, is_archive=True, workshop=WORKSHOP, tolerances=tolerances)
    files = unpacked(export_files(request, lambda message, fraction: None).file.data)
    (tmp_path / "tolerances.toml").write_text(tomli_w.dumps({"error": errors}))
    (tmp_path / "workshop.toml").write_text(tomli_w.dumps(WORKSHOP))
    folder = tmp_path / "export"
    run_command(
        "export", sensor, "-o", folder, "--formats", ",".join(names),
        "--workshop", tmp_path / "workshop.toml", "--tolerances", tmp_path / "tolerances.toml",
    )  # fmt: skip
    assert set(files) == {"README.txt", *(path.name for path in folder.iterdir())}
    for path in folder.iterdir():
        expected = without_times(path.name, path.read_bytes())
        assert without_times(path.name, files[path.name]) == expected, path.name
        assert path.name in files["README.txt"].decode()


def test_tolerance_report_matches_command_line(tmp_path, monkeypatch):
    """Report of the tolerances of the medium grade, the template of the command line."""
    monkeypatch.setattr(_export_process, "TRIALS", 200)
    result = export_files(task("paper-spherical", "tolerances"), lambda message, fraction: None)
    text = tolerance_template(om.load_sensor("paper-spherical"))
    (tmp_path / "tolerances.toml").write_text(text)
    run_command(
        "tolerance", "paper-spherical", tmp_path / "tolerances.toml", "--trials", 200,
        "--report", tmp_path / "report.html",
    )  # fmt: skip
    assert result.file.name == "paper-spherical-tolerances.html"
    assert result.file.data == (tmp_path / "report.html").read_bytes()


def test_requirements_are_part_of_the_archive():
    requirements = {"field": {"omega_max_deg": 130.0}}
    request = task("paper-spherical", "requirements", "sensor", requirements=requirements)
    files = unpacked(export_files(request, lambda message, fraction: None).file.data)
    text = files["paper-spherical-requirements.toml"].decode()
    assert tomllib.loads(text)["field"] == requirements["field"]
    saved = parse_sensor(files["paper-spherical.toml"].decode())
    assert saved == om.load_sensor("paper-spherical")
    with pytest.raises(om.OmnimirrorError, match="the design has no requirements"):
        export_files(task("paper-spherical", "requirements"), lambda message, fraction: None)


def test_progress_precedes_the_file():
    with (
        TestClient(create_app(), base_url="http://127.0.0.1") as client,
        client.websocket_connect(RUN) as socket,
    ):
        socket.send_json(task("paper-spherical", "csv", "pdf", "zmx").model_dump())
        messages = [socket.receive_json()]
        while messages[-1]["state"] == "running":
            messages.append(socket.receive_json())
        data = socket.receive_bytes()
    fractions = [message["fraction"] for message in messages]
    assert fractions == sorted(fractions)
    assert len(fractions) == 4
    assert (messages[-1]["state"], messages[-1]["name"]) == ("done", "paper-spherical.zip")
    assert "Missing entries of the drawing: drawing number" in messages[-1]["remarks"][0]
    assert set(unpacked(data)) == {
        "README.txt",
        "paper-spherical-sag.csv",
        "paper-spherical-drawing.pdf",
        "paper-spherical.zmx",
    }


def test_closed_connection_terminates_the_export(monkeypatch):
    processes = []

    def recorded(module: str):
        processes.append(_workers_start(module))
        return processes[-1]

    _workers_start = _workers.start_process
    monkeypatch.setattr(_workers, "start_process", recorded)
    with TestClient(create_app(), base_url="http://127.0.0.1") as client:
        with client.websocket_connect(RUN) as socket:
            socket.send_json(task("paper-spherical", "report").model_dump())
            assert socket.receive_json()["state"] == "running"
        deadline = time.monotonic() + 30
        while processes[0].poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
    assert processes[0].returncode == -9


@pytest.mark.parametrize(
    ("section", "entry", "value", "message"),
    [
        ("mirror", "form_um", -1.0, "form_um must be"),
        ("mirror", "material", "x" * 27, "material must be printable text of at most 26"),
        ("title", "date", "tomorrow", "date must have the format 2026-11-22"),
        ("mirror", "colour", "red", "the workshop data has no entry mirror.colour"),
        ("lens", "material", "brass", "the workshop data has no entry lens.material"),
    ],
)
def test_error_of_workshop_data_contains_entry(section, entry, value, message):
    with pytest.raises(InvalidEntry, match=message) as caught:
        export_files(task(workshop={section: {entry: value}}), lambda message, fraction: None)
    assert caught.value.entry == (section, entry)


def test_missing_packages_are_reported_with_remedy(monkeypatch):
    assert export_start().remedy is None
    monkeypatch.setattr(exporter, "_is_installed", lambda package: package != "OCP")
    start = export_start()
    assert {f.name: f.missing for f in start.formats if f.missing} == {"step": ("OCP",)}
    assert start.remedy is not None
    assert "omnimirror[cad]" in start.remedy or "pip install" in start.remedy
    with pytest.raises(om.OmnimirrorError, match="step requires OCP"):
        export_files(task("paper-spherical", "step"), lambda message, fraction: None)


def test_form_contains_all_entries_of_workshop_files():
    sections = {section.name: section for section in export_start().workshop}
    assert set(sections) == {"title", "mirror", "secondary"}
    entries = {entry.name: entry for entry in sections["mirror"].entries}
    assert (entries["form_um"].unit, entries["form_um"].low) == ("um", 1e-4)
    assert entries["material"].max_length == 26
    filled = {name: entry.default for name, entry in entries.items()}
    assert export_files(task(workshop={"mirror": filled}), lambda message, fraction: None).file.data
