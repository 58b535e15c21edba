"""Measure the throughput and overhead of batch processing against a bare loop.

Interleaved rounds of a bare loop (decode, dewarp, encode, write), one thread of the batch runner, one and two worker
processes, and a local Dask cluster with two workers. Each run processes the same images to a new folder; start and
planning are measured with a second job of few images and subtracted. The overhead per image is measured with images so
small that processing is negligible, in processor time. The minimum over the rounds is reported.

    python benchmarks/batch_throughput.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.interop.batch.job import BatchJob, parse_job
from omnimirror.io.images import decode_image_and_metadata, encode_image

MODEL_WORKERS, IMAGES_PER_DAY = 64, 1_000_000


def make_job(folder: Path, name: str, size: str, workers: int) -> BatchJob:
    """Return a job from ``raw`` to a new folder."""
    text = (
        f"[inputs]\nfiles = ['raw']\n[[sensor]]\nfile = 'camera.toml'\n[view.panorama]\n"
        f"view = 'panorama'\nsize = {size}\n[output]\nurl = '{name}'\nformat = '.jpg'\n"
        f"[execution]\nworkers = {workers}\nper_block = 8\n"
    )
    return parse_job(text, folder=folder)


class Cost(NamedTuple):
    """Wall time and processor time of a run, s."""

    wall: float
    processor: float


def run_bare_loop(folder: Path, job: BatchJob) -> Cost:
    """Return the cost of a bare loop on one thread; maps are computed before."""
    camera = om.load_camera(folder / "camera.toml")
    dewarp = om.Dewarper(camera, job.views["panorama"](camera))
    paths = sorted((folder / "raw").iterdir())
    out = Path(job.output_url)
    out.mkdir()
    dewarp(om.read_image(paths[0]), False)
    start = time.perf_counter(), time.process_time()
    for path in paths:
        image, _ = decode_image_and_metadata(path, path.read_bytes())
        (out / path.name).write_bytes(encode_image(path.name, dewarp(image, False)))
    return Cost(time.perf_counter() - start[0], time.process_time() - start[1])


def run_batch(job: BatchJob, scheduler: str) -> Cost:
    """Return the cost of a run, from its second half: without the start of workers and the maps."""
    progress: list[tuple[int, float]] = []
    status = om.batch.run(
        job,
        scheduler=scheduler,
        on_progress=lambda done, total: progress.append((done, time.process_time())),
    )
    assert status.failed == 0
    rows = sorted(row.finished for row in om.batch.plan(job).manifest.rows.values())
    skipped = len(rows) // 2
    wall = (rows[-1] - rows[skipped]) * len(rows) / (len(rows) - 1 - skipped)
    (first, start), (last, end) = progress[len(progress) // 2], progress[-1]
    return Cost(wall, (end - start) * len(rows) / (last - first))


def measure(folder: Path, size: str, rounds: int, address: str) -> dict[str, list[Cost]]:
    """Return the durations of all methods, interleaved."""
    methods: dict[str, Callable[[BatchJob], Cost]] = {
        "bare loop": lambda job: run_bare_loop(folder, job),
        "batch, one thread": lambda job: run_batch(job, "threads"),
        "batch, one process": lambda job: run_batch(job, "processes"),
        "batch, two processes": lambda job: run_batch(job, "processes"),
        "batch, Dask, two workers": lambda job: run_batch(job, address),
    }
    if not address:
        del methods["batch, Dask, two workers"]
    times: dict[str, list[Cost]] = {name: [] for name in methods}
    for number in range(rounds):
        for name, method in methods.items():
            workers = 2 if "two" in name else 1
            backend.set_threads(1)
            job = make_job(folder, f"out-{number}-{len(times[name])}-{workers}", size, workers)
            shutil.rmtree(job.output_url, ignore_errors=True)
            times[name].append(method(job))
            shutil.rmtree(job.output_url)
    return times


def table(times: dict[str, list[Cost]], count: int) -> list[str]:
    """Return the rows of a table of rates."""
    rows = [
        "| method | images/s | relative rate | processor time per image, ms |",
        "|---|---:|---:|---:|",
    ]
    walls = {name: min(cost.wall for cost in costs) for name, costs in times.items()}
    for name, costs in times.items():
        references = {
            "batch, two processes": "batch, one process",
            "batch, Dask, two workers": "batch, two processes",
        }
        reference = references.get(name, "bare loop")
        in_process = "bare" in name or "thread" in name
        processor_ms = f"{1000 * min(c.processor for c in costs) / count:.2f}" if in_process else ""
        ratio = walls[reference] / walls[name]
        rows.append(
            f"| {name} | {count / walls[name]:.1f} | {ratio:.2f} of {reference} | {processor_ms} |"
        )
    return rows


def cluster(stack: ExitStack) -> str:
    """Start a cluster with two workers and return its address."""
    from distributed import LocalCluster

    started = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")
    return str(stack.enter_context(started).scheduler_address)


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
        with ExitStack() as stack:
            address = "" if options.without_dask else cluster(stack)
            large = measure(Path(folder), "[1024, 256]", options.rounds, address)
    with tempfile.TemporaryDirectory() as folder:
        write_images(Path(folder), 5 * options.images, 64)
        small = measure(Path(folder), "[64, 16]", options.rounds, "")
    lines += [
        f"{options.images} JPEG images of 1024 x 1024 px to panoramas of 1024 x 256 px; {processor_name()}, "
        f"{os.cpu_count()} cores.{load_note}",
        "",
        *table(large, options.images),
        "",
        f"{5 * options.images} images of 64 x 64 px, for the overhead per image:",
        "",
        *table(small, 5 * options.images),
        "",
    ]
    count = 5 * options.images
    minima = {name: min(cost.processor for cost in costs) for name, costs in small.items()}
    overhead = (minima["batch, one thread"] - minima["bare loop"]) / count
    cost = min(cost.wall for cost in large["batch, one process"]) / options.images
    rate = MODEL_WORKERS / cost
    lines.append(
        f"Overhead of the runner: {1000 * overhead:.2f} ms per image. Model for {MODEL_WORKERS} workers: "
        f"{rate:.0f} images/s at {1000 * cost:.1f} ms per image and worker; {IMAGES_PER_DAY:,} images per "
        f"day require {IMAGES_PER_DAY * cost / 86400:.2f} workers."
    )
    write_text(options.output / "batch_throughput.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
