"""Interlaced videos: frames with lines of two instants."""

from fractions import Fraction

import av
import numpy as np
import pytest
from av.filter import Graph

from omnimirror.io.video.frames import planes
from omnimirror.io.video.reader import VideoReader

WIDTH, HEIGHT, COUNT, STEP = 64, 48, 6, 4


def bar(field: int) -> np.ndarray:
    """Return a bar that moves with every field."""
    x = np.arange(WIDTH) - 8 - STEP * field
    return np.where((x >= 0) & (x < 8), 200, 50)


def marked(frames, mode):
    """Set the field order of frames."""
    graph = Graph()
    source = graph.add_buffer(width=WIDTH, height=HEIGHT, format="yuv420p", time_base=Fraction(1, 25))
    setfield, sink = graph.add("setfield", mode), graph.add("buffersink")
    source.link_to(setfield)
    setfield.link_to(sink)
    graph.configure()
    for frame in frames:
        graph.push(frame)
        yield graph.pull()


def make(path, mode):
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
        for frame in marked(frames(), mode):
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def places(frame) -> np.ndarray:
    """Return the bar position in each line."""
    light = planes(frame)[0].astype(float) - 50
    return (light * np.arange(WIDTH)).sum(axis=1) / light.sum(axis=1)


@pytest.mark.parametrize("mode", ["tff", "bff"])
def test_each_picture_shows_one_moment(tmp_path, mode):
    with VideoReader(make(tmp_path / "a.mp4", mode)) as reader:
        assert "is interlaced" in reader.notes[0]
        frames = list(reader.frames())
    assert [frame.time for frame in frames] == pytest.approx([i / 25 for i in range(COUNT)])
    for i, frame in enumerate(frames[1:-1], 1):  # neighbours are missing at the ends
        np.testing.assert_allclose(places(frame), 11.5 + 2 * STEP * i, atol=0.5)
        assert not frame.interlaced_frame


def test_a_part_of_it_begins_and_ends_where_it_should(tmp_path):
    with VideoReader(make(tmp_path / "a.mp4", "bff"), 0.08, 0.08) as reader:
        frames = list(reader.frames())
    assert [frame.time for frame in frames] == pytest.approx([0, 0.04])
    np.testing.assert_allclose(np.median(places(frames[0])), 11.5 + 2 * STEP * 2, atol=0.5)


def test_pictures_that_are_whole_are_left_alone(tmp_path):
    """Including combing patterns without an interlace flag."""
    with VideoReader(make(tmp_path / "a.mp4", "prog")) as reader:
        assert reader.notes == []
        frame = list(reader.frames())[2]
    assert np.ptp(places(frame)) > STEP - 1
