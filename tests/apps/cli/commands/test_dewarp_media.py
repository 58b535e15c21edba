"""Command ``omnimirror dewarp`` on videos and folders of images."""

from __future__ import annotations

import signal
import socket
import sys
import time
from pathlib import Path
from subprocess import PIPE, Popen

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.io.live_sources import LiveSource
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter
from tests.commands import fails, omnimirror

SIZE = 160
BALL = ["--ball", "79.5,79.5,76,260"]
CAMERA = om.MirrorBall(
    centre_px=(79.5, 79.5), rim_radius_px=76.0, field_deg=260.0, image_size=(SIZE, SIZE)
)


def uniform_image(shade: int) -> np.ndarray:
    """Return a smooth image whose colour encodes its number."""
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    return np.stack([u / 2 + 40, v / 2 + 40, np.full_like(u, shade)], axis=-1).astype(np.uint8)


@pytest.fixture(scope="module")
def encoded(tmp_path_factory):
    path = tmp_path_factory.mktemp("encoded") / "in.mp4"
    with VideoWriter(path, (SIZE, SIZE), 25, crf=1) as writer:
        for i in range(20):
            writer.write(frame_of_image(uniform_image(60 + 5 * i)))
    return path.read_bytes()


@pytest.fixture
def video(tmp_path, encoded):
    (tmp_path / "in.mp4").write_bytes(encoded)
    return tmp_path / "in.mp4"


def frames(path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]


def test_all_video_frames_are_dewarped(video, tmp_path):
    args = [
        *BALL,
        "--view",
        "perspective",
        "--tilt-deg",
        "-30",
        "--size",
        "96x64",
        "--set",
        "video.crf=1",
    ]
    run = omnimirror("dewarp", video, *args, "-o", tmp_path / "out.mp4")
    assert run.returncode == 0, run.stderr
    assert "20 frames" in run.stderr
    dewarped = frames(tmp_path / "out.mp4")
    assert len(dewarped) == 20
    dewarp = om.Dewarper(CAMERA, om.screens.Plane((96, 64), tilt_deg=-30.0))
    for i in (0, 7, 19):
        expected = dewarp(frames(video)[i]).astype(float)
        assert np.abs(dewarped[i] - expected)[4:-4, 4:-4].mean() < 3


def test_video_border_colour(video, tmp_path):
    args = [
        *BALL,
        "--elevation-deg",
        "-90:90",
        "--size",
        "128x64",
        "--set",
        "video.crf=1",
        "--interpolation",
        "area",
    ]
    run = omnimirror(
        "dewarp",
        video,
        *args,
        "--border",
        "#c86432",
        "--set",
        "resampling.threads=1",
        "-o",
        tmp_path / "out.mp4",
    )
    assert run.returncode == 0, run.stderr
    for frame in frames(tmp_path / "out.mp4"):
        assert np.abs(frame[:10, 8:-8].astype(int) - [0xC8, 0x64, 0x32]).max() < 12
    for border in ("#ff", "300"):
        fails(
            omnimirror("dewarp", video, *args, "--border", border, "-o", tmp_path / "no.mp4"),
            border,
        )
        assert not (tmp_path / "no.mp4").exists()


def test_video_range(video, tmp_path):
    args = [*BALL, "--size", "128x", "--start-s", "0.2", "--duration-s", "0.4"]
    run = omnimirror("dewarp", video, *args, "-o", tmp_path / "out.mp4")
    assert run.returncode == 0, run.stderr
    assert len(frames(tmp_path / "out.mp4")) == 10
    assert (
        b"GPano" in (tmp_path / "out.mp4").read_bytes()
        or b"sv3d" in (tmp_path / "out.mp4").read_bytes()
    )


def test_keyframes(video, tmp_path):
    (tmp_path / "keys.csv").write_text("time_s,pan_deg,hfov_deg\n0,0,60\n0.76,40,90\n")
    args = [
        *BALL,
        "--view",
        "perspective",
        "--tilt-deg",
        "-30",
        "--size",
        "96x64",
        "--set",
        "video.crf=1",
    ]
    run = omnimirror(
        "dewarp", video, *args, "--keyframes", tmp_path / "keys.csv", "-o", tmp_path / "out.mp4"
    )
    assert run.returncode == 0, run.stderr
    last = om.Dewarper(CAMERA, om.screens.Plane((96, 64), 40.0, -30.0, hfov_deg=90.0))(
        frames(video)[-1]
    )
    assert np.abs(frames(tmp_path / "out.mp4")[-1] - last.astype(float))[4:-4, 4:-4].mean() < 3


