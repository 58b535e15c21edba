"""Numbered images as video output."""

import signal
import sys
from pathlib import Path
from subprocess import PIPE, Popen

import av
import numpy as np
import pytest
from PIL import Image

import omnimirror as om
from omnimirror.base.errors import MediaError
from omnimirror.io.video_frames import ColourCoding, empty_frame, frame_of_image
from omnimirror.io.video_writer import ImageSequenceWriter, VideoWriter
from tests.commands import fails, omnimirror
from tests.io.synthetic import images_of

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
DEWARP = om.Dewarper(
    om.MirrorBall(centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=260.0, image_size=(64, 64)),
    om.screens.Plane((32, 24), tilt_deg=-30.0),
)


def image_of(number: int) -> np.ndarray:
    v, u = np.mgrid[0:64, 0:64]
    return np.dstack([2 * u + 20, 2 * v + 40, np.full_like(u, 20 * number)]).astype(np.uint8)


@pytest.fixture
def film(tmp_path):
    with VideoWriter(tmp_path / "in.mp4", (64, 64), 25, crf=1) as writer:
        for i in range(12):
            writer.write(frame_of_image(image_of(i)))
    return tmp_path / "in.mp4"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_frames_are_written_as_numbered_images(film, tmp_path, suffix):
    out = tmp_path / "out"
    run = omnimirror("dewarp", film, *BALL, "-o", out / f"f%04d{suffix}")
    assert run.returncode == 0, run.stderr
    assert names(out) == [f"f{i:04d}{suffix}" for i in range(1, 13)]
    for i, frame in enumerate(images_of(film), 1):
        expected = DEWARP(frame.to_ndarray(format="rgb24")).astype(float)
        with Image.open(out / f"f{i:04d}{suffix}") as image:
            assert np.abs(np.asarray(image) - expected)[2:-2, 2:-2].mean() < 3


def test_images_of_longer_run_are_reported(film, tmp_path):
    for name in ("f0012.png", "f0013.png", "f0020.png", "f14.png"):
        (tmp_path / name).write_bytes(b"older")
    run = omnimirror("dewarp", film, *BALL, "-o", tmp_path / "f%04d.png")
    assert run.returncode == 0, run.stderr
    assert "f0013.png to f0020.png are images of a previous run and do not belong" in run.stderr
    assert (tmp_path / "f0013.png").read_bytes() == b"older"
    repeated = omnimirror("dewarp", film, *BALL, "--skip-existing", "-o", tmp_path / "f%04d.png")
    assert "previous run" not in repeated.stderr


def test_existing_images_are_skipped(film, tmp_path):
    whole, part = tmp_path / "whole", tmp_path / "part"
    assert omnimirror("dewarp", film, *BALL, "-o", whole / "%d.png").returncode == 0
    part.mkdir()
    (part / "2.png").write_bytes(b"mine")
    (part / "007.png").write_bytes(b"the number of none")
    run = omnimirror("dewarp", film, *BALL, "--skip-existing", "-o", part / "%d.png")
    assert "11 frames" in run.stderr
    assert (part / "2.png").read_bytes() == b"mine"
    for i in (1, *range(3, 13)):
        assert (part / f"{i}.png").read_bytes() == (whole / f"{i}.png").read_bytes()
    repeated = omnimirror("dewarp", film, *BALL, "--skip-existing", "-o", part / "%d.png")
    assert (repeated.returncode, "0 frames" in repeated.stderr) == (0, True)
    omnimirror("dewarp", film, *BALL, "-o", part / "%d.png")
    assert (part / "2.png").read_bytes() == (whole / "2.png").read_bytes()


def test_sigterm_leaves_complete_images(film, tmp_path):
    out, program = tmp_path / "out", Path(sys.executable).with_name("omnimirror")
    arguments = [
        "dewarp",
        film,
        "--ball",
        "31.5,31.5,30,260",
        "--size",
        "512x256",
        "-o",
        out / "%d.png",
        "-o",
        "-",
    ]
    with Popen([program, *map(str, arguments)], stdout=PIPE, stderr=PIPE) as run:
        assert run.stdout.read(9) == b"YUV4MPEG2"  # the writer blocks at a full pipe
        run.send_signal(signal.SIGTERM)
        _, stderr = run.communicate()
    assert run.returncode == 143, stderr
    files = names(out)
    assert files == [f"{i}.png" for i in range(1, len(files) + 1)]
    assert 1 <= len(files) < 12
    assert all(om.read_image(out / name).shape == (256, 512, 3) for name in files)


