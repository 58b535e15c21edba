"""Measure the throughput and overhead of batch processing against a bare loop.

Interleaved rounds of a bare loop (decode, dewarp, encode, write) in one and in two independent processes, the batch
runner with one thread, one and two worker processes, and a local Dask cluster with two workers. Each run writes to a
new folder. Rates and processor times exclude the start: they are those of the second half of the images of a run. The
medians of the rates and of their ratios in each round, and the minimum processor time, are reported. Two independent
bare loops show how much of two cores is available: the ratios of two workers are to be compared with theirs.

    python benchmarks/batch_throughput.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.interop.batch.job import BatchJob, parse_job
from omnimirror.io.images import decode_image_and_metadata, encode_image

MODEL_WORKERS, IMAGES_PER_DAY = 64, 1_000_000
BARE, BARE_TWO = "bare loop", "bare loop, two processes"
THREAD, PROCESS = "batch, one thread", "batch, one process"
TWO, DASK = "batch, two processes", "batch, Dask, two workers"
REFERENCES = {BARE_TWO: BARE, THREAD: BARE, PROCESS: BARE, TWO: PROCESS, DASK: TWO}


def make_job(folder: Path, name: str, size: str, workers: int, per_block: int = 4) -> BatchJob:
    """Return a job from ``raw`` to a new folder."""
    text = (
        f"[inputs]\nfiles = ['raw']\n[[sensor]]\nfile = 'camera.toml'\n[view.panorama]\n"
        f"view = 'panorama'\nsize = {size}\n[output]\nurl = '{name}'\nformat = '.jpg'\n"
        f"[execution]\nworkers = {workers}\nper_block = {per_block}\n"
    )
    return parse_job(text, folder=folder)


class Cost(NamedTuple):
    """Images per second, and processor time of all processes per image in ms."""

    rate: float
    processor_ms: float


def bare_loop(job: BatchJob, name: str, barrier: Barrier, costs: Any) -> None:
    """Process all images on one thread; report the cost of the second half."""
    backend.set_threads(1)
    camera = om.load_camera(job.folder / "camera.toml")
    dewarp = om.Dewarper(camera, job.views["panorama"](camera))
    paths = sorted((job.folder / "raw").iterdir())
    out = Path(job.output_url) / name
    out.mkdir(parents=True)
    dewarp(om.read_image(paths[0]), False)
    barrier.wait()
    start = time.perf_counter(), time.process_time()
    for number, path in enumerate(paths):
        if number == len(paths) // 2:
            start = time.perf_counter(), time.process_time()
        image, _ = decode_image_and_metadata(path, path.read_bytes())
        (out / path.name).write_bytes(encode_image(path.name, dewarp(image, False)))
    count = len(paths) - len(paths) // 2
    wall, processor = time.perf_counter() - start[0], time.process_time() - start[1]
    costs.put(Cost(count / wall, 1000 * processor / count))


def run_bare_loops(job: BatchJob, processes: int) -> Cost:
    """Return the cost of independent processes, which process all images each."""
    context = multiprocessing.get_context("spawn")
    barrier, queue = context.Barrier(processes), context.Queue()
    loops = [
        context.Process(target=bare_loop, args=(job, str(number), barrier, queue))
        for number in range(processes)
    ]
    for loop in loops:
        loop.start()
    costs: list[Cost] = [queue.get() for _ in loops]
    for loop in loops:
        loop.join()
    return Cost(sum(c.rate for c in costs), sum(c.processor_ms for c in costs) / processes)


def usage() -> tuple[float, float]:
    """Return the wall time, and the processor time of this process and its children, s."""
    own = psutil.Process()
    times = [process.cpu_times() for process in (own, *own.children(recursive=True))]
    return time.perf_counter(), sum(each.user + each.system for each in times)


def run_batch(job: BatchJob, scheduler: str) -> Cost:
    """Return the cost of a run."""
    progress: list[tuple[int, float, float]] = []

    def record(done: int, total: int) -> None:
        if done == total or (done >= total // 2 and not progress):
            progress.append((done, *usage()))

    status = om.batch.run(job, scheduler=scheduler, on_progress=record)
    assert status.failed == 0
    (first, wall, processor), (last, wall_end, processor_end) = progress
    count = last - first
    return Cost(count / (wall_end - wall), 1000 * (processor_end - processor) / count)


def measure(
    folder: Path, size: str, rounds: int, per_block: int, with_dask: bool
) -> dict[str, list[Cost]]:
    """Return the costs of all methods, interleaved."""
    methods: dict[str, Callable[[BatchJob], Cost]] = {
        BARE: lambda job: run_bare_loops(job, 1),
        BARE_TWO: lambda job: run_bare_loops(job, 2),
        THREAD: lambda job: run_batch(job, "threads"),
        PROCESS: lambda job: run_batch(job, "processes"),
        TWO: lambda job: run_batch(job, "processes"),
        DASK: lambda job: run_batch(job, "local"),
    }
    if not with_dask:
        del methods[DASK]
    costs: dict[str, list[Cost]] = {name: [] for name in methods}
    for number in range(rounds):
        for name, method in methods.items():
            workers = 2 if "two" in name else 1
            backend.set_threads(1)
            output = f"out-{number}-{list(methods).index(name)}"
            costs[name].append(method(make_job(folder, output, size, workers, per_block)))
            shutil.rmtree(folder / output)
            print(f"{name}: {costs[name][-1]}", file=sys.stderr, flush=True)
    return costs


def median_rate(costs: list[Cost]) -> float:
    """Return the median rate of several rounds."""
    return statistics.median(cost.rate for cost in costs)


def median_ratio(costs: list[Cost], reference: list[Cost]) -> float:
    """Return the median over the rounds of the ratio of the rates of two methods."""
    pairs = zip(costs, reference, strict=True)
    return statistics.median(cost.rate / other.rate for cost, other in pairs)


def min_processor_ms(costs: list[Cost]) -> float:
    """Return the minimum processor time per image of several rounds, ms."""
    return min(cost.processor_ms for cost in costs)


def table(costs: dict[str, list[Cost]]) -> list[str]:
    """Return the rows of a table of rates."""
    rows = [
        "| method | images/s | relative rate | processor time per image, ms |",
        "|---|---:|---:|---:|",
    ]
    for name, runs in costs.items():
        reference = REFERENCES.get(name, BARE)
        relative = f"{median_ratio(runs, costs[reference]):.2f} of {reference}"
        rows.append(
            f"| {name} | {median_rate(runs):.1f} | {relative} | {min_processor_ms(runs):.2f} |"
        )
    return rows


def write_images(folder: Path, count: int, width: int) -> None:
    """Write a camera of a size and photographs as JPEG."""
    scale = width / 1024
    camera = om.Unified(
        xi=0.9,
        focal_px=(300.0 * scale, 300.0 * scale),
        centre_px=(width / 2 - 0.5, width / 2 - 0.5),
        image_size=(width, width),
    )
    om.save_camera(camera, folder / "camera.toml")
    rng = np.random.default_rng(0)
    for number in range(count):
        coarse = rng.integers(0, 255, (width // 8, width // 8, 3), dtype=np.uint8)
        image = np.repeat(np.repeat(coarse, 8, 0), 8, 1)
        om.write_image(folder / "raw" / f"{number:05d}.jpg", image)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--images", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--without-dask", action="store_true")
    options = parser.parse_args()
    lines = []
    load_note = load_warning()
    with tempfile.TemporaryDirectory() as folder:
        write_images(Path(folder), options.images, 1024)
        large = measure(Path(folder), "[1024, 256]", options.rounds, 8, not options.without_dask)
    with tempfile.TemporaryDirectory() as folder:
        write_images(Path(folder), 5 * options.images, 64)
        small = measure(Path(folder), "[64, 16]", options.rounds, 32, False)
    lines += [
        f"{options.images} JPEG images of 1024 x 1024 px to panoramas of 1024 x 256 px; {processor_name()}, "
        f"{os.cpu_count()} cores.{load_note}",
        "",
        *table(large),
        "",
        f"{5 * options.images} images of 64 x 64 px, for the overhead per image:",
        "",
        *table(small),
        "",
    ]
    overhead_ms = min_processor_ms(small[PROCESS]) - min_processor_ms(small[BARE])
    cost_ms = min_processor_ms(large[PROCESS])
    rate = 1000 * MODEL_WORKERS / cost_ms
    ratio = median_ratio(large[TWO], large[PROCESS])
    bare_ratio = median_ratio(large[BARE_TWO], large[BARE])
    lines.append(
        f"Overhead of the runner: {overhead_ms:.2f} ms of processor time per image. Two worker processes reach "
        f"{ratio:.2f} times one; two independent bare loops {bare_ratio:.2f} times one. Model for {MODEL_WORKERS} "
        f"workers with one core each: {rate:.0f} images/s at {cost_ms:.1f} ms per image; {IMAGES_PER_DAY:,} images "
        f"per day require {IMAGES_PER_DAY * cost_ms / 86_400_000:.2f} workers."
    )
    write_text(options.output / "batch_throughput.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
