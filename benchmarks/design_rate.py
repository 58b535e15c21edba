"""What evaluating a design costs: the batch evaluator beside om.evaluate and Optiland's field-curvature analysis.

A design is evaluated at 100 field angles: mapping, tangential and sagittal images, blur, at the design's own best
focus. All run interleaved in one process; medians. Optiland's analysis gives mapping aside tangential and sagittal
focus only, for fields below 90 deg, and no best focus.

    python benchmarks/design_rate.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import platform
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from evaluation_time import optiland_system
from timing import interleaved

import omnimirror as om
from omnimirror.batch.bases import family
from omnimirror.batch.evaluate import Designs, evaluate_designs
from omnimirror.files import write_text
from omnimirror.native import backend

ANGLES, DESIGNS, RUNS = 100, 20_000, 15


def designs(count: int) -> Designs:
    """Even polynomials of five terms about the paper's equidistant mirror."""
    rng = np.random.default_rng(0)
    c = np.array([0.6409, 0.155, -0.01, 0.0, 0.0]) * (1 + 0.05 * rng.standard_normal((count, 5)))
    return Designs(family("even-polynomial", 5), c, 172 * rng.uniform(0.95, 1.05, count), 43.9, 11.6, 4.0, 5.2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    many, few = designs(DESIGNS), designs(2048)
    sensor = om.load_sensor("paper-spherical")
    omega = np.linspace(0, 135, ANGLES)
    cores = os.cpu_count() or 1

    def on_threads(count: int) -> Callable[[], object]:
        def run() -> object:
            backend.set_threads(count)
            return evaluate_designs(many, ANGLES, native=True)

        return run

    functions: dict[str, Callable[[], object]] = {"NumPy": lambda: evaluate_designs(few, ANGLES, native=False)}
    counts = {"NumPy": len(few)}
    if backend.is_compiled:
        for count in dict.fromkeys((1, min(4, cores))):
            functions[f"compiled, {count} thread{'s' * (count > 1)}"] = on_threads(count)
            counts[f"compiled, {count} thread{'s' * (count > 1)}"] = len(many)
    functions["om.evaluate at a best focus of its own"] = lambda: om.evaluate(sensor, omega, focus_mm="auto")
    functions["om.evaluate as focused"] = lambda: om.evaluate(sensor, omega)
    notes = []
    try:
        from optiland.analysis import FieldCurvature
    except ImportError:
        notes = ["", "Optiland is not installed (`make bench` installs it), so it is not compared."]
    else:
        warnings.simplefilter("ignore")
        functions["Optiland, system and field curvature to 80 deg"] = lambda: FieldCurvature(
            optiland_system(sensor, 80.0), num_points=ANGLES
        )
    medians = interleaved(functions, RUNS)
    rates = {name: 1e3 * counts.get(name, 1) / ms for name, ms in medians.items()}
    rows = [f"| {name} | {rate:,.0f} | {1e6 / rate:,.1f} |" for name, rate in rates.items()]
    table = "\n".join(
        [
            f"Medians of {RUNS} interleaved runs, {ANGLES} field angles a design, Python {platform.python_version()}, "
            f"NumPy {np.__version__}, {cores} cores.",
            "",
            "| what | designs a second | us a design |",
            "|---|---|---|",
            *rows,
            *notes,
        ]
    )
    print(table)
    write_text(arguments.out / "design_rate.md", table + "\n")


if __name__ == "__main__":
    main()
