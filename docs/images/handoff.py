"""The pictures of docs/handoff.md: what programs make of the files that are handed to them, beside ours.

python docs/images/handoff.py --blender .venv/blender/bin/python
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import omnimirror as om
from omnimirror.simulate.colour import srgb_bytes
from omnimirror.simulate.rendering.exposure import expose

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))


def blender(python: Path, pixels: int = 480) -> None:
    """The box of the tests by the paper's sensor out of line: ours, and Blender's."""
    from tests.handoff.rays.box import Box
    from tests.simulate.rendering.test_mitsuba_pictures import MISALIGNED, small

    sensor = small("paper-spherical", pixels, MISALIGNED)
    with tempfile.TemporaryDirectory() as folder:
        script, picture = Path(folder, "camera.py"), Path(folder, "picture.exr")
        om.write_rays(sensor, script, formats="blender")
        program = ROOT / "tests" / "handoff" / "rays" / "in_blender.py"
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run([python, program, script, picture, "64"], check=True, env=environment)
        theirs = om.read_image(picture)[..., :3]
    both = [srgb_bytes(light) for light in (expose(sensor, Box(), samples=16), theirs)]
    om.write_image(HERE / "handoff-blender.jpg", np.hstack([both[0], np.full((pixels, 16, 3), 255, np.uint8), both[1]]))


def maps(left: int = 150, top: int = 60, size: tuple[int, int] = (80, 110), times: int = 3) -> None:
    """A corner of a view: ours, bicubic and linear, then in C, by the shader, by GStreamer and by ffmpeg."""
    from tests.handoff.maps import consumers

    sensor = om.load_sensor("paper-spherical")
    picture = om.take_picture(sensor, om.Room(), samples=4, low_pass=True)
    view = om.screens.Plane((320, 240), pan_deg=60.0, hfov_deg=60.0)
    ours = [om.Dewarper(sensor, view, how)(picture) for how in ("auto", "linear")]
    with tempfile.TemporaryDirectory() as folder:
        theirs = [program(sensor, view, picture, Path(folder)) for program in consumers.PROGRAMS]
    crops = [v[top : top + size[1], left : left + size[0]].repeat(times, 0).repeat(times, 1) for v in (*ours, *theirs)]
    gap = np.full((crops[0].shape[0], 8, 3), 255, np.uint8)
    om.write_image(HERE / "handoff-maps.jpg", np.hstack([part for crop in crops for part in (crop, gap)][:-1]))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--blender", type=Path, default=Path(sys.prefix) / "blender" / "bin" / "python")
    blender(options.parse_args().blender)
    maps()
