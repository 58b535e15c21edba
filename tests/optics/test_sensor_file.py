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
from omnimirror.cameras.frames import Mount
from omnimirror.design.sensor_file_template import sensor_template
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.image_sensor import Imager, ImagerPose
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import EvenPolynomial
from omnimirror.optics.mirrors.as_built import MirrorForm, MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors, format_sensor, load_sensor, parse_sensor
from omnimirror.optics.toml_validation import SourceLocator
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


def test_bundled_sensors_are_those_of_the_paper_and_more():
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


def test_prototypes_are_as_section_5_1_says():
    sphere, hyperboloid = load_sensor("prototype-spherical"), load_sensor("prototype-hyperboloidal")
    assert (sphere.mirror.radius_mm, sphere.mirror.rim_radius_mm) == (50.0, 44.0)
    assert sphere.field_deg[1] == pytest.approx(135, abs=1e-4)
    assert hyperboloid.mirror.rim_radius_mm == 30.0
    assert hyperboloid.field_deg[1] == pytest.approx(105, abs=1e-3)
    assert hyperboloid.mirror_distance_mm == pytest.approx(
        hyperboloid.mirror.single_viewpoint_distance, rel=1e-15
    )


def test_every_bundled_sensor_has_its_image_on_the_imager(bundled):
    u, v = bundled.imager.centre
    assert bundled.rim_radius_px <= min(u, v) + 0.5


def test_round_trip_without_loss(any_sensor, tmp_path):
    om.save_sensor(any_sensor, tmp_path / "s.toml")
    assert load_sensor(tmp_path / "s.toml") == any_sensor


def test_bundled_round_trip_without_loss(bundled):
    assert parse_sensor(format_sensor(bundled)) == bundled


@given(
    name=st.text(max_size=30),
    notes=st.text(max_size=80),
    coefficients=st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=6),
    distance=st.floats(1e-3, 1e6),
    azimuth=st.floats(-360, 360),
    looks=st.sampled_from(["up", "down", "forward"]),
    centre=st.none() | st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
)
def test_any_sensor_round_trips_without_loss(
    name, notes, coefficients, distance, azimuth, looks, centre
):
    sensor = om.Sensor(
        EvenPolynomial(tuple(coefficients), 10.0),
        Perspective(11.6, 4.0, 212.0),
        Imager(640, 480, 3.45, centre),
        Mount(looks, azimuth, True),
        distance,
        name,
        notes,
    )
    assert parse_sensor(format_sensor(sensor)) == sensor


def test_what_stands_in_place_is_not_written_and_what_does_not_comes_back():
    plain = om.load_sensor("paper-spherical")
    moved = replace(
        plain,
        mirror_pose=MirrorPose(0.1, -0.2),
        mirror_form=MirrorForm((5,), (2.0,)),
        imager_pose=ImagerPose(tilt_x_deg=0.5),
        mount=replace(plain.mount, pitch_deg=2.0, roll_deg=-1.0),
    )
    tables, entries = ("mirror_pose", "mirror_form", "imager_pose"), ("pitch_deg", "roll_deg")
    for sensor, is_moved in ((plain, False), (moved, True)):
        data = tomllib.loads(format_sensor(sensor))
        assert [name in data for name in tables] == [is_moved] * 3
        assert [name in data.get("mount", {}) for name in entries] == [is_moved] * 2
        assert parse_sensor(format_sensor(sensor)) == sensor


def test_a_profile_beside_the_sensor_file_is_followed(tmp_path):
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


def test_the_template_of_init_is_a_working_sensor():
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


