"""Export from Python and from the command line."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.manufacturing import DEFAULT_FORMATS, FORMATS, Body
from omnimirror.manufacturing.body import parts_of, with_housing
from omnimirror.manufacturing.exporter import sensor_changes
from omnimirror.manufacturing.surface_approximation import fit_asphere
from omnimirror.optics.housing import Dome, Housing, Rim, Rod
from omnimirror.optics.mirrors import SlopeSpline
from omnimirror.optics.sensor_files import bundled_sensors, save_sensor
from tests.commands import omnimirror
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few

from .test_housing import BEFORE_WINDOW, IN_DOME, IN_WATER

COVERED = (IN_WATER, IN_DOME, BEFORE_WINDOW)
NAMES = ["-drawing.pdf", "-sag.csv", ".3mf", ".dat", ".dxf", ".step", ".stl", ".zmx"]


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "slope-spline"))
def test_all_mirrors_export_to_all_formats(kind, tmp_path):
    files = om.export(sensor_of(kind), tmp_path / "out", grid_points=33, chord_tolerance_um=50.0)
    assert sorted(f.path.name for f in files) == [f"{kind}{name}" for name in NAMES]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        f"{kind}{name}" for name in NAMES
    ]
    for file in files:
        assert file.path.stat().st_size > 1000
        assert (file.deviation_um is None) == (file.path.suffix == ".pdf")
        limits = {".stl": 50.0, ".3mf": 50.0, ".dat": 1e3}
        limit = limits.get(file.path.suffix, 0.01)
        assert file.deviation_um is None or 0 <= file.deviation_um <= limit


SENSORS = {name: om.load_sensor(name) for name in bundled_sensors()} | {s.name: s for s in COVERED}


@pytest.mark.parametrize(
    ("name", "kind"),
    few(
        [(name, kind) for name in SENSORS for kind in FORMATS],
        *((name, "svg") for name in ("in-water", "in-dome", "before-window", "folded-spherical")),
        ("in-water", "zmx"),
        ("paraboloid-telecentric", "gcode"),
    ),
)
def test_all_sensors_export_to_all_formats(name, kind, tmp_path):
    files = om.export(
        SENSORS[name], tmp_path, formats=[kind], grid_points=33, chord_tolerance_um=50.0
    )
    assert {f.path for f in files} == set(tmp_path.iterdir())
    for file in files:
        assert file.path.stat().st_size > 300
        if kind in ("csv", "gcode", "points"):
            assert not re.search(r"-0(\.0+)?(?![\d.eE])", file.path.read_text())


@pytest.mark.parametrize("name", SENSORS)
def test_default_bodies_do_not_change_the_sensor(name):
    """Bodies from the rims of the housing do not change the evaluated sensor."""
    sensor = SENSORS[name]
    assert sensor_changes(sensor, with_housing(parts_of(sensor))) == []


@pytest.mark.parametrize(
    ("name", "options", "terms"),
    [
        ("in-dome", {"body": Body(flange_width_mm=80.0)}, ["dome", "hides"]),
        (
            "fitted-dome",
            {"body": Body(flange_width_mm=5.0)},
            ["dome diameter_mm 238 -> 242", "obscured_percent"],
        ),
        (
            "paper-spherical",
            {"body": Body(flange_width_mm=5.0)},
            ["rim hides nothing -> 129.3 to 135 deg"],
        ),
        (
            "paper-spherical",
            {"housing": Housing(rod=Rod())},
            ["rod hides nothing", "obscured_to_deg"],
        ),
        ("in-water", {"housing": Housing()}, ["cover tube -> none", "field_from_deg"]),
    ],
)
def test_changes_of_the_evaluated_sensor_stop_the_export(name, options, terms, tmp_path):
    fitted = replace(
        SENSORS["paper-spherical"], housing=Housing(shell=Dome(material="polycarbonate"))
    )
    sensor = SENSORS.get(name, fitted)
    if name == "in-dome":  # the dome has no space for such a flange
        with pytest.raises(InvalidParameter, match="to enclose the mirror"):
            om.export(sensor, tmp_path / "a.step", **options)
        return
    with pytest.raises(InvalidParameter) as error:
        om.export(sensor, tmp_path / "a.csv", **options)
    for term in (*terms, "change the evaluated sensor", "--allow-changes"):
        assert term in str(error.value)
    assert not list(tmp_path.iterdir())
    assert om.export(sensor, tmp_path / "a.csv", allow_changes=True, **options)


@pytest.mark.parametrize("body", [Body(thickness_mm=9.0), Body(thread="M6", bore_depth_mm=12.0)])
def test_invisible_bodies_are_not_changes(body, tmp_path):
    assert om.export(om.load_sensor("paper-spherical"), tmp_path / "a.csv", body=body)


@pytest.mark.parametrize(
    "suffix", few([".stp", ".STEP", ".svg", ".png", ".dat", ".csv"], ".STEP", ".svg", ".dat")
)
def test_suffix_selects_the_format(suffix, tmp_path):
    file, *others = om.export(
        om.load_sensor("paper-spherical"), tmp_path / f"mirror{suffix}", grid_points=9
    )
    assert file.path == tmp_path / f"mirror{suffix}"
    assert [other.path.name for other in others] == [f"mirror-mirror{suffix}"] * (
        suffix in (".svg", ".png")
    )
    assert all(f.path.exists() for f in (file, *others))


def test_sensor_names_are_converted_to_file_names(tmp_path):
    sensor = replace(om.load_sensor("paper-spherical"), name="../my sensor: no 1/2")
    (file,) = om.export(sensor, tmp_path, formats=["csv"])
    assert file.path == tmp_path / "my-sensor-no-1-2-sag.csv"


@pytest.mark.parametrize(
    ("path", "formats", "message"),
    [
        ("mirror.sldprt", None, "one of the suffixes .step"),
        ("out", ["step", "iges"], "names from step, stl.* got 'iges'"),
        ("mirror.step", ["stl"], "a folder for the formats stl; got the step file"),
    ],
)
def test_invalid_formats_are_rejected(path, formats, message, tmp_path):
    with pytest.raises(InvalidParameter, match=message):
        om.export(om.load_sensor("paper-spherical"), tmp_path / path, formats=formats)
    assert not list(tmp_path.iterdir())


def test_failed_export_leaves_existing_files_unchanged(tmp_path):
    sensor = om.load_sensor("paper-spherical")
    (tmp_path / "paper-spherical-sag.csv").write_text("precious")
    with pytest.raises(InvalidParameter, match="got a hole"):
        om.export(
            sensor,
            tmp_path,
            formats=["csv", "zmx", "step"],
            body=Body(bore_diameter_mm=5.0, bore_depth_mm=40.0),
        )
    assert [p.name for p in tmp_path.iterdir()] == ["paper-spherical-sag.csv"]
    assert (tmp_path / "paper-spherical-sag.csv").read_text() == "precious"


def test_missing_package_message(tmp_path, monkeypatch):
    module = sys.modules[FORMATS["zmx"].write.__module__]
    monkeypatch.setattr(
        module, "find_spec", lambda name: None if name in ("OCP", "ezdxf") else object()
    )
    sensor = om.load_sensor("paper-spherical")
    message = (
        "step, dxf require OCP, ezdxf: run pip install '.[cad]' in the repository, or select "
        "stl, 3mf, zmx, gridsag, csv, pdf"
    )
    with pytest.raises(OmnimirrorError, match=f"^{re.escape(message)}$"):
        om.export(sensor, tmp_path)
    with pytest.raises(
        OmnimirrorError, match=r"^step requires OCP: run pip install '\.\[cad\]' in the repository$"
    ):
        om.export(sensor, tmp_path / "mirror.step")
    assert len(om.export(sensor, tmp_path, formats=["csv", "zmx"])) == 2


@pytest.mark.full
def test_core_formats_import_no_optional_package():
    """Lens files, tables and drawings require only core packages."""
    code = (
        "import sys, tempfile, omnimirror as om\nwith tempfile.TemporaryDirectory() as "
        "folder:\n    sensor = om.load_sensor('exact-equidistant')\n    om.export(sensor, "
        "folder, formats=['zmx', 'gridsag', 'csv', 'pdf'], grid_points=9)\nprint([m for m in "
        "('OCP', 'ezdxf', 'trimesh', 'networkx') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.strip() == "[]", run.stderr


# -- command
# ---------------------------------------------------------------------------------------------


def test_command_prints_files_and_deviations(tmp_path):
    run = omnimirror(
        "export",
        "exact-equidistant",
        "-o",
        "out",
        "--thread",
        "M6",
        "--set",
        "file.grid_points=65",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    lines = [line.split() for line in run.stdout.splitlines() if line.startswith("out/")]
    assert len(lines) == len(DEFAULT_FORMATS)
    deviation = {Path(line[0]).suffix: line[-1] for line in lines}
    assert float(deviation[".stl"]) <= 10
    assert 0 < float(deviation[".step"]) <= 0.01
    assert float(deviation[".zmx"]) < 1e-3
    assert "M6" in (tmp_path / "out" / "exact-equidistant.step").read_text()


def test_options_affect_the_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(name, *options):
        main(["export", "paper-spherical", "-o", name, *options])
        return (tmp_path / name).read_text(encoding="utf-8", errors="replace")

    assert (
        write("a.csv", "--set", "file.step_deg=45", "--set", "file.digits=2")
        .splitlines()[-2]
        .startswith("43.90,26.12,135.00,")
    )
    assert write("a.dat", "--set", "file.grid_points=11").startswith("11 11 ")
    svg = write(
        "a.svg",
        "--set",
        "housing.rod.diameter_mm=5",
        "--allow-changes",
        "--set",
        "file.sheet=A4",
        "--set",
        "file.scale=1:5",
    )
    assert "rod Ø5" in svg
    assert "SENSOR  1:5" in svg
    coarse, fine = (
        len(write("a.stl", "--set", f"file.chord_tolerance_um={t}")) for t in ("100", "10")
    )
    assert 5 < fine / coarse < 15


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--formats", "step,iges"], "got 'iges'"),
        (["--set", "file.scale=half"], "such as 1:2 or 5:1; got 'half'"),
        (["--set", "file.scale=1:0"], "got '1:0'"),
        (
            ["--thread", "M6", "--set", "body.bore_diameter_mm=5"],
            "bore_diameter_mm must not be given",
        ),
        (["--set", "body.bore_diameter_mm=5", "--set", "body.bore_depth_mm=40"], "got a hole"),
        (
            ["--set", "housing.tube.diameter_mm=50"],
            "to enclose the mirror",
        ),
        (
            ["--set", "body.thickness_mm=nan"],
            "body.thickness_mm must be a number; got nan",
        ),
        (["--set", "file.digits=40"], "digits must be an integer between 0 and 15; got 40"),
    ],
)
def test_invalid_options_print_one_message_and_write_no_file(
    options, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(["export", "paper-spherical", "-o", "out", *options])
    stderr = capsys.readouterr().err
    assert message in stderr
    assert len(stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@pytest.mark.parametrize("suffix", few([".step", ".dxf"], ".dxf"))
def test_full_disk_prints_one_message_and_keeps_files(suffix, tmp_path):
    path = tmp_path / f"out{suffix}"
    path.write_text("precious")
    run = subprocess.run(
        [
            Path(sys.executable).with_name("omnimirror"),
            "export",
            "paper-spherical",
            "-o",
            path.name,
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # it would be truncated too
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert run.returncode == 1
    assert run.stderr.startswith(f"omnimirror: cannot write out{suffix}"), run.stderr
    assert len(run.stderr.splitlines()) == 1, run.stderr
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_all_formats_are_documented():
    page = (Path(__file__).parents[2] / "docs" / "manufacture.md").read_text()
    for name, entry in FORMATS.items():
        assert f"`{name}`" in page
        assert all(f"`{suffix}`" in page for suffix in entry.suffixes)


def test_inaccurate_lens_file_prints_a_warning(tmp_path):
    """A freeform profile exceeds sixteen terms; the reported angle is that between the reflected
    rays.
    """
    sphere = om.load_sensor("paper-spherical")
    x = np.linspace(0, sphere.mirror.rim_radius_mm, 41)
    slopes = sphere.mirror.slope(x) * (1 + 2e-3 * np.sin(x))
    wavy = replace(
        sphere, mirror=SlopeSpline(tuple(slopes), sphere.mirror.rim_radius_mm), name="wavy"
    )
    (file,) = om.export(wavy, tmp_path, formats=["zmx"])
    r = np.linspace(0, wavy.mirror.rim_radius_mm, 4001)
    angle_deg = 2 * np.degrees(
        np.abs(np.arctan(fit_asphere(wavy.mirror).profile(r)[1]) - np.arctan(wavy.mirror.slope(r)))
    )
    assert file.ray_deg == pytest.approx(angle_deg.max(), rel=1e-2)
    assert file.ray_deg > 0.05
    assert not file.follows
    (exact,) = om.export(sphere, tmp_path, formats=["zmx"])
    assert exact.ray_deg == 0
    assert exact.follows
    save_sensor(wavy, tmp_path / "wavy.toml")
    output = omnimirror(
        "export", tmp_path / "wavy.toml", "-o", tmp_path / "lens", "--formats", "zmx,gridsag"
    ).stdout
    assert f"{file.ray_deg:.2g}" in output
    assert "wavy.zmx is not accurate" in output
    assert "grid sag" in output


REQUIREMENTS = """
[field]
omega_max_deg = 130.0

