"""Sensor files: round trip, and errors with their positions."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError, SpecError
from omnimirror.base.parameters import Uncertainty
from omnimirror.base.toml_validation import SourceLocator
from omnimirror.cameras.camera import Mount
from omnimirror.design.sensor_file_template import sensor_template
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.image_sensor import Imager, ImagerPose
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import EvenPolynomial
from omnimirror.optics.mirrors.mirror import MirrorForm, MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors, format_sensor, load_sensor, parse_sensor
from omnimirror.optics.thermal import Thermal
from tests.conftest import M

GOOD = """
[mirror]
kind = "sphere"
radius_mm = 50.0
rim_radius_mm = 44

[lens]
kind = "perspective"
focal_length_mm = 11.6
f_number = 4.0
focus_distance_mm = 218.0

[imager]
width_px = 1024
height_px = 1024
pixel_pitch_um = 5.2

[mount]
mirror_distance_mm = 186.0
"""


def test_bundled_sensor_list():
    assert set(bundled_sensors()) >= {
        "paper-spherical",
        "paper-equidistant",
        "paper-hyperboloidal",
        "prototype-spherical",
        "prototype-hyperboloidal",
        "paraboloid-telecentric",
        "exact-equidistant",
    }
    for name, rim, focus in (
        ("spherical", 43.905, 212),
        ("equidistant", 43.9, 205),
        ("hyperboloidal", 43.9, 190),
    ):
        sensor = load_sensor(f"paper-{name}")
        assert sensor.mirror.rim_radius_mm == rim
        assert sensor.lens == Perspective(11.6, 4.0, focus)
        assert sensor.imager == Imager(1024, 1024, 5.2)
    assert load_sensor("paper-spherical").mirror_distance_mm == pytest.approx(4.110 * M)
    assert load_sensor("paper-hyperboloidal").mirror_distance_mm == pytest.approx(
        3.5505227 * M, abs=1e-7 * M
    )
    assert load_sensor("exact-equidistant").mirror_distance_mm == pytest.approx(
        3.92426760151 * M, rel=1e-11
    )


def test_prototypes_match_section_5_1():
    sphere, hyperboloid = load_sensor("prototype-spherical"), load_sensor("prototype-hyperboloidal")
    assert (sphere.mirror.radius_mm, sphere.mirror.rim_radius_mm) == (50.0, 44.0)
    assert sphere.field_deg[1] == pytest.approx(135, abs=1e-4)
    assert hyperboloid.mirror.rim_radius_mm == 30.0
    assert hyperboloid.field_deg[1] == pytest.approx(105, abs=1e-3)
    assert hyperboloid.mirror_distance_mm == pytest.approx(
        hyperboloid.mirror.single_viewpoint_distance, rel=1e-15
    )


def test_bundled_images_fit_imager(bundled):
    u, v = bundled.imager.centre
    assert bundled.rim_radius_px <= min(u, v) + 0.5


def test_sensor_file_round_trip(any_sensor, tmp_path):
    om.save_sensor(any_sensor, tmp_path / "s.toml")
    assert load_sensor(tmp_path / "s.toml") == any_sensor


def test_bundled_sensor_round_trip(bundled):
    assert parse_sensor(format_sensor(bundled)) == bundled


@given(
    name=st.text(max_size=30),
    notes=st.text(max_size=80),
    coefficients=st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=6),
    distance=st.floats(1e-3, 1e6),
    azimuth=st.floats(-360, 360),
    orientation=st.sampled_from(["up", "down", "forward"]),
    centre=st.none() | st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
)
def test_random_sensor_round_trip(
    name, notes, coefficients, distance, azimuth, orientation, centre
):
    sensor = om.Sensor(
        EvenPolynomial(tuple(coefficients), 10.0),
        Perspective(11.6, 4.0, 212.0),
        Imager(640, 480, 3.45, centre),
        Mount(orientation, azimuth, True),
        distance,
        name,
        notes,
    )
    assert parse_sensor(format_sensor(sensor)) == sensor


def test_changes_replace_and_remove_entries(tmp_path, monkeypatch):
    plain = load_sensor("paper-spherical")
    changes = {"lens": {"f_number": 5.6}, "notes": None, "name": None}
    changed = load_sensor("paper-spherical", changes)
    assert changed == replace(
        plain, lens=replace(plain.lens, f_number=5.6), name="sensor", notes=""
    )
    assert parse_sensor(format_sensor(plain), changes=changes) == changed
    # a file of the name of a bundled sensor precedes it
    (tmp_path / "paper-spherical").write_text(GOOD)
    monkeypatch.chdir(tmp_path)
    assert load_sensor("paper-spherical") == parse_sensor(GOOD) != plain
    with pytest.raises(
        SpecError,
        match=r"^sensor file or bundled sensor 'zzzz' does not exist; the bundled sensors",
    ):
        load_sensor("zzzz")
    with pytest.raises(
        SpecError, match=r"'paper-sferical' does not exist; .*\? The bundled sensors"
    ):
        load_sensor("paper-sferical")


def test_optional_tables_round_trip():
    """Only specified tables and entries are written."""
    plain = load_sensor("folded-spherical")
    covariance = ((0.25, 0.0), (0.0, 0.01))
    names = ("mirror_distance_mm", "focus_distance_mm")
    tables, entries = ("secondary", "uncertainty", "thermal"), ("field_deg", "marginal_sigmas")
    for uncertainty in (
        None,
        Uncertainty(names, covariance),
        Uncertainty(names, covariance, field_deg=90.0, marginal_sigmas=(0.5, 0.1)),
    ):
        for thermal in (None, Thermal()):
            for secondary in (None, plain.secondary):
                sensor = replace(
                    plain, uncertainty=uncertainty, thermal=thermal, secondary=secondary
                )
                data = tomllib.loads(format_sensor(sensor))
                is_present = [part is not None for part in (secondary, uncertainty, thermal)]
                assert [name in data for name in tables] == is_present
                is_full = uncertainty is not None and uncertainty.field_deg is not None
                table = data.get("uncertainty", {})
                assert [name in table for name in entries] == [is_full] * 2
                assert parse_sensor(format_sensor(sensor)) == sensor
                assert parse_sensor(format_sensor(sensor)).uncertainty == uncertainty


def test_camera_file_is_no_sensor_file():
    camera = "[camera]\nkind = 'unified'\n"
    with pytest.raises(SpecError, match=r"^mine must be a sensor file; got a camera file, which"):
        parse_sensor(camera, "mine")
    with pytest.raises(SpecError, match="unknown entry camera"):
        parse_sensor(camera + GOOD, "mine")


def test_default_poses_omitted_from_file():
    plain = om.load_sensor("paper-spherical")
    moved = replace(
        plain,
        mirror_pose=MirrorPose(0.1, -0.2, float("0"), float("0")),
        mirror_form=MirrorForm((5,), (2.0,)),
        imager_pose=ImagerPose(tilt_x_deg=0.5),
        mount=replace(plain.mount, pitch_deg=2.0, roll_deg=-1.0),
    )
    tables, entries = ("mirror_pose", "mirror_form", "imager_pose"), ("pitch_deg", "roll_deg")
    for sensor, is_moved in ((plain, False), (moved, True)):
        data = tomllib.loads(format_sensor(sensor))
        assert [name in data for name in tables] == [is_moved] * 3
        assert [name in data.get("mount", {}) for name in entries] == [is_moved] * 2
        assert set(data.get("mirror_pose", ())) <= {"decentre_x_mm", "decentre_y_mm"}
        assert parse_sensor(format_sensor(sensor)) == sensor


def test_profile_file_relative_to_sensor_file(tmp_path):
    x = np.linspace(0, 44, 60)
    rows = "\n".join(f"{a},{50 - np.sqrt(2500 - a * a)}" for a in x)
    (tmp_path / "profile.csv").write_text(f"# measured\nx_mm,z_mm\n{rows}\n")
    text = GOOD.replace(
        '"sphere"\nradius_mm = 50.0\nrim_radius_mm = 44', '"sampled"\nprofile_csv = "profile.csv"'
    )
    (tmp_path / "s.toml").write_text(text)
    sensor, sphere = load_sensor(tmp_path / "s.toml"), parse_sensor(GOOD)
    angles = np.linspace(0, 130, 14)
    np.testing.assert_allclose(
        om.evaluate(sensor, angles).h_px, om.evaluate(sphere, angles).h_px, rtol=1e-7
    )
    assert parse_sensor(format_sensor(sensor)) == sensor  # including the points


def test_template_is_valid_sensor():
    sensor = parse_sensor(sensor_template("mine"))
    assert sensor.name == "mine"
    assert sensor.field_deg[1] == pytest.approx(135, abs=0.01)


HOUSED = (
    GOOD
    + """
