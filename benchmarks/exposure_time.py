"""Measure the rendering time and the sampling error of an image through the whole aperture against Mitsuba 3.

1000 x 1000 pixels, 64 rays per pixel, an environment map of 512 x 1024. All variants run interleaved on all cores;
results are medians of wall time and processor time. Mitsuba renders the same lens, mirror (a mesh of 500 000 triangles,
or its analytic sphere), environment and box filter; only rendering is timed, after a first image. Each variant runs in
a separate process, because llvm_ad_rgb aborts without LLVM 16 or newer; DRJIT_LIBLLVM_PATH specifies its library.

    python benchmarks/exposure_time.py --out out/benchmarks
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from circumstances import circumstances

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.base.files import write_text
from omnimirror.optics.mirrors.as_built import MirrorPose
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment

PIXELS, RAYS = 1000, 64
SENSORS = {"sphere": "paper-spherical", "asphere": "paper-equidistant"}
THEIR_RUNS = 3
MOST_RAYS = 4096  # rays per pixel of the reference image


def sensor_of(name: str, pixels: int = PIXELS) -> om.Sensor:
    from tests.simulation.test_mitsuba_images import small

    return small(name, pixels, MirrorPose())


def timed(function: Callable[[], object]) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    function()
    return time.perf_counter() - wall, time.process_time() - cpu


def theirs(variant: str, name: str) -> tuple[float, float] | str:
    """Return wall-clock and processor seconds of Mitsuba's rendering, or the reason for its
    failure."""
    command = [sys.executable, __file__, "--mitsuba", variant, name]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=600)
    except subprocess.TimeoutExpired:
        return "longer than 10 minutes"
    if run.returncode:
        reason = run.stderr.strip().splitlines()
        return f"did not run ({reason[-1][:60] if reason else run.returncode})"
    wall, cpu = map(float, run.stdout.split()[-2:])
    return wall, cpu


def render_here(variant: str, name: str) -> None:
    """Print the seconds of a rendering in this process, after a warm-up."""
    import mitsuba as mi

    mi.set_variant(variant)
    from tests.simulation import test_mitsuba_images as pictures

    sensor = sensor_of(name)
    _, light = pictures.maps()
    with tempfile.TemporaryDirectory() as folder:
        if name == "paper-spherical":
            mirror = pictures.ball(sensor)
        else:
            path = Path(folder) / "mirror.ply"
            mi.set_variant("scalar_rgb")
            pictures.meshed(mi, sensor, 500, 500).shapes()[0].write_ply(str(path))
            mi.set_variant(variant)
            mirror = {"type": "ply", "filename": str(path)}
        scene = pictures.scene_of(mi, sensor, mirror, light, RAYS)
        if variant != "scalar_rgb":  # no compilation
            np.array(mi.render(scene, spp=RAYS, seed=1))
        print(*timed(lambda: np.array(mi.render(scene, spp=RAYS, seed=2))))


def medians(times: list[tuple[float, float]]) -> tuple[float, float]:
    wall, cpu = (statistics.median(t) for t in zip(*times, strict=True))
    return wall, cpu


def error_db(sensor: om.Sensor, world: Environment, rays: int) -> float:
    """Return the sampling error in sRGB within the mirror image, relative to a reference with more
    rays and another seed."""
    a = srgb_from_linear(expose(sensor, world, samples=rays, blur=True, seed=1))
    b = srgb_from_linear(expose(sensor, world, samples=MOST_RAYS, blur=True, seed=2))
    rows, columns = np.mgrid[: len(a), : len(a)]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    inside = sensor.backproject(pixels).valid.reshape(a.shape[:2])
    return float(-10 * np.log10(np.mean((a - b)[inside] ** 2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--mitsuba", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.mitsuba:
        render_here(*arguments.mitsuba)
        return
    from tests.simulation.test_mitsuba_images import maps

    world = Environment(maps()[0])
    lines = [
        "# A picture through the whole aperture",
        "",
        f"{PIXELS} x {PIXELS} px, {RAYS} rays per pixel for all programs, environment map. "
        f"{circumstances(arguments.runs)}",
        "",
        "| mirror | program | wall, s | processor, s | speed-up, wall | speed-up, processor | sampling error |",
        "|---|---|---|---|---|---|---|",
    ]
    for label, name in SENSORS.items():
        sensor = sensor_of(name)
        expose(sensor, world, samples=1, blur=True)
        ours: list[tuple[float, float]] = []
        chief: list[tuple[float, float]] = []
        rendered: dict[str, list[tuple[float, float] | str]] = {"llvm_ad_rgb": [], "scalar_rgb": []}
        for run in range(arguments.runs):
            ours.append(timed(lambda s=sensor: expose(s, world, samples=RAYS, blur=True)))
            chief.append(timed(lambda s=sensor: expose(s, world, samples=1)))
            for variant, found in rendered.items():
                if run < THEIR_RUNS and not any(isinstance(f, str) for f in found):
                    found.append(theirs(variant, name))
        wall, cpu = medians(ours)
        decibels = error_db(sensor_of(name, 500), world, RAYS)
        lines.append(f"| {label} | omnimirror | {wall:.2f} | {cpu:.2f} | | | {decibels:.1f} dB |")
        for variant, found in rendered.items():
            numbers = [f for f in found if not isinstance(f, str)]
            if not numbers:
                lines.append(f"| {label} | Mitsuba {variant} | {found[-1]} | | | | |")
                continue
            w, c = medians(numbers)
            lines.append(
                f"| {label} | Mitsuba {variant} | {w:.1f} | {c:.1f} | {w / wall:.0f} | {c / cpu:.0f} | |"
            )
        wall, cpu = medians(chief)
        lines.append(f"| {label} | omnimirror, chief rays | {wall:.3f} | {cpu:.3f} | | | |")
        print("\n".join(lines[-4:]), flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out / "exposure_time.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