def test_a_housing_comes_back_with_what_was_left_out():
    sensor = parse_sensor(HOUSED)
    assert sensor.housing == Housing(CameraBody(30.0), Rod(end_diameter_mm=2.0), Tube(), Rim(1.5))
    assert parse_sensor(format_sensor(sensor)) == sensor
    dome = replace(sensor, housing=Housing(shell=Dome(centre_mm=-80.0)))
    assert parse_sensor(format_sensor(dome)) == dome
    assert "housing" not in format_sensor(parse_sensor(GOOD))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[housing.camera]",
            "[housing.kamera]",
            r"line 21: housing.kamera is not known; did you mean camera\?",
        ),
        (
            "[housing.tube]",
            "[housing.tube]\ndiameter_mm = 90",
            r"line 27: a tube of 90 mm .* valid from 97 mm",
        ),
        ("[housing.tube]", "[housing.tube]\nwall_mm = 0", "line 28: housing.tube.wall_mm = 0"),
        (
            "[housing.tube]",
            "[housing.tube]\nwall = 3",
            r"line 28: housing.tube.wall is not known; did you mean wall_mm",
        ),
        ("diameter_mm = 30.0\n", "", "line 21: housing.camera.diameter_mm is missing"),
        ("[housing.tube]", "[housing.dome]\n[housing.tube]", "housing has both a tube and a dome"),
        (
            "[housing.rod]\nend_diameter_mm",
            "[housing]\nrod",
            "line 25: housing.rod = 2.0 is not a table",
        ),
        (
            "end_diameter_mm = 2.0",
            "gap_mm = 200",
            "line 24: gap_mm = 200 leaves no rod; it is valid below 186 mm",
        ),
    ],
)
def test_a_housing_that_cannot_be_is_named_with_its_line(old, new, message):
    text = HOUSED.replace(old, new)
    assert text != HOUSED
    with pytest.raises(SpecError, match=message):
        parse_sensor(text)


def test_the_housing_of_the_template_works():
    head, tail = sensor_template("mine").split("# [housing.camera]")
    sensor = parse_sensor(
        head
        + "\n".join(line.removeprefix("# ") for line in ("# [housing.camera]" + tail).splitlines())
    )
    assert {ring.part for ring in sensor.obscurations} >= {"camera", "rod", "tube's base"}


