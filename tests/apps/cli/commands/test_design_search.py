"""Commands for optimised designs, Pareto fronts, apertures and catalogue parts."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import omnimirror as om
from omnimirror.design._design_problem import DesignProblem
from omnimirror.design.optimiser import optimise
from tests.commands import fails, omnimirror

REQUIREMENTS = """
name = "ring"
[field]
omega_max_deg = 130
object_distance_mm = [600, inf]
[mirror]
mapping = "equidistant"
fit = "polynomial:4"
rim_radius_mm = 40
[lens]
theta_max_deg = 12
[[limit]]
quantity = "total_blur_px"
at_most = 4.0
"""


def test_optimise_writes_sensor_and_prints_convergence(tmp_path):
    run = omnimirror(
        "design",
        "--like",
        "paper-spherical",
        "--optimise",
        "worst_blur_deg",
        "--set",
        "mirror.shape=polynomial",
        "--set",
        "search.terms=3,4,5",
        "--set",
        "search.starts=1",
        "--set",
        "search.mode=paper",
        "--set",
        "search.image_radius_px=500",
        "-o",
        "best.toml",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    values = [float(line.split()[-2]) for line in run.stdout.splitlines()[2:5]]
    assert values == sorted(values, reverse=True)
    sensor = om.load_sensor(tmp_path / "best.toml")
    assert sensor.mirror.KIND == "even-polynomial"
    assert sensor.field_deg[1] == pytest.approx(
        om.load_sensor("paper-spherical").field_deg[1], abs=1e-9
    )
    for word in ("requirement", "margin", "sphere", "optimised"):
        assert word in run.stdout


def test_optimise_from_options_only(tmp_path):
    run = omnimirror(
        "design",
        "--optimise",
        "worst_floored_area_deg2",
        "--omega-max-deg",
        120,
        "--theta-max-deg",
        "8:12",
        "--rim-radius-mm",
        30,
        "--focal-length-mm",
        16,
        "--f-number",
        "2:16",
        "--set",
        "imager.width_px=2048",
        "--set",
        "imager.height_px=2048",
        "--set",
        "imager.pixel_pitch_um=3.45",
        "--set",
        "search.terms=5",
        "--at-least",
        "area_ratio=0.667",
        "--at-most",
        "total_blur_t_px=3@20:110",
        "--set",
        "search.starts=1",
        "--set",
        "search.resume=search.json",
        "-o",
        "best.toml",
        "--json",
        "best.json",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    sensor = om.load_sensor(tmp_path / "best.toml")
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-9)
    assert (sensor.mirror.rim_radius_mm, sensor.lens.focal_length_mm, sensor.imager.width_px) == (
        30.0,
        16.0,
        2048,
    )
    assert (tmp_path / "search.json").exists()
    areas = om.evaluate(sensor).area_px2
    assert areas.min() / areas.max() >= 0.667
    blur = om.evaluate(sensor, np.linspace(20, 110, 901)).blur_t_px
    assert np.abs(blur).max() <= 3.0
    rows = json.loads((tmp_path / "best.json").read_text())["requirements"]
    assert [r["name"] for r in rows][-2:] == ["total_blur_t_px", "area_ratio"]
    assert all(r["is_met"] for r in rows)


SEARCH = (
    "design",
    "r.toml",
    "--optimise",
    "worst_floored_area_deg2",
    "--set",
    "mirror.shape=polynomial:3",
    "--set",
    "search.starts=1",
)


def test_optimise_replaces_mapping_of_file(tmp_path):
    (tmp_path / "r.toml").write_text(REQUIREMENTS)
    run = omnimirror(*SEARCH, "--f-number", 8, "-o", "s.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert om.load_sensor(tmp_path / "s.toml").mirror.KIND == "even-polynomial"


@pytest.mark.full  # test_design covers the conflict of a family, reported in the same format
@pytest.mark.long
def test_optimised_requirements_report_conflicts(tmp_path):
    (tmp_path / "r.toml").write_text(REQUIREMENTS)
    run = omnimirror(*SEARCH, "--json", "t.json", cwd=tmp_path)
    assert run.returncode == 3, run.stdout + run.stderr
    assert "Infeasible requirements: total_blur_px." in run.stdout
    conflict = json.loads((tmp_path / "t.json").read_text())["conflict"]
    names = {r["name"] for r in conflict["alone"] if r["needed"] is not None}
    assert {"total_blur_px", "f_number", "omega_max_deg"} <= names
    assert 0 < conflict["joint_change"] < 0.5


@pytest.mark.long
def test_pareto_front_is_saved_drawn_and_selected_from(tmp_path):
    arguments = (
        "design",
        "--pareto",
        "worst_floored_area_deg2,inverse_area_ratio",
        "--set",
        "mirror.shape=polynomial:4",
        "--set",
        "search.population=20",
        "--set",
        "search.generations=20",
        "--set",
        "search.resume=front.parquet",
    )
    run = omnimirror(*arguments, "--figures", "figures", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    for name in ("SPH", "E-DI", "SVP", "exactly equiareal"):
        assert name in run.stdout
    assert om.read_image(tmp_path / "figures" / "front.png").std() > 5
    assert (tmp_path / "figures" / "front.svg").exists()
    run = omnimirror(*arguments, "--set", "search.pick=1", "-o", "one.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "requirement" in run.stdout
    assert (
        om.load_sensor(tmp_path / "one.toml").name
        == "front-worst-floored-area-deg2-inverse-area-ratio-1"
    )
    assert "search.pick=NUMBER" in fails(*arguments, "-o", "other.toml", cwd=tmp_path)
    assert not (tmp_path / "other.toml").exists()


@pytest.mark.full
@pytest.mark.long
def test_interrupted_search_is_resumed(tmp_path):
    """Ctrl-C after the first start: the best design is written, and the same command completes the
    search."""
    search = (
        "design",
        "--optimise",
        "worst_blur_deg",
        "--set",
        "search.terms=16",
        "--set",
        "search.starts=12",
        "--set",
        "search.resume=search.json",
    )
    # background processes ignore SIGINT by default
    signal_setup = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    main = "from omnimirror.apps.cli import main; main(sys.argv[1:])"
    program = [sys.executable, "-c", signal_setup + main, *search, "-o", "best.toml"]
    process = subprocess.Popen(
        program, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while not (tmp_path / "search.json").exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    output, error_output = process.communicate()
    assert process.returncode == 130, error_output
    assert "Stopped" in output
    assert om.load_sensor(tmp_path / "best.toml").mirror.KIND == "slope-spline"
    run_count = len(json.loads((tmp_path / "search.json").read_text())["runs"])
    assert 0 < run_count < 12
    problem = DesignProblem(terms=16)
    progress = []
    optimise(
        problem,
        "worst_blur_deg",
        starts=run_count + 1,
        resume=tmp_path / "search.json",
        on_iteration=progress.append,
    )
    assert {p.run for p in progress} == {run_count}


def test_apertures_and_parts_print_tables(tmp_path):
    run = omnimirror("apertures", "paper-spherical", "paper-hyperboloidal", "--f-number", "1.4:16")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("together") == 2
    run = omnimirror("parts", "paper-spherical", "-o", "bought.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "exceeds" in run.stdout
    sensor = om.load_sensor(tmp_path / "bought.toml")
    assert sensor.mirror == om.load_sensor("paper-spherical").mirror
    assert "no sensor file was written" in fails(
        "parts", "paper-spherical", "typical", "--min-fill", 0.99999, "-o", "x.toml", cwd=tmp_path
    )


OPTIMISE = ["design", "--optimise", "worst_floored_area_deg2", "--set", "search.starts=1"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*OPTIMISE, "--at-most", "area_ratio"], "QUANTITY=NUMBER"),
        ([*OPTIMISE, "--at-most", "sharpness=3"], "got 'sharpness'"),
        ([*OPTIMISE, "--at-most", "total_blur_px=3@20:160"], "limit.omega_deg must be [FROM, TO]"),
        ([*OPTIMISE, "--set", "search.terms=few"], "integers above 0"),
        ([*OPTIMISE, "--set", "search.terms=200"], "must be 3 to 60"),
        (
            [*OPTIMISE, "--set", "mirror.shape=cone:3"],
            "the freeform family must be spline:N with N from 3 to 60",
        ),
        (
            [*OPTIMISE, "--set", "mirror.fit=polynomial:3"],
            "must be omitted for an optimised mirror",
        ),
        ([*OPTIMISE, "--theta-max-deg", "12:x"], "range LOW:HIGH"),
        ([*OPTIMISE, "--omega-max-deg", "175"], "omega_max_deg must be between"),
        ([*OPTIMISE, "--set", "search.population=3"], "requires --pareto"),
        ([*OPTIMISE, "--mapping", "equidistant"], "got mapping and optimise"),
        (
            [*OPTIMISE, "--set", "search.resume=s.json", "--set", "search.terms=3,4"],
            "requires a single value of search.terms",
        ),
        (["design", "--optimise", "beauty"], "is not one of"),
        (
            [
                "design",
                "--set",
                "mirror.shape=spline:5",
                "--like",
                "paper-spherical",
                "--mapping",
                "equidistant",
            ],
            "requires mirror.optimise",
        ),
        (
            ["design", "--like", "nowhere", "--optimise", "worst_blur_deg"],
            "sensor file or bundled sensor 'nowhere' does not exist",
        ),
        (["design", "--pareto", "worst_blur_deg"], "at least two different names"),
        (["design", "--pareto", "worst_blur_deg,beauty"], "must be one of worst_floored_area_deg2"),
        (
            ["design", "--pareto", "worst_blur_deg,worst_aspect", "--set", "search.starts=3"],
            "requires --optimise",
        ),
        (
            ["design", "--pareto", "worst_blur_deg,worst_aspect", "--set", "lens.focus_mm=200"],
            "focus_mm must be omitted",
        ),
        (
            [
                "design",
                "--mapping",
                "equidistant",
                "--like",
                "paper-spherical",
                "--set",
                "search.seed=3",
            ],
            "--set search.seed requires",
        ),
        (
            ["apertures", "paper-spherical", "--f-number", "8:4"],
            "must be a range with 0 < low <= high",
        ),
        (["parts", "paper-spherical", "nowhere.toml"], "cannot read"),
    ],
)
def test_invalid_arguments_print_one_line(arguments, message):
    assert message in fails(*arguments)
