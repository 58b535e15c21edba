"""Measure the time per ray in PyTorch, forward and backward, in processor time of one core or on a GPU.

One million rays in double precision: pixels to rays, and points at 0.5 to 5 m to pixels, for the spherical sensor of
the paper, aligned and misaligned, with and without trainable parameters. The forward pass is without gradients; the
backward pass is that of the sum of all outputs and is compared with the recorded forward pass. On a GPU, 16 million
rays are computed at once in both precisions, in device time.

    python benchmarks/torch_rate.py --out out/benchmarks
    python benchmarks/torch_rate.py --device cuda --out out/benchmarks
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
from circumstances import circumstances

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.interop.torch import TorchCamera, differentiable
from omnimirror.optics.mirrors.as_built import MirrorPose

RAYS = {"cpu": 1 << 20, "cuda": 1 << 24}
RATES = {"cpu": "rays/s per core", "cuda": "rays/s"}
POSES = {"aligned": MirrorPose(), "misaligned": MirrorPose(1.0, 0.0, 0.0, 1.0, 1.0)}
LEARNED = {"": (), "focal length, tilt, shape": ("focal", "tilt", "shape")}


def asked(device: str, dtype: torch.dtype) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(1)
    count = RAYS[device]
    away = rng.normal(size=(count, 3))
    away[:, 2] = -np.abs(away[:, 2])
    away *= rng.uniform(500, 5000, (count, 1)) / np.linalg.norm(away, axis=1)[:, None]
    what = {"backproject": rng.uniform(170, 850, (count, 2)), "project": away}
    return {method: torch.from_numpy(rows).to(device, dtype) for method, rows in what.items()}


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


def nanoseconds(function: Callable[[], object], what: torch.Tensor, runs: int) -> float:
    """Return the median time per ray, ns."""
    function()
    times = [seconds_of(function, what.device.type) for _ in range(runs)]
    return statistics.median(times) / len(what) * 1e9


def measured(
    camera: TorchCamera, method: str, what: torch.Tensor, runs: int
) -> tuple[float, float, float]:
    ask, leaf = getattr(camera, method), what.clone().requires_grad_()
    with torch.no_grad():
        forward = nanoseconds(lambda: ask(what), what, runs)
    recorded = nanoseconds(lambda: ask(leaf), what, runs)
    both = nanoseconds(lambda: sum(part.sum() for part in ask(leaf)[:-1]).backward(), what, runs)
    return forward, recorded, both - recorded


def rows(device: str, dtype: torch.dtype, runs: int) -> Iterator[str]:
    """Yield rows of the table by operation, alignment and learnable parameters."""
    digits = 0 if device == "cpu" else 2
    for method, what in asked(device, dtype).items():
        for place, pose in POSES.items():
            sensor = replace(om.load_sensor("paper-spherical"), mirror_pose=pose)
            for learned, free in LEARNED.items():
                camera = differentiable(sensor, free, dtype=dtype, device=device)
                forward, recorded, backward = measured(camera, method, what, runs)
                yield (
                    f"| {method} | {place} | {learned} | {forward:.{digits}f} | {1e3 / forward:.1f} million "
                    f"| {recorded:.{digits}f} | {backward:.{digits}f} | {backward / forward:.1f} |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--device", choices=tuple(RAYS), default="cpu")
    arguments = parser.parse_args()
    device, runs = arguments.device, arguments.runs
    torch.set_num_threads(1)
    backend.set_threads(1)
    lines, where = (
        ["# Rays in PyTorch"],
        "one core" if device == "cpu" else torch.cuda.get_device_name(),
    )
    for dtype in (torch.float64,) if device == "cpu" else (torch.float64, torch.float32):
        about = f"{RAYS[device]} rays in {str(dtype)[6:]}, PyTorch {torch.__version__}, {where}. {circumstances(runs)}"
        rate = "rays/s per core" if device == "cpu" else "rays/s"
        lines += [
            "",
            about,
            "",
            f"| | mirror | trained parameters | forward, ns | {rate} | forward with graph, ns "
            "| backward, ns | backward / forward |",
        ]
        lines.append("|---|---|---|---|---|---|---|---|")
        for line in rows(device, dtype, runs):
            lines.append(line)
            print(line, flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    name = "torch_rate.md" if device == "cpu" else "torch_rate_card.md"
    write_text(arguments.out / name, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
