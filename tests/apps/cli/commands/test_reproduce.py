"""Command ``omnimirror reproduce``."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

import omnimirror.apps.reproduction as package
from omnimirror.apps.cli import main
from tests.commands import fails, omnimirror


def test_writes_table_and_figures(tmp_path):
    run = omnimirror("reproduce", "-o", "here", "--only", "fig6", "--only", "fig8", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert {p.name for p in (tmp_path / "here").iterdir()} == {
        "numbers.csv",
        "numbers.md",
        "fig6.svg",
        "fig6.png",
        "fig8.svg",
        "fig8.png",
    }
    assert "2 are not reproduced, 0 differ from the known result" in run.stdout
    assert "erratum 19" in run.stdout


def test_slides_have_larger_text_in_the_given_format(tmp_path):
    font_sizes_px = {}
    for style in ("paper", "slides"):
        arguments = ("--only", "fig5", "--format", "svg", "--style", style, "-o", style)
        run = omnimirror("reproduce", *arguments, cwd=tmp_path)
        assert run.returncode == 0, run.stderr
        files = {p.name for p in (tmp_path / style).iterdir()}
        assert files == {"numbers.csv", "numbers.md", "fig5.svg"}
        text = (tmp_path / style / "fig5.svg").read_text()
        font_sizes_px[style] = [float(px) for px in re.findall(r"font-size: ([\d.]+)px", text)]
    assert min(font_sizes_px["slides"]) > max(font_sizes_px["paper"])


def test_no_figures(tmp_path):
    run = omnimirror("reproduce", "--no-figures", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert {p.name for p in (tmp_path / "reproduced").iterdir()} == {"numbers.csv", "numbers.md"}


def test_unknown_figure_prints_one_line(tmp_path):
    assert "fig99" in fails("reproduce", "--only", "fig99", cwd=tmp_path)


def test_unexpected_verdict_exits_with_1(tmp_path, monkeypatch, capsys):
    claims = package.all_claims()
    i = next(i for i, c in enumerate(claims) if c.quantity == "whole sphere")
    claims[i] = replace(claims[i], compute=lambda paper: 41000.0)
    monkeypatch.setattr(package, "all_claims", lambda: claims)
    with pytest.raises(SystemExit, match=r"^1$"):
        main(["reproduce", "--no-figures", "-o", str(tmp_path)])
    message = capsys.readouterr().err.strip()
    assert len(message.splitlines()) == 1
    assert f"{i + 1} (Sec. 3.3: whole sphere)" in message
    assert "**differs** (expected: agrees)" in (tmp_path / "numbers.md").read_text(encoding="utf-8")