[housing.camera]
diameter_mm = 30.0

[housing.rod]
end_diameter_mm = 2.0

[housing.tube]

[housing.rim]
width_mm = 1.5
"""
)


def test_housing_round_trip_with_defaults():
    sensor = parse_sensor(HOUSED)
    assert sensor.housing == Housing(CameraBody(30.0), Rod(end_diameter_mm=2.0), Tube(), Rim(1.5))
    assert parse_sensor(format_sensor(sensor)) == sensor
    dome = replace(sensor, housing=Housing(shell=Dome(centre_mm=-80.0)))
    assert parse_sensor(format_sensor(dome)) == dome
    assert "housing" not in format_sensor(parse_sensor(GOOD))
    parts = tomllib.loads(format_sensor(sensor))["housing"]
    assert list(parts) == ["camera", "rod", "rim", "tube"]
    assert list(tomllib.loads(format_sensor(dome))["housing"]) == ["dome"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[housing.camera]",
            "[housing.kamera]",
            r"line 21: unknown entry housing.kamera; did you mean camera\?",
        ),
        (
            "[housing.tube]",
            "[housing.tube]\ndiameter_mm = 90",
            r"line 27: diameter_mm of the tube must be at least 97 mm.* got 90",
        ),
        (
            "[housing.tube]",
            "[housing.tube]\nwall_mm = 0",
            "line 28: housing.tube.wall_mm must be greater than",
        ),
        (
            "[housing.tube]",
            "[housing.tube]\nwall = 3",
            r"line 28: unknown entry housing.tube.wall; did you mean wall_mm",
        ),
        ("diameter_mm = 30.0\n", "", "line 21: housing.camera.diameter_mm is missing"),
        (
            "[housing.tube]",
            "[housing.dome]\n[housing.tube]",
            "housing must not have both a tube and a dome",
        ),
        (
            "[housing.rod]\nend_diameter_mm",
            "[housing]\nrod",
            r"line 25: housing.rod must be a table \[housing.rod\]; got 2.0",
        ),
        (
            "end_diameter_mm = 2.0",
            "gap_mm = 200",
            "line 24: gap_mm must be less than 186 mm, the distance from lens to mirror; got 200",
        ),
    ],
)
def test_invalid_housing_error_reports_line(old, new, message):
    text = HOUSED.replace(old, new)
    assert text != HOUSED
    with pytest.raises(SpecError, match=message):
        parse_sensor(text)


def test_template_housing_is_valid():
    head, tail = sensor_template("mine").split("# [housing.camera]")
    sensor = parse_sensor(
        head
        + "\n".join(line.removeprefix("# ") for line in ("# [housing.camera]" + tail).splitlines())
    )
    assert {ring.part for ring in sensor.obscurations} >= {"camera", "rod", "tube's base"}


BAD = [
    (
        "[mirror]\nkind = ",
        "[mirror\nkind = ",
        r"mine\.toml must be valid TOML: Expected '\]' at the end of a table declaration \(at line 2, c",
    ),
    ("[mount]", "[mout]", r"line 18: unknown entry mout; did you mean mount\?"),
    (
        "radius_mm = 50.0",
        "raduis_mm = 50.0",
        r"line 4: unknown entry mirror.raduis_mm; did you mean radius_mm\?",
    ),
    ("radius_mm = 50.0\n", "", "line 2: mirror.radius_mm is missing .radius of the sphere"),
    (
        "radius_mm = 50.0",
        'radius_mm = "50"',
        "line 4: mirror.radius_mm must be a valid number; got '50'",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = -50.0",
        "line 4: mirror.radius_mm must be greater than or equal to .* got -50.0",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = nan",
        "line 4: mirror.radius_mm must be a finite number; got nan",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = 40.0",
        "line 2: rim_radius_mm must be less than 40 mm, where the sphere ends; got 44",
    ),
    (
        'kind = "sphere"',
        'kind = "spere"',
        r"line 3: unknown mirror.kind 'spere'; did you mean sphere\?",
    ),
    ('kind = "sphere"\n', "", "line 2: mirror.kind is missing; use sphere, hyperboloid"),
    (
        'kind = "perspective"',
        'kind = "fisheye"',
        "line 8: unknown lens.kind 'fisheye'; use perspective",
    ),
    ("f_number = 4.0", "f_number = 0", "line 10: lens.f_number must be greater"),
    (
        "focus_distance_mm = 218.0",
        "focus_distance_mm = 11.0",
        "line 7: focus_distance_mm must be greater than focal_length_mm",
    ),
    (
        "width_px = 1024",
        "width_px = 10.5",
        "line 14: imager.width_px must be a valid integer; got 10.5",
    ),
    (
        "pixel_pitch_um = 5.2",
        "pixel_pitch_um = true",
        "line 16: imager.pixel_pitch_um must be a valid number; got True",
    ),
    (
        "pixel_pitch_um = 5.2",
        "centre_px = [1, 2, 3]\npixel_pitch_um = 5.2",
        r"centre_px must be a pair \(u, v\); got 3",
    ),
    (
        "mirror_distance_mm = 186.0",
        "mirror_distance_mm = -1.0",
        "line 19: mount.mirror_distance_mm must be",
    ),
    (
        "mirror_distance_mm = 186.0",
        'camera_looks = "left"',
        "mount.camera_looks must be one of 'up', 'down'",
    ),
    ("mirror_distance_mm = 186.0", "", "must be finite and greater than 0 for a perspective lens"),
    (
        "mirror_distance_mm = 186.0",
        "distance_mm = 186.0",
        r"unknown entry mount.distance_mm; did you mean mirror_distance_mm\?",
    ),
    (
        "[imager]\nwidth_px = 1024\nheight_px = 1024\npixel_pitch_um = 5.2\n",
        "",
        r"the table \[imager\] is missing",
    ),
    ("\n[mirror]", "format = 9\n[mirror]", "line 1: format must be 1 .* got 9"),
    ("\n[mirror]", "name = 3\n[mirror]", "line 1: name must be a string in quotes; got 3"),
    (
        'kind = "sphere"\nradius_mm = 50.0\nrim_radius_mm = 44',
        'kind = "sampled"\nprofile_csv = "no.csv"',
        "cannot read the profile",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD, ids=[m[:40] for *_, m in BAD])
def test_invalid_file_error_reports_line_and_valid_values(old, new, message):
    assert old in GOOD
    with pytest.raises(SpecError, match=message) as e:
        parse_sensor(GOOD.replace(old, new, 1), source="mine.toml", folder=Path())
    assert str(e.value).startswith("mine.toml")
    assert "\n" not in str(e.value)


def test_unreadable_files_rejected(tmp_path):
    with pytest.raises(
        SpecError,
        match=r"sensor file or bundled sensor 'paper-sferical' does not exist; did you mean paper-spherical\?",
    ):
        load_sensor("paper-sferical")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SpecError, match=r"the file must be text in UTF-8"):
        load_sensor(tmp_path / "b.toml")
    with pytest.raises(SpecError, match=r"cannot read the sensor file|there is no sensor file"):
        load_sensor(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("x,z\n", "must contain lines of two numbers"),
        ("0,0\n1,0.1\n2,oops\n", "line 3: the line must contain two numbers .* got '2,oops'"),
        ("0,0\n1,0.1\n", "a sampled profile must have at least 6 points; got 2"),
        ("1,0\n2,1\n3,2\n4,3\n5,4\n6,5\n", "x_mm must start with 0, on the axis; got 1"),
        ("0,0\n2,1\n1,2\n4,3\n5,4\n6,5\n", "must increase; got"),
    ],
)
def test_invalid_profiles_rejected(tmp_path, content, message):
    from omnimirror.optics.mirrors import SampledProfile

    (tmp_path / "p.csv").write_text(content)
    with pytest.raises(OmnimirrorError, match=message):
        SampledProfile.from_csv(tmp_path / "p.csv")


def test_sampled_profile_rejects_rim_beyond_points():
    from omnimirror.optics.mirrors import SampledProfile

    x = tuple(np.linspace(0, 10, 11))
    with pytest.raises(
        OmnimirrorError,
        match="rim_radius_mm must be at most 10 mm, the last point of the profile; got 12",
    ):
        SampledProfile(x, tuple(0.01 * np.square(x)), rim_radius_mm=12.0)
    with pytest.raises(OmnimirrorError, match="equally many values; got 11 and 10"):
        SampledProfile(x, x[:-1])
    with pytest.raises(OmnimirrorError, match="apex must be one of smooth, pointed; got 'round'"):
        SampledProfile(x, x, apex="round")
    pointed = SampledProfile(x, tuple(np.multiply(x, 0.5)), apex="pointed")
    assert float(pointed.slope(0.0)) == pytest.approx(0.5)


def test_failed_save_keeps_existing_file(tmp_path):
    folder = tmp_path / "taken"
    folder.write_text("a file where a folder would have to be")
    with pytest.raises(OmnimirrorError, match="cannot write"):
        om.save_sensor(load_sensor("paper-spherical"), folder / "s.toml")
    assert folder.read_text().startswith("a file")
    replaced = replace(load_sensor("paper-spherical"), name="second")
    om.save_sensor(replaced, tmp_path / "s.toml")
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("mirror", "radius_mm"), 8),
        (("mirror", "missing"), 7),
        (("lens", "kind"), 10),
        (("limit", "1", "at_most"), 18),
        (("limit", "1", "field", "in_a_line"), 19),
        (("imager", "width_px"), 21),
        (("nothing",), None),
    ],
)
def test_line_numbers_of_dotted_and_quoted_keys(path, line):
    text = """# a comment with ''' in it
name = "x # [lens]"
notes = '''a
[mirror]
radius_mm = 3
'''
mirror.kind = 'sphere'
mirror . "radius_mm" = 50.0
[lens]
kind = "a"
list = [
  1,
]
[[limit]]
quantity = "a"
[[ limit ]]
quantity = "b"
at_most = 3
field = {omega_max_deg = 9}
["imager"]
width_px = 3
"""
    assert SourceLocator(text, "a.toml").line(path) == line
