"""Commands that describe and evaluate sensors."""

from __future__ import annotations

import json

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import COMMANDS
from omnimirror.base.parameters import Uncertainty
from tests.commands import fails, omnimirror

HEADER = """
omega_deg x_mm z_mm beta_deg theta_deg gamma_deg h_px dh_domega_px_per_deg width_px_per_deg area_px2
aspect viewpoint_z_mm radius_t_mm radius_s_mm q_t_mm q_s_mm image_t_x_mm image_t_z_mm image_s_x_mm
image_s_z_mm distance_t_mm distance_s_mm blur_t_px blur_s_px blur_t_deg blur_s_deg blur_area_deg2 plane_t_mm_per_px
cylinder_t_mm_per_px object_s_mm_per_px
""".split()  # noqa: SIM905 - as the requirement spells it


def test_help_lists_all_commands():
    run = omnimirror("--help")
    assert run.returncode == 0
    for name in COMMANDS:
        assert name in run.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_all_commands_have_help(name):
    run = omnimirror(name, "--help")
    assert run.returncode == 0, run.stderr
    assert "Usage: omnimirror" in run.stdout


def test_printed_table_has_all_angles():
    run = omnimirror("evaluate", "paper-spherical", "--omega-deg", "0:135:5")
    assert run.returncode == 0
    rows = [
        line.split()
        for line in run.stdout.splitlines()
        if line.strip() and line.split()[0].isdigit()
    ]
    assert [int(r[0]) for r in rows] == list(range(0, 136, 5))
    assert "212.00 mm" in run.stdout


def test_csv_is_exact(tmp_path):
    run = omnimirror(
        "evaluate", "paper-equidistant", "--omega-deg", "0:135:15", "--csv", tmp_path / "e.csv"
    )
    assert run.returncode == 0
    header, *rows = (tmp_path / "e.csv").read_text().splitlines()
    assert header.split(",") == HEADER
    values = np.array([[float(v) for v in r.split(",")] for r in rows])
    result = om.evaluate(om.load_sensor("paper-equidistant"), np.arange(0, 136, 15.0))
    np.testing.assert_array_equal(values, np.stack(list(result.columns().values()), axis=1))


def test_json_contains_summary_and_columns(tmp_path):
    args = [
        "evaluate",
        "paper-spherical",
        "--omega-deg",
        "90",
        "--object-distance-mm",
        "219.5",
        "--focus-mm",
        "auto",
    ]
    assert omnimirror(*args, "--json", tmp_path / "e.json").returncode == 0
    data = json.loads((tmp_path / "e.json").read_text())
    assert list(data["columns"]) == HEADER
    best = om.best_focus(om.load_sensor("paper-spherical"), object_distance_mm=219.5)
    assert data["summary"]["focus_mm"] == best.focus_mm
    assert data["summary"]["object_distance_mm"] == 219.5


