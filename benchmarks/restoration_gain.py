"""Measure the gain of restoration: PSNR against the image without blur at 1 % noise, by image radius.

The weights were tuned on three scenes: the room, the street, and clouds of 1/f noise. The results are for other scenes:
the calibration hall, dead leaves with lettering, and photographs in equirectangular files. The image without blur
samples the same areas of the same pixels through a pinhole.

Gains are those of the 8-bit sRGB image for the inner 2/3 of the radius, the outer 1/3, and the worst of ten
rings. *Blur only* is the PSNR without noise; noise alone corresponds to 40 dB. With --best, a column reports the
maximum gain with a specified noise of half to twice the true value, chosen with knowledge of the truth.

    python benchmarks/restoration_gain.py --environment museum.hdr lawn.jpg -o out/benchmarks
    python benchmarks/restoration_gain.py --tuning                # the scenes used for tuning the weights
    python benchmarks/restoration_gain.py --pixels 512 --blur-factors 0.85 1.15   # incorrectly specified blur
    python benchmarks/restoration_gain.py --pixels 256 --jpeg 60 75 92         # JPEG images with estimated noise
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from measurement_conditions import processor_name
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.base.colour import linear_from_srgb, srgb_from_linear
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.dewarp.restoration.deblurring import Restorer
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.scene import Scene
from omnimirror.simulation.scenes.street import Street

NOISE = 0.01
RUNS = 3  # the median is reported; the first run includes memory allocation by the system
SENSORS = ("paper-spherical", "paper-equidistant", "paper-hyperboloidal")
NOISE_FACTORS = (0.5, 0.7, 1.4, 2.0)
CROPS = (
    ("paper-spherical", "dead leaves", (20, 330)),
    ("paper-spherical", "hall", (20, 380)),
    ("paper-hyperboloidal", "dead leaves", (60, 250)),
)
COLUMNS = (
    "sensor",
    "scene",
    "blur only, dB",
    "degraded image, dB",
    "gain, dB",
    "worst ring, dB",
    "CPU time, s",
    "first image, CPU time, s",
)


def dead_leaves(
    width: int = 4096, leaves: int = 14000, smallest_deg: float = 0.53, seed: int = 3
) -> om.Environment:
    """Return occluding discs of all sizes and colours, with edge statistics of natural scenes, and
    lettering."""
    rng = np.random.default_rng(seed)
    height = width // 2
    image = np.full((height, width, 3), 128, np.uint8)
    smallest, largest = smallest_deg * width / 360, width / 14
    radii = 1 / np.sqrt(rng.uniform(1 / largest**2, 1 / smallest**2, leaves))
    for radius in radii:
        u, latitude = rng.random() * width, np.arcsin(rng.uniform(-1, 1))
        v, half_width = (
            (0.5 - latitude / np.pi) * height,
            min(radius / max(np.cos(latitude), 0.05), width / 4),
        )
        colour = rng.uniform(10, 245, 3).tolist()
        for shift in (-width, 0, width):
            centre, axes = (
                (int(16 * (u + shift)), int(16 * v)),
                (int(16 * half_width), int(16 * radius)),
            )
            cv2.ellipse(image, centre, axes, 0, 0, 360, colour, -1, cv2.LINE_8, 4)
    for _ in range(leaves // 64):
        position = (
            int(rng.uniform(0, 0.93) * width),
            int((0.5 - np.arcsin(rng.uniform(-0.9, 0.9)) / np.pi) * height),
        )
        size, colour = rng.uniform(0.1, 0.4) * smallest, rng.uniform(0, 255, 3).tolist()
        cv2.putText(
            image,
            "omnimirror 212",
            position,
            cv2.FONT_HERSHEY_SIMPLEX,
            size,
            colour,
            1 + int(2 * size),
        )
    return om.Environment(linear_from_srgb(image / 255.0))


def clouds(width: int = 4096, seed: int = 11) -> om.Environment:
    """Return noise with correlated colours and 1/f amplitudes."""
    rng = np.random.default_rng(seed)
    height = width // 2
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    frequency[0, 0] = np.inf
    drawn = rng.standard_normal((3, *frequency.shape)) + 1j * rng.standard_normal(
        (3, *frequency.shape)
    )
    grey, *others = np.fft.irfft2(drawn / frequency, (height, width))
    colours = (
        np.stack([grey, *(0.85 * grey + 0.5 * other for other in others)], axis=-1) / grey.std()
    )
    return om.Environment(linear_from_srgb(np.clip(0.45 + 0.2 * colours, 0, 1)).astype(np.float32))


def load_environment(path: Path, saturated: float = 0.005) -> om.Environment:
    """Return an environment with an exposure that saturates at most a given fraction of the image."""
    bright = np.quantile(om.Environment.load(path).light.max(axis=2), 1 - saturated)
    return om.Environment.load(path, gain=min(1.0, 1 / float(bright)))


class Gains(NamedTuple):
    """Result for one image."""

    blurred_db: NDArray[np.float64]
    """PSNR (2,) of the blurred image: inner 2/3 of the radius, outer 1/3."""
    input_db: NDArray[np.float64]
    """PSNR (2,) with noise."""
    gain_db: NDArray[np.float64]
    best_db: NDArray[np.float64]
    """Gain (2,) for the best noise value."""
    tenths_db: NDArray[np.float64]
    """Gains (10,) by radial zone."""
    seconds: float
    images: tuple[Any, Any, Any]
    """Images without blur, degraded, and restored."""


def gains(
    restorer: Restorer,
    scene: Scene,
    noise: float = NOISE,
    seed: int = 1,
    noise_factors: Sequence[float] = (),
    quality: int | None = None,
) -> Gains:
    """Render images with and without blur, add noise, restore and compare; also for scaled noise
    values.

    With a ``quality``, the image is JPEG-coded and its noise is estimated.
    """
    sensor = restorer.camera
    sharp = srgb_from_linear(om.expose(sensor, scene, samples=16))
    blurred = srgb_from_linear(om.expose(sensor, scene, samples=64, blur=True))
    noisy = blurred + noise * np.random.default_rng(seed).standard_normal(blurred.shape)
    degraded = np.rint(255 * np.clip(noisy, 0, 1)).astype(np.uint8)
    if quality is not None:
        degraded = jpeg_round_trip(degraded, quality)
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        restored = restorer(degraded, noise if quality is None else None)
        times.append(time.process_time() - start)
    radius = restorer.radius / sensor.rim_radius_px

    def psnr(image: NDArray[Any], edges: Any) -> NDArray[np.float64]:
        error = ((image / 255.0 - sharp) ** 2).mean(axis=2)
        parts = [error[(a <= radius) & (radius < b)].mean() for a, b in pairwise(edges)]
        return -10 * np.log10(parts)

    thirds, tenths = (0, 2 / 3, 1), np.linspace(0, 1, 11)
    before, after = psnr(degraded, thirds), psnr(restored, thirds)
    others = [psnr(restorer(degraded, share * noise), thirds) for share in noise_factors]
    return Gains(
        psnr(np.asarray(255 * blurred), thirds),
        before,
        after - before,
        np.max([after, *others], axis=0) - before,
        psnr(restored, tenths) - psnr(degraded, tenths),
        float(np.median(times)),
        (np.rint(255 * sharp).astype(np.uint8), degraded, restored),
    )


def jpeg_round_trip(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Encode as JPEG and decode."""
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.ascontiguousarray(
        np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
    )


