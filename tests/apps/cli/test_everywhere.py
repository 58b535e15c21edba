"""Common behaviour of all commands: JSON output, verbosity, shell completion."""

from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

import omnimirror as om
from omnimirror.apps.cli import app, main
from tests.apps.cli.test_help_pages import COMMANDS
from tests.everyday import few

TABLES = {
    "sensors": [],
    "mappings": [],
    "spots": ["paper-spherical", "--omega-deg", "30,90"],
    "psf": ["paper-spherical", "--omega-deg", "30"],
    "mtf": ["paper-spherical", "--omega-deg", "30", "--set", "mtf.cycles_per_px=0.1,0.2"],
    "illumination": ["paper-spherical", "--omega-deg", "30"],
    "apertures": ["paper-spherical"],
    "parts": ["paper-spherical", "--feasible"],
    "bracket plan": ["paper-spherical"],
    "simulate roundtrip": ["paper-spherical", "--samples", "1"],
}
"""Commands whose only table is written by --json, with fast arguments."""
NUMBER = re.compile(r"^-?\d+(\.\d+)?$")


def run(*arguments):
    return CliRunner().invoke(
        app, [str(w) for w in arguments], catch_exceptions=False, standalone_mode=False
    )


@pytest.mark.parametrize("name", few(TABLES, *(TABLES.keys() - {"parts", "simulate roundtrip"})))
def test_json_has_one_record_per_table_row(name, tmp_path):
    """One record per line, with the first cell of each line."""
    file = tmp_path / "table.json"
    result = run(*name.split(), *TABLES[name], "--json", file)
    records = json.loads(file.read_text())
    if name == "mtf":  # the terminal shows a selection of columns
        assert [r["cycles_per_px"] for r in records] == [0.1, 0.2]
        return
    lines = [
        line for line in result.stdout.splitlines() if line.strip() and not line.startswith("Wrote")
    ][-len(records) :]
    for line, record in zip(lines, records, strict=True):
        first, value = line.split()[0], next(iter(record.values()))
        if name == "parts":
            assert record["lens"] in line
            assert record["imager"] in line
        elif NUMBER.match(first):
            assert float(first) == pytest.approx(value, rel=1e-3)
        else:
            assert first == value


def test_export_json_lists_written_files(tmp_path):
    run(
        "export",
        "paper-spherical",
        "-o",
        tmp_path / "x",
        "--formats",
        "csv",
        "--json",
        tmp_path / "x.json",
    )
    (record,) = json.loads((tmp_path / "x.json").read_text())
    assert os.path.exists(record["path"])
    assert record["deviation_um"] < 0.01


def test_table_commands_have_json_option():
    """Inspection of the source of each command; reproduce writes its numbers as CSV and Markdown."""
    without = {
        name
        for name, command in COMMANDS.items()
        if re.search(
            "plain_table\\(|print_(rows|verdict|design)\\(|_table\\(",
            inspect.getsource(command.callback),
        )
        and not any("--json" in p.opts for p in command.params)
    }
    assert without <= {"reproduce"}


def run_process(*arguments, **environment):
    """Run a separate process; return its output and messages."""
    program = [sys.executable, "-m", "omnimirror", *arguments]
    return subprocess.run(
        program, capture_output=True, text=True, env={**os.environ, **environment}
    )


def test_quiet_writes_files_without_messages(tmp_path, capsys):
    main(
        [
            "evaluate",
            "paper-spherical",
            "--omega-deg",
            "30",
            "--quiet",
            "--csv",
            str(tmp_path / "a.csv"),
        ]
    )
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "a.csv").read_text().startswith("omega_deg")
    with pytest.raises(SystemExit, match=r"^1$"):
        main(["evaluate", "nothing", "--quiet"])
    assert "nothing" in capsys.readouterr().err
    main(["dewarp", "--quiet", *image_arguments(tmp_path), "-o", str(tmp_path / "b.png")])
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "b.png").is_file()


def image_arguments(folder):
    om.write_image(folder / "ball.png", np.full((64, 64, 3), 90, np.uint8))
    return [str(folder / "ball.png"), "--ball", "31.5,31.5,30,300", "--size", "32x16"]


def test_quiet_json_on_standard_output(capsys):
    main(["sensors", "--quiet", "--json", "-"])
    out, err = capsys.readouterr()
    assert len(json.loads(out)) == len(om.bundled_sensors())
    assert not err


def test_verbose_prints_run_time(capsys):
    main(["sensors", "--verbose"])
    message = capsys.readouterr().err.strip()
    assert re.fullmatch(
        r"\d+\.\d\d s, \d+\.\d\d s of processor time; omnimirror .*, samplers: [\w-]+", message
    )


def test_words_after_double_dash_are_arguments(capsys):
    with pytest.raises(SystemExit, match=r"^1$"):
        main(["evaluate", "--", "--quiet"])
    assert "--quiet" in capsys.readouterr().err


def test_shell_completion():
    result = run_process(
        _OMNIMIRROR_COMPLETE="bash_complete",
        COMP_WORDS="omnimirror evaluate paper-s",
        COMP_CWORD="2",
    )
    assert result.stdout.splitlines() == ["plain,paper-spherical", "file,paper-s"]
    result = run_process(
        _OMNIMIRROR_COMPLETE="bash_complete", COMP_WORDS="omnimirror illu", COMP_CWORD="1"
    )
    assert result.stdout.splitlines() == ["plain,illumination"]
