"""Measure the cost of a real lens and a dome in batches of designs and in one evaluation of 100 field angles.

The lens is a triplet of six surfaces with a moving entrance pupil and its own aberrations; the dome is made of acrylic.
Each design is evaluated at 100 field angles at its own best focus: mapping, tangential and sagittal images, blur. All
variants run interleaved in one process; results are medians of wall time and processor time.

    python benchmarks/real_lens_rate.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measurement_conditions import load_warning, processor_name
from timing import measure_wall_and_cpu

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.optics.batch.evaluate import Designs, evaluate_designs
from omnimirror.optics.batch.families import family
from omnimirror.optics.housing import Dome, Housing
from omnimirror.optics.lenses import SurfaceLens

ANGLES, DESIGNS, RUNS = 100, 8000, 7
TRIPLET = SurfaceLens(
    f_number=4.0,
    focus_distance_mm=212.0,
    curvature_per_mm=(0.195804, -0.009892, -0.194044, 0.212417, 0.054093, -0.234317),
    thickness_mm=(0.756079, 1.393752, 0.231993, 1.102095, 0.684883, 0.0),
    index=(1.62041, 1.0, 1.62004, 1.0, 1.62041, 1.0),
    stop_surface=4,
    field_max_deg=21.0,
)
DOME = Housing(shell=Dome(material="acrylic"))
VARIANTS: dict[str, dict[str, Any]] = {
    "ideal lens, bare mirror": {},
    "ideal lens, dome": {"housing": DOME},
    "triplet, bare mirror": {"lens": TRIPLET},
    "triplet and dome": {"lens": TRIPLET, "housing": DOME},
}


def designs(count: int, **variant: Any) -> Designs:
    """Return even polynomials of five terms, perturbations of the paper's equidistant mirror."""
    rng = np.random.default_rng(0)
    c = np.array([0.6409, 0.155, -0.01, 0.0, 0.0]) * (1 + 0.05 * rng.standard_normal((count, 5)))
    m = 172 * rng.uniform(0.95, 1.05, count)
    return Designs(family("even-polynomial", 5), c, m, 43.9, 11.6, 4.0, 5.2, **variant)


def batches() -> tuple[dict[str, Callable[[], object]], dict[str, int]]:
    """Return batches by label, and the number of designs in each."""
    functions, counts = dict[str, Callable[[], object]](), dict[str, int]()

    def with_threads(batch: Designs, count: int) -> Callable[[], object]:
        def run() -> object:
            backend.set_threads(count)
            return evaluate_designs(batch, ANGLES, native=True)

        return run

    for name, variant in VARIANTS.items():
        if backend.is_compiled:
            batch = designs(DESIGNS, **variant)
            for count in dict.fromkeys((1, min(2, os.cpu_count() or 1))):
                functions[f"{name} | {count}"] = with_threads(batch, count)
                counts[f"{name} | {count}"] = DESIGNS
    numpy_batch = designs(256, **VARIANTS["triplet and dome"])
    functions["triplet and dome, NumPy | 1"] = lambda: evaluate_designs(
        numpy_batch, ANGLES, native=False
    )
    return functions, counts | {"triplet and dome, NumPy | 1": 256}


def evaluations() -> dict[str, Callable[[], object]]:
    """Return single evaluations of 100 field angles: a cached sensor, and a sensor at another
    focus."""
    sphere = om.load_sensor("paper-spherical")
    variant = replace(sphere, lens=TRIPLET, housing=DOME)
    omega = np.linspace(0, 134, ANGLES)
    refocused = replace(variant, lens=TRIPLET.focused_at(215.0))
    return {
        "ideal lens, bare mirror": lambda: om.evaluate(sphere, omega),
        "triplet and dome": lambda: om.evaluate(variant, omega),
        "triplet and dome, new sensor for each evaluation": lambda: om.evaluate(
            replace(refocused, name="new"), omega
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    load_note = load_warning()
    functions, counts = batches()
    rows = [
        f"| {name} | {1e3 * counts[name] / wall:,.0f} | {1e3 * counts[name] / cpu:,.0f} |"
        for name, (wall, cpu) in measure_wall_and_cpu(functions, RUNS).items()
    ]
    single = [
        f"| {name} | {wall:.2f} | {cpu:.2f} |"
        for name, (wall, cpu) in measure_wall_and_cpu(evaluations(), 40).items()
    ]
    table = "\n".join(
        [
            f"`real_lens_rate.py` on {processor_name()}, {os.cpu_count()} "
            f"cores, NumPy {np.__version__}; medians of {RUNS} "
            f"and 40 interleaved runs.{load_note}",
            "",
            f"| designs of {ANGLES} field angles | threads | designs/s | designs/s per core |",
            "|---|---|---|---|",
            *rows,
            "",
            f"| one evaluation of {ANGLES} field angles | time, ms | CPU time, ms |",
            "|---|---|---|",
            *single,
        ]
    )
    print(table)
    write_text(arguments.output / "real_lens_rate.md", table + "\n")


if __name__ == "__main__":
    main()
