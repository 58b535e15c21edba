"""Command line with unusual arguments: a result, or one line and a nonzero exit code."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.optics.sensor_files import SENSOR_FOLDER
from tests.everyday import few

SENSOR = (
    '[mirror]\nkind = "sphere"\nradius_mm = {a}\nrim_radius_mm = 44.0\n[lens]\nkind = "perspective"\n'
    "focal_length_mm = {b}\nf_number = 4.0\nfocus_distance_mm = 218.0\n"
    "[imager]\nwidth_px = {c}\nheight_px = 64\npixel_pitch_um = 83.2\n[mount]\nmirror_distance_mm = {d}\n{e}"
)
REQUIREMENTS = (
    '[field]\nomega_max_deg = {a}\n[mirror]\nmapping = "equidistant"\nrim_radius_mm = {b}\n[lens]\n'
    "theta_max_deg = {c}\nf_number = {d}\n{e}"
)
PARTS = (
    '[[lens]]\nname = "l"\nfocal_length_mm = {a}\nf_number_min = {b}\nf_number_max = 16.0\nminimum_focus_mm = 100.0\n'
    '[[imager]]\nname = "i"\nwidth_px = {c}\nheight_px = 1000\npixel_pitch_um = {d}\n{e}'
)
CHECKS = (
    '[field]\nomega_max_deg = {a}\nobject_distance_mm = {b}\n[mirror]\nmapping = "equidistant"\n'
    'rim_radius_mm = 40.0\n[lens]\ntheta_max_deg = 12.0\n[[limit]]\nquantity = "total_blur_px"\nat_most = {c}\n'
    '[[limit]]\nquantity = "resolution_px_per_deg"\nat_least = {d}\n{e}'
)
ERRORS = (
    '[[error]]\nname = "mirror.decentre_x_mm"\ntolerance = {a}\n'
    '[[error]]\nname = "mirror.tilt_x_deg"\ntolerance = {b}\ndistribution = "normal"\n'
    '[[correlation]]\nbetween = ["mirror.decentre_x_mm", "mirror.tilt_x_deg"]\nvalue = {c}\n'
    '[[limit]]\nquantity = "motion_px"\nafter = "pose"\nat_most = {d}\n{e}'
)
FIGURES = (
    "[objects]\nobject_distance_mm = {a}\n[[figure]]\nrms_um = {b}\nexponent = {c}\norders = [{d}, 6]\n"
    '[[limit]]\nquantity = "motion_px"\nat_most = 1.0\n{e}'
)
HOUSED = (
    SENSOR.format(a="50.0", b="11.6", c="64", d="185.93", e="")
    + "[housing.tube]\ndiameter_mm = {a}\nwall_mm = {b}\n[housing.camera]\ndiameter_mm = {c}\n"
    + "[housing.rim]\nwidth_mm = {d}\n{e}"
)
USUAL = {
    SENSOR: ("50.0", "11.6", "64", "185.93"),
    REQUIREMENTS: ("90.0", "40.0", "12.0", "4.0"),
    PARTS: ("8.0", "1.4", "1000", "5.0"),
    CHECKS: ("90.0", "[500.0, inf]", "3.0", "1.0"),
    ERRORS: ("0.1", "0.05", "0.5", "1.0"),
    FIGURES: ("2000.0", "0.3", "2.5", "4"),
    HOUSED: ("98.0", "3.0", "24.0", "1.0"),
}
FILES = {
    "evaluate {} --omega-deg 0:60:30": SENSOR,
    "design {}": REQUIREMENTS,
    "parts paper-spherical {}": PARTS,
    "check {} paper-spherical": CHECKS,
    "tolerance small.toml {} --trials 3": ERRORS,
    "tolerance small.toml {} --trials 2": FIGURES,
    "check requirements.toml {} --json out.json": HOUSED,
    "rays {} -o rays.npz": SENSOR,
    "maps {} --view perspective --size 8x6 -o map.npz": SENSOR,
    "colmap {} b.png -o project --views 1 --set view.size=16": SENSOR,
    "check requirements.toml {}": SENSOR,
    "form {} points.csv": SENSOR,
}
ODD_VALUES = (
    "[]",
    "[1.0]",
    "true",
    "inf",
    "nan",
    "-1.0",
    "0",
    '""',
    '"x"',
    '"[/red]"',
    "{}",
    "9" * 25,
    "9" * 5000,
    "1e308",
    "-1e308",
    "1e300",
    "1e-308",
    "5e-324",
    "9223372036854775807",
    "[" * 3000 + "]" * 3000,
    "[" + "1.5, " * 50_000 + "]",
    "1979-05-27",
    '"\\u0000"',
    "1_0.0",
)
ODD_LINES = (
    "",
    "x = 1",
    "format = true",
    "[[limit]]",
    'name = "a\\nb"',
    '"a\\nb" = 1',
    "[mirror]",
    "\x00",
    "\udcff",
    "é",
)
INVALID_ARGUMENTS = (
    "",
    "-",
    "x",
    "1_000",
    "١٢٣",
    "inf",
    "nan",
    "-1",
    "1e308",
    "-1e308",
    "1e300",
    "1e-308",
    "5e-324",
    "2147483648",
    "9223372036854775807",
    "0",
    "0:1:0",
    "9" * 5000,
    "a\nb",
    "[/red]",
    "[bold]",
    "/dev/null",
    "/dev/zero",
    "/",
    ".",
    "loop",
    "n\udcff",
    "\x1b[31m",
    "--",
    "é" * 300,
    "paper-spherical",
    "1,2,3,4",
)
EXTREMES = (
    "1e308",
    "-1e308",
    "1e160",
    "1e20",
    "5e-324",
    "1e-160",
    "0.0",
    "nan",
    "9223372036854775807",
)
NUMBER = re.compile(r"(?<=[ \[])-?\d+(?:\.\d+)?(?:e-?\d+)?(?=[\s,\]])")
COMMANDS = (
    "evaluate paper-spherical --omega-deg {}",
    "evaluate {} --omega-deg 0",
    "evaluate paper-spherical --set blur.image_radius_px={}",
    "evaluate paper-spherical --omega-deg 0:60:30 --csv {}",
    "evaluate paper-spherical --omega-deg 0 --focus-mm {}",
    "evaluate paper-spherical --omega-deg 0 --set light.wavelength_nm={}",
    "evaluate paper-spherical --pixel {}",
    "spots paper-spherical --omega-deg 30 --set pupil.rings={}",
    "spots paper-spherical --omega-deg {}",
    "psf paper-spherical --kind geometric --omega-deg {}",
    "mtf paper-spherical --omega-deg 30 --kind {}",
    "illumination paper-spherical --omega-deg 30 --reflectivity {}",
    "illumination {} --omega-deg 30",
    "illumination paper-spherical --omega-deg 0:60:30 --csv {}",
    "compare paper-spherical {}",
    "bracket plan {}",
    "init -o {}",
    "design --like {}",
    "design --mapping {} --omega-max-deg 90",
    "parts paper-spherical {}",
    "parts {} parts.toml",
    "dewarp a.png --ball {} -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size {} -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size 32x16 --set view.span_deg={} -o out.png",
    "dewarp {} --ball 16,16,12,300 -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size 32x16 -o {}",
    "dewarp a.png --sensor {} -o out.png",
    "dewarp a.png --sensor calib_results.txt --set camera.rim_radius_px={} -o out.png",
    "mappings --omega-max-deg {}",
    "export {} -o out.csv",
    "{}",
    "simulate {}",
    "lines a.png --rim {} 16 12",
    "lines a.png --camera {}",
    "lines {}",
    "lines a.png --camera small.toml --set lines.distance_mm={}",
    "lines a.png --camera small.toml --set rim.inner_radius_px={}",
    "lines --lines edges.csv --camera calib_results.txt --image-size {}",
    "lines --lines {} --camera calib_results.txt --image-size 1024x768",
    "rim {}",
    "rim a.png --separately {}",
    "rim a.png -o {}",
    "rim a.png --json {}",
    "colmap {} a.png -o project",
    "colmap small.toml {} -o project --views 1 --set view.size=16",
    "colmap small.toml b.png -o {} --views 1 --set view.size=16",
    "colmap small.toml b.png -o project --set view.size=16 --views {}",
    "colmap small.toml b.png -o project --views 1 --set view.size={}",
    "colmap small.toml b.png -o project --views 1 --set view.size=16 --hfov-deg {}",
    "colmap small.toml b.png -o project --views 1 --set view.size=16 --set view.tilt_deg={}",
    "colmap small.toml b.png -o project --views 1 --set view.size=16 --set view.distance_mm={}",
    "colmap small.toml b.png -o project --views 1 --set view.size=16 --every {}",
    "colmap small.toml b.png -o project --views 1 --set view.size=16 --poses {}",
    "colmap small.toml b.png -o project --panorama --set view.size={}",
    "rays {} -o rays.npz",
    "rays small.toml -o {}",
    "rays small.toml -o rays.npz --step {}",
    "rays small.toml -o rays --format {}",
    "maps {} --size 8x6 -o map.npz",
    "maps small.toml --size 8x6 -o {}",
    "maps small.toml --size 8x6 -o map --format {}",
    "maps small.toml --view perspective --size {} -o map.npz",
    "maps small.toml --view perspective --size 8x6 --hfov-deg {} -o map.npz",
    "maps small.toml --view perspective --size 8x6 --distance-mm {} -o map.npz",
    "maps small.toml --view perspective --size 8x6 --set view.zoom={} -o map.npz",
    "maps small.toml --view perspective --size 8x6 --set view.offset_mm={},0,0 --distance-mm 900 -o map.npz",
    "maps small.toml --view ground --size 8x6 --set view.height_mm={} -o map.npz",
    "maps small.toml --view ground --size 8x6 --set view.height_mm=900 --set view.mm_per_px={} -o map.npz",
    "maps small.toml --size 8x6 --elevation-deg {} -o map.npz",
    "maps small.toml --size 8x6 --distance-mm 900 --set view.wall_mm=0:{} -o map.npz",
    "check {} paper-spherical",
    "check requirements.toml {}",
    "check requirements.toml paper-spherical --temperatures 0:{}",
    "check requirements.toml paper-spherical --set housing.tube.wall_mm={}",
    "check requirements.toml paper-spherical --set housing.dome.centre_mm={}",
    "check requirements.toml paper-spherical --set housing.camera.diameter_mm={}",
    "check requirements.toml paper-spherical --json {}",
    "parts paper-spherical parts.toml --min-fill {}",
    "parts paper-spherical parts.toml --object-distance-mm {}",
    "parts paper-spherical parts.toml -o {}",
    "form {} points.csv",
    "form paper-spherical {}",
    "form paper-spherical points.csv --set fit.order={}",
    "form paper-spherical points.csv --json {}",
    "form paper-spherical points.csv --set as_built.asymmetric=true -o {}",
    "tolerance small.toml errors.toml --trials 3 --set analysis.seed={}",
    "tolerance small.toml errors.toml --trials 3 --merit motion_px={}",
    "uncertainty {}",
    "measure paper-spherical 700 500 500 {}",
    "measure paper-spherical 700 500 500 700 --wall-mm {}",
    "uncertainty paper-spherical --height-mm {}",
    "convert {} -o out.toml",
    "convert calib_results.txt -o {}",
    "convert calib_results.txt -o out.yaml --to {}",
    "convert calib_results.txt -o out.yaml --to kalibr-omni --tolerance-px {}",
    "convert paper-spherical -o out.yaml --to kalibr-ds --tolerance-px 9 --set fit.distance_mm={}",
    "convert calib_results.txt -o out.yaml --to ros-plumb-bob --tolerance-px 9 --set fit.field_deg={}",
    "convert calib_results.txt -o out.toml --camera {}",
    "convert calib_results.txt -o out.toml --set camera.rim_radius_px={}",
    "convert calib_results.txt -o out.toml --set camera.image_size={}",
)


ANGLES = np.linspace(0, 50, 200)
"""Radians: a spiral of points about the vertex of the paper's spherical mirror."""
POINTS = np.column_stack(
    [ANGLES * np.cos(ANGLES) / 2, ANGLES * np.sin(ANGLES) / 2, 50 - np.sqrt(2500 - ANGLES**2 / 4)]
)
CLOUDS = {
    "on a slanted line": POINTS[:, :1] * [1.0, 2.0, 3.0],
    "all one": np.tile(POINTS[50], (300, 1)),
    "two": np.repeat(POINTS[[20, 150]], 150, axis=0),
    "three": np.repeat(POINTS[[20, 90, 150]], 100, axis=0),
    "nearly flat": POINTS * [1.0, 1.0, 1e-300],
    "huge": POINTS * 1e300,
    "huge in height": POINTS * [1.0, 1.0, 1e307],
    "huge in one point": np.vstack([POINTS, [1e308, -1e308, 1e308]]),
    "tiny": POINTS * 1e-300,
    "far away": POINTS + 1e18,
    "none": POINTS[:0],
    "one": POINTS[:1],
}


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    from omnimirror.io import write_image

    monkeypatch.chdir(tmp_path)
    write_image("a.png", np.zeros((32, 32, 3), np.uint8))
    write_image("b.png", np.zeros((64, 64, 3), np.uint8))
    Path("loop").symlink_to("loop")
    om.convert(
        om.OCam(polynomial=(-131.5, 0.0, 1.8e-3), centre_px=(515.3, 380.3), image_size=(1024, 768)),
        "calib_results.txt",
    )
    for name, form in {
        "parts": PARTS,
        "small": SENSOR,
        "requirements": CHECKS,
        "errors": ERRORS,
    }.items():
        Path(f"{name}.toml").write_text(
            form.format(**dict(zip("abcd", USUAL[form], strict=True)), e="")
        )
    Path("edges.csv").write_text(
        "line,u_px,v_px\n" + "".join(f"1,{400 + 9 * i},{300 + i}\n" for i in range(9))
    )
    np.savetxt("points.csv", POINTS, delimiter=",")


