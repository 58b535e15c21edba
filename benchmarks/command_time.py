"""Measure complete commands, from their start until the files are written, for one large image and for a folder.

Each program converts a JPEG of 3840 x 2160 px with a mirror ball to a panorama, as run from a shell: ``DePolar`` of
ImageMagick, which has no mirror model, and the filter v360 of FFmpeg, which supports a distant ball. Then a folder of
JPEGs of 1024 x 1024 px is converted and compared with reading and writing the same files with OpenCV.

    python benchmarks/command_time.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from measurement_conditions import describe_conditions

import omnimirror as om
from omnimirror.base.files import write_text

OMNIMIRROR = [str(Path(sys.executable).with_name("omnimirror")), "dewarp", "--quiet"]
CIRCLE_PX, WIDTH_PX, PANORAMA_HEIGHT_PX = 2160, 3840, 960
BALL = f"{WIDTH_PX / 2},{CIRCLE_PX / 2},{CIRCLE_PX / 2 - 20},320"
CODEC_SCRIPT = """
import sys, cv2
image = cv2.imread(sys.argv[1])
cv2.imwrite(sys.argv[2], image[600:1560], [cv2.IMWRITE_JPEG_QUALITY, 95])
"""
FOLDER_CODEC_SCRIPT = """
import os
import sys
from concurrent.futures import ThreadPoolExecutor
import cv2
cv2.setNumThreads(1)
source, view, target, threads = sys.argv[1:]
views = cv2.imread(view)
def one(name):
    cv2.imread(f"{source}/{name}")
    cv2.imwrite(f"{target}/{name}", views, [cv2.IMWRITE_JPEG_QUALITY, 95])
with ThreadPoolExecutor(int(threads)) as pool:
    list(pool.map(one, sorted(os.listdir(source))))