BAD = [
    ("[mirror]\nkind = ", "[mirror\nkind = ", "is not valid TOML"),
    ("[mount]", "[mout]", r"line 18: mout is not known; did you mean mount\?"),
    (
        "radius_mm = 50.0",
        "raduis_mm = 50.0",
        r"line 4: mirror.raduis_mm is not known; did you mean radius_mm\?",
    ),
    ("radius_mm = 50.0\n", "", "line 2: mirror.radius_mm is missing .radius of the sphere"),
    (
        "radius_mm = 50.0",
        'radius_mm = "50"',
        "line 4: mirror.radius_mm = '50': it should be a valid number",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = -50.0",
        "line 4: mirror.radius_mm = -50.0: it should be greater than or equal to",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = nan",
        "line 4: mirror.radius_mm = nan: it should be a finite number",
    ),
    (
        "radius_mm = 50.0",
        "radius_mm = 40.0",
        "line 2: the sphere ends 40 mm from the axis .* rim_radius_mm = 44 is valid",
    ),
    (
        'kind = "sphere"',
        'kind = "spere"',
        r"line 3: mirror.kind = 'spere' is not known; did you mean sphere\?",
    ),
    ('kind = "sphere"\n', "", "line 2: mirror.kind is missing; valid are sphere, hyperboloid"),
    (
        'kind = "perspective"',
        'kind = "fisheye"',
        "line 8: lens.kind = 'fisheye' is not known; valid are perspective",
    ),
    ("f_number = 4.0", "f_number = 0", "line 10: lens.f_number = 0: it should be greater"),
    (
        "focus_distance_mm = 218.0",
        "focus_distance_mm = 11.0",
        "line 7: focus_distance_mm = 11 is not beyond the focal",
    ),
    (
        "width_px = 1024",
        "width_px = 10.5",
        "line 14: imager.width_px = 10.5: it should be a valid integer",
    ),
    (
        "pixel_pitch_um = 5.2",
        "pixel_pitch_um = true",
        "line 16: imager.pixel_pitch_um = True: it should be a valid number",
    ),
    (
        "pixel_pitch_um = 5.2",
        "centre_px = [1, 2, 3]\npixel_pitch_um = 5.2",
        "centre_px has 3 numbers; it needs two",
    ),
    (
        "mirror_distance_mm = 186.0",
        "mirror_distance_mm = -1.0",
        "line 19: mount.mirror_distance_mm = -1.0: it should be",
    ),
    (
        "mirror_distance_mm = 186.0",
        'camera_looks = "left"',
        "mount.camera_looks = 'left' is not one of 'up', 'down'",
    ),
    ("mirror_distance_mm = 186.0", "", "a perspective lens needs a finite distance"),
    (
        "mirror_distance_mm = 186.0",
        "distance_mm = 186.0",
        r"distance_mm is not known; did you mean mirror_distance_mm\?",
    ),
    (
        "[imager]\nwidth_px = 1024\nheight_px = 1024\npixel_pitch_um = 5.2\n",
        "",
        r"there is no \[imager\] table",
    ),
    ("\n[mirror]", "format = 9\n[mirror]", "line 1: format = 9 is not known to this version"),
    ("\n[mirror]", "name = 3\n[mirror]", "line 1: name = 3 is not a text in quotes"),
    (
        'kind = "sphere"\nradius_mm = 50.0\nrim_radius_mm = 44',
        'kind = "sampled"\nprofile_csv = "no.csv"',
        "cannot read the profile",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD, ids=[m[:40] for *_, m in BAD])
def test_a_wrong_file_says_where_and_what_would_be_valid(old, new, message):
    assert old in GOOD
    with pytest.raises(SpecError, match=message) as e:
        parse_sensor(GOOD.replace(old, new, 1), source="mine.toml", folder=Path())
    assert str(e.value).startswith("mine.toml")
    assert "\n" not in str(e.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(
        SpecError,
        match=r"no sensor file or bundled sensor 'paper-sferical'; did you mean paper-spherical\?",
    ):
        load_sensor("paper-sferical")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SpecError, match="it is not a text file"):
        load_sensor(tmp_path / "b.toml")
    with pytest.raises(SpecError, match=r"cannot read the sensor file|there is no sensor file"):
        load_sensor(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("x,z\n", "holds no line of two numbers"),
        ("0,0\n1,0.1\n2,oops\n", "line 3: '2,oops' is not two numbers"),
        ("0,0\n1,0.1\n", "a sampled profile of 2 points is too short"),
        ("1,0\n2,1\n3,2\n4,3\n5,4\n6,5\n", "x_mm starts at 1 mm"),
        ("0,0\n2,1\n1,2\n4,3\n5,4\n6,5\n", "does not grow after point 1"),
    ],
)
def test_wrong_profiles(tmp_path, content, message):
    from omnimirror.optics.mirrors import SampledProfile

    (tmp_path / "p.csv").write_text(content)
    with pytest.raises(OmnimirrorError, match=message):
        SampledProfile.from_csv(tmp_path / "p.csv")


def test_sampled_profile_refuses_a_rim_beyond_its_points():
    from omnimirror.optics.mirrors import SampledProfile

    x = tuple(np.linspace(0, 10, 11))
    with pytest.raises(
        OmnimirrorError, match="rim_radius_mm = 12 lies beyond the last point of the profile"
    ):
        SampledProfile(x, tuple(0.01 * np.square(x)), rim_radius_mm=12.0)
    with pytest.raises(OmnimirrorError, match="11 points and z_mm 10"):
        SampledProfile(x, x[:-1])
    with pytest.raises(OmnimirrorError, match="apex = 'round' is not one of smooth, pointed"):
        SampledProfile(x, x, apex="round")
    pointed = SampledProfile(x, tuple(np.multiply(x, 0.5)), apex="pointed")
    assert float(pointed.slope(0.0)) == pytest.approx(0.5)


def test_saving_leaves_an_earlier_file_when_the_disk_refuses(tmp_path):
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
def test_lines_are_those_of_dotted_and_quoted_keys_and_not_of_what_stands_in_texts(path, line):
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
