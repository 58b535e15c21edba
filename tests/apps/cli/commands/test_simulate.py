"""Command ``omnimirror simulate``."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.simulation.detector import Detector
from omnimirror.simulation.ground_truth_maps import ground_truth
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.scene import Pose, PosedScene
from tests.commands import fails, omnimirror


@pytest.fixture(scope="module")
def sensor_file(tmp_path_factory):
    """A sensor with few, large pixels."""
    from dataclasses import replace

    sensor = om.load_sensor("paper-spherical")
    imager = replace(sensor.imager, width_px=128, height_px=128, pixel_pitch_um=8 * 5.2)
    path = tmp_path_factory.mktemp("sensor") / "small.toml"
    om.save_sensor(replace(sensor, imager=imager), path)
    return path


@pytest.fixture(scope="module")
def sky_file(tmp_path_factory):
    rows = np.linspace(1, 0, 32, dtype=np.float32)[:, None, None]
    path = tmp_path_factory.mktemp("sky") / "sky.hdr"
    om.write_image(path, np.ascontiguousarray(np.broadcast_to(rows, (32, 64, 3))))
    return path


def simulate(*args):
    run = omnimirror("simulate", *args)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_exr_contains_light_and_ground_truth(sensor_file, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    file_path = tmp_path / "truth.exr"
    simulate(sensor_file, "--no-blur", "--samples", 1, "--pose", "300,100,0,30", "-o", file_path)
    with OpenEXR.File(str(file_path), separate_channels=True) as file:
        channels = {name: np.array(c.pixels) for name, c in file.channels().items()}
    assert set(channels) == {"R", "G", "B", "A", "H", "Z", "DX", "DY", "DZ", "OX", "OY", "OZ"}
    sensor, scene = (
        om.load_sensor(sensor_file),
        PosedScene(om.Room(), Pose(300.0, 100.0, 0.0, 30.0)),
    )
    truth = ground_truth(sensor, scene)
    np.testing.assert_allclose(channels["Z"], truth.depth_mm, rtol=1e-6)
    np.testing.assert_allclose(channels["DY"], truth.directions[..., 1], atol=1e-6)
    np.testing.assert_array_equal(channels["A"] == 1, np.isfinite(truth.depth_mm))
    np.testing.assert_allclose(channels["G"], expose(sensor, scene, samples=1)[..., 1], atol=1e-6)
    assert om.read_image(file_path).shape == (128, 128, 4)


def test_exr_labels_obscuration_and_refraction(sensor_file, sky_file, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    channels = {}
    supports = {
        "rod": ("--set", "housing.rod.diameter_mm=12"),
        "tube": ("--set", "housing.tube={}"),
    }
    for name, options in supports.items():
        path = tmp_path / f"{name}.exr"
        simulate(
            sensor_file, "--scene", sky_file, "--no-blur", "--samples", 1, *options, "-o", path
        )
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels[name] = {name: np.array(c.pixels) for name, c in file.channels().items()}
        is_obscured = channels[name]["H"] == 1
        assert is_obscured.sum() > 100
        assert not channels[name]["A"][is_obscured].any()
        assert np.isnan(channels[name]["Z"][is_obscured]).all()
    is_valid = channels["tube"]["A"] == 1
    np.testing.assert_allclose(
        np.hypot(channels["tube"]["OX"], channels["tube"]["OY"])[is_valid], 50.0, atol=1e-4
    )


def test_blurred_noisy_environment_in_12_bits(sensor_file, sky_file, tmp_path):
    path = tmp_path / "noisy.png"
    options = (
        "--set",
        "detector.full_well_e=4000",
        "--set",
        "detector.read_noise_e=5",
        "--set",
        "detector.bits=12",
        "--set",
        "detector.curve=linear",
        "--set",
        "rendering.seed=5",
    )
    output = simulate(sensor_file, "--scene", sky_file, "--spp", 4, *options, "-o", path)
    assert "128 x 128 px, 4 rays" in output
    image = om.read_image(path)
    assert image.dtype == np.uint16
    assert 2000 < image.max() <= 4095
    second_path = tmp_path / "again.png"
    simulate(sensor_file, "--scene", sky_file, "--spp", 4, *options, "-o", second_path)
    np.testing.assert_array_equal(image, om.read_image(second_path))


def test_video_along_path(sensor_file, sky_file, tmp_path):
    pytest.importorskip("av")
    from omnimirror.io.video_reader import VideoReader

    (tmp_path / "path.csv").write_text("time_s,x_mm,pan_deg\n0,0,0\n0.2,100,90\n")
    video = tmp_path / "drive.mp4"
    output = simulate(
        sensor_file,
        "--scene",
        sky_file,
        "--spp",
        1,
        "--path",
        tmp_path / "path.csv",
        "--set",
        "video.fps=20",
        "-o",
        video,
    )
    assert "5 frames" in output
    assert VideoReader(video).expected_frames == 5


def test_panorama_option(sensor_file, sky_file, tmp_path):
    simulate(
        sensor_file,
        "--scene",
        sky_file,
        "--spp",
        1,
        "-o",
        tmp_path / "a.jpg",
        "--panorama",
        tmp_path / "p.png",
    )
    panorama = om.read_image(tmp_path / "p.png")
    height, width = panorama.shape[:2]
    assert width > 2 * height
    assert panorama[5, width // 2, 0] > panorama[-40, width // 2, 0]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ("--scene", "moon", "-o", "a.png"),
            "the scene must be one of room, street, hall or a file",
        ),
        (
            ("--scene", "none.hdr", "-o", "a.png"),
            "cannot read the image none.hdr: the file does not exist",
        ),
        (("--pose", "1,2", "-o", "a.png"), "must be a pose X,Y,Z"),
        (("--pose", "9e6,0,0", "-o", "a.png"), "ray origins must be inside the room"),
        (("--set", "detector.bits=12", "-o", "a.jpg"), "use .png or .tif"),
        (("--set", "detector.bayer=RGGB", "-o", "a.exr"), "detector.bayer requires"),
        (("--set", "video.fps=10", "-o", "a.png"), "video.fps requires --path"),
        (("-o", "a.mp4"), "requires --path"),
        (
            ("--set", "scene.heading_deg=10", "-o", "a.png"),
            "scene.heading_deg requires an environment image",
        ),
        (("-o", "a.xyz"), "cannot write a.xyz: the suffix must be one of"),
    ],
)
def test_invalid_arguments_write_no_file(sensor_file, tmp_path, args, message):
    assert message in fails("simulate", sensor_file, *args, cwd=tmp_path)
    assert not list(tmp_path.iterdir())


def _terminate_when(state, *arguments):
    """Return the output of a command after SIGTERM, sent once its handler is installed and a state
    is reached."""
    with subprocess.Popen(
        [sys.executable, "-m", "omnimirror", *map(str, arguments)],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        while not (_handles_sigterm(run.pid) and state()):
            assert run.poll() is None, run.stderr.read()
            time.sleep(0.01)
        run.send_signal(signal.SIGTERM)
        messages = run.communicate()[1]
    assert run.returncode == 128 + signal.SIGTERM, messages
    assert "Traceback" not in messages
    assert messages.endswith("stopped\n")
    return messages


def _handles_sigterm(process: int) -> bool:
    match = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process}/status").read_text())
    return bool(int(match[1], 16) & 1 << signal.SIGTERM - 1)


needs_proc = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="signals are seen in /proc"
)


@needs_proc
def test_sigterm_before_first_image_leaves_no_file(sensor_file, tmp_path):
    output = tmp_path / "out.png"
    messages = _terminate_when(
        lambda: True, "simulate", sensor_file, "--samples", "1024", "-o", output
    )
    assert messages.strip() == "omnimirror: stopped"
    assert not list(tmp_path.iterdir())


@pytest.mark.full
@needs_proc
def test_sigterm_keeps_completed_dataset_images(sensor_file, sky_file, tmp_path):
    folder = tmp_path / "set"
    arguments = (
        "simulate",
        "dataset",
        sensor_file,
        "--views",
        "400",
        "--set",
        "rendering.seed=3",
        "-o",
        folder,
    )
    messages = _terminate_when(lambda: len(list(folder.glob("*.png"))) > 1, *arguments)
    assert "images" in messages
    assert not [p for p in folder.iterdir() if p.name.startswith(".")]
    for path in folder.glob("*.png"):
        om.read_image(path)


@needs_proc
def test_sigterm_keeps_completed_training_shards(sensor_file, sky_file, tmp_path):
    (tmp_path / "path.csv").write_text("time_s,x_mm,pan_deg\n0,0,0\n100,100,90\n")
    folder = tmp_path / "set"
    arguments = (
        "simulate",
        "training",
        sensor_file,
        "--scene",
        sky_file,
        "--spp",
        "1",
        "--set",
        "storage.per_shard=1",
    )
    messages = _terminate_when(
        lambda: len([*folder.glob("set-*.tar")]) > 1,
        *arguments,
        "--path",
        tmp_path / "path.csv",
        "-o",
        folder,
    )
    shards = sorted(folder.iterdir())
    assert f"contains {len(shards)} shards" in messages
    for number, shard in enumerate(shards):
        with tarfile.open(shard) as tar:
            assert tar.getnames() == [f"{number:06d}.{suffix}" for suffix in ("png", "npz", "json")]


@needs_proc
def test_sigterm_leaves_playable_video(sensor_file, sky_file, tmp_path):
    av = pytest.importorskip("av")
    (tmp_path / "path.csv").write_text("time_s,x_mm,pan_deg\n0,0,0\n100,100,90\n")
    folder = tmp_path / "out"
    arguments = (
        "simulate",
        sensor_file,
        "--scene",
        sky_file,
        "--spp",
        "4",
        "--path",
        tmp_path / "path.csv",
    )
    # the hidden file grows after the first of 2501 frames have been encoded
    _terminate_when(
        lambda: any(p.stat().st_size > 2000 for p in folder.glob(".*")),
        *arguments,
        "-o",
        folder / "a.mkv",
    )
    assert [p.name for p in folder.iterdir()] == ["a.mkv"]
    with av.open(str(folder / "a.mkv")) as container:
        assert 1 <= sum(1 for _ in container.decode(video=0)) < 2501


@pytest.mark.long
@needs_proc
def test_sigterm_keeps_completed_video_dataset_frames(sensor_file, sky_file, tmp_path):
    av = pytest.importorskip("av")
    (tmp_path / "path.csv").write_text("time_s,x_mm,pan_deg\n0,0,0\n100,100,90\n")
    folder = tmp_path / "set"
    arguments = (
        "simulate",
        "dataset",
        sensor_file,
        "--scene",
        sky_file,
        "--spp",
        "4",
        "--path",
        tmp_path / "path.csv",
    )
    messages = _terminate_when(
        lambda: len([*folder.glob("frames/frame-*.png")]) > 1, *arguments, "-o", folder
    )
    dataset = json.loads((folder / "dataset.json").read_text())
    count = dataset["frames"]
    assert 1 <= count < 2501, messages
    assert not [p for p in folder.rglob("*") if p.name.startswith(".")]
    images = sorted(
        (folder / "frames").iterdir()
    )  # one more if terminated between writing and recording
    assert len(images) in (count, count + 1)
    for image in images:
        om.read_image(image)
    assert len((folder / "poses.csv").read_text().splitlines()) == 1 + count
    with av.open(str(folder / dataset["video"])) as container:
        assert sum(1 for _ in container.decode(video=0)) == count


def test_calibrated_camera_renders_sharp_images(tmp_path):
    """Each pixel shows the radiance of the scene along the camera ray."""
    camera = om.Unified(
        xi=0.9,
        focal_px=(33.0, 32.0),
        centre_px=(41.0, 39.0),
        image_size=(80, 80),
        k1=-0.02,
        rim_radius_px=36.0,
    )
    om.save_camera(camera, tmp_path / "mine.toml")
    om.write_image(tmp_path / "world.hdr", np.random.default_rng(0).random((32, 64, 3), np.float32))
    simulate(
        tmp_path / "mine.toml",
        "--scene",
        tmp_path / "world.hdr",
        "--samples",
        1,
        "-o",
        tmp_path / "picture.png",
    )
    rays = camera.backproject(np.argwhere(np.ones((80, 80)))[:, ::-1])
    world = om.Environment.load(tmp_path / "world.hdr")
    light = np.zeros((6400, 3), np.float32)
    light[rays.valid] = world.radiance(rays.origins[rays.valid], rays.directions[rays.valid])
    pixels = om.read_image(tmp_path / "picture.png").reshape(-1, 3)
    np.testing.assert_array_equal(pixels, Detector().read(light.reshape(80, 80, 3)).reshape(-1, 3))
    for option, message in (
        ("--blur", "blur must be False unless the camera is a sensor"),
        ("--set=housing.rod={}", "unknown entry housing"),
    ):
        assert message in fails(
            "simulate", tmp_path / "mine.toml", option, "-o", tmp_path / "no.png"
        )
