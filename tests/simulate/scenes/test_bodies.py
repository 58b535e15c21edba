"""Boxes that move in a scene: what their file says, and where a sensor sees them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter, SpecError
from omnimirror.media.keyframes import Keyframes
from tests.commands import omnimirror

BODIES = """
[cart]
size_mm = [400, 300, 500]
colour = "#2e86de"
interpolation = "linear"

[[cart.keyframe]]
time_s = 0
x_mm = 1500
y_mm = 0

[[cart.keyframe]]
time_s = 2
y_mm = 900
pan_deg = 90

[lamp]
size_mm = [200, 200, 900]
path = "lamp.csv"
"""


def test_a_file_of_bodies_says_what_python_does(tmp_path):
    (tmp_path / "bodies.toml").write_text(BODIES)
    (tmp_path / "lamp.csv").write_text("time_s,x_mm\n0,-800\n1,-700\n")
    cart, lamp = om.load_bodies(tmp_path / "bodies.toml")
    assert (cart.name, cart.size_mm, cart.colour) == ("cart", (400, 300, 500), "#2e86de")
    assert cart.pose_at(1.0) == om.Pose(1500.0, 450.0, 0.0, pan_deg=90.0)
    assert (lamp.name, lamp.pose_at(5.0).x_mm) == ("lamp", -700.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "holds 0 bodies"),
        ("cart = 3", "cart = 3 is no body"),
        ("[cart]\ncolour = '#fff'", r"\[cart\] of .* has no size_mm"),
        ("[cart]\nsize_mm = [1, 2]\nkeyframe = [{time_s = 0, x_mm = 1}]", r"\[cart\] of .*size_mm"),
        ("[cart]\nsize_mm = [1, 2, 0]\nkeyframe = [{time_s = 0, x_mm = 1}]", r"\[cart\] of .*size_mm\[2\] = 0"),
        ("[cart]\nsize_mm = [1, 2, 3]", r"\[cart\] of .* holds no keyframes"),
        ("[cart]\nsize_mm = [1, 2, 3]\nkeyframe = [{time_s = 0, hfov_deg = 1}]", "hfov_deg"),
        ("[cart]\nsize_mm = [1, 2, 3]\nkeyframe = [{time_s = 0, x_mm = 1}]\nmass = 3", "and nothing else"),
        ("[cart]\nsize_mm = [1, 2, 3]\ncolour = 'reddish'\nkeyframe = [{time_s = 0, x_mm = 1}]", "reddish"),
        ("[cart]\nsize_mm = [1, 2, 3]\npath = 'gone.csv'", "there are no keyframes"),
        ("[cart]\nsize_mm = [1, 2, 3]\npath = 4", r"\[cart\] of .*path = 4"),
    ],
)
def test_a_wrong_file_is_refused_with_the_body_s_name(tmp_path, text, says):
    (tmp_path / "bodies.toml").write_text(text)
    with pytest.raises(SpecError, match=says):
        om.load_bodies(tmp_path / "bodies.toml")


def test_bodies_that_are_not_there():
    with pytest.raises(SpecError, match=r"there are no bodies 'nowhere\.toml'"):
        om.load_bodies("nowhere.toml")
    with pytest.raises(InvalidParameter, match="path has 'hfov_deg'"):
        om.MovingBox((1.0, 1.0, 1.0), Keyframes({"hfov_deg": ((0.0, 1.0),)}))


def test_a_video_shows_bodies_where_they_are(tmp_path):
    """The middle of the side that faces the sensor, by the sensor's own projection, in every frame; and again."""
    av = pytest.importorskip("av")
    sphere = om.load_sensor("paper-spherical")
    small = replace(sphere, imager=replace(sphere.imager, width_px=128, height_px=128, pixel_pitch_um=5.2 * 8))
    om.save_sensor(small, tmp_path / "small.toml")
    (tmp_path / "path.csv").write_text("time_s,x_mm\n0,0\n2,100\n")
    (tmp_path / "bodies.toml").write_text(BODIES.partition("[lamp]")[0].replace("pan_deg = 90", ""))
    asked = (
        "--path",
        tmp_path / "path.csv",
        "--bodies",
        tmp_path / "bodies.toml",
        "--spp",
        "1",
        "--no-blur",
        "--fps",
        "1",
    )
    for words in (
        ("simulate", "dataset", tmp_path / "small.toml", *asked, "-o", tmp_path / "set"),
        ("simulate", tmp_path / "small.toml", *asked, "-o", tmp_path / "film.mp4"),
        ("simulate", "dataset", "--again", tmp_path / "set" / "dataset.json", "-o", tmp_path / "again"),
    ):
        run = omnimirror(*words)
        assert run.returncode == 0, run.stderr
    assert (tmp_path / "again" / "video.mp4").read_bytes() == (tmp_path / "set" / "video.mp4").read_bytes()

    (cart,), path = om.load_bodies(tmp_path / "bodies.toml"), om.load_path(tmp_path / "path.csv")
    for film in (tmp_path / "set" / "video.mp4", tmp_path / "film.mp4"):
        with av.open(str(film)) as container:
            frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert len(frames) == 3
        for number, frame in enumerate(frames):
            middle = cart.pose_at(number).to_scene(np.array([[-200.0, 0.0, 0.0]]))
            (pixel,), _ = small.project(om.Pose(**path.at(number)).to_sensor(middle))
            u, v = np.round(pixel).astype(int)
            red, _, blue = frame[v, u].astype(int)
            assert blue > red + 80, (film.name, number)  # nothing else in the room is as blue
