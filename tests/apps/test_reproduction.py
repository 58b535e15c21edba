"""Verdicts of the statements of the paper."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from omnimirror.apps.reproduction import (
    ALL_FIGURES,
    _claims,
    all_claims,
    check,
    draw_figures,
    reproduce_paper,
)
from omnimirror.apps.reproduction._claims import (
    AS_INTERPRETED,
    ASSUMED,
    DIFFERS,
    HEADINGS,
    NOT_REPRODUCED,
    WORDINGS,
    number,
    printed_number,
    summary,
)
from omnimirror.apps.reproduction._paper_sensors import Paper
from omnimirror.base.errors import InvalidParameter

ERRATA = Path(__file__).parents[2] / "docs" / "errata.md"


@pytest.fixture(scope="module")
def rows():
    return check()


def test_all_verdicts_are_expected(rows):
    assert [
        f"{r.title}: {r.verdict}, computed {r.computed}" for r in rows if not r.as_expected
    ] == []


def test_correct_statements_are_not_errata(rows):
    """Erratum numbers are stable: 4, 6, 10, 14 to 16, 18 and 20 are remarks without a row."""
    errata = {r.claim.erratum for r in rows if r.verdict.startswith("erratum")}
    assert errata == {1, 2, 3, 5, 7, 8, 9, 11, 12, 13, 17, 19}
    assert [r.claim.quantity for r in rows if r.verdict == NOT_REPRODUCED] == [
        "E-DI: best L0",
        "SVP: best L0",
    ]
    assert [r.claim.quantity for r in rows if r.verdict == ASSUMED] == [
        "SVP: L0 that focuses the peripheral area",
        "hyperboloidal prototype: largest field angle at 60 mm diameter",
    ]


@pytest.mark.parametrize(
    ("text", "value", "tolerance"),
    [
        ("13.7", 13.7, 0.05),
        ("3.550", 3.55, 5e-4),
        ("6412", 6412, 0.5),
        ("180", 180, 5),
        ("-0.01", -0.01, 5e-3),
    ],
)
def test_tolerance_is_half_a_unit_of_the_last_digit(text, value, tolerance):
    assert printed_number(text) == pytest.approx((value, tolerance), rel=1e-12)


@pytest.mark.parametrize(
    ("claim", "agreeing_values", "differing_values"),
    [
        (_claims.Claim("", "", "", float, "1", 1.0), [1.0], [1.0 + 1e-9, 1.0 - 1e-9, np.inf]),
        (
            _claims.printed("", "", "", "13.7", float),
            [13.65, 13.7, 13.75],
            [13.6499, 13.7501, -13.7],
        ),
        (_claims.worded("", "", "", "constant", 2.0, float), [1.95, 2.05], [1.949, 2.051]),
        (_claims.worded("", "", "", "proportional", 200.0, float), [195.0, 205.0], [194.9, 205.1]),
        (_claims.worded("", "", "", "almost", 10.0, float), [8.5, 11.5], [8.49, 11.51]),
        (_claims.ordered("", "", "", "<=", 3.0, float), [3.0, 2.0, -9.0], [3.0 + 1e-9]),
        (_claims.ordered("", "", "", ">=", 3.0, float), [3.0, 9.0], [3.0 - 1e-9, -3.0]),
        (
            _claims.Claim("", "", "", float, "", 3.0, 0.5, "".join(["<", "="])),
            [3.5, 2.0],
            [3.51, 4.0],
        ),
        (
            _claims.Claim("", "", "", float, "", 3.0, 0.5, "".join([">", "="])),
            [2.5, 4.0],
            [2.49, 2.0],
        ),
        (_claims.identity("", "", "", float), [1.0, 1 + 9e-10], [1 + 2e-9, 0.0]),
        (_claims.zero("", "", "", float), [0.0, -9e-10], [2e-9, -2e-9]),
        (
            _claims.formula("", "", "", -50.0, float),
            [-50.0, -50.0049, -49.9951],
            [-50.0051, -49.9949, 50.0],
        ),
        (_claims.unprinted("", "", "", "2.5", float), [2.45, 2.55], [2.449, 2.551]),
    ],
)
def test_tolerance_of_each_kind_of_statement(claim, agreeing_values, differing_values):
    assert [claim.verdict(value) for value in agreeing_values] == [claim.expected] * len(
        agreeing_values
    )
    assert [claim.verdict(value) for value in differing_values] == [DIFFERS] * len(differing_values)


def test_wordings_state_their_tolerance():
    for word, (share, explanation) in WORDINGS.items():
        assert f"'{word}'" in explanation
        assert f" {100 * share:g} % of" in explanation


def test_common_tolerance_rule(rows):
    for r in rows:
        c = r.claim
        if c.relation != "=":
            assert c.tolerance == 0, r.title
        elif c.interpretation:
            assert (c.tolerance / c.target, c.interpretation) in WORDINGS.values(), r.title
        elif re.fullmatch(r"-?[\d.]+", c.statement) and c.statement != "0":
            assert (c.target, c.tolerance) == printed_number(c.statement), r.title
        elif c.target is not None:
            assert c.tolerance <= 1e-4 * max(abs(c.target), 1e-5), r.title


def test_correct_values_refute_the_printed_ones(rows):
    for r in rows:
        if r.claim.correct is not None:
            assert r.claim.verdict(float(r.claim.correct)) == r.claim.expected, r.title


def test_rows_have_place_quantity_and_method(rows):
    for r in rows:
        assert re.search(r"Table|Sec|Fig|Eq", r.claim.place)
        assert r.claim.method
        assert r.claim.quantity


@pytest.mark.parametrize("claim", all_claims(), ids=lambda c: c.quantity)
def test_wrong_value_changes_verdict(claim):
    value = claim.target if claim.target is not None else float(claim.correct)
    wrong_value = {"<=": value + 10.0, ">=": value - 10.0, "=": value + 3 * claim.tolerance + 0.02}[
        claim.relation
    ]
    if claim.correct is not None and claim.relation == "=":
        wrong_value = max(value, float(claim.correct)) + 3 * claim.tolerance + 0.02
    assert claim.verdict(wrong_value) != claim.expected


def test_nan_differs():
    assert {replace(c, relation="=").verdict(float("nan")) for c in all_claims()} == {DIFFERS}


def test_viewpoint_error_by_exhaustive_search():
    """Largest |eps| of Eq. 23 at 7 M, minimised over V0 on a fine grid with the analytic sag."""
    A, m = 1.1378931, 4.1096948  # sphere of Table 1 in closed form
    x = np.linspace(1e-6, 1.0, 2001)
    beta, theta = np.arcsin(x / A), np.arctan2(x, m + A - np.sqrt(A**2 - x**2))
    omega, z = 2 * beta + theta, A - np.sqrt(A**2 - x**2)
    offset = np.linspace(0.0, 0.3, 3001)[:, None] - (z + x / np.tan(omega))
    error = np.arctan2(offset * np.sin(omega), 7 + x / np.sin(omega) + offset * np.cos(omega))
    expected = np.degrees(np.abs(error).max(axis=1).min())
    assert Paper().viewpoint_error_deg(7, "SPH") == pytest.approx(expected, rel=2e-3)
    assert expected == pytest.approx(2.346, abs=2e-3)


def test_files_contain_all_rows(rows, tmp_path):
    result = reproduce_paper(tmp_path, figures=False)
    assert [f.name for f in result.files] == ["numbers.csv", "numbers.md"]
    with (tmp_path / "numbers.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == HEADINGS
    assert [t["verdict"] for t in table] == [r.verdict for r in rows]
    assert [float(t["computed"]) for t in table] == pytest.approx(
        [r.computed for r in rows], rel=1e-11, abs=1e-12
    )
    assert all(t["interpretation"] for t in table if t["verdict"] == AS_INTERPRETED)
    text = (tmp_path / "numbers.md").read_text(encoding="utf-8")
    assert len(re.findall(r"^\| \d", text, flags=re.M)) == len(rows)
    for line in text.splitlines():
        if line.startswith("| "):
            assert len(re.findall(r"(?<!\\)\|", line)) == 11


def test_rows_as_csv_markdown_and_terminal_table(tmp_path):
    """Numbers with 12 and 6 digits; unexpected verdicts are emphasised."""
    claims = [
        _claims.formula("Sec. 1", "a|b", "m", 20 / 3, float, "mm", note="n"),
        _claims.worded("Fig. 2", "c", "m", "almost", 9.0, float, note="o"),
        _claims.printed("Eq. 3", "d", "m", "3", float, erratum=9, correct="5"),
        _claims.unprinted("Eq. 4", "e", "m", "2.5", float),
        _claims.printed("Eq. 5", "f", "m", "3", float, correct="5"),
    ]
    computed, exact = (20 / 3 + 1e-5, 20.0, 5.0, 2.5, 4.0), (2 / 3, None, None, None, None)
    rows = [
        _claims.CheckedClaim(k, claim, value, precise, claim.verdict(value))
        for k, (claim, value, precise) in enumerate(
            zip(claims, computed, exact, strict=True), start=1
        )
    ]
    assert [r.as_expected for r in rows] == [True, False, True, True, False]
    explanation = WORDINGS["almost"][1]
    _claims.write_csv(rows, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8") as file:
        table = list(csv.reader(file))
    assert table[1:] == [
        ["1", "Sec. 1", "a|b", "6.66667 (printed formula)", "6.66667666667", "0.666666666667", "mm",
         "0.000666666666667", "", "agrees", "agrees", "m", "", "n"],
        ["2", "Fig. 2", "c", "9 (almost)", "20", "", "", "1.35", "", "differs",
         "agrees as interpreted", "m", explanation, "o"],
        ["3", "Eq. 3", "d", "3", "5", "", "", "0.5", "5", "erratum 9", "erratum 9", "m", "", ""],
        ["4", "Eq. 4", "e", "", "2.5", "", "", "0", "2.5", "computed", "computed", "m", "", ""],
        ["5", "Eq. 5", "f", "3", "4", "", "", "0.5", "5", "differs", "not reproduced", "m", "", ""],
    ]  # fmt: skip
    _claims.write_markdown(rows, tmp_path / "a.md")
    lines = (tmp_path / "a.md").read_text(encoding="utf-8").splitlines()
    assert lines[-5:] == [
        r"| 1 | Sec. 1 | a\|b | 6.66667 (printed formula) ± 0.000666667 | 6.66668 | 0.666667 | mm | agrees | m | n |",
        "| 2 | Fig. 2 | c | 9 (almost) ± 1.35 | 20 |  |  | **differs** (expected: agrees as interpreted) | m | "
        f"{explanation}; o |",
        "| 3 | Eq. 3 | d | 3 ± 0.5 | 5 |  |  | erratum 9 | m |  |",
        "| 4 | Eq. 4 | e |  | 2.5 |  |  | computed | m |  |",
        "| 5 | Eq. 5 | f | 3 ± 0.5 | 4 |  |  | **differs** (expected: not reproduced) | m |  |",
    ]
    screen = io.StringIO()
    terminal = {"force_terminal": True, "color_system": "standard", "no_color": False}
    console = Console(file=screen, width=120, **terminal)
    console.print(_claims.terminal_table(rows))
    green, yellow, grey, red = "\x1b[32m", "\x1b[33m", "\x1b[2m", "\x1b[1;31m"
    for start, verdict in zip(
        (green, red, yellow, grey, red),
        ("agrees", "differs", "erratum 9", "computed", "differs"),
        strict=True,
    ):
        assert f"{start}{verdict}" in screen.getvalue()
    text_lines = re.sub(r"\x1b\[[\d;]*m", "", screen.getvalue()).splitlines()
    assert [" ".join(line.split()) for line in text_lines] == [
        "Place Quantity Printed Computed Exact Unit Verdict",
        "1 Sec. 1 a|b 6.66667 (printed formula) 6.66668 0.666667 mm agrees",
        "2 Fig. 2 c 9 (almost) 20 differs",
        "3 Eq. 3 d 3 5 erratum 9",
        "4 Eq. 4 e 2.5 computed",
        "5 Eq. 5 f 3 4 differs",
    ]
    assert text_lines[1].startswith("1  Sec. 1  a|b  ")
    assert text_lines[2].startswith("2  Fig. 2  c  ")
    assert [number(value) for value in (9e-13, 1e-12, -2e-12)] == ["0", "1e-12", "-2e-12"]


def test_rows_are_numbered_from_1(rows):
    assert [r.number for r in rows] == list(range(1, len(rows) + 1))
    assert rows[0].title.startswith("1 (")


def test_errata_page_quotes_computed_values(rows):
    page = ERRATA.read_text(encoding="utf-8")
    entries = dict(re.findall(r"^\| (\d+) \| (.*)$", page, flags=re.M))
    assert set(entries) == {str(n) for n in range(1, 21)}
    for r in rows:
        if r.claim.erratum is not None:
            assert number(r.computed, 4) in entries[str(r.claim.erratum)], r.title
    assert summary(rows) in " ".join(page.split())


def test_figures_use_paper_approximations(tmp_path):
    calls = []
    files = draw_figures(
        tmp_path, ["fig5", "fig5"], formats=["svg"], on_progress=lambda *n: calls.append(n)
    )
    assert [f.name for f in files] == ["fig5.svg"]
    assert calls == [(1, 1)]
    assert ">SPH<" in files[0].read_text(encoding="utf-8")


@pytest.mark.full
def test_figure_17_is_rendered_and_dewarped(tmp_path):
    (file,) = draw_figures(tmp_path, ["fig17"], formats=["png"])
    assert file.stat().st_size > 300_000


def test_unknown_figure_raises_before_writing(tmp_path):
    with pytest.raises(InvalidParameter, match=r"fig17.*fig99"):
        reproduce_paper(tmp_path / "out", only=["fig99"])
    assert not (tmp_path / "out").exists()
    assert tuple(f"fig{n}" for n in range(1, 19)) == ALL_FIGURES


def test_diagrams_are_to_scale(tmp_path):
    """The rays of Fig. 2 by the law of reflection, and the blur of Fig. 18 by Eq. 28."""
    from omnimirror.analysis.figures import sensor_diagrams
    from omnimirror.apps.reproduction import paper_sensors

    sensor = paper_sensors()[0]
    for omega in (20.0, 100.0, 135.0):
        ray = sensor_diagrams.chief_ray(sensor, omega)
        to_lens = np.array([-ray.x, -sensor.meridian.m - ray.z])
        slope = float(sensor.mirror.slope(ray.x))
        normal = np.array([slope, -1.0]) / np.hypot(slope, 1.0)
        to_lens /= np.linalg.norm(to_lens)
        np.testing.assert_allclose(
            2 * (to_lens @ normal) * normal - to_lens, ray.towards, atol=1e-9
        )
    (file,) = draw_figures(tmp_path, ["fig18"], formats=["svg"])
    assert "image sensor" in file.read_text(encoding="utf-8")
    spot = next(
        line
        for line in sensor_diagrams.blur_geometry().axes[0].lines
        if line.get_linewidth() == 3.5
    )
    f, D, L0, L = 1.0, 1.1, 3.2, 6.0
    assert np.ptp(spot.get_ydata()) == pytest.approx(f * D * (L - L0) / ((L0 - f) * L))
