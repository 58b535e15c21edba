"""Measure the time from the click to the complete report in the studio, for the first and for later reports.

The first report includes the import of the plotting package and the preparation of the room.

    python benchmarks/report_download.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from measurement_conditions import describe_conditions

import omnimirror as om
from omnimirror.apps.studio._design_files import sensor_report
from omnimirror.base.files import write_text

SENSORS = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant")


def measure_report(name: str) -> tuple[float, float, int]:
    """Return wall-clock seconds, core seconds and bytes of a report."""
    sensor = om.load_sensor(name)
    wall, cpu = time.perf_counter(), time.process_time()
    report = sensor_report(sensor, lambda step, fraction: None)
    return time.perf_counter() - wall, time.process_time() - cpu, len(report.data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    rows = []
    for number, name in enumerate(SENSORS):
        if number == 0:
            wall, cpu, size = measure_report(name)
            rows.append(
                f"| {name}, first report of the server | {wall:.1f} | {cpu:.1f} | {size / 1e6:.1f} |"
            )
        wall, cpu, size = np.median([measure_report(name) for _ in range(arguments.runs)], axis=0)
        rows.append(f"| {name} | {wall:.1f} | {cpu:.1f} | {size / 1e6:.1f} |")
        print(*rows, sep="\n", flush=True)
    lines = [
        "# Reports",
        "",
        describe_conditions(arguments.runs).replace("interleaved runs", "reports"),
        "",
        "| report | wall time, s | CPU time, s | size, MB |",
        "|---|---|---|---|",
        *rows,
        "",
    ]
    write_text(arguments.output / "report_download.md", "\n".join(lines))


if __name__ == "__main__":
    main()
