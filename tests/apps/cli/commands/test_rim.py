"""Commands ``omnimirror rim`` and ``omnimirror dewarp --auto``."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras.camera import Mount
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.commands import fails, omnimirror


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two images of one sensor, a small image with a clear outline, and an image without a mirror."""
    folder = tmp_path_factory.mktemp("rims")
    for azimuth in (0.0, 90.0):
        scene = om.PosedScene(om.load_scene("room", texel_mm=20.0), om.Pose(pan_deg=azimuth))
        om.write_image(
            folder / f"room{azimuth:.0f}.png",
            om.render_image(om.load_sensor("paper-spherical"), scene, samples=1),
        )
    v, u = np.mgrid[:200, :260]
    radius, azimuth = np.hypot(u - 130.0, v - 100.0), np.arctan2(v - 100.0, u - 130.0)
    disc = np.clip(80.5 - radius, 0, 1) * (110 + 80 * np.tanh(6 * np.sin(11 * azimuth))) + 12
    om.write_image(folder / "disc.png", disc.astype(np.uint8))
    om.write_image(folder / "nothing.png", np.full((200, 300, 3), 90, np.uint8))
    return folder


def test_rim_of_sensor(folder, tmp_path):
    run = omnimirror(
        "rim",
        folder / "room0.png",
        "--json",
        tmp_path / "rim.json",
        "-o",
        tmp_path / "rim.png",
    )
    assert run.returncode == 0, run.stderr
    rim = json.loads((tmp_path / "rim.json").read_text())
    assert rim["centre_px"] == pytest.approx([511.5, 511.5], abs=1.0)
    assert rim["semi_axes_px"] == pytest.approx([501.63, 501.63], abs=1.0)
    assert rim["confidence"] > 0.6
    assert rim["image_size"] == [1024, 1024]
    assert om.read_image(tmp_path / "rim.png").shape[2] >= 3


def test_images_of_one_sensor_are_evaluated_together(folder, tmp_path):
    run = omnimirror(
        "rim", folder / "room0.png", folder / "room90.png", "--json", tmp_path / "rim.json"
    )
    assert run.returncode == 0, run.stderr
    assert "together" in run.stdout
    rim = json.loads((tmp_path / "rim.json").read_text())
    assert [entry["name"] for entry in rim["images"]] == ["room0.png", "room90.png"]
    assert rim["semi_axes_px"] == pytest.approx([501.63, 501.63], abs=1.0)


def test_rejected_outline_is_reported(folder):
    run = omnimirror("rim", folder / "nothing.png")
    assert run.returncode == 0
    assert "no rim detected: the confidence must be at least 0.6; got 0.00" in run.stdout


def test_rejected_outlines_are_listed_as_candidates(tmp_path):
    """Two discs of one colour that are not mirrors."""
    v, u = np.mgrid[:240, :400]
    image = np.where(
        np.hypot(u - 110, v - 120) < 70, 200, np.where(np.hypot(u - 290, v - 120) < 60, 120, 40)
    )
    om.write_image(tmp_path / "discs.png", image.astype(np.uint8))
    run = omnimirror("rim", tmp_path / "discs.png", "--json", tmp_path / "rim.json")
    assert run.returncode == 0, run.stderr
    rim = json.loads((tmp_path / "rim.json").read_text())
    assert not rim["accepted"]
    radii = [np.sqrt(np.prod(candidate["semi_axes_px"])) for candidate in rim["candidates"]]
    assert rim["candidates"][0]["centre_px"] == rim["centre_px"]
    assert all(candidate["confidence"] < 0.6 for candidate in rim["candidates"])
    assert min(abs(radius - 70) for radius in radii) < 1
    assert min(abs(radius - 60) for radius in radii) < 1
    assert "candidate 2" in " ".join(run.stdout.split())


@pytest.mark.parametrize("command", ["rim", "lines"])
def test_images_of_different_sizes_raise(command, folder):
    images = [folder / "room0.png", folder / "nothing.png", folder / "room90.png"]
    message = fails(command, *images)
    assert "room0.png has 1024 x 1024 px, nothing.png has 300 x 200 px" in message


def test_auto_dewarps_image_by_detected_rim(folder, tmp_path):
    """Same view as with the sensor that rendered the image, up to the outline error."""
    views = {}
    for name, camera in {
        "auto": ["--auto", "--mirror", "paper-spherical"],
        "told": ["--sensor", "paper-spherical"],
    }.items():
        run = omnimirror("dewarp", folder / "room0.png", *camera, "-o", tmp_path / f"{name}.png")
        assert run.returncode == 0, run.stderr
        views[name] = om.read_image(tmp_path / f"{name}.png")[..., :3].astype(float)
    width = min(view.shape[1] for view in views.values())
    height = min(view.shape[0] for view in views.values())
    assert abs(views["auto"].shape[1] / views["told"].shape[1] - 1) < 0.01
    assert np.median(np.abs(views["auto"][:height, :width] - views["told"][:height, :width])) < 4


