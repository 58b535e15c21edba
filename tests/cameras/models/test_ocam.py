"""OCamCalib file and camera against OCamCalib's own formulas and images."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorWarning, SpecError
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import parse_ocam

SAMPLE = Path(__file__).parents[4] / "shared/data/ocamcalib_cpp_sample"
needs_sample = pytest.mark.skipif(not SAMPLE.exists(), reason=f"no sample pictures at {SAMPLE}")

GOOD = """#polynomial coefficients for the DIRECT mapping function

5 -1.314797e+002 0.000000e+000 1.848991e-003 2.251206e-007 -7.343233e-010

#inverse
3 266.092981 272.489459 148.629937

#center
382.294245 515.323794
#affine
0.999845 0.000044 0.000008

#size
768 1024

"""


def cam2world(pixels, camera):
    """Return rays (n, 3) of OCamCalib's cam2world.m, written out, in its frame of row, column and
    z."""
    c, d, e = camera.affine
    column, row = np.moveaxis(np.asarray(pixels) - camera.centre_px, -1, 0)
    x = (row - d * column) / (c - d * e)
    y = (c * column - e * row) / (c - d * e)
    rho = np.hypot(x, y)
    z = sum(a * rho**i for i, a in enumerate(camera.polynomial))
    return np.stack([x, y, z], axis=-1) / np.sqrt(x**2 + y**2 + z**2)[..., None]


def test_reads_the_file():
    camera = parse_ocam(GOOD)
    assert camera.polynomial == (-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10)
    assert camera.centre_px == (515.323794, 382.294245)
    assert camera.image_size == (1024, 768)
    assert camera.affine == (0.999845, 4.4e-05, 8e-06)
    assert camera.optics == "mirror"


def test_reads_line_ends_byte_order_mark_and_comments(tmp_path):
    path = tmp_path / "calib.txt"
    path.write_bytes(
        b"\xef\xbb\xbf"
        + GOOD.replace("768 1024", "768 1024  # rows, columns").replace("\n", "\r\n").encode()
    )
    with pytest.warns(OmnimirrorWarning, match="inverse polynomial"):  # three coefficients only
        assert om.load_ocam(path) == parse_ocam(GOOD)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("5 -1.3", "4 -1.3"),
            "line 3: the direct polynomial must have the number of coefficients",
        ),
        (("3 266", "x 266"), "line 6: the inverse polynomial .* must be numbers; got 'x'"),
        (("3 266", "nan 266"), "line 6: the inverse polynomial .* must be numbers; got 'nan'"),
        (
            ("382.294245 ", ""),
            r"OCamCalib file line 9: the centre \(row and column\) must be 2 numbers; got 1",
        ),
        (
            ("0.000008", "0.000008 1"),
            r"OCamCalib file line 11: the affine parameters \(c, d and e\) must be 3 numbers; got 4",
        ),
        (
            ("768 1024", "768.5 1024"),
            r"OCamCalib file line 14: the image size must be integers; got 768\.5 1024",
        ),
        (
            ("768 1024", "0 1024"),
            "OCamCalib file: image height must be an integer between 1 and 100000 px; got 0",
        ),
        (
            ("768 1024", ""),
            r"OCamCalib file must contain the image size \(height and width\); got the end of the file",
        ),
        (
            ("-1.314797e+002", "1.314797e+002"),
            r"OCamCalib file: polynomial must begin with a negative number, f\(0\) < 0",
        ),
        (
            ("0.999845", "0"),
            r"affine must be an invertible matrix .*; got \(0\.0, 4\.4e-05, 8e-06\)",
        ),
    ],
)
def test_invalid_file_raises_with_line(change, message):
    assert change[0] in GOOD
    with pytest.raises(SpecError, match=message) as e:
        parse_ocam(GOOD.replace(*change))
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("content", [b"", b"# nothing\n", b"\xff\xd8\xff\x00\x80", None])
def test_non_ocam_file_raises(tmp_path, content):
    path = tmp_path / "calib.txt"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SpecError, match=r"calib\.txt"):
        om.load_ocam(path)
    with pytest.raises(SpecError, match="cannot read"):
        om.load_ocam(tmp_path)


@given(st.text(max_size=200))
def test_arbitrary_text_is_parsed_or_raises(text):
    with pytest.raises(SpecError, match=r"^OCamCalib file"):
        parse_ocam(text)


@pytest.mark.parametrize(
    "changes",
    [{"optics": "lens"}, {"rim_radius_px": 0.0}, {"rim_radius_px": np.nan}, {"polynomial": ()}],
)
def test_invalid_camera_raises(changes):
    good = {"polynomial": (-100.0,), "centre_px": (5.0, 5.0), "image_size": (11, 11)}
    with pytest.raises(InvalidParameter, match=next(iter(changes))):
        om.OCam(**(good | changes))


@pytest.mark.parametrize(("optics", "sign"), [("mirror", 1), ("fisheye", -1)])
def test_rays_equal_ocamcalib(optics, sign):
    camera = parse_ocam(GOOD, optics=optics, mount=Mount("up", 0.0))  # world frame = camera frame
    pixels = np.random.default_rng(0).uniform(0, (1023, 767), (200, 2))
    row, column, z = cam2world(pixels, camera).T
    expected = np.stack([column, row, sign * z], axis=-1)
    np.testing.assert_allclose(camera.backproject(pixels).directions, expected, atol=1e-14)
    np.testing.assert_allclose(
        camera.project_directions(expected).pixels, pixels, atol=1e-9, rtol=0
    )


def test_optics_determines_axis_direction():
    down, up = [0, 0, -1], [0, 0, 1]
    for optics, visible, hidden in (("mirror", down, up), ("fisheye", up, down)):
        camera = parse_ocam(GOOD, optics=optics)
        assert camera.project_directions([visible, hidden]).valid.tolist() == [True, False]
        np.testing.assert_allclose(camera.project_directions([visible]).pixels[0], camera.centre_px)


def test_field_ends_at_maximum_angle():
    """f = -100 + rho^2/1000 - 1e-8 rho^4: the field angle reverses at a radius found here by
    search."""
    camera = om.OCam(
        polynomial=(-100.0, 0.0, 1e-3, 0.0, -1e-8),
        centre_px=(2000.0, 2000.0),
        image_size=(4001, 4001),
    )
    rho = np.linspace(0, 2000, 2_000_001)
    omega = np.arctan2(rho, 100 - 1e-3 * rho**2 + 1e-8 * rho**4)
    rate = np.gradient(omega, rho) * 100
    expected = rho[np.argmax(rate < 0.01)]
    assert camera.field_radius_px == pytest.approx(expected, abs=0.01)
    assert expected < 1000
    assert camera.backproject(
        [[2000 + expected - 1, 2000], [2000 + expected + 1, 2000]]
    ).valid.tolist() == [
        True,
        False,
    ]


def test_field_ends_at_rim():
    camera = parse_ocam(GOOD, rim_radius_px=200.0)
    u, v = camera.centre_px
    assert camera.backproject([[u + 199.9, v], [u + 200.1, v]]).valid.tolist() == [True, False]
    free = parse_ocam(GOOD)
    assert free.backproject([[-0.5, -0.5], [1023.5, 767.5]]).valid.all()


@needs_sample
def test_perspective_reference_image():
    """undistort_perspective of OCamCalib's C++ sample, with sf = 5."""
    camera = om.load_ocam(SAMPLE / "calib_results_fisheye.txt", "fisheye")
    source = cv2.imread(str(SAMPLE / "test_fisheye.jpg"))
    reference = cv2.imread(str(SAMPLE / "undistorted_perspective.jpg"))
    height, width = reference.shape[:2]
    row, column = np.mgrid[:height, :width]
    z = np.full(row.shape, -width / 5)
    in_camera = np.stack([column - width / 2, row - height / 2, -z], axis=-1).reshape(-1, 3)
    pixels, valid = camera.project_directions(in_camera @ camera.mount.rotation().T)
    assert valid.mean() > 0.4
    maps = np.where(np.isnan(pixels), -10, pixels).astype(np.float32).reshape(height, width, 2)
    image = cv2.remap(source, maps, None, cv2.INTER_LINEAR)
    assert np.abs(image.astype(float) - reference).mean() <= 0.5
    inside = valid.reshape(height, width)
    assert np.abs(image.astype(float) - reference)[inside].mean() <= 0.75


