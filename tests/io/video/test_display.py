"""Mastering-display metadata of HDR videos."""

import struct
from fractions import Fraction

import av
import numpy as np
import pytest
from av.sidedata.sidedata import Type as SideData

import omnimirror as om
from omnimirror.dewarp.pipelines.video import Listener
from omnimirror.io.processing import process
from omnimirror.io.video.display import Display, dynamic_kinds
from omnimirror.io.video.reader import VideoReader
from omnimirror.io.video.writer import VideoWriter
from tests.commands import omnimirror

GRADED = "master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1):max-cll=1000,400"
P3 = [0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329]
"""Red, green, blue and white of DCI-P3 with D65."""


@pytest.fixture
def graded(tmp_path):
    with av.open(str(tmp_path / "in.mp4"), "w") as container:
        stream = container.add_stream("libx265", rate=25, options={"x265-params": f"{GRADED}:log-level=none"})
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p10le"
        context = stream.codec_context
        context.color_range, context.colorspace, context.color_primaries, context.color_trc = 1, 9, 9, 16
        for i in range(3):
            frame = av.VideoFrame(128, 96, "yuv420p10le")
            for plane in frame.planes:
                np.frombuffer(plane, np.uint16)[:] = 400
            frame.pts = i
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return tmp_path / "in.mp4"


def copied(source, out, codec):
    with VideoReader(source) as reader:
        assert not reader.notes
        writer = VideoWriter.like(reader, out, codec=codec)
        process(reader.items(), writer, lambda frame, time_s: frame, "frame")
    return writer.notes


@pytest.mark.parametrize("codec", ["libx265", "libx264", "libsvtav1"])
def test_it_is_kept(graded, tmp_path, codec):
    assert not copied(graded, tmp_path / "out.mp4", codec)
    with av.open(str(tmp_path / "out.mp4")) as container:
        beside = next(container.decode(video=0)).side_data
        mastering = struct.unpack("22i", bytes(beside.get(SideData.MASTERING_DISPLAY_METADATA)))
        light = struct.unpack("2I", bytes(beside.get(SideData.CONTENT_LIGHT_LEVEL)))
    values = np.array(mastering[:20:2]) / np.array(mastering[1:20:2])
    np.testing.assert_allclose(values[:8], P3, atol=2e-5)
    np.testing.assert_allclose(values[8:], [1e-4, 1000], rtol=0.3)  # AV1 stores the minimum in units of 1/16384
    assert light == (1000, 400)


def test_what_cannot_be_kept_is_said(graded, tmp_path):
    assert "the display that it was graded on is lost" in copied(graded, tmp_path / "out.mkv", "ffv1")[0]
    ball = ["--ball", "63.5,47.5,40,260", "--view", "perspective", "--size", "64x48"]
    run = omnimirror("dewarp", graded, *ball, "-o", tmp_path / "%d.png")
    assert "%d.png: what it tells of the display that it was graded on is lost" in run.stderr
    beside = {SideData.DYNAMIC_HDR_PLUS: object(), SideData.DOVI_METADATA: object(), SideData.DOVI_RPU_BUFFER: 1}
    assert dynamic_kinds(beside) == "HDR10+ and Dolby Vision"
    assert not dynamic_kinds({SideData.CONTENT_LIGHT_LEVEL: object()})


@pytest.mark.parametrize("pixel_format", [None, "yuv420p10le"])
def test_a_stream_keeps_what_it_tells_of_colours_and_display(graded, tmp_path, pixel_format):
    """A file given by its URL is read as a stream."""
    notes = []
    om.dewarp_video(
        graded.as_uri(), tmp_path / "out.mp4", camera=om.MirrorBall((63.5, 47.5), 40.0, 260.0, (128, 96)),
        view=om.screens.Plane((64, 48), tilt_deg=-30.0), listener=Listener(note=notes.append),
        recording=om.Recording(duration_s=0.01, pixel_format=pixel_format),
    )  # fmt: skip
    with av.open(str(tmp_path / "out.mp4")) as container:
        frame = next(container.decode(video=0))
    assert (frame.color_trc, frame.color_primaries, frame.colorspace) == (16, 9, 9)
    assert struct.unpack("2I", bytes(frame.side_data.get(SideData.CONTENT_LIGHT_LEVEL))) == (1000, 400)
    assert any("HDR, and 8 bits of it show steps" in note for note in notes) == (pixel_format is None)


def test_half_of_it_is_told_where_it_can_be():
    assert Display(light=(1000, 400)).options("libx264") == "cll=1000,400"
    assert Display(primaries=(Fraction(1, 3),) * 8).options("libx265") is None
    assert Display().options("libx265") == ""
