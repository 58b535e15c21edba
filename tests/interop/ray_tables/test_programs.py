"""Images and depths of a room by Blender and by Newton, each in a separate environment.

``make programs`` creates the environments, for Blender of the oldest and the newest supported release;
``OMNIMIRROR_BLENDER``, ``OMNIMIRROR_BLENDER_OLDEST`` and ``OMNIMIRROR_NEWTON`` name other interpreters.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.rendering import expose
from tests.interop.documentation import unmarked_code
from tests.interop.ray_tables.box import Box, first_hits
from tests.simulation.test_mitsuba_images import MISALIGNED, compare_images, grey_levels, small

HERE = Path(__file__).parent


def python_of(program):
    """Return the interpreter of a program, or skip the test."""
    variable = f"OMNIMIRROR_{program.upper().replace('-', '_')}"
    python = Path(os.environ.get(variable, Path(sys.prefix) / program / "bin" / "python"))
    if not python.exists():
        pytest.skip(f"{program} is not installed: make programs")
    return python


def run_in(program, *arguments):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    run = subprocess.run(
        [python_of(program), HERE / f"in_{program.partition('-')[0]}.py", *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.full
@pytest.mark.parametrize("blender", ["blender", "blender-oldest"])
@pytest.mark.parametrize(
    ("name", "pose"), [("paper-spherical", MirrorPose()), ("paper-equidistant", MISALIGNED)]
)
def test_blender_image(name, pose, blender, tmp_path, beside):
    sensor = small(name, 256, pose)
    om.write_rays(sensor, tmp_path / "camera.py", formats="blender")
    run_in(blender, tmp_path / "camera.py", tmp_path / "image.exr", 64)
    reference = om.read_image(tmp_path / "image.exr")[..., :3]
    decibels, shift = compare_images(sensor, expose(sensor, Box(), samples=16), reference)
    version = (tmp_path / "version.txt").read_text()
    levels = grey_levels(decibels), grey_levels(55)
    beside(
        "Blender",
        "images by Cycles with the exported ray table, RMS difference in grey levels",
        *levels,
        "",
        version,
    )
    beside("Blender", "maximum image shift in any of eight sectors", shift, 0.02, "px", version)


@pytest.mark.full
def test_newton_depths(tmp_path, beside):
    sensor = small("paper-spherical", 128, MISALIGNED)
    om.write_rays(sensor, tmp_path / "rays.npy", formats="newton")
    (tmp_path / "code.py").write_text(unmarked_code("Newton", "##"))
    run_in("newton", tmp_path / "rays.npy", tmp_path / "depths.npy", tmp_path / "code.py")
    depths, table = 1000 * np.load(tmp_path / "depths.npy"), om.ray_table(sensor)
    on = table.weights > 0
    origins, directions = table.origins[on], table.directions[on]
    true = np.linalg.norm(first_hits(origins, directions) - origins, axis=-1)
    error = np.abs(depths[on] - true).max()
    version = (tmp_path / "version.txt").read_text()
    beside("Newton", "depths along exported rays in a room", error, 0.01, "mm", version)
    assert not depths[~on].any()
