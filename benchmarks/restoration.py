"""What restoring gains: PSNR against the picture without blur, at 1 % noise, over the radius of the picture.

The scenes are none that the method was tuned on: dead leaves with lettering, made here, and environments given as
equirectangular files. Gains are of the sRGB picture in 8 bits, over the inner two thirds of the radius, the
outer third, and the worst of its ten tenths; seconds are those that processors spend on a picture, its blur prepared.

    python benchmarks/restoration.py --environment hall.hdr sunset.hdr --out out/benchmarks
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.files import write_text
from omnimirror.simulate.colour import linear_from_srgb, srgb_from_linear
from omnimirror.simulate.restoration import Restorer
from omnimirror.simulate.scenes import Scene

NOISE = 0.01
SENSORS = ("paper-spherical", "paper-equidistant", "paper-hyperboloidal")
HEADER = "| sensor | scene | given dB, rest / outer | gain, rest / outer | worst tenth | seconds |\n" + "|---" * 6 + "|"


def dead_leaves(width: int = 4096, leaves: int = 14000, smallest_deg: float = 0.53, seed: int = 3) -> om.Environment:
    """Disks of every size and colour that hide each other, as edges do in nature, and lettering."""
    rng = np.random.default_rng(seed)
    height = width // 2
    picture = np.full((height, width, 3), 128, np.uint8)
    smallest, largest = smallest_deg * width / 360, width / 14
    radii = 1 / np.sqrt(rng.uniform(1 / largest**2, 1 / smallest**2, leaves))
    for radius in radii:
        u, latitude = rng.random() * width, np.arcsin(rng.uniform(-1, 1))
        v, wide = (0.5 - latitude / np.pi) * height, min(radius / max(np.cos(latitude), 0.05), width / 4)
        colour = rng.uniform(10, 245, 3).tolist()
        for turn in (-width, 0, width):
            centre, axes = (int(16 * (u + turn)), int(16 * v)), (int(16 * wide), int(16 * radius))
            cv2.ellipse(picture, centre, axes, 0, 0, 360, colour, -1, cv2.LINE_8, 4)
    for _ in range(leaves // 64):
        place = int(rng.uniform(0, 0.93) * width), int((0.5 - np.arcsin(rng.uniform(-0.9, 0.9)) / np.pi) * height)
        size, colour = rng.uniform(0.1, 0.4) * smallest, rng.uniform(0, 255, 3).tolist()
        cv2.putText(picture, "omnimirror 212", place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1 + int(2 * size))
    return om.Environment(linear_from_srgb(picture / 255.0))


def exposed(path: Path, saturated: float = 0.005) -> om.Environment:
    """An environment exposed so that no more than a share of it saturates the picture."""
    bright = np.quantile(om.Environment.load(path).light.max(axis=2), 1 - saturated)
    return om.Environment.load(path, gain=min(1.0, 1 / float(bright)))


class Gains(NamedTuple):
    """Of one picture."""

    given_db: tuple[float, float]
    """PSNR of the noisy, blurred picture: the inner two thirds of the radius, the outer third."""
    gain_db: tuple[float, float]
    tenths_db: NDArray[np.float64]
    """(10,) gains by tenths of the radius."""
    seconds: float
    pictures: tuple[Any, Any, Any]
    """Without blur, as given, and restored."""


def gains(restorer: Restorer, scene: Scene, noise: float = NOISE, seed: int = 1) -> Gains:
    """Take the picture with and without blur, add noise, restore, and compare."""
    sensor = restorer.sensor
    sharp = srgb_from_linear(om.expose(sensor, scene, 16))
    blurred = srgb_from_linear(om.expose(sensor, scene, 64, blur=True))
    noisy = blurred + noise * np.random.default_rng(seed).standard_normal(blurred.shape)
    given = np.rint(255 * np.clip(noisy, 0, 1)).astype(np.uint8)
    start = time.process_time()
    restored = restorer(given, noise)
    seconds = time.process_time() - start
    radius = restorer.radius / sensor.rim_radius_px

    def psnr(picture: NDArray[np.uint8], edges: Any) -> NDArray[np.float64]:
        error = ((picture / 255.0 - sharp) ** 2).mean(axis=2)
        parts = [error[(a <= radius) & (radius < b)].mean() for a, b in pairwise(edges)]
        return -10 * np.log10(parts)

    thirds, tenths = (0, 2 / 3, 1), np.linspace(0, 1, 11)
    before, after = psnr(given, thirds), psnr(restored, thirds)
    return Gains(
        tuple(before), tuple(after - before), psnr(restored, tenths) - psnr(given, tenths), seconds,
        (np.rint(255 * sharp).astype(np.uint8), given, restored),
    )  # fmt: skip


def faster(sensor: om.Sensor, pixels: int, f_number: float) -> om.Sensor:
    """The sensor with fewer and larger pixels, and a lens that blurs as many of them."""
    imager = type(sensor.imager)(pixels, pixels, sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels)
    return replace(sensor, imager=imager, lens=replace(sensor.lens, f_number=f_number))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--environment", type=Path, nargs="*", default=[], help="equirectangular pictures")
    parser.add_argument("--sensor", nargs="*", default=SENSORS)
    arguments = parser.parse_args()
    scenes = {"dead leaves": dead_leaves()} | {p.stem: exposed(p) for p in arguments.environment}
    rows = [HEADER]
    for name in arguments.sensor:
        restorer = Restorer(om.load_sensor(name))
        _ = restorer.blur
        for scene, environment in scenes.items():
            found = gains(restorer, environment)
            (g0, g1), (d0, d1) = found.given_db, found.gain_db
            rows.append(
                f"| {name} | {scene} | {g0:.1f} / {g1:.1f} | {d0:+.2f} / {d1:+.2f} | {found.tenths_db.min():+.1f} | "
                f"{found.seconds:.0f} |"
            )
            print(rows[-1], flush=True)
            for kind, picture in zip(("sharp", "given", "restored"), found.pictures, strict=True):
                om.write_image(arguments.out / f"{name}-{scene}-{kind}.png", np.ascontiguousarray(picture[..., ::-1]))
    write_text(arguments.out / "restoration.md", "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