"""


def measure_costs(
    commands: dict[str, Callable[[], Sequence[str | Path]]], runs: int
) -> dict[str, tuple[float, float]]:
    """Return the medians of wall-clock and processor seconds, interleaved."""
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            start = time.perf_counter()
            process = subprocess.Popen(
                [str(w) for w in command()], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
            )
            stderr = process.stderr.read() if process.stderr else b""
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                sys.exit(f"{name} failed: {stderr.decode()}")
            samples[name].append((time.perf_counter() - start, usage.ru_utime + usage.ru_stime))
    return {name: tuple(np.median(times, axis=0)) for name, times in samples.items()}


def measure_image(folder: Path, runs: int) -> list[str]:
    """Return table rows for each program on one large image."""
    image = om.render_image(om.load_sensor("paper-spherical"), om.Room(), samples=4, low_pass=True)
    large = np.zeros((CIRCLE_PX, WIDTH_PX, 3), np.uint8)
    large[:, (WIDTH_PX - CIRCLE_PX) // 2 : (WIDTH_PX + CIRCLE_PX) // 2] = cv2.resize(
        image, (CIRCLE_PX, CIRCLE_PX), interpolation=cv2.INTER_CUBIC
    )
    source = folder / "ball.jpg"
    om.write_image(source, large)
    crop, size = f"crop={CIRCLE_PX}:{CIRCLE_PX}", f"w={WIDTH_PX}:h={PANORAMA_HEIGHT_PX}"
    imagemagick = next(
        (p for p in ("/usr/bin/convert", "/usr/bin/magick") if Path(p).exists()),
        shutil.which("magick"),
    )
    dewarp = [
        *OMNIMIRROR,
        source,
        "--ball",
        BALL,
        "--size",
        f"{WIDTH_PX}x{PANORAMA_HEIGHT_PX}",
        "-o",
    ]
    commands: dict[str, list[str | Path]] = {
        "omnimirror": [*dewarp, folder / "a.jpg"],
        "omnimirror, linear": [*dewarp, folder / "b.jpg", "--interpolation", "linear"],
    }
    if shutil.which("ffmpeg"):
        ffmpeg = ["ffmpeg", "-y", "-loglevel", "error", "-i", source, "-vf"]
        commands["ffmpeg v360, cubic"] = [
            *ffmpeg,
            f"{crop},v360=ball:e:{size}:interp=cubic",
            "-q:v",
            "2",
            folder / "c.jpg",
        ]
        commands["ffmpeg v360, linear"] = [
            *ffmpeg,
            f"{crop},v360=ball:e:{size}",
            "-q:v",
            "2",
            folder / "d.jpg",
        ]
    if imagemagick:
        polar = [
            "-distort",
            "DePolar",
            f"{CIRCLE_PX / 2} 0 {WIDTH_PX / 2},{CIRCLE_PX / 2}",
            "-resize",
            f"{WIDTH_PX}x{PANORAMA_HEIGHT_PX}!",
        ]
        commands["ImageMagick DePolar"] = [
            imagemagick,
            source,
            *polar,
            "-quality",
            "95",
            folder / "e.jpg",
        ]
    commands["Python and OpenCV, decoding and encoding only"] = [
        sys.executable,
        "-c",
        CODEC_SCRIPT,
        source,
        folder / "f.jpg",
    ]
    results = measure_costs(
        {name: (lambda command=command: command) for name, command in commands.items()}, runs
    )
    best = results["omnimirror"][0]
    return [
        f"| {name} | {s:.2f} | {cpu:.2f} | {s / best:.1f} |" for name, (s, cpu) in results.items()
    ]


def measure_folder(folder: Path, count: int, runs: int) -> list[str]:
    """Return table rows for a folder: each interpolation, and its codecs alone."""
    source, target, view = folder / "in", folder / "out", folder / "view.jpg"
    source.mkdir()
    image = om.render_image(om.load_sensor("paper-spherical"), om.Room(), samples=4, low_pass=True)
    rng = np.random.default_rng(0)
    for k in range(count):
        om.write_image(
            source / f"{k:04d}.jpg",
            (image + rng.normal(0, 2, image.shape)).clip(0, 255).astype(np.uint8),
        )

    def with_empty_output(command: list[str | Path]) -> Callable[[], list[str | Path]]:
        def prepare() -> list[str | Path]:
            shutil.rmtree(target, ignore_errors=True)
            target.mkdir()
            return command

        return prepare

    single_image = [
        *OMNIMIRROR,
        source / "0000.jpg",
        "--sensor",
        "paper-spherical",
        "--size",
        "1440x",
        "-o",
        view,
    ]
    subprocess.run([str(w) for w in single_image], check=True)
    dewarp = [*OMNIMIRROR, source, "--sensor", "paper-spherical", "--size", "1440x", "-o", target]
    commands = {
        interpolation: with_empty_output([*dewarp, "--interpolation", interpolation])
        for interpolation in ("linear", "cubic", "auto")
    }
    codecs = [
        sys.executable,
        "-c",
        FOLDER_CODEC_SCRIPT,
        source,
        view,
        target,
        str(os.cpu_count() or 1),
    ]
    results = measure_costs(
        {
            **commands,
            "OpenCV, decoding and encoding only": with_empty_output(codecs),
            "one image": lambda: single_image,
        },
        runs,
    )
    codec_s, start = results["OpenCV, decoding and encoding only"][1], results.pop("one image")[1]
    return [
        f"| {name} | {s:.2f} | {cpu:.2f} | {1e3 * cpu / count:.1f} | {100 * (cpu / codec_s - 1):+.0f} % |"
        for name, (s, cpu) in results.items()
    ] + [
        "",
        f"omnimirror includes {start:.2f} s for the start of the command and one image.",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--count", type=int, default=1000, help="number of images in the folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        large, many = (
            measure_image(Path(folder), arguments.runs),
            measure_folder(Path(folder), arguments.count, 3),
        )
    text = "\n".join(
        [
            "# Complete commands",
            "",
            describe_conditions(arguments.runs),
            "",
            "One JPEG of 3840 x 2160 px to a panorama of 3840 x 960:",
            "",
            "| program | wall time, s | CPU time, s | ratio to omnimirror |",
            "|---|---:|---:|---:|",
            *large,
            "",
            f"A folder of {arguments.count} JPEGs of 1024 x 1024 px to panoramas of 1440 x 540:",
            "",
            "| interpolation | wall time, s | CPU time, s | CPU time per image, ms | overhead relative to the codecs |",
            "|---|---:|---:|---:|---:|",
            *many,
            "",
        ]
    )
    print(text)
    write_text(arguments.output / "command_time.md", text)


if __name__ == "__main__":
    main()