[mirror]
family = "sphere"
rim_radius_mm = 43.9

[lens]
theta_max_deg = [5.0, 20.0]

[[limit]]
quantity = "total_blur_px"
at_most = 20.0

[[limit]]
quantity = "obscured_percent"
at_most = 2.0
"""


def test_export_lists_requirements_with_changed_margins(tmp_path, monkeypatch, capsys):
    """Margins equal those of ``om.check_requirements`` for the evaluated sensor and for the sensor
    with the flange in its housing.
    """
    monkeypatch.chdir(tmp_path)
    Path("requirements.toml").write_text(REQUIREMENTS)
    sensor, requirements = (
        om.load_sensor("paper-spherical"),
        om.load_requirements("requirements.toml"),
    )
    with_rim = replace(sensor, housing=replace(sensor.housing, rim=Rim(5.0, 3.0, 5.0)))
    before, after = (
        {row.label: row for row in om.check_requirements(requirements, s).rows}
        for s in (sensor, with_rim)
    )
    labels = {
        label for label, row in before.items() if abs(row.margin - after[label].margin) > 1e-6
    }
    assert "omega_max_deg" in labels
    with pytest.raises(InvalidParameter, match="change the evaluated sensor") as error:
        om.export(
            sensor,
            "out",
            formats=["csv"],
            body=Body(flange_width_mm=5.0),
            requirements="requirements.toml",
        )
    message = str(error.value)
    for label, row in before.items():
        entry = f"{label}: margin {row.margin:.4g} -> {after[label].margin:.4g}"
        assert (entry in message) == (label in labels)
    assert "omega_max_deg: margin 5.005 -> -0.6733 deg (not met)" in message
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(
            [
                "export",
                "paper-spherical",
                "-o",
                "out",
                "--set",
                "body.flange_width_mm=5",
                "--requirements",
                "requirements.toml",
            ]
        )
    assert "obscured_percent: margin 2 -> -1.416 % (not met)" in capsys.readouterr().err
    assert not Path("out").exists()
