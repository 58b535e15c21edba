"""Numbered images, standard input, and timecodes."""

import sys
from fractions import Fraction
from pathlib import Path
from subprocess import run as run_program

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_metadata import advance_timecode
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from tests.commands import fails, omnimirror
from tests.io.synthetic import SIZE, images_of, make_video

BALL = [
    "--ball",
    "31.5,31.5,30,260",
    "--view",
    "perspective",
    "--tilt-deg",
    "-30",
    "--size",
    "32x24",
]
CAMERA = om.MirrorBall(
    centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=260.0, image_size=(64, 64)
)
VIEW = om.screens.Plane((32, 24), tilt_deg=-30.0)


def image_of(number: int) -> np.ndarray:
    v, u = np.mgrid[0:64, 0:64]
    return np.dstack([2 * u + 20, 2 * v + 40, np.full_like(u, 20 * number)]).astype(np.uint8)


@pytest.fixture
def sequence_folder(tmp_path):
    for i in range(3, 9):  # FFmpeg searches for a first number below 5 itself
        om.write_image(tmp_path / f"f{i + 5:03d}.png", image_of(i))
    om.write_image(tmp_path / "f1.png", image_of(0))  # not a number of three digits
    return tmp_path


def test_image_sequence_is_read_as_video(sequence_folder):
    run = omnimirror(
        "dewarp",
        sequence_folder / "f%03d.png",
        *BALL,
        "--set",
        "video.frame_rate=10",
        "--set",
        "video.crf=1",
        "-o",
        sequence_folder / "o.mp4",
    )
    assert run.returncode == 0, run.stderr
    frames = images_of(sequence_folder / "o.mp4")
    assert [frame.time for frame in frames] == pytest.approx([i / 10 for i in range(6)])
    dewarp = om.Dewarper(CAMERA, VIEW)
    for i, frame in enumerate(frames, 3):
        assert (int(frame.colorspace), int(frame.color_range)) == (
            1,
            1,
        )  # explicit, to avoid guesses by readers
        assert (
            np.abs(frame.to_ndarray(format="rgb24") - dewarp(image_of(i)).astype(float)).mean() < 3
        )


def test_missing_image_of_sequence_raises(sequence_folder):
    (sequence_folder / "f010.png").unlink()
    assert f"{sequence_folder / 'f010.png'} is missing" in fails(
        "dewarp", sequence_folder / "f%03d.png", *BALL, "-o", sequence_folder / "o.mp4"
    )
    with pytest.raises(MediaError, match="the image sequence must have at least one image"):
        VideoReader(sequence_folder / "g%d.png")
    with pytest.raises(InvalidParameter, match="frame_rate must be greater than 0; got 0"):
        VideoReader(sequence_folder / "f%03d.png", frame_rate=0)


def test_video_on_standard_input_with_index_at_end(tmp_path):
    with VideoWriter(tmp_path / "in.mp4", (64, 64), 25) as writer:
        for i in range(5):
            writer.write(frame_of_image(image_of(i)))
    program = Path(sys.executable).with_name("omnimirror")
    command = [program, "dewarp", "-", *BALL, "-o", "o.mkv"]
    done = run_program(
        command, input=(tmp_path / "in.mp4").read_bytes(), capture_output=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert len(images_of(tmp_path / "o.mkv")) == 5
    empty = run_program(command, input=b"", capture_output=True, cwd=tmp_path)
    assert empty.returncode == 1
    assert b"standard input must be a video; got no data" in empty.stderr


# -- timecodes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_timecode_is_preserved(tmp_path, suffix):
    source = make_video(tmp_path / "a.mov", 10, timecode="10:20:30:05")
    for start_s, expected in ((0, "10:20:30:05"), (0.2, "10:20:30:10")):
        out = tmp_path / f"b{suffix}"
        with VideoReader(source, start_s) as reader:
            process(
                reader.items(), VideoWriter.from_source(reader, out), lambda frame, time_s: frame
            )
        with av.open(str(out)) as container:
            notes = [container.metadata, *(stream.metadata for stream in container.streams)]
        timecodes = {
            text for note in notes for key, text in note.items() if key.lower() == "timecode"
        }
        assert timecodes == {expected}


def test_lost_timecode_is_reported(tmp_path):
    source = make_video(tmp_path / "a.mov", 3, timecode="10:20:30:05")
    with (
        VideoReader(source) as reader,
        VideoWriter.from_source(reader, tmp_path / "b.ts") as writer,
    ):
        writer.write(frame_of_image(np.zeros((SIZE[1], SIZE[0]), np.uint8)))
    assert "the timecode is lost" in writer.notes[0]


def test_drop_frame_timecode_follows_clock():
    """At 29.97 frames/s, an hour of clock time is 107892 frames (SMPTE ST 12), and days wrap
    around."""
    rate = Fraction(30000, 1001)
    assert advance_timecode("00:00:00;00", 107892, rate) == "01:00:00;00"
    assert advance_timecode("00:00:00;00", 24 * 107892, rate) == "00:00:00;00"
    timecodes = [advance_timecode("00:00:00;00", n, rate) for n in range(40000)]
    assert len(set(timecodes)) == 40000
    assert timecodes == sorted(timecodes)
    assert not any(c.endswith((":00;00", ":00;01")) and int(c[3:5]) % 10 for c in timecodes)
    assert advance_timecode("00:00:59;59", 1, Fraction(60000, 1001)) == "00:01:00;04"
