"""Interlaced videos: frames with lines of two instants."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.filter import Graph
from PIL import Image

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.colour import linear_from_srgb
from omnimirror.io.images import encoded
from omnimirror.io.video_frames import frame_of_image, image_of_frame, planes
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from omnimirror.optics.image_sensor import Imager

# -- Interlaced videos: frames with lines of two instants ------------------------------------------

WIDTH, HEIGHT, COUNT, STEP = 64, 48, 6, 4


def bar(field: int) -> np.ndarray:
    """Return a bar that moves with every field."""
    x = np.arange(WIDTH) - 8 - STEP * field
    return np.where((x >= 0) & (x < 8), 200, 50)


def mark_fields(frames, mode):
    """Set the field order of frames."""
    graph = Graph()
    source = graph.add_buffer(
        width=WIDTH, height=HEIGHT, format="yuv420p", time_base=Fraction(1, 25)
    )
    setfield, sink = graph.add("setfield", mode), graph.add("buffersink")
    source.link_to(setfield)
    setfield.link_to(sink)
    graph.configure()
    for frame in frames:
        graph.push(frame)
        yield graph.pull()


def write_film(path, mode):
    def frames():
        for i in range(COUNT):
            frame = av.VideoFrame(WIDTH, HEIGHT, "yuv420p")
            y, u, v = planes(frame)
            first = 0 if mode == "tff" else 1
            y[first::2], y[1 - first :: 2], u[:], v[:] = bar(2 * i), bar(2 * i + 1), 128, 128
            frame.pts, frame.time_base = i, Fraction(1, 25)
            yield frame

    with av.open(str(path), "w") as container:
        options = {"crf": "1", **({} if mode == "prog" else {"x264-params": f"{mode}=1"})}
        stream = container.add_stream("libx264", rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for frame in mark_fields(frames(), mode):
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def bar_positions(frame) -> np.ndarray:
    """Return the bar position in each line."""
    light = planes(frame)[0].astype(float) - 50
    return (light * np.arange(WIDTH)).sum(axis=1) / light.sum(axis=1)


@pytest.mark.parametrize("mode", ["tff", "bff"])
def test_deinterlaced_frames_show_one_field(tmp_path, mode):
    with VideoReader(write_film(tmp_path / "a.mp4", mode)) as reader:
        assert "is interlaced" in reader.notes[0]
        frames = list(reader.frames())
    assert [frame.time for frame in frames] == pytest.approx([i / 25 for i in range(COUNT)])
    for i, frame in enumerate(frames[1:-1], 1):  # neighbours are missing at the ends
        np.testing.assert_allclose(bar_positions(frame), 11.5 + 2 * STEP * i, atol=0.5)
        assert not frame.interlaced_frame


def test_part_of_interlaced_video_has_exact_limits(tmp_path):
    with VideoReader(write_film(tmp_path / "a.mp4", "bff"), 0.08, 0.08) as reader:
        frames = list(reader.frames())
    assert [frame.time for frame in frames] == pytest.approx([0, 0.04])
    np.testing.assert_allclose(np.median(bar_positions(frames[0])), 11.5 + 2 * STEP * 2, atol=0.5)


def test_progressive_frames_are_unchanged(tmp_path):
    """Including combing patterns without an interlace flag."""
    with VideoReader(write_film(tmp_path / "a.mp4", "prog")) as reader:
        assert reader.notes == []
        frame = list(reader.frames())[2]
    assert np.ptp(bar_positions(frame)) > STEP - 1


# -- RGB order of colours in Python for all programs and interfaces --------------------------------

ORANGE = (230, 120, 20)
BALL = om.MirrorBall(
    centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=280.0, image_size=(64, 64)
)
BALL_OPTIONS = ("--ball", "31.5,31.5,30,280")
VIEW = om.screens.Plane((32, 24), hfov_deg=60.0)


def orange(size=(64, 64)) -> np.ndarray:
    return np.full((size[1], size[0], 3), ORANGE, np.uint8)


def write_with_pillow(path: Path, size=(64, 64)) -> Path:
    Image.new("RGB", size, ORANGE).save(path)
    return path


def read_with_pillow(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def assert_orange(image: np.ndarray, tolerance: float = 0.0) -> None:
    """Check the centre of the image."""
    middle = image[image.shape[0] // 2, image.shape[1] // 2, :3].astype(float)
    np.testing.assert_allclose(middle, ORANGE, atol=tolerance)


def deep_png(path: Path) -> Path:
    """Write a 16-bit orange image byte by byte as specified: R, G, B, big-endian."""
    row = b"\0" + struct.pack(">3H", *(257 * value for value in ORANGE)) * 8

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">2I5B", 8, 8, 16, 2, 0, 0, 0)
    whole = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(row * 8)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + whole)
    return path


def deep_tiff(path: Path, kind: str) -> Path:
    """Write an uncompressed orange image of 16 bits or floats from 0 to 1, as specified by TIFF
    6.0."""
    values = np.array(ORANGE) * 257 if kind == "<u2" else np.array(ORANGE) / 255
    data = np.tile(values.astype(kind), 64).tobytes()
    size, bits = np.dtype(kind).itemsize, 8 * np.dtype(kind).itemsize
    entries = [
        (256, 3, 1, 8), (257, 3, 1, 8), (258, 3, 3, 146), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 1, 158),
        (277, 3, 1, 3), (278, 3, 1, 8), (279, 4, 1, 64 * 3 * size), (284, 3, 1, 1), (339, 3, 3, 152),
    ]  # fmt: skip
    table = (
        struct.pack("<H", len(entries))
        + b"".join(struct.pack("<2H2I", *e) for e in entries)
        + bytes(4)
    )
    head = b"II*\0" + struct.pack("<I", 8) + table
    sample_format = 1 if kind == "<u2" else 3
    path.write_bytes(head + struct.pack("<6H", *[bits] * 3, *[sample_format] * 3) + data)
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp", ".bmp"])
def test_pillow_interoperability(tmp_path, suffix):
    tolerance = {".jpg": 2, ".webp": 3}.get(suffix, 0)
    assert_orange(om.read_image(write_with_pillow(tmp_path / f"theirs{suffix}")), tolerance)
    om.write_image(tmp_path / f"ours{suffix}", orange())
    assert_orange(read_with_pillow(tmp_path / f"ours{suffix}"), 2 if suffix == ".jpg" else 0)


@pytest.mark.parametrize(("suffix", "alpha"), [(".png", 99), (".tif", 255), (".webp", 99)])
def test_alpha_is_last_channel(tmp_path, suffix, alpha):
    """Semi-transparent TIFF is excluded: its readers weight colours by alpha."""
    colour = (*ORANGE, alpha)
    Image.new("RGBA", (8, 8), colour).save(tmp_path / f"theirs{suffix}", lossless=True)
    assert om.read_image(tmp_path / f"theirs{suffix}")[4, 4].tolist() == [*colour]
    om.write_image(tmp_path / f"ours{suffix}", np.full((8, 8, 4), colour, np.uint8))
    with Image.open(tmp_path / f"ours{suffix}") as image:
        assert image.convert("RGBA").getpixel((4, 4)) == colour


def test_deep_files_from_raw_bytes(tmp_path):
    assert_orange(om.read_image(deep_png(tmp_path / "a.png")) / 257)
    assert_orange(om.read_image(deep_tiff(tmp_path / "a.tif", "<u2")) / 257)
    assert_orange(om.read_image(deep_tiff(tmp_path / "b.tif", "<f4")) * 255, 1e-4)


def test_radiance_files(tmp_path):
    """Bytes of red, green, blue and their exponent, as specified for Radiance."""
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\n"
    (tmp_path / "theirs.hdr").write_bytes(head + bytes([*ORANGE, 128]) * 16)
    assert_orange(om.read_image(tmp_path / "theirs.hdr") * 256, 0.6)
    om.write_image(tmp_path / "ours.hdr", np.full((4, 4, 3), np.array(ORANGE) / 256, np.float32))
    assert_orange(
        np.frombuffer((tmp_path / "ours.hdr").read_bytes()[-64:], np.uint8).reshape(4, 4, 4), 1
    )


def test_openexr_names_its_channels(tmp_path):
    library = pytest.importorskip("OpenEXR")
    channels = {
        name: np.full((8, 8), value, np.float32) for name, value in zip("RGB", ORANGE, strict=True)
    }
    with library.File({"type": library.scanlineimage}, channels | {"A": channels["R"]}) as file:
        file.write(str(tmp_path / "theirs.exr"))
    assert om.read_image(tmp_path / "theirs.exr")[4, 4].tolist() == [*ORANGE, ORANGE[0]]
    om.write_image(tmp_path / "ours.exr", np.full((8, 8, 4), (*ORANGE, 7), np.float32))
    with library.File(str(tmp_path / "ours.exr"), separate_channels=True) as file:
        assert [file.channels()[name].pixels[4, 4] for name in "RGBA"] == [*ORANGE, 7]


def test_encoded_images_have_rgb_order(tmp_path):
    (tmp_path / "a.png").write_bytes(encoded(orange(), ".png"))
    (tmp_path / "a.jpg").write_bytes(encoded(orange(), ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 90]))
    assert_orange(read_with_pillow(tmp_path / "a.png"))
    assert_orange(read_with_pillow(tmp_path / "a.jpg"), 3)


def omnimirror(*args) -> None:
    """Run the command line."""
    with suppress(SystemExit):
        main([*map(str, args)])


# -- videos ----------------------------------------------------------------------------------------


def film_by_pyav(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "bgr0"
        for _ in range(3):
            container.mux(
                stream.encode(
                    av.VideoFrame.from_ndarray(orange(), format="rgb24").reformat(format="bgr0")
                )
            )
        container.mux(stream.encode(None))
    return path


def frames_by_pyav(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_frames_of_a_video(tmp_path):
    film_by_pyav(tmp_path / "theirs.mkv")
    images: list[np.ndarray] = []

    def append(image, time_s):
        images.append(image)
        return image

    with (
        VideoReader(tmp_path / "theirs.mkv") as reader,
        VideoReader(tmp_path / "theirs.mkv") as reopened,
    ):
        assert_orange(image_of_frame(next(reopened.frames())))
        process(reader.items(), VideoWriter(tmp_path / "ours.mp4", (64, 64), 25, crf=1), append)
    assert_orange(images[1])
    assert_orange(frames_by_pyav(tmp_path / "ours.mp4")[1], 6)


@pytest.mark.parametrize("channels", [3, 4])
def test_frames_of_images(channels):
    image = np.dstack([orange(), np.full((64, 64), 255, np.uint8)])[..., :channels]
    frame = frame_of_image(np.ascontiguousarray(image))
    assert_orange(frame.to_ndarray(format="rgb24"))
    assert_orange(image_of_frame(frame.reformat(format="yuv444p")), 6)


def test_video_dewarped_by_command_line(tmp_path, capfdbinary):
    film = film_by_pyav(tmp_path / "theirs.mkv")
    size = ("--view", "perspective", "--size", "32x24")
    omnimirror(
        "dewarp", film, *BALL_OPTIONS, *size, "--set", "video.crf=1", "-o", tmp_path / "ours.mp4"
    )
    assert_orange(frames_by_pyav(tmp_path / "ours.mp4")[1], 8)
    omnimirror("dewarp", film, *BALL_OPTIONS, *size, "-o", "rawvideo:-")
    assert_orange(np.frombuffer(capfdbinary.readouterr().out, np.uint8).reshape(3, 24, 32, 3)[1], 8)


# -- dewarped, rendered and restored images --------------------------------------------------------


def test_images_dewarped(tmp_path):
    assert_orange(om.Dewarper(BALL, VIEW)(om.read_image(write_with_pillow(tmp_path / "a.png"))))
    assert om.Dewarper(BALL, VIEW)(orange(), transparent=True)[12, 16].tolist() == [*ORANGE, 255]
    all_around = om.Dewarper(BALL, om.screens.Equirectangular((64, 32)), border=(1, 2, 3))
    assert (all_around(orange())[~all_around.valid] == [1, 2, 3]).all()


def test_images_dewarped_by_command_line(tmp_path):
    write_with_pillow(tmp_path / "a.png")
    args = (
        *BALL_OPTIONS,
        "--view",
        "sphere",
        "--size",
        "64x32",
        "--border",
        "#0a141e",
        "--interpolation",
        "linear",
    )
    omnimirror("dewarp", tmp_path / "a.png", *args, "-o", tmp_path / "b.png")
    colours = {tuple(c) for c in read_with_pillow(tmp_path / "b.png").reshape(-1, 3).tolist()}
    assert colours == {ORANGE, (0x0A, 0x14, 0x1E)}


@pytest.fixture
def sensor() -> om.Sensor:
    return replace(om.load_sensor("paper-spherical"), imager=Imager(64, 64, 83.2))


def test_images_rendered_and_restored(sensor, tmp_path):
    write_with_pillow(tmp_path / "world.png", (128, 64))
    image = om.render_image(sensor, om.Environment.load(tmp_path / "world.png"), samples=1)
    assert_orange(image)
    om.write_image(tmp_path / "a.png", image)
    assert_orange(read_with_pillow(tmp_path / "a.png"))
    assert_orange(om.restore(sensor, image, noise=0.01), 2)


@pytest.mark.parametrize("suffix", [".png", ".hdr", ".exr"])
def test_images_rendered_by_command_line(sensor, tmp_path, suffix):
    om.save_sensor(sensor, tmp_path / "small.toml")
    write_with_pillow(tmp_path / "world.png", (128, 64))
    out = tmp_path / f"a{suffix}"
    omnimirror(
        "simulate",
        tmp_path / "small.toml",
        "--scene",
        tmp_path / "world.png",
        "--spp",
        "1",
        "-o",
        out,
    )
    if suffix == ".png":
        assert_orange(read_with_pillow(out))
    else:
        light = om.read_image(out)[32, 32, :3]
        np.testing.assert_allclose(
            light, linear_from_srgb(np.array(ORANGE) / 255), rtol=0.02, atol=0.004
        )