def answer(arguments: list[str], capsysbinary: pytest.CaptureFixture[bytes]) -> int:
    """Run a command in this process and check that errors are one line and leave no partial output.

    Return its exit code.
    """
    before = {path.name for path in Path().iterdir()}
    code = 0
    try:
        main(arguments)
    except SystemExit as e:
        code = int(e.code or 0)
    stderr = capsysbinary.readouterr().err.decode("utf-8", "replace")  # the output can be an image
    assert code != 70, stderr  # internal error
    assert "Traceback" not in stderr
    if code not in (0, 3):  # 3: violated requirements, reported as a table
        lines = stderr.splitlines()
        if len(arguments) > 1:  # a group without a command prints its help
            assert len(lines) == 1, stderr
            assert lines[0].startswith("omnimirror: ")
        assert len(stderr) < 3000
    new = {path.name for path in Path().iterdir()} - before
    assert not [name for name in new if ".omnimirror-" in name]
    return code


@pytest.mark.parametrize("command", FILES)
def test_unusual_values_in_files(command, capsysbinary):
    form = FILES[command]
    usual = USUAL[form]
    Path("file.toml").write_text(form.format(**dict(zip("abcd", usual, strict=True)), e=""))
    assert answer(command.format("file.toml").split(), capsysbinary) in (0, 3)
    for i, value in enumerate(ODD_VALUES):
        entries = dict(zip("abcd", usual, strict=True)) | {"abcd"[i % 4]: value}
        Path("file.toml").write_text(form.format(**entries, e=""))
        answer(command.format("file.toml").split(), capsysbinary)
    for line in ODD_LINES:
        text = form.format(**dict(zip("abcd", usual, strict=True)), e=line)
        Path("file.toml").write_bytes(text.encode("utf-8", "surrogateescape"))
        answer(command.format("file.toml").split(), capsysbinary)


