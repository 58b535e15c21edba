"""Measure the time per ray in PyTorch, forward and backward, in processor time of one core or on a GPU.

One million rays in double precision: pixels to rays, and points at 0.5 to 5 m to pixels, for the spherical sensor of
the paper, aligned and misaligned, with and without trainable parameters. The forward pass is without gradients; the
backward pass is that of the sum of all outputs and is compared with the recorded forward pass. On a GPU, 16 million
rays are computed at once in both precisions, in device time.

    python benchmarks/torch_rate.py -o out/benchmarks
    python benchmarks/torch_rate.py --device cuda -o out/benchmarks
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from measurement_conditions import describe_conditions

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.interop.torch import TorchCamera, differentiable
from omnimirror.optics.mirrors.mirror import MirrorPose

RAYS = {"cpu": 1 << 20, "cuda": 1 << 24}
RATES = {"cpu": "rays/s per core", "cuda": "rays/s"}
POSES = {"aligned": MirrorPose(), "misaligned": MirrorPose(1.0, 0.0, 0.0, 1.0, 1.0)}
TRAINED = {"": (), "focal length, tilt, shape": ("focal", "tilt", "shape")}


def make_inputs(device: str, dtype: torch.dtype) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(1)
    count = RAYS[device]
    points = rng.normal(size=(count, 3))
    points[:, 2] = -np.abs(points[:, 2])
    points *= rng.uniform(500, 5000, (count, 1)) / np.linalg.norm(points, axis=1)[:, None]
    inputs = {"backproject": rng.uniform(170, 850, (count, 2)), "project": points}
    return {method: torch.from_numpy(rows).to(device, dtype) for method, rows in inputs.items()}


def seconds_of(function: Callable[[], object], device: str) -> float:
    """Return the processor time of one core, or the device time of the GPU."""
    if device == "cpu":
        start = time.process_time()
        function()
        return time.process_time() - start
    start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    start.record()
    function()
    end.record()
    torch.cuda.synchronize()
    return float(start.elapsed_time(end)) * 1e-3


def nanoseconds(function: Callable[[], object], inputs: torch.Tensor, runs: int) -> float:
    """Return the median time per ray, ns."""
    function()
    times = [seconds_of(function, inputs.device.type) for _ in range(runs)]
    return statistics.median(times) / len(inputs) * 1e9


def measure(
    camera: TorchCamera, method: str, inputs: torch.Tensor, runs: int
) -> tuple[float, float, float]:
    operation, leaf = getattr(camera, method), inputs.clone().requires_grad_()
    with torch.no_grad():
        forward = nanoseconds(lambda: operation(inputs), inputs, runs)
    recorded = nanoseconds(lambda: operation(leaf), inputs, runs)
    total = nanoseconds(
        lambda: sum(part.sum() for part in operation(leaf)[:-1]).backward(), inputs, runs
    )
    return forward, recorded, total - recorded


def rows(device: str, dtype: torch.dtype, runs: int) -> Iterator[str]:
    """Yield rows of the table by operation, alignment and learnable parameters."""
    digits = 0 if device == "cpu" else 2
    for method, inputs in make_inputs(device, dtype).items():
        for alignment, pose in POSES.items():
            sensor = replace(om.load_sensor("paper-spherical"), mirror_pose=pose)
            for trained, free in TRAINED.items():
                camera = differentiable(sensor, free, dtype=dtype, device=device)
                forward, recorded, backward = measure(camera, method, inputs, runs)
                yield (
                    f"| {method} | {alignment} | {trained} | {forward:.{digits}f} | {1e3 / forward:.1f} million "
                    f"| {recorded:.{digits}f} | {backward:.{digits}f} | {backward / forward:.1f} |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--device", choices=tuple(RAYS), default="cpu")
    arguments = parser.parse_args()
    device, runs = arguments.device, arguments.runs
    torch.set_num_threads(1)
    backend.set_threads(1)
    lines, device_name = (
        ["# Rays in PyTorch"],
        "one core" if device == "cpu" else torch.cuda.get_device_name(),
    )
    for dtype in (torch.float64,) if device == "cpu" else (torch.float64, torch.float32):
        conditions = (
            f"{RAYS[device]} rays in {str(dtype)[6:]}, PyTorch "
            f"{torch.__version__}, {device_name}. {describe_conditions(runs)}"
        )
        lines += [
            "",
            conditions,
            "",
            f"| | mirror | trained parameters | forward, ns | {RATES[device]} | forward with graph, ns "
            "| backward, ns | backward / forward |",
        ]
        lines.append("|---|---|---|---|---|---|---|---|")
        for line in rows(device, dtype, runs):
            lines.append(line)
            print(line, flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    name = "torch_rate.md" if device == "cpu" else "torch_rate_gpu.md"
    write_text(arguments.output / name, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
