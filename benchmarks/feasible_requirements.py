"""Success rate of `design_sensor` on requirement files that are feasible by construction.

Each file takes the values of a random sensor, relaxed by 0.5 %, as limits, and replaces rim radius,
focal length and F-number by wide asymmetric ranges that contain those of the sensor. Files cover
families and mappings, fits, domes, tubes in air and water, near objects (distances, a cylinder, a
plane), and lenses and imagers of the catalogue.

    python benchmarks/feasible_requirements.py --count 300 -o out/benchmarks
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.base.files import write_text
from omnimirror.design._candidates import make
from omnimirror.design._parameter_search import solve
from omnimirror.design.catalogue import LensComponent, read_catalogue
from omnimirror.design.requirement_files import requirements_of
from omnimirror.design.requirements import MAX_FOCUS

RELAXATION = 0.005  # relative relaxation
MAX_QUANTITIES = (
    "total_blur_deg",
    "total_blur_px",
    "viewpoint_spread_mm",
    "sag_mm",
    "overall_height_mm",
    "overall_diameter_mm",
)
MIN_QUANTITIES = ("resolution_px_per_deg", "area_ratio", "width_px_per_deg", "mtf")
MIRRORS = (
    "sphere",
    "hyperboloid",
    "paraboloid",
    "ellipsoid",
    "equidistant",
    "equiareal",
    "conformal",
    "unit-aspect",
)
FAMILIES = MIRRORS[:4]
OBJECTS = ("infinity", "distances", "cylinder", "plane")
HOUSINGS = ("none", "camera", "dome", "tube", "water")
MAX_ATTEMPTS = 200


def feasible_requirements(seed: int) -> om.Requirements:
    """Return requirements that a random sensor meets, with the values of that sensor inside ranges."""
    rng = np.random.default_rng(seed)
    housing, objects = str(rng.choice(HOUSINGS)), str(rng.choice(OBJECTS))  # not redrawn in retries
    for _ in range(MAX_ATTEMPTS):
        tables, values = _tables(rng, housing, objects)
        try:
            sensor = make(requirements_of(_merged(tables, values))).sensor
            limits = _limits(rng, tables, values, sensor)
            ranges = {
                name: _random_range(rng, value, *_BOUNDS[name]) for name, value in values.items()
            }
            requirements = requirements_of({**_merged(tables, ranges), "limit": limits})
            if limits and om.check_requirements(requirements, sensor).is_met:
                return requirements
        except OmnimirrorError:
            continue
    raise RuntimeError(f"no sensor found for seed {seed}")


_BOUNDS = {
    "rim_radius_mm": (5.0, 90.0),
    "focal_length_mm": (1.5, 40.0),
    "f_number": (1.4, 16.0),
    "conic": (-4.0, 4.0),
}


def _tables(
    rng: np.random.Generator, housing: str, objects: str
) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the tables without the entries that become ranges, and the values of these entries."""
    kind = str(rng.choice(MIRRORS))
    rim = float(rng.uniform(8.0, 60.0))
    values = {
        "rim_radius_mm": rim,
        "focal_length_mm": float(rng.uniform(3.0, 16.0)),
        "f_number": float(rng.uniform(2.0, 8.0)),
    }
    field: dict[str, Any] = {
        "omega_max_deg": float(rng.uniform(90.0, 135.0)),
        "omega_min_deg": 20.0,
    }
    mirror: dict[str, Any] = {"family" if kind in FAMILIES else "mapping": kind}
    if kind == "ellipsoid":
        values["conic"] = float(rng.uniform(-0.6, 1.5))
    if kind not in FAMILIES and rng.random() < 0.4:
        mirror["fit"] = str(rng.choice(["polynomial:5", "asphere:3"]))
    object_tables = {
        "infinity": {},
        "distances": {
            "object_distance_mm": [
                float(rng.uniform(5, 15) * rim),
                float(rng.uniform(20, 80) * rim),
            ]
        },
        "cylinder": {"object_cylinder_radius_mm": float(rng.uniform(5, 20) * rim)},
        "plane": {"object_plane_distance_mm": float(rng.uniform(5, 20) * rim)},
    }
    field |= object_tables[objects]
    shell = {"material": "acrylic", "wall_mm": 3.0}
    tube = {**shell, "diameter_mm": float(rng.uniform(3.0, 4.0) * 60.0)}
    housing_table: dict[str, Any] = {
        "none": {},
        "camera": {"camera": {"diameter_mm": float(rng.uniform(0.2, 0.6) * rim)}},
        "dome": {"dome": shell},
        "tube": {"tube": tube},
        "water": {"tube": {**tube, "medium": "water"}},
    }[housing]
    if housing == "water":
        field["omega_min_deg"] = 50.0
    imager, lens, lens_ranges = _imager_and_lens(rng)
    values |= lens_ranges
    tables = {
        "name": "feasible",
        "field": field,
        "mirror": mirror,
        "lens": lens,
        "imager": imager,
        "housing": housing_table,
    }
    return tables, {name: value for name, value in values.items() if name not in lens}