@pytest.mark.parametrize("sensor", few(om.bundled_sensors(), "paper-hyperboloidal"))
def test_extreme_numbers_in_every_entry(sensor, capsysbinary):
    text = (SENSOR_FOLDER / f"{sensor}.toml").read_text()
    numbers = [
        n
        for n in NUMBER.finditer(text)
        if "=" in text[text.rfind("\n", 0, n.start()) + 1 : n.start()]
    ]
    assert len(numbers) > 8
    for number in numbers[1:]:  # the first is that of the format
        for value in EXTREMES:
            Path("file.toml").write_text(text[: number.start()] + value + text[number.end() :])
            for command in (
                "evaluate file.toml --omega-deg 0:60:30",
                "rays file.toml -o rays.npz --step 99",
            ):
                answer(command.split(), capsysbinary)


@pytest.mark.parametrize("command", COMMANDS)
def test_unusual_command_line_arguments(command, capsysbinary):
    first = COMMANDS.index(command)
    for k in range(4):  # some of the values for each command, others for the next
        word = INVALID_ARGUMENTS[(first + 7 * k) % len(INVALID_ARGUMENTS)]
        answer([part.replace("{}", word) for part in command.split()], capsysbinary)


DEPARTURES = "--set points.are_departures=true"


@pytest.mark.parametrize("cloud", CLOUDS)
@pytest.mark.parametrize(
    "option", few(["", DEPARTURES, "--set fit.order=4", "--unit inch"], "", DEPARTURES)
)
def test_points_without_mirror_shape(cloud, option, capsysbinary):
    np.savetxt("cloud.csv", CLOUDS[cloud], delimiter=",")
    is_perfect = (cloud, option) == ("nearly flat", DEPARTURES)  # no departures at all
    code = answer(["form", "paper-spherical", "cloud.csv", *option.split()], capsysbinary)
    assert code in ((0,) if is_perfect else (1, 2))


