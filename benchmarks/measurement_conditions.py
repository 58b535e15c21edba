"""Common functions of the dewarping benchmarks: image, threads and description of the machine."""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

import omnimirror as om
from omnimirror.base.native import backend


def parse_arguments(description: str, runs: int) -> argparse.Namespace:
    """Parse the common options."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--image", type=Path, help="photograph; noise by default")
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 4])
    return parser.parse_args()


def load_photograph(path: Path | None) -> np.ndarray:
    """Return a large colour image."""
    return (
        om.read_image(path)
        if path
        else np.random.default_rng(0).integers(0, 255, (2000, 2000, 3), np.uint8)
    )


def set_threads(count: int) -> None:
    """Set the number of threads of all compared programs."""
    backend.set_threads(count)
    cv2.setNumThreads(count)


def select_clock(threads: int) -> Callable[[], float]:
    """Return the clock: processor time for one thread, because it is independent of other load,
    otherwise wall-clock time."""
    return time.thread_time if threads == 1 else time.perf_counter


def describe_conditions(runs: int, repetitions: int = 1, by_processor_time: bool = False) -> str:
    """Describe method and machine in one paragraph."""
    repeated = f" of {repetitions} repetitions" if repetitions > 1 else ""
    clock = "; processor time for one thread" if by_processor_time else ""
    return (
        f"`{Path(sys.argv[0]).name}` on {processor_name()}, {os.cpu_count()} cores, {backend.name} samplers, OpenCV "
        f"{cv2.__version__}, NumPy {np.__version__}; medians of "
        f"{runs} interleaved runs{repeated}{clock}.{load_warning()}"
    )


def load_warning() -> str:
    """Return a warning if other processes load the machine."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return (
        f" The load average before the run was {load:.0f}."
        if load > 0.5 * (os.cpu_count() or 1)
        else ""
    )


def processor_name() -> str:
    """Return the name of the processor, if available."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
