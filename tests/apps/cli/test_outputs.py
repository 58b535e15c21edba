"""Outputs other than regular files: standard output, devices, pipes, links."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from omnimirror.apps.cli import COMMANDS, _output, app, main

ANGLES = ["--omega-deg", "0:90:45"]


def run(*args):
    return CliRunner().invoke(
        app, [str(a) for a in args], catch_exceptions=False, standalone_mode=False
    )


def test_table_on_standard_output(tmp_path):
    file_run = run("evaluate", "paper-spherical", *ANGLES, "--csv", tmp_path / "a.csv")
    pipe_run = run("evaluate", "paper-spherical", *ANGLES, "--csv", "-")
    assert pipe_run.stdout == (tmp_path / "a.csv").read_text()
    assert "best focus" in pipe_run.stderr  # messages are preserved
    assert "Wrote" not in pipe_run.stderr
    assert "Wrote" in file_run.stdout
    assert json.loads(run("evaluate", "paper-spherical", *ANGLES, "--json", "-").stdout)["columns"][
        "omega_deg"
    ] == [
        0,
        45,
        90,
    ]


def test_image_on_standard_output_equals_file(tmp_path):
    source = tmp_path / "round.png"
    cv2.imwrite(str(source), np.random.default_rng(1).integers(0, 256, (64, 64, 3), np.uint8))
    arguments = ["dewarp", source, "--ball", "31.5,31.5,30,300", "--size", "32x16"]
    run(*arguments, "-o", tmp_path / "out.tif")
    for kind, magic in ((None, b"\x89PNG"), ("tif", b"II*\0"), ("jpg", b"\xff\xd8\xff")):
        result = run(*arguments, "-o", f"{kind}:-" if kind else "-")
        assert result.stdout_bytes.startswith(magic)
        if kind != "jpg":
            image = cv2.imdecode(np.frombuffer(result.stdout_bytes, np.uint8), cv2.IMREAD_UNCHANGED)
            assert np.array_equal(
                image, cv2.imread(str(tmp_path / "out.tif"), cv2.IMREAD_UNCHANGED)
            )


def test_figure_on_standard_output():
    assert run("spots", "paper-spherical", *ANGLES, "-o", "-").stdout_bytes.startswith(b"\x89PNG")
    assert b"<svg" in run("spots", "paper-spherical", *ANGLES, "-o", "svg:-").stdout_bytes


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ["evaluate", "paper-spherical", "--csv", "-", "--json", "-"],
            "--csv and --json must not both be written",
        ),
        (
            ["spots", "paper-spherical", "-o", "gif:-"],
            "standard output must be -, png:-, svg:-, pdf:-; got gif:-",
        ),
        (
            ["evaluate", "paper-spherical", "--csv", "svg:-"],
            "standard output must be -; got svg:-",
        ),
        (["evaluate", "paper-spherical", "--csv", ""], "must not be empty"),
    ],
)
def test_invalid_standard_output_raises(args, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^2$"):
        main(args)
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_closed_pipe_is_no_error():
    command = [
        sys.executable,
        "-m",
        "omnimirror",
        "evaluate",
        "paper-spherical",
        "--omega-deg",
        "0:130:.01",
    ]
    for arguments in (command, [*command, "--csv", "-"]):
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout.readline()
            process.stdout.close()
            assert b"omnimirror: " not in process.stderr.read()
            assert process.wait() == 0


def test_output_options_support_standard_output():
    """Options that accept a file name accept ``-`` too, except for folders, sources and video
    paths."""
    from omnimirror.apps.cli._output import Output

    output_names = ("csv_file", "json_file", "output", "out", "figure", "panorama")

    def subcommands(command, name):
        for sub in getattr(command, "commands", {}).values():
            yield from subcommands(sub, f"{name} {sub.name}")
        yield name, command

    context = app.make_context("omnimirror", ["evaluate"])
    for name in COMMANDS:
        for path, command in subcommands(app.get_command(context, name), name):
            for parameter in command.params:
                is_folder = getattr(parameter.type, "file_okay", True) is False or path in (
                    "reproduce",
                    "demo",
                )
                if parameter.name in output_names and not is_folder and not parameter.is_flag:
                    assert isinstance(parameter.type, Output), f"{path} {parameter.opts}"


@pytest.mark.parametrize(
    ("command_line", "message"),
    [
        (
            "rim a.png -o ./a.png",
            "--output must not overwrite the input a.png; specify another file",
        ),
        (
            "evaluate s.toml --omega-deg 0 --csv link.toml",
            "--csv must not overwrite the input link.toml",
        ),
        ("convert s.toml -o s.toml", "--output must not overwrite the input s.toml"),
        (
            "evaluate s.toml --omega-deg 0 --csv x --json ./x",
            "--csv and --json must not both be written to x",
        ),
        (
            "evaluate s.toml --omega-deg 0 --csv x --json ./s.toml",
            "--json must not overwrite the input s.toml",
        ),
        (
            "evaluate s.toml --omega-deg 0 --csv /dev/null --json ./s.toml",
            "--json must not overwrite the input s.toml",
        ),
    ],
)
def test_outputs_must_not_overwrite_inputs_or_outputs(
    command_line, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.zeros((64, 64, 3), np.uint8))
    main(["init", "-o", "s.toml"])
    (tmp_path / "link.toml").symlink_to("s.toml")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(command_line.split())
    assert message in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_two_outputs_to_one_device():
    run("evaluate", "paper-spherical", *ANGLES, "--csv", "/dev/null", "--json", "/dev/null")


def test_messages_on_standard_error_and_text_on_standard_output(capsys):
    """Control sequences in names are escaped, brackets are not interpreted as styles, and numbers
    have no colours."""
    _output.print_notice("a [bold]b[/bold] \x1b[31m")
    _output.print_remark("c \x1b]0;d")
    _output.print_line("1 of 2 ", ("e.csv", "bold"))
    output = capsys.readouterr()
    assert output.err == "omnimirror: a [bold]b[/bold] \\x1b[31m\nc \\x1b]0;d\n"
    assert output.out == "1 of 2 e.csv\n"


class Screen(io.StringIO):
    """Terminal that records its output."""

    def isatty(self):
        return True


def terminal_as_standard_error(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "90")
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    return screen


def without_styles(screen):
    return re.sub(r"\x1b\[[\d;]*m", "", screen.getvalue())


ERASURE = "\x1b[1A\x1b[2K"
"""Erasure of the line of a progress bar at its end."""


def test_progress_bar_of_frames(monkeypatch):
    terminal = terminal_as_standard_error(monkeypatch)
    with _output.frame_rate_bar() as update:
        end = time.monotonic() + 60
        while "frames/s" not in terminal.getvalue() and time.monotonic() < end:
            time.sleep(0.02)
        assert re.search(r"0/\? 0 frames/s", without_styles(terminal))
        time.sleep(0.1)
        update(3, 10)
    assert re.search(r"Dewarping .* 3/10 \d+ frames/s", without_styles(terminal))
    assert terminal.getvalue().endswith(ERASURE)
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)
    with _output.frame_rate_bar() as update:
        update(10, 10)
    assert pipe.getvalue() == ""


def test_progress_bar_with_description(monkeypatch):
    terminal = terminal_as_standard_error(monkeypatch)
    bar = _output.progress_bar(Console(file=terminal))
    with bar:
        bar.add_task("[red]a[/red]", total=2, completed=1)
    assert "[red]a[/red] " in terminal.getvalue()
    assert terminal.getvalue().endswith(ERASURE)
    pipe = io.StringIO()
    with _output.progress_bar(Console(file=pipe)) as bar:
        bar.add_task("a", total=2)
    assert pipe.getvalue() == ""


def test_rows_are_those_of_a_plain_table():
    """Wider than the console, without wrapping; with ``--quiet``, nothing."""
    columns = [["1", "20", "3"], ["4.5", "-6.25", "7"]]
    streams = [io.StringIO() for _ in range(3)]
    narrow, quiet, wide = (
        Console(file=stream, width=width, quiet=is_quiet)
        for stream, width, is_quiet in zip(streams, (7, 80, 80), (False, True, False), strict=True)
    )
    table = _output.plain_table("a\nmm", "heading\ndeg", tight=True)
    for row in zip(*columns, strict=True):
        table.add_row(*row)
    wide.print(table)
    for console in (narrow, quiet):
        _output.print_rows(console, [("a", "mm"), ("heading", "deg")], columns)
    lines = streams[0].getvalue().splitlines()
    assert lines == [" a heading", "mm     deg", " 1     4.5", "20   -6.25", " 3       7"]
    assert [line.rstrip() for line in streams[2].getvalue().splitlines()] == lines
    assert streams[1].getvalue() == ""


def test_pipes_have_lines_of_200_characters(monkeypatch):
    """Tables wrap there; lines of text do not."""
    stream, second_stream = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    assert _output.output_console().width == 200
    _output.print_line("x" * 300)
    _output.print_line("y", console=Console(file=second_stream))
    _output.print_written(None, Path("-"), Path("a.csv"))
    assert stream.getvalue() == "x" * 300 + "\nWrote a.csv\n"
    assert second_stream.getvalue() == "y\n"


def test_terminal_output_has_only_own_styles(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setenv("TERM", "xterm")
    for name in ("NO_COLOR", "FORCE_COLOR", "COLUMNS"):
        monkeypatch.delenv(name, raising=False)
    _output.print_line("12.5 mm 'a' True ", ("e.csv", "bold"))
    _output.output_console().print("12.5 mm 'a' True [red]b[/red] :cat:", soft_wrap=True)
    assert screen.getvalue() == (
        "12.5 mm 'a' True \x1b[1me.csv\x1b[0m\n12.5 mm 'a' True [red]b[/red] :cat:\n"
    )


def test_device_among_several_outputs(tmp_path, monkeypatch):
    @click.command()
    @_output.output_option("--a", multiple=True)
    @_output.output_option("--b")
    def command(**_):
        pass

    monkeypatch.chdir(tmp_path)
    arguments = ["--a", "/dev/null", "--a", "f"]
    _output.check_output_files(command.make_context("x", [*arguments, "--b", "g"]))
    with pytest.raises(click.UsageError, match="--a and --b must not both be written to f"):
        _output.check_output_files(command.make_context("x", [*arguments, "--b", "./f"]))
    # in the order of the declarations
    command.params.reverse()
    with pytest.raises(click.UsageError, match="--b and --a must not both be written to f"):
        _output.check_output_files(command.make_context("x", [*arguments, "--b", "f"]))


def test_existing_outputs_are_overwritten_unless_they_are_inputs(tmp_path, monkeypatch):
    @click.command()
    @click.argument("sources", nargs=-1)
    @_output.output_option("-o", "--output")
    def command(**_):
        pass

    monkeypatch.chdir(tmp_path)
    for name in ("in", "out"):
        (tmp_path / name).write_text(name)
    _output.check_output_files(command.make_context("x", ["in", "text", "-o", "out"]))
    _output.check_output_files(command.make_context("x", ["in", "new", "-o", "new"]))
    with pytest.raises(click.UsageError, match="--output must not overwrite the input in; specify"):
        _output.check_output_files(command.make_context("x", ["text", "in", "-o", "in"]))


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("-", "-.bmp"),
        ("/dev/stdout", "/dev/stdout"),
        *((name, name) for name in ("+", ",", ".", "-a", "/dev/null", "/dev/stdouu", "/a", "/z")),
    ],
)
def test_names_of_standard_output(name, path):
    """The first format is that of ``-``; other names are files."""
    context = click.Context(click.Command("x"))
    option = click.Option(["-o", "--output"], type=_output.Output(("bmp", "png")))
    with context:
        assert str(option.type.convert(name, option, context)) == path
        assert _output.is_standard_output_used() == (name in ("-", "/dev/stdout"))
        assert _output.take_standard_output("".join(["--out", "put"]), "") == Path("-")
        for other in ("--a", "--z"):
            if _output.is_standard_output_used():
                with pytest.raises(
                    click.UsageError,
                    match=f"--output and {other} must not both be written to standard output",
                ):
                    _output.take_standard_output(other, "")


@pytest.mark.parametrize("kind", ["bmp", "png", "".join(["c", "sv"]), ""])
def test_terminals_display_no_images(kind, monkeypatch):
    monkeypatch.setattr(sys, "stdout", Screen())
    with click.Context(click.Command("x")):
        if kind in ("csv", ""):
            assert _output.take_standard_output("-o", kind) == Path(f"-.{kind}" if kind else "-")
        else:
            with pytest.raises(click.UsageError, match="an image cannot be written to a terminal"):
                _output.take_standard_output("-o", kind)


def test_table_wraps_text_but_not_numbers():
    """The text column uses the rest of 28 characters after the first column and the numbers."""
    table = _output.plain_table("name", "mm", "remark", text_columns=("name", "remark"))
    table.add_row("first part", "1234.5678", "as long as it may be")
    console = Console(file=io.StringIO(), width=28)
    console.print(table)
    lines = console.file.getvalue().splitlines()
    assert lines[0].index("mm") + 2 == lines[1].index("1234.5678") + 9  # numbers are right-aligned
    assert lines[0].index("rem") == lines[1].index("as")  # text is left-aligned
    assert lines[1].startswith("first part  1234.5678  as")
    assert " ".join(" ".join(line.split()) for line in lines[2:]) == "long as it may be"
