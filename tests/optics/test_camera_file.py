"""Camera files: round trip, and one-sentence errors with line numbers."""

import tomllib
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.base.parameters import Uncertainty
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import CAMERAS
from omnimirror.optics.camera_files import format_camera, is_ocam_text
from tests.contracts.test_camera_models import MODELS

GOOD = """# A comment
format = 1

[camera]
kind = "unified"
xi = 0.96
focal_px = [220, 221.5]
centre_px = [319.5, 239.5]
image_size = [640, 480]
k1 = -0.05
rim_radius_px = 230.0

[mount]
camera_looks = "down"
pitch_deg = 3.0

[uncertainty]
names = ["xi", "cx"]
covariance = [[1e-6, 1e-5], [1e-5, 0.04]]
"""


def random_uncertainty(model):
    names = tuple(p.name for p in model.parameters)
    factor = np.random.default_rng(1).normal(size=(len(names), len(names))) * 1e-3
    return Uncertainty(names, tuple(map(tuple, (factor @ factor.T).tolist())))


@pytest.mark.parametrize("mount", [Mount(), Mount("forward", 33.3, True, 4.0, -5.0)])
@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_camera_file_round_trip(model, mount, tmp_path):
    path = tmp_path / "camera.toml"
    for camera in (
        replace(model, mount=mount),
        replace(model, mount=mount, uncertainty=random_uncertainty(model)),
    ):
        om.save_camera(camera, path, notes="calibrated\non a board")
        assert om.load_camera(path) == camera
        assert path.read_text().startswith("# calibrated\n# on a board\n")
        assert om.parse_camera(path.read_text()).uncertainty == camera.uncertainty


def test_all_camera_kinds_tested():
    assert {model.KIND for model in MODELS.values()} == set(CAMERAS)


def test_camera_file_text():
    camera = om.parse_camera(GOOD)
    assert camera == om.Unified(
        xi=0.96,
        focal_px=(220.0, 221.5),
        centre_px=(319.5, 239.5),
        image_size=(640, 480),
        k1=-0.05,
        rim_radius_px=230.0,
        mount=Mount("down", pitch_deg=3.0),
        uncertainty=Uncertainty(("xi", "cx"), ((1e-6, 1e-5), (1e-5, 0.04))),
    )
    assert camera.uncertainty.sigmas == {"xi": pytest.approx(1e-3), "cx": pytest.approx(0.2)}
    table = tomllib.loads(format_camera(camera))["camera"]
    assert "k2" not in table  # defaults to 0
    assert table["kind"] == "unified"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ('"unified"', '"unfied"'),
            r"mine line 5: unknown camera.kind 'unfied'; did you mean unified\?",
        ),
        (
            ('kind = "unified"\n', ""),
            "mine line 4: camera.kind is missing; use unified, enhanced-unified",
        ),
        (("xi = 0.96", 'xi = "1"'), "line 6: camera.xi must be a valid number; got '1'"),
        (("xi = 0.96\n", ""), "line 4: camera.xi is missing"),
        (
            ("xi = 0.96", "xi = -1"),
            r"mine line 6: camera\.xi must be between 0 and 10000; got -1\.0",
        ),
        (("k1 =", "skew ="), r"line 10: unknown entry camera.skew; did you mean skew_px\?"),
        (("[220, 221.5]", "[220]"), "line 7: camera.focal_px must have at least 2 items"),
        (
            ("[220, 221.5]", "[220, -1]"),
            r"mine line 7: camera\.focal_px .* two numbers \(fx, fy\) greater than 0 px; got \(220\.0, -1\.0\)",
        ),
        (("[220, 221.5]", "[220, inf]"), "line 7: camera.focal_px"),
        (("[640, 480]", "[640.5, 480]"), "line 9: camera.image_size"),
        (
            ("[640, 480]", "[640, 0]"),
            "mine line 4: image height must be an integer between 1 and 100000 px; got 0",
        ),
        (
            ("rim_radius_px = 230.0", "rim_radius_px = 0"),
            r"mine line 11: camera\.rim_radius_px must be greater than 0 px and at most 1e\+06 px; got 0\.0",
        ),
        (('"down"', '"sideways"'), "line 14: mount.camera_looks"),
        (("[mount]", "[mounts]"), r"unknown entry mounts; did you mean mount\?"),
        (("format = 1", "format = 2"), "line 2: format must be .* got 2"),
        (
            ('"xi", "cx"', '"xi"'),
            r"mine line 17: covariance must have the shape \(1, 1\) for 1 names",
        ),
        (
            ('"xi", "cx"', '"xi", "f"'),
            "mine line 17: the parameters of the uncertainty must be from xi, fx, fy, skew, cx, cy, k1,",
        ),
        (("0.04]]", "-0.04]]"), "mine line 17: covariance must have no negative eigenvalues"),
        (("[1e-5, 0.04]", "[2e-5, 0.04]"), "mine line 17: covariance must be symmetric"),
        (
            ("[camera]", "[camera"),
            r"mine must be valid TOML: Expected '\]' at the end of a table declaration \(at line 4, column 8\)",
        ),
    ],
)
def test_camera_file_errors_report_line(change, message):
    assert change[0] in GOOD
    with pytest.raises(SpecError, match=message) as e:
        om.parse_camera(GOOD.replace(*change), "mine")
    assert "\n" not in str(e.value)