@pytest.mark.full
@pytest.mark.parametrize("command", COMMANDS)
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    word=st.one_of(
        st.sampled_from(INVALID_ARGUMENTS),
        st.text(st.characters(exclude_characters="\0/"), max_size=12),
    )
)
def test_arbitrary_command_line_arguments(command, word, capsysbinary):
    answer([part.replace("{}", word) for part in command.split()], capsysbinary)


def test_invalid_files_of_other_commands(capsysbinary):
    """Coincident points, nested brackets, and an empty name."""
    Path("one.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n" + "1,1,1,1,1\n" * 9)
    Path("deep.json").write_text('{"a":' * 3000)
    for command in (
        "calibrate --points one.csv --image-size 64x64 --model unified",
        "rim {}",
        "export paper-spherical --tolerances deep.json -o a.pdf",
    ):
        assert answer([word.replace("{}", "") for word in command.split()], capsysbinary) in (1, 2)


@pytest.mark.parametrize("encoding", few(["ascii", "latin-1"], "ascii"))
def test_terminals_with_limited_encoding(encoding):
    run = subprocess.run(
        [sys.executable, "-m", "omnimirror", "evaluate", "paper-spherical", "--omega-deg", "0"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )
    assert run.returncode == 0
    assert run.stderr == b""
    assert b"deg" in run.stdout


def test_closed_streams():
    command = f"{sys.executable} -m omnimirror sensors"
    run = subprocess.run(f"{command} >&-", shell=True, capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stderr == "omnimirror: standard output: closed\n"
    assert subprocess.run(f"{command} 2>&- >/dev/null", shell=True).returncode == 0


def test_traceback_is_printed_on_request(capsys):
    with pytest.raises(SystemExit, match=r"^1$"):
        main(["evaluate", "nope", "--debug"])
    stderr = capsys.readouterr().err
    assert "Traceback" in stderr
    assert stderr.splitlines()[-1].startswith(
        "omnimirror: sensor file, camera file or bundled sensor 'nope'"
    )


def test_numbers_are_parsed_consistently():
    """Number types of click would accept 1_000 and digits of other scripts."""
    import click

    from omnimirror.apps.cli import COMMANDS as NAMES
    from omnimirror.apps.cli import app

    context = app.make_context("omnimirror", ["evaluate"])
    for name in NAMES:
        for parameter in app.get_command(context, name).params:
            assert type(parameter.type) not in (
                type(click.FLOAT),
                type(click.INT),
                click.IntRange,
                click.FloatRange,
            )