def test_assumed_mirror_is_reported(folder, tmp_path):
    run = omnimirror("dewarp", folder / "disc.png", "--auto", "-o", tmp_path / "view.png")
    assert run.returncode == 0, run.stderr
    assert "assumed mirror: one-shot" in run.stderr
    assert "specify another with --mirror" in run.stderr


def test_ball_orientation_is_reported(folder, tmp_path):
    """A camera looks slightly down at a ball: the view is that of a tilted ball."""
    ball = om.MirrorBall(
        centre_px=(299.5, 299.5),
        rim_radius_px=270.0,
        field_deg=340.0,
        image_size=(600, 600),
        mount=Mount("forward", pitch_deg=-15.0, roll_deg=3.0),
    )
    om.write_image(tmp_path / "ball.png", om.render_image(ball, om.Room(texel_mm=20.0), samples=1))
    command = ("dewarp", tmp_path / "ball.png", "--auto", "--mirror", "ball", "-o")
    run = omnimirror(*command, tmp_path / "view.png")
    assert run.returncode == 0, run.stderr
    match = re.search(
        r"look forward \(--camera-looks\); tilt (\S+),(\S+) deg, from \d+ vertical edges",
        run.stderr,
    )
    assert match is not None, run.stderr
    assert (float(match[1]), float(match[2])) == pytest.approx((-15.0, 3.0), abs=0.5)
    run = omnimirror(*command, tmp_path / "told.png", "--set", "camera.level=-15,3")
    assert run.returncode == 0, run.stderr
    assert "the camera" not in run.stderr
    expected, result = (
        om.read_image(tmp_path / name)[..., :3].astype(float) for name in ("told.png", "view.png")
    )
    assert np.median(np.abs(expected - result)) < 4
    run = omnimirror(
        "dewarp", folder / "disc.png", "--auto", "--mirror", "ball", "-o", tmp_path / "disc.png"
    )
    assert "the camera is assumed to look forward without tilt" in run.stderr


@pytest.mark.full
def test_ambiguous_tilt_is_reported(tmp_path):
    """The camera reflection in a hyperboloid is at nearly the same position for both signs of the
    tilt."""
    sensor = om.load_sensor("prototype-hyperboloidal")
    imager = replace(sensor.imager, width_px=1100, height_px=1100, centre_px=None)
    tilted = replace(sensor, imager=imager, mirror_pose=MirrorPose(0.5, 1.0, 0.0, -5.0, 2.0))
    om.write_image(
        tmp_path / "tilted.png",
        om.render_image(tilted, om.load_scene("room", texel_mm=20.0), samples=1),
    )
    run = omnimirror(
        "dewarp",
        tmp_path / "tilted.png",
        "--auto",
        "--mirror",
        "prototype-hyperboloidal",
        "-o",
        tmp_path / "view.png",
    )
    assert run.returncode == 0, run.stderr
    match = re.search(
        r"tilt (\S+), (\S+) deg about x and y assumed; (\S+), (\S+) deg has", run.stderr
    )
    assert match is not None, run.stderr
    assert [float(match[k]) for k in (1, 2)] == [
        pytest.approx(-5.0, abs=0.4),
        pytest.approx(2.0, abs=0.4),
    ]
    assert float(match[3]) > 1.0


def test_auto_with_invalid_arguments(folder, tmp_path):
    view = tmp_path / "view.png"
    assert "the confidence of the mirror outline must be at least 0.6" in fails(
        "dewarp", folder / "nothing.png", "--auto", "-o", view
    )
    assert not view.exists()
    assert "--auto and --ball must not be given together" in fails(
        "dewarp", folder / "room0.png", "--auto", "--ball", "1,2,3,90", "-o", view
    )
    assert "--mirror requires --auto" in fails(
        "dewarp", folder / "room0.png", "--mirror", "ball", "-o", view
    )
    assert "presets: one-shot" in fails(
        "dewarp", folder / "nothing.png", "--auto", "--mirror", "bal", "-o", view
    )  # raised before the detection


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "video.crf=20"], "--set video.crf requires a video"),
        (["--set", "restoration.noise=0.01"], "--set restoration.noise requires --restore"),
        (["--restore", "--set", "restoration.blur_px=1,2,3"], "got (1, 2, 3)"),
        (["-o", "view.xyz"], "got '.xyz'"),
    ],
)
def test_auto_checks_options_before_detection(options, message, folder, tmp_path):
    output = [] if "-o" in options else ["-o", tmp_path / "view.png"]
    error = fails("dewarp", folder / "nothing.png", "--auto", *options, *output)
    assert message in error
    assert "detected rim" not in error
