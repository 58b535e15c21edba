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
    group: click.Group = app, words: tuple[str, ...] = ()
) -> Iterator[tuple[str, click.Command]]:
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        if isinstance(command, click.Group):
            yield from commands(command, (*words, name))
        else:
            yield " ".join((*words, name)), command


COMMANDS = dict(commands())


@pytest.mark.parametrize("words", COMMANDS)
def test_commands_have_page_and_example(words):
    command = COMMANDS[words]
    assert isinstance(command, DocumentedCommand)
    assert (DOCS / f"{command.page}.md").exists()
    page = (DOCS / f"{command.page}.md").read_text(encoding="utf-8")
    assert f"omnimirror {words}" in page or f"omnimirror {words.replace(' image', '')}" in page
    shown = command.get_help(click.Context(command, info_name=words))
    assert f"More: docs/{command.page}.md" in shown
    assert command.examples
    for example in command.examples:
        assert f"  {example}\n" in shown  # on one line, for copying


@pytest.mark.parametrize("example", [e for c in COMMANDS.values() for e in c.examples])
def test_examples_parse(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    understand(example)


def understand(line: str) -> None:
    """Reject command lines with unknown options or values of a wrong type, without running them."""
    first, name, *words = shlex.split(line)
    assert first == "omnimirror"
    if name in ("simulate", "bracket", "tolerance") and f"{name} {words[0]}" in COMMANDS:
        name = f"{name} {words.pop(0)}"
    command = COMMANDS["simulate image" if name == "simulate" else name]
    command.make_context("command", words)


SHOWN = {
    f"{page.name}: {line}": line
    for page in [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]
    for line in re.findall(r"^    (omnimirror .*)$", page.read_text(encoding="utf-8"), flags=re.M)
}
"""Commands of the documentation that are displayed only: they require cameras, videos, or half an
hour."""


@pytest.mark.parametrize("line", SHOWN.values(), ids=SHOWN)
def test_displayed_commands_parse(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    understand(re.split(r" [|>] ", line)[0])


def test_options_are_grouped_once():
    shown = COMMANDS["dewarp"].get_help(click.Context(COMMANDS["dewarp"], info_name="dewarp"))
    headings = [
        line for line in shown.splitlines() if line.endswith(":") and not line.startswith(" ")
    ]
    assert headings[0] == "Options:"
    assert len(headings) >= 7
    camera = shown.split("Camera model:")[1].split("\n\n")[0]
    assert "--ocam" in camera
    assert "--crf" not in camera
    flags = [line.split()[0].rstrip(",") for line in shown.splitlines() if line.startswith("  -")]
    assert (
        len(flags)
        == len(set(flags))
        == len(COMMANDS["dewarp"].get_params(click.Context(COMMANDS["dewarp"]))) - 1
    )


LONG = {"dewarp", "maps", "serve", "view"}
"""Commands whose help does not fit on one screen yet."""


@pytest.mark.parametrize("words", sorted(COMMANDS.keys() - LONG))
def test_help_fits_on_one_screen(words):
    context = click.Context(COMMANDS[words], info_name=words, terminal_width=100)
    assert len(COMMANDS[words].get_help(context).splitlines()) <= 45


TABLES = {"check", "sensors", "apertures", "bracket plan", "simulate roundtrip"}
"""Commands that write nothing but the printed table."""
SERVERS = {"studio", "view", "serve"}


def test_outputs_have_the_same_option():
    for words, command in COMMANDS.items():
        outputs = [p for p in command.params if {"-o", "--output"} & set(p.opts)]
        assert [p.opts for p in outputs] == [["-o", "--output"]] * (
            words not in TABLES | SERVERS
        ), words
        arguments = [p for p in command.params if isinstance(p, click.Argument)]
        assert not any(isinstance(p.type, Output) for p in arguments), words


@pytest.mark.parametrize(
    ("words", "message"),
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
        (
            ["mtf", "paper-spherical", "--set", "mtf.cycles_per_px=0:1"],
            "must be START:STOP:STEP, such as 0:135:5; got '0:1'",
        ),
        (
            ["evaluate", "paper-spherical", "--set", "focus.merit=beauty"],
            "'beauty' is not one of",
        ),
        (
            ["apertures", "paper-spherical", "--set", "blur.mode=rough"],
            "blur.mode must be one of exact, paper",
        ),
    ],
)
def test_invalid_entries_print_one_line(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(words)
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
