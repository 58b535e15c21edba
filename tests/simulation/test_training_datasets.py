"""Training datasets: normals against those of the room boxes, flow against retraced rays."""

from __future__ import annotations

import io
import json
import signal
import tarfile
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base import interrupts
from omnimirror.base.errors import InvalidParameter
from omnimirror.io.keyframes import Keyframes
from omnimirror.optics.housing import CameraBody, Housing
from omnimirror.simulation.ground_truth_maps import Moment, _normals, training_ground_truth
from omnimirror.simulation.scenes.moving_objects import SceneWithBodies
from omnimirror.simulation.scenes.room import FURNITURE, PIECES, ROOM, SOLIDS
from omnimirror.simulation.scenes.scene import PosedScene, face_of, intersect_boxes
from omnimirror.simulation.scenes.street import Street
from tests.commands import fails, omnimirror
from tests.simulation.scenes.test_moving_objects import BODIES

SPH = om.load_sensor("paper-spherical")
SMALL = replace(
    SPH,
    imager=replace(SPH.imager, width_px=96, height_px=96, pixel_pitch_um=5.2 * 1024 / 96),
    housing=Housing(CameraBody(60.0)),
)
CART = om.MovingBox(
    (300.0, 400.0, 500.0),
    Keyframes(
        {
            "x_mm": ((0.0, 900.0), (1.0, 1300.0)),
            "y_mm": ((0.0, -900.0), (1.0, 300.0)),
            "pan_deg": ((0.0, 0.0), (1.0, 50.0)),
        },
        "linear",
    ),
    name="cart",
)
ON_CART = 7 + len(FURNITURE)
POSES = (
    om.Pose(100.0, 50.0, 30.0, pan_deg=20.0, tilt_deg=4.0),
    om.Pose(190.0, 20.0, 40.0, pan_deg=31.0, roll_deg=2.0),
)


@pytest.fixture(scope="module")
def moments():
    room = om.Room(texel_mm=40.0)
    return [
        Moment(SceneWithBodies(room, (CART,), time), pose)
        for time, pose in zip((0.2, 0.35), POSES, strict=True)
    ]


@pytest.fixture(scope="module")
def ground_truth(moments):
    return training_ground_truth(SMALL, *moments)


def in_scene(moment, truth, valid):
    return moment.pose.to_scene(truth.origins_mm[valid]), truth.directions[
        valid
    ] @ moment.pose.rotation().T


