"""Keyframed views."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from omnimirror.base.errors import MediaError
from omnimirror.io.keyframes import Keyframes, keyframes_of, parse_csv, parse_toml

CSV = """# a slow turn
time_s, pan_deg, hfov_deg
0, 170, 90
2, -170,
4, -90, 40
"""
TOML = """
interpolation = "linear"

[[keyframe]]
time_s = 0
pan_deg = 170

[[ keyframe ]]
time_s = 2
pan_deg = -170
tilt_deg = -10.5
"""


def test_csv_with_empty_cells(tmp_path):
    (tmp_path / "a.csv").write_text("\ufeff" + CSV)
    keyframes = Keyframes.load(tmp_path / "a.csv")
    assert keyframes.at(0) == keyframes.at(-3) == {"pan_deg": 170, "hfov_deg": 90}
    assert keyframes.at(2)["pan_deg"] == -170
    assert keyframes.at(2)["hfov_deg"] == 65
    assert keyframes.at(4) == keyframes.at(99) == {"pan_deg": -90, "hfov_deg": 40}


def test_toml_linear(tmp_path):
    (tmp_path / "a.toml").write_text(TOML)
    keyframes = Keyframes.load(tmp_path / "a.toml")
    assert keyframes.at(1) == {
        "pan_deg": 180,
        "tilt_deg": -5.25,
    }  # 0 in the first keyframe, which does not contain it
    assert keyframes.at(0.5)["pan_deg"] == pytest.approx(175)
    assert keyframes.at(1.5)["pan_deg"] == pytest.approx(-175)


POSES = ("x_mm", "y_mm", "pan_deg")
MISSING_AT_FIRST = {
    parse_csv: "time_s,x_mm,y_mm,pan_deg\n1,1500,,\n2,1500,900,\n3,1500,,40",
    parse_toml: "interpolation = 'linear'\n[[keyframe]]\ntime_s = 1\nx_mm = 1500\n"
    "[[keyframe]]\ntime_s = 2\nx_mm = 1500\ny_mm = 900\n[[keyframe]]\ntime_s = 3\npan_deg = 40",
}


@pytest.mark.parametrize("parse", MISSING_AT_FIRST)
def test_value_missing_in_first_keyframe_is_zero(parse):
    keyframes = parse(MISSING_AT_FIRST[parse], names=POSES)
    assert keyframes.at(0) == keyframes.at(1) == {"x_mm": 1500, "y_mm": 0, "pan_deg": 0}
    assert keyframes.at(1.5)["y_mm"] == pytest.approx(
        450
    )  # halfway, where smooth and linear interpolation agree
    assert 900 == keyframes.at(2)["y_mm"] == keyframes.at(3)["y_mm"]
    assert 0 < keyframes.at(2)["pan_deg"] < 40 == keyframes.at(3)["pan_deg"]


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_csv, "time_s,pan_deg,{0}\n0,0,\n4,90,60"),
        (parse_toml, "[[keyframe]]\ntime_s = 0\n[[keyframe]]\ntime_s = 4\n{0} = 60"),
    ],
)
@pytest.mark.parametrize("name", ["hfov_deg", "distance_mm"])
def test_values_without_default_are_required_in_first_keyframe(parse, text, name):
    with pytest.raises(
        MediaError,
        match=f"{name} must be in the first keyframe of keyframes; got it only from .*line",
    ):
        parse(text.format(name))


values = st.lists(st.floats(-60, 60), min_size=3, max_size=8)


@given(values, st.floats(0, 1))
def test_smooth_interpolation_does_not_overshoot(levels, share):
    keyframes = Keyframes({"tilt_deg": tuple((2.0 * i, level) for i, level in enumerate(levels))})
    for i, (a, b) in enumerate(pairwise(levels)):
        assert min(a, b) - 1e-9 <= keyframes.at(2 * (i + share))["tilt_deg"] <= max(a, b) + 1e-9


@pytest.mark.parametrize("interpolation", [None, "smooth", "linear"])
def test_motion_between_two_keyframes(interpolation):
    """Smooth by default: 3 t^2 - 2 t^3 of the range, which starts and ends at rest."""
    header = "" if interpolation is None else f"interpolation = '{interpolation}'\n"
    text = "[[keyframe]]\ntime_s = -4\ntilt_deg = 10\n[[keyframe]]\ntime_s = -2\ntilt_deg = 26\n"
    keyframes = parse_toml(header + text)
    for t in (0.0, 0.25, 0.5, 0.875, 1.0):
        share = t if interpolation == "linear" else 3 * t**2 - 2 * t**3
        assert keyframes.at(-4 + 2 * t)["tilt_deg"] == pytest.approx(10 + 16 * share, rel=1e-12)


def test_csv_lines_may_start_with_spaces_and_quotes():
    """Only # starts a comment, and only at the start of a line; empty lines are counted."""
    text = '\n#,#\n"time_s",pan_deg\n"0",0\n\n 2 ,90\n#3,4\n'
    assert parse_csv(text) == parse_csv("time_s,pan_deg\n0,0\n2,90")
    assert parse_csv(text + "3\n") == parse_csv(text)  # fewer cells than the header
    with pytest.raises(MediaError, match=r"^line 6 of moves: pan_deg must be a number; got '9x'$"):
        parse_csv(text.replace("90", "9x"), "moves")


