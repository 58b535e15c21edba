"""Interleaved timing of functions on a shared machine, with medians."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def measure_interleaved(
    functions: dict[str, Callable[[], object]],
    runs: int,
    repetitions: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Return the median time per call of each function in ms, interleaved in groups of calls after
    a warm-up."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in range(runs):
        for name, function in functions.items():
            for _ in range(repetitions):
                start = clock()
                function()
                times[name].append(clock() - start)
    return {name: 1e3 * statistics.median(t) for name, t in times.items()}


def measure_wall_and_cpu(
    functions: dict[str, Callable[[], object]], runs: int
) -> dict[str, tuple[float, float]]:
    """Return the median wall-clock and processor time per call of each function in ms, interleaved."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in range(runs):
        for name, function in functions.items():
            wall, cpu = time.perf_counter(), time.process_time()
            function()
            times[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {
        name: tuple(1e3 * statistics.median(t) for t in zip(*samples, strict=True))
        for name, samples in times.items()
    }
