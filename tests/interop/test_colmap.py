"""COLMAP projects: files read back by the definitions of COLMAP; tests/full runs a reconstruction."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.formats._colmap import KINDS
from omnimirror.interop.colmap import MODEL_IDS, write_colmap
from omnimirror.interop.pinholes import camera_rig, view_mask
from omnimirror.io.keyframes import Keyframes
from omnimirror.optics.housing import CameraBody, Housing
from tests.commands import omnimirror

SPH = om.load_sensor("paper-spherical")
POSES = [
    om.Pose(400.0, -200.0, 50.0, pan_deg=30.0, tilt_deg=5.0),
    om.Pose(700.0, 0.0, 0.0, roll_deg=3.0),
]


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    for k in range(2):
        om.write_image(folder / f"{k}.png", np.full((1024, 1024, 3), 100 + k, np.uint8))
    return folder


@pytest.fixture(scope="module")
def project(images, tmp_path_factory):
    sensor = replace(SPH, housing=Housing(CameraBody(60.0)))
    return write_colmap(
        sensor,
        images,
        tmp_path_factory.mktemp("colmap") / "project",
        views_around=5,
        tilt_deg=-45.0,
        hfov_deg=90.0,
        size=120,
        poses=POSES,
    )


def rows(project, table):
    with closing(sqlite3.connect(project.folder / "database.db")) as base:
        return list(base.execute(f"SELECT * FROM {table}"))


def test_model_ids_equal_those_of_the_camera_file_format():
    assert {name: KINDS[name].number for name in MODEL_IDS} == MODEL_IDS


def test_database_lists_images_cameras_and_frames(project):
    names = [f"{view.name}/{k}.png" for k in range(2) for view in project.rig]
    assert [name for _, name, _ in rows(project, "images")] == names
    assert all((project.folder / "images" / name).is_file() for name in names)
    assert all((project.folder / "masks" / f"{name}.png").is_file() for name in names)
    cameras = {
        number: (*size, np.frombuffer(p)) for number, _, *size, p, _ in rows(project, "cameras")
    }
    width, height, (fx, fy, cx, cy) = cameras[3]
    assert (width, height, cx, cy) == (120, 120, 60.0, 60.0)
    assert fx == fy == pytest.approx(60.0)  # hfov 90 deg
    frames = [(frame, image, camera) for frame, image, camera, _ in rows(project, "frame_data")]
    assert frames == [(1 + k // 5, 1 + k, 1 + k % 5) for k in range(10)]


def test_rig_poses_transform_points_between_cameras(project):
    """Transform a world point from the reference camera to all others."""
    rig, point = project.rig, np.array([900.0, 1300.0, -400.0])
    in_first = rig[0].rotation.T @ (point - rig[0].position_mm) / 1000
    (config,) = json.loads((project.folder / "rig_config.json").read_text())
    assert [entry["image_prefix"] for entry in config["cameras"]] == [
        f"{view.name}/" for view in rig
    ]
    assert [entry.get("ref_sensor", False) for entry in config["cameras"]] == [True] + 4 * [False]
    stored = [np.frombuffer(blob) for *_, blob in rows(project, "rig_sensors")]
    for view, entry, pose in zip(rig[1:], config["cameras"][1:], stored, strict=True):
        np.testing.assert_allclose(pose[:4], entry["cam_from_rig_rotation"])
        np.testing.assert_allclose(pose[4:], entry["cam_from_rig_translation"])
        rotation = Rotation.from_quat(np.roll(pose[:4], -1)).as_matrix()
        expected = view.rotation.T @ (point - view.position_mm) / 1000
        np.testing.assert_allclose(rotation @ in_first + pose[4:], expected, atol=1e-12)


def test_masks_exclude_the_rim_and_the_camera_body(project):
    mask = om.read_image(project.folder / "masks" / "view-000" / "0.png.png")
    mask = mask[..., 0] if mask.ndim == 3 else mask
    assert set(np.unique(mask)) == {0, 255}
    assert not mask[-1, 60]  # nadir: the camera itself
    assert mask[60, 60]
    high = camera_rig(SPH, 1, tilt_deg=40.0, size=120)[0]  # above the rim at 45 deg elevation
    above = view_mask(SPH, om.Dewarper(SPH, high.screen))
    assert not above[0, 60]
    assert above[-1, 60]


@pytest.mark.parametrize("distance", [1000.0, 3000.0, 10000.0])
def test_transforms_project_scene_points_within_the_reported_error(project, distance):
    frames = json.loads((project.folder / "transforms.json").read_text())["frames"]
    assert len(frames) == 10
    count = 0
    for frame, (pose, view) in zip(
        frames, [(p, v) for p in POSES for v in project.rig], strict=True
    ):
        pose_matrix, rng = np.array(frame["transform_matrix"]), np.random.default_rng(3)
        points = (
            np.concatenate([rng.uniform(-0.8, 0.8, (60, 2)), np.full((60, 1), -1.0)], axis=1)
            * distance
            / 1000
        )
        scene = (pose_matrix[:3, :3] @ points.T).T + pose_matrix[:3, 3]
        file_pixels = (
            np.array([frame["fl_x"] * points[:, 0], -frame["fl_y"] * points[:, 1]]).T
            / -points[:, 2:]
        )
        file_pixels += [frame["cx"] - 0.5, frame["cy"] - 0.5]
        pixels, valid = SPH.project(pose.to_sensor(1000 * scene))
        rays = SPH.backproject(pixels[valid])  # pixel of the view for the direction of this ray
        heading = rays.directions @ view.rotation
        dewarped = view.parameters[0] * heading[:, :2] / heading[:, 2:] + (frame["w"] - 1) / 2
        assert np.abs(dewarped - file_pixels[valid]).max() <= view.errors_px[distance] * 1.05
        count += int(valid.sum())
    assert count > 300


def test_panorama_is_one_camera_with_error_inverse_to_distance(images, tmp_path):
    project = write_colmap(SPH, [images / "0.png"], tmp_path / "p", panorama=True, size=360)
    ((_, model, *size, _, _),) = rows(project, "cameras")
    assert (model, *size) == (17, 360, 180)
    near, _, far = project.rig[0].errors_px.values()
    assert near / far == pytest.approx(10.0, rel=0.1)
    assert 0.1 < near < 2.0
    single = om.load_sensor("paper-hyperboloidal")
    assert camera_rig(single, panorama=True, size=3600)[0].errors_px[1000.0] < 0.1


def test_view_at_a_distance_is_exact_there():
    (view,) = camera_rig(SPH, 1, size=200, distance_mm=3000.0)
    assert view.errors_px[3000.0] < 1e-6 < 0.2 < view.errors_px[1000.0]


def test_every_second_frame_of_a_video(tmp_path):
    av = pytest.importorskip("av")
    film, moves = tmp_path / "ride.mp4", Keyframes({"x_mm": ((0.0, 0.0), (1.0, 400.0))}, "linear")
    small = replace(
        SPH, imager=replace(SPH.imager, width_px=128, height_px=128, pixel_pitch_um=5.2 * 8)
    )
    room = om.Room(texel_mm=40.0)
    om.write_video(om.ImageSequence(small, room, moves, frame_rate=4.0, samples=1), film)
    poses = [om.Pose(**moves.at(k / 4)) for k in range(5)]
    project = write_colmap(
        small, film, tmp_path / "a", views_around=2, size=48, every=2, poses=poses
    )
    names = [f"{view.name}/frame-{k:06d}.png" for k in (0, 2, 4) for view in project.rig]
    assert [name for _, name, _ in rows(project, "images")] == names
    frames = json.loads((project.folder / "transforms.json").read_text())["frames"]
    assert [frame["file_path"] for frame in frames] == [f"images/{name}" for name in names]
    positions_m = [
        frame["transform_matrix"][0][3] for frame in frames if "view-000" in frame["file_path"]
    ]
    np.testing.assert_allclose(np.diff(positions_m), [0.2, 0.2])
    whole = write_colmap(small, film, tmp_path / "b", views_around=2, size=48)
    assert whole.images == 5
    one, same = (
        om.read_image(at / "images" / "view-000" / "frame-000004.png")
        for at in (project.folder, whole.folder)
    )
    np.testing.assert_array_equal(one, same)
    with av.open(str(film)) as container:
        last = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)][4]
    straight = om.Dewarper(small, whole.rig[0].screen, "cubic")(last)
    assert (
        np.abs(one.astype(int) - straight).max() <= 3
    )  # rounding of the colour conversion by FFmpeg
    with pytest.raises(
        InvalidParameter, match="poses must have one entry per image; got 2 poses for 5 images"
    ):
        write_colmap(small, film, tmp_path / "c", poses=POSES)
    with pytest.raises(
        InvalidParameter, match="image files or a single video; got 2 entries with a video"
    ):
        write_colmap(small, [film, film], tmp_path / "c")


def test_invalid_arguments_raise(images, project, tmp_path):
    with pytest.raises(InvalidParameter, match="got 2 poses for 1 images"):
        write_colmap(SPH, [images / "0.png"], tmp_path / "a", poses=POSES)
    with pytest.raises(InvalidParameter, match="folder must not contain a project"):
        write_colmap(SPH, [images / "0.png"], project.folder)
    with pytest.raises(InvalidParameter, match=r"transforms\.json requires pinhole cameras"):
        write_colmap(SPH, images, tmp_path / "b", poses=POSES, panorama=True, size=360)
    with pytest.raises(
        InvalidParameter, match=r"views_around must be an integer between 1 and .*; got 0"
    ):
        write_colmap(SPH, images, tmp_path / "c", views_around=0)
    assert not list(tmp_path.iterdir())


def test_command_with_poses(images, tmp_path):
    (tmp_path / "poses.csv").write_text("time_s,x_mm\n0,0\n0.04,100\n")
    run = omnimirror(
        "colmap",
        "paper-spherical",
        str(images),
        "--set",
        "view.size=64",
        "--views",
        "4",
        "--poses",
        "poses.csv",
        "-o",
        "project",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "view-270  64 x 64" in run.stdout
    frames = json.loads((tmp_path / "project" / "transforms.json").read_text())["frames"]
    translation = np.array(frames[4]["transform_matrix"]) - frames[0]["transform_matrix"]
    np.testing.assert_allclose(translation[:3, 3], [0.1, 0, 0], atol=1e-12)
    run = omnimirror(
        "colmap",
        "paper-spherical",
        str(images),
        "--panorama",
        "--hfov-deg",
        60,
        "-o",
        "o",
        cwd=tmp_path,
    )
    assert "--hfov-deg must not be given with --panorama" in run.stderr