def with_fewer_pixels(sensor: om.Sensor, pixels: int, f_number: float) -> om.Sensor:
    """Return the sensor with fewer, larger pixels and a lens with the same blur in pixels."""
    imager = type(sensor.imager)(
        pixels, pixels, sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    )
    return replace(sensor, imager=imager, lens=replace(sensor.lens, f_number=f_number))


def table(
    sensors: Sequence[str],
    scenes: dict[str, Scene],
    out: Path,
    noise_factors: Sequence[float],
    pixels: int,
    blur_factors: Sequence[float],
    qualities: Sequence[int],
) -> Iterator[str]:
    """Yield the lines of the table; write the images."""
    columns = [
        *COLUMNS,
        *["best gain, dB"][: len(noise_factors)],
        *(f"worst ring, {times:g} of the specified blur" for times in blur_factors),
        *(f"worst ring, JPEG {quality}" for quality in qualities),
    ]
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for name in sensors:
        sensor = om.load_sensor(name)
        restorer = Restorer(
            with_fewer_pixels(
                sensor, pixels, sensor.lens.f_number * pixels / sensor.imager.width_px
            )
        )
        others = [
            Restorer(restorer.camera, specified=restorer.known.scaled(times).sizes)
            for times in blur_factors
        ]
        uniform = np.full((*restorer.camera.image_size[::-1], 3), 128, np.uint8)
        start = time.process_time()
        restorer(uniform, NOISE)
        first = time.process_time() - start
        for scene, scene_model in scenes.items():
            result = gains(restorer, scene_model, noise_factors=noise_factors)
            pairs = (
                f"{inner:.1f} / {outer:.1f}"
                for inner, outer in (result.blurred_db, result.input_db)
            )
            gain, best = (
                f"{inner:+.2f} / {outer:+.2f}" for inner, outer in (result.gain_db, result.best_db)
            )
            cells = [
                name,
                scene,
                *pairs,
                gain,
                f"{result.tenths_db.min():+.1f}",
                f"{result.seconds:.1f}",
                f"{first:.1f}",
            ]
            cells += [best][: len(noise_factors)] + [
                f"{gains(other, scene_model).tenths_db.min():+.2f}" for other in others
            ]
            cells += [
                f"{gains(restorer, scene_model, quality=q).tenths_db.min():+.2f}" for q in qualities
            ]
            yield f"| {' | '.join(cells)} |"
            for kind, image in zip(("sharp", "given", "restored"), result.images, strict=True):
                om.write_image(out / f"{name}-{scene}-{kind}.png", image)


