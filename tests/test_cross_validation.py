"""Page of the comparisons with other programs, and the releases that are compared."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import program_releases
from tests.cross_validation import PROGRAMS, Comparison, page, parse_page

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "cross-validation.md"


def compared(version: str, *deviations: float, quantity: str = "points") -> list[Comparison]:
    return [Comparison("COLMAP", quantity, each, 0.5, "px", version) for each in deviations]


def test_page_lists_largest_deviation_and_number_of_cases():
    lines = page(compared("4.2.1", 0.1, 0.25, 0.2), "").splitlines()
    assert "| [COLMAP](#colmap) | 4.2.1 | 4.2.1 | 1 | 0.5 |" in lines
    assert "| quantity | 4.2.1 | tolerance |" in lines
    assert "| points | 0.25 px (3) | 0.5 px |" in lines


def test_page_keeps_the_oldest_and_the_newest_release():
    text = ""
    for version, deviation in (("4.9.1", 0.1), ("4.10.0", 0.2), ("4.1.0", 0.3), ("4.2.1", 0.4)):
        text = page(compared(version, deviation), text)
    assert "| points | 0.3 px (1) | 0.2 px (1) | 0.5 px |" in text.splitlines()
    assert list(parse_page(text)["COLMAP"]) == ["4.1.0", "4.10.0"]


def test_new_comparisons_replace_those_of_the_same_release_only():
    text = page(compared("4.1.0", 0.1) + compared("4.2.1", 0.2), "")
    text = page(compared("4.2.1", 0.3) + compared("4.2.1", 0.4, quantity="views"), text)
    lines = text.splitlines()
    assert "| points | 0.1 px (1) | 0.3 px (1) | 0.5 px |" in lines
    assert "| views | - | 0.4 px (1) | 0.5 px |" in lines
    assert page(compared("4.2.1", 0.3), text) == text


def test_exact_comparisons_have_a_tolerance_of_zero():
    exact = Comparison("GStreamer", "differing values", 0.0, 0.0, "%", "1.22.0")
    lines = page([exact], "").splitlines()
    assert "| differing values | 0 % (1) | 0 % |" in lines
    assert "| [GStreamer](#gstreamer) | 1.22.0 | 1.22.0 | 1 | 0 |" in lines


def test_documented_page_lists_all_programs():
    text = PAGE.read_text(encoding="utf-8")
    assert list(parse_page(text)) == list(PROGRAMS)
    assert page([], text) == text


@pytest.mark.parametrize("name", program_releases.PROGRAMS)
def test_compared_releases_have_a_section_and_tests(name):
    program = program_releases.PROGRAMS[name]
    assert name in PROGRAMS
    assert re.fullmatch(r"[\w-]+>=[\d.]+", program_releases.requirement(program))
    paths = re.findall(r"tests/\S+", program.tests)
    assert paths
    assert not [path for path in paths if not (ROOT / path).exists()]
