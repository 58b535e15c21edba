"""Selection of the daily cases of a test; ``make test-full`` runs all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

FEW_MIRRORS = ("cone", "conic-asphere", "cylinder", "sampled")
"""Mirrors of different types: with a pointed tip, analytic, with a prescribed mapping, and through
points."""


def few(cases: Iterable[Any], *everyday: object) -> list[Any]:
    """Return all cases of a parametrised test, with tuples for several values; only the named ones
    run daily."""
    found = list(cases)
    assert set(everyday) <= set(found), f"there is no case {set(everyday) - set(found)}"
    return [case if case in everyday else _in_the_long_run(case) for case in found]


def _in_the_long_run(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
