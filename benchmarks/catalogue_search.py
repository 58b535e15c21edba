"""Measure the search over 200 lenses and 50 imagers with one mirror per combination.

The catalogue is generated from a seed with realistic focal lengths, F-numbers, image circles, pixels and prices. The
searches are for the ten cheapest feasible combinations and for the Pareto front of price and blur.

    python benchmarks/catalogue_search.py --processes 2 -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.design.catalogue import Catalogue, ImagerComponent, LensComponent

LENSES, IMAGERS = 200, 50


def catalogue() -> Catalogue:
    """Return random lenses and imagers."""
    rng = np.random.default_rng(1)

    def lens(i: int) -> LensComponent:
        f = float(np.round(rng.uniform(2.5, 35), 1))
        return LensComponent(
            f"lens {i}",
            f,
            f_number_min=float(rng.choice([1.4, 1.8, 2.0, 2.8])),
            f_number_max=16.0,
            minimum_focus_mm=float(max(rng.uniform(20, 300), 1.2 * f)),
            image_circle_mm=float(rng.choice([6.6, 8.0, 11.0, 16.0])),
            extension_rings_mm=(0.5, 1.0) if i % 3 else (),
            price=float(np.round(rng.uniform(8, 400))),
            mass_g=60.0,
        )

    def imager(i: int) -> ImagerComponent:
        width = int(rng.choice([1280, 1920, 2448, 3840]))
        return ImagerComponent(
            f"imager {i}",
            width,
            int(width * rng.choice([0.75, 0.5625, 0.8])),
            float(rng.choice([1.12, 1.55, 2.0, 2.4, 2.9, 3.45, 5.2])),
            price=float(np.round(rng.uniform(25, 600))),
            mass_g=40.0,
        )

    return Catalogue(tuple(map(lens, range(LENSES))), tuple(map(imager, range(IMAGERS))))


def requirements_for(blur_deg: float) -> om.Requirements:
    """Return requirements for a sphere of 60 mm with a field of 120 deg and a blur limit."""
    return om.Requirements(
        field=om.FieldRequirements(omega_max_deg=120, omega_min_deg=15),
        mirror=om.MirrorRequirements(rim_radius_mm=30, family="sphere"),
        lens=om.LensRequirements(f_number=(1, 16)),
        limits=[
            om.Limit("total_blur_deg", at_most=blur_deg),
            om.Limit("resolution_px_per_deg", at_least=4.0),
        ],
        parts=om.PartsRequirements(max_height_mm=250.0),
    )


def row(components: Catalogue, blur_deg: float, label: str, processes: int, **options: Any) -> str:
    """Measure one search."""
    start = time.perf_counter()
    result = om.design_from_parts(
        requirements_for(blur_deg), components, processes=processes, **options
    )
    seconds = time.perf_counter() - start
    cheapest = f"{result.found[0].price:.0f}" if result.found else ""
    return f"| {label} | {blur_deg:g} | {seconds:.1f} | {len(result.found)} | {cheapest} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    load_note, components, processes = load_warning(), catalogue(), arguments.processes
    rows = [
        row(components, 1.2, "ten cheapest combinations", processes, most=10),
        row(components, 0.05, "ten cheapest combinations, none feasible", processes, most=10),
        row(components, 1.2, "Pareto front of price and blur", processes, front=True),
    ]
    table = "\n".join(
        [
            f"`catalogue_search.py` on {processor_name()}, {os.cpu_count()} cores, {processes} processes, NumPy "
            f"{np.__version__}; {LENSES} x {IMAGERS} components.{load_note}",
            "",
            "| requirements | maximum blur, deg | time, s | combinations | lowest price |",
            "|---|---|---|---|---|",
            *rows,
        ]
    )
    print(table)
    write_text(arguments.output / "catalogue_search.md", table + "\n")


if __name__ == "__main__":
    main()
