"""EXIF orientation against Pillow and OpenCV, for all readers."""

import base64
import io
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image, ImageOps

import omnimirror as om
from omnimirror.apps.cli import app, main
from omnimirror.apps.studio._uploads import browser_image, image_in
from omnimirror.apps.studio.pages import image_viewer
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.image_files import ImageDewarper
from omnimirror.dewarp.request import DewarpRequest
from omnimirror.io.images import read_image_and_metadata
from omnimirror.simulation.rendering import render_image

FIELD = cv2.resize(np.random.default_rng(5).integers(0, 255, (6, 9, 3), np.uint8), (72, 48))
SUFFIXES = [".jpg", ".png", ".webp", ".tif", ".avif"]
STORED = "--set=input.stored_orientation=true"


def write_with_orientation(path: Path, image: np.ndarray, orientation: int, **more: object) -> Path:
    exif = Image.Exif()
    exif[0x0112] = orientation
    lossless = {"lossless": True} if path.suffix == ".webp" else {}
    quality = {"quality": 98, "subsampling": 0} if path.suffix == ".jpg" else {}
    Image.fromarray(image).save(path, exif=exif, **lossless, **quality, **more)
    return path


def pillow_image(path: Path) -> np.ndarray:
    return np.asarray(ImageOps.exif_transpose(Image.open(path)))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_equals_pillow_and_opencv(tmp_path, orientation, suffix):
    path = write_with_orientation(tmp_path / f"a{suffix}", FIELD, orientation)
    image, metadata = read_image_and_metadata(path)
    expected = pillow_image(path)
    assert image.shape == expected.shape
    assert np.abs(image.astype(int) - expected).max() <= 2
    assert metadata.orientation == orientation
    if suffix != ".avif":  # whose rotation OpenCV ignores
        opencv_image = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR)[
            ..., ::-1
        ]
        np.testing.assert_array_equal(image, opencv_image)
    stored = om.read_image(path, stored_orientation=True)
    assert stored.shape == FIELD.shape
    assert np.abs(stored.astype(int) - FIELD).mean() < 6


BY_OPENCV = {
    2: lambda image: cv2.flip(image, 1),
    3: lambda image: cv2.rotate(image, cv2.ROTATE_180),
    4: lambda image: cv2.flip(image, 0),
    5: cv2.transpose,
    6: lambda image: cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE),
    7: lambda image: cv2.flip(cv2.transpose(image), -1),
    8: lambda image: cv2.rotate(image, cv2.ROTATE_90_COUNTERCLOCKWISE),
}


@pytest.mark.parametrize("orientation", range(2, 9))
@pytest.mark.parametrize("big", [False, True])
def test_deep_tiff_is_oriented_once(tmp_path, orientation, big):
    deep = (FIELD[..., 0].astype(np.uint16) << 7) + 5
    path = write_with_orientation(tmp_path / "a.tif", deep, orientation, big_tiff=big)
    assert path.read_bytes()[2] == (43 if big else 42)
    np.testing.assert_array_equal(om.read_image(path), BY_OPENCV[orientation](deep))
    np.testing.assert_array_equal(om.read_image(path, stored_orientation=True), deep)


@pytest.mark.parametrize("value", [0, 9, 65535])
def test_invalid_orientations_are_ignored(tmp_path, value):
    np.testing.assert_array_equal(
        om.read_image(write_with_orientation(tmp_path / "a.png", FIELD, value)), FIELD
    )


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".tif"])
def test_written_images_have_no_orientation(tmp_path, suffix):
    image, metadata = read_image_and_metadata(write_with_orientation(tmp_path / "a.jpg", FIELD, 6))
    om.write_image(
        tmp_path / f"b{suffix}", image, metadata=metadata.supported_by(f"b{suffix}", image)[0]
    )
    with Image.open(tmp_path / f"b{suffix}") as output:
        assert output.size == (48, 72)
        assert output.getexif().get(0x0112, 1) == 1


# -- all readers ----------------------------------------------------------------------------------

SPHERE = om.load_sensor("paper-spherical")
WIDE = om.MirrorBall(
    centre_px=(70.0, 50.0), rim_radius_px=40.0, field_deg=280.0, image_size=(140, 96)
)
BOARD = om.Board("chessboard", 7, 5, 20.0)


@pytest.fixture
def rotated(tmp_path):
    """A landscape image, and the file of a camera that was rotated by 90 deg."""
    image = cv2.resize(
        np.random.default_rng(6).integers(0, 255, (12, 18, 3), np.uint8), WIDE.image_size
    )
    om.write_image(tmp_path / "upright.png", image)
    return image, write_with_orientation(tmp_path / "turned.png", np.rot90(image).copy(), 6)


