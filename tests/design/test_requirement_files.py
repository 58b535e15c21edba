"""Requirement files: errors with their positions."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError, SpecError
from omnimirror.design import Limit, format_requirements, load_requirements, parse_requirements
from omnimirror.design._design_problem import DesignProblem
from omnimirror.optics.image_sensor import Imager

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
quantity = "total_blur_px"
at_most = 4

[[limit]]
quantity = "aspect"
at_least = 0.8
at_most = 1.25
omega_deg = [20, 100]
"""


def test_requirement_file_is_read():
    requirements = parse_requirements(GOOD)
    assert requirements.name == "mine"
    assert requirements.field.object_distance_mm == (500.0, np.inf)
    assert requirements.lens.theta_max_deg == (10.0, 14.0)
    assert requirements.lens.f_number == 5.6
    assert requirements.lens.focal_length_mm is None
    assert requirements.imager.size == (1280, 1024)
    assert [limit.quantity for limit in requirements.limits] == ["total_blur_px", "aspect"]
    assert requirements.limits[1].omega_deg == (20.0, 100.0)


def test_changes_override_file(tmp_path):
    (tmp_path / "r.toml").write_text(GOOD)
    requirements = load_requirements(
        tmp_path / "r.toml", {"lens": {"f_number": [4, 8]}, "name": "other"}
    )
    assert requirements.lens.f_number == (4.0, 8.0)
    assert requirements.lens.theta_max_deg == (10.0, 14.0)
    assert requirements.name == "other"


def test_table_relative_to_file_is_read(tmp_path):
    rows = "\n".join(f"{o},{2 * o}" for o in range(0, 121, 5))
    (tmp_path / "map.csv").write_text(f"omega_deg,height\n{rows}\n")
    text = GOOD.replace(
        'mapping = "equidistant"', 'mapping = "tabulated-mapping"\nmapping_csv = "map.csv"'
    )
    (tmp_path / "r.toml").write_text(text)
    assert load_requirements(tmp_path / "r.toml").mirror.omega_deg[-1] == 120.0


