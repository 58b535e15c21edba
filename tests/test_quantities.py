"""The vocabulary: one name for one thing, with its unit, and every table speaks it."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror import quantities
from omnimirror.analysis.comparison import COMPARED
from omnimirror.analysis.evaluation import Evaluation
from omnimirror.quantities import QUANTITIES
from tests.conftest import sensor_of

UNITS = {
    "px_per_deg": "px/deg", "deg2": "deg²", "px2": "px²", "deg": "deg", "px": "px", "mm": "mm", "percent": "%",
}  # fmt: skip


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_name_ends_with_its_unit(name):
    unit = next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}")), "")
    assert QUANTITIES[name].unit == unit
    assert QUANTITIES[name].name == name
    assert QUANTITIES[name].title
    assert QUANTITIES[name].meaning


def test_no_two_quantities_are_explained_alike():
    told = [(q.title, q.unit, q.meaning) for q in QUANTITIES.values()]
    assert len(set(told)) == len(told)
    groups = (quantities.COLUMNS, quantities.OF_BOTH_SIDES, quantities.OF_THE_SENSOR, quantities.OVER_THE_FIELD)
    assert sum(map(len, groups)) == len(QUANTITIES)


def test_the_columns_are_those_of_an_evaluation():
    import omnimirror as om

    result = om.evaluate(sensor_of("hyperboloid"), [20.0, 60.0])
    arrays = [name for name in Evaluation.__annotations__ if isinstance(getattr(result, name), np.ndarray)]
    assert arrays == [q.name for q in quantities.COLUMNS]
    assert all(f"{name} : (n,)" in Evaluation.__doc__ for name in arrays)


def test_every_table_takes_its_words_from_here():
    assert set(COMPARED) <= set(QUANTITIES)
