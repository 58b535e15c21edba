"""Measure the processor time until the studio displays a misaligned sensor: its tables and the response.

python benchmarks/misaligned_tables.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.apps.studio._camera_tables import camera_model, camera_tables
from omnimirror.base.files import write_text
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose

POSE = MirrorPose(0.7, -0.4, 0.5, 0.8, -0.5)


def sensors() -> dict[str, om.Sensor]:
    """Return sensors of the kinds with different costs."""
    sphere, hyperboloid, equidistant = (
        om.load_sensor(f"paper-{name}") for name in ("spherical", "hyperboloidal", "equidistant")
    )
    misaligned = replace(sphere, mirror_pose=POSE)
    return {
        "sphere, decentred": replace(sphere, mirror_pose=MirrorPose(0.7, -0.4)),
        "sphere, tilted": replace(sphere, mirror_pose=MirrorPose(tilt_x_deg=0.8, tilt_y_deg=-0.5)),
        "sphere, decentred and tilted": misaligned,
        "hyperboloid, decentred and tilted": replace(hyperboloid, mirror_pose=POSE),
        "even polynomial, decentred and tilted": replace(equidistant, mirror_pose=POSE),
        "sphere, decentred and tilted, lens distortion": replace(
            misaligned, lens=replace(sphere.lens, k1=-0.2, p1=1e-3, p2=-1e-3)
        ),
        "sphere, aligned, tilted lens distortion": replace(
            sphere, lens=replace(sphere.lens, k1=-0.2, p1=1e-3)
        ),
        "sphere, decentred and tilted, dome": replace(misaligned, housing=Housing(shell=Dome())),
        "sphere, decentred and tilted, tube": replace(
            misaligned, housing=Housing(shell=Tube(120.0))
        ),
    }


def processor_time_s(sensor: om.Sensor, runs: int) -> float:
    """Return the median processor time with empty caches."""
    times = []
    for _ in range(runs):
        camera_tables.cache_clear()
        camera_model.cache_clear()
        start = time.process_time()
        camera_model("id", "name", "title", (), replace(sensor))
        times.append(time.process_time() - start)
    return float(np.median(times))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    conditions = (
        f"{processor_name()}, {os.cpu_count()} cores, NumPy "
        f"{np.__version__}; medians of {arguments.runs}.{load_warning()}"
    )
    rows = []
    for name, sensor in sensors().items():
        rows.append(f"| {name} | {processor_time_s(sensor, arguments.runs):.2f} |")
        print(rows[-1], flush=True)
    lines = [
        "# Coordinate tables of misaligned sensors",
        "",
        f"`{Path(__file__).name}` on {conditions}",
        "",
        "| sensor | CPU time, s |",
    ]
    write_text(
        arguments.output / "misaligned_tables.md", "\n".join([*lines, "|---|---|", *rows, ""])
    )


if __name__ == "__main__":
    main()
