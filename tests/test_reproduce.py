"""The numbers of the paper get the verdicts that are known to be right."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from omnimirror.errors import InvalidParameter
from omnimirror.reproduce import ALL_FIGURES, all_claims, check, draw_figures, reproduce_paper
from omnimirror.reproduce.claims import AGREES, AS_READ, ASSUMED
from omnimirror.reproduce.tables import HEADINGS, number

ERRATA = Path(__file__).parents[1] / "docs" / "errata.md"


@pytest.fixture(scope="module")
def rows():
    return check()


def test_every_verdict_is_the_expected_one(rows):
    assert [f"{r.title}: {r.verdict}, computed {r.computed}" for r in rows if not r.as_expected] == []


def test_there_are_many_numbers_and_all_errata(rows):
    assert len(rows) >= 40
    assert {r.claim.erratum for r in rows} - {None} == set(range(1, 21))
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
    result = reproduce_paper(tmp_path, figures=False)
    assert [f.name for f in result.files] == ["numbers.csv", "numbers.md"]
    with (tmp_path / "numbers.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == HEADINGS
    assert [t["verdict"] for t in table] == [r.verdict for r in rows]
    assert [float(t["computed"]) for t in table] == pytest.approx([r.computed for r in rows], rel=1e-11, abs=1e-12)
    assert all(t["reading"] for t in table if t["verdict"] == AS_READ)
    text = (tmp_path / "numbers.md").read_text(encoding="utf-8")
    assert len(re.findall(r"^\| \d", text, flags=re.M)) == len(rows)
    for line in text.splitlines():
        if line.startswith("| "):
            assert len(re.findall(r"(?<!\\)\|", line)) == 11


def test_the_list_of_errata_quotes_these_numbers(rows):
    entries = dict(re.findall(r"^\| (\d+) \| (.*)$", ERRATA.read_text(encoding="utf-8"), flags=re.M))
    assert set(entries) == {str(n) for n in range(1, 21)}
    for r in rows:
        if r.claim.erratum is not None:
            assert number(r.computed, 4) in entries[str(r.claim.erratum)], r.title
    agree = sum(r.verdict == AGREES for r in rows)
    read = sum(r.verdict == AS_READ for r in rows)
    said = " ".join(ERRATA.read_text(encoding="utf-8").split())
    assert f"{len(rows)} rows of which {agree} agree with the paper, {read} agree as words" in said


def test_figures_are_drawn_the_papers_way(tmp_path):
    seen = []
    files = draw_figures(tmp_path, ["fig5", "fig5"], formats=["svg"], progress=seen.append)
    assert [f.name for f in files] == ["fig5.svg"]
    assert seen == ["fig5"]
    assert ">SPH<" in files[0].read_text(encoding="utf-8")


@pytest.mark.full
def test_figure_17_is_taken_and_straightened(tmp_path):
    (file,) = draw_figures(tmp_path, ["fig17"], formats=["png"])
    assert file.stat().st_size > 300_000


def test_an_unknown_figure_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InvalidParameter, match=r"fig99.*fig17"):
        reproduce_paper(tmp_path / "out", only=["fig99"])
    assert not (tmp_path / "out").exists()
    assert tuple(f"fig{n}" for n in range(1, 19)) == ALL_FIGURES


def test_wide_tolerances_say_how_words_are_read(rows):
    """Whatever may be off by more than half a unit of the last digit is not said simply to agree."""
    for r in rows:
        c = r.claim
        if r.verdict == AGREES and c.relation == "=" and c.printed and c.tolerance:
            digits = f"{c.printed:.12g}"
            unit = 10.0 ** -len(digits.partition(".")[2])
            assert c.tolerance <= unit, r.title
    assert [r.claim.quantity for r in rows if r.verdict == ASSUMED] == [
        "hyperboloidal prototype: largest viewing angle at 60 mm diameter"
    ]


def test_diagrams_are_drawn_to_scale(tmp_path):
    """The rays of Fig. 2 by the law of reflection, and the blur of Fig. 18 by Eq. 28."""
    from omnimirror.figures import diagrams
    from omnimirror.reproduce import paper_sensors

    sensor = paper_sensors()[0]
    for omega in (20.0, 100.0, 135.0):
        ray = diagrams.chief_ray(sensor, omega)
        to_lens = np.array([-ray.x, -sensor.meridian.m - ray.z])
        slope = float(sensor.mirror.slope(ray.x))
        normal = np.array([slope, -1.0]) / np.hypot(slope, 1.0)
        to_lens /= np.linalg.norm(to_lens)
        np.testing.assert_allclose(2 * (to_lens @ normal) * normal - to_lens, ray.towards, atol=1e-9)
    (file,) = draw_figures(tmp_path, ["fig18"], formats=["svg"])
    assert "image sensor" in file.read_text(encoding="utf-8")
    spot = next(line for line in diagrams.blur_geometry().axes[0].lines if line.get_linewidth() == 3.5)
    f, D, L0, L = 1.0, 1.1, 3.2, 6.0
    assert np.ptp(spot.get_ydata()) == pytest.approx(f * D * (L - L0) / ((L0 - f) * L))
