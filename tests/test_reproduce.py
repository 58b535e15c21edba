"""The numbers of the paper get the verdicts that are known to be right."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest

from omnimirror.errors import InvalidParameter
from omnimirror.reproduce import ALL_FIGURES, all_claims, check, draw_figures, reproduce
from omnimirror.reproduce.claims import AGREES
from omnimirror.reproduce.tables import HEADINGS, number

ERRATA = Path(__file__).parents[1] / "docs" / "errata.md"


@pytest.fixture(scope="module")
def rows():
    return check()


def test_every_verdict_is_the_expected_one(rows):
    assert [f"{r.title}: {r.verdict}, computed {r.computed}" for r in rows if not r.as_expected] == []


def test_there_are_many_numbers_and_all_errata(rows):
    assert len(rows) >= 40
    assert {r.claim.erratum for r in rows} - {None} == set(range(1, 19))
    assert sum(r.verdict == AGREES for r in rows) >= 30


def test_the_printed_numbers_of_errata_do_not_hold(rows):
    for r in rows:
        if r.claim.erratum is not None:
            assert r.claim.corrected is not None
            assert r.claim.verdict(r.claim.corrected) == r.claim.expected, r.title


def test_every_row_says_where_and_how(rows):
    for r in rows:
        assert re.search(r"Table|Sec|Fig|Eq", r.claim.place)
        assert r.claim.formula
        assert r.claim.quantity


@pytest.mark.parametrize("claim", all_claims(), ids=lambda c: c.quantity)
def test_a_wrong_number_loses_its_verdict(claim):
    """A program that computed something clearly different would be noticed in every row."""
    wrong = {"<=": 10.0, ">=": -10.0, "=": claim.printed + 3 * claim.tolerance + 1e-3}[claim.relation]
    assert claim.verdict(wrong) != claim.expected


def test_numbers_that_are_not_numbers_agree_with_nothing():
    assert {replace(c, relation="=").verdict(float("nan")) for c in all_claims()} == {"not reproduced"}


def test_files_hold_every_row(rows, tmp_path):
    result = reproduce(tmp_path, figures=False)
    assert [f.name for f in result.files] == ["numbers.csv", "numbers.md"]
    with (tmp_path / "numbers.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == HEADINGS
    assert [t["verdict"] for t in table] == [r.verdict for r in rows]
    assert [float(t["computed"]) for t in table] == pytest.approx([r.computed for r in rows], rel=1e-11, abs=1e-12)
    text = (tmp_path / "numbers.md").read_text(encoding="utf-8")
    assert len(re.findall(r"^\| \d", text, flags=re.M)) == len(rows)
    for line in text.splitlines():
        if line.startswith("| "):
            assert len(re.findall(r"(?<!\\)\|", line)) == 11


def test_the_list_of_errata_quotes_these_numbers(rows):
    entries = dict(re.findall(r"^\| (\d+) \| (.*)$", ERRATA.read_text(encoding="utf-8"), flags=re.M))
    assert set(entries) == {str(n) for n in range(1, 19)}
    for r in rows:
        if r.claim.erratum is not None:
            assert number(r.computed, 4) in entries[str(r.claim.erratum)], r.title
    agree = sum(r.verdict == AGREES for r in rows)
    assert f"{len(rows)} rows of which {agree} agree" in " ".join(ERRATA.read_text(encoding="utf-8").split())


def test_figures_are_drawn_the_papers_way(tmp_path):
    seen = []
    files = draw_figures(tmp_path, ["fig5", "fig5"], formats=["svg"], progress=seen.append)
    assert [f.name for f in files] == ["fig5.svg"]
    assert seen == ["fig5"]
    assert ">SPH<" in files[0].read_text(encoding="utf-8")


def test_figure_17_is_taken_and_straightened(tmp_path):
    (file,) = draw_figures(tmp_path, ["fig17"], formats=["png"])
    assert file.stat().st_size > 300_000


def test_an_unknown_figure_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InvalidParameter, match=r"fig99.*fig17"):
        reproduce(tmp_path / "out", only=["fig99"])
    assert not (tmp_path / "out").exists()
    assert len(ALL_FIGURES) == 12
