"""What a ray costs in PyTorch, forward and backward, in processor time of one core.

A million rays each, in double precision: pixels into rays, and points half a metre to five metres away into pixels; of
the paper's spherical sensor in line and out of line, with and without parameters that learn. Forward is without
gradients; backward is of sums of all that came out, beside the forward pass that records for it.

    python benchmarks/torch_rate.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from circumstances import circumstances

import omnimirror as om
from omnimirror.files import write_text
from omnimirror.mirrors.pose import MirrorPose
from omnimirror.native import backend
from omnimirror.torch import TorchCamera, differentiable

RAYS = 1 << 20
POSES = {"in line": MirrorPose(), "out of line": MirrorPose(1.0, 0.0, 0.0, 1.0, 1.0)}
LEARNED = {"": (), "focal length, tilt, shape": ("focal", "tilt", "shape")}


def asked() -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(1)
    away = rng.normal(size=(RAYS, 3))
    away[:, 2] = -np.abs(away[:, 2])
    away *= rng.uniform(500, 5000, (RAYS, 1)) / np.linalg.norm(away, axis=1)[:, None]
    return {"backproject": torch.from_numpy(rng.uniform(170, 850, (RAYS, 2))), "project": torch.from_numpy(away)}


def nanoseconds(function: Callable[[], object], runs: int) -> float:
    function()
    times = []
    for _ in range(runs):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return statistics.median(times) / RAYS * 1e9


def measured(camera: TorchCamera, method: str, what: torch.Tensor, runs: int) -> tuple[float, float, float]:
    ask, leaf = getattr(camera, method), what.clone().requires_grad_()
    with torch.no_grad():
        forward = nanoseconds(lambda: ask(what), runs)
    recorded = nanoseconds(lambda: ask(leaf), runs)
    both = nanoseconds(lambda: sum(part.sum() for part in ask(leaf)[:-1]).backward(), runs)
    return forward, recorded, both - recorded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    backend.set_threads(1)
    lines = [
        "# Rays in PyTorch",
        "",
        f"{RAYS} rays in float64, PyTorch {torch.__version__}, one core. {circumstances(arguments.runs)}",
        "",
        "| | mirror | learned | forward, ns | rays/s and core | recorded, ns | backward, ns | of forward |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for method, what in asked().items():
        for place, pose in POSES.items():
            sensor = replace(om.load_sensor("paper-spherical"), mirror_pose=pose)
            for learned, free in LEARNED.items():
                forward, recorded, backward = measured(differentiable(sensor, free), method, what, arguments.runs)
                lines.append(
                    f"| {method} | {place} | {learned} | {forward:.0f} | {1e3 / forward:.1f} million "
                    f"| {recorded:.0f} | {backward:.0f} | {backward / forward:.1f} |"
                )
                print(lines[-1], flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out / "torch_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
