"""Video files: reading, image processing and writing."""

import os
import resource
import signal
import stat
import subprocess
import sys
import threading
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.io.image_metadata import oriented
from omnimirror.io.video_frames import (
    ColourCoding,
    converted,
    empty_frame,
    frame_of_image,
    frame_of_planes,
    image_of_frame,
    planes,
    upright,
)
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from tests.everyday import few
from tests.io.synthetic import (
    SIZE,
    grey_of,
    images_of,
    luma_of,
    make_video,
    number_of,
    sound_of,
    tone,
)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return make_video(tmp_path_factory.mktemp("video") / "ünï clip.mp4", title="A room")


def unchanged(pixels, time_s):
    return pixels


def process_file(source, path, function=unchanged, pixels="image", **more):
    with VideoReader(source) as reader:
        return process(
            reader.items(), VideoWriter.from_source(reader, path, **more), function, pixels
        )


@pytest.mark.parametrize(("rate", "suffix"), [(2, ".mp4"), (2, ".mov"), (25, ".m4v"), (25, ".mkv")])
def test_duration_includes_all_frames(tmp_path, rate, suffix):
    """Frames displayed by FFmpeg, and their total duration, with B-frames last in the file."""
    rough = np.kron(
        np.random.default_rng(1).integers(40, 200, (6, 24, 3), np.uint8),
        np.ones((8, 8, 1), np.uint8),
    )
    short = []
    for count in (*range(1, 16), 26, 51):
        path = tmp_path / f"{count}{suffix}"
        with VideoWriter(path, SIZE, rate) as video:
            for number in range(count):
                frame = frame_of_image(np.ascontiguousarray(rough[:, number : number + 64]))
                frame.pts, frame.time_base = number, Fraction(1, rate)
                video.write(frame)
        with av.open(str(path)) as container:
            duration_s = container.duration / av.time_base
        if (count_of_frames := len(images_of(path))) != count or abs(
            duration_s - count / rate
        ) > 0.0011:
            short.append((count, count_of_frames, duration_s))
    assert not short


# -- complete path
# -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".ts"])
@pytest.mark.parametrize("pixels", ["image", "planes"])
def test_copy_keeps_everything_except_pixels(clip, tmp_path, suffix, pixels):
    out = tmp_path / f"out{suffix}"
    outcome = process_file(clip, out, pixels=pixels)
    before, after = images_of(clip), images_of(out)
    assert (outcome.frames, outcome.is_stopped, len(after)) == (50, False, 50)
    # Matroska and MPEG-TS start at 0 or later, and shift images and sound equally.
    sound, copied = sound_of(clip), sound_of(out)
    shift = after[0].pts * after[0].time_base - before[0].pts * before[0].time_base
    assert shift == 0 if suffix in (".mp4", ".mov") else shift >= 0
    tick = after[0].time_base
    for a, b in zip(before, after, strict=True):
        assert abs(b.pts * b.time_base - a.pts * a.time_base - shift) <= tick / 2
        assert abs(luma_of(a) - luma_of(b)) <= 4
    assert [data for _, data in copied] == [
        data for _, data in sound
    ] or suffix == ".ts"  # in ADTS frames there
    assert len(copied) == len(sound)
    assert all(
        abs(c[0] - s[0] - shift) <= Fraction(1, 900) for c, s in zip(copied, sound, strict=True)
    )
    with VideoReader(out) as reader:
        assert reader.frame_rate == 25
        assert reader.colour == ColourCoding(1, 1, 1, 1)
        assert reader.metadata.get("title") == ("A room" if suffix != ".ts" else None)
    assert list(tmp_path.iterdir()) == [out]


FIELD = cv2.resize(np.random.default_rng(4).integers(40, 200, (6, 8, 3), np.uint8), SIZE)