BAD = [
    ("[field]", "[feild]", r"line 3: unknown entry feild; did you mean field\?"),
    (
        "omega_max_deg = 120",
        "omega_max = 120",
        r"line 4: unknown entry field.omega_max; did you mean omega_max_deg\?",
    ),
    ("omega_max_deg = 120\n", "", "line 3: field.omega_max_deg is missing .field angle at the rim"),
    (
        "omega_max_deg = 120",
        "omega_max_deg = 200",
        "line 4: field.omega_max_deg must be less than or equal",
    ),
    (
        "omega_min_deg = 10.0",
        "omega_min_deg = 130",
        "line 5: field.omega_min_deg must be less than omega_max_deg = 120; got 130",
    ),
    ("[500, inf]", "[500, 100]", r"line 6: field.object_distance_mm must be a number"),
    ("[500, inf]", "nan", "line 6: field.object_distance_mm must be a number"),
    (
        '"equidistant"',
        '"equidist"',
        r"line 9: mirror.mapping must be one of .*; got 'equidist'; did you mean equidistant\?",
    ),
    (
        'mapping = "equidistant"',
        'family = "torus"',
        "line 9: mirror.family must be one of sphere.*; got 'torus'",
    ),
    (
        'mapping = "equidistant"',
        'family = "polynomial:99"',
        "line 9: fit must be .*; got 'polynomial:99'",
    ),
    (
        'mapping = "equidistant"\n',
        "",
        "line 8: mirror must have exactly one of mapping, family and optimise; got none",
    ),
    (
        'mapping = "equidistant"',
        'mapping = "equidistant"\nfamily = "sphere"',
        "line 8: .* must have exactly one of .*; got mapping and family",
    ),
    (
        "rim_radius_mm = 40",
        'rim_radius_mm = 40\nfit = "spline:3"',
        "line 11: fit must be .*; got 'spline:3'",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = [40, 50, 60]",
        "line 10: mirror.rim_radius_mm must be a number .*or a range .LOW, HIGH",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = true",
        "line 10: mirror.rim_radius_mm must be a number",
    ),
    ("theta_max_deg = [10, 14.0]\n", "", "line 12: lens requires focal_length_mm or theta_max_deg"),
    (
        "f_number = 5.6",
        'kind = "orthographic"',
        "line 13: lens.theta_max_deg must be omitted for an orthographic lens",
    ),
    (
        "width_px = 1280",
        "width_px = 0",
        "line 17: imager.width_px must be greater than or equal to 1",
    ),
    (
        'quantity = "total_blur_px"',
        'quantity = "blur"',
        r"line 22: limit.quantity must be one of total_blur_px.*; got 'blur'",
    ),
    ("at_most = 4\n", "", "line 21: limit of total_blur_px must have at_most or at_least"),
    (
        "at_least = 0.8",
        "at_least = 2",
        "line 25: limit of aspect: at_least must not exceed at_most",
    ),
    (
        "[20, 100]",
        "[20, 130]",
        r"line 29: limit.omega_deg must be \[FROM, TO\] up to 120 deg; got \[20.0, 130.0\]",
    ),
    ("[20, 100]", "[20]", "line 29: limit.1.omega_deg"),
    (
        "at_least = 0.8",
        "atleast = 0.8",
        r"line 27: unknown entry limit.1.atleast; did you mean at_least\?",
    ),
    (
        'quantity = "total_blur_px"\nat_most = 4',
        'quantity = "total_blur_px"\nat_most = -4',
        "line 21: limit of total_blur_px: at_most must be at least 0; got -4",
    ),
    (
        'quantity = "total_blur_px"\nat_most = 4',
        'quantity = "area_ratio"\nat_least = 1.5',
        "line 21: limit of area_ratio: at_least must be at most 1; got 1.5",
    ),
    (
        'quantity = "total_blur_px"\nat_most = 4',
        'quantity = "aspect"\nat_most = 0.5',
        "line 25: limit 2 contradicts limit 1: aspect at least 0.8 and at most 0.5",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = 0.001",
        "line 10: mirror.rim_radius_mm must be a number from 0.1",
    ),
    ("[500, inf]", "0.01", "line 6: field.object_distance_mm must be a number from 1 to inf"),
    (
        "[mirror]",
        "[housing.camera]\ndiameter_mm = 1000\n[mirror]",
        "line 9: housing.camera.diameter_mm must be at most 400, 5 times .*; got 1000",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = 40\nconic = -1.5",
        "line 11: mirror.conic must be omitted for the equidistant mapping; it applies to hyperboloid",
    ),
    (
        'mapping = "equidistant"',
        'family = "sphere"\nconic = 0.5',
        "line 10: mirror.conic must be omitted for the family sphere",
    ),
    (
        "rim_radius_mm = 40",
        "rim_radius_mm = 40\nplane_distance_mm = 700",
        "line 11: plane_distance_mm must be omitted for the equidistant mapping; it applies to ground-plane",
    ),
    (
        'mapping = "equidistant"',
        'mapping = "ground-plane"\nplane_distance_mm = -700',
        r"mine\.toml line 10: plane_distance_mm must be between 0\.001 and 1e\+07 mm; got -700",
    ),
    (
        'mapping = "equidistant"',
        'mapping = "ground-plane"',
        "line 9: the ground-plane mapping requires plane_distance_mm",
    ),
    (
        'mapping = "equidistant"',
        'mapping = "cylinder"\ncylinder_radius_mm = 30',
        "line 10: cylinder_radius_mm must be greater than rim_radius_mm = 40; got 30",
    ),
    (
        'mapping = "equidistant"',
        'mapping = "cylinder"\ncylinder_radius_mm = "far"',
        "line 10: mirror.cylinder_radius_mm must be a valid number",
    ),
    (
        'mapping = "equidistant"',
        'family = "sphere"\ncylinder_radius_mm = 300',
        "line 10: mirror.cylinder_radius_mm must be omitted for the family sphere",
    ),
    (
        'quantity = "total_blur_px"\nat_most = 4',
        'quantity = "total_blur_deg"\nat_most = 0',
        "line 21: limit of total_blur_deg: at_most must be greater than 0; got 0",
    ),
    (
        "at_most = 4\n",
        'at_most = 2\n[[limit]]\nquantity = "total_blur_t_px"\nat_least = 3\n',
        "line 24: limit 2 contradicts limit 1: total_blur_t_px at least 3 and total_blur_px at most 2, which",
    ),
    (
        "[[limit]]\nquantity",
        "[limit]\nquantity",
        r"mine\.toml must be valid TOML: Cannot overwrite a value \(at line 25, column 8\)",
    ),
    ("\nname", "\nformat = 7\nname", "line 2: format must be .* got 7"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD, ids=[m[:45] for *_, m in BAD])
def test_file_errors_name_line_and_valid_values(old, new, message):
    assert old in GOOD
    with pytest.raises(SpecError, match=message) as e:
        parse_requirements(GOOD.replace(old, new, 1), source="mine.toml")
    assert str(e.value).startswith("mine.toml")
    assert "\n" not in str(e.value)


def test_limit_at_single_angle_is_read():
    requirements = parse_requirements(GOOD.replace("[20, 100]", "[90, 90]"))
    assert requirements.limits[1].omega_deg == (90.0, 90.0)


def test_byte_order_mark_is_ignored(tmp_path):
    (tmp_path / "r.toml").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_requirements(tmp_path / "r.toml").name == "mine"
    assert parse_requirements("\ufeff" + GOOD).name == "mine"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "x", None, True, [1.0]])
