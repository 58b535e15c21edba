"""Measure design evaluations per second: batch evaluator, `om.evaluate` and the field-curvature analysis of Optiland.

A design is evaluated at 100 field angles at its own best focus: mapping, tangential and sagittal images, blur. All
variants run interleaved in one process; results are medians of wall time and processor time. A batch of 2,000
corresponds to one generation of a global search; the numbers of a batch of 20,000 occupy 160 MB. The analysis of
Optiland returns tangential and sagittal focus only, for fields below 90 deg, without a best focus.

    python benchmarks/design_rate.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from evaluation_time import optiland_system
from measurement_conditions import load_warning, processor_name
from timing import measure_wall_and_cpu

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.optics.batch.evaluate import Designs, evaluate_designs
from omnimirror.optics.batch.families import family

ANGLES, SMALL_BATCH, LARGE_BATCH, RUNS = 100, 2_000, 20_000, 15


def designs(count: int) -> Designs:
    """Return even polynomials of five terms, perturbations of the paper's equidistant mirror."""
    rng = np.random.default_rng(0)
    c = np.array([0.6409, 0.155, -0.01, 0.0, 0.0]) * (1 + 0.05 * rng.standard_normal((count, 5)))
    return Designs(
        family("even-polynomial", 5), c, 172 * rng.uniform(0.95, 1.05, count), 43.9, 11.6, 4.0, 5.2
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    load_note = load_warning()
    small, large = designs(SMALL_BATCH), designs(LARGE_BATCH)
    sensor = om.load_sensor("paper-spherical")
    omega = np.linspace(0, 135, ANGLES)
    functions: dict[str, Callable[[], object]] = {
        "NumPy": lambda: evaluate_designs(small, ANGLES, native=False)
    }
    counts = {"NumPy": SMALL_BATCH}

    def compiled(batch: Designs, threads: int) -> None:
        def run() -> object:
            backend.set_threads(threads)
            return evaluate_designs(batch, ANGLES, native=True)

        name = f"compiled, {backend.name}, {threads} thread{'s' * (threads > 1)}, {len(batch):,} at once"
        functions[name], counts[name] = run, len(batch)

    if backend.is_compiled:
        for batch in (small, large):
            for threads in dict.fromkeys((1, min(4, os.cpu_count() or 1))):
                compiled(batch, threads)
    functions["om.evaluate at best focus"] = lambda: om.evaluate(sensor, omega, focus_mm="auto")
    functions["om.evaluate at the specified focus"] = lambda: om.evaluate(sensor, omega)
    notes = []
    try:
        from optiland.analysis import FieldCurvature
    except ImportError:
        notes = [
            "",
            "Optiland is not installed (`make bench` installs it) and is not included in the comparison.",
        ]
    else:
        warnings.simplefilter("ignore")
        functions["Optiland, system and field curvature to 80 deg"] = lambda: FieldCurvature(
            optiland_system(sensor, 80.0), num_points=ANGLES
        )
    rows = [
        f"| {name} | {1e3 * counts.get(name, 1) / wall:,.0f} | {1e3 * counts.get(name, 1) / cpu:,.0f} |"
        for name, (wall, cpu) in measure_wall_and_cpu(functions, RUNS).items()
    ]
    table = "\n".join(
        [
            f"`design_rate.py` on {processor_name()}, {os.cpu_count()} "
            f"cores, NumPy {np.__version__}; medians of {RUNS} "
            f"interleaved runs.{load_note}",
            "",
            f"| designs of {ANGLES} field angles | designs/s | designs/s per core |",
            "|---|---|---|",
            *rows,
            *notes,
        ]
    )
    print(table)
    write_text(arguments.output / "design_rate.md", table + "\n")


if __name__ == "__main__":
    main()