def write_rotated(path, rotation, pixel_format="yuv420p"):
    """Write a video of one image that differs in all orientations."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=25, options={"crf": "1"})
        video.width, video.height, video.pix_fmt = *SIZE, pixel_format
        video.set_display_rotation(rotation)
        for number in range(3):
            frame = av.VideoFrame.from_ndarray(FIELD, "rgb24")
            frame.pts = number
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
    return path


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.parametrize("rotation", [90, -90, 180])
def test_rotation_equals_opencv(tmp_path, rotation, suffix):
    source = write_rotated(tmp_path / f"a{suffix}", rotation)
    expected = cv2.VideoCapture(str(source)).read()[1][..., ::-1]
    with VideoReader(source) as reader:
        frames = list(reader.frames())
        assert reader.size == (frames[0].width, frames[0].height) == expected.shape[1::-1]
        assert "--set input.stored_orientation=true" in reader.notes[0]
    assert len(frames) == 3
    for frame in frames:
        assert np.abs(image_of_frame(frame).astype(int) - expected).max() <= 1
    process_file(source, tmp_path / f"b{suffix}")
    (output, *_) = images_of(tmp_path / f"b{suffix}")
    assert (output.rotation, output.width, output.height) == (0, *expected.shape[1::-1])


@pytest.mark.parametrize("rotation", [90, 180])
def test_stored_orientation_option(tmp_path, rotation):
    source = write_rotated(tmp_path / "a.mp4", rotation)
    with VideoReader(source, stored_orientation=True) as reader:
        (frame, *_) = reader.frames()
        assert reader.size == (frame.width, frame.height) == SIZE
        assert abs(reader.rotation_deg) == rotation
        assert "as stored" in reader.notes[0]
    assert np.abs(image_of_frame(frame).astype(int) - FIELD).mean() < 4


def test_rotation_by_other_angle_is_reported(tmp_path):
    with VideoReader(write_rotated(tmp_path / "a.mp4", 30)) as reader:
        assert reader.size == SIZE
        assert "not a multiple of 90 deg and is not applied" in reader.notes[0]


@pytest.mark.parametrize("size", [(64, 48), (63, 47)])
@pytest.mark.parametrize(
    "name", ["yuv420p", "nv12", "yuv422p10le", "yuva444p12le", "rgb24", "gray"]
)
@pytest.mark.parametrize("number", [2, 3, 4, 5, 6, 7, 8])
def test_frames_are_oriented_as_images(number, name, size):
    image = cv2.resize(FIELD, size)
    frame = converted(av.VideoFrame.from_ndarray(image, "rgb24"), name)
    frame.pts, frame.time_base = 7, Fraction(1, 25)
    rotated = upright(frame, number)
    assert (rotated.pts, rotated.time_base) == (7, Fraction(1, 25))
    before, after = (
        np.stack(planes(converted(part, "yuv444p16le", interpolation=2))) / 256
        for part in (frame, rotated)
    )
    expected = np.stack([oriented(plane, number) for plane in before])
    assert np.abs(after[0] - expected[0]).max() < 1.1  # luma; chroma may be interpolated
    assert np.abs(after[1:] - expected[1:]).mean() < 1.5


@pytest.mark.parametrize("space", [1, 5])
@pytest.mark.parametrize("colour_range", [1, 2])
@pytest.mark.parametrize("pixels", ["image", "planes"])
def test_colours_are_unchanged(tmp_path, space, colour_range, pixels):
    source = make_video(tmp_path / "a.mp4", 5, colour_range=colour_range, colour_space=space)
    process_file(source, tmp_path / "b.mp4", pixels=pixels, crf=5)
    a, b = images_of(source)[3], images_of(tmp_path / "b.mp4")[3]
    assert (b.color_range, b.colorspace) == (a.color_range, a.colorspace) == (colour_range, space)
    for plane_a, plane_b in zip(planes(a), planes(b), strict=True):
        assert np.abs(plane_a.astype(int) - plane_b).max() <= 3
    assert np.abs(image_of_frame(a).astype(int) - image_of_frame(b)).max() <= 6


def test_full_range_is_converted_if_unsupported(tmp_path):
    source = make_video(tmp_path / "a.mp4", 5, colour_range=2)
    for pixels in ("image", "planes"):
        process_file(
            source,
            tmp_path / "b.mkv",
            pixels=pixels,
            codec="mpeg4",
            options={"qmin": "1", "qmax": "1"},
        )
        a, b = images_of(source)[3], images_of(tmp_path / "b.mkv")[3]
        assert b.color_range != 2
        assert abs(luma_of(b) - (16 + luma_of(a) * 219 / 255)) <= 3


def test_variable_frame_times_are_preserved(tmp_path):
    times = [0, 1, 2, 7, 8, 20, 21, 22, 40]
    source = make_video(tmp_path / "a.mp4", times=times)
    process_file(source, tmp_path / "b.mp4")
    assert [round(frame.time * 25, 6) for frame in images_of(tmp_path / "b.mp4")] == times


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.parametrize(
    ("start", "duration", "first", "count"),
    [
        (0, 0.4, 0, 10),
        (1.0, 0.4, 25, 10),
        (0.5, None, 13, 37),
        (1.02, 0.2, 26, 5),
        (1.96, 5, 49, 1),
    ],
)
def test_start_and_duration_are_exact(clip, tmp_path, suffix, start, duration, first, count):
    source = clip if suffix == ".mp4" else make_video(tmp_path / "a.mkv")
    with VideoReader(source, start, duration) as reader:
        assert abs(reader.expected_frames - count) <= 1
        process(reader.items(), VideoWriter.from_source(reader, tmp_path / "b.mp4"), unchanged)
    frames = images_of(tmp_path / "b.mp4")
    assert [number_of(frame) for frame in frames] == [i % 9 for i in range(first, first + count)]
    assert frames[0].time == pytest.approx(first / 25 - start, abs=1e-3)
    # The audio is that of the same part: its packets start within one packet of the images.
    origin = {data: time for time, data in sound_of(source)}
    for time, data in sound_of(tmp_path / "b.mp4"):
        assert float(origin[data] - time) == pytest.approx(start, abs=2e-3)


def test_reader_can_be_iterated_repeatedly(clip):
    with VideoReader(clip) as reader:
        assert (
            reader.expected_frames == len(list(reader.frames())) == len(list(reader.frames())) == 50
        )
    with VideoReader(clip, with_audio=False) as reader:
        assert all(isinstance(item, av.VideoFrame) for item in reader.items())


def test_audio_packets_keep_stream_after_reading(clip):
    with VideoReader(clip) as reader:
        packets = [item for item in reader.items() if not isinstance(item, av.VideoFrame)]
        assert packets
        assert all(packet.stream is reader.audio_streams[0] for packet in packets)


def test_function_receives_frames_in_order_with_time(clip, tmp_path):
    calls = []

    def note(image, time_s):
        calls.append((round(time_s * 25), image.shape))
        assert threading.current_thread() is threading.main_thread()
        return image[:24, :32]

    process_file(clip, tmp_path / "b.mp4", note, size=(32, 24))
    assert calls == [(i, (48, 64, 3)) for i in range(50)]
    assert (images_of(tmp_path / "b.mp4")[0].width, len(sound_of(tmp_path / "b.mp4"))) == (
        32,
        len(sound_of(clip)),
    )


def test_planes_can_be_filled_without_a_copy(clip, tmp_path):
    def invert(parts, time_s):
        frame, targets = empty_frame(SIZE)
        for part, out in zip(parts, targets, strict=True):
            np.subtract(255, part, out=out)
        return frame

    process_file(clip, tmp_path / "b.mp4", invert, "planes", crf=5)
    lumas = [luma_of(frame) for frame in images_of(tmp_path / "b.mp4")]
    assert max(abs(luma - 255 + grey_of(i)) for i, luma in enumerate(lumas)) <= 4


def test_progress_reports(clip, tmp_path):
    updates = []
    with VideoReader(clip) as reader:
        process(
            reader.items(),
            VideoWriter.from_source(reader, tmp_path / "b.mp4"),
            unchanged,
            on_progress=lambda *n: updates.append(n),
            total=50,
        )
    assert updates[-1] == (50, 50)


def write_coded(path, codec, pixel_format, colour=None):
    """Write two frames of a smooth image, by PyAV only."""
    v, u = np.mgrid[0:48, 0:64]
    image = np.dstack([u * 4, v * 5, 200 - u, 255 - u * 3]).astype(np.uint8)
    with av.open(str(path), "w") as container:
        # Without B-frames: the decoding time of the first of two frames is undefined in x265
        parameters = "log-level=none:bframes=0"
        options = {"x265-params": parameters} if codec == "libx265" else {}
        stream = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = *SIZE, pixel_format
        (colour or ColourCoding()).apply_to(stream.codec_context)
        for i in range(2):
            frame = av.VideoFrame.from_ndarray(image, format="rgba").reformat(format=pixel_format)
            (colour or ColourCoding()).apply_to(frame)
            frame.pts, frame.time_base = i, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


HDR = ColourCoding(1, 9, 9, 16)


@pytest.mark.parametrize(
    ("source", "codec", "pixel_format", "out", "more", "output_format", "loss"),
    [
        ("a.mp4", "libx265", "yuv420p10le", "o.mp4", {}, "yuv420p10le", ""),
        ("a.mkv", "ffv1", "yuv422p10le", "o.mp4", {}, "yuv422p10le", ""),
        ("a.mkv", "ffv1", "yuv444p", "o.mkv", {"codec": "ffv1"}, "yuv444p", ""),
        ("a.mkv", "ffv1", "yuva444p12le", "o.mkv", {"codec": "ffv1"}, "yuva444p12le", ""),
        (
            "a.mkv",
            "ffv1",
            "yuva444p10le",
            "o.mov",
            {"codec": "prores_ks"},
            "yuva444p12le",
            "",
        ),  # decoded format
        (
            "a.mkv",
            "ffv1",
            "yuva444p12le",
            "o.mp4",
            {},
            "yuv444p10le",
            "12 bits are reduced to 10, transparency is lost;",
        ),
        (
            "a.mkv",
            "ffv1",
            "yuv444p",
            "o.mkv",
            {"codec": "mpeg4"},
            "yuv420p",
            "chroma is reduced from 4:4:4 to 4:2:0;",
        ),
        ("a.mkv", "ffv1", "bgr0", "o.mp4", {}, "yuv420p", "chroma is reduced from RGB to 4:2:0;"),
        ("a.mkv", "ffv1", "yuv444p", "o.mp4", {"pixel_format": "yuv420p"}, "yuv420p", ""),
    ],
)
def test_lost_depth_chroma_or_transparency_is_reported(
    tmp_path, source, codec, pixel_format, out, more, output_format, loss
):
    write_coded(tmp_path / source, codec, pixel_format, HDR if codec == "libx265" else None)
    with VideoReader(tmp_path / source) as reader:
        writer = VideoWriter.from_source(reader, tmp_path / out, **more)
        process(reader.items(), writer, unchanged, "frame")
    a, b = images_of(tmp_path / source)[0], images_of(tmp_path / out)[0]
    assert b.format.name == output_format
    assert ColourCoding.of(b) == ColourCoding.of(a) if codec == "libx265" else True
    assert [loss in note for note in writer.notes] == ([True] if loss else [])
    if "RGB" in loss:  # its planes as YUV depend on an unspecified matrix
        before, after = (image_of_frame(frame).astype(int) for frame in (a, b))
        assert np.abs(before - after)[4:-4, 4:-4].mean() < 80 * 255 / 4095
        return
    before, after = (planes(converted(frame, "yuva444p12le")) for frame in (a, b))
    for one, other in zip(before[: 3 if "transparency" in loss else 4], after, strict=False):
        assert np.abs(one.astype(int) - other)[4:-4, 4:-4].mean() < 80  # range of values: 4095


def test_hdr_losses_are_reported(tmp_path):
    write_coded(tmp_path / "a.mkv", "libx265", "yuv420p10le", HDR)
    with (
        VideoReader(tmp_path / "a.mkv") as reader,
        VideoWriter.from_source(reader, tmp_path / "b.mkv", codec="mpeg4") as b,
    ):
        b.write(next(reader.frames()))
    assert (
        "b.mkv: 10 bits are reduced to 8, HDR tags are lost; use --set video.codec=ffv1 with .mkv"
        in b.notes[0]
    )


def test_unsupported_pixel_format_raises(tmp_path):
    with pytest.raises(
        InvalidParameter,
        match="pixel_format must be one of yuv420p, yuvj420p, yuv422p, yuvj422p, yuv444p, yuvj444p, nv12,",
    ):
        VideoWriter(tmp_path / "a.mp4", SIZE, 25, pixel_format="rgb565")


# -- errors
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"the file does not exist"),
        (b"", r"it is not a video, or is damaged or truncated"),
        (b"hello, world" * 500, r"it is not a video, or is damaged or truncated"),
    ],
)
def test_invalid_video_file_raises(tmp_path, content, message, capfd):
    path = tmp_path / "a.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MediaError, match=message) as e:
        VideoReader(path)
    assert "\n" not in str(e.value)
    assert capfd.readouterr().err == ""


def test_audio_file_raises(tmp_path):
    with av.open(str(tmp_path / "a.mka"), "w") as container:
        sound = container.add_stream("aac", rate=48000, layout="mono")
        container.mux(sound.encode(tone(0)))
        container.mux(sound.encode(None))
    with pytest.raises(MediaError, match=r"no video stream can be decoded"):
        VideoReader(tmp_path / "a.mka")


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_truncated_video_keeps_readable_frames(tmp_path, suffix, capfd):
    whole = tmp_path / f"whole{suffix}"
    make_video(whole)
    if suffix == ".mp4":  # with its index first, as for the web; otherwise it is unreadable
        with (
            av.open(str(whole)) as source,
            av.open(str(tmp_path / "front.mp4"), "w", options={"movflags": "faststart"}) as out,
        ):
            copies = {
                stream.index: out.add_stream_from_template(stream) for stream in source.streams
            }
            for packet in source.demux():
                if packet.size:
                    packet.stream = copies[packet.stream.index]
                    out.mux(packet)
        whole = tmp_path / "front.mp4"
    data = whole.read_bytes()
    part = tmp_path / f"part{suffix}"
    part.write_bytes(data[: int(len(data) * 0.7)])
    with pytest.raises(MediaError, match=r"part.* is (truncated|damaged).* decoded frames") as e:
        process_file(part, tmp_path / f"out{suffix}")
    assert "\n" not in str(e.value)
    frames = images_of(tmp_path / f"out{suffix}")
    assert 5 < len(frames) < 50
    assert [number_of(frame) for frame in frames] == [i % 9 for i in range(len(frames))]
    assert capfd.readouterr().err == ""


def test_damaged_video_keeps_decodable_frames(clip, tmp_path):
    data = bytearray(clip.read_bytes())
    with av.open(str(clip)) as container:
        packets = [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]
    for at, size in (packets[10], packets[30]):
        data[at : at + size] = bytes(size)
    (tmp_path / "a.mp4").write_bytes(data)
    with pytest.raises(
        MediaError,
        match=r"a.mp4 is damaged: cannot decode \d+ of 50 frames; decoded \d+",
    ):
        process_file(tmp_path / "a.mp4", tmp_path / "b.mp4")
    assert 25 <= len(images_of(tmp_path / "b.mp4")) <= 48


def test_missing_index_raises(tmp_path):
    data = make_video(tmp_path / "a.mp4").read_bytes()
    (tmp_path / "b.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(MediaError, match=r"it is not a video, or is damaged or truncated"):
        VideoReader(tmp_path / "b.mp4")


@pytest.mark.parametrize(
    ("start", "duration"), [(-1, None), (float("nan"), None), (0, 0), (0, -1), (5, None)]
)
def test_part_outside_video_raises(clip, start, duration):
    with pytest.raises(InvalidParameter, match=r"(start_s|duration_s) must be"):
        VideoReader(clip, start, duration)


@pytest.mark.parametrize(
    ("name", "more", "message"),
    [
        (
            "a.gif",
            {},
            r"the suffix must be one of \.mp4, \.m4v, \.mov, \.mkv, \.webm, \.ts; got '\.gif'",
        ),
        ("a", {}, r"the suffix must be one of \.mp4, \.m4v, \.mov, \.mkv, \.webm, \.ts; got ''"),
        (
            "a.mp4",
            {"codec": "nonsense"},
            "codec must be an FFmpeg encoder such as libx264, libx265, libsvtav1, libvpx-vp9, mpeg4, mj",
        ),
        (
            "a.mp4",
            {"codec": "aac"},
            "codec must be a video encoder such as libx264, libx265, libsvtav1, libvpx-vp9, mpeg4, mjpe",
        ),
        (
            "a.mp4",
            {"codec": "mpeg4", "crf": 20},
            "options must be supported by the encoder mpeg4; got 'crf'",
        ),
        (
            "a.mp4",
            {"crf": -1},
            "crf must be between 0 and 63; got -1",
        ),
        (
            "a.webm",
            {"crf": 64},
            "crf must be between 0 and 63; got 64",
        ),
        (
            "a.mp4",
            {"options": {"colour": "1"}},
            "options must be supported by the encoder libx264; got 'colour'",
        ),
        (
            "a.mp4",
            {"size": (63, 48)},
            "the size of a video encoded by libx264 must be even because of chroma subsampling, such as",
        ),
        (
            "a.webm",
            {},
            r"webm does not support the audio codec of the source, aac; write to \.mkv, or omit the audio",
        ),
    ],
)
def test_unsupported_encoding_raises(clip, tmp_path, name, more, message):
    with VideoReader(clip) as reader, pytest.raises((MediaError, InvalidParameter), match=message):
        VideoWriter.from_source(reader, tmp_path / name, **more)
    assert not list(tmp_path.iterdir())


def test_frames_of_other_size_or_type_raise(tmp_path):
    with VideoWriter(tmp_path / "a.mp4", SIZE, 25) as writer:
        writer.write(frame_of_image(np.zeros((48, 64), np.uint8)))
        with pytest.raises(InvalidParameter, match=r"must have 64 x 48 px; got 32 x 24 px"):
            writer.write(frame_of_image(np.zeros((24, 32, 3), np.uint8)))
    with pytest.raises(
        MediaError, match=r"image must be uint8 of shape \(h, w\), \(h, w, 3\) or \(h, w, 4\)"
    ):
        frame_of_image(np.zeros((24, 32, 3), np.uint16))
    with pytest.raises(MediaError, match="planes must have the shapes of a 4:2:0 image"):
        frame_of_planes((np.zeros((24, 32), np.uint8),) * 3)
    with pytest.raises(MediaError, match=r"must be nv12 or planar YUV .*; got rgb24"):
        planes(av.VideoFrame(8, 8, "rgb24"))


@pytest.mark.parametrize("error", [RuntimeError("half way"), MediaError("half way")])
def test_error_keeps_existing_file(clip, tmp_path, error):
    out = tmp_path / "b.mp4"
    out.write_text("precious")
    before = set(threading.enumerate())

    def fail(image, time_s):
        if time_s > 1:
            raise error
        return image

    with pytest.raises(type(error), match="half way"):
        process_file(clip, out, fail)
    assert out.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [out]
    assert (
        set(threading.enumerate()) <= before
    )  # threads of a browser of other tests may be present


def test_writer_without_frames_raises(tmp_path):
    with (
        pytest.raises(MediaError, match=r"there are no frames"),
        VideoWriter(tmp_path / "a.mp4", SIZE, 25),
    ):
        pass
    assert not list(tmp_path.iterdir())


def test_ctrl_c_finishes_file(tmp_path):
    def stop_after_ten():
        with VideoWriter(tmp_path / "a.mp4", SIZE, 25) as writer:
            for _ in range(10):
                writer.write(frame_of_image(np.zeros((48, 64, 3), np.uint8)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop_after_ten()
    assert len(images_of(tmp_path / "a.mp4")) == 10
    with pytest.raises(KeyboardInterrupt), VideoWriter(tmp_path / "b.mp4", SIZE, 25):
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


SCRIPT = """
import sys, time
from omnimirror.base.errors import OmnimirrorError
from omnimirror.base import interrupts
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter

