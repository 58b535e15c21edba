"""Which cases of a test run every day; ``make test-full`` runs all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

FEW_MIRRORS = ("cone", "conic-asphere", "cylinder", "sampled")
"""Mirrors unlike each other: with a pointed tip, by a formula, generated for a mapping, and through points."""


def few(cases: Iterable[Any], *everyday: object) -> list[Any]:
    """All cases for a parametrised test, tuples of several values; those not named run in the long run alone."""
    found = list(cases)
    assert set(everyday) <= set(found), f"there is no case {set(everyday) - set(found)}"
    return [case if case in everyday else _in_the_long_run(case) for case in found]


def _in_the_long_run(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
