"""Measure Monte Carlo trials per second: random errors, ray tracing, blur and five calibrations per sensor.

Errors are decentre, displacement and tilt of the mirror and twelve Zernike terms; 97 objects, exact image motion,
tangential and sagittal blur, focus for minimum RMS. The kernel on one and two threads and the NumPy implementation run
interleaved in one process; results are medians.

    python benchmarks/tolerance_rate.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.manufacturing.tolerancing.compensation import POSE
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator

SENSORS = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant", "exact-equidistant")
TRIALS, NUMPY_TRIALS, RUNS = 8192, 256, 9
ERRORS = {name: om.Tolerance(0.1) for name in POSE}
ERRORS |= {f"mirror.zernike_{j}_um": om.Tolerance(1.0) for j in range(4, 16)}


def functions_of(name: str) -> dict[str, Callable[[], object]]:
    """Return evaluations of trials of a sensor: compiled by number of threads, and in NumPy."""
    sensor = om.load_sensor(name)
    evaluator, tolerances = TrialEvaluator.of(sensor, "rms"), om.Tolerances(sensor, ERRORS)

    def compiled(threads: int) -> Callable[[], object]:
        def run() -> object:
            backend.set_threads(threads)
            return evaluator.evaluate(tolerances.drawn(0, 0, TRIALS))

        return run

    def in_numpy() -> object:
        with mock.patch.object(backend, "module", None):
            return evaluator.evaluate(tolerances.drawn(0, 0, NUMPY_TRIALS))

    return {"1": compiled(1), "2": compiled(2), "NumPy": in_numpy}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    rows = []
    for name in SENSORS:
        medians = measure_interleaved(functions_of(name), RUNS)
        one, two, numpy = (
            1e3 * TRIALS / medians["1"],
            1e3 * TRIALS / medians["2"],
            1e3 * NUMPY_TRIALS / medians["NumPy"],
        )
        rows.append(f"| {name} | {one:,.0f} | {two:,.0f} | {numpy:,.0f} |")
    cores = os.cpu_count() or 1
    table = "\n".join(
        [
            f"Medians of {RUNS} interleaved runs, Python {platform.python_version()}, NumPy {np.__version__}, {cores} "
            f"cores, {backend.name}. Trials per second, including drawing: 17 errors, 97 objects, five calibrations.",
            "",
            "| sensor | one thread | two threads | NumPy |",
            "|---|---:|---:|---:|",
            *rows,
        ]
    )
    print(table)
    write_text(arguments.output / "tolerance_rate.md", table + "\n")


if __name__ == "__main__":
    main()
