"""Measure the dewarping time per frame of the compiled samplers against cv2.remap with fixed-point maps.

All variants run interleaved in one process with the same number of threads; results are medians. Bilinear and bicubic,
uint8 RGB, precomputed maps. The last two columns compute panoramas directly from r(row) and (cos, sin)(column).

*Copy* moves the same number of bytes as a frame on one thread: it reads the map and all 64-byte lines of the image that
contain samples, and writes the output. *In cache* is the packed-map sampler with the same fractions on an image of
64 x 64 px, which is the arithmetic without memory latency. The larger of both is the lower bound for this sampler.

    python benchmarks/straightening_rate.py --out out/benchmarks --picture photograph.jpg
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from circumstances import arguments_of, circumstances, clock_of, photograph_of, set_threads
from timing import interleaved

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
CV = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}


def camera_of(side: int) -> om.MirrorBall:
    return om.MirrorBall(
        centre_px=((side - 1) / 2, (side - 1) / 2),
        rim_radius_px=0.48 * side,
        field_deg=270.0,
        image_size=(side, side),
    )


def screen_of(kind: str, size: tuple[int, int], pan_deg: float = 30.0) -> Cylinder | Plane:
    return (
        Cylinder(size, -70.0, 40.0)
        if kind == "panorama"
        else Plane(size, pan_deg, -20.0, 0.0, 90.0)
    )


def bytes_moved(coordinates: np.ndarray, side: int, out: np.ndarray) -> int:
    """Return the bytes of a bilinear frame from a packed map of 6 bytes per pixel."""
    corner = coordinates[~np.isnan(coordinates[..., 0])].astype(int).clip(0, side - 2)
    first = (corner[:, 1] * side + corner[:, 0]) * 3
    lines = np.unique(
        np.concatenate([(first + row * side * 3 + end) // 64 for row in (0, 1) for end in (0, 5)])
    )
    return 64 * len(lines) + 6 * coordinates[..., 0].size + out.nbytes


def fixed_rows(photograph: np.ndarray, threads: int, runs: int) -> list[str]:
    """Return rows of fixed maps: packed and fixed-point, and panoramas without a map."""
    rows = []
    for side, size, kind in CASES:
        picture = cv2.resize(photograph, (side, side), interpolation=cv2.INTER_AREA)
        camera = camera_of(side)
        coordinates = om.Dewarper(camera, screen_of(kind, size)).coordinates()
        fixed_point = cv2.convertMaps(
            *np.moveaxis(coordinates.astype(np.float32), -1, 0).copy(), cv2.CV_16SC2
        )
        clock = clock_of(threads)
        out, other = np.empty((*size[::-1], 3), np.uint8), np.empty((*size[::-1], 3), np.uint8)
        moved = np.zeros(
            (2, bytes_moved(coordinates, side, out) // 2), np.uint8
        )  # half is read, half is written
        for interpolation, flag in CV.items():
            packed = PixelMap(coordinates.astype(np.float32), (side, side))
            functions: dict[str, Callable[[], object]] = {
                "OpenCV": lambda p=picture, m=fixed_point, f=flag, o=other: cv2.remap(p, *m, f, o),
                "packed": lambda p=picture, m=packed, i=interpolation, o=out: remap(p, m, i, o),
            }
            if threads == 1:
                functions["copy"] = lambda m=moved: np.copyto(m[1], m[0])
                near = PixelMap(
                    (coordinates % IN_CACHE[0]).clip(2, IN_CACHE[0] - 4).astype(np.float32),
                    IN_CACHE,
                )
                small = picture[: IN_CACHE[1], : IN_CACHE[0]].copy()
                functions["in cache"] = lambda p=small, m=near, i=interpolation, o=other: remap(
                    p, m, i, o
                )
            remap(
                picture, packed, interpolation, out
            )  # the packed map is used from the second image on
            if kind == "panorama":
                centre = np.array(camera.centre_px)
                radii = np.nanmean(np.linalg.norm(coordinates - centre, axis=-1), axis=1)
                angles = np.arctan2(*(coordinates - centre)[size[1] // 2].T[::-1])
                polar = PolarMap(tuple(centre), radii, angles, (side, side))
                functions["polar"] = lambda p=picture, m=polar, i=interpolation, o=out: remap(
                    p, m, i, o
                )
            ms = interleaved(functions, runs, FRAMES, clock)
            ours = ms["packed"]
            floors = f"{ms['copy']:.2f} | {ms['in cache']:.2f}" if threads == 1 else "|"
            no_map = (
                f"{ms['polar']:.2f} | {ms['OpenCV'] / ms['polar']:.1f}" if "polar" in ms else "|"
            )
            rows.append(
                f"| {side} -> {size[0]} x {size[1]} {kind} | {interpolation} | {threads} | {ms['OpenCV']:.2f} | "
                f"{ours:.2f} | {ms['OpenCV'] / ours:.1f} | {floors} | {no_map} |"
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    arguments = arguments_of(__doc__.splitlines()[0], RUNS)
    photograph = photograph_of(arguments.picture)
    lines = [
        "# Dewarping a frame, uint8 RGB",
        "",
        circumstances(arguments.runs, FRAMES, by_processor_time=True),
        "",
        "| source -> output | interpolation | threads | cv2.remap, ms | packed map, ms | ratio | copy, ms |"
        " in cache, ms | no map, ms | ratio |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for threads in arguments.threads:
        set_threads(threads)
        lines += fixed_rows(photograph, threads, arguments.runs)
    write_text(arguments.out / "straightening_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
