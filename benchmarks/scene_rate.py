"""Measure ray-triangle intersections per second of one core, and the rendering time of the bundled scenes.

Triangulated bumpy spheres around the sensor, observed by the mirror of `paper-spherical` at 512 x 512 px: 16 rays per
pixel through the aperture, or the chief ray; one thread. Images have 1000 x 1000 px, 16 rays per pixel, and use all
cores. Times are processor times. The number of bytes is the growth of the process, including the triangle arrays, which
is not measurable for few triangles.

    python benchmarks/scene_rate.py --out out/benchmarks
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
from circumstances import circumstances

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.simulation.pixel_rays import REFLECTED, sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose, trace_bundle
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.street import Street
from omnimirror.simulation.scenes.surfaces import facets

RINGS = (36, 143, 570)  # spheres of 5,000, 82,000 and 1.3 million triangles
TRACED, PIXELS, RAYS = 512, 1000, 16


def sensor_of(pixels: int) -> om.Sensor:
    sensor = om.load_sensor("paper-spherical")
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    return replace(
        sensor,
        imager=replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch),
    )


def ball(rings: int) -> np.ndarray:
    """Return triangles (n, 3, 3) around the origin, mm."""
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    radius = 3000 * (1 + 0.05 * np.sin(9 * turn) * np.sin(7 * polar) * np.sin(polar))
    across, up = radius * np.sin(polar), radius * np.cos(polar)
    points = np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate(
        [np.stack(corners, axis=-2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    )


def rays_of(samples: int, blur: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions (n, 3) of the reflected rays by pixel."""
    bundle = trace_bundle(
        sensor_of(TRACED),
        sampling_plan(samples, blur),
        Radiometry(),
        slice(0, TRACED),
        slice(0, TRACED),
    )
    seeing = bundle.fate == REFLECTED
    return bundle.origins[seeing], bundle.directions[seeing]


def seconds(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def resident() -> int:
    """Return the resident memory of the process in bytes; 0 if unavailable."""
    gc.collect()
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096
    except OSError:
        return 0


def held_each(rings: int) -> float:
    """Return the memory per triangle in bytes, measured in a new process without memory reuse."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
        return alone.submit(_held_each, rings).result()


def _held_each(rings: int) -> float:
    triangles = ball(rings)
    colours = np.ones((len(triangles), 3, 3), np.float32)
    facets(triangles[:100], colours[:100]).first_hits(
        np.zeros((1, 3)), np.ones((1, 3))
    )  # imports the modules that are loaded on first use
    before = resident()
    scene = facets(triangles, colours)
    assert scene.native
    return (resident() - before) / len(triangles)


def of_triangles(rings: int, kinds: list[tuple[np.ndarray, np.ndarray]], runs: int) -> str:
    triangles = ball(rings)
    colours = np.random.default_rng(1).uniform(0, 1, (len(triangles), 3, 3)).astype(np.float32)
    scene = facets(triangles, colours)
    build = seconds(lambda: scene.native)
    rates = [
        len(origins)
        / statistics.median(
            seconds(lambda o=origins, d=directions: scene.first_hits(o, d)) for _ in range(runs)
        )
        for origins, directions in kinds
    ]
    row = [
        f"{len(triangles)}",
        f"{build:.2f}",
        f"{held_each(rings):.0f}" if rings == RINGS[-1] else "",
    ]
    return f"| {' | '.join(row + [f'{rate / 1e6:.1f}' for rate in rates])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    lines = [
        "# Scenes of surfaces",
        "",
        circumstances(arguments.runs).replace(" interleaved", ""),
        "",
    ]
    lines += [
        "| triangles | tree construction, s | bytes per triangle | aperture, Mrays/s | chief rays, Mrays/s |",
        "|---|---|---|---|---|",
    ]
    threads = backend.threads
    backend.set_threads(1)
    kinds = [rays_of(RAYS, True), rays_of(1, False)]
    lines += [of_triangles(rings, kinds, arguments.runs) for rings in RINGS]
    backend.set_threads(threads)
    lines += [
        "",
        f"| {PIXELS} x {PIXELS} px, {RAYS} rays per pixel | CPU time, s | CPU time with aperture, s |",
        "|---|---|---|",
    ]
    sensor = sensor_of(PIXELS)
    for name, scene in {"room": om.Room(), "hall": Hall(), "street": Street()}.items():
        expose(sensor, scene, samples=1)
        sharp, blurred = (
            statistics.median(
                seconds(lambda b=blur, s=scene: expose(sensor, s, samples=RAYS, blur=b))
                for _ in range(arguments.runs)
            )
            for blur in (False, True)
        )
        lines.append(f"| {name} | {sharp:.2f} | {blurred:.2f} |")
    print("\n".join(lines))
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out / "scene_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