def test_normals_match_faces(moments, ground_truth):
    valid = np.isfinite(ground_truth.truth.depth_mm) & (ground_truth.labels != ON_CART)
    origins, towards = in_scene(moments[0], ground_truth.truth, valid)
    faces = intersect_boxes(ROOM, SOLIDS, origins, towards).face
    boxes = (ROOM, *SOLIDS)
    normals = np.array([face_of(boxes[f // 6], f % 6, inside=f < 6).normal for f in faces])
    right = normals @ moments[0].pose.rotation()
    angles_deg = np.degrees(
        np.arccos(np.clip((right * ground_truth.normals[valid]).sum(axis=1), -1, 1))
    )
    assert valid.sum() > 4000
    assert angles_deg.max() < 0.01


def test_normals_near_creases_match_face():
    """Rays to points 0.02 to 1 mm from the edges of the room, where adjacent rays meet another face."""
    rng = np.random.default_rng(4)
    lowest, highest = (np.array(ROOM.low), np.array(ROOM.high))
    points = rng.uniform(lowest, highest, (3000, 3))
    axis, other = rng.integers(0, 3, 3000), rng.integers(1, 3, 3000)
    rows, side = np.arange(3000), rng.random((2, 3000)) < 0.5
    points[rows, axis] = np.where(side[0], lowest[axis], highest[axis])
    other = (axis + other) % 3
    inwards = 10 ** rng.uniform(-1.7, 0, 3000)
    points[rows, other] = np.where(side[1], lowest[other] + inwards, highest[other] - inwards)
    origins = np.tile([100.0, 50.0, 30.0], (3000, 1))
    towards = points - origins
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    scene = om.Room(texel_mm=40.0)
    faces = intersect_boxes(ROOM, SOLIDS, origins, towards).face
    right = np.array([face_of((ROOM, *SOLIDS)[f // 6], f % 6, inside=f < 6).normal for f in faces])
    depth = scene.distance_mm(origins, towards)
    normals = _normals(PosedScene(scene, om.Pose()), origins, towards, depth)
    angles_deg = np.degrees(np.arccos(np.clip((right * normals).sum(axis=1), -1, 1)))
    assert (
        angles_deg < 0.1
    ).mean() > 0.998  # others are within 1 mm of a corner, where three faces meet
    assert (faces < 6).mean() > 0.5


def test_body_normals(moments, ground_truth):
    on = ground_truth.labels == ON_CART
    assert on.sum() > 20
    turn = CART.pose_at(0.2).rotation().T @ moments[0].pose.rotation()
    own = np.abs(ground_truth.normals[on] @ turn.T)
    np.testing.assert_allclose(own.max(axis=1), 1.0, atol=1e-6)
    points = CART.pose_at(0.2).to_sensor(
        moments[0].pose.to_scene(ground_truth.truth.points_mm[on])
    ) / (np.array(CART.size_mm) / 2)
    np.testing.assert_allclose(np.abs(points).max(axis=1), 1.0, atol=1e-9)
    assert (np.abs(points).argmax(axis=1) == own.argmax(axis=1)).all()


def test_labels_match_scene(moments, ground_truth):
    names = ("nothing", *moments[0].scene.label_names)
    assert names[-1] == "cart"
    valid = np.isfinite(ground_truth.truth.depth_mm)
    assert not ground_truth.labels[~valid].any()
    names_in_image = {names[label] for label in np.unique(ground_truth.labels)}
    assert {"nothing", "wall ahead", "floor", "cart"} <= names_in_image
    points = moments[0].pose.to_scene(
        ground_truth.truth.points_mm[ground_truth.labels == names.index("floor")]
    )
    np.testing.assert_allclose(points[:, 2], ROOM.low[2], atol=1e-6)
    for name in FURNITURE:  # pixels labelled as table are on a box of the table
        on = ground_truth.labels == names.index(name)
        assert on.sum() > 10 or name not in ("table", "bookcase", "armchair"), name
        points = moments[0].pose.to_scene(ground_truth.truth.points_mm[on])
        boxes = [piece.box for piece in PIECES if piece.name == name]
        outside = [
            np.maximum(np.array(b.low) - points, points - np.array(b.high)).max(axis=1)
            for b in boxes
        ]
        assert np.abs(np.min(outside, axis=0)).max(initial=0.0) < 1e-6, name


def test_flow_matches_next_frame(moments, ground_truth):
    """Retraced ray of that pixel: static points are unchanged, and body points have moved."""
    v, u = np.nonzero(ground_truth.visible_again)
    pixels = np.stack([u, v], axis=1) + ground_truth.flow_px[ground_truth.visible_again]
    rays = SMALL.backproject(pixels)
    after = moments[1]
    distance_mm = after.posed_scene.distance_mm(rays.origins, rays.directions)
    ends = after.pose.to_scene(rays.origins + distance_mm[:, None] * rays.directions)
    points = moments[0].pose.to_scene(ground_truth.truth.points_mm[ground_truth.visible_again])
    on_body = ground_truth.labels[ground_truth.visible_again] == ON_CART
    assert on_body.sum() > 10
    points[on_body] = CART.pose_at(0.35).to_scene(CART.pose_at(0.2).to_sensor(points[on_body]))
    assert np.linalg.norm(ends - points, axis=1).max() < 20.0  # grazing rays
    assert np.quantile(np.linalg.norm(ends - points, axis=1), 0.99) < 1e-3
    assert (
        0.7
        < ground_truth.visible_again.sum() / np.isfinite(ground_truth.truth.depth_mm).sum()
        < 1.0
    )


def test_occluded_points_are_not_visible_again(moments, ground_truth):
    """Pixels whose point is occluded in the next frame, by a body that was elsewhere before."""
    empty = [Moment(SceneWithBodies(m.scene.scene, (), m.scene.time_s), m.pose) for m in moments]
    without = training_ground_truth(SMALL, *empty)
    occluded = (
        without.visible_again
        & ~ground_truth.visible_again
        & (ground_truth.labels == without.labels)
    )
    v, u = np.nonzero(occluded)
    rays = SMALL.backproject(np.stack([u, v], axis=1) + without.flow_px[occluded])
    labels = moments[1].scene.labels(
        moments[1].pose.to_scene(rays.origins), rays.directions @ moments[1].pose.rotation().T
    )
    assert len(labels) > 10
    assert (labels == ON_CART).mean() > 0.99


def test_shards_are_complete_and_reproducible(tmp_path):
    path = Keyframes({"x_mm": ((0.0, 0.0), (0.08, 100.0))}, "linear")
    tiny = replace(
        SMALL, imager=replace(SPH.imager, width_px=32, height_px=32, pixel_pitch_um=5.2 * 32)
    )
    counts = []
    sequence = om.ImageSequence(tiny, om.Room(texel_mm=40.0), path, bodies=(CART,), samples=1)
    results = [
        om.write_training_dataset(
            sequence,
            tmp_path / name,
            per_shard=2,
            workers=workers,
            on_progress=lambda *count: counts.append(count),
        )
        for name, workers in (("a", 1), ("b", 2))
    ]
    assert counts == 2 * [(1, 3), (2, 3), (3, 3)]
    assert [p.read_bytes() for p in results[0]] == [p.read_bytes() for p in results[1]]
    names, samples = [], {}
    for shard in results[0]:
        with tarfile.open(shard) as tar:
            for entry in tar:
                names.append(entry.name)
                samples[entry.name] = tar.extractfile(entry).read()
    assert names == [f"{k:06d}.{ending}" for k in range(3) for ending in ("png", "npz", "json")]
    (tmp_path / "0.png").write_bytes(samples["000000.png"])
    assert om.read_image(tmp_path / "0.png").shape == (32, 32, 3)
    arrays = np.load(io.BytesIO(samples["000002.npz"]))
    assert arrays["normals"].shape == (32, 32, 3)
    assert np.nanmax(np.abs(arrays["flow_px"])) < 1e-6  # the last frame has no flow
    assert json.loads(samples["000001.json"])["pose"]["x_mm"] == pytest.approx(50.0)
    card = (tmp_path / "a" / "README.md").read_text()
    assert "3 frames of 32 x 32 px" in card
    assert f"| {ON_CART} | cart |" in card
    with pytest.raises(InvalidParameter, match="folder must not contain a dataset"):
        om.write_training_dataset(sequence, tmp_path / "a")


@pytest.fixture
def interruptible():
    """Handler of Python for Ctrl-C, which jobs in the background ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("is_deferred", [False, True])
def test_interrupted_dataset_contains_complete_shards(tmp_path, is_deferred):
    def interrupt(done, _):
        if done == 3:
            signal.raise_signal(signal.SIGINT)

    camera = om.Unified(xi=0.9, focal_px=(20.0, 20.0), centre_px=(15.5, 15.5), image_size=(32, 32))
    path = Keyframes({"x_mm": ((0.0, 0.0), (1.2, 100.0))})
    sequence = om.ImageSequence(camera, om.Room(texel_mm=40.0), path, samples=1)

    def write(folder, on_progress=None):
        with interrupts.deferred() if is_deferred else nullcontext():
            return om.write_training_dataset(
                sequence, folder, per_shard=2, workers=2, on_progress=on_progress
            )

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "stopped", interrupt)
    shards = sorted((tmp_path / "stopped").iterdir())
    assert 1 <= len(shards) < 8  # without temporary files and card
    for shard, whole in zip(shards, write(tmp_path / "whole"), strict=False):
        assert shard.name == whole.name
        assert shard.read_bytes() == whole.read_bytes()


def test_sky_flow():
    street = Street(texel_mm=100.0)
    first, second = (
        Moment(SceneWithBodies(street, (), 0.0), pose)
        for pose in (om.Pose(), om.Pose(300.0, pan_deg=8.0))
    )
    ground_truth = training_ground_truth(SMALL, first, second)
    sky = np.isinf(ground_truth.truth.depth_mm)
    assert sky.sum() > 200
    assert not ground_truth.labels[sky].any()
    assert np.isnan(ground_truth.normals[sky]).all()
    visible_sky = sky & ground_truth.visible_again
    v, u = np.nonzero(visible_sky)
    towards = SMALL.backproject(
        np.stack([u, v], axis=1) + ground_truth.flow_px[visible_sky]
    ).directions
    directions = ground_truth.truth.directions[visible_sky] @ second.pose.rotation()
    np.testing.assert_allclose(towards, directions, atol=1e-9)
    ground = np.isfinite(ground_truth.truth.depth_mm) & (
        ground_truth.truth.points_mm[..., 2] < -1000
    )
    assert np.median(np.abs(ground_truth.normals[ground][:, 2])) > 0.999


# -- command line
# ------------------------------------------------------------------------------------


def test_command_matches_python(tmp_path):
    sensor, lines = tmp_path / "small.toml", "time_s,x_mm\n0,0\n0.08,100\n"
    om.save_sensor(
        replace(
            SMALL, imager=replace(SPH.imager, width_px=32, height_px=32, pixel_pitch_um=5.2 * 32)
        ),
        sensor,
    )
    (tmp_path / "walk.csv").write_text(lines)
    (tmp_path / "bodies.toml").write_text(BODIES)
    (tmp_path / "lamp.csv").write_text("time_s,x_mm,y_mm\n0,-800,300\n")
    arguments = (
        "simulate",
        "training",
        sensor,
        "--path",
        tmp_path / "walk.csv",
        "--set",
        f"video.bodies={tmp_path / 'bodies.toml'}",
    )
    run = omnimirror(
        *arguments,
        "--spp",
        "1",
        "--no-blur",
        "--set",
        "storage.per_shard=2",
        "-o",
        tmp_path / "command",
    )
    assert "set-000000.tar to set-000001.tar" in run.stdout, run.stderr
    sequence = om.ImageSequence(
        om.load_sensor(sensor),
        om.load_scene("room"),
        om.load_path(tmp_path / "walk.csv"),
        bodies=om.load_bodies(tmp_path / "bodies.toml"),
        samples=1,
    )
    results = om.write_training_dataset(sequence, tmp_path / "made", per_shard=2)
    assert len(results) == 2
    for path in (tmp_path / "made").iterdir():
        assert (tmp_path / "command" / path.name).read_bytes() == path.read_bytes(), path.name
    assert "cart" in (tmp_path / "command" / "README.md").read_text()
    assert "folder must not contain a dataset" in fails(*arguments, "-o", tmp_path / "command")


def test_training_dataset_requires_path(tmp_path):
    assert "requires --path" in fails(
        "simulate", "training", "paper-spherical", "-o", tmp_path / "set"
    )
    assert not (tmp_path / "set").exists()
