"""Dewarping requests: camera and view of an image size, tilt, panorama metadata and encoder settings."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp.request import DewarpRequest, VideoSettings, is_video, without_tilt
from omnimirror.io import GPano

TILTED = om.Unified(
    xi=0.9,
    focal_px=(55.0, 55.0),
    centre_px=(63.5, 63.5),
    image_size=(128, 128),
    mount=Mount(pitch_deg=20.0, roll_deg=5.0, forward_azimuth_deg=30.0),
)
BALL = om.MirrorBall(
    centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=280.0, image_size=(64, 64)
)


class Bare:
    """Camera without a mount."""

    image_size = (4, 4)
    project = project_directions = backproject = None


def test_request_has_the_documented_defaults():
    request = DewarpRequest(BALL)
    assert request.view is om.views.panorama
    assert (request.interpolation, request.viewpoint, request.border) == ("auto", "exact", None)
    assert (request.keep_tilt, request.stored_orientation) == (False, False)
    view = request.view_of(BALL)
    assert view == om.views.panorama(BALL)
    assert DewarpRequest(BALL, view).view_of(TILTED) is view
    plane = om.screens.Plane((6, 4), hfov_deg=40.0)
    dewarper = request.dewarper(BALL, plane, 7)
    assert dewarper(np.full((64, 64), 9, np.uint8)).shape == (4, 6)
    assert (dewarper.keep_map, request.dewarper(BALL, plane, 7, True).keep_map) == (False, True)


def test_camera_of_an_image_size():
    sizes = []

    def camera(size):
        sizes.append(size)
        return replace(BALL, image_size=size)

    assert DewarpRequest(camera).camera_of((200, 100)).image_size == (200, 100)
    assert sizes == [(200, 100)]
    assert DewarpRequest(BALL).camera_of((200, 100)) is BALL
    with pytest.raises(InvalidParameter, match=r"the result of camera\(size\) must be a camera"):
        DewarpRequest(lambda size: size).camera_of((2, 1))


def test_view_with_residual_tilt_removes_it_from_camera():
    assert DewarpRequest(TILTED).view_camera(TILTED) is TILTED
    level = DewarpRequest(TILTED, keep_tilt=True).view_camera(TILTED)
    assert level == replace(TILTED, mount=Mount(forward_azimuth_deg=30.0))
    with pytest.raises(
        InvalidParameter, match=r"must have a mount to keep its tilt; got a Bare without$"
    ):
        without_tilt(Bare())


SPHERE = om.screens.Equirectangular((90, 40), -40.0, 20.0, pan_deg=90.0, span_deg=180.0)


def test_panorama_metadata_contain_residual_tilt():
    """Panned by 90 deg, the pitch of the camera is the roll of the panorama."""
    size, elevation = (90, 40), (-40.0, 20.0)
    plain = GPano.of_view(size, elevation, 180.0)
    assert (plain.pitch_deg, plain.roll_deg) == (0.0, 0.0)
    assert DewarpRequest(TILTED).panorama_of(TILTED, SPHERE) == plain
    assert DewarpRequest(TILTED, keep_tilt=True).panorama_of(Bare(), SPHERE) == plain
    metadata = DewarpRequest(TILTED, keep_tilt=True).panorama_of(TILTED, SPHERE)
    pitch, roll = TILTED.mount.view_tilt_deg(90.0)
    assert metadata == GPano.of_view(size, elevation, 180.0, tilt_deg=(pitch, roll))
    assert roll == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize(
    ("view", "is_panorama"),
    [
        (SPHERE, True),
        (replace(SPHERE, distance_mm=900.0), False),
        (om.screens.Cylinder((90, 40), -40.0, 20.0, rows="tilt"), True),
        (om.screens.Cylinder((90, 40), -40.0, 20.0, rows="height"), False),
        (om.screens.Cylinder((90, 40), -40.0, 20.0, rows="tilt", distance_mm=900.0), False),
        (om.screens.Plane((60, 40), hfov_deg=80.0), False),
    ],
)
def test_distant_panoramas_linear_in_tilt_have_metadata(view, is_panorama):
    assert (DewarpRequest(BALL).panorama_of(BALL, view) is not None) == is_panorama


def test_encoder_settings_are_those_specified():
    assert VideoSettings().encoding() == {}
    assert (VideoSettings().preview, VideoSettings().skip_existing) == (False, False)
    settings = VideoSettings(codec="h264", crf=0, pixel_format="yuv420p", start_s=1.0)
    assert settings.encoding() == {"codec": "h264", "crf": 0, "pixel_format": "yuv420p"}
    raw = replace(settings, pipe_format="rawvideo")  # the format of the pixels is that of the pipe
    assert raw.encoding() == {"codec": "h264", "crf": 0}
    assert replace(settings, pipe_format="y4m").encoding() == settings.encoding()


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("room.mp4", True),
        ("room.MOV", True),
        ("-", True),
        ("0", True),
        ("12", True),
        ("1a", False),
        ("²", False),  # a digit, but no number
        ("", False),
        ("/dev/video0", True),
        ("dev/video0", False),
        ("http://camera/stream", True),
        ("frame%04d.png", True),
        ("frame.png", False),
    ],
)
def test_sources_of_videos(source, expected):
    assert is_video(source) is expected