def _imager_and_lens(
    rng: np.random.Generator,
) -> tuple[dict[str, Any], dict[str, Any], dict[str, float]]:
    """Return the imager, the fixed entries of the lens and its F-number, from the catalogue or
    freely chosen."""
    components = read_catalogue()
    imagers = [part for part in components.imagers if rng.random() < 0.4]
    if imagers:
        part = imagers[0]
        imager = {
            "width_px": part.width_px,
            "height_px": part.height_px,
            "pixel_pitch_um": part.pixel_pitch_um,
        }
    else:
        width = int(rng.choice([1280, 1920, 2048, 4000]))
        height = int(width * rng.choice([0.5625, 0.75, 1.0]))
        imager = {
            "width_px": width,
            "height_px": height,
            "pixel_pitch_um": float(rng.choice([1.55, 2.4, 3.45, 4.8])),
        }
    if rng.random() < 0.7:
        return imager, {}, {}
    lenses = [part for part in components.lenses if isinstance(part, LensComponent)]
    component = lenses[int(rng.integers(len(lenses)))]
    lens = {
        "focal_length_mm": component.focal_length_mm,
        "focus_mm": [component.minimum_focus_mm, MAX_FOCUS],
    }
    if component.f_number_min == component.f_number_max:
        return imager, {**lens, "f_number": component.f_number_min}, {}
    return (
        imager,
        lens,
        {"f_number": float(rng.uniform(component.f_number_min, component.f_number_max))},
    )


def _merged(tables: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the tables with entries of mirror and lens."""
    mirror_values = {
        name: value for name, value in values.items() if name in ("rim_radius_mm", "conic")
    }
    lens_values = {name: value for name, value in values.items() if name not in mirror_values}
    return {
        **tables,
        "mirror": tables["mirror"] | mirror_values,
        "lens": tables["lens"] | lens_values,
    }


def _random_range(rng: np.random.Generator, value: float, low: float, high: float) -> list[float]:
    """Return an asymmetric range about a value."""
    if value <= 0 or low < 0:
        return [max(low, value - rng.uniform(0.1, 1.0)), min(high, value + rng.uniform(0.1, 2.0))]
    return [max(low, value / rng.uniform(1.05, 2.5)), min(high, value * rng.uniform(1.05, 2.5))]


def _limits(
    rng: np.random.Generator, tables: dict[str, Any], values: dict[str, float], sensor: om.Sensor
) -> list[dict[str, Any]]:
    """Return limits at the relaxed values of a sensor."""
    upper = [str(name) for name in rng.choice(MAX_QUANTITIES, rng.integers(1, 4), replace=False)]
    lower = [str(name) for name in rng.choice(MIN_QUANTITIES, rng.integers(1, 3), replace=False)]
    cycles = {"cycles_per_px": 0.125}
    candidates = [{"quantity": name, "at_most": 1e9} for name in upper]
    candidates += [
        {"quantity": name, "at_least": 1e-9, **(cycles if name == "mtf" else {})} for name in lower
    ]
    verdict = om.check_requirements(
        requirements_of({**_merged(tables, values), "limit": candidates}), sensor
    )
    limits = []
    for limit, row in zip(candidates, verdict.limits, strict=True):
        side, factor = (
            ("at_most", 1 + RELAXATION) if "at_most" in limit else ("at_least", 1 - RELAXATION)
        )
        if not np.isfinite(row.reached) or row.reached <= 1e-6:
            continue
        limits.append({**limit, side: row.reached * factor})
    return limits


def main() -> None:
    from measurement_conditions import load_warning, processor_name

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=0, help="first seed")
    parser.add_argument(
        "--failures", type=Path, help="folder for the requirement files without a solution"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    load_note, times, unsolved = load_warning(), [], []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.count):
        requirements = feasible_requirements(seed)
        start = time.process_time()
        try:
            verdict = solve(requirements)[1].verdict
            failure = (
                ""
                if verdict.is_met
                else f"misses {', '.join(verdict.missed)} by {verdict.worst:.2%}"
            )
        except OmnimirrorError as error:
            failure = str(error)
        times.append(time.process_time() - start)
        print(f"seed {seed}, {times[-1]:.1f} s: {failure or 'met'}", flush=True)
        if failure:
            unsolved.append(seed)
            if arguments.failures:
                write_text(
                    arguments.failures / f"feasible-{seed}.toml",
                    om.format_requirements(requirements),
                )
    table = "\n".join(
        [
            f"`feasible_requirements.py` on {processor_name()}; seeds {arguments.first_seed} to {seed}.{load_note}",
            "",
            "| files | solved | median CPU time, s | longest, s |",
            "|---|---|---|---|",
            f"| {len(times)} | {1 - len(unsolved) / len(times):.1%} | {np.median(times):.1f} | {max(times):.1f} |",
        ]
    )
    print(table)
    write_text(arguments.output / "feasible_requirements.md", table + "\n")


if __name__ == "__main__":
    main()
