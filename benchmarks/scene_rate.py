"""Measure ray-triangle intersections per second of one core, and the rendering time of the bundled scenes.

Triangulated bumpy spheres around the sensor, observed by the mirror of `paper-spherical` at 512 x 512 px: 16 rays per
pixel through the aperture, or the chief ray; one thread. Images have 1000 x 1000 px, 16 rays per pixel, and use all
cores. Times are processor times. The number of bytes is the growth of the process, including the triangle arrays, which
is not measurable for few triangles.

    python benchmarks/scene_rate.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from measurement_conditions import describe_conditions

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.simulation.pixel_rays import REFLECTED, sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose, trace_bundle
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.scene import facets
from omnimirror.simulation.scenes.street import Street

RINGS = (36, 143, 570)  # spheres of 5,000, 82,000 and 1.3 million triangles
TRACED_PX, IMAGE_PX, RAYS = 512, 1000, 16


def make_sensor(pixels: int) -> om.Sensor:
    sensor = om.load_sensor("paper-spherical")
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    return replace(
        sensor,
        imager=replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch),
    )


def bumpy_sphere(rings: int) -> np.ndarray:
    """Return triangles (n, 3, 3) around the origin, mm."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    radius = 3000 * (1 + 0.05 * np.sin(9 * azimuth) * np.sin(7 * polar) * np.sin(polar))
    across, up = radius * np.sin(polar), radius * np.cos(polar)
    points = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), up], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate(
        [np.stack(corners, axis=-2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    )


def reflected_rays(samples: int, blur: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions (n, 3) of the reflected rays by pixel."""
    bundle = trace_bundle(
        make_sensor(TRACED_PX),
        sampling_plan(samples, blur),
        Radiometry(),
        slice(0, TRACED_PX),
        slice(0, TRACED_PX),
    )
    reflected = bundle.outcome == REFLECTED
    return bundle.origins[reflected], bundle.directions[reflected]


def processor_time_s(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def resident_bytes() -> int:
    """Return the resident memory of the process in bytes; 0 if unavailable."""
    gc.collect()
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096
    except OSError:
        return 0


def bytes_per_triangle(rings: int) -> float:
    """Return the memory per triangle in bytes, measured in a new process without memory reuse."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        return executor.submit(_bytes_per_triangle, rings).result()


def _bytes_per_triangle(rings: int) -> float:
    triangles = bumpy_sphere(rings)
    colours = np.ones((len(triangles), 3, 3), np.float32)
    facets(triangles[:100], colours[:100]).first_hits(
        np.zeros((1, 3)), np.ones((1, 3))
    )  # imports the modules that are loaded on first use
    before = resident_bytes()
    scene = facets(triangles, colours)
    assert scene.native
    return (resident_bytes() - before) / len(triangles)


def triangle_row(rings: int, ray_sets: list[tuple[np.ndarray, np.ndarray]], runs: int) -> str:
    triangles = bumpy_sphere(rings)
    colours = np.random.default_rng(1).uniform(0, 1, (len(triangles), 3, 3)).astype(np.float32)
    scene = facets(triangles, colours)
    build = processor_time_s(lambda: scene.native)
    rates = [
        len(origins)
        / statistics.median(
            processor_time_s(lambda o=origins, d=directions: scene.first_hits(o, d))
            for _ in range(runs)
        )
        for origins, directions in ray_sets
    ]
    row = [
        f"{len(triangles)}",
        f"{build:.2f}",
        f"{bytes_per_triangle(rings):.0f}" if rings == RINGS[-1] else "",
    ]
    return f"| {' | '.join(row + [f'{rate / 1e6:.1f}' for rate in rates])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    lines = [
        "# Triangle scenes",
        "",
        describe_conditions(arguments.runs).replace(" interleaved", ""),
        "",
    ]
    lines += [
        "| triangles | tree construction, s | bytes per triangle | aperture, Mrays/s | chief rays, Mrays/s |",
        "|---|---|---|---|---|",
    ]
    threads = backend.threads
    backend.set_threads(1)
    ray_sets = [reflected_rays(RAYS, True), reflected_rays(1, False)]
    lines += [triangle_row(rings, ray_sets, arguments.runs) for rings in RINGS]
    backend.set_threads(threads)
    lines += [
        "",
        f"| {IMAGE_PX} x {IMAGE_PX} px, {RAYS} rays per pixel | CPU time, s | CPU time with aperture, s |",
        "|---|---|---|",
    ]
    sensor = make_sensor(IMAGE_PX)
    for name, scene in {"room": om.Room(), "hall": Hall(), "street": Street()}.items():
        expose(sensor, scene, samples=1)
        sharp, blurred = (
            statistics.median(
                processor_time_s(lambda b=blur, s=scene: expose(sensor, s, samples=RAYS, blur=b))
                for _ in range(arguments.runs)
            )
            for blur in (False, True)
        )
        lines.append(f"| {name} | {sharp:.2f} | {blurred:.2f} |")
    print("\n".join(lines))
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "scene_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
