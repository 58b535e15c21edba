"""The command line given what nobody would give it: an answer, or one line and a code that is not 0."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnimirror.cli import main
from tests.everyday import few

SENSOR = (
    '[mirror]\nkind = "sphere"\nradius_mm = {a}\nrim_radius_mm = 44.0\n[lens]\nkind = "perspective"\n'
    "focal_length_mm = {b}\nf_number = 4.0\nfocus_distance_mm = 218.0\n"
    "[imager]\nwidth_px = {c}\nheight_px = 64\npixel_pitch_um = 83.2\n[mount]\nmirror_distance_mm = {d}\n{e}"
)
WANTED = (
    '[field]\nomega_max_deg = {a}\n[mirror]\nmapping = "equidistant"\nrim_radius_mm = {b}\n[lens]\n'
    "theta_max_deg = {c}\nf_number = {d}\n{e}"
)
PARTS = (
    '[[lens]]\nname = "l"\nfocal_length_mm = {a}\nf_number_min = {b}\nf_number_max = 16.0\nminimum_focus_mm = 100.0\n'
    '[[imager]]\nname = "i"\nwidth_px = {c}\nheight_px = 1000\npixel_pitch_um = {d}\n{e}'
)
FILES = {
    "evaluate {} --omega-deg 0:60:30": (SENSOR, ("50.0", "11.6", "64", "185.93")),
    "design {}": (WANTED, ("90.0", "40.0", "12.0", "4.0")),
    "parts paper-spherical {}": (PARTS, ("8.0", "1.4", "1000", "5.0")),
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
    "1e-308",
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
ODD_WORDS = (
    "",
    "-",
    "x",
    "1_000",
    "١٢٣",
    "inf",
    "nan",
    "-1",
    "1e308",
    "1e-308",
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
COMMANDS = (
    "evaluate paper-spherical --omega-deg {}",
    "evaluate {} --omega-deg 0",
    "evaluate paper-spherical --image-radius-px {}",
    "evaluate paper-spherical --omega-deg 0:60:30 --csv {}",
    "evaluate paper-spherical --omega-deg 0 --focus-mm {}",
    "evaluate paper-spherical --omega-deg 0 --wavelength-nm {}",
    "evaluate paper-spherical --pixel {}",
    "spots paper-spherical --omega-deg 30 --rings {}",
    "spots paper-spherical --omega-deg {}",
    "psf paper-spherical --kind geometric --omega-deg {}",
    "mtf paper-spherical --omega-deg 30 --kind {}",
    "illumination paper-spherical --omega-deg 30 --reflectivity {}",
    "illumination {} --omega-deg 30",
    "illumination paper-spherical --omega-deg 0:60:30 --csv {}",
    "compare paper-spherical {}",
    "bracket plan {}",
    "init {} --force",
    "design --like {}",
    "design --mapping {} --omega-max-deg 90",
    "parts paper-spherical {}",
    "parts {} parts.toml",
    "dewarp a.png --ball {} -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size {} -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size 32x16 --span-deg {} -o out.png",
    "dewarp {} --ball 16,16,12,300 -o out.png",
    "dewarp a.png --ball 16,16,12,300 --size 32x16 -o {}",
    "dewarp a.png --ocam {} -o out.png",
    "dewarp a.png --sensor {} -o out.png",
    "mappings --omega-max-deg {}",
    "export {} -o out.csv",
    "{}",
    "simulate {}",
    "lines a.png --rim {} 16 12",
    "lines a.png --camera {}",
    "lines {}",
    "uncertainty {}",
    "uncertainty paper-spherical --height-mm {}",
    "convert {} out.toml",
    "convert calib_results.txt {}",
    "convert calib_results.txt out.yaml --to {}",
    "convert calib_results.txt out.yaml --to kalibr-omni --tolerance-px {}",
    "convert paper-spherical out.yaml --to kalibr-ds --tolerance-px 9 --distance-mm {}",
    "convert calib_results.txt out.yaml --to ros-plumb-bob --tolerance-px 9 --field-deg {}",
    "convert calib_results.txt out.toml --camera {}",
    "convert calib_results.txt out.toml --rim-radius-px {}",
    "convert calib_results.txt out.toml --image-size {}",
)


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    import numpy as np

    from omnimirror.media import write_image

    monkeypatch.chdir(tmp_path)
    write_image("a.png", np.zeros((32, 32, 3), np.uint8))
    Path("loop").symlink_to("loop")
    Path("calib_results.txt").write_text("3 -131.5 0.0 1.8e-3\n1 200.0\n380.3 515.3\n1.0 0.0 0.0\n768 1024\n")
    Path("parts.toml").write_text(PARTS.format(a="8.0", b="1.4", c="1000", d="5.0", e=""))


def answer(words: list[str], capsysbinary: pytest.CaptureFixture[bytes]) -> int:
    """Run a command in this process; what it says of an error is one line, and nothing half done stays behind.

    Its exit code is returned.
    """
    before = {path.name for path in Path().iterdir()}
    code = 0
    try:
        main(words)
    except SystemExit as e:
        code = int(e.code or 0)
    said = capsysbinary.readouterr().err.decode("utf-8", "replace")  # what goes out may be a picture
    assert code != 70, said  # this should not have happened
    assert "Traceback" not in said
    if code:
        lines = said.splitlines()
        if len(words) > 1:  # a group alone shows its help
            assert len(lines) == 1, said
            assert lines[0].startswith("omnimirror: ")
        assert len(said) < 3000
    new = {path.name for path in Path().iterdir()} - before
    assert not [name for name in new if ".omnimirror-" in name]
    return code


@pytest.mark.parametrize("command", FILES)
def test_odd_values_in_files(command, capsysbinary):
    form, usual = FILES[command]
    for i, value in enumerate(ODD_VALUES):
        entries = dict(zip("abcd", usual, strict=True)) | {"abcd"[i % 4]: value}
        Path("file.toml").write_text(form.format(**entries, e=""))
        answer(command.format("file.toml").split(), capsysbinary)
    for line in ODD_LINES:
        text = form.format(**dict(zip("abcd", usual, strict=True)), e=line)
        Path("file.toml").write_bytes(text.encode("utf-8", "surrogateescape"))
        answer(command.format("file.toml").split(), capsysbinary)


@pytest.mark.parametrize("command", COMMANDS)
def test_odd_words(command, capsysbinary):
    first = COMMANDS.index(command)
    for k in range(4):  # some of the words for each command, others for the next
        word = ODD_WORDS[(first + 7 * k) % len(ODD_WORDS)]
        answer([part.replace("{}", word) for part in command.split()], capsysbinary)


@pytest.mark.full
@pytest.mark.parametrize("command", COMMANDS)
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(word=st.one_of(st.sampled_from(ODD_WORDS), st.text(st.characters(exclude_characters="\0/"), max_size=12)))
def test_any_words(command, word, capsysbinary):
    answer([part.replace("{}", word) for part in command.split()], capsysbinary)


def test_files_of_other_commands_that_are_none(capsysbinary):
    """Points that are all one, brackets within brackets, and no name at all."""
    Path("one.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n" + "1,1,1,1,1\n" * 9)
    Path("deep.json").write_text('{"a":' * 3000)
    for command in ("calibrate --points one.csv --image-size 64x64 --model unified", "rim {}",
                    "export paper-spherical --tolerances deep.json -o a.pdf"):  # fmt: skip
        assert answer([word.replace("{}", "") for word in command.split()], capsysbinary) in (1, 2)


@pytest.mark.parametrize("encoding", few(["ascii", "latin-1"], "ascii"))
def test_terminals_of_few_characters(encoding):
    run = subprocess.run(
        [sys.executable, "-m", "omnimirror", "evaluate", "paper-spherical", "--omega-deg", "0"],
        capture_output=True, env={**os.environ, "PYTHONIOENCODING": encoding},
    )  # fmt: skip
    assert run.returncode == 0
    assert run.stderr == b""
    assert b"deg" in run.stdout


def test_streams_that_are_closed():
    command = f"{sys.executable} -m omnimirror sensors"
    run = subprocess.run(f"{command} >&-", shell=True, capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stderr == "omnimirror: standard output: it is closed\n"
    assert subprocess.run(f"{command} 2>&- >/dev/null", shell=True).returncode == 0


def test_the_trace_is_shown_when_it_is_asked_for(capsys):
    with pytest.raises(SystemExit, match=r"^1$"):
        main(["evaluate", "nope", "--debug"])
    told = capsys.readouterr().err
    assert "Traceback" in told
    assert told.splitlines()[-1].startswith("omnimirror: there is no sensor file")


def test_numbers_are_read_in_one_way():
    """Options of click's own number types would take 1_000 and other scripts' digits."""
    import click

    from omnimirror.cli import COMMANDS as NAMES
    from omnimirror.cli import app

    context = app.make_context("omnimirror", ["evaluate"])
    for name in NAMES:
        for parameter in app.get_command(context, name).params:
            assert type(parameter.type) not in (type(click.FLOAT), type(click.INT), click.IntRange, click.FloatRange)
