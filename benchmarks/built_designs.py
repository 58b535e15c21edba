"""Measure the cost of a real lens and a dome in batches of designs and in one evaluation of 100 field angles.

The lens is a triplet of six surfaces with a moving entrance pupil and its own aberrations; the dome is made of acrylic.
Each design is evaluated at 100 field angles at its own best focus: mapping, tangential and sagittal images, blur. All
variants run interleaved in one process; results are medians of wall time and processor time.

    python benchmarks/built_designs.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from circumstances import other_load, processor
from timing import measured

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
BUILT: dict[str, dict[str, Any]] = {
    "ideal lens, bare mirror": {},
    "ideal lens, dome": {"housing": DOME},
    "triplet, bare mirror": {"lens": TRIPLET},
    "triplet and dome": {"lens": TRIPLET, "housing": DOME},
}


def designs(count: int, **built: Any) -> Designs:
    """Return even polynomials of five terms, perturbations of the paper's equidistant mirror."""
    rng = np.random.default_rng(0)
    c = np.array([0.6409, 0.155, -0.01, 0.0, 0.0]) * (1 + 0.05 * rng.standard_normal((count, 5)))
    m = 172 * rng.uniform(0.95, 1.05, count)
    return Designs(family("even-polynomial", 5), c, m, 43.9, 11.6, 4.0, 5.2, **built)


def batches() -> tuple[dict[str, Callable[[], object]], dict[str, int]]:
    """Return batches by label, and the number of designs in each."""
    functions, counts = dict[str, Callable[[], object]](), dict[str, int]()

    def on_threads(many: Designs, count: int) -> Callable[[], object]:
        def run() -> object:
            backend.set_threads(count)
            return evaluate_designs(many, ANGLES, native=True)

        return run

    for name, built in BUILT.items():
        if backend.is_compiled:
            many = designs(DESIGNS, **built)
            for count in dict.fromkeys((1, min(2, os.cpu_count() or 1))):
                functions[f"{name} | {count}"] = on_threads(many, count)
                counts[f"{name} | {count}"] = DESIGNS
    few = designs(256, **BUILT["triplet and dome"])
    functions["triplet and dome, NumPy | 1"] = lambda: evaluate_designs(few, ANGLES, native=False)
    return functions, counts | {"triplet and dome, NumPy | 1": 256}


def evaluations() -> dict[str, Callable[[], object]]:
    """Return single evaluations of 100 field angles: a cached sensor, and a sensor at another
    focus."""
    sphere = om.load_sensor("paper-spherical")
    built = replace(sphere, lens=TRIPLET, housing=DOME)
    omega = np.linspace(0, 134, ANGLES)
    refocused = replace(built, lens=TRIPLET.focused_at(215.0))
    return {
        "ideal lens, bare mirror": lambda: om.evaluate(sphere, omega),
        "triplet and dome": lambda: om.evaluate(built, omega),
        "triplet and dome, new sensor for each evaluation": lambda: om.evaluate(
            replace(refocused, name="new"), omega
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    load = other_load()
    functions, counts = batches()
    rows = [
        f"| {name} | {1e3 * counts[name] / wall:,.0f} | {1e3 * counts[name] / cpu:,.0f} |"
        for name, (wall, cpu) in measured(functions, RUNS).items()
    ]
    single = [
        f"| {name} | {wall:.2f} | {cpu:.2f} |"
        for name, (wall, cpu) in measured(evaluations(), 40).items()
    ]
    table = "\n".join(
        [
            f"`built_designs.py` on {processor()}, {os.cpu_count()} cores, NumPy {np.__version__}; medians of {RUNS} "
            f"and 40 interleaved runs.{load}",
            "",
            f"| designs of {ANGLES} field angles | threads | designs/s | designs/s per core |",
            "|---|---|---|---|",
            *rows,
            "",
            f"| one evaluation of {ANGLES} field angles | ms | CPU time, ms |",
            "|---|---|---|",
            *single,
        ]
    )
    print(table)
    write_text(arguments.out / "built_designs.md", table + "\n")


if __name__ == "__main__":
    main()
