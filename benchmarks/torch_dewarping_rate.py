"""Measure the frame rate of dewarping PyTorch tensors against the samplers of the package and cv2.remap.

A spherical mirror in 1024 x 1024 px and a view of 1280 x 720 px, three channels, with precomputed
maps. *NumPy* is ``om.Dewarper``, *PyTorch* is ``om.torch.TorchDewarper`` with batches of several
images, *OpenCV* is ``cv2.remap`` with maps of floating-point coordinates. All variants run interleaved;
times are medians. On a GPU, the images and results remain there.

    python benchmarks/torch_dewarping_rate.py -o out/benchmarks
    python benchmarks/torch_dewarping_rate.py --device cuda -o out/benchmarks
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from measurement_conditions import describe_conditions, set_threads
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text

VIEW = om.screens.Plane((1280, 720), 30.0, -20.0, hfov_deg=90.0)
BATCH = {"cpu": 1, "cuda": 16}
FLAGS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
DTYPES = ("uint8", "float32")


def benchmark_functions(
    dtype: str, interpolation: str, device: str
) -> dict[str, tuple[Callable[[], object], int]]:
    """Return functions and the number of images that each of them dewarps."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (1024, 1024, 3), np.uint8).astype(dtype)
    dewarp = om.Dewarper(om.load_sensor("paper-spherical"), VIEW, interpolation, keep_map=True)
    tensor_dewarp = om.torch.TorchDewarper(dewarp)
    batch = torch.from_numpy(image).permute(2, 0, 1).expand(BATCH[device], -1, -1, -1)
    batch = batch.contiguous().to(device)
    out = np.empty((720, 1280, 3), dtype)

    def dewarp_tensors() -> None:
        tensor_dewarp(batch)
        if device == "cuda":
            torch.cuda.synchronize()

    functions: dict[str, tuple[Callable[[], object], int]] = {
        "PyTorch": (dewarp_tensors, len(batch)),
        "NumPy": (lambda: dewarp(image, out=out), 1),
    }
    if interpolation in FLAGS:
        u, v = np.moveaxis(dewarp.coordinates().astype(np.float32), -1, 0)
        flag = FLAGS[interpolation]
        functions["OpenCV"] = (lambda: cv2.remap(image, u, v, flag, dst=out), 1)
    return functions


def rows(device: str, runs: int) -> Iterator[str]:
    """Yield rows of the table, images per second."""
    for dtype in DTYPES:
        for interpolation in ("linear", "cubic", "auto"):
            functions = benchmark_functions(dtype, interpolation, device)
            times = measure_interleaved(
                {name: function for name, (function, _) in functions.items()}, runs, 3
            )
            rates = {name: 1e3 * functions[name][1] / time for name, time in times.items()}
            numbers = [
                f"{rates[name]:.0f}" if name in rates else ""
                for name in ("PyTorch", "NumPy", "OpenCV")
            ]
            yield f"| {interpolation}, {dtype} | {' | '.join(numbers)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--device", choices=tuple(BATCH), default="cpu")
    arguments = parser.parse_args()
    device = arguments.device
    set_threads(arguments.threads)
    torch.set_num_threads(arguments.threads)
    device_name = "CPU" if device == "cpu" else torch.cuda.get_device_name()
    conditions = (
        f"Images/s, {arguments.threads} thread(s) for NumPy and OpenCV; PyTorch {torch.__version__} "
        f"on {device_name}, batches of {BATCH[device]}. {describe_conditions(arguments.runs)}"
    )
    lines = ["# Dewarping of tensors", "", conditions, "", "| | PyTorch | NumPy | OpenCV |"]
    lines.append("|---|---|---|---|")
    for line in rows(device, arguments.runs):
        lines.append(line)
        print(line, flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    suffix = "" if device == "cpu" else "_gpu"
    write_text(arguments.output / f"torch_dewarping_rate{suffix}.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
