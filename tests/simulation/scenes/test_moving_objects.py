"""Moving boxes in a scene: their file, and their projections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.base.native import backend
from omnimirror.io.keyframes import Keyframes
from omnimirror.optics.image_sensor import Imager
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.moving_objects import SceneWithBodies
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


def test_load_bodies(tmp_path):
    (tmp_path / "bodies.toml").write_text(BODIES)
    (tmp_path / "lamp.csv").write_text("time_s,x_mm\n0,-800\n1,-700\n")
    cart, lamp = om.load_bodies(tmp_path / "bodies.toml")
    assert (cart.name, cart.size_mm, cart.colour) == ("cart", (400, 300, 500), "#2e86de")
    assert cart.pose_at(1.0) == om.Pose(1500.0, 450.0, 0.0, pan_deg=45.0)
    assert (lamp.name, lamp.pose_at(5.0).x_mm) == ("lamp", -700.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"bodies\.toml must contain 1 to 1000 bodies; got 0"),
        ("cart = 3", r"bodies\.toml: the body cart must be a table \[cart\]; got 3"),
        ("[cart]\ncolour = '#fff'", r"\[cart\] of .*: size_mm must be"),
        ("[cart]\nsize_mm = [1, 2]\nkeyframe = [{time_s = 0, x_mm = 1}]", r"\[cart\] of .*size_mm"),
        (
            "[cart]\nsize_mm = [1, 2, 0]\nkeyframe = [{time_s = 0, x_mm = 1}]",
            r"\[cart\] of .*bodies\.toml: size_mm\[2\] must be finite and at least 0\.001; got 0",
        ),
        ("[cart]\nsize_mm = [1, 2, 3]", r"\[cart\] of .*bodies\.toml must contain keyframes"),
        ("[cart]\nsize_mm = [1, 2, 3]\nkeyframe = [{time_s = 0, hfov_deg = 1}]", "hfov_deg"),
        (
            "[cart]\nsize_mm = [1, 2, 3]\nkeyframe = [{time_s = 0, x_mm = 1}]\nmass = 3",
            r"\[cart\] of .*bodies\.toml must contain only \[\[keyframe\]\] tables and optionally interpolation",
        ),
        (
            "[cart]\nsize_mm = [1, 2, 3]\ncolour = 'reddish'\nkeyframe = [{time_s = 0, x_mm = 1}]",
            "reddish",
        ),
        (
            "[cart]\nsize_mm = [1, 2, 3]\npath = 'gone.csv'",
            "path must be an existing keyframe file",
        ),
        (
            "[cart]\nsize_mm = [1, 2, 3]\npath = 4",
            r"\[cart\] of .*bodies\.toml: path must be a file name; got 4",
        ),
    ],
)
def test_invalid_bodies_file_raises(tmp_path, text, message):
    (tmp_path / "bodies.toml").write_text(text)
    with pytest.raises(SpecError, match=message):
        om.load_bodies(tmp_path / "bodies.toml")


def test_missing_bodies_raise():
    with pytest.raises(SpecError, match=r"path must be an existing file of bodies"):
        om.load_bodies("nowhere.toml")
    with pytest.raises(InvalidParameter, match=r"tracks of path must be .*; got 'hfov_deg'"):
        om.MovingBox((1.0, 1.0, 1.0), Keyframes({"hfov_deg": ((0.0, 1.0),)}))


def test_video_shows_moving_bodies(tmp_path):
    """Centre of the side facing the sensor, by the projection of the sensor, in every frame;
    reproducible."""
    av = pytest.importorskip("av")
    sphere = om.load_sensor("paper-spherical")
    small = replace(
        sphere, imager=replace(sphere.imager, width_px=128, height_px=128, pixel_pitch_um=5.2 * 8)
    )
    om.save_sensor(small, tmp_path / "small.toml")
    (tmp_path / "path.csv").write_text("time_s,x_mm\n0,0\n2,100\n")
    (tmp_path / "bodies.toml").write_text(BODIES.partition("[lamp]")[0].replace("pan_deg = 90", ""))
    options = (
        "--path",
        tmp_path / "path.csv",
        "--set",
        f"video.bodies={tmp_path / 'bodies.toml'}",
        "--spp",
        "1",
        "--no-blur",
        "--set",
        "video.fps=1",
    )
    for arguments in (
        ("simulate", "dataset", tmp_path / "small.toml", *options, "-o", tmp_path / "set"),
        ("simulate", tmp_path / "small.toml", *options, "-o", tmp_path / "film.mp4"),
        (
            "simulate",
            "dataset",
            "--reproduce",
            tmp_path / "set" / "dataset.json",
            "-o",
            tmp_path / "again",
        ),
    ):
        run = omnimirror(*arguments)
        assert run.returncode == 0, run.stderr
    assert (tmp_path / "again" / "video.mp4").read_bytes() == (
        tmp_path / "set" / "video.mp4"
    ).read_bytes()

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
            assert blue > red + 80, (film.name, number)  # no other object in the room is as blue


BALL = om.load_sensor("paper-spherical")


class Unpainted:
    """Scene that does not declare that it consists of surfaces only."""

    def __init__(self, scene):
        self.radiance, self.distance_mm = scene.radiance, scene.distance_mm


@pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")
@pytest.mark.parametrize("blur", [True, False])
def test_compiled_bodies_match_numpy(blur):
    turns = {"x_mm": ((0.0, 900.0),), "pan_deg": ((0.0, 34.0),), "tilt_deg": ((0.0, 12.0),)}
    lies = {"y_mm": ((0.0, -700.0),), "z_mm": ((0.0, -300.0),)}
    bodies = (
        om.MovingBox((400.0, 300.0, 500.0), Keyframes(turns)),
        om.MovingBox((200.0, 200.0, 200.0), Keyframes(lies), colour="#3388ff"),
    )
    scene, sensor = (
        SceneWithBodies(om.Room(texel_mm=40.0), bodies, 0.0),
        replace(BALL, imager=Imager(256, 256, 20.8)),
    )
    light, expected = (
        expose(sensor, s, samples=4, blur=blur, seed=1) for s in (scene, Unpainted(scene))
    )
    differs = np.abs(light - expected).max(axis=-1)
    assert (differs > 1e-5).sum() <= 3, "but for rays that graze an edge"
    alone = expose(sensor, scene.scene, samples=4, blur=blur, seed=1)
    assert (np.abs(alone - light).max(axis=-1) > 1e-2).sum() > 500, "bodies are in sight"


@pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")
def test_touching_surfaces_are_deterministic():
    """Compiled surfaces reorder their records; regenerated datasets previously had other pixels for
    that reason."""
    cart = om.MovingBox((400.0, 300.0, 500.0), Keyframes({"x_mm": ((0.0, 900.0),)}))
    scene, corners = (
        SceneWithBodies(om.Room(texel_mm=41.5), (cart,), 0.0),
        (np.full(3, -50.0), np.full(3, 50.0)),
    )
    first = scene.surroundings_from(*corners).surfaces.records.copy()
    own = scene.scene.surroundings_from(*corners).surfaces
    before = own.records.copy()
    own.first_hits(np.zeros((1, 3)), np.ones((1, 3)))
    assert (own.records != before).any(), "else there is nothing to hold"
    np.testing.assert_array_equal(scene.surroundings_from(*corners).surfaces.records, first)


def test_rays_starting_in_body():
    around = om.MovingBox((400.0, 300.0, 500.0), Keyframes({"x_mm": ((0.0, 100.0),)}))
    scene = SceneWithBodies(om.Room(texel_mm=40.0), (around,), 0.0)
    corners = np.full(3, -50.0), np.full(3, 50.0)
    assert scene.surroundings_from(*corners) is None
    assert SceneWithBodies(scene.scene).surroundings_from(
        *corners
    ) is scene.scene.surroundings_from(*corners)
    assert SceneWithBodies(Unpainted(scene.scene)).surroundings_from(*corners) is None
