"""Calibration datasets: stated corners equal those in the images."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.io.keyframes import Keyframes
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.dataset_manifest import CalibrationRecipe, VideoRecipe, load_recipe
from omnimirror.simulation.datasets import (
    view_poses,
    visible_corners_px,
    write_calibration_dataset,
    write_video_dataset,
)
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.room import Room
from omnimirror.simulation.scenes.scene import Pose


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    sensor = om.load_sensor("paper-equidistant")
    count = write_calibration_dataset(
        CalibrationRecipe(
            sensor=sensor, views=2, samples=4, blur=False, hall=Hall(texel_mm=12.5), seed=3
        ),
        folder,
    )
    return folder, count, json.loads((folder / "dataset.json").read_text())


def test_calibration_dataset_is_complete(dataset):
    folder, count, data = dataset
    assert count == 2
    names = ["dataset.json", "sensor.toml", "view-000.png", "view-001.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert om.load_sensor(folder / data["sensor"]).name == "paper-equidistant"
    assert data["views"][0]["pose"] == {f"{n}_mm": 0.0 for n in "xyz"} | {
        f"{n}_deg": 0.0 for n in ("pan", "tilt", "roll")
    }
    assert len(data["boards_mm"]) == 18
    assert all(len(view["corners_px"]) > 8 for view in data["views"])


def test_corners_match_opencv(dataset):
    """Subpixel saddle points of the image, searched from 1 px off the true position."""
    folder, _, data = dataset
    for view in data["views"]:
        grey = cv2.cvtColor(om.read_image(folder / view["image"]), cv2.COLOR_RGB2GRAY)
        expected = np.array(
            [
                c
                for board in view["corners_px"].values()
                for row in board
                for c in row
                if c is not None
            ]
        )
        inner = np.hypot(*(expected - 511.5).T) < 440
        start = (expected[inner] + [0.7, -0.7]).astype(np.float32)
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        corners = cv2.cornerSubPix(grey, start[:, None].copy(), (3, 3), (-1, -1), criteria)[:, 0]
        distances_px = np.hypot(*(corners - expected[inner]).T)
        assert len(distances_px) > 400
        assert np.median(distances_px) < 0.1
        assert np.quantile(distances_px, 0.9) < 0.2
        assert abs(np.median(corners - expected[inner], axis=0)).max() < 0.02


def test_occluded_corners_are_omitted():
    """The whole board is visible from its front, and only its back from behind."""
    sensor, hall = om.load_sensor("paper-spherical"), Hall(texel_mm=50.0)
    assert np.isfinite(visible_corners_px(sensor, hall, Pose())["A4"]).all()
    assert np.isnan(visible_corners_px(sensor, hall, Pose(x_mm=3200.0))["A4"]).all()


def test_poses_are_reproducible():
    assert view_poses(5, seed=2) == view_poses(5, seed=2)
    assert len({*view_poses(30)}) == 30
    with pytest.raises(InvalidParameter, match=r"views must be .*; got 0"):
        view_poses(0)


def small(pixels=96):
    sensor = om.load_sensor("paper-spherical")
    pitch = 5.2 * 1024 / pixels
    return replace(
        sensor,
        imager=replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch),
    )


PATH = Keyframes({"x_mm": ((0.0, 0.0), (1.0, 600.0)), "pan_deg": ((0.0, 0.0), (1.0, 45.0))})


def test_video_dataset_poses_and_ground_truth(tmp_path):
    pytest.importorskip("av")
    library = pytest.importorskip("OpenEXR")
    from omnimirror.io.video_reader import VideoReader
    from omnimirror.simulation.simulated_video import load_path

    room, sensor = Room(texel_mm=40.0), small()
    assert (
        write_video_dataset(
            VideoRecipe(
                sensor=sensor,
                scene=room,
                path=PATH,
                frame_rate=4.0,
                samples=1,
                blur=False,
                truth=True,
            ),
            tmp_path,
        )
        == 5
    )
    data = json.loads((tmp_path / "dataset.json").read_text())
    assert data["frames"] == VideoReader(tmp_path / data["video"]).expected_frames == 5
    poses = load_path(tmp_path / data["poses"])
    assert poses.at(0.75)["x_mm"] == pytest.approx(PATH.at(0.75)["x_mm"])
    with library.File(str(tmp_path / (data["truth"] % 3)), separate_channels=True) as file:
        depth = np.array(file.channels()["Z"].pixels)
    pixel, pose = [60, 30], Pose(**PATH.at(0.75))
    rays = om.load_sensor(tmp_path / data["sensor"]).backproject([pixel])
    start, end = pose.to_scene(rays.origins), pose.to_scene(rays.origins + rays.directions)
    assert depth[pixel[1], pixel[0]] == pytest.approx(
        room.distance_mm(start, end - start)[0], rel=1e-5
    )


def test_interrupted_dataset_describes_files(tmp_path):
    pytest.importorskip("av")

    def stop(done, _):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video_dataset(
            VideoRecipe(
                sensor=small(),
                scene=Room(texel_mm=40.0),
                path=PATH,
                frame_rate=9.0,
                samples=1,
                blur=False,
            ),
            tmp_path / "v",
            on_progress=stop,
        )
    assert json.loads((tmp_path / "v/dataset.json").read_text())["frames"] == 2
    assert len((tmp_path / "v/poses.csv").read_text().splitlines()) == 3
    with pytest.raises(KeyboardInterrupt):
        write_calibration_dataset(
            CalibrationRecipe(
                sensor=small(), views=5, samples=1, blur=False, hall=Hall(texel_mm=50.0)
            ),
            tmp_path / "c",
            on_progress=stop,
        )
    described = json.loads((tmp_path / "c/dataset.json").read_text())
    assert [view["image"] for view in described["views"]] == ["view-000.png", "view-001.png"]
    images = sorted(path.name for path in (tmp_path / "c").glob("*.png"))
    assert images == ["view-000.png", "view-001.png"]


def test_command_writes_dataset(tmp_path):
    from tests.commands import omnimirror

    om.save_sensor(small(), tmp_path / "small.toml")
    run = omnimirror(
        "simulate", "dataset", "small.toml", "-o", "set", "--views", 1, "--spp", 1, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert sorted(p.name for p in (tmp_path / "set").iterdir()) == [
        "dataset.json",
        "sensor.toml",
        "view-000.png",
    ]


@pytest.mark.parametrize(
    "camera",
    [
        om.Unified(
            xi=0.9,
            focal_px=(260.0, 262.0),
            centre_px=(322.0, 315.0),
            image_size=(640, 640),
            k1=-0.02,
            p1=1e-3,
            rim_radius_px=300.0,
        ),
        om.ViewpointSpline(
            radii_px=(70.0, 140.0, 205.0, 262.0, 310.0),
            viewpoints_mm=(0.0, -2.0, -6.0, -12.0, -20.0),
            field_deg=260.0,
            centre_px=(322.0, 315.0),
            image_size=(640, 640),
        ),
        replace(
            om.load_sensor("paper-equidistant"), mirror_pose=MirrorPose(1.0, -0.5, 0.0, 0.6, -0.8)
        ),
    ],
    ids=["central", "non-central", "misaligned mirror"],
)
def test_dataset_of_calibrated_camera(camera, tmp_path):
    """OpenCV detects its corners at their positions in its images, and its file is the camera."""
    hall = Hall(texel_mm=12.5)
    write_calibration_dataset(
        CalibrationRecipe(sensor=camera, views=1, samples=4, blur=False, hall=hall), tmp_path
    )
    data = json.loads((tmp_path / "dataset.json").read_text())
    assert om.load_camera(tmp_path / data["sensor"]) == camera
    assert load_recipe(tmp_path / "dataset.json").recipe.sensor == camera
    grey = cv2.cvtColor(om.read_image(tmp_path / "view-000.png"), cv2.COLOR_RGB2GRAY)
    (view,) = data["views"]
    expected = np.array(
        [c for board in view["corners_px"].values() for row in board for c in row if c is not None]
    )
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    start = (expected + np.array([0.5, -0.5])).astype(np.float32)
    corners = cv2.cornerSubPix(grey, start[:, None].copy(), (2, 2), (-1, -1), criteria)[:, 0]
    distances_px = np.hypot(*(corners - expected).T)
    assert len(distances_px) > 300
    assert np.median(distances_px) < 0.15
    assert abs(np.median(corners - expected, axis=0)).max() < 0.03


def test_blur_of_calibrated_camera_raises(tmp_path):
    camera = om.Unified(xi=0.9, focal_px=(40.0, 40.0), centre_px=(47.5, 47.5), image_size=(96, 96))
    write_calibration_dataset(
        CalibrationRecipe(sensor=camera, views=1, samples=1, hall=Hall(texel_mm=50.0)),
        tmp_path / "set",
    )
    assert json.loads((tmp_path / "set/dataset.json").read_text())["recipe"]["blur"] is False
    with pytest.raises(InvalidParameter, match="blur must be False unless the camera is a sensor"):
        write_calibration_dataset(
            CalibrationRecipe(sensor=camera, views=1, samples=1, blur=True), tmp_path / "other"
        )