def test_smooth_interpolation_equals_pchip():
    """SciPy's monotone interpolation has the same slopes inside; at the ends, slopes are zero."""
    times, levels = np.array([0, 1, 3, 4, 6, 7.5, 9]), np.array([0, 4, 5, 5, 20, 18, 19.0])
    keyframes = Keyframes({"tilt_deg": tuple(zip(times, levels, strict=True))})
    reference = PchipInterpolator(times, levels)
    for t in np.linspace(1, 7.5, 50):
        assert keyframes.at(t)["tilt_deg"] == pytest.approx(reference(t), abs=1e-9)
    for end in (0, 9):
        assert keyframes.at(end + np.sign(4 - end) * 1e-4)["tilt_deg"] == pytest.approx(
            keyframes.at(end)["tilt_deg"], abs=1e-6
        )


@given(st.lists(st.floats(-720, 720), min_size=2, max_size=6), st.floats(0, 1))
def test_pan_interpolates_along_shortest_path(pans, share):
    keyframes = Keyframes(
        {"pan_deg": tuple((float(i), pan) for i, pan in enumerate(pans))}, "linear"
    )
    for i, (a, b) in enumerate(pairwise(pans)):
        shortest_turn = (b - a + 180) % 360 - 180
        pan = keyframes.at(i + share)["pan_deg"]
        assert -180 <= pan <= 180
        assert (
            abs((pan - (a + share * shortest_turn) + 180) % 360 - 180) < 1e-6
            or abs(abs(shortest_turn) - 180) < 1e-6
        )


@pytest.mark.parametrize(
    ("parse", "text", "message"),
    [
        (
            parse_csv,
            "",
            "keyframes must contain keyframes, with a header such as time_s,pan_deg,tilt_deg$",
        ),
        (parse_csv, "time_s,pan_deg\n", "keyframes must contain keyframes"),
        (parse_csv, "pan_deg\n1", "line 1 of keyframes must contain time_s"),
        (
            parse_csv,
            "time_s,pan\n1,1",
            "line 1 of keyframes: the names must be from time_s, pan_deg, tilt_deg, roll_deg, hfov_deg,",
        ),
        (
            parse_csv,
            "time_s,pan_deg\n0,1\n1,x",
            "line 3 of keyframes: pan_deg must be a number; got 'x'",
        ),
        (parse_csv, "time_s,pan_deg\n0,1\n\n,5", "line 4 of keyframes must contain time_s"),
        (
            parse_csv,
            "time_s,pan_deg\n0,1,2",
            "line 2 of keyframes must have at most 2 values, as the header; got 3",
        ),
        (
            parse_csv,
            "time_s,pan_deg\n1,1\n1,2",
            "line 3 of keyframes: time_s must be greater than that of the previous keyframe, 1 s; got 1 s",
        ),
        (
            parse_csv,
            "time_s,pan_deg\n0,inf",
            "line 2 of keyframes: pan_deg must be a number; got 'inf'",
        ),
        (parse_toml, "x = ", r"keyframes must be valid TOML: Invalid value \(at end of document\)"),
        (parse_toml, "", "keyframes must contain keyframes"),
        (
            parse_toml,
            "interpolation = 'cubic'",
            "keyframes: interpolation must be smooth or linear; got 'cubic'",
        ),
        (
            parse_toml,
            "keyframe = 3",
            r"keyframes must contain only \[\[keyframe\]\] tables and optionally interpolation",
        ),
        (
            parse_toml,
            "keyframe = [3]",
            r"keyframes must contain only \[\[keyframe\]\] tables and optionally interpolation",
        ),
        (
            parse_toml,
            TOML + "[[keyframe]]\ntime_s = 3\npan_deg = [1]",
            r"the keyframe in line 12 of keyframes: pan_deg must be a number; got \[1\]",
        ),
        (
            parse_toml,
            "other = 3",
            r"keyframes must contain only \[\[keyframe\]\] tables and optionally interpolation",
        ),
        (
            parse_toml,
            TOML + "[[keyframe]]\npan_deg = 1",
            "the keyframe in line 12 of keyframes must contain time_s",
        ),
        (
            parse_toml,
            TOML + "[[keyframe]]\ntime_s = 3\nzoom = 1",
            "the keyframe in line 12 of keyframes: the names must be from time_s, pan_deg, tilt_deg, ro",
        ),
        (
            parse_toml,
            TOML + "[[keyframe]]\ntime_s = true",
            "the keyframe in line 12 of keyframes: time_s must be a number; got True",
        ),
    ],
)
def test_keyframe_errors_contain_line(parse, text, message):
    with pytest.raises(MediaError, match=message) as e:
        parse(text)
    assert "\n" not in str(e.value)


def test_invalid_keyframe_files_raise(tmp_path):
    with pytest.raises(MediaError, match="path must be an existing keyframe file"):
        Keyframes.load(tmp_path / "a.csv")
    for name, text in (("b.CSV", CSV), ("b.Toml", TOML)):
        (tmp_path / name).write_text(text)
        assert set(Keyframes.load(tmp_path / name).tracks) >= {"pan_deg"}
    (tmp_path / "a.txt").write_text(CSV)
    with pytest.raises(MediaError, match=r"keyframes must be a \.csv or \.toml file"):
        Keyframes.load(tmp_path / "a.txt")
    with pytest.raises(MediaError, match="cannot read the keyframes"):
        Keyframes.load(tmp_path)


def test_keyframes_without_lines_are_numbered_from_1():
    with pytest.raises(MediaError, match="keyframe 2 of moves must contain time_s"):
        keyframes_of({"keyframe": [{"time_s": 0, "pan_deg": 1}, {"pan_deg": 2}]}, "moves")
    with pytest.raises(MediaError, match="the keyframe in line 7 of moves must contain time_s"):
        keyframes_of(
            {"keyframe": [{"time_s": 0, "pan_deg": 1}, {"pan_deg": 2}]}, "moves", lines=[3, 7]
        )