source, out, max_frames = sys.argv[1], sys.argv[2], int(sys.argv[3])  # frames before Ctrl-C
count = 0

def count_frame(image, time_s):
    global count
    count += 1
    print("frame", flush=True)
    while count == max_frames and not interrupts.is_pending():
        time.sleep(0.01)
    return image

try:
    reader = VideoReader(source)
    outcome = process(reader.items(), VideoWriter.from_source(reader, out), count_frame)
    print(outcome.exit_code, outcome.frames, flush=True)
except OmnimirrorError as e:
    sys.exit(f"omnimirror: {e}")
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_leave_playable_file(clip, tmp_path, number):
    out = tmp_path / "b.mp4"
    run = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, clip, out, "8"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for _ in range(8):
        assert run.stdout.readline() == "frame\n"
    run.send_signal(number)
    rest, errors = run.communicate()
    assert (run.returncode, errors) == (0, "")
    code, count = rest.splitlines()[-1].split()
    assert int(code) == 128 + number
    frames = images_of(out)
    assert 7 <= len(frames) == int(count) < 40
    assert [number_of(frame) for frame in frames] == [i % 9 for i in range(len(frames))]
    assert sound_of(out)
    assert list(tmp_path.iterdir()) == [out]


def test_full_disk_is_reported_and_preserves_files(tmp_path):
    source = make_video(tmp_path / "a.mp4", 200)
    out = tmp_path / "out" / "b.mp4"
    out.parent.mkdir()
    out.write_text("precious")
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, source, out, "0"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # it would be truncated too
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )
    assert run.returncode == 1
    assert run.stderr.startswith(f"omnimirror: cannot write {out}: File too large")
    assert len(run.stderr.splitlines()) == 1
    assert out.read_text() == "precious"
    assert os.listdir(out.parent) == ["b.mp4"]


