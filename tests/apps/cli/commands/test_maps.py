"""Command ``omnimirror maps``."""

from __future__ import annotations

import numpy as np

import omnimirror as om
from tests.commands import fails, omnimirror

VIEW = ["--view", "perspective", "--size", "160x120"]


def test_formats_in_a_folder(tmp_path):
    run = omnimirror(
        "maps", "paper-spherical", *VIEW, "-o", tmp_path, "--format", "opencv,ffmpeg,vpi,glsl"
    )
    assert run.returncode == 0, run.stderr
    names = {"opencv.npz", "ffmpeg-x.pgm", "ffmpeg-y.pgm", "vpi.npy", "glsl.frag", "glsl-map.bin"}
    assert {p.name for p in tmp_path.iterdir()} == {f"paper-spherical-{name}" for name in names}
    assert "px: nearest-neighbour sampling" in run.stdout
    sensor = om.load_sensor("paper-spherical")
    coordinates = om.Dewarper(sensor, om.screens.Plane((160, 120))).coordinates()
    assert np.abs(np.load(tmp_path / "paper-spherical-vpi.npy") - coordinates).max() < 1e-4


def test_viewpoint_and_distance_options(tmp_path):
    near = [*VIEW, "--distance-mm", "400", "-o"]
    omnimirror("maps", "paper-spherical", *near, tmp_path / "exact.npy")
    omnimirror(
        "maps", "paper-spherical", *near, tmp_path / "single.npy", "--set", "view.viewpoint=single"
    )
    exact, single = (np.load(tmp_path / f"{name}.npy") for name in ("exact", "single"))
    assert np.abs(exact - single).max() > 0.5


def test_invalid_arguments(tmp_path):
    assert "formats must be given for the folder" in fails(
        "maps", "paper-spherical", *VIEW, "-o", tmp_path
    )
    assert "got 'nuke'" in fails(
        "maps", "paper-spherical", *VIEW, "-o", tmp_path, "--format", "nuke"
    )
    sky = ["--view", "perspective", "--tilt-deg", "89", "--hfov-deg", "10"]
    assert "must overlap the field of the camera" in fails(
        "maps", "paper-spherical", *sky, "-o", tmp_path / "a.npz"
    )
    assert not list(tmp_path.iterdir())
