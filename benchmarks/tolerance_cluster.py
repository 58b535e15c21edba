"""Measure the overhead of a Dask cluster against the threads of one process, in processor time.

Scheduler and workers (one per core) run on the loopback interface and are idle before the measurement; the processor
time of all processes from then on is counted, including the start of the client and the first import of the workers.
The idle load of scheduler and workers is measured separately and counted for the undisturbed duration of the work. The
throughput of 64 workers is extrapolated.

    python benchmarks/tolerance_cluster.py -o out/benchmarks
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

from measurement_conditions import load_warning, processor_name

from omnimirror.base.files import write_text
from omnimirror.manufacturing.tolerancing.sweep import SHARD_TRIALS

IDLE_S = 20.0
SHARDS, WORKERS = 20, os.cpu_count() or 1  # 10 million sensors
MODEL_WORKERS = 64
# Disables the worker profiler, which samples 100 times per second for the unused dashboard.
WITHOUT_PROFILER = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
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


def processor_s(pid: int) -> float:
    """Return the processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def run_sweep(folder: Path, name: str, address: str = "") -> tuple[str, float]:
    """Return the result of a sweep and the processor time of its client."""
    command = [folder / "tolerances.toml", folder / name, SHARDS * SHARD_TRIALS, address]
    run = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, command)], capture_output=True, text=True, check=True
    )
    trials, passed, seconds = run.stdout.split()
    return f"{passed} of {trials}", float(seconds)


def start_process(stack: ExitStack, *command: str) -> subprocess.Popen[bytes]:
    program = Path(sys.executable).with_name("dask")
    undisturbed_s = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "env": os.environ | WITHOUT_PROFILER,
    }
    process = subprocess.Popen([program, *command], **undisturbed_s)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def cluster(stack: ExitStack, folder: Path) -> tuple[str, dict[str, list[int]]]:
    """Start a cluster; return its address, and its processes by role."""
    from distributed import Client

    file = folder / "scheduler.json"
    scheduler = start_process(
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
    command = (
        "worker",
        "--scheduler-file",
        str(file),
        "--host",
        "127.0.0.1",
        "--nthreads",
        "1",
        "--no-nanny",
    )
    workers = [start_process(stack, *command, "--no-dashboard") for _ in range(WORKERS)]
    with Client(scheduler_file=str(file), set_as_default=False) as client:
        client.wait_for_workers(WORKERS)
        address = client.scheduler.address
    return address, {"scheduler": [scheduler.pid], "workers": [worker.pid for worker in workers]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    load_note = load_warning()
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        subprocess.run(
            [sys.executable, "-m", "omnimirror", "tolerance", "init", "paper-spherical"],
            cwd=folder,
            check=True,
        )
        of_threads, threads_s = run_sweep(folder, "threads")
        of_both, repeated = run_sweep(folder, "threads")  # only reads and aggregates results
        address, processes = cluster(stack, folder)
        idle, _ = during(processes, lambda: time.sleep(IDLE_S))
        cluster_results: list[tuple[str, float]] = []
        busy, wall = during(
            processes, lambda: cluster_results.append(run_sweep(folder, "cluster", address))
        )
    (of_cluster, client), idle_rates = (
        cluster_results[0],
        {role: seconds / IDLE_S for role, seconds in idle.items()},
    )
    assert of_threads == of_both == of_cluster
    write(arguments.output, threads_s, repeated, client, busy, idle_rates, wall, load_note)


def during(
    processes: dict[str, list[int]], action: Callable[[], object]
) -> tuple[dict[str, float], float]:
    """Return the processor time of processes during an action, and its wall-clock time, s."""
    before = {role: sum(map(processor_s, pids)) for role, pids in processes.items()}
    start = time.perf_counter()
    action()
    wall = time.perf_counter() - start
    return {
        role: sum(map(processor_s, pids)) - before[role] for role, pids in processes.items()
    }, wall


def write(
    out: Path,
    threads_s: float,
    repeated: float,
    client: float,
    processor_s: dict[str, float],
    idle_rates: dict[str, float],
    wall: float,
    busy: str,
) -> None:
    total, shard = client + sum(processor_s.values()), (threads_s - repeated) / SHARDS
    undisturbed_s = repeated + (threads_s - repeated) / WORKERS
    overhead = total - threads_s - sum(idle_rates.values()) * max(wall - undisturbed_s, 0.0)
    rows = [
        f"| threads of one process | {threads_s:.1f} |",
        f"| of which start-up, reading and reduction | {repeated:.1f} |",
        f"| cluster: client process | {client:.1f} |",
        f"| cluster: scheduler | {processor_s['scheduler']:.2f} |",
        f"| cluster: {WORKERS} workers | {processor_s['workers']:.1f} |",
        f"| cluster: scheduler, idle, per second | {idle_rates['scheduler']:.3f} |",
        f"| cluster: {WORKERS} workers, idle, per second | {idle_rates['workers']:.3f} |",
        f"| overhead of the cluster over threads, measured | {total - threads_s:.1f}, "
        f"{100 * (total / threads_s - 1):.0f} % |",
        "| overhead of the cluster over threads, for an undisturbed run of "
        f"{undisturbed_s:.0f} s | {overhead:.1f}, {100 * overhead / threads_s:.1f} % |",
    ]
    text = "\n".join(
        [
            (
                f"{SHARDS} shards of {SHARD_TRIALS:,} sensors, {shard:.1f} s of one core each; "
                f"{wall:.0f} s of wall time. {processor_name()}, {WORKERS} cores.{busy}"
            ),
            "",
            "| process | CPU time, s |",
            "|---|---:|",
            *rows,
            "",
            f"Estimate for {MODEL_WORKERS} workers: "
            f"{MODEL_WORKERS / shard:.0f} shards per second, {MODEL_WORKERS * SHARD_TRIALS / shard / 1e6:.1f} "
            f"million sensors, {MODEL_WORKERS / shard * SHARD_TRIALS * 96 / 1e6:.0f} MB/s to the shared disk; then "
            f"at most {1e6 * repeated / (SHARDS * SHARD_TRIALS):.1f} "
            "s of one core per million trials for the reduction.",
        ]
    )
    print(text)
    write_text(out / "tolerance_cluster.md", text + "\n")


if __name__ == "__main__":
    main()
