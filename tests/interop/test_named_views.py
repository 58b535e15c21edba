"""View files: parsing and error messages."""

import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError


def load(tmp_path, text):
    (tmp_path / "views.toml").write_text(text)
    return om.load_views(tmp_path / "views.toml")


def test_views_equal_those_of_the_view_functions(tmp_path):
    sensor = om.load_sensor("paper-spherical")
    text = """
[front]
pan_deg = 10
hfov_deg = 60
size = [320, 240]
steerable = true
[around]
view = "panorama"
elevation_deg = [-40, 20]
[floor]
view = "ground"
height_mm = 1200
mm_per_px = 10
offset_mm = [100, 0, 0]
"""
    views = load(tmp_path, text)
    assert {name: view.steerable for name, view in views.items()} == {
        "front": True,
        "around": False,
        "floor": False,
    }
    assert views["front"](sensor) == om.screens.Plane((320, 240), 10.0, hfov_deg=60.0)
    assert views["around"](sensor) == om.views.panorama(sensor, elevation_deg=(-40.0, 20.0))
    assert views["floor"](sensor) == om.views.ground(
        sensor, 1200.0, mm_per_px=10.0, offset_mm=(100.0, 0.0, 0.0)
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"views\.toml must contain 1 to 64 views; got 0"),
        ("front = 3", r"views\.toml: the view front must be a table \[front\]; got 3"),
        (
            "['a b']",
            "must consist of letters, digits and underscores and begin with a letter; got 'a b'",
        ),
        ("[a]\nview = 'fan'", "\\[a\\]: view must be one of panorama, perspective.*; got 'fan'"),
        ("[a]\nview = 7", "view must be a string; got 7"),
        ("[a]\nsteerable = 1", "steerable must be true or false; got 1"),
        (
            "[a]\nheight_mm = 7",
            "options of a perspective view must be from view, size, pan_deg.*; got 'height_mm'",
        ),
        (
            "[a]\nview = 'panorama'\nsteerable = true",
            "a steerable view must be perspective; 'a' is a panorama view",
        ),
    ],
)
def test_invalid_files_raise_with_name_and_condition(tmp_path, text, message):
    with pytest.raises(SpecError, match=message):
        load(tmp_path, text)


def test_missing_file_raises():
    with pytest.raises(SpecError, match=r"path must be an existing file of views"):
        om.load_views("nowhere.toml")


def test_option_values_are_checked_on_construction():
    with pytest.raises(InvalidParameter, match="hfov_deg"):
        om.NamedView("a", options={"hfov_deg": 190.0})(om.load_sensor("paper-spherical"))


FILE = "[front]\nhfov_deg = 60\nsize = [320, 240]\n[around]\nview = 'panorama'\n"


def test_changes_replace_and_remove_entries_of_the_file(tmp_path):
    (tmp_path / "views.toml").write_text(FILE)
    changes = {"front": {"pan_deg": 40, "size": None}, "around": {"elevation_deg": [-30, 10]}}
    views = om.load_views(tmp_path / "views.toml", changes)
    assert views["front"].options == {"hfov_deg": 60, "pan_deg": 40}
    assert views["around"].options == {"elevation_deg": (-30, 10)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frnt": {"pan_deg": 1}}, "unknown view frnt; did you mean front"),
        ({"front": 5}, r"must be entries such as front\.pan_deg"),
        ({"front": {"pan": 1}}, "got 'pan'; did you mean pan_deg"),
    ],
)
def test_invalid_changes_raise(tmp_path, changes, message):
    (tmp_path / "views.toml").write_text(FILE)
    with pytest.raises(SpecError, match=message):
        om.load_views(tmp_path / "views.toml", changes)
