"""Pictures and depths of the same room by Blender and by Newton, which are installed beside the package or not at all.

``make programs`` makes an environment for each; ``OMNIMIRROR_BLENDER`` and ``OMNIMIRROR_NEWTON`` name others.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.mirrors.pose import MirrorPose
from omnimirror.simulate.rendering.exposure import expose
from tests.handoff.rays.box import Box, first_hits
from tests.simulate.rendering.test_mitsuba_pictures import MISALIGNED, compared, grey_levels, small

HERE = Path(__file__).parent


def python_of(program):
    """The Python that has a program, or a skip that says so."""
    python = Path(os.environ.get(f"OMNIMIRROR_{program.upper()}", Path(sys.prefix) / program / "bin" / "python"))
    if not python.exists():
        pytest.skip(f"{program} is not here: make programs")
    return python


def run_in(program, *words):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    run = subprocess.run(
        [python_of(program), HERE / f"in_{program}.py", *map(str, words)],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.full
@pytest.mark.parametrize(("name", "pose"), [("paper-spherical", MirrorPose()), ("paper-equidistant", MISALIGNED)])
def test_blenders_picture_is_ours(name, pose, tmp_path, beside):
    sensor = small(name, 256, pose)
    om.write_rays(sensor, tmp_path / "camera.py", formats="blender")
    run_in("blender", tmp_path / "camera.py", tmp_path / "picture.exr", 64)
    theirs = om.read_image(tmp_path / "picture.exr")[..., :3]
    decibels, shift = compared(sensor, expose(sensor, Box(), samples=16), theirs)
    version = (tmp_path / "version.txt").read_text()
    levels = grey_levels(decibels), grey_levels(55)
    beside("Blender", "pictures by Cycles through our ray table, difference in grey levels, rms", *levels, "", version)
    beside("Blender", "the same, shift of any eighth", shift, 0.02, "px", version)


@pytest.mark.full
def test_newtons_depths_are_ours(tmp_path):
    sensor = small("paper-spherical", 128, MISALIGNED)
    om.write_rays(sensor, tmp_path / "rays.npy", formats="newton")
    run_in("newton", tmp_path / "rays.npy", tmp_path / "depths.npy")
    depths, table = 1000 * np.load(tmp_path / "depths.npy"), om.ray_table(sensor)
    on = table.weights > 0
    origins, directions = table.origins[on], table.directions[on]
    true = np.linalg.norm(first_hits(origins, directions) - origins, axis=-1)
    print(f"{np.abs(depths[on] - true).max():.4f} mm")
    assert np.abs(depths[on] - true).max() < 0.01
    assert not depths[~on].any()