@given(st.text(max_size=100))
def test_arbitrary_text_read_or_rejected(text):
    for prefix in ("", "[camera]\n", GOOD):
        with suppress(SpecError):
            om.parse_camera(prefix + text)


OCAM = (
    "\n# polynomial: a0, a1, ...\n\n3 -100 0 2.5E-3 # of 2\n2 100 50\n239.5 319.5\n1 0 0\n480 640\n"
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (OCAM, True),
        ("5 # five", True),
        ("# 5\nfive # 5", False),
        ("+inf -NaN 1e-3", True),
        ("1 2 x", False),
        ("", False),
        ("# 5\n", False),
        ("\n5\nkind = 3", True),
        ("kind = 3\n5", False),
    ],
)
def test_ocamcalib_files_start_with_numbers(text, expected):
    """The first line of content decides; # starts a comment."""
    assert is_ocam_text(text) is expected


def test_entries_of_camera_files_are_changed(tmp_path):
    changes = {"camera": {"xi": 0.0, "k1": None}, "mount": None, "uncertainty": None}
    expected = om.Unified(
        xi=0.0,
        focal_px=(220.0, 221.5),
        centre_px=(319.5, 239.5),
        image_size=(640, 480),
        rim_radius_px=230.0,
    )
    assert om.parse_camera(GOOD, changes=changes) == expected
    (tmp_path / "a.toml").write_text(GOOD)
    assert om.load_camera(tmp_path / "a.toml", changes) == expected
    table = tomllib.loads(format_camera(expected))["camera"]
    assert table["xi"] == 0.0  # without a default
    assert not {"k1", "skew_px", "p1"} & set(table)
    assert om.parse_camera(format_camera(expected)) == expected
    assert "rim_radius_px" not in format_camera(replace(expected, rim_radius_px=None))
    ocam = om.OCam(
        polynomial=(-100.0, 0.0, 2.5e-3), centre_px=(319.5, 239.5), image_size=(640, 480)
    )
    om.convert(ocam, tmp_path / "b.txt", to="ocamcalib")
    with pytest.raises(
        SpecError,
        match=r"b\.txt, an OCamCalib file, must be from camera\.optics, camera\.rim_radius_px; got",
    ):
        om.load_camera(tmp_path / "b.txt", changes)
    with pytest.raises(TypeError, match="notes must be text; got 3"):
        format_camera(expected, 3)


@pytest.mark.parametrize(
    ("source", "end"),
    [
        ("a.toml", r"\)"),
        ("A.TOML", r"\)"),
        ("a", r"\)"),
        ("a.xml", "; convert camera files of other programs with omnimirror convert"),
    ],
)
def test_other_formats_are_recognised_by_suffix(source, end):
    with pytest.raises(SpecError, match=f"^{source} must be valid TOML: .*{end}$"):
        om.parse_camera("a b", source)


def test_camera_file_formats_read(tmp_path):
    """Detection by content: a sensor name, a sensor file, an OCamCalib file."""
    sensor = om.load_sensor("paper-spherical")
    assert om.load_camera("paper-spherical") == sensor
    om.save_camera(sensor, tmp_path / "sensor.toml")
    assert (
        om.load_camera(tmp_path / "sensor.toml")
        == om.load_sensor(tmp_path / "sensor.toml")
        == sensor
    )
    om.convert(
        om.OCam(polynomial=(-100.0, 0.0, 2.5e-3), centre_px=(319.5, 239.5), image_size=(640, 480)),
        tmp_path / "calib.txt",
        to="ocamcalib",
    )
    assert om.load_camera(tmp_path / "calib.txt") == om.load_ocam(tmp_path / "calib.txt")
    entries = {"optics": "fisheye", "rim_radius_px": 200.0}
    assert om.load_camera(tmp_path / "calib.txt", {"camera": entries}) == om.load_ocam(
        tmp_path / "calib.txt", "fisheye", rim_radius_px=200.0
    )
    with pytest.raises(SpecError, match=r"must be from camera\.optics, .*; got mount\.pitch_deg"):
        om.load_camera(tmp_path / "calib.txt", {"mount": {"pitch_deg": 5.0}})
    with pytest.raises(SpecError, match="entries of camera require a camera file"):
        om.load_camera("paper-spherical", {"camera": entries})
    (tmp_path / "camchain.yaml").write_text("cam0:\n  camera_model: ds\n")
    with pytest.raises(
        SpecError,
        match=r"camchain\.yaml must be valid TOML: Expected '=' after a key in a key/value pair "
        r"\(at line 1, .*; convert camera files of other programs with omnimirror convert$",
    ):
        om.load_camera(tmp_path / "camchain.yaml")
    (tmp_path / "found.json").write_text('{"rms_px": 0.1, "held_out_rms_px": 0.1}')
    with pytest.raises(
        SpecError,
        match=r"found.json .* contains the results of a calibration; .* the output file of its -o option$",
    ):
        om.load_camera(tmp_path / "found.json")
    with pytest.raises(
        SpecError,
        match=r"sensor file, camera file or bundled sensor 'paper-sperical' does not exist; did",
    ):
        om.load_camera("paper-sperical")
    with pytest.raises(InvalidParameter, match="camera must be a sensor, or a camera of kind"):
        om.save_camera("paper-spherical", tmp_path / "x.toml")
