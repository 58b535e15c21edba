"""Views of the page against those of the Python dewarper: equal source pixels."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibration.formats import _scaramuzza
from omnimirror.cameras.camera import Mount
from omnimirror.io import read_image, write_image
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors, save_sensor
from tests.commands import omnimirror

from .browser import command, coordinates, drop, open_page, set_state, view_pixels
from .images import pattern, psnr, python_view

SIZE = (120, 90)
TOLERANCE_PX = 0.02  # px
STATES = {
    "panorama": {"mode": "panorama", "pan": 20},
    "part of a panorama": {"mode": "panorama", "pan": -100, "tilt": -10, "zoom": 3},
    "perspective": {"mode": "perspective", "pan": 70, "tilt": -25, "hfov": 75},
    "dome": {"mode": "dome", "pan": 30, "zoom": 1.2},
    "planet": {"mode": "planet", "pan": -40},
    "ground": {"mode": "ground", "pan": 15, "height": 900, "zoom": 1.5},
    "mosaic": {"mode": "mosaic", "pan": 10, "tilt": -20, "hfov": 80},
    "near panorama": {"mode": "panorama", "distance": 250},
    "near wall": {"mode": "perspective", "pan": -30, "tilt": 5, "hfov": 100, "distance": 300},
    "near dome": {"mode": "dome", "distance": 400},
}
ALL = pytest.param(tuple(STATES), id="all", marks=pytest.mark.full)
DEFAULT_SENSORS = (
    "folded-hyperboloidal",
    "paraboloid-telecentric",
)  # two mirrors, and another lens
OCAM = _scaramuzza.write_ocamcalib(
    om.OCam(
        polynomial=(-2.6e2, 0.0, 1.1e-3, -4.0e-7, 3.1e-9),
        centre_px=(402.7, 299.2),
        image_size=(800, 600),
        affine=(0.9991, 0.0007, -0.0004),
    )
)


@pytest.fixture(scope="module")
def page(browser, server):
    """One page for all cameras, with a small view for software rendering."""
    page = open_page(browser, server)
    page.add_style_tag(
        content="#frame { height: 30px !important; min-height: 0 !important; max-width: 40px }"
    )
    yield page
    assert page.problems == []
    page.context.close()


def choose(page, sensor: str, **state) -> None:
    """Select a camera of the server, with its own or a given mount."""
    set_state(
        page,
        **{"rim": None, "looks": None, "forward": None, "flipped": None, "sensor": sensor, **state},
    )
    page.wait_for_function(
        """([sensor, looks]) => {
          const { model } = window.omnimirror.look.sensor.camera;
          return model.id === sensor && (!looks || model.mount.camera_looks === looks);
        }""",
        arg=[sensor, state.get("looks")],
    )


def load(page, path: Path) -> None:
    """Select a camera by its calibration file, as a user does."""
    page.set_input_files("#calibration", path)
    page.wait_for_function(
        "(name) => window.omnimirror.look.sensor.camera.model.options[1] === name", arg=path.name
    )


def view_case(*names: str):
    """Return a case of several kinds of view; the full test covers all of them."""
    return pytest.param(names, id=", ".join(names))


def check(
    page, folder: Path, size: tuple[int, int], states: tuple[str, ...] = tuple(STATES), **view_state
) -> None:
    """Check that each kind of view has the coordinates and colours of its displayed command line."""
    image = pattern(size)
    name = f"picture-{size[0]}x{size[1]}.png"
    write_image(folder / name, image)
    drop(page, folder / name)
    set_state(page, **view_state)
    for name in states:
        set_state(page, **{"zoom": 1, "tilt": 0, "distance": float("inf"), **STATES[name]})
        dewarper = python_view(command(page, *SIZE), folder)
        result, expected = coordinates(page, *SIZE), dewarper.coordinates(exact=True)
        assert result.shape == expected.shape, name
        is_finite = np.isfinite(result[..., 0]) & np.isfinite(expected[..., 0])
        differs = np.isfinite(result[..., 0]) ^ np.isfinite(expected[..., 0])
        assert is_finite.any(), name
        assert differs.mean() < 0.002, f"{name}: {differs.sum()} pixels are seen by one only"
        error = np.linalg.norm(result - expected, axis=-1)[is_finite]
        assert error.max() < TOLERANCE_PX, (
            f"{name}: {error.max():.4f} px, {(error > TOLERANCE_PX).sum()} pixels"
        )
        colours = view_pixels(page, *SIZE)
        assert (colours[..., 3] == 255)[is_finite].all()
        level = psnr(colours[..., :3], dewarper(image), is_finite)
        assert level > 40, f"{name}: {level:.1f} dB"


@pytest.mark.parametrize(
    "sensor",
    [
        name if name in DEFAULT_SENSORS else pytest.param(name, marks=pytest.mark.full)
        for name in bundled_sensors()
    ],
)
@pytest.mark.parametrize("states", [view_case("panorama", "near wall"), ALL])
def test_views_of_bundled_sensors_match_command_line(sensor, states, page, tmp_path):
    """Mirrors of all kinds, one or two of them, with lenses of both kinds."""
    choose(page, sensor)
    check(page, tmp_path, om.load_sensor(sensor).image_size, states)


@pytest.mark.full
@pytest.mark.parametrize("orientation", ["down", "forward"])
def test_flipped_and_rotated_camera_matches_command_line(orientation, page, tmp_path):
    choose(page, "paper-spherical", looks=orientation, forward=33, flipped=True)
    check(page, tmp_path, (1024, 1024))


@pytest.mark.parametrize("optics", [pytest.param("mirror", marks=pytest.mark.full), "fisheye"])
@pytest.mark.parametrize("states", [view_case("planet", "mosaic"), ALL])
def test_views_of_ocamcalib_cameras_match_command_line(optics, states, page, tmp_path):
    path = tmp_path / f"calib_results_{optics}.txt"
    path.write_text(OCAM)
    load(page, path)
    page.wait_for_selector("#optics-row:visible")
    if optics == "fisheye":
        # Not `check`, which reads the state immediately: the page names the previous camera until
        # the other is loaded.
        page.get_by_label("fisheye", exact=True).click()
        page.wait_for_function(
            "window.omnimirror.look.sensor.camera.model.options.includes('camera.optics=fisheye')"
        )
        choose(page, page.evaluate("window.omnimirror.store.state.sensor"), looks="down")
    check(page, tmp_path, (800, 600), states)


CALIBRATED = {
    "distorted": om.Unified(
        xi=0.9,
        focal_px=(330.0, 334.0),
        centre_px=(410.0, 290.0),
        image_size=(800, 600),
        skew_px=0.4,
        k1=-0.08,
        k2=0.02,
        k3=-0.001,
        p1=0.003,
        p2=-0.002,
    ),
    "not-central": om.ViewpointSpline(
        radii_px=(60.0, 118.0, 180.0, 240.0, 285.0),
        viewpoints_mm=(-4.0, -2.5, 0.0, 3.0, 6.0),
        field_deg=230.0,
        centre_px=(400.0, 300.0),
        image_size=(800, 600),
    ),
    "not-central-stretched": om.ViewpointSpline(
        radii_px=(60.0, 118.0, 180.0, 240.0, 285.0),
        viewpoints_mm=(-4.0, -2.5, 0.0, 3.0, 6.0),
        field_deg=230.0,
        centre_px=(405.0, 290.0),
        image_size=(800, 600),
        stretch_x=0.004,
        shear=-0.003,
        p1=1e-5,
        p2=-2e-5,
    ),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("distorted", marks=pytest.mark.full),
        pytest.param("not-central", marks=pytest.mark.full),
        "not-central-stretched",
    ],
)
@pytest.mark.parametrize("states", [view_case("ground", "near dome"), ALL])
def test_views_of_calibrated_cameras_match_command_line(name, states, page, tmp_path):
    camera, path = CALIBRATED[name], tmp_path / f"{tmp_path.name}.toml"
    om.save_camera(camera, path)
    load(page, path)
    check(page, tmp_path, camera.image_size, states)


POSES = {
    "decentred and tilted": MirrorPose(decentre_x_mm=0.8, tilt_y_deg=0.6),
    "far out": MirrorPose(decentre_y_mm=-1.5, displacement_mm=2.0, tilt_x_deg=-2.0),
    "displaced": MirrorPose(displacement_mm=-1.0),
}


@pytest.mark.full
@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
def test_views_of_misaligned_sensors_match_command_line(pose, page, tmp_path):
    sensor = replace(om.load_sensor("paper-hyperboloidal"), mirror_pose=pose)
    path = tmp_path / f"{tmp_path.name}.toml"
    save_sensor(sensor, path)
    load(page, path)
    check(page, tmp_path, sensor.image_size)


@pytest.mark.parametrize(
    "pose", [pytest.param("decentred and tilted", marks=pytest.mark.full), "far out"]
)
@pytest.mark.parametrize("states", [view_case("perspective", "near panorama"), ALL])
def test_flipped_misaligned_sensor_matches_command_line(pose, states, page, tmp_path):
    path = tmp_path / f"{tmp_path.name}.toml"
    save_sensor(
        replace(
            om.load_sensor("paper-spherical"),
            mirror_pose=POSES[pose],
            mount=Mount("down", 20.0, True),
        ),
        path,
    )
    load(page, path)
    check(page, tmp_path, (1024, 1024), states)


def test_fitted_mirror_ball_matches_command_line(page, tmp_path):
    choose(page, "ball:280", looks="forward")
    check(page, tmp_path, (900, 700), rim=[470.25, 341.5, 300.0])


def test_fitted_sensor_file_reproduces_view(browser, server, tmp_path):
    image = pattern((640, 480))
    write_image(tmp_path / "picture.png", image)
    page = open_page(browser, f"{server}#mode=perspective&pan=50&hfov=60")
    drop(page, tmp_path / "picture.png")
    set_state(page, rim=[330.0, 250.5, 210.0])
    with page.expect_download() as download:
        page.click("#save-sensor")
    download.value.save_as(tmp_path / download.value.suggested_filename)
    arguments = shlex.split(command(page, *SIZE))
    run = omnimirror(*arguments[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    expected = read_image(tmp_path / "perspective.png")
    pixels = view_pixels(page, *SIZE)
    both = (expected[..., 3] > 0) & (pixels[..., 3] > 0)
    assert both.mean() > 0.9
    assert psnr(pixels[..., :3], expected[..., :3], both) > 40
    page.context.close()


def test_minified_detail_is_averaged(browser, server, tmp_path):
    """Compared with a Python view of eight times the size, averaged by OpenCV."""
    image = np.random.default_rng(4).integers(0, 256, (1024, 1024, 3)).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    write_image(tmp_path / "picture.png", image)
    page = open_page(browser, f"{server}#mode=perspective&hfov=100&tilt=-30")
    drop(page, tmp_path / "picture.png")
    line = command(page, *SIZE).replace("120x90", "960x720")
    expected = cv2.resize(python_view(line, tmp_path)(image), SIZE, interpolation=cv2.INTER_AREA)
    pixels = view_pixels(page, *SIZE)
    inner = np.zeros(pixels.shape[:2], bool)
    inner[8:-8, 8:-8] = True
    assert psnr(pixels[..., :3], expected, inner & (pixels[..., 3] > 0)) > 35
    page.context.close()
