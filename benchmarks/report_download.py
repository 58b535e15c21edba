"""Measure the time from the click to the complete report in the studio, for the first and for later reports.

The first report includes the import of the plotting package and the preparation of the room.

    python benchmarks/report_download.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from circumstances import circumstances

import omnimirror as om
from omnimirror.apps.studio._bench_files import downloaded
from omnimirror.apps.studio.bench_messages import FileRequest
from omnimirror.base.files import write_text
from omnimirror.optics.sensor_files import tables_of

SENSORS = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant")


def once(name: str) -> tuple[float, float, int]:
    """Return wall-clock seconds, core seconds and bytes of a report."""
    asked = FileRequest(
        tables=tables_of(om.load_sensor(name)), kind="report", object_distance_mm=None
    )
    wall, cores = time.perf_counter(), time.process_time()
    made = downloaded(asked)
    return time.perf_counter() - wall, time.process_time() - cores, len(made.data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    rows = []
    for number, name in enumerate(SENSORS):
        if number == 0:
            wall, cores, size = once(name)
            rows.append(
                f"| {name}, first report of the server | {wall:.1f} | {cores:.1f} | {size / 1e6:.1f} |"
            )
        wall, cores, size = np.median([once(name) for _ in range(arguments.runs)], axis=0)
        rows.append(f"| {name} | {wall:.1f} | {cores:.1f} | {size / 1e6:.1f} |")
        print(*rows, sep="\n", flush=True)
    lines = [
        "# Reports",
        "",
        circumstances(arguments.runs).replace("interleaved runs", "reports"),
        "",
        "| report | s | CPU time, s | MB |",
        "|---|---|---|---|",
        *rows,
        "",
    ]
    write_text(arguments.out / "report_download.md", "\n".join(lines))


if __name__ == "__main__":
    main()
