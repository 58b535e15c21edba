"""Files of views: what they say, and what is refused."""

import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter, SpecError


def load(tmp_path, text):
    (tmp_path / "views.toml").write_text(text)
    return om.load_views(tmp_path / "views.toml")


def test_views_are_those_of_the_makers(tmp_path):
    sensor = om.load_sensor("paper-spherical")
    text = """
[front]
pan_deg = 10
hfov_deg = 60
size = [320, 240]
steered = true
[around]
view = "panorama"
elevation_deg = [-40, 20]
[floor]
view = "ground"
height_mm = 1200
mm_per_px = 10
offset_mm = [100, 0, 0]
"""
    found = load(tmp_path, text)
    assert {name: view.steered for name, view in found.items()} == {"front": True, "around": False, "floor": False}
    assert found["front"](sensor) == om.screens.Plane((320, 240), 10.0, hfov_deg=60.0)
    assert found["around"](sensor) == om.views.panorama(sensor, elevation_deg=(-40.0, 20.0))
    assert found["floor"](sensor) == om.views.ground(sensor, 1200.0, mm_per_px=10.0, offset_mm=(100.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds 0 views; it is valid with 1 to 64"),
        ("front = 3", "front = 3 is no view; valid are tables such as \\[front\\]"),
        ("['a b']", "'a b' is no name of a view; valid are letters, digits and underscores"),
        ("[a]\nview = 'fan'", "\\[a\\]: view = 'fan' is not known; valid are panorama, perspective"),
        ("[a]\nview = 7", "view is a word, and steered is true or false"),
        ("[a]\nheight_mm = 7", "'height_mm' does not belong to a perspective; valid are size, pan_deg"),
        ("[a]\nview = 'panorama'\nsteered = true", "'a' is a panorama, and only a perspective can be steered"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, sentence):
    with pytest.raises(SpecError, match=sentence):
        load(tmp_path, text)


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(SpecError, match=r"there are no views 'nowhere\.toml'"):
        om.load_views("nowhere.toml")


def test_values_are_checked_where_the_view_is_made():
    with pytest.raises(InvalidParameter, match="hfov_deg"):
        om.NamedView("a", options={"hfov_deg": 190.0})(om.load_sensor("paper-spherical"))
