"""Datasets resumed after their process was killed, and datasets regenerated from their manifest."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.io.keyframes import Keyframes
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.simulation.dataset_manifest import (
    CalibrationRecipe,
    VideoRecipe,
    format_of,
    load_recipe,
    recipe_record,
)
from omnimirror.simulation.datasets import (
    write_calibration_dataset,
    write_video_dataset,
)
from omnimirror.simulation.detector import Detector
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.room import Room
from omnimirror.simulation.scenes.scene_sources import SceneSource
from tests.commands import fails, omnimirror
from tests.simulation.test_calibration_datasets import PATH, small

HALL = Hall(texel_mm=50.0)
ROOT = Path(__file__).parents[2]
KILLED = """
import signal, sys
from tests.simulation.test_dataset_manifest import write

def stand_still(done):
    if done == 3:
        signal.pause()

write(sys.argv[1], sys.argv[2], stand_still)
"""


def write(kind, folder, after=lambda done: None):
    """Write a dataset of five images."""
    sensor = small(64)
    if kind == "calibration":
        write_calibration_dataset(
            CalibrationRecipe(
                sensor=sensor,
                views=5,
                samples=4,
                blur=False,
                detector=Detector(full_well_e=1e4),
                hall=HALL,
            ),
            folder,
            on_progress=lambda n, _: after(n),
        )
    else:
        write_video_dataset(
            VideoRecipe(
                sensor=sensor,
                scene=Room(texel_mm=40.0),
                path=PATH,
                frame_rate=4.0,
                samples=4,
                blur=False,
            ),
            folder,
            on_progress=lambda n, _: after(n),
        )


def wait_for(condition, description):
    """Wait for a state; the limit only ends a hanging run."""
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end, f"timeout while waiting until {description}"
        time.sleep(0.002)


def contents(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


@pytest.fixture(scope="module")
def scene_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets")
    om.save_sensor(small(64), folder / "small.toml")
    om.write_image(
        folder / "sky.hdr", np.random.default_rng(1).uniform(0, 1, (16, 32, 3)).astype(np.float32)
    )
    (folder / "path.csv").write_text("time_s,pan_deg\n0,0\n0.2,90\n")
    return folder


@pytest.mark.full
@pytest.mark.parametrize("kind", ["calibration", "video"])
def test_killed_dataset_is_resumed(kind, tmp_path):
    """Completed items are not regenerated after SIGKILL, and all files equal those of an
    undisturbed run."""
    if kind == "video":
        pytest.importorskip("av")
    partial_folder, whole = tmp_path / "killed", tmp_path / "whole"
    run = subprocess.Popen([sys.executable, "-c", KILLED, kind, partial_folder], cwd=ROOT)

    def done():
        try:
            files = json.loads((partial_folder / "dataset.json").read_text())["files"]
        except FileNotFoundError:
            return []
        return [name for name in files if name.endswith(".png")]

    wait_for(lambda: len(done()) >= 3 or run.poll() is not None, "three images are done")
    run.send_signal(signal.SIGKILL)
    assert run.wait() == -signal.SIGKILL
    data, images = json.loads((partial_folder / "dataset.json").read_text()), done()
    assert not data["complete"]
    assert len(images) == 3
    if kind == "calibration":
        assert [view["image"] for view in data["views"]] == images
        assert all(view["corners_px"] for view in data["views"])
    before = {name: om.read_image(partial_folder / name) for name in images}
    stamps = {name: (partial_folder / name).stat().st_mtime_ns for name in images}
    (
        partial_folder
        / {"calibration": ".view-003-abcd_123.png", "video": ".video-abcd_123.mp4"}[kind]
    ).touch()

    def compare(number):
        if number == 4:
            assert {name: (partial_folder / name).stat().st_mtime_ns for name in images} == stamps

    write(kind, partial_folder, compare)
    write(kind, whole)
    assert all(image.shape == (64, 64, 3) for image in before.values())
    assert json.loads((partial_folder / "dataset.json").read_text())["complete"]
    assert contents(partial_folder) == contents(whole)


def test_changed_image_is_rendered_again(tmp_path):
    def write():
        write_calibration_dataset(
            CalibrationRecipe(sensor=small(), views=2, samples=1, blur=False, hall=HALL),
            tmp_path,
        )

    write()
    first = contents(tmp_path)
    (tmp_path / "view-000.png").write_bytes(b"something else")
    time_ns = (tmp_path / "view-001.png").stat().st_mtime_ns
    write()
    assert contents(tmp_path) == first
    assert (tmp_path / "view-001.png").stat().st_mtime_ns == time_ns


def test_other_dataset_is_not_overwritten(tmp_path):
    write_calibration_dataset(
        CalibrationRecipe(sensor=small(), views=1, samples=1, blur=False, hall=HALL), tmp_path
    )
    before = contents(tmp_path)
    with pytest.raises(InvalidParameter, match="differs in samples, seed"):
        write_calibration_dataset(
            CalibrationRecipe(sensor=small(), views=1, samples=4, blur=False, hall=HALL, seed=2),
            tmp_path,
        )
    assert contents(tmp_path) == before


def test_failed_dataset_leaves_no_files(tmp_path):
    far = Keyframes({"x_mm": ((0.0, 1e6), (1.0, 1e6))})
    with pytest.raises(InvalidParameter, match="must be inside the room"):
        write_video_dataset(
            VideoRecipe(
                sensor=small(),
                scene=Room(texel_mm=40.0),
                path=far,
                frame_rate=2.0,
                samples=1,
                blur=False,
            ),
            tmp_path / "set",
        )
    assert not (tmp_path / "set").exists()


# -- regeneration
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize("shell", [None, Tube(140.0), Dome(inner_shift_mm=0.5)])
@pytest.mark.parametrize("reflectivity", [0.9, "gold", 0.96 + 6.69j, ("silver", 0.5, 1j + 2)])
def test_recipe_round_trip(tmp_path, shell, reflectivity):
    """Round trip of every argument of the writers."""
    recipe = VideoRecipe(
        sensor=replace(small(), housing=Housing(CameraBody(20.0), Rod(2 / 3), shell, Rim(1.0))),
        radiometry=Radiometry(reflectivity=reflectivity),
        detector=Detector(0.7, 1e4, 2.5, 12, "linear", "RGGB", 64.0),
        path=Keyframes({"x_mm": ((0.0, 0.1), (1.0, 600.0))}, "linear"),
        scene=SceneSource("street", 50.0),
        seed=7,
    )
    manifest = {"format": format_of("video"), "recipe": recipe_record(recipe)}
    (tmp_path / "dataset.json").write_text(json.dumps(manifest))
    loaded, created_with = load_recipe(tmp_path / "dataset.json")
    assert loaded == recipe
    assert created_with == version("omnimirror")


def test_other_format_raises(tmp_path):
    """Datasets of format 2 stored the housing outside the sensor, as 'hardware' and 'shell'."""
    recipe = recipe_record(CalibrationRecipe(sensor=small())) | {
        "hardware": {"rod_radius_mm": 4.0},
        "shell": None,
    }
    (tmp_path / "dataset.json").write_text(
        json.dumps({"format": "omnimirror calibration set 2", "recipe": recipe})
    )
    stderr = fails(
        "simulate", "dataset", "--reproduce", tmp_path / "dataset.json", "-o", tmp_path / "other"
    )
    assert (
        "must have the format 'omnimirror calibration dataset 3'; got 'omnimirror calibration set 2'"
        in stderr
    )
    assert not (tmp_path / "other").exists()


def regenerated(scene_folder, name, *options):
    run = omnimirror("simulate", "dataset", "small.toml", *options, "-o", name, cwd=scene_folder)
    assert run.returncode == 0, run.stderr
    run = omnimirror(
        "simulate",
        "dataset",
        "--reproduce",
        f"{name}/dataset.json",
        "-o",
        f"{name}-again",
        cwd=scene_folder,
    )
    assert run.returncode == 0, run.stderr
    files = contents(scene_folder / name)
    assert files == contents(scene_folder / f"{name}-again")
    return files


def test_video_dataset_is_reproducible(scene_folder):
    pytest.importorskip("av")
    pytest.importorskip("OpenEXR")
    options = (
        "--path",
        "path.csv",
        "--set",
        "video.fps=10",
        "--scene",
        "sky.hdr",
        "--set",
        "scene.heading_deg=30",
        "--spp",
        4,
        "--truth",
    )
    files = regenerated(
        scene_folder,
        "drive",
        *options,
        "--set",
        "housing.tube={}",
        "--set",
        "detector.full_well_e=5000",
        "--set",
        "rendering.seed=3",
    )
    frames = [f"frame-{number:05d}.exr" for number in range(3)]
    assert sorted(files) == ["dataset.json", *frames, "poses.csv", "sensor.toml", "video.mp4"]
    data = json.loads(files["dataset.json"])
    assert data["recipe"]["seed"] == 3
    assert data["recipe"]["omnimirror"] == version("omnimirror")
    assert om.optics.sensor_files.parse_sensor(data["recipe"]["sensor"]).housing.shell == Tube()
    assert "refused" not in data


def test_calibration_dataset_is_reproducible(tmp_path):
    sensor = replace(small(), housing=Housing(CameraBody(50.0), shell=Dome(260.0), rim=Rim(1.0)))
    dim = Radiometry(reflectivity=("gold", 0.96 + 6.69j, 0.5))
    camera = Detector(full_well_e=4000.0, read_noise_e=4.0, bits=12, curve="linear", bayer="RGGB")
    write_calibration_dataset(
        CalibrationRecipe(
            sensor=sensor,
            views=2,
            samples=1,
            blur=True,
            radiometry=dim,
            detector=camera,
            seed=5,
            hall=HALL,
        ),
        tmp_path / "a",
    )
    recipe, _ = load_recipe(tmp_path / "a" / "dataset.json")
    assert isinstance(recipe, CalibrationRecipe)
    write_calibration_dataset(recipe, tmp_path / "b")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_changed_scene_or_option_raises(scene_folder, tmp_path):
    pytest.importorskip("av")
    (tmp_path / "sky.hdr").write_bytes((scene_folder / "sky.hdr").read_bytes())
    source = SceneSource(str(tmp_path / "sky.hdr"))
    write_video_dataset(
        VideoRecipe(
            sensor=small(64), scene=source, path=PATH, frame_rate=1.0, duration_s=0.0, samples=1
        ),
        tmp_path / "set",
    )
    description = tmp_path / "set" / "dataset.json"
    assert "must not be given together" in fails(
        "simulate",
        "dataset",
        "--reproduce",
        description,
        "--set",
        "rendering.seed=4",
        "-o",
        tmp_path / "other",
    )
    om.write_image(tmp_path / "sky.hdr", np.ones((16, 32, 3), np.float32))
    with pytest.raises(MediaError, match=r"sky.hdr of the dataset has changed"):
        load_recipe(description)
    os.remove(tmp_path / "sky.hdr")
    with pytest.raises(MediaError, match=r"sky.hdr of the dataset is missing"):
        load_recipe(description)
    description.write_text('{"format": "old"}')
    with pytest.raises(MediaError, match=r"must be the dataset.json of a dataset"):
        load_recipe(description)


# -- shells ------------------------------------------------------------------------------------------


@pytest.mark.full
def test_corners_in_tube_match_images(tmp_path):
    """The image is traced through the wall, and corners use the solution of the wall: OpenCV
    detects them there."""
    import cv2

    sensor = replace(om.load_sensor("paper-equidistant"), housing=Housing(shell=Tube(120.0, 5.0)))
    write_calibration_dataset(
        CalibrationRecipe(sensor=sensor, views=1, samples=4, blur=False, hall=Hall(texel_mm=12.5)),
        tmp_path,
    )
    view = json.loads((tmp_path / "dataset.json").read_text())["views"][0]
    grey = om.read_image(tmp_path / view["image"])[..., 1].copy()
    expected = np.array(
        [c for board in view["corners_px"].values() for row in board for c in row if c is not None]
    )
    inner = expected[np.hypot(*(expected - 511.5).T) < 440]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    corners = cv2.cornerSubPix(
        grey, inner.astype(np.float32)[:, None].copy(), (3, 3), (-1, -1), criteria
    )[:, 0]
    assert np.median(np.hypot(*(corners - inner).T)) < 0.1
    assert abs(np.median(corners - inner, axis=0)).max() < 0.02