def test_non_numeric_limit_is_rejected(value):
    with pytest.raises(
        InvalidParameter, match=r"at_most.* of total_blur_px|total_blur_px must have at_most or"
    ):
        Limit("total_blur_px", at_most=value)


def test_limits_of_disjoint_ranges_do_not_conflict():
    apart = (
        Limit("aspect", at_most=0.5, omega_deg=(0.0, 19.0)),
        Limit("aspect", at_least=0.8, omega_deg=(20.0, 100.0)),
    )
    assert apart[0].contradicts(apart[1]) is None
    assert "at least 0.8 and at most 0.5" in Limit("aspect", at_most=0.5).contradicts(apart[1])


WITHIN, AROUND = (20.0, 60.0), (10.0, 90.0)


@pytest.mark.parametrize(
    ("low", "high", "is_contradiction"),
    [
        (Limit("total_blur_s_deg", at_least=0.3), Limit("total_blur_deg", at_most=0.2), True),
        (
            Limit("total_blur_deg", at_least=0.3),
            Limit("total_blur_s_deg", at_most=0.2),
            False,
        ),  # the other part may be larger
        (
            Limit("resolution_px_per_deg", at_least=4.0),
            Limit("width_px_per_deg", at_most=3.0),
            True,
        ),
        (
            Limit("dh_domega_px_per_deg", at_least=4.0),
            Limit("width_px_per_deg", at_most=3.0),
            False,
        ),
        (Limit("sag_mm", at_least=40.0), Limit("length_mm", at_most=30.0), True),
        (
            Limit("total_blur_t_px", at_least=3.0, omega_deg=(0, 20)),
            Limit("total_blur_px", at_most=2.0, omega_deg=(21, 90)),
            False,
        ),
        (
            Limit("viewpoint_spread_mm", None, 9.0, WITHIN),
            Limit("viewpoint_spread_mm", 5.0, None, AROUND),
            True,
        ),
        (
            Limit("viewpoint_spread_mm", None, 9.0, AROUND),
            Limit("viewpoint_spread_mm", 5.0, None, WITHIN),
            False,
        ),
        (Limit("area_ratio", None, 0.9, AROUND), Limit("area_ratio", 0.5, None, WITHIN), True),
        (Limit("area_ratio", None, 0.9, WITHIN), Limit("area_ratio", 0.5, None, AROUND), False),
    ],
)
def test_contradictory_limits_are_rejected(low, high, is_contradiction):
    assert (low.contradicts(high) is not None) == is_contradiction
    assert (high.contradicts(low) is not None) == is_contradiction


def test_single_viewpoint_may_be_required():
    assert Limit("viewpoint_spread_mm", at_most=0.0).at_most == 0.0


# -- created in Python
# ------------------------------------------------------------------------------


def constructed_requirements():
    return om.Requirements(
        name="mine",
        field=om.FieldRequirements(
            omega_max_deg=120, omega_min_deg=10.0, object_distance_mm=(500, np.inf)
        ),
        mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=40),
        lens=om.LensRequirements(theta_max_deg=(10, 14.0), f_number=5.6),
        imager=Imager(1280, 1024, 4.8),
        limits=[
            om.Limit("total_blur_px", 4),
            om.Limit("aspect", at_least=0.8, at_most=1.25, omega_deg=[20, 100]),
        ],
    )


def test_file_and_dataclasses_are_equivalent():
    assert constructed_requirements() == parse_requirements(GOOD)
    assert hash(constructed_requirements()) == hash(parse_requirements(GOOD))