KILLED = """
import os, signal, sys
import numpy as np
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter

writer = VideoWriter(sys.argv[1], (64, 48), 25, options={"tune": "zerolatency"})
for i in range(100):
    writer.write(frame_of_image(np.full((48, 64), i, np.uint8)))
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("suffix", few([".mp4", ".mov", ".mkv"], ".mp4"))
def test_output_of_killed_run_is_rescued(tmp_path, suffix):
    out = tmp_path / f"a{suffix}"
    for _ in range(2):  # the second run must not depend on the first
        subprocess.run([sys.executable, "-c", KILLED, out])
    left = [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    assert len(left) == 1
    assert not out.exists()
    whole = len(images_of(left[0]))
    assert 60 <= whole <= 100  # all but the last second
    with VideoWriter(out, SIZE, 25) as writer:
        writer.write(frame_of_image(np.zeros((48, 64), np.uint8)))
    names = {f"a{suffix}", f"a.rescued{suffix}", f"a.rescued-2{suffix}"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert len(images_of(tmp_path / f"a.rescued-2{suffix}")) == whole
    assert "killed" in writer.notes[0]
    assert stat.S_IMODE((tmp_path / f"a.rescued{suffix}").stat().st_mode) == stat.S_IMODE(
        out.stat().st_mode
    )


def test_unplayable_output_of_killed_run_is_removed(tmp_path):
    (tmp_path / ".a.omnimirror-12345678.mp4").write_bytes(b"nothing")
    with VideoWriter(tmp_path / "a.mp4", SIZE, 25) as writer:
        writer.write(frame_of_image(np.zeros((48, 64), np.uint8)))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    assert writer.notes == []


def test_finished_mp4_is_not_fragmented(clip, tmp_path):
    process_file(clip, tmp_path / "a.mp4")
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.streams.video[0].frames == 50
    boxes, data = [], (tmp_path / "a.mp4").read_bytes()
    while data:
        boxes.append(data[4:8])
        data = data[int.from_bytes(data[:4], "big") :]
    assert boxes == [b"ftyp", b"free", b"mdat", b"moov"]
