"""Frames of all pixel formats, processed by planes."""

from fractions import Fraction

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.video_files import dewarp_frame
from omnimirror.io.video_frames import converted, frame_of_image, planes

SIDE = 240
BALL = om.MirrorBall(
    centre_px=(119.5, 119.5), rim_radius_px=110.0, field_deg=250.0, image_size=(SIDE, SIDE)
)
VIEW = om.screens.Plane((160, 120), pan_deg=20.0, tilt_deg=-30.0)
DOME = om.views.dome(BALL, (130, 130))  # with corners outside the field
LIMITED, FULL = 1, 2
FORMATS = ["yuv420p", "nv12", "yuvj420p", "yuvj422p", "yuv422p", "yuv444p", "yuv420p10le", "rgb24"]
FORMATS += ["yuv422p10le", "yuva444p12le", "gbrp10le", "yuv411p"]
OUTPUT_FORMATS = {
    "yuvj420p": "yuv420p",
    "yuvj422p": "yuv422p",
    "rgb24": "yuv444p",
    "gbrp10le": "yuv444p10le",
    "yuv411p": "yuv422p",
}


def image():
    """A smooth image with varied colours, sensitive to reversal."""
    v, u = np.mgrid[0:SIDE, 0:SIDE]
    return np.dstack([60 + u // 2, 200 - v // 2, 90 + (u + v) // 5]).astype(np.uint8)


def frame_of(pixel_format, colour_range):
    frame = frame_of_image(image())
    frame.colorspace, frame.color_range = 1, colour_range
    output = converted(frame, pixel_format)
    output.pts, output.time_base = 77, Fraction(1, 25)
    return output


@pytest.mark.parametrize("colour_range", [LIMITED, FULL])
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_frame_formats_match_image(pixel_format, colour_range):
    if pixel_format.startswith("yuvj") and colour_range == LIMITED:
        pytest.skip(f"{pixel_format} is full range by its name")
    frame = frame_of(pixel_format, colour_range)
    output = dewarp_frame(om.Dewarper(BALL, VIEW), frame)
    assert output.format.name == OUTPUT_FORMATS.get(pixel_format, pixel_format)
    assert (output.width, output.height) == VIEW.size
    expected = om.Dewarper(BALL, VIEW)(image()).astype(float)
    rgb = output.to_ndarray(format="rgb24")
    assert np.abs(rgb - expected).mean() < 2.5  # two conversions of FFmpeg alone differ by 2
    assert np.abs(rgb - expected).max() < 12
    assert np.abs(rgb[:, ::-1] - expected).mean() > 8


@pytest.mark.parametrize(
    ("pixel_format", "colour_range", "luma"),
    [
        ("yuv420p", LIMITED, 16),
        ("yuv420p", FULL, 0),
        ("yuvj420p", 0, 0),
        ("yuv420p", 0, 16),
        ("nv12", FULL, 0),
    ],
)
def test_frame_is_black_outside_field(pixel_format, colour_range, luma):
    frame = av.VideoFrame(SIDE, SIDE, pixel_format)
    for plane in planes(frame):
        plane[:] = 90
    frame.color_range = colour_range
    output = dewarp_frame(om.Dewarper(BALL, DOME), frame)
    y, *colours = planes(output)
    assert y[0, 0] == luma
    assert y[65, 65] == 90
    assert all((part[0, 0] == 128).all() and (part[32, 32] == 90).all() for part in colours)
    assert (output.color_range == FULL) == (luma == 0)
    assert output.to_ndarray(format="rgb24")[0, 0].max() <= 1


def test_frame_time_and_colour_coding_are_preserved():
    frame = frame_of("yuv420p", LIMITED)
    frame.pts = 4711
    output = dewarp_frame(om.Dewarper(BALL, VIEW), frame)
    assert (output.pts, output.time_base) == (frame.pts, frame.time_base)
    assert (output.colorspace, output.color_range) == (frame.colorspace, frame.color_range)


def test_moving_and_fixed_views_match():
    frame = frame_of("yuv420p", LIMITED)
    fixed = om.Dewarper(BALL, VIEW)
    outputs = [dewarp_frame(fixed, frame) for _ in range(3)] + [
        dewarp_frame(om.Dewarper(BALL, VIEW), frame)
    ]
    for output in outputs[1:]:
        for one, other in zip(planes(output), planes(outputs[0]), strict=True):
            assert np.abs(one.astype(int) - other).max() <= 1


def test_frame_size_mismatch_raises():
    with pytest.raises(InvalidParameter, match=r"planes must have the shapes .* for 240 x 240 px"):
        dewarp_frame(om.Dewarper(BALL, VIEW), av.VideoFrame(64, 48, "yuv420p"))


def test_chroma_siting():
    """Correctness of these positions is tested for single planes."""
    frame = frame_of("yuvj420p", FULL)
    for sitings in (("left",), ("center",), ("center", "left")):
        output = dewarp_frame(om.Dewarper(BALL, VIEW), frame, *sitings)
        expected = om.Dewarper(BALL, VIEW).planes(planes(frame), None, *sitings, full_range=True)
        for one, other in zip(planes(output), expected, strict=True):
            np.testing.assert_array_equal(one, other)


def edge(colours, side=SIDE):
    """Return a 12-bit frame with luma and chroma edges at the same position, and a transparent left
    half."""
    across, down = {"422": (side // 2, side), "444": (side, side)}[colours]
    frame = av.VideoFrame(side, side, f"yuva{colours}p12le")
    for plane, (width, height) in zip(
        planes(frame), [(side, side), *[(across, down)] * 2, (side, side)], strict=True
    ):
        plane[:] = np.where(np.arange(width) < width // 2, 1000, 3000)[None]
        assert plane.shape == (height, width)
    return frame


@pytest.mark.parametrize("colours", ["422", "444"])
@pytest.mark.parametrize("to_siting", ["left", "center"])
def test_chroma_and_alpha_align_with_luma(colours, to_siting):
    """Planes of equal content yield planes of equal content, and pixels outside the field are
    transparent."""
    dewarp = om.Dewarper(BALL, DOME)
    y, u, v, opaque = planes(dewarp_frame(dewarp, edge(colours), "left", to_siting))
    inside = dewarp.valid
    np.testing.assert_array_equal(u, v)
    np.testing.assert_array_equal(opaque[inside], y[inside])
    assert (opaque[~inside] == 0).all()
    if colours == "444":
        np.testing.assert_array_equal(u[inside], y[inside])
        return
    # mean luma at a chroma position: on every second column, or between two
    luma = y.astype(float)
    expected = luma[:, ::2] if to_siting == "left" else (luma[:, ::2] + luma[:, 1::2]) / 2
    middle = (slice(40, 90), slice(20, 45))
    error = u[middle] - expected[middle]
    assert np.abs(error).mean() < 40
    assert abs(error.mean()) < 12  # of 2000 values: no subpixel shift


def test_colour_border_is_opaque():
    output = dewarp_frame(om.Dewarper(BALL, DOME, border=(500, 600, 700)), edge("444"))
    assert [int(plane[0, 0]) for plane in planes(output)] == [500, 600, 700, 4095]
