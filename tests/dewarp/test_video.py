"""Frames of every pixel format, through their planes."""

from fractions import Fraction

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.dewarp.video import dewarp_frame
from omnimirror.errors import InvalidParameter
from omnimirror.media.frames import converted, frame_of_image, planes

SIDE = 240
BALL = om.MirrorBall((119.5, 119.5), 110.0, 250.0, (SIDE, SIDE))
VIEW = om.screens.Plane((160, 120), pan_deg=20.0, tilt_deg=-30.0)
DOME = om.views.dome(BALL, (130, 130))  # whose corners are outside
LIMITED, FULL = 1, 2
FORMATS = ["yuv420p", "nv12", "yuvj420p", "yuvj422p", "yuv422p", "yuv444p", "yuv420p10le", "rgb24"]


def picture():
    """Smooth, with colours all over, and reversed if anything is."""
    v, u = np.mgrid[0:SIDE, 0:SIDE]
    return np.dstack([60 + u // 2, 200 - v // 2, 90 + (u + v) // 5]).astype(np.uint8)


def frame_of(pixel_format, colour_range):
    frame = frame_of_image(picture())
    frame.colorspace, frame.color_range = 1, colour_range
    made = converted(frame, pixel_format)
    made.pts, made.time_base = 77, Fraction(1, 25)
    return made


@pytest.mark.parametrize("colour_range", [LIMITED, FULL])
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_a_frame_of_any_format_shows_what_its_picture_shows(pixel_format, colour_range):
    if pixel_format.startswith("yuvj") and colour_range == LIMITED:
        pytest.skip(f"{pixel_format} is full range by its name")
    frame = frame_of(pixel_format, colour_range)
    made = dewarp_frame(om.Dewarper(BALL, VIEW), frame)
    assert made.format.name == ("nv12" if pixel_format == "nv12" else "yuv420p")
    assert (made.width, made.height) == VIEW.size
    expected = om.Dewarper(BALL, VIEW)(picture()).astype(float)
    taken = made.to_ndarray(format="rgb24")
    assert np.abs(taken - expected).mean() < 2.5  # FFmpeg's two conversions alone are off by 2
    assert np.abs(taken - expected).max() < 12
    assert np.abs(taken[:, ::-1] - expected).mean() > 8


@pytest.mark.parametrize(("pixel_format", "colour_range", "luma"), [
    ("yuv420p", LIMITED, 16), ("yuv420p", FULL, 0), ("yuvj420p", 0, 0), ("yuv420p", 0, 16), ("nv12", FULL, 0),
])  # fmt: skip
def test_outside_the_field_a_frame_is_black_in_its_own_range(pixel_format, colour_range, luma):
    frame = av.VideoFrame(SIDE, SIDE, pixel_format)
    for plane in planes(frame):
        plane[:] = 90
    frame.color_range = colour_range
    made = dewarp_frame(om.Dewarper(BALL, DOME), frame)
    y, *colours = planes(made)
    assert y[0, 0] == luma
    assert y[65, 65] == 90
    assert all((part[0, 0] == 128).all() and (part[32, 32] == 90).all() for part in colours)
    assert (made.color_range == FULL) == (luma == 0)
    assert made.to_ndarray(format="rgb24")[0, 0].max() <= 1


def test_time_and_colour_coding_are_carried_on():
    frame = frame_of("yuv420p", LIMITED)
    frame.pts = 4711
    made = dewarp_frame(om.Dewarper(BALL, VIEW), frame)
    assert (made.pts, made.time_base) == (frame.pts, frame.time_base)
    assert (made.colorspace, made.color_range) == (frame.colorspace, frame.color_range)


def test_a_view_that_moves_and_one_that_stays_show_the_same():
    frame = frame_of("yuv420p", LIMITED)
    stays = om.Dewarper(BALL, VIEW)
    shown = [dewarp_frame(stays, frame) for _ in range(3)] + [dewarp_frame(om.Dewarper(BALL, VIEW), frame)]
    for made in shown[1:]:
        for one, other in zip(planes(made), planes(shown[0]), strict=True):
            assert np.abs(one.astype(int) - other).max() <= 1


def test_a_frame_of_another_size_is_refused():
    with pytest.raises(InvalidParameter, match="are no 4:2:0 picture of 240 x 240 px"):
        dewarp_frame(om.Dewarper(BALL, VIEW), av.VideoFrame(64, 48, "yuv420p"))


def test_colours_lie_where_they_are_said_to():
    """That these places are right is shown of planes by themselves."""
    frame = frame_of("yuvj420p", FULL)
    for sitings in (("left",), ("center",), ("center", "left")):
        made = dewarp_frame(om.Dewarper(BALL, VIEW), frame, *sitings)
        expected = om.Dewarper(BALL, VIEW).planes(planes(frame), None, *sitings, full_range=True)
        for one, other in zip(planes(made), expected, strict=True):
            np.testing.assert_array_equal(one, other)
