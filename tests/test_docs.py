"""The examples in README and docs run as they stand."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from omnimirror.design import parse_requirements
from omnimirror.specs import parse_sensor
from tests.cli.test_evaluate import omnimirror

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.M | re.S)


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.name)
def test_python_examples_run_in_order(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), names)


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "console")], ids=lambda p: p.name)
def test_commands_run_in_order(page, tmp_path):
    for block in blocks(page, "toml"):  # a first line "# name.toml" says which file the commands find
        if file := re.match(r"# ([\w-]+\.toml)\n", block):
            (tmp_path / file[1]).write_text(block)
    commands = [line[2:] for block in blocks(page, "console") for line in block.splitlines() if line.startswith("$ ")]
    for command in commands:
        program, *args = shlex.split(command)
        assert program == "omnimirror"
        run = omnimirror(*args, cwd=tmp_path)
        assert run.returncode == 0, f"{command}\n{run.stderr}"


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "toml")], ids=lambda p: p.name)
def test_sensor_and_requirement_files_are_valid(page):
    for block in blocks(page, "toml"):
        if "[field]" in block:
            assert parse_requirements(block).field.omega_max_deg > 0
            continue
        assert parse_sensor(block).aligned().field_deg[1] > 0


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