def test_dewarping_applies_and_reports_orientation(tmp_path, rotated, capsys):
    straight = ImageDewarper(DewarpRequest(WIDE))
    expected = straight(tmp_path / "upright.png", tmp_path / "a.png")
    note = straight(rotated[1], tmp_path / "b.png")
    assert "orient" not in expected
    assert (
        "rotated by 90 deg clockwise according to EXIF; --set input.stored_orientation=true" in note
    )
    np.testing.assert_array_equal(
        om.read_image(tmp_path / "b.png"), om.read_image(tmp_path / "a.png")
    )
    with pytest.raises(
        InvalidParameter, match=r"as stored; omit --set input\.stored_orientation=true"
    ):
        ImageDewarper(DewarpRequest(WIDE, stored_orientation=True))(rotated[1], tmp_path / "c.png")
    result = om.dewarp_images(tmp_path / "turned.png", tmp_path / "many", camera=WIDE)
    assert sum(result.oriented.values()) == 1
    np.testing.assert_array_equal(
        om.read_image(tmp_path / "many" / "turned.png"), om.read_image(tmp_path / "a.png")
    )


def test_dewarping_stored_pixels_reports_option(tmp_path, rotated):
    """A camera calibrated with stored pixels."""
    tall = om.MirrorBall(
        centre_px=(50.0, 70.0), rim_radius_px=40.0, field_deg=280.0, image_size=(96, 140)
    )
    with pytest.raises(
        InvalidParameter,
        match=r"must have the 96 x 140 px .* clockwise; --set input.stored_orientation=true",
    ):
        ImageDewarper(DewarpRequest(tall))(rotated[1], tmp_path / "b.png")
    om.write_image(tmp_path / "stored.png", np.rot90(rotated[0]).copy())
    ImageDewarper(DewarpRequest(tall))(tmp_path / "stored.png", tmp_path / "a.png")
    note = ImageDewarper(DewarpRequest(tall, stored_orientation=True))(
        rotated[1], tmp_path / "b.png"
    )
    assert (
        "b.png: panorama (elevation -90 to 50 deg), 134 x 52 px, all pixels inside the field, as sto"
        in note
    )
    np.testing.assert_array_equal(
        om.read_image(tmp_path / "b.png"), om.read_image(tmp_path / "a.png")
    )


def test_studio_uses_displayed_orientation(tmp_path, rotated):
    image, path = rotated
    np.testing.assert_array_equal(image_in(path.read_bytes(), "a.png"), image)
    (tmp_path / "b.png").write_bytes(browser_image(path.read_bytes(), "a.png")[0])
    np.testing.assert_array_equal(pillow_image(tmp_path / "b.png"), image)
    page = image_viewer(WIDE, "ball", (), path, om.read_image(path))
    embedded = base64.b64decode(re.search(r"data:image/png;base64,([A-Za-z0-9+/=]+)", page)[1])
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(embedded))), image)
    assert om.show(path, WIDE).page.count("data:image/png") == 1


def test_boards_are_detected_in_displayed_orientation(tmp_path):
    v, u = np.mgrid[:150, :200]
    grey = np.where((u // 24 + v // 24) % 2, 200, 40).astype(np.uint8)
    image = np.pad(grey[:144, :192], ((20, 30), (40, 10)), constant_values=200)
    path = write_with_orientation(tmp_path / "a.png", np.rot90(image).copy(), 6)
    upright, applied, stored = (
        om.find_boards([image], BOARD),
        *(
            om.find_boards([path], BOARD, stored_orientation=is_stored)
            for is_stored in (False, True)
        ),
    )
    assert upright[0].used
    assert applied[0].image_size == image.shape[::-1]
    np.testing.assert_allclose(applied[0].corners_px, upright[0].corners_px)
    assert stored[0].image_size == image.shape


@pytest.mark.parametrize("command", ["rim", "colmap", "calibrate", "lines"])
def test_commands_report_orientation(tmp_path, rotated, command, capsys):
    """Each command reports the applied orientation before its other errors on the plain image."""
    _, path = rotated
    arguments = {
        "rim": ["rim", path],
        "colmap": ["colmap", SPHERE.name, path, "-o", tmp_path / "project"],
        "calibrate": ["calibrate", path, "--board", "7x5", "--square-mm", "20"],
        "lines": ["lines", path, "--rim", "70", "50", "40"],
    }[command]
    for option, note in (
        ([], "rotated by 90 deg clockwise according to EXIF"),
        ([STORED], "as stored; the EXIF"),
    ):
        run = CliRunner().invoke(app, [*map(str, arguments), *option])
        assert f"1 of 1 images {note}" in run.stderr, run.output


def test_rim_detection_uses_displayed_orientation(tmp_path, capsys):
    ball = om.MirrorBall(
        centre_px=(190.0, 150.0), rim_radius_px=120.0, field_deg=300.0, image_size=(400, 300)
    )
    image = render_image(ball, om.Room(texel_mm=20.0), samples=2)
    path = write_with_orientation(tmp_path / "a.png", np.rot90(image).copy(), 6)
    main(["rim", str(path), "--json", str(tmp_path / "rim.json")])
    om.write_image(tmp_path / "b.png", image)
    main(["rim", str(tmp_path / "b.png"), "--json", str(tmp_path / "upright.json")])
    a, b = (json.loads((tmp_path / name).read_text()) for name in ("rim.json", "upright.json"))
    assert a["centre_px"] == b["centre_px"]
    np.testing.assert_allclose(a["centre_px"], [190.0, 150.0], atol=3)
