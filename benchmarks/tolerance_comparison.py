"""Measure the time of a tolerance trial in omnimirror and in Optiland for a case that both support.

A spherical mirror is decentred, tilted about two axes and displaced along its axis, and reflects rays from the lens.
Four variants of Optiland: its tolerancing module, one Monte Carlo trial with the direction of each ray as an operand;
the same with one operand; and two manual implementations, perturbations and one vectorised call with all rays: of the
tracer, and of the mirror surface alone with given rays. The trial of omnimirror also determines the image of each
object, focus, blur and five calibrations. All variants run interleaved in one process on one thread; results are
medians of processor time. Before the measurement, the program verifies that both trace the same rays: rays computed for
the objects of a perturbed sensor are launched in Optiland and must leave its mirror towards these objects.

    python benchmarks/tolerance_comparison.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import platform
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from measurement_conditions import processor_name
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.manufacturing.tolerancing.compensation import POSE
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.perturbed_states import states_of
from omnimirror.manufacturing.tolerancing.trial_images import trace_objects

RUNS, TRIALS, OPTILAND_TRIALS = 9, 2000, 3
SIZES = dict(zip(POSE, (0.1, 0.1, 0.1, 0.1, 0.1), strict=True))


def optiland_system(sensor: om.Sensor) -> Any:
    """Return a system of a point in the lens and the mirror."""
    from optiland.optic import Optic

    system = Optic()
    system.add_surface(index=0, thickness=sensor.mirror_distance_mm)
    system.add_surface(
        index=1,
        thickness=-100.0,
        radius=sensor.mirror.vertex_radius,
        material="mirror",
        is_stop=True,
    )
    system.add_surface(index=2)
    system.set_aperture("EPD", 2 * 0.9 * sensor.mirror.rim_radius_mm)
    system.set_field_type("angle")
    system.add_field(y=0)
    system.add_wavelength(0.55, is_primary=True)
    return system


def perturb(system: Any, values: dict[str, float]) -> None:
    """Perturb the mirror of a system as in a trial; Optiland rotates about X, then Y, as omnimirror
    does."""
    coordinate_system = system.surface_group.surfaces[1].geometry.cs
    coordinate_system.x, coordinate_system.y, coordinate_system.z = (
        values[name] for name in POSE[:3]
    )
    coordinate_system.rx, coordinate_system.ry = (
        np.radians(values[POSE[3]]),
        np.radians(values[POSE[4]]),
    )


def launch_rays(sensor: om.Sensor, tangents: np.ndarray) -> Any:
    """Launch rays from the lens with given tangents."""
    from optiland.rays import RealRays

    n = len(tangents)
    zero, one = np.zeros(n), np.ones(n)
    cosines = np.column_stack([tangents, one]) / np.sqrt(1 + (tangents**2).sum(axis=1))[:, None]
    return RealRays(
        zero, zero, np.full(n, -sensor.mirror_distance_mm), *cosines.T.copy(), one, 0.55 * one
    )


def largest_angle_rad(
    sensor: om.Sensor, evaluator: TrialEvaluator, values: dict[str, float]
) -> float:
    """Return the largest angle between the directions of the trial and the corresponding Optiland
    rays."""
    field = evaluator.field
    states = states_of(field.sensor, {name: np.array([v]) for name, v in values.items()})
    tangents = trace_objects(states, field.targets, field.distant, field.start).tangents[0]
    system, rays = optiland_system(sensor), launch_rays(sensor, tangents)
    perturb(system, values)
    system.surface_group.surfaces[1].trace(rays)
    directions = np.column_stack([np.asarray(rays.L), np.asarray(rays.M), np.asarray(rays.N)])
    return float(np.linalg.norm(np.cross(directions, field.targets), axis=1).max())


def tolerancing(system: Any, operands: int) -> Any:
    """Return Optiland's Monte Carlo analysis with a number of rays, each an operand."""
    from optiland.tolerancing.core import Tolerancing
    from optiland.tolerancing.monte_carlo import MonteCarlo
    from optiland.tolerancing.perturbation import DistributionSampler

    analysis = Tolerancing(system)
    azimuths = np.arange(operands) * 2.4  # golden angle
    radii = np.sqrt((np.arange(operands) + 0.5) / operands)
    for r, phi in zip(radii, azimuths, strict=True):
        settings = {"optic": system, "surface_number": 1, "Hx": 0, "Hy": 0, "wavelength": 0.55}
        analysis.add_operand(
            "real_M", input_data={**settings, "Px": r * np.cos(phi), "Py": r * np.sin(phi)}
        )
    for kind, axes, size in (("decenter", "xy", 0.1), ("tilt", "xy", np.radians(0.1))):
        for axis in axes:
            sampler = DistributionSampler("normal", loc=0.0, scale=size)
            analysis.add_perturbation(kind, sampler, surface_number=1, axis=axis)
    analysis.add_perturbation(
        "thickness",
        DistributionSampler("normal", loc=system.surface_group.get_thickness(0)[0], scale=0.1),
        surface_number=0,
    )
    return MonteCarlo(analysis)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    backend.set_threads(1)
    sensor = om.load_sensor("paper-spherical")
    evaluator = TrialEvaluator.of(sensor, "rms")
    rng, n = np.random.default_rng(1), len(evaluator.field)
    max_angle_rad = max(
        largest_angle_rad(
            sensor, evaluator, {name: float(rng.normal() * size) for name, size in SIZES.items()}
        )
        for _ in range(5)
    )
    tolerances = om.Tolerances(
        sensor, {name: om.Tolerance(2 * size, "normal") for name, size in SIZES.items()}
    )
    states = states_of(sensor, {}, 1)
    tangents = trace_objects(
        states, evaluator.field.targets, evaluator.field.distant, evaluator.field.start
    ).tangents[0]
    manual_system = optiland_system(sensor)

    def trace_mirror() -> None:
        for values in (
            {name: rng.normal() * size for name, size in SIZES.items()}
            for _ in range(OPTILAND_TRIALS)
        ):
            perturb(manual_system, values)
            manual_system.surface_group.surfaces[1].trace(launch_rays(sensor, tangents))

    pupil_points = np.random.default_rng(2).uniform(-0.6, 0.6, (2, n))

    def trace_system() -> None:
        for values in (
            {name: rng.normal() * size for name, size in SIZES.items()}
            for _ in range(OPTILAND_TRIALS)
        ):
            perturb(manual_system, values)
            manual_system.trace_generic(0.0, 0.0, *pupil_points, 0.55)

    all_operands, single = (tolerancing(optiland_system(sensor), count) for count in (n, 1))
    functions: dict[str, Callable[[], object]] = {
        "omnimirror": lambda: evaluator.evaluate(tolerances.drawn(0, 0, TRIALS)),
        "all operands": lambda: all_operands.run(OPTILAND_TRIALS),
        "one operand": lambda: single.run(OPTILAND_TRIALS),
        "system": trace_system,
        "mirror": trace_mirror,
    }
    medians = measure_interleaved(functions, RUNS, clock=time.process_time)
    trial_ms = medians["omnimirror"] / TRIALS
    rows = [f"| omnimirror, complete trial | {n} | {1e3 * trial_ms:.2f} | |"]
    for name, label, rays in (
        ("all operands", "Optiland's tolerancing module", n),
        ("one operand", "Optiland's tolerancing module, one operand", 1),
        ("system", "custom code: perturbations, and one vectorised call of the Optiland tracer", n),
        (
            "mirror",
            "custom code: perturbations, and intersection of given rays with the mirror only",
            n,
        ),
    ):
        ms = medians[name] / OPTILAND_TRIALS
        rows.append(f"| {label} | {rays} | {1e3 * ms:,.0f} | {ms / rays / (trial_ms / n):,.0f} |")
    table = "\n".join(
        [
            f"Medians of {RUNS} interleaved runs, one thread, processor time. Python {platform.python_version()}, "
            f"NumPy {np.__version__}, Optiland {version('optiland')}, "
            f"{backend.name} ({processor_name()}). The same rays "
            f"leave both mirrors in directions that differ by at most {max_angle_rad:.1e} rad.",
            "",
            "| trial | rays | time, us | ratio to omnimirror per ray |",
            "|---|---:|---:|---:|",
            *rows,
        ]
    )
    print(table)
    write_text(arguments.output / "tolerance_comparison.md", table + "\n")


if __name__ == "__main__":
    main()