OTHERS = [
    """
mirror = {optimise = "worst_blur_deg", shape = "spline:9", rim_radius_mm = [30, 40]}
lens.kind = "orthographic"
""",
    """
mirror = {family = "ellipsoid", conic = [-0.5, 2], rim_radius_mm = 30}
lens = {focal_length_mm = [4, 16], focus_mm = 300}
""",
    """
lens.theta_max_deg = 10
mount.camera_looks = "down"
imager = {width_px = 64, height_px = 48, pixel_pitch_um = 3, centre_px = [31.0, 24.5]}
[mirror]
mapping = "tabulated-mapping"
omega_deg = [0, 30, 60, 90, 120, 150]
height = [0, 1, 2, 3, 4, 5.5]
rim_radius_mm = 3
""",
]
ALL = [
    GOOD,
    *(f"name = 'x'\nnotes = 'a\u00b5b'\nfield.omega_max_deg = 150\n{text}" for text in OTHERS),
]


@pytest.mark.parametrize("text", ALL)
def test_requirements_round_trip_through_file(text):
    requirements = parse_requirements(text)
    assert parse_requirements(format_requirements(requirements)) == requirements
    tables = tomllib.loads(format_requirements(requirements))
    for section, entries in tomllib.loads(text).items():  # the file has the same entries
        if isinstance(entries, dict):
            assert {k: tables[section][k] for k in entries} == entries


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda: om.FieldRequirements(omega_max_deg=200),
            "field.omega_max_deg must be less than or equal",
        ),
        (
            lambda: om.FieldRequirements(omega_max_deg="wide"),
            "field.omega_max_deg must be a valid num",
        ),
        (lambda: om.LensRequirements(f_number=(8, 4)), r"lens.f_number must be a number from 0.1"),
        (
            lambda: replace(constructed_requirements().mirror, apex="sharp"),
            "mirror.apex must be one of",
        ),
        (
            lambda: replace(constructed_requirements(), lens=om.LensRequirements()),
            "lens requires focal_length_mm or theta",
        ),
        (
            lambda: replace(constructed_requirements(), field=3),
            "field must be of kind FieldRequirements; got 3",
        ),
        (
            lambda: replace(constructed_requirements(), limits=[3]),
            "limits must be a list of limits; got 3",
        ),
        (
            lambda: replace(
                constructed_requirements(), field=om.FieldRequirements(omega_max_deg=90)
            ),
            r"limit.omega_deg must be \[FROM, TO\] up to 90 deg",
        ),
    ],
)
def test_python_errors_agree_with_file_errors(change, message):
    with pytest.raises(OmnimirrorError, match=f"^{message}") as e:
        change()
    assert "\n" not in str(e.value)


def test_numpy_numbers_are_accepted():
    field = om.FieldRequirements(
        omega_max_deg=np.int64(120), object_distance_mm=np.array([500, np.inf])
    )
    assert field == constructed_requirements().field.__class__(
        omega_max_deg=120.0, object_distance_mm=(500.0, np.inf)
    )


@pytest.mark.parametrize(
    "change", [{"image_radius_px": 0}, {"image_radius_px": float("nan")}, {"mode": "Exact"}]
)
def test_requirements_without_imager_or_with_unknown_mode_are_rejected(change):
    with pytest.raises(InvalidParameter, match=next(iter(change))):
        DesignProblem(**change)


def test_unreadable_files_are_rejected(tmp_path):
    with pytest.raises(SpecError, match=r"requirement file .*no\.toml: the file does not exist"):
        load_requirements(tmp_path / "no.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SpecError, match=r"the file must be text in UTF-8"):
        load_requirements(tmp_path / "b.toml")


@pytest.mark.parametrize(
    ("lens", "valid"),
    [
        ("focal_length_mm = 8.0\nfocus_mm = [3, 5]", "8"),
        ("focus_mm = -4\ntheta_max_deg = 12.0", "0"),
    ],
)
def test_focus_below_focal_length_is_rejected(lens, valid):
    text = f'field.omega_max_deg = 100\n[mirror]\nmapping = "equiangular"\nrim_radius_mm = 20\n[lens]\n{lens}\n'
    with pytest.raises(
        SpecError,
        match=rf"line [67]: lens.focus_mm must be greater than the focal length, {valid} mm",
    ):
        parse_requirements(text)
