"""Vocabulary: one name with its unit per quantity, used by all tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omnimirror.analysis.comparison import COMPARED
from omnimirror.analysis.evaluation import COLUMNS, Evaluation
from omnimirror.analysis.focus import FOCUS_MERITS
from omnimirror.base import quantities
from omnimirror.base.quantities import QUANTITIES
from omnimirror.design.limits import LIMITABLE
from omnimirror.design.merits import DESIGN_MERITS, values_of_evaluation
from omnimirror.optics.batch.evaluate import BATCH_COLUMNS
from tests.conftest import sensor_of

DOCS = Path(__file__).parents[2] / "docs"
UNITS = {
    "cycles_per_px": "cycles/px",
    "lp_per_mm": "lp/mm",
    "px_per_deg": "px/deg",
    "mm_per_px": "mm/px",
    "deg2": "deg²",
    "px2": "px²",
    "deg": "deg",
    "px": "px",
    "mm": "mm",
    "percent": "%",
    "sr": "sr",
    "g": "g",
}


@pytest.mark.parametrize("name", QUANTITIES)
def test_quantity_name_ends_with_unit(name):
    unit = next((unit for end, unit in UNITS.items() if f"_{name}".endswith(f"_{end}")), "")
    assert QUANTITIES[name].unit == unit
    assert QUANTITIES[name].name == name
    assert QUANTITIES[name].title
    assert QUANTITIES[name].meaning


def test_quantity_descriptions_are_unique():
    descriptions = [(q.title, q.unit, q.meaning) for q in QUANTITIES.values()]
    assert len(set(descriptions)) == len(descriptions)
    per_angle = (
        quantities.FIELD_QUANTITIES,
        quantities.DERIVED_QUANTITIES,
        quantities.LENS_QUANTITIES,
        quantities.CALIBRATION_QUANTITIES,
    )
    of_sensors = (
        quantities.SENSOR_QUANTITIES,
        quantities.APERTURE_QUANTITIES,
        quantities.AS_BUILT_QUANTITIES,
    )
    groups = (*per_angle, *of_sensors, quantities.REDUCED_QUANTITIES)
    assert sum(map(len, groups)) == len(QUANTITIES)


def test_field_quantities_are_evaluation_columns():
    import omnimirror as om

    result = om.evaluate(sensor_of("hyperboloid"), [20.0, 60.0])
    arrays = [
        name for name in Evaluation.__annotations__ if isinstance(getattr(result, name), np.ndarray)
    ]
    assert arrays == [q.name for q in quantities.FIELD_QUANTITIES]
    assert all(f"{name} : (n,)" in Evaluation.__doc__ for name in arrays)


def test_heading_is_head_or_symbol():
    assert all(
        quantity.heading == (quantity.head if quantity.head else quantity.symbol)
        for quantity in QUANTITIES.values()
    )
    assert {bool(quantity.head) for quantity in QUANTITIES.values()} == {True, False}


def test_tables_use_quantities():
    assert set(COMPARED) | set(BATCH_COLUMNS) <= set(QUANTITIES)
    assert set(LIMITABLE) | set(FOCUS_MERITS) | set(DESIGN_MERITS) <= set(QUANTITIES)
    assert all(limitable.quantity is QUANTITIES[name] for name, limitable in LIMITABLE.items())


def test_quantity_has_same_value_in_all_results():
    """A focus merit, a design merit, a row of the comparison and a limit of the same name are
    equal."""
    import omnimirror as om

    sensor = om.load_sensor("paper-equidistant")
    angles = np.linspace(*sensor.field_deg, 721)
    result = om.evaluate(sensor, angles)
    table, field = om.compare([sensor]), values_of_evaluation(result)
    shared = set(DESIGN_MERITS) & set(COMPARED)
    assert len(shared) >= 5
    for name in shared:
        assert DESIGN_MERITS[name].value(field) == pytest.approx(table[name].values[0], rel=1e-9), (
            name
        )
    for name in set(LIMITABLE) & set(COMPARED):
        low, high = (LIMITABLE[name].extreme(field, largest)[0] for largest in (False, True))
        assert low == pytest.approx(high), name  # one number for the whole field
        assert low == pytest.approx(table[name].values[0], rel=1e-9), name
    for name in set(FOCUS_MERITS) & set(DESIGN_MERITS) - {"mean_floored_area_deg2"}:
        best = om.best_focus(sensor, name, omega_deg=angles)
        at_focus = om.evaluate(sensor, angles, focus_mm=best.focus_mm)
        assert DESIGN_MERITS[name].value(values_of_evaluation(at_focus)) == pytest.approx(
            best.value, rel=1e-9
        ), name


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("tolerance", [q.name for q in quantities.AS_BUILT_QUANTITIES]),
        ("design", LIMITABLE),
        ("optimisation", DESIGN_MERITS),
        ("evaluation", FOCUS_MERITS),
        ("evaluation", COLUMNS),
    ],
)
def test_pages_document_every_quantity(page, names):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    shortened = "`image_t_x_mm` to `image_s_z_mm`"
    assert [
        n
        for n in names
        if f"`{n}`" not in text and not (n.startswith("image_") and shortened in text)
    ] == []