def test_y4m_pipe(video, tmp_path):
    run = omnimirror("dewarp", video, *BALL, "--size", "128x64", "-o", "-", text=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(b"YUV4MPEG2 W128 H64 F25:1")
    assert run.stdout.count(b"FRAME") == 20


def test_raw_video_pipe(video):
    args = ["--size", "128x64", "-o", "rawvideo:-"]
    run = omnimirror("dewarp", video, *BALL, *args, text=False)
    assert run.returncode == 0, run.stderr
    images = np.frombuffer(run.stdout, np.uint8).reshape(20, 64, 128, 3)
    dewarp = om.Dewarper(CAMERA, om.views.panorama(CAMERA, (128, 64)))
    assert np.abs(images[7] - dewarp(frames(video)[7]).astype(float))[4:-4].mean() < 3
    grey = omnimirror("dewarp", video, *BALL, *args, "--set", "video.pixel_format=gray", text=False)
    assert len(grey.stdout) == 20 * 64 * 128


def test_several_outputs(video, tmp_path):
    args = [
        *BALL,
        "--size",
        "128x64",
        "-o",
        tmp_path / "a.mp4",
        "-o",
        tmp_path / "b.mkv",
        "-o",
        "-",
    ]
    run = omnimirror("dewarp", video, *args, text=False)
    assert run.returncode == 0, run.stderr
    assert b"a.mp4, " in run.stderr
    assert b"b.mkv, standard output: panorama" in run.stderr
    assert (
        run.stdout.count(b"FRAME")
        == len(frames(tmp_path / "a.mp4"))
        == len(frames(tmp_path / "b.mkv"))
        == 20
    )


def test_sigterm_keeps_completed_frames(video, tmp_path):
    program = Path(sys.executable).with_name("omnimirror")
    arguments = ["dewarp", video, *BALL, "--size", "512x256", "-o", tmp_path / "a.mkv", "-o", "-"]
    with Popen([program, *map(str, arguments)], stdout=PIPE, stderr=PIPE) as run:
        assert run.stdout.read(9) == b"YUV4MPEG2"  # the writer blocks at a full pipe
        run.send_signal(signal.SIGTERM)
        _, messages = run.communicate()
    assert run.returncode == 143, messages
    assert b"stopped; " in messages
    assert 1 <= len(frames(tmp_path / "a.mkv")) < 20


def test_file_is_streamed_in_real_time(video, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{probe.getsockname()[1]}"
    with LiveSource(url, timeout_s=60, patience_s=600, reconnect=False) as live:
        while not live.received:  # repeatedly, until the receiver has recognised the format
            start = time.monotonic()
            run = omnimirror(
                "dewarp", video, *BALL, "--size", "128x64", "-o", url + "?pkt_size=1316"
            )
            assert run.returncode == 0, run.stderr
            assert time.monotonic() - start > 19 / 25
        frame = live.first()
    assert (frame.width, frame.height) == (128, 64)


def test_folder_with_damaged_image(tmp_path):
    for i in range(3):
        om.write_image(tmp_path / f"{i}.png", uniform_image(60 + i))
    (tmp_path / "bad.png").write_bytes(b"not a picture")
    run = omnimirror(
        "dewarp",
        tmp_path,
        *BALL,
        "--size",
        "128x",
        "--set=image.transparent=false",
        "-o",
        tmp_path / "out",
    )
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert f"cannot read the image {tmp_path / 'bad.png'}: it must be" in run.stderr
    assert "3 of 4 images dewarped" in run.stdout
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["0.png", "1.png", "2.png"]
    expected = om.Dewarper(CAMERA, om.views.panorama(CAMERA, (128, None)))(uniform_image(61))
    np.testing.assert_array_equal(om.read_image(tmp_path / "out" / "1.png"), expected)


def test_skip_existing_continues_folder(tmp_path):
    for i in range(3):
        om.write_image(tmp_path / f"{i}.png", uniform_image(60 + i))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "1.png").write_bytes(b"done before")
    (tmp_path / "out" / ".2.omnimirror-abcd1234.png").write_bytes(
        b"half of it"
    )  # left by a killed run
    run = omnimirror(
        "dewarp", tmp_path, *BALL, "--size", "64x", "--skip-existing", "-o", tmp_path / "out"
    )
    assert run.returncode == 0, run.stderr
    assert "2 of 2 images dewarped, 1 existed" in run.stdout
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["0.png", "1.png", "2.png"]
    assert (tmp_path / "out" / "1.png").read_bytes() == b"done before"
    second_run = omnimirror(
        "dewarp", tmp_path, *BALL, "--size", "64x", "--skip-existing", "-o", tmp_path / "out"
    )
    assert second_run.returncode == 0
    assert "0 of 0 images dewarped, 3 existed" in second_run.stdout


def test_panorama_metadata(tmp_path):
    om.write_image(tmp_path / "a.png", uniform_image(90))
    assert (
        omnimirror(
            "dewarp", tmp_path / "a.png", *BALL, "--size", "128x", "-o", tmp_path / "p.jpg"
        ).returncode
        == 0
    )
    assert b"GPano:CroppedAreaTopPixels" in (tmp_path / "p.jpg").read_bytes()
    args = ["--view", "perspective", "--tilt-deg", "-30", "-o", tmp_path / "v.jpg"]
    assert omnimirror("dewarp", tmp_path / "a.png", *BALL, *args).returncode == 0
    assert b"GPano" not in (tmp_path / "v.jpg").read_bytes()


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["no.mp4", "-o", "o.mp4"], "cannot read the video no.mp4: the file does not exist"),
        (["in.mp4", "-o", "in.mp4"], "must differ from the source video; got in.mp4"),
        (["in.mp4", "-o", "o.gifv"], "got '.gifv'"),
        (
            ["in.mp4", "-o", "o.mp4", "--start-s", "9"],
            "start_s must be less than the duration of in.mp4",
        ),
        (
            ["in.mp4", "-o", "o.mp4", "--set=image.transparent=true"],
            "--set image.transparent requires images",
        ),
        (
            ["in.mp4", "-o", "-", "--set", "video.crf=3"],
            "crf must be omitted unless an output is a video file or stream",
        ),
        (["in.mp4", "-o", "o.mp4", "--keyframes", "no.csv"], "no.csv"),
        (["in.mp4", "-o", "o.mp4", "--set", "video.codec=h266"], "h266"),
        (["a.png", "-o", "o.png", "--start-s", "1"], "--start-s requires a video; got a.png"),
        (["a.png", "a.png", "-o", "o.png"], "must be a folder for several images"),
        (["*.tif", "-o", "out"], "source must be an existing file or match one; got *.tif"),
        (["/dev/video99", "-o", "o.mp4"], "got /dev/video99"),
        (["in.mp4", "-o", "/dev/video98"], "got /dev/video98; on Linux"),
        (["in.mp4", "-o", "o.mp4", "-o", "/dev/video98"], "got /dev/video98; on Linux"),
        (["in.mp4", "-o", "gopher://x"], "got 'gopher://x'"),
        (["in.mp4", "-o", "o.mp4", "-o", "o.mp4"], "the outputs must differ; got o.mp4 twice"),
        (
            ["in.mp4", "-o", "tif:-"],
            "standard output of a video must be -, y4m:-, rawvideo:-; got tif:-",
        ),
        (
            ["a.png", "-o", "y4m:-"],
            "standard output of an image must be -, png:-, jpg:-, tif:-",
        ),
        (
            ["in.mp4", "-o", "y4m:-", "-o", "rawvideo:-"],
            "standard output must have one format; got y4m, rawvideo",
        ),
        (
            ["in.mp4", "-o", "-", "--set", "video.pixel_format=gray"],
            "pixel_format must be omitted unless an output is a video file",
        ),
        (
            [
                "in.mp4",
                "-o",
                "rawvideo:-",
                "--set",
                "video.pixel_format=no",
            ],
            "pixel format no",
        ),
        (["in.mp4"], "--output must be given, or --preview for a video"),
        (["a.png", "-o", "o.png", "-o", "p.png"], "several outputs require a video"),
        (["a.png", "--preview"], "--preview requires a video; got a.png"),
    ],
)
def test_invalid_arguments_print_one_line(args, message, video, tmp_path):
    om.write_image(tmp_path / "a.png", uniform_image(90))
    before = sorted(p.name for p in tmp_path.iterdir())
    assert message in fails("dewarp", *args, *BALL, cwd=tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no DISPLAY")
def test_preview_without_display_writes_no_file(video, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    message = fails("dewarp", video, *BALL, "-o", "o.mp4", "--preview", cwd=tmp_path)
    assert "a preview window requires a display" in message
    assert [p.name for p in tmp_path.iterdir()] == ["in.mp4"]
