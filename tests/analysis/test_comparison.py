"""The table of a comparison against the evaluation of each sensor, closed forms and what is known of the paper's."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.mirrors.pose import MirrorPose
from tests.conftest import sensor_of

NAMES = ("paper-spherical", "paper-equidistant", "paper-hyperboloidal", "folded-spherical", "paraboloid-telecentric")
SENSORS = [om.load_sensor(n) for n in NAMES]
TABLE = om.compare(SENSORS)


@pytest.mark.parametrize(
    ("key", "known"),
    [
        ("nonlinearity_percent", {"paper-equidistant": pytest.approx(0.49, abs=0.005)}),  # erratum 3's polynomial
        ("share_of_sphere_percent", {"paper-spherical": pytest.approx(85.36, abs=0.01)}),  # erratum 9
        ("area_ratio", {"paper-spherical": pytest.approx(0.691, abs=0.001)}),  # the paper's "70 %"
        ("viewpoint_spread_mm", {"paper-hyperboloidal": pytest.approx(0, abs=1e-10)}),
        ("worst_aspect", {"paraboloid-telecentric": pytest.approx(1, abs=1e-12)}),
        ("one_viewpoint_error_px", {"paraboloid-telecentric": pytest.approx(0, abs=1e-9)}),
        ("sag_mm", {"paper-spherical": pytest.approx(49.9582 - np.sqrt(49.9582**2 - 43.905**2))}),
        ("length_mm", {"folded-spherical": pytest.approx(86 + 49.9582 - np.sqrt(49.9582**2 - 43.905**2))}),
    ],
)
def test_known_numbers_are_there(key, known):
    row = dict(zip(NAMES, TABLE[key].values, strict=True))
    assert {name: row[name] for name in known} == known


def test_the_worst_is_no_better_than_any_angle_of_the_evaluation():
    for i, sensor in enumerate(SENSORS):
        angles = om.evaluate(sensor, np.linspace(*sensor.field_deg, 50))
        for key in ("blur_t_px", "blur_s_px", "blur_t_deg", "blur_s_deg", "floored_area_deg2"):
            worst = np.abs(getattr(angles, key)).max()
            assert worst * (1 - 1e-12) <= TABLE[f"worst_{key}"].values[i] <= worst * 1.01
        assert TABLE["best_focus_mm"].values[i] == om.best_focus(sensor).focus_mm
        assert TABLE["best_focus_worst_floored_area_deg2"].values[i] <= TABLE["worst_floored_area_deg2"].values[i]


def test_the_best_of_a_row_is_marked_and_nothing_where_none_is_better():
    assert TABLE["field_to_deg"].best == [True, True, True, True, False]  # they read 135.0, and one 105.0
    assert TABLE["length_mm"].best == [False, False, False, True, False]  # a telecentric lens stands anywhere
    assert TABLE["length_mm"].texts[-1] == "–"
    assert TABLE["dh_domega_ratio"].best == [False, True, False, False, False]
    assert not any(TABLE["focus_mm"].best)
    assert not any(om.compare([SENSORS[0]])["field_to_deg"].best)


def test_every_kind_of_mirror_can_be_compared(any_sensor):
    values = [v for row in om.compare([any_sensor]).rows for v in row.values if isinstance(v, float)]
    assert np.isnan(values).sum() == any_sensor.lens.TELECENTRIC


def test_files_hold_every_number_exactly(tmp_path):
    TABLE.to_csv(tmp_path / "t.csv")
    TABLE.to_json(tmp_path / "t.json")
    header, *lines = csv.reader((tmp_path / "t.csv").read_text(encoding="utf-8").splitlines())
    assert header == ["quantity", *NAMES]
    sensors = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert [s["name"] for s in sensors] == list(NAMES)
    for row, line in zip(TABLE.rows, lines, strict=True):
        assert line[0] == row.name
        for value, cell, sensor in zip(row.values, line[1:], sensors, strict=True):
            if isinstance(value, str):
                assert cell == sensor[row.name] == value
            else:
                np.testing.assert_equal([float(cell), float(sensor[row.name])], [value, value])


def test_sensors_of_one_name_are_told_apart():
    cone = sensor_of("cone")
    table = om.compare([cone, SENSORS[0], replace(cone, mirror=SENSORS[0].mirror)])
    assert table.names == ["cone (1)", "paper-spherical", "cone (2)"]


def test_a_sensor_as_it_was_built_is_compared_as_it_was_drawn_and_that_is_said():
    built = replace(SENSORS[0], name="built", mirror_pose=MirrorPose(0.3, -0.4, 0.0, 0.0, 1.2))
    table = om.compare([built, SENSORS[0]])
    assert table.notes == (
        "built: its mirror is decentred by 0.5 mm and tilted by 1.2 deg; it is compared as if it were in place.",
    )
    assert all(row.texts[0] == row.texts[1] for row in table.rows)
    assert om.compare([SENSORS[0]]).notes == ()


def test_too_many_or_unknown_is_refused():
    with pytest.raises(InvalidParameter, match="7 sensors do not fit side by side; 1 to 6 are valid"):
        om.compare([SENSORS[0]] * 7)
    with pytest.raises(InvalidParameter, match="0 sensors"):
        om.compare([])
    with pytest.raises(InvalidParameter, match="'speed' is not compared; valid are mirror, "):
        TABLE["speed"]
