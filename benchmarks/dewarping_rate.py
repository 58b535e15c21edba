"""Measure the dewarping time per frame of the compiled samplers against cv2.remap with fixed-point maps.

All variants run interleaved in one process with the same number of threads; results are medians. Bilinear and bicubic,
uint8 RGB, precomputed maps. The last two columns compute panoramas directly from r(row) and (cos, sin)(column).

*Copy* moves the same number of bytes as a frame on one thread: it reads the map and all 64-byte lines of the image that
contain samples, and writes the output. *In cache* is the packed-map sampler with the same fractions on an image of
64 x 64 px, which is the arithmetic without memory latency. The larger of both is the lower bound for this sampler.

    python benchmarks/dewarping_rate.py -o out/benchmarks --image photograph.jpg
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from measurement_conditions import (
    describe_conditions,
    load_photograph,
    parse_arguments,
    select_clock,
    set_threads,
)
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.dewarp.maps import PixelMap, PolarMap
from omnimirror.dewarp.sampling import remap
from omnimirror.dewarp.screens import Cylinder, Plane

RUNS = 15
FRAMES = 5  # consecutive frames, as in a video
CASES = [
    (1000, (1440, 360), "panorama"),
    (1000, (2880, 720), "panorama"),
    (1000, (1280, 720), "view"),
    (2048, (2880, 720), "panorama"),
    (4096, (2880, 720), "panorama"),
]
IN_CACHE = (64, 64)
OPENCV_FLAGS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}


def mirror_ball(source_px: int) -> om.MirrorBall:
    return om.MirrorBall(
        centre_px=((source_px - 1) / 2, (source_px - 1) / 2),
        rim_radius_px=0.48 * source_px,
        field_deg=270.0,
        image_size=(source_px, source_px),
    )


def make_screen(kind: str, size: tuple[int, int], pan_deg: float = 30.0) -> Cylinder | Plane:
    return (
        Cylinder(size, -70.0, 40.0)
        if kind == "panorama"
        else Plane(size, pan_deg, -20.0, 0.0, 90.0)
    )


def bytes_moved(coordinates: np.ndarray, source_px: int, out: np.ndarray) -> int:
    """Return the bytes of a bilinear frame from a packed map of 6 bytes per pixel."""
    corner = coordinates[~np.isnan(coordinates[..., 0])].astype(int).clip(0, source_px - 2)
    first = (corner[:, 1] * source_px + corner[:, 0]) * 3
    lines = np.unique(
        np.concatenate(
            [(first + row * source_px * 3 + end) // 64 for row in (0, 1) for end in (0, 5)]
        )
    )
    return 64 * len(lines) + 6 * coordinates[..., 0].size + out.nbytes


def measure_rows(photograph: np.ndarray, threads: int, runs: int) -> list[str]:
    """Return rows of fixed maps: packed and fixed-point, and panoramas without a map."""
    rows = []
    for source_px, size, kind in CASES:
        image = cv2.resize(photograph, (source_px, source_px), interpolation=cv2.INTER_AREA)
        camera = mirror_ball(source_px)
        coordinates = om.Dewarper(camera, make_screen(kind, size)).coordinates()
        fixed_point = cv2.convertMaps(
            *np.moveaxis(coordinates.astype(np.float32), -1, 0).copy(), cv2.CV_16SC2
        )
        clock = select_clock(threads)
        out, opencv_out = np.empty((*size[::-1], 3), np.uint8), np.empty((*size[::-1], 3), np.uint8)
        copy_buffer = np.zeros(
            (2, bytes_moved(coordinates, source_px, out) // 2), np.uint8
        )  # half is read, half is written
        for interpolation, flag in OPENCV_FLAGS.items():
            packed = PixelMap(coordinates.astype(np.float32), (source_px, source_px))
            functions: dict[str, Callable[[], object]] = {
                "OpenCV": lambda p=image, m=fixed_point, f=flag, o=opencv_out: cv2.remap(
                    p, *m, f, o
                ),
                "packed": lambda p=image, m=packed, i=interpolation, o=out: remap(p, m, i, o),
            }
            if threads == 1:
                functions["copy"] = lambda m=copy_buffer: np.copyto(m[1], m[0])
                cached_map = PixelMap(
                    (coordinates % IN_CACHE[0]).clip(2, IN_CACHE[0] - 4).astype(np.float32),
                    IN_CACHE,
                )
                cached_image = image[: IN_CACHE[1], : IN_CACHE[0]].copy()
                functions["in cache"] = (
                    lambda p=cached_image, m=cached_map, i=interpolation, o=opencv_out: remap(
                        p, m, i, o
                    )
                )
            remap(
                image, packed, interpolation, out
            )  # the packed map is used from the second image on
            if kind == "panorama":
                centre = np.array(camera.centre_px)
                radii = np.nanmean(np.linalg.norm(coordinates - centre, axis=-1), axis=1)
                angles = np.arctan2(*(coordinates - centre)[size[1] // 2].T[::-1])
                polar = PolarMap(tuple(centre), radii, angles, (source_px, source_px))
                functions["polar"] = lambda p=image, m=polar, i=interpolation, o=out: remap(
                    p, m, i, o
                )
            ms = measure_interleaved(functions, runs, FRAMES, clock)
            packed_ms = ms["packed"]
            lower_bounds = f"{ms['copy']:.2f} | {ms['in cache']:.2f}" if threads == 1 else "|"
            no_map = (
                f"{ms['polar']:.2f} | {ms['OpenCV'] / ms['polar']:.1f}" if "polar" in ms else "|"
            )
            rows.append(
                f"| {source_px} -> {size[0]} x {size[1]} {kind} | {interpolation} | {threads} | {ms['OpenCV']:.2f} | "
                f"{packed_ms:.2f} | {ms['OpenCV'] / packed_ms:.1f} | {lower_bounds} | {no_map} |"
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    arguments = parse_arguments(__doc__.splitlines()[0], RUNS)
    photograph = load_photograph(arguments.image)
    lines = [
        "# Dewarping a frame, uint8 RGB",
        "",
        describe_conditions(arguments.runs, FRAMES, by_processor_time=True),
        "",
        "| source -> output | interpolation | threads | cv2.remap, ms | packed map, ms | ratio | copy, ms |"
        " in cache, ms | no map, ms | ratio |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for threads in arguments.threads:
        set_threads(threads)
        lines += measure_rows(photograph, threads, arguments.runs)
    write_text(arguments.output / "dewarping_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
