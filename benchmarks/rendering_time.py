"""Measure the rendering time and the sampling error of an image through the whole aperture against Mitsuba 3.

1000 x 1000 pixels, 64 rays per pixel, an environment map of 512 x 1024. All variants run interleaved on all cores;
results are medians of wall time and processor time. Mitsuba renders the same lens, mirror (a mesh of 500 000 triangles,
or its analytic sphere), environment and box filter; only rendering is timed, after a first image. Each variant runs in
a separate process, because llvm_ad_rgb aborts without LLVM 16 or newer; DRJIT_LIBLLVM_PATH specifies its library.

    python benchmarks/rendering_time.py -o out/benchmarks
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

from measurement_conditions import describe_conditions

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.base.files import write_text
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment

PIXELS, RAYS = 1000, 64
SENSORS = {"sphere": "paper-spherical", "asphere": "paper-equidistant"}
MITSUBA_RUNS = 3
REFERENCE_RAYS = 4096  # rays per pixel of the reference image


def make_sensor(name: str, pixels: int = PIXELS) -> om.Sensor:
    from tests.simulation.test_mitsuba_images import small

    return small(name, pixels, MirrorPose())


def measure_times(function: Callable[[], object]) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    function()
    return time.perf_counter() - wall, time.process_time() - cpu


def time_mitsuba(variant: str, name: str) -> tuple[float, float] | str:
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


def render_with_mitsuba(variant: str, name: str) -> None:
    """Print the seconds of a rendering in this process, after a warm-up."""
    import mitsuba as mi

    mi.set_variant(variant)
    from tests.simulation import test_mitsuba_images as mitsuba_images

    sensor = make_sensor(name)
    _, light = mitsuba_images.maps()
    with tempfile.TemporaryDirectory() as folder:
        if name == "paper-spherical":
            mirror = mitsuba_images.ball(sensor)
        else:
            path = Path(folder) / "mirror.ply"
            mi.set_variant("scalar_rgb")
            mitsuba_images.meshed(mi, sensor, 500, 500).shapes()[0].write_ply(str(path))
            mi.set_variant(variant)
            mirror = {"type": "ply", "filename": str(path)}
        scene = mitsuba_images.scene_of(mi, sensor, mirror, light, RAYS)
        if variant != "scalar_rgb":  # no compilation
            np.array(mi.render(scene, spp=RAYS, seed=1))
        print(*measure_times(lambda: np.array(mi.render(scene, spp=RAYS, seed=2))))


def medians(times: list[tuple[float, float]]) -> tuple[float, float]:
    wall, cpu = (statistics.median(t) for t in zip(*times, strict=True))
    return wall, cpu


def error_db(sensor: om.Sensor, environment: Environment, rays: int) -> float:
    """Return the sampling error in sRGB within the mirror image, relative to a reference with more
    rays and another seed."""
    a = srgb_from_linear(expose(sensor, environment, samples=rays, blur=True, seed=1))
    b = srgb_from_linear(expose(sensor, environment, samples=REFERENCE_RAYS, blur=True, seed=2))
    rows, columns = np.mgrid[: len(a), : len(a)]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    inside = sensor.backproject(pixels).valid.reshape(a.shape[:2])
    return float(-10 * np.log10(np.mean((a - b)[inside] ** 2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--mitsuba", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.mitsuba:
        render_with_mitsuba(*arguments.mitsuba)
        return
    from tests.simulation.test_mitsuba_images import maps

    environment = Environment(maps()[0])
    lines = [
        "# Rendering through the aperture",
        "",
        f"{PIXELS} x {PIXELS} px, {RAYS} rays per pixel for all programs, environment map. "
        f"{describe_conditions(arguments.runs)}",
        "",
        "| mirror | program | wall time, s | CPU time, s | speed-up, wall time | speed-up, CPU time | sampling error |",
        "|---|---|---|---|---|---|---|",
    ]
    for label, name in SENSORS.items():
        sensor = make_sensor(name)
        expose(sensor, environment, samples=1, blur=True)
        aperture_times: list[tuple[float, float]] = []
        chief_ray_times: list[tuple[float, float]] = []
        rendered: dict[str, list[tuple[float, float] | str]] = {"llvm_ad_rgb": [], "scalar_rgb": []}
        for run in range(arguments.runs):
            aperture_times.append(
                measure_times(lambda s=sensor: expose(s, environment, samples=RAYS, blur=True))
            )
            chief_ray_times.append(
                measure_times(lambda s=sensor: expose(s, environment, samples=1))
            )
            for variant, results in rendered.items():
                if run < MITSUBA_RUNS and not any(isinstance(f, str) for f in results):
                    results.append(time_mitsuba(variant, name))
        wall, cpu = medians(aperture_times)
        decibels = error_db(make_sensor(name, 500), environment, RAYS)
        lines.append(f"| {label} | omnimirror | {wall:.2f} | {cpu:.2f} | | | {decibels:.1f} dB |")
        for variant, results in rendered.items():
            numbers = [f for f in results if not isinstance(f, str)]
            if not numbers:
                lines.append(f"| {label} | Mitsuba {variant} | {results[-1]} | | | | |")
                continue
            mitsuba_wall, mitsuba_cpu = medians(numbers)
            lines.append(
                f"| {label} | Mitsuba {variant} | {mitsuba_wall:.1f} | {mitsuba_cpu:.1f} "
                f"| {mitsuba_wall / wall:.0f} | {mitsuba_cpu / cpu:.0f} | |"
            )
        wall, cpu = medians(chief_ray_times)
        lines.append(f"| {label} | omnimirror, chief rays | {wall:.3f} | {cpu:.3f} | | | |")
        print("\n".join(lines[-4:]), flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "rendering_time.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