@needs_sample
def test_panorama_reference_image():
    """A plain polar unwrapping; the camera reproduces its pixels from their directions."""
    camera = om.load_ocam(SAMPLE / "calib_results_catadioptric.txt")
    source = cv2.imread(str(SAMPLE / "test_catadioptric.jpg"))
    reference = cv2.imread(str(SAMPLE / "undistorted_panoramic.jpg"))
    height, width = reference.shape[:2]
    row, column = np.mgrid[:height, :width]
    theta = -2 * np.pi * column / width
    rho = 470 - 450 / height * row
    u, v = camera.centre_px
    unrolled = np.stack([u + rho * np.sin(theta), v + rho * np.cos(theta)], axis=-1)
    down, right, z = np.moveaxis(cam2world(unrolled, camera), -1, 0)
    in_camera = np.stack([right, down, z], axis=-1).reshape(-1, 3)
    pixels, valid = camera.project_directions(in_camera @ camera.mount.rotation().T)
    pixels = pixels.reshape(height, width, 2)
    inside = valid.reshape(height, width)
    expected_inside = ((unrolled >= -0.5) & (unrolled <= (1023.5, 767.5))).all(axis=-1)
    np.testing.assert_array_equal(inside, expected_inside)
    np.testing.assert_allclose(pixels[inside], unrolled[inside], atol=1e-9, rtol=0)
    image = cv2.remap(
        source, np.where(inside[..., None], pixels, -10).astype(np.float32), None, cv2.INTER_LINEAR
    )
    assert np.abs(image.astype(float) - reference).mean() <= 1.0


def test_additional_lines_are_ignored():
    tail = "\n# pixel size (um)\n5.2 5.2\nbaseline: 120 mm\nnan\n"
    assert parse_ocam(GOOD + tail) == parse_ocam(GOOD)


@pytest.mark.parametrize("coefficient", ["1e308", "-1e200"])
def test_overflowing_coefficients_raise(coefficient):
    with pytest.raises(
        SpecError, match=r"polynomial must have coefficients with magnitudes less than 1e\+100; got"
    ):
        parse_ocam(f"3 -100 0 {coefficient}\n2 100 50\n59.5 79.5\n1 0 0\n120 160\n")
