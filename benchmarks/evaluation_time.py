"""Measure the evaluation of 100 field angles with omnimirror and with the field-curvature analysis of Optiland.

Both run interleaved in one process; results are medians. The analysis of Optiland returns two columns (tangential and
sagittal focus) for fields below 90 deg, the evaluation of omnimirror 27 columns over the whole field. Optiland aims its
rays at a stop behind the aberrations of the mirror; beyond about 15 deg, they miss the lens. The table reports the
distance, because the comparison concerns time and not accuracy.

    python benchmarks/evaluation_time.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import platform
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text

ANGLES = 100
RUNS = 100


def optiland_system(sensor: om.Sensor, largest_deg: float) -> Any:
    """Return the sensor as an Optiland system: mirror, ideal lens with the stop, image; fields up
    to largest_deg."""
    from optiland.optic import Optic

    system = Optic()
    system.add_surface(index=0, thickness=np.inf)
    system.add_surface(
        index=1,
        thickness=-sensor.mirror_distance_mm,
        radius=sensor.mirror.vertex_radius,
        material="mirror",
    )
    lens = sensor.lens
    system.add_surface(
        index=2,
        surface_type="paraxial",
        f=lens.focal_length_mm,
        thickness=-lens.image_distance,
        is_stop=True,
    )
    system.add_surface(index=3)
    system.set_aperture("EPD", 0.3)
    system.set_field_type("angle")
    for angle in (0.0, largest_deg / 2, largest_deg):
        system.add_field(y=angle)
    system.add_wavelength(0.55, is_primary=True)
    return system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    sensor = om.load_sensor("paper-spherical")
    omega = np.linspace(0, 135, ANGLES)
    functions: dict[str, Callable[[], object]] = {
        "omnimirror evaluate, 27 columns": lambda: om.evaluate(sensor, omega),
        "omnimirror best focus, 1001 angles": lambda: om.best_focus(sensor),
    }
    notes = []
    try:
        from optiland.analysis import FieldCurvature
    except ImportError:
        notes.append(
            "Optiland is not installed (`make bench` installs it) and is not included in the comparison."
        )
    else:
        warnings.simplefilter("ignore")
        system = optiland_system(sensor, 80.0)
        functions["Optiland field curvature, 2 columns, to 80 deg"] = lambda: FieldCurvature(
            system, num_points=ANGLES
        )
        for angle in (15.0, 45.0, 80.0):
            ray = system.trace_generic(0, angle / 80.0, 0, 0, 0.55)
            x = om.evaluate(sensor, [angle]).h_px[0] * sensor.imager.pitch_mm
            notes.append(
                f"Optiland's chief ray at {angle:g} deg meets the image "
                f"plane {abs(float(ray.y[0])):.3f} mm from the axis, "
                f"and the exact one at {x:.3f} mm."
            )
    medians = measure_interleaved(functions, RUNS)
    reference_ms = medians["omnimirror evaluate, 27 columns"]
    rows = [f"| {name} | {t:.3f} | {t / reference_ms:.1f} |" for name, t in medians.items()]
    table = "\n".join(
        [
            f"Medians of {RUNS} interleaved runs of {ANGLES} field angles, Python {platform.python_version()}, NumPy "
            f"{np.__version__}.",
            "",
            "| analysis | time, ms | ratio |",
            "|---|---|---|",
            *rows,
            "",
            *notes,
        ]
    )
    print(table)
    write_text(arguments.output / "evaluation_time.md", table + "\n")


if __name__ == "__main__":
    main()
