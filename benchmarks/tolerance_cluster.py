"""Measure the overhead of a Dask cluster against the threads of one process, in processor time.

Scheduler and workers (one per core) run on the loopback interface and are idle before the measurement; the processor
time of all processes from then on is counted, including the start of the client and the first import of the workers.
The idle load of scheduler and workers is measured separately and counted for the undisturbed duration of the work. The
throughput of 64 workers is extrapolated.

    python benchmarks/tolerance_cluster.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from circumstances import other_load, processor

from omnimirror.base.files import write_text
from omnimirror.manufacturing.tolerancing.sweep import SHARD_TRIALS

IDLE_S = 20.0
SHARDS, WORKERS = 20, os.cpu_count() or 1  # 10 million sensors
MANY = 64
# Disables the worker profiler, which samples 100 times per second for the unused dashboard.
UNWATCHED = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
TICK = os.sysconf("SC_CLK_TCK")
RUN = """
import sys, time
from pathlib import Path
import omnimirror as om
sensor = om.load_sensor("paper-spherical")
plan = om.load_tolerances(sys.argv[1], sensor)
sweep = om.Sweep(Path(sys.argv[2]), scheduler=sys.argv[4] or None)
found = om.tolerance(sensor, plan, trials=int(sys.argv[3]), sweep=sweep)
print(found.statistics.trials, found.statistics.passed, time.process_time())
"""


def spent(pid: int) -> float:
    """Return the processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def swept(folder: Path, name: str, address: str = "") -> tuple[str, float]:
    """Return the result of a sweep and the processor time of its client."""
    words = [folder / "tolerances.toml", folder / name, SHARDS * SHARD_TRIALS, address]
    run = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, words)], capture_output=True, text=True, check=True
    )
    trials, passed, seconds = run.stdout.split()
    return f"{passed} of {trials}", float(seconds)


def started(stack: ExitStack, *words: str) -> subprocess.Popen[bytes]:
    program = Path(sys.executable).with_name("dask")
    quiet = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "env": os.environ | UNWATCHED,
    }
    process = subprocess.Popen([program, *words], **quiet)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def cluster(stack: ExitStack, folder: Path) -> tuple[str, dict[str, list[int]]]:
    """Start a cluster; return its address, and its processes by role."""
    from distributed import Client

    file = folder / "scheduler.json"
    scheduler = started(
        stack,
        "scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
        "--scheduler-file",
        str(file),
    )
    while not file.exists():
        time.sleep(0.1)
    words = (
        "worker",
        "--scheduler-file",
        str(file),
        "--host",
        "127.0.0.1",
        "--nthreads",
        "1",
        "--no-nanny",
    )
    workers = [started(stack, *words, "--no-dashboard") for _ in range(WORKERS)]
    with Client(scheduler_file=str(file), set_as_default=False) as client:
        client.wait_for_workers(WORKERS)
        address = client.scheduler.address
    return address, {"scheduler": [scheduler.pid], "workers": [worker.pid for worker in workers]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    loaded = other_load()
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        subprocess.run(
            [sys.executable, "-m", "omnimirror", "tolerance", "init", "paper-spherical"],
            cwd=folder,
            check=True,
        )
        of_threads, single = swept(folder, "threads")
        of_both, again = swept(folder, "threads")  # only reads and aggregates results
        address, processes = cluster(stack, folder)
        idle, _ = during(processes, lambda: time.sleep(IDLE_S))
        found: list[tuple[str, float]] = []
        busy, wall = during(processes, lambda: found.append(swept(folder, "cluster", address)))
    (of_cluster, client), standing = (
        found[0],
        {what: seconds / IDLE_S for what, seconds in idle.items()},
    )
    assert of_threads == of_both == of_cluster
    write(arguments.out, single, again, client, busy, standing, wall, loaded)


def during(
    processes: dict[str, list[int]], act: Callable[[], object]
) -> tuple[dict[str, float], float]:
    """Return the processor time of processes during an action, and its wall-clock time, s."""
    before = {what: sum(map(spent, pids)) for what, pids in processes.items()}
    begin = time.perf_counter()
    act()
    wall = time.perf_counter() - begin
    return {what: sum(map(spent, pids)) - before[what] for what, pids in processes.items()}, wall


def write(
    out: Path,
    single: float,
    again: float,
    client: float,
    spent: dict[str, float],
    standing: dict[str, float],
    wall: float,
    busy: str,
) -> None:
    whole, shard = client + sum(spent.values()), (single - again) / SHARDS
    quiet = again + (single - again) / WORKERS
    beyond = whole - single - sum(standing.values()) * max(wall - quiet, 0.0)
    rows = [
        f"| threads of one process | {single:.1f} |",
        f"| of which start-up, reading and reduction | {again:.1f} |",
        f"| cluster: client process | {client:.1f} |",
        f"| cluster: scheduler | {spent['scheduler']:.2f} |",
        f"| cluster: {WORKERS} workers | {spent['workers']:.1f} |",
        f"| cluster: scheduler, idle, per second | {standing['scheduler']:.3f} |",
        f"| cluster: {WORKERS} workers, idle, per second | {standing['workers']:.3f} |",
        f"| overhead of the cluster over threads, measured | {whole - single:.1f}, "
        f"{100 * (whole / single - 1):.0f} % |",
        f"| overhead of the cluster over threads, for an undisturbed run of {quiet:.0f} s | {beyond:.1f}, "
        f"{100 * beyond / single:.1f} % |",
    ]
    text = "\n".join(
        [
            f"{SHARDS} shards of {SHARD_TRIALS:,} sensors, {shard:.1f} s of one core each; {wall:.0f} s of wall time. "
            f"{processor()}, {WORKERS} cores.{busy}",
            "",
            "| processor time | s |",
            "|---|---:|",
            *rows,
            "",
            f"Estimate for {MANY} workers: "
            f"{MANY / shard:.0f} shards per second, {MANY * SHARD_TRIALS / shard / 1e6:.1f} "
            f"million sensors, {MANY / shard * SHARD_TRIALS * 96 / 1e6:.0f} MB/s to the disc that they share; then "
            f"at most {1e6 * again / (SHARDS * SHARD_TRIALS):.1f} s of one core per million trials for the reduction.",
        ]
    )
    print(text)
    write_text(out / "tolerance_cluster.md", text + "\n")


if __name__ == "__main__":
    main()