@pytest.mark.parametrize(
    ("source", "output", "message"),
    [
        (
            "in.mp4",
            "f.png",
            "cannot write f.png: the name must contain a number, such as f%04d.png",
        ),
        (
            "in.mp4",
            "f%s.png",
            "cannot write f%s.png: the name must contain a number, such as f%04d.png",
        ),
        (
            "in.mp4",
            "f%d-%d.png",
            "cannot write f%d-%d.png: the name must contain one number and no other %, such as f%04d.png",
        ),
        (
            "in.mp4",
            "100%/f%d.png",
            "cannot write 100%/f%d.png: the name must contain one number and no other %, such as f%04d.png",
        ),
        (
            "in.mp4",
            "f%4d.png",
            "cannot write f%4d.png: the number must have at most 9 digits with leading zeros, such as f",
        ),
        (
            "in.mp4",
            "f%099999999d.png",
            "cannot write f%099999999d.png: the number must have at most 9 digits with leading zeros, s",
        ),
        (
            "in.mp4",
            "f%04d.gif",
            "cannot write f%04d.gif: the suffix of an image sequence must be one of .png, .jpg, .jpeg, ",
        ),
        ("f%04d.png", "./f%03d.png", "must not overwrite the source images f%04d.png"),
    ],
)
def test_invalid_pattern_raises(film, tmp_path, source, output, message):
    om.write_image(tmp_path / "f0001.png", image_of(1))
    assert message in fails("dewarp", source, *BALL, "-o", output, cwd=tmp_path)
    assert names(tmp_path) == ["f0001.png", "in.mp4"]


def test_video_options_are_rejected_for_images(film, tmp_path):
    for option in (["--set", "video.crf=3"], ["--set", "video.pixel_format=yuv420p"]):
        fails("dewarp", film, *BALL, *option, "-o", tmp_path / "%d.png")
    arguments = ["--skip-existing", "-o", tmp_path / "%d.png", "-o", tmp_path / "a.mp4"]
    assert "skip_existing must be used with a single image sequence" in fails(
        "dewarp", film, *BALL, *arguments
    )
    assert names(tmp_path) == ["in.mp4"]


# -- depth -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bits", "pixel_format"), [(10, "yuv420p10le"), (12, "yuv444p12le"), (16, "yuv444p16le")]
)
def test_more_than_8_bits_are_written_as_16(tmp_path, bits, pixel_format):
    """Luma of n bits is black at 16/256 and white at 235/256 (ITU-R BT.2100)."""
    scale = 1 << (bits - 8)
    frame, (y, u, v) = empty_frame((64, 48), pixel_format)
    y[:] = np.linspace(16 * scale, 235 * scale, 64).round()
    u[:] = v[:] = 128 * scale
    frame.color_range, frame.colorspace = 1, 1
    ImageSequenceWriter(tmp_path / "%d.png", (64, 48), pixel_format).write(frame)
    image = om.read_image(tmp_path / "1.png")
    assert image.dtype == np.uint16
    expected = (y[0] / scale - 16) / 219
    np.testing.assert_allclose(
        image / 65535, np.repeat(expected[None, :, None], 3, 2).repeat(48, 0), atol=4e-4
    )


def test_transparency_is_preserved(tmp_path):
    frame, (y, u, v, a) = empty_frame((64, 48), "yuva444p")
    for plane, value in zip((y, u, v, a), (126, 128, 128, 77), strict=True):
        plane[:] = value
    ImageSequenceWriter(tmp_path / "%d.png", (64, 48), "yuva444p").write(frame)
    assert om.read_image(tmp_path / "1.png")[20, 20, 3] == 77


def test_image_losses_are_reported(tmp_path):
    hdr = ColourCoding(1, 9, 9, 16)
    notes = ImageSequenceWriter(tmp_path / "%d.jpg", (64, 48), "yuva444p10le", hdr).notes
    assert "%d.jpg: 10 bits are reduced to 8, transparency is lost; use .png or .tif" in notes[0]
    assert "HDR tags are lost in images" in notes[1]
    assert not ImageSequenceWriter(tmp_path / "%d.png", (64, 48), "yuva444p10le").notes
    with pytest.raises(MediaError, match=r"\.jpg images must have at most 65500 px per side"):
        ImageSequenceWriter(tmp_path / "%d.jpg", (70_000, 48))


def test_chroma_is_centre_sited(tmp_path):
    """Siting declared by the sink: a ramp of chroma samples at 2 i + 0.5 is a straight line through
    them."""
    frame, (y, u, v) = empty_frame((64, 48))
    y[:], u[:], v[:] = 128, 128, 64 + 4 * np.arange(32)
    frame.color_range, frame.colorspace = 1, 1
    ImageSequenceWriter(tmp_path / "%d.png", (64, 48)).write(frame)
    red = om.read_image(tmp_path / "1.png")[24, 8:56, 0].astype(float)
    colour = 64 + 2 * (np.arange(8, 56) - 0.5)
    expected = 255 * ((128 - 16) / 219 + 1.5748 * (colour - 128) / 224)
    inside = (expected > 5) & (expected < 250)
    np.testing.assert_allclose(red[inside], expected[inside], atol=1.5)


def test_panorama_metadata_of_image_sequences(film, tmp_path):
    run = omnimirror(
        "dewarp", film, "--ball", "31.5,31.5,30,260", "--size", "128x64", "-o", tmp_path / "%d.jpg"
    )
    assert run.returncode == 0, run.stderr
    assert b"GPano" in (tmp_path / "1.jpg").read_bytes()
    assert av.open(str(tmp_path / "1.jpg")).streams.video[0].width == 128