def crops(out: Path) -> NDArray[np.uint8]:
    """Return crops of the written images at twice their size: without blur, degraded, restored."""
    rows = []
    for name, scene, (top, left) in CROPS:
        kinds = [
            om.read_image(out / f"{name}-{scene}-{kind}.png")
            for kind in ("sharp", "given", "restored")
        ]
        parts = [
            np.kron(kind[top : top + 150, left : left + 200], np.ones((2, 2, 1), np.uint8))
            for kind in kinds
        ]
        rows.append(
            np.hstack(
                [np.pad(part, ((3, 3), (3, 3), (0, 0)), constant_values=255) for part in parts]
            )
        )
    return np.vstack(rows)


def describe_conditions(pixels: int) -> str:
    """Describe the machine of the timings."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    kernels = backend.name if backend.is_compiled else "no compiled"
    return (
        f"`restoration_gain.py`: one image of {pixels} x {pixels} px in colour, {backend.threads} threads on "
        f"{processor_name()}, {os.cpu_count()} cores, {kernels} "
        f"kernels, OpenCV {cv2.__version__}, NumPy {np.__version__}; "
        f"the load average before the run was {load:.0f}. "
        f"*CPU time* is the sum over all cores, as the median of {RUNS} runs; *first image* includes all "
        "preparations for a sensor. Pairs of values refer to the inner 2/3 and the outer 1/3 of the radius.\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument(
        "--environment", type=Path, nargs="*", default=[], help="equirectangular images"
    )
    parser.add_argument("--sensor", nargs="*", default=SENSORS)
    parser.add_argument("--tuning", action="store_true", help="scenes used for tuning")
    parser.add_argument(
        "--best", action="store_true", help="also use other noise values (5 x slower)"
    )
    parser.add_argument(
        "--pixels", type=int, default=1024, help="fewer, larger pixels, same blur in pixels"
    )
    parser.add_argument(
        "--blur-factors",
        type=float,
        nargs="*",
        default=[],
        help="scale factors of the specified blur",
    )
    parser.add_argument(
        "--jpeg",
        type=int,
        nargs="*",
        default=[],
        help="also JPEG-code with these qualities",
    )
    parser.add_argument("--crops", type=Path, help="write crops of the images side by side")
    arguments = parser.parse_args()
    if arguments.tuning:
        name, scenes = (
            "restoration_gain_tuning",
            {"room": om.Room(), "street": Street(), "clouds": clouds()},
        )
    else:
        name, scenes = "restoration_gain", {"hall": Hall(), "dead leaves": dead_leaves()}
        scenes |= {p.stem: load_environment(p) for p in arguments.environment}
    lines = [describe_conditions(arguments.pixels)]
    noise_factors = NOISE_FACTORS if arguments.best else ()
    others = (arguments.blur_factors, arguments.jpeg)
    for line in table(
        arguments.sensor, scenes, arguments.output, noise_factors, arguments.pixels, *others
    ):
        print(line, flush=True)
        lines.append(line)
    write_text(arguments.output / f"{name}.md", "\n".join(lines) + "\n")
    if arguments.crops:
        om.write_image(arguments.crops, crops(arguments.output))


if __name__ == "__main__":
    main()
