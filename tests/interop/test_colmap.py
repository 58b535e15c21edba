"""Projects for COLMAP, read back as its files are defined; tests/full reconstructs from one."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnimirror as om
from omnimirror.calibrate.formats.colmap import KINDS
from omnimirror.errors import InvalidParameter
from omnimirror.housing import CameraBody, Housing
from omnimirror.interop.colmap import rig_of, write_colmap
from omnimirror.interop.colmap.database import MODELS
from omnimirror.media.keyframes import Keyframes
from tests.commands import omnimirror

SPH = om.load_sensor("paper-spherical")
POSES = [om.Pose(400.0, -200.0, 50.0, pan_deg=30.0, tilt_deg=5.0), om.Pose(700.0, 0.0, 0.0, roll_deg=3.0)]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    for k in range(2):
        om.write_image(folder / f"{k}.png", np.full((1024, 1024, 3), 100 + k, np.uint8))
    return folder


@pytest.fixture(scope="module")
def project(pictures, tmp_path_factory):
    sensor = replace(SPH, housing=Housing(CameraBody(60.0)))
    return write_colmap(
        sensor, pictures, tmp_path_factory.mktemp("colmap") / "project", views_around=5, tilt_deg=-45.0, hfov_deg=90.0,
        size=120, poses=POSES,
    )  # fmt: skip


def rows(project, table):
    with closing(sqlite3.connect(project.folder / "database.db")) as base:
        return list(base.execute(f"SELECT * FROM {table}"))


def test_the_numbers_of_models_are_colmaps():
    assert {name: KINDS[name].number for name in MODELS} == MODELS


def test_the_database_names_every_picture_with_its_camera_and_those_taken_together(project):
    names = [f"{view.name}/{k}.png" for k in range(2) for view in project.rig]
    assert [name for _, name, _ in rows(project, "images")] == names
    assert all((project.folder / "images" / name).is_file() for name in names)
    assert all((project.folder / "masks" / f"{name}.png").is_file() for name in names)
    cameras = {number: (*size, np.frombuffer(p)) for number, _, *size, p, _ in rows(project, "cameras")}
    width, height, (fx, fy, cx, cy) = cameras[3]
    assert (width, height, cx, cy) == (120, 120, 60.0, 60.0)
    assert fx == fy == pytest.approx(60.0)  # 90 deg wide
    taken = [(frame, image, camera) for frame, image, camera, _ in rows(project, "frame_data")]
    assert taken == [(1 + k // 5, 1 + k, 1 + k % 5) for k in range(10)]


def test_rig_file_and_database_place_the_views_where_they_are(project):
    """A point of the sensor's world, through the first camera's frame into every other one."""
    rig, point = project.rig, np.array([900.0, 1300.0, -400.0])
    in_first = rig[0].rotation.T @ (point - rig[0].position_mm) / 1000
    (config,) = json.loads((project.folder / "rig_config.json").read_text())
    assert [entry["image_prefix"] for entry in config["cameras"]] == [f"{view.name}/" for view in rig]
    assert [entry.get("ref_sensor", False) for entry in config["cameras"]] == [True] + 4 * [False]
    stored = [np.frombuffer(blob) for *_, blob in rows(project, "rig_sensors")]
    for view, entry, pose in zip(rig[1:], config["cameras"][1:], stored, strict=True):
        np.testing.assert_allclose(pose[:4], entry["cam_from_rig_rotation"])
        np.testing.assert_allclose(pose[4:], entry["cam_from_rig_translation"])
        turn = Rotation.from_quat(np.roll(pose[:4], -1)).as_matrix()
        wanted = view.rotation.T @ (point - view.position_mm) / 1000
        np.testing.assert_allclose(turn @ in_first + pose[4:], wanted, atol=1e-12)


def test_masks_leave_out_the_rim_and_the_camera_in_the_middle(project):
    mask = om.read_image(project.folder / "masks" / "view-000" / "0.png.png")
    mask = mask[..., 0] if mask.ndim == 3 else mask
    assert set(np.unique(mask)) == {0, 255}
    assert not mask[-1, 60]  # straight down: the camera itself
    assert mask[60, 60]
    high = rig_of(SPH, 1, tilt_deg=40.0, size=120)[0]  # past the rim, at 45 deg up
    from omnimirror.interop.colmap.rig import mask_of

    above = mask_of(SPH, om.Dewarper(SPH, high.screen))
    assert not above[0, 60]
    assert above[-1, 60]


@pytest.mark.parametrize("distance", [1000.0, 3000.0, 10000.0])
def test_transforms_show_points_of_the_scene_where_the_views_do_within_what_is_told(project, distance):
    frames = json.loads((project.folder / "transforms.json").read_text())["frames"]
    assert len(frames) == 10
    checked = 0
    for frame, (pose, view) in zip(frames, [(p, v) for p in POSES for v in project.rig], strict=True):
        placed, rng = np.array(frame["transform_matrix"]), np.random.default_rng(3)
        ahead = np.concatenate([rng.uniform(-0.8, 0.8, (60, 2)), np.full((60, 1), -1.0)], axis=1) * distance / 1000
        scene = (placed[:3, :3] @ ahead.T).T + placed[:3, 3]
        by_file = np.array([frame["fl_x"] * ahead[:, 0], -frame["fl_y"] * ahead[:, 1]]).T / -ahead[:, 2:]
        by_file += [frame["cx"] - 0.5, frame["cy"] - 0.5]
        pixels, seen = SPH.project(pose.to_sensor(1000 * scene))
        rays = SPH.backproject(pixels[seen])  # and the view shows that pixel where its direction is
        towards = rays.directions @ view.rotation
        shown = view.parameters[0] * towards[:, :2] / towards[:, 2:] + (frame["w"] - 1) / 2
        assert np.abs(shown - by_file[seen]).max() <= view.errors_px[distance] * 1.05
        checked += int(seen.sum())
    assert checked > 300


def test_a_panorama_is_one_camera_and_its_error_falls_with_the_distance(pictures, tmp_path):
    project = write_colmap(SPH, [pictures / "0.png"], tmp_path / "p", is_panorama=True, size=360)
    ((_, model, *size, _, _),) = rows(project, "cameras")
    assert (model, *size) == (17, 360, 180)
    near, _, far = project.rig[0].errors_px.values()
    assert near / far == pytest.approx(10.0, rel=0.1)
    assert 0.1 < near < 2.0
    single = om.load_sensor("paper-hyperboloidal")
    assert rig_of(single, is_panorama=True, size=3600)[0].errors_px[1000.0] < 0.1


def test_a_view_at_a_distance_is_exact_there():
    (view,) = rig_of(SPH, 1, size=200, distance_mm=3000.0)
    assert view.errors_px[3000.0] < 1e-6 < 0.2 < view.errors_px[1000.0]


def test_frames_of_a_video_are_pictures_one_of_so_many(tmp_path):
    av = pytest.importorskip("av")
    film, moves = tmp_path / "ride.mp4", Keyframes({"x_mm": ((0.0, 0.0), (1.0, 400.0))}, "linear")
    small = replace(SPH, imager=replace(SPH.imager, width_px=128, height_px=128, pixel_pitch_um=5.2 * 8))
    om.write_video(small, om.Room(texel_mm=40.0), path=moves, output=film, frame_rate=4.0, samples=1)
    poses = [om.Pose(**moves.at(k / 4)) for k in range(5)]
    done = write_colmap(small, film, tmp_path / "a", views_around=2, size=48, every=2, poses=poses)
    names = [f"{view.name}/frame-{k:06d}.png" for k in (0, 2, 4) for view in done.rig]
    assert [name for _, name, _ in rows(done, "images")] == names
    frames = json.loads((done.folder / "transforms.json").read_text())["frames"]
    assert [frame["file_path"] for frame in frames] == [f"images/{name}" for name in names]
    stood = [frame["transform_matrix"][0][3] for frame in frames if "view-000" in frame["file_path"]]
    np.testing.assert_allclose(np.diff(stood), [0.2, 0.2])
    whole = write_colmap(small, film, tmp_path / "b", views_around=2, size=48)
    assert whole.pictures == 5
    one, same = (om.read_image(at / "images" / "view-000" / "frame-000004.png") for at in (done.folder, whole.folder))
    np.testing.assert_array_equal(one, same)
    with av.open(str(film)) as container:
        last = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)][4]
    straight = om.Dewarper(small, whole.rig[0].screen, "cubic")(last)
    assert np.abs(one.astype(int) - straight).max() <= 3  # FFmpeg converts colours by its own rounding
    with pytest.raises(InvalidParameter, match="poses has 2 of them for 5 pictures"):
        write_colmap(small, film, tmp_path / "c", poses=POSES)
    with pytest.raises(InvalidParameter, match="a video among them"):
        write_colmap(small, [film, film], tmp_path / "c")


def test_what_cannot_be_is_refused(pictures, project, tmp_path):
    with pytest.raises(InvalidParameter, match="poses has 2 of them for 1 pictures"):
        write_colmap(SPH, [pictures / "0.png"], tmp_path / "a", poses=POSES)
    with pytest.raises(InvalidParameter, match="holds a project already"):
        write_colmap(SPH, [pictures / "0.png"], project.folder)
    with pytest.raises(InvalidParameter, match=r"transforms\.json is of pinholes"):
        write_colmap(SPH, pictures, tmp_path / "b", poses=POSES, is_panorama=True, size=360)
    with pytest.raises(InvalidParameter, match="views_around = 0"):
        write_colmap(SPH, pictures, tmp_path / "c", views_around=0)
    assert not list(tmp_path.iterdir())


def test_the_command_takes_poses_of_a_video_set_and_says_what_is_lost(pictures, tmp_path):
    (tmp_path / "poses.csv").write_text("time_s,x_mm\n0,0\n0.04,100\n")
    run = omnimirror(
        "colmap", "paper-spherical", str(pictures), "--size", "64", "--views", "4", "--poses", "poses.csv", "--gsplat",
        "-o", "project", cwd=tmp_path,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "view-270  64 x 64" in run.stdout
    frames = json.loads((tmp_path / "project" / "transforms.json").read_text())["frames"]
    moved = np.array(frames[4]["transform_matrix"]) - frames[0]["transform_matrix"]
    np.testing.assert_allclose(moved[:3, 3], [0.1, 0, 0], atol=1e-12)
    run = omnimirror("colmap", "paper-spherical", str(pictures), "--gsplat", "-o", "other", cwd=tmp_path)
    assert run.returncode != 0
    assert "--gsplat and --poses belong together" in run.stderr
    run = omnimirror(
        "colmap", "paper-spherical", str(pictures), "--panorama", "--hfov-deg", 60, "-o", "o", cwd=tmp_path
    )
    assert "--hfov-deg belongs to views" in run.stderr
