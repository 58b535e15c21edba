"""Measure the time per frame of a moving view (map and resampling) against a table map and a NumPy map.

A spherical mirror in 1000 x 1000 px, views of 1280 x 720 px, bilinear, uint8 RGB; every run has
another direction. ``table map`` is the fastest implementation with NumPy and OpenCV: one product
per pixel, the radius from a table, float32, reused buffers, and ``cv2.remap``. ``NumPy map`` is the
straightforward implementation. Both support distant objects only. All variants run interleaved in
one process with the same number of threads and several consecutive frames per turn, into reused
images; results are medians. *Sampling only* uses a precomputed map, which is the lower bound for
this sampler. The last row is a view of 1920 x 1080 px from frames of 3840 x 2160 px in YUV 4:2:0.

    python benchmarks/moving_views.py -o out/benchmarks --image photograph.jpg
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

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
from omnimirror.cameras.camera import view_axes
from omnimirror.dewarp._source_coordinates import lattice_map_of, polar_map_of
from omnimirror.optics.image_sensor import Imager

RUNS = 7
FRAMES = 24  # consecutive frames; the first ones run with cold caches after 1 s of other work
SOURCE_PX, VIEW_SIZE, HFOV_DEG, TILT_DEG = 1000, (1280, 720), 90.0, -20.0
PANORAMA = (1440, 360)
LARGE_SOURCE, LARGE_VIEW = (3840, 2160), (1920, 1080)
LARGE_ROW = "4K, YUV 4:2:0, distant"
TABLE_SIZE = 1 << 16
Maps = tuple[np.ndarray, np.ndarray]


def sensor() -> om.Sensor:
    return replace(
        om.load_sensor("paper-spherical"),
        imager=Imager(SOURCE_PX, SOURCE_PX, 5.2 * 1024 / SOURCE_PX),
    )


class TableMap:
    """Maps of distant views, about 10 passes over float32 arrays each."""

    def __init__(self, camera: om.Sensor) -> None:
        s = camera.symmetry
        self.centre, self.frame = s.centre_px, np.stack([s.right, s.down, s.axis])
        self.table = self._radius_over_sine(s)
        width, height = VIEW_SIZE
        focal = width / 2 / np.tan(np.radians(HFOV_DEG / 2))
        self.x = ((np.arange(width) - (width - 1) / 2) / focal).astype(np.float32)
        self.y = ((np.arange(height) - (height - 1) / 2) / focal).astype(np.float32)[:, None]
        self.per_length = 1 / np.sqrt(1 + self.x**2 + self.y**2)
        self.u, self.v, self.along = (np.empty((height, width), np.float32) for _ in range(3))
        self.index = np.empty((height, width), np.int32)

    @staticmethod
    def _radius_over_sine(symmetry: om.cameras.camera.AxialSymmetry) -> np.ndarray:
        """Return the radius over sin(Omega/2), up to 1; far outside the image beyond the field."""
        half_sine = (np.arange(TABLE_SIZE) + 0.5) / TABLE_SIZE
        omega = 2 * np.arcsin(half_sine)
        inside = omega <= symmetry.omega_max
        table = np.full(TABLE_SIZE, 1e6)
        table[inside] = symmetry.radius_px(omega[inside]) / np.sin(omega[inside])
        return table.astype(np.float32)

    def __call__(self, pan_deg: float) -> Maps:
        axes = np.stack(view_axes(pan_deg, TILT_DEG), axis=-1)
        for out, (ahead, right, down) in zip(
            (self.u, self.v, self.along), self.frame @ axes, strict=True
        ):
            np.add(
                np.float32(ahead) + np.float32(right) * self.x, np.float32(down) * self.y, out=out
            )
        self.along *= self.per_length
        np.subtract(1, self.along, out=self.along)
        self.along *= np.float32(0.5)
        np.sqrt(self.along, out=self.along)
        self.along *= np.float32(TABLE_SIZE - 1)
        np.copyto(self.index, self.along, casting="unsafe")
        np.take(self.table, self.index, out=self.along, mode="clip")
        self.along *= self.per_length
        for out, centre in zip((self.u, self.v), self.centre, strict=True):
            out *= self.along
            out += np.float32(centre)
        return self.u, self.v


def numpy_map(camera: om.Sensor, omegas: np.ndarray, radii: np.ndarray, pan_deg: float) -> Maps:
    """Return a map by a straightforward implementation: unit vectors, rotation, angles, pixels."""
    s, (width, height) = camera.symmetry, VIEW_SIZE
    focal = width / 2 / np.tan(np.radians(HFOV_DEG / 2))
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    rays = np.stack([np.full_like(x, focal), x, y], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays = (
        rays @ np.stack(view_axes(pan_deg, TILT_DEG)) @ np.stack([s.right, s.down, s.axis], axis=-1)
    )
    omega, phi = np.arccos(rays[..., 2]), np.arctan2(rays[..., 1], rays[..., 0])
    radius = np.interp(omega, omegas, radii, right=1e6)
    u, v = s.centre_px[0] + radius * np.cos(phi), s.centre_px[1] + radius * np.sin(phi)
    return u.astype(np.float32), v.astype(np.float32)


def benchmark_functions(image: np.ndarray) -> dict[str, Callable[[], object]]:
    camera = sensor()
    frame = itertools.count()
    table_map = TableMap(camera)
    omegas = np.linspace(0, camera.symmetry.omega_max, 4096)
    radii = camera.symmetry.radius_px(omegas)

    def pan() -> float:
        return 0.37 * next(frame)

    def view(distance_mm: float) -> om.screens.Plane:
        current_pan_deg = pan()
        distance_mm += 0.1 * current_pan_deg  # a new distance per frame; infinity is unchanged
        return om.screens.Plane(
            VIEW_SIZE, current_pan_deg, TILT_DEG, hfov_deg=HFOV_DEG, distance_mm=distance_mm
        )

    def panorama(distance_mm: float) -> om.screens.Cylinder:
        return om.screens.Cylinder(PANORAMA, -70.0, 40.0, pan(), distance_mm=distance_mm)

    out = {size: np.empty((*size[::-1], 3), np.uint8) for size in (VIEW_SIZE, PANORAMA)}

    planes, large_out = yuv_planes(image, LARGE_SOURCE), yuv_planes(image, LARGE_VIEW)
    large = replace(
        om.load_sensor("paper-spherical"),
        imager=Imager(*LARGE_SOURCE, 5.2 * 1024 / LARGE_SOURCE[1]),
    )

    def large_view() -> None:
        screen = om.screens.Plane(LARGE_VIEW, pan(), TILT_DEG, hfov_deg=HFOV_DEG)
        om.Dewarper(large, screen, "linear").planes(planes, large_out)

    def remap(maps: Maps) -> np.ndarray:
        return cv2.remap(image, *maps, cv2.INTER_LINEAR, out[VIEW_SIZE])

    def dewarp(screen: om.screens.Plane | om.screens.Cylinder) -> np.ndarray:
        return om.Dewarper(camera, screen, "linear")(image, out=out[screen.size])

    stationary = om.Dewarper(
        camera,
        om.screens.Plane(VIEW_SIZE, 30.0, TILT_DEG, hfov_deg=HFOV_DEG),
        "linear",
        keep_map=True,
    )
    stationary(image, out=out[VIEW_SIZE])  # the packed map is used from the second image on
    check(camera, table_map, numpy_map(camera, omegas, radii, 30.0))
    return {
        "NumPy map + cv2.remap": lambda: remap(numpy_map(camera, omegas, radii, pan())),
        "table map + cv2.remap": lambda: remap(table_map(pan())),
        "distant view": lambda: dewarp(view(np.inf)),
        "near view": lambda: dewarp(view(400.0)),
        "sampling only, stationary view": lambda: stationary(image, out=out[VIEW_SIZE]),
        "coordinates of the distant view": lambda: lattice_map_of(camera, view(np.inf)),
        "coordinates of the near view": lambda: lattice_map_of(camera, view(400.0)),
        "distant panorama": lambda: dewarp(panorama(np.inf)),
        "near panorama": lambda: dewarp(panorama(400.0)),
        "coordinates of the near panorama": lambda: polar_map_of(camera, panorama(400.0)),
        LARGE_ROW: large_view,
    }


def yuv_planes(image: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, ...]:
    """Return an image of the given size in YUV 4:2:0."""
    width, height = size
    yuv = cv2.cvtColor(cv2.resize(image, size), cv2.COLOR_RGB2YUV_I420)
    quarter = width * height // 4
    u, v = yuv[height:].reshape(-1)[:quarter], yuv[height:].reshape(-1)[quarter:]
    return yuv[:height], u.reshape(height // 2, width // 2), v.reshape(height // 2, width // 2)


def check(camera: om.Sensor, table_map: TableMap, direct_map: Maps) -> None:
    """Check that all maps yield the same view."""
    coordinates = om.Dewarper(
        camera, om.screens.Plane(VIEW_SIZE, 30.0, TILT_DEG, hfov_deg=HFOV_DEG)
    ).coordinates()
    for maps in (table_map(30.0), direct_map):
        assert np.abs(np.stack(maps, axis=-1) - coordinates).max() < 0.05


def main() -> None:
    arguments = parse_arguments(__doc__.splitlines()[0], RUNS)
    image = cv2.resize(
        load_photograph(arguments.image), (SOURCE_PX, SOURCE_PX), interpolation=cv2.INTER_AREA
    )
    functions = benchmark_functions(image)
    ms = {}
    for threads in arguments.threads:
        set_threads(threads)
        ms[threads] = measure_interleaved(functions, arguments.runs, FRAMES, select_clock(threads))
    headings = [f"{threads} thread{'s' * (threads > 1)}, ms" for threads in ms]
    lines = [
        "# Moving views",
        "",
        describe_conditions(arguments.runs, FRAMES, by_processor_time=True),
        "",
        f"| {' | '.join(['computation per frame', *headings])} | table map / this | NumPy map / this |",
        f"|{'---|' * (len(headings) + 3)}",
    ]
    for name in functions:
        times = [f"{row_ms[name]:.2f}" for row_ms in ms.values()]
        ratios = [
            ", ".join(f"{row_ms[reference] / row_ms[name]:.1f}" for row_ms in ms.values())
            if name.endswith(" view")
            else ""
            for reference in ("table map + cv2.remap", "NumPy map + cv2.remap")
        ]
        ratios = ["", ""] if name.startswith("coordinates") else ratios
        lines.append(f"| {' | '.join([name, *times, *ratios])} |")
    near = ", ".join(
        f"{row_ms['near view'] / row_ms['distant view']:.2f}" for row_ms in ms.values()
    )
    frames = ", ".join(f"{1e3 / row_ms[LARGE_ROW]:.0f}" for row_ms in ms.values())
    lines += [
        "",
        f"Time ratio of a near to a distant view: {near}. Rate for 4K frames: {frames} moving views/s.",
    ]
    print("\n".join(lines))
    write_text(arguments.output / "moving_views.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
