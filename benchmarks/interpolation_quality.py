"""Measure the PSNR of dewarped images for every interpolation method.

The spherical sensor of the paper captures the room with 64 rays per pixel. The reference is the image of an ideal
camera with the same screen: the mean radiance of the scene over each output pixel with 8 x 8 rays. The room is treated
as infinitely distant, which eliminates parallax. Only pixels inside the field are evaluated.

    python benchmarks/interpolation_quality.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.dewarp.screens import Screen
from omnimirror.simulation.rendering import render_pinhole_image

SAMPLES = 8  # rays per pixel and side
BLOCK_RAYS = 1 << 17  # rays per block, limited by the cache size
S = om.screens
VIEWS: list[tuple[str, Screen]] = [
    ("perspective, 40 deg", S.Plane((640, 480), 20.0, -15.0, 0.0, 40.0)),
    ("perspective, 60 deg", S.Plane((640, 480), 200.0, -20.0, 0.0, 60.0)),
    ("quarter of a panorama", S.Cylinder((960, 480), -60.0, 30.0, 0.0, 90.0)),
    ("panorama", S.Cylinder((1706, 640), -90.0, 45.0)),
    ("dome", S.DomeMaster((1000, 1000), 135.0, "nadir")),
    ("perspective, 140 deg", S.Plane((640, 400), 20.0, -40.0, 0.0, 140.0)),
    ("little planet", S.LittlePlanet((800, 800), 260.0, "nadir")),
    ("panorama", S.Cylinder((854, 320), -90.0, 45.0)),
    ("dome", S.DomeMaster((500, 500), 135.0, "nadir")),
    ("perspective, 100 deg", S.Plane((240, 180), 20.0, -20.0, 0.0, 100.0)),
    ("perspective, 140 deg", S.Plane((200, 125), 20.0, -40.0, 0.0, 140.0)),
    ("little planet", S.LittlePlanet((300, 300), 260.0, "nadir")),
    ("panorama", S.Cylinder((426, 160), -90.0, 45.0)),
    ("dome, thumbnail", S.DomeMaster((200, 200), 135.0, "nadir")),
    ("panorama, thumbnail", S.Cylinder((200, 75), -90.0, 45.0)),
]
METHODS = ("nearest", "linear", "cubic", "area", "auto")
OPENCV_METHODS = {
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos4": cv2.INTER_LANCZOS4,
}


def reference_view(scene: om.Room, screen: Screen) -> np.ndarray:
    """Return the view of an ideal camera, (height, width, 3) uint8."""
    width, height = screen.size
    step = max(1, BLOCK_RAYS // (width * SAMPLES**2))
    u = (np.arange(width * SAMPLES) + 0.5) / SAMPLES - 0.5

    def strip(top: int) -> np.ndarray:
        v = top + (np.arange(min(step, height - top) * SAMPLES) + 0.5) / SAMPLES - 0.5
        return render_pinhole_image(scene, screen.targets_at(*np.meshgrid(u, v)), SAMPLES)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate(list(pool.map(strip, range(0, height, step))))


def psnr(image: np.ndarray, reference: np.ndarray, inside: np.ndarray) -> float:
    return float(
        10 * np.log10(255**2 / np.mean((image[inside].astype(float) - reference[inside]) ** 2))
    )


def scale(coordinates: np.ndarray, axis: int) -> float:
    """Return the median of source pixels per output pixel along an axis."""
    return float(np.nanmedian(np.linalg.norm(np.diff(coordinates, axis=axis), axis=-1)))


def table_row(
    name: str, screen: Screen, sensor: om.Sensor, image: np.ndarray, scene: om.Room
) -> str:
    reference = reference_view(scene, screen)
    coordinates = om.Dewarper(sensor, screen).coordinates()
    inside = np.isfinite(coordinates[..., 0])
    maps = np.moveaxis(np.nan_to_num(coordinates, nan=-10.0).astype(np.float32), -1, 0)
    omnimirror_psnr = [
        psnr(om.Dewarper(sensor, screen, kind)(image), reference, inside) for kind in METHODS
    ]
    opencv_psnr = [
        psnr(cv2.remap(image, *maps, flag), reference, inside) for flag in OPENCV_METHODS.values()
    ]
    best = max(omnimirror_psnr + opencv_psnr)
    cells = [
        f"**{value:.2f}**" if value == best else f"{value:.2f}"
        for value in omnimirror_psnr + opencv_psnr
    ]
    width, height = screen.size
    return (
        f"| {name}, {width} x {height} | {scale(coordinates, 1):.2f} "
        f"x {scale(coordinates, 0):.2f} | {' | '.join(cells)} | "
        f"{omnimirror_psnr[-1] - best:+.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    sensor, scene = om.load_sensor("paper-spherical"), om.Room()
    image = om.render_image(sensor, scene, samples=SAMPLES**2, distant=True)
    lines = [
        "# PSNR of dewarped images, dB",
        "",
        f"Source image of {image.shape[1]} x {image.shape[0]} px; source and "
        f"reference images are rendered with {SAMPLES**2} rays per pixel. "
        f"OpenCV {cv2.__version__}.",
        "",
        f"| view | source px per output px | {' | '.join(METHODS)} | "
        f"{' | '.join(f'cv2 {name}' for name in OPENCV_METHODS)} | auto minus best |",
        "|---|---|" + "---|" * (len(METHODS) + len(OPENCV_METHODS) + 1),
    ]
    for name, screen in VIEWS:
        lines.append(table_row(name, screen, sensor, image, scene))
        print(lines[-1], flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "interpolation_quality.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