def test_non_finite_numbers_in_json(tmp_path):
    (tmp_path / "cone.toml").write_text(
        '[mirror]\nkind = "cone"\nslope_deg = 50.0\nrim_radius_mm = 40.0\n[lens]\nkind = '
        '"perspective"\nfocal_length_mm = 11.6\nf_number = 4.0\nfocus_distance_mm = 200.0\n'
        "[imager]\nwidth_px = 1024\nheight_px = 1024\npixel_pitch_um = 5.2\n[mount]\n"
        "mirror_distance_mm = 160.0\n"
    )
    run = omnimirror(
        "evaluate", "cone.toml", "--omega-deg", "105", "--json", "e.json", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert json.loads((tmp_path / "e.json").read_text())["columns"]["radius_t_mm"] == ["inf"]


def test_paper_mode_changes_only_blur(tmp_path):
    for name, flags in (("exact", []), ("paper", ["--set", "blur.mode=paper"])):
        args = ["--omega-deg", "0:135:45", "--csv", tmp_path / f"{name}.csv", *flags]
        assert omnimirror("evaluate", "paper-spherical", *args).returncode == 0
    exact, paper = (
        np.genfromtxt(tmp_path / f"{n}.csv", delimiter=",", names=True) for n in ("exact", "paper")
    )
    for name in HEADER:
        same = np.array_equal(exact[name], paper[name])
        assert same != name.startswith("blur"), name
    np.testing.assert_allclose(paper["blur_t_px"] / exact["blur_t_px"], 1 - 11.6 / 212, rtol=1e-12)


def test_sensors_lists_bundled_sensors():
    run = omnimirror("sensors")
    assert run.returncode == 0
    for name in om.optics.sensor_files.bundled_sensors():
        assert name in run.stdout


def test_init_writes_valid_file_and_does_not_overwrite(tmp_path):
    assert omnimirror("init", cwd=tmp_path).returncode == 0
    assert omnimirror("evaluate", "sensor.toml", cwd=tmp_path).returncode == 0
    (tmp_path / "sensor.toml").write_text("precious")
    assert "already exists" in fails("init", cwd=tmp_path)
    assert (tmp_path / "sensor.toml").read_text() == "precious"
    assert omnimirror("init", "-o", "sensor.toml", cwd=tmp_path).returncode == 0
    assert omnimirror("evaluate", "sensor.toml", cwd=tmp_path).returncode == 0


def test_template_secondary_is_valid(tmp_path):
    assert omnimirror("init", "-o", "mine.toml", cwd=tmp_path).returncode == 0
    text = (tmp_path / "mine.toml").read_text()
    start, end = text.index("# [secondary]"), text.index("# [mirror_pose]")
    folded = "".join(line.removeprefix("# ") + "\n" for line in text[start:end].splitlines())
    (tmp_path / "folded.toml").write_text(text[:start] + folded + text[end:])
    single, double = (om.load_sensor(tmp_path / name) for name in ("mine.toml", "folded.toml"))
    np.testing.assert_allclose(
        om.evaluate(double, [60.0]).h_px, om.evaluate(single, [60.0]).h_px, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ["evaluate", "nowhere.toml"],
            "sensor file, camera file or bundled sensor 'nowhere.toml' does not exist",
        ),
        (["evaluate", "paper-sferical"], "did you mean paper-spherical"),
        (["evaluate"], "Missing argument 'SENSOR'"),
        (["evaluate", "paper-spherical", "--omega-deg", "140"], "omega must be 0 to "),
        (["evaluate", "paper-spherical", "--omega-deg", "0:135"], "must be START:STOP:STEP"),
        (
            ["evaluate", "paper-spherical", "--omega-deg", "0:135:0"],
            "START must be at most STOP, and STEP above 0",
        ),
        (
            ["evaluate", "paper-spherical", "--omega-deg", "0:1e9:1e-3"],
            "must be at most 1000000 numbers",
        ),
        (["evaluate", "paper-spherical", "--omega-deg", "ten"], "got 'ten'"),
        (["evaluate", "paper-spherical", "--omega-deg", "nan"], "must be finite numbers"),
        (
            ["evaluate", "paper-spherical", "--omega-deg", "1", "--x-mm", "2"],
            "omega_deg and x_mm must not be given together",
        ),
        (
            ["evaluate", "paper-spherical", "--object-distance-mm", "-3"],
            "must be a distance in mm above 0, or 'inf'; got '-3'",
        ),
        (
            ["evaluate", "paper-spherical", "--object-distance-mm", "5m"],
            "must be a distance in mm above 0, or 'inf'; got '5m'",
        ),
        (
            ["evaluate", "paper-spherical", "--focus-mm", "near"],
            "must be a distance in mm, or 'auto'; got 'near'",
        ),
        (
            ["evaluate", "paper-spherical", "--focus-mm", "3"],
            "focus_distance_mm must be greater than focal_length_mm",
        ),
        (["evaluate", "paper-spherical", "--pixel", "7"], "must be a pixel U,V; got '7'"),
        (
            ["evaluate", "paper-spherical", "--set", "focus.merit=nice"],
            "'nice' is not one of 'worst_floored_area_deg2'",
        ),
        (["evaluate", "paper-spherical", "--omga-deg", "3"], "No such option"),
        (["evaluate", "paper-spherical", "--csv", "/proc/no/e.csv"], "cannot write /proc/no/e.csv"),
        (["evaluat", "paper-spherical"], "unknown command 'evaluat'; did you mean evaluate?"),
    ],
)
def test_invalid_arguments_print_one_line(args, message, tmp_path):
    assert message in fails(*args, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.long
def test_figures_are_written_to_folder(tmp_path):
    run = omnimirror(
        "evaluate", "paraboloid-telecentric", "--omega-deg", "0:90:30", "-o", tmp_path / "f"
    )
    assert run.returncode == 0, run.stderr
    names = {p.name for p in (tmp_path / "f").iterdir()}
    assert {"fig4.svg", "fig4.png", "fig5.svg", "fig9.svg"} <= names


def test_pixel_option(tmp_path):
    run = omnimirror(
        "evaluate",
        "paper-spherical",
        "--pixel",
        "511.5,11.5",
        "--pixel",
        "811.5,511.5",
        "--csv",
        tmp_path / "p.csv",
    )
    assert run.returncode == 0, run.stderr
    table = np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["h_px"], [500, 300], rtol=1e-12)


def test_camera_file_table(tmp_path):
    """Analytic reference: the image radius of a paraboloid is f tan(Omega / 2)."""
    uncertainty = Uncertainty(("cx", "cy"), ((0.04, 0.0), (0.0, 0.04)))
    camera = om.Unified(
        xi=1.0,
        focal_px=(200.0, 200.0),
        centre_px=(319.5, 239.5),
        image_size=(640, 480),
        uncertainty=uncertainty,
    )
    om.save_camera(camera, tmp_path / "mine.toml")
    run = omnimirror(
        "evaluate",
        "mine.toml",
        "--omega-deg",
        "0:90:45",
        "--csv",
        "t.csv",
        "--json",
        "t.json",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "mine.toml: unified model of a mirror, field to" in run.stdout
    data = json.loads((tmp_path / "t.json").read_text())
    np.testing.assert_allclose(
        data["columns"]["h_px"], [0.0, 200 * np.tan(np.radians(22.5)), 200.0], atol=1e-12
    )
    # 0.2 px in both directions; both have 200 / 2 px per radian in the centre
    assert data["columns"]["direction_sigma_deg"][0] == pytest.approx(np.degrees(0.2 / 100))
    assert {"name": "cx", "value": 319.5, "sigma": pytest.approx(0.2), "unit": "px"} in data[
        "summary"
    ]["parameters"]
    header = (tmp_path / "t.csv").read_text().splitlines()[0].split(",")
    assert list(data["columns"]) == header


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--pixel", "3,1"],
            "--pixel requires a mirror and a lens, which a camera file does not contain",
        ),
        (["--focus-mm", "auto"], "--focus-mm requires"),
        (["--set", "housing.rod={}"], "unknown entry housing"),
        (["-o", "folder"], "--output requires"),
        (["--omega-deg", "170"], "omega_deg must be 0 to"),
    ],
)
def test_optical_options_of_camera_file_raise(options, message, tmp_path):
    om.save_camera(
        om.Unified(
            xi=0.9, focal_px=(200.0, 200.0), centre_px=(319.5, 239.5), image_size=(640, 480)
        ),
        tmp_path / "mine.toml",
    )
    assert message in fails("evaluate", "mine.toml", *options, cwd=tmp_path)
