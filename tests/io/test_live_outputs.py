"""Pipes, virtual cameras and windows."""

import io
import shutil
import subprocess
import sys
import time
from fractions import Fraction
from importlib.util import find_spec

import av
import numpy as np
import pytest

from omnimirror.base import interrupts
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.io import live_outputs
from omnimirror.io.live_outputs import PipeSink, Preview, Tee, VirtualCamera
from omnimirror.io.video_frames import frame_of_image, planes
from omnimirror.io.video_processing import in_real_time, process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from tests.io.synthetic import SIZE, images_of, make_video, sound_of


@pytest.fixture(scope="module", params=[1, 2], ids=["limited", "full"])
def clip(request, tmp_path_factory):
    return make_video(tmp_path_factory.mktemp("pipe") / "a.mp4", 10, colour_range=request.param)


def y4m_of(data):
    """Parse header and frames of a YUV4MPEG2 stream."""
    head, _, rest = data.partition(b"\n")
    fields = {field[:1].decode(): field[1:].decode() for field in head.split(b" ")[1:]}
    width, height = int(fields["W"]), int(fields["H"])
    size = width * height + 2 * ((width + 1) // 2) * ((height + 1) // 2)
    frames = []
    while rest:
        assert rest.startswith(b"FRAME\n")
        frames.append(rest[6 : 6 + size])
        assert len(frames[-1]) == size
        rest = rest[6 + size :]
    return head.decode(), frames


@pytest.mark.parametrize("pixels", ["planes", "image"])
def test_y4m_is_read_by_two_readers(clip, tmp_path, pixels):
    pipe = io.BytesIO()
    with VideoReader(clip) as reader:
        process(
            reader.items(), PipeSink("y4m", reader.frame_rate, stream=pipe), lambda p, t: p, pixels
        )
    head, frames = y4m_of(pipe.getvalue())
    before = images_of(clip)
    colour_range = "FULL" if before[0].color_range == 2 else "LIMITED"
    assert head == f"YUV4MPEG2 W64 H48 F25:1 Ip A1:1 C420jpeg XCOLORRANGE={colour_range}"
    expected = [b"".join(plane.tobytes() for plane in planes(frame)) for frame in before]
    tolerance = 0 if pixels == "planes" else 3
    for frame, expected_bytes in zip(frames, expected, strict=True):
        if pixels == "image" and not 60 < expected_bytes[0] < 180:
            continue  # outside the RGB gamut: blue, green and red were clipped
        difference = np.frombuffer(frame, np.uint8).astype(int) - np.frombuffer(
            expected_bytes, np.uint8
        )
        assert np.abs(difference).max() <= tolerance
    (tmp_path / "a.y4m").write_bytes(pipe.getvalue())
    after = images_of(tmp_path / "a.y4m")
    assert [round(frame.time * 25) for frame in after] == list(range(10))
    assert after[0].color_range == before[0].color_range
    np.testing.assert_array_equal(
        planes(after[5])[1].ravel(), np.frombuffer(frames[5], np.uint8)[3072:3840]
    )


def test_y4m_of_odd_sides():
    pipe = io.BytesIO()
    PipeSink("y4m", Fraction(30000, 1001), stream=pipe).write(av.VideoFrame(63, 47, "yuv420p"))
    head, frames = y4m_of(pipe.getvalue())
    assert "W63 H47 F30000:1001" in head
    assert len(frames) == 1


def test_rawvideo_contains_only_pixels(clip):
    pipe = io.BytesIO()
    images = []
    with VideoReader(clip) as reader:

        def append(image, time_s):
            images.append(image)
            return image

        process(reader.items(), PipeSink("rawvideo", 25, stream=pipe), append)
    np.testing.assert_array_equal(
        np.frombuffer(pipe.getvalue(), np.uint8).reshape(-1, 48, 64, 3), images
    )
    with pytest.raises(MediaError, match="cannot write frames of pixel format nonsense"):
        PipeSink("rawvideo", 25, "nonsense", io.BytesIO()).write(av.VideoFrame(8, 8, "yuv420p"))
    with pytest.raises(InvalidParameter, match="kind must be y4m or rawvideo; got 'mp4'"):
        PipeSink("mp4", 25)


def test_closed_pipe_is_no_error(clip):
    """The broken pipe is left to the command line, which ignores it, as for any program on a pipe."""
    code = f"""
import sys
from omnimirror.io.live_outputs import PipeSink
from omnimirror.io.video_processing import in_real_time, process
from omnimirror.io.video_reader import VideoReader
reader = VideoReader({str(clip)!r})
try:
    process(list(reader.items()) * 50, PipeSink("y4m", 25), lambda p, t: p, "planes")
except BrokenPipeError:
    sys.stderr.write("enough")
    sys.stderr.close()
    import os
    os._exit(3)
"""
    run = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert run.stdout.read(9) == b"YUV4MPEG2"
    run.stdout.close()
    assert run.stderr.read() == b"enough"
    run.stderr.close()
    assert run.wait(20) == 3


def test_tee_writes_same_frames_to_all_sinks(clip, tmp_path):
    pipe = io.BytesIO()
    with VideoReader(clip) as reader:
        sink = Tee(
            VideoWriter.from_source(reader, tmp_path / "a.mp4"), PipeSink("y4m", 25, stream=pipe)
        )
        outcome = process(reader.items(), sink, lambda p, t: p)
    assert (
        outcome.frames
        == 10
        == len(y4m_of(pipe.getvalue())[1])
        == len(images_of(tmp_path / "a.mp4"))
    )


def test_tee_writes_audio_to_all_files(tmp_path):
    clip = make_video(tmp_path / "in.mp4", 30)
    names = [tmp_path / "a.mp4", tmp_path / "b.mkv"]
    with VideoReader(clip) as reader:
        process(
            reader.items(),
            Tee(*(VideoWriter.from_source(reader, name) for name in names)),
            lambda p, t: p,
        )
    expected = [data for _, data in sound_of(clip)]
    for name in names:
        assert [data for _, data in sound_of(name)] == expected
        assert len(images_of(name)) == 30


def test_in_real_time_delays_frames(clip):
    with VideoReader(clip) as reader:
        start = time.monotonic()
        times = [(frame.time, time.monotonic() - start) for frame in in_real_time(reader.frames())]
    assert all(arrival >= time_s - times[0][0] - 1e-3 for time_s, arrival in times)


def test_missing_virtual_camera_raises():
    with pytest.raises(
        MediaError,
        match=r"must be a virtual camera .*; got /dev/video77; .* 'sudo modprobe v4l2loopback'",
    ):
        VirtualCamera("/dev/video77", (64, 48), 25)


def test_missing_display_raises(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform.startswith("linux"):
        with pytest.raises(MediaError, match="a preview window requires a display"):
            Preview(SIZE)
    monkeypatch.setenv("DISPLAY", ":4711")
    with monkeypatch.context() as patch:
        patch.setattr(live_outputs, "find_spec", lambda name: None)
        with pytest.raises(
            MediaError,
            match="a preview window requires Tk for Python; on Debian: apt install python3-tk",
        ):
            Preview(SIZE)
    if find_spec("_tkinter"):
        with pytest.raises(
            MediaError, match="cannot open a preview window: couldn't connect to display"
        ):
            Preview(SIZE)


def red_frame():
    return frame_of_image(np.full((48, 64, 3), (0, 0, 230), np.uint8))


def pixel_on_screen():
    """Return red, green and blue at the centre of the upper left window, captured by Tk in another
    process."""
    code = """
import subprocess, sys
dump = subprocess.run(["xwd", "-root", "-silent"], capture_output=True, check=True).stdout
head = int.from_bytes(dump[:4], "big"); colours = int.from_bytes(dump[76:80], "big")
line = int.from_bytes(dump[48:52], "big"); start = head + 12 * colours
at = start + 24 * line + 32 * 4
print(*dump[at:at + 3])
"""
    return [
        int(v)
        for v in subprocess.run([sys.executable, "-c", code], capture_output=True).stdout.split()
    ]


@pytest.mark.skipif(shutil.which("xwd") is None, reason="there is no xwd to look at the screen")
def test_preview_displays_frames(display):
    with Preview(SIZE) as preview:
        for _ in range(100):
            preview.write(red_frame())
            time.sleep(0.05)
            colour = pixel_on_screen()
            if np.abs(np.subtract(colour, (0, 0, 230))).max() < 6:  # blue first
                break
        else:
            pytest.fail(f"the window does not show the frame, but {colour}")
    assert preview.frames_written >= 1
    assert preview._window.returncode == 0


def test_closing_preview_stops_processing(display):
    with interrupts.deferred(), Preview(SIZE) as preview:
        preview.write(red_frame())
        preview._window.terminate()
        while not interrupts.is_pending():
            preview.write(red_frame())
            time.sleep(0.02)
