"""Help of every command: grouped options, valid examples, and existing documentation pages."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from omnimirror.apps.cli import app, main
from omnimirror.apps.cli._declarations import DocumentedCommand
from omnimirror.apps.cli._output import Output

DOCS = Path(__file__).parents[3] / "docs"


def commands(
    group: click.Group = app, parents: tuple[str, ...] = ()
) -> Iterator[tuple[str, click.Command]]:
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        if isinstance(command, click.Group):
            yield from commands(command, (*parents, name))
        else:
            yield " ".join((*parents, name)), command


COMMANDS = dict(commands())


@pytest.mark.parametrize("command_name", COMMANDS)
def test_commands_have_page_and_example(command_name):
    command = COMMANDS[command_name]
    assert isinstance(command, DocumentedCommand)
    assert (DOCS / f"{command.page}.md").exists()
    page = (DOCS / f"{command.page}.md").read_text(encoding="utf-8")
    assert (
        f"omnimirror {command_name}" in page
        or f"omnimirror {command_name.replace(' image', '')}" in page
    )
    help_text = command.get_help(click.Context(command, info_name=command_name))
    assert f"More: docs/{command.page}.md" in help_text
    assert command.examples
    for example in command.examples:
        assert f"  {example}\n" in help_text  # on one line, for copying


@pytest.mark.parametrize("example", [e for c in COMMANDS.values() for e in c.examples])
def test_examples_parse(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    parse_command_line(example)


def parse_command_line(line: str) -> None:
    """Reject command lines with unknown options or values of a wrong type, without running them."""
    first, name, *arguments = shlex.split(line)
    assert first == "omnimirror"
    if (
        name in ("simulate", "bracket", "tolerance", "batch")
        and f"{name} {arguments[0]}" in COMMANDS
    ):
        name = f"{name} {arguments.pop(0)}"
    command = COMMANDS["simulate image" if name == "simulate" else name]
    command.make_context("command", arguments)


DISPLAYED_COMMANDS = {
    f"{page.name}: {line}": line
    for page in [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]
    for line in re.findall(r"^    (omnimirror .*)$", page.read_text(encoding="utf-8"), flags=re.M)
}
"""Commands of the documentation that are displayed only: they require cameras, videos, or half an
hour."""


@pytest.mark.parametrize("line", DISPLAYED_COMMANDS.values(), ids=DISPLAYED_COMMANDS)
def test_displayed_commands_parse(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parse_command_line(re.split(r" [|>] ", line)[0])


def test_options_are_grouped_once():
    context = click.Context(COMMANDS["dewarp"], info_name="dewarp", terminal_width=100)
    help_text = COMMANDS["dewarp"].get_help(context)
    headings = [
        line for line in help_text.splitlines() if line.endswith(":") and not line.startswith(" ")
    ]
    assert headings == ["Options:", "Camera:", "View:", "Files:", "Examples:"]
    camera = help_text.split("Camera:")[1].split("\n\n")[0]
    assert "--ball" in camera
    assert "--preview" not in camera
    flags = [
        line.split()[0].rstrip(",") for line in help_text.splitlines() if line.startswith("  -")
    ]
    assert (
        len(flags)
        == len(set(flags))
        == len(COMMANDS["dewarp"].get_params(click.Context(COMMANDS["dewarp"]))) - 1
    )


@pytest.mark.parametrize("command_name", sorted(COMMANDS))
def test_help_fits_on_one_screen(command_name):
    context = click.Context(COMMANDS[command_name], info_name=command_name, terminal_width=100)
    assert len(COMMANDS[command_name].get_help(context).splitlines()) <= 45


TABLES = {"check", "sensors", "apertures", "bracket plan", "measure", "simulate roundtrip"}
"""Commands that write nothing but the printed table."""
JOBS = {"batch plan", "batch run", "batch status"}
"""Commands whose output is an entry of a file."""
SERVERS = {"studio", "view", "serve"}


def test_outputs_have_the_same_option():
    for command_name, command in COMMANDS.items():
        outputs = [p for p in command.params if {"-o", "--output"} & set(p.opts)]
        assert [p.opts for p in outputs] == [["-o", "--output"]] * (
            command_name not in TABLES | SERVERS | JOBS
        ), command_name
        arguments = [p for p in command.params if isinstance(p, click.Argument)]
        assert not any(isinstance(p.type, Output) for p in arguments), command_name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate", "paper-spherical", "--set", "lens"], "must be TABLE.KEY=VALUE"),
        (["evaluate", "paper-spherical", "--set", "lense.f_number=4"], "did you mean lens?"),
        (["evaluate", "paper-spherical", "--set", "lens.f_numbr=4"], "did you mean f_number?"),
        (["evaluate", "paper-spherical", "--set", "lens.f_number=wide"], "lens.f_number must be"),
        (
            ["export", "paper-spherical", "-o", "a.stl", "--set", "file.digit=1"],
            "did you mean file.digits?",
        ),
        (
            ["export", "paper-spherical", "-o", "a.stl", "--set", "file.digits=x"],
            "file.digits must be an integer",
        ),
        (["dewarp", "a.png", "--roll-deg", "3"], "Use --set view.roll_deg=VALUE"),
        (
            ["serve", "rtsp://a/1", "--stored-orientation"],
            "Use --set input.stored_orientation=VALUE",
        ),
        (["maps", "a.toml", "--view-deg", "3"], "No such option '--view-deg'. (Did"),
        (["dewarp", "a.png", "--set", "view.rol_deg=3"], "did you mean view.roll_deg?; use view."),
        (
            ["dewarp", "a.png", "--set", "view.pan_deg=3"],
            "view.pan_deg is an option; use --pan-deg",
        ),
        (["dewarp", "a.png", "--set", "door.pan_deg=3"], "unknown entry door.pan_deg"),
        (["dewarp", "a.png", "--set", "door=3"], "unknown entry door;"),
        (["dewarp", "a.png", "--set", "camera.level=5"], "camera.level must be PITCH,ROLL"),
        (["dewarp", "a.png", "--set", "view.zoom=inf"], "view.zoom must be a factor above 0"),
        (
            ["dewarp", "a.png", "--set", "camera.keep_tilt=1"],
            "camera.keep_tilt must be true or false",
        ),
        (["dewarp", "a.png", "--set", "view.pole=top"], "view.pole must be one of nadir, zenith"),
        (
            ["dewarp", "a.png", "--set", "resampling.threads=0"],
            "resampling.threads: 0 is not in the range 1<=x<=1024",
        ),
        (
            ["mtf", "paper-spherical", "--set", "mtf.cycles_per_px=0:1"],
            "mtf.cycles_per_px must be START:STOP:STEP",
        ),
        (
            ["evaluate", "paper-spherical", "--set", "focus.merit=beauty"],
            "focus.merit: 'beauty' is not one of",
        ),
        (
            ["apertures", "paper-spherical", "--set", "blur.mode=rough"],
            "blur.mode must be one of exact, paper",
        ),
    ],
)
def test_invalid_entries_print_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(arguments)
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
