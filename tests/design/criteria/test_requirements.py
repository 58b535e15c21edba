"""The requirement file: what is wrong in it is named with its place."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.design import Limit, load_requirements, parse_requirements
from omnimirror.design.optimise.problem import DesignProblem
from omnimirror.errors import InvalidParameter, SpecError

GOOD = """
name = "mine"
[field]
omega_max_deg = 120
omega_min_deg = 10.0
object_distance_mm = [500, inf]

[mirror]
mapping = "equidistant"
rim_radius_mm = 40

[lens]
theta_max_deg = [10, 14.0]
f_number = 5.6

[imager]
width_px = 1280
height_px = 1024
pixel_pitch_um = 4.8

[[limit]]
quantity = "blur_px"
at_most = 4

[[limit]]
quantity = "aspect"
at_least = 0.8
at_most = 1.25
omega_deg = [20, 100]
"""


def test_a_file_is_read_as_it_says():
    wanted = parse_requirements(GOOD)
    assert wanted.name == "mine"
    assert wanted.field.object_distance_mm == (500.0, np.inf)
    assert wanted.lens.theta_max_deg == (10.0, 14.0)
    assert wanted.lens.f_number == (5.6, 5.6)
    assert wanted.lens.focal_length_mm is None
    assert wanted.imager.size == (1280, 1024)
    assert [limit.quantity for limit in wanted.limits] == ["blur_px", "aspect"]
    assert wanted.limits[1].omega_deg == (20.0, 100.0)


def test_changes_go_before_the_file(tmp_path):
    (tmp_path / "r.toml").write_text(GOOD)
    wanted = load_requirements(tmp_path / "r.toml", {"lens": {"f_number": [4, 8]}, "name": "other"})
    assert wanted.lens.f_number == (4.0, 8.0)
    assert wanted.lens.theta_max_deg == (10.0, 14.0)
    assert wanted.name == "other"


def test_a_table_beside_the_file_is_followed(tmp_path):
    rows = "\n".join(f"{o},{2 * o}" for o in range(0, 121, 5))
    (tmp_path / "map.csv").write_text(f"omega_deg,height\n{rows}\n")
    text = GOOD.replace('mapping = "equidistant"', 'mapping = "tabulated-mapping"\nmapping_csv = "map.csv"')
    (tmp_path / "r.toml").write_text(text)
    assert load_requirements(tmp_path / "r.toml").mirror.omega_deg[-1] == 120.0


BAD = [
    ("[field]", "[feild]", r"line 3: feild is not known; did you mean field\?"),
    ("omega_max_deg = 120", "omega_max = 120", r"line 4: field.omega_max is not known; did you mean omega_max_deg\?"),
    ("omega_max_deg = 120\n", "", "line 3: field.omega_max_deg is missing .field angle at the rim"),
    (
        "omega_max_deg = 120",
        "omega_max_deg = 200",
        "line 4: field.omega_max_deg = 200: it should be less than or equal",
    ),
    (
        "omega_min_deg = 10.0",
        "omega_min_deg = 130",
        "line 5: field.omega_min_deg = 130 is not below omega_max",
    ),
    (
        "[500, inf]",
        "[500, 100]",
        r"line 6: field.object_distance_mm = \[500, 100\]: it should be a number",
    ),
    ("[500, inf]", "nan", "line 6: field.object_distance_mm = nan: it should be a number"),
    ('"equidistant"', '"equidist"', r"line 9: mirror.mapping = 'equidist' is not known; did you mean equidistant\?"),
    ('mapping = "equidistant"', 'family = "torus"', "line 9: mirror.family = 'torus' is not known; valid are sphere"),
    ('mapping = "equidistant"', 'family = "polynomial:99"', "line 9: 'polynomial:99' is not a form to fit"),
    ('mapping = "equidistant"\n', "", "line 8: mirror has neither mapping nor family"),
    (
        'mapping = "equidistant"',
        'mapping = "equidistant"\nfamily = "sphere"',
        "line 8: mirror has both",
    ),
    ("rim_radius_mm = 40", 'rim_radius_mm = 40\nfit = "spline:3"', "line 11: 'spline:3' is not a form to fit"),
    ("rim_radius_mm = 40", "rim_radius_mm = [40, 50, 60]", "line 10: mirror.rim_radius_mm = .*such a .LOW, HIGH"),
    ("rim_radius_mm = 40", "rim_radius_mm = true", "line 10: mirror.rim_radius_mm = True: it should be a number"),
    ("theta_max_deg = [10, 14.0]\n", "", "line 12: lens has neither focal_length_mm nor theta_max_deg"),
    ("f_number = 5.6", 'kind = "orthographic"', "line 13: lens.theta_max_deg does not apply to an orthographic lens"),
    ("width_px = 1280", "width_px = 0", "line 17: imager.width_px = 0: it should be greater than or equal to 1"),
    (
        'quantity = "blur_px"',
        'quantity = "blur"',
        r"line 22: limit.quantity = 'blur' is not known; did you mean blur",
    ),
    ("at_most = 4\n", "", "line 21: limit of blur_px says neither at_most nor at_least"),
    ("at_least = 0.8", "at_least = 2", "line 25: limit of aspect: at_least is above at_most"),
    ("[20, 100]", "[20, 130]", r"line 29: limit.omega_deg = \[20.0, 130.0\] is no part of the field"),
    ("[20, 100]", "[20]", "line 29: limit.1.omega_deg"),
    ("at_least = 0.8", "atleast = 0.8", r"line 27: limit.1.atleast is not known; did you mean at_least\?"),
    (
        'quantity = "blur_px"\nat_most = 4',
        'quantity = "blur_px"\nat_most = -4',
        "line 21: limit of blur_px: at_most = -4 is below 0",
    ),
    (
        'quantity = "blur_px"\nat_most = 4',
        'quantity = "area_ratio"\nat_least = 1.5',
        "line 21: limit of area_ratio: at_least = 1.5 is above 1",
    ),
    (
        'quantity = "blur_px"\nat_most = 4',
        'quantity = "aspect"\nat_most = 0.5',
        "line 25: limit 2 contradicts limit 1: aspect at least 0.8 and at most 0.5",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = 0.001",
        "line 10: mirror.rim_radius_mm = 0.001: it should be a number from 0.1",
    ),
    ("[500, inf]", "0.01", "line 6: field.object_distance_mm = 0.01: it should be a number from 1 to inf"),
    (
        "omega_min_deg = 10.0",
        "omega_min_deg = 10.0\ncamera_radius_mm = 500",
        "line 6: field.camera_radius_mm = 500 is more than 5 times",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = 40\nconic = -1.5",
        "line 11: mirror.conic does not apply to the equidistant mapping; it belongs to hyperboloid",
    ),
    (
        'mapping = "equidistant"',
        'family = "sphere"\nconic = 0.5',
        "line 10: mirror.conic does not apply to the family sphere",
    ),
    ("[[limit]]\nquantity", "[limit]\nquantity", "is not valid TOML|limit = .* is not a list of tables"),
    ("\nname", "\nformat = 7\nname", "line 2: format = 7 is not known to this version"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD, ids=[m[:45] for *_, m in BAD])
def test_a_wrong_file_says_where_and_what_would_be_valid(old, new, message):
    assert old in GOOD
    with pytest.raises(SpecError, match=message) as e:
        parse_requirements(GOOD.replace(old, new, 1), source="mine.toml")
    assert str(e.value).startswith("mine.toml")
    assert "\n" not in str(e.value)


def test_a_limit_may_be_at_one_angle():
    wanted = parse_requirements(GOOD.replace("[20, 100]", "[90, 90]"))
    assert wanted.limits[1].omega_deg == (90.0, 90.0)


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path):
    (tmp_path / "r.toml").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_requirements(tmp_path / "r.toml").name == "mine"
    assert parse_requirements("\ufeff" + GOOD).name == "mine"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "x", None, True, [1.0]])
def test_a_limit_that_is_no_number_is_refused(value):
    with pytest.raises(InvalidParameter):
        Limit("blur_px", at_most=value)


def test_limits_of_parts_that_do_not_meet_are_no_contradiction():
    apart = Limit("aspect", at_most=0.5, omega_deg=(0.0, 19.0)), Limit("aspect", at_least=0.8, omega_deg=(20.0, 100.0))
    assert apart[0].contradicts(apart[1]) is None
    assert "at least 0.8 and at most 0.5" in Limit("aspect", at_most=0.5).contradicts(apart[1])


@pytest.mark.parametrize("change", [{"image_radius_px": 0}, {"image_radius_px": float("nan")}, {"mode": "Exact"}])
def test_a_problem_with_no_image_or_an_unknown_mode_is_refused(change):
    with pytest.raises(InvalidParameter, match=next(iter(change))):
        DesignProblem(**change)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(SpecError, match=r"there is no requirement file .*no\.toml"):
        load_requirements(tmp_path / "no.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SpecError, match="it is not a text file"):
        load_requirements(tmp_path / "b.toml")


@pytest.mark.parametrize(
    ("lens", "valid"),
    [("focal_length_mm = 8.0\nfocus_mm = [3, 5]", "above 8"), ("focus_mm = -4\ntheta_max_deg = 12.0", "above 0")],
)
def test_a_focus_nearer_than_the_focal_length_is_refused(lens, valid):
    text = f'field.omega_max_deg = 100\n[mirror]\nmapping = "equiangular"\nrim_radius_mm = 20\n[lens]\n{lens}\n'
    with pytest.raises(SpecError, match=rf"line [67]: lens.focus_mm = .* it is valid {valid}"):
        parse_requirements(text)
