"""Measure complete commands, from their start until the files are written, for one large image and for a folder.

Each program converts a JPEG of 3840 x 2160 px with a mirror ball to a panorama, as run from a shell: ``DePolar`` of
ImageMagick, which has no mirror model, and the filter v360 of FFmpeg, which supports a distant ball. Then a folder of
JPEGs of 1024 x 1024 px is converted and compared with reading and writing the same files with OpenCV.

    python benchmarks/whole_commands.py --out out/benchmarks
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
from circumstances import circumstances

import omnimirror as om
from omnimirror.base.files import write_text

OURS = [str(Path(sys.executable).with_name("omnimirror")), "dewarp", "--quiet"]
SIDE, WIDE, TALL = 2160, 3840, 960
BALL = f"{WIDE / 2},{SIDE / 2},{SIDE / 2 - 20},320"
ALONE = """
import sys, cv2
picture = cv2.imread(sys.argv[1])
cv2.imwrite(sys.argv[2], picture[600:1560], [cv2.IMWRITE_JPEG_QUALITY, 95])
"""
CODECS = """
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


def costs(
    commands: dict[str, Callable[[], Sequence[str | Path]]], runs: int
) -> dict[str, tuple[float, float]]:
    """Return the medians of wall-clock and processor seconds, interleaved."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, words in commands.items():
            begin = time.perf_counter()
            process = subprocess.Popen(
                [str(w) for w in words()], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
            )
            said = process.stderr.read() if process.stderr else b""
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                sys.exit(f"{name} failed: {said.decode()}")
            taken[name].append((time.perf_counter() - begin, usage.ru_utime + usage.ru_stime))
    return {name: tuple(np.median(times, axis=0)) for name, times in taken.items()}


def one_picture(folder: Path, runs: int) -> list[str]:
    """Return table rows for each program on one large image."""
    picture = om.render_image(
        om.load_sensor("paper-spherical"), om.Room(), samples=4, low_pass=True
    )
    large = np.zeros((SIDE, WIDE, 3), np.uint8)
    large[:, (WIDE - SIDE) // 2 : (WIDE + SIDE) // 2] = cv2.resize(
        picture, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC
    )
    source = folder / "ball.jpg"
    om.write_image(source, large)
    crop, size = f"crop={SIDE}:{SIDE}", f"w={WIDE}:h={TALL}"
    im = next(
        (p for p in ("/usr/bin/convert", "/usr/bin/magick") if Path(p).exists()),
        shutil.which("magick"),
    )
    ours = [*OURS, source, "--ball", BALL, "--size", f"{WIDE}x{TALL}", "-o"]
    commands: dict[str, list[str | Path]] = {
        "omnimirror": [*ours, folder / "a.jpg"],
        "omnimirror, linear": [*ours, folder / "b.jpg", "--interpolation", "linear"],
    }
    if shutil.which("ffmpeg"):
        head = ["ffmpeg", "-y", "-loglevel", "error", "-i", source, "-vf"]
        commands["ffmpeg v360, cubic"] = [
            *head,
            f"{crop},v360=ball:e:{size}:interp=cubic",
            "-q:v",
            "2",
            folder / "c.jpg",
        ]
        commands["ffmpeg v360, linear"] = [
            *head,
            f"{crop},v360=ball:e:{size}",
            "-q:v",
            "2",
            folder / "d.jpg",
        ]
    if im:
        polar = [
            "-distort",
            "DePolar",
            f"{SIDE / 2} 0 {WIDE / 2},{SIDE / 2}",
            "-resize",
            f"{WIDE}x{TALL}!",
        ]
        commands["ImageMagick DePolar"] = [im, source, *polar, "-quality", "95", folder / "e.jpg"]
    commands["Python and OpenCV, reading and writing only"] = [
        sys.executable,
        "-c",
        ALONE,
        source,
        folder / "f.jpg",
    ]
    found = costs({name: (lambda words=words: words) for name, words in commands.items()}, runs)
    best = found["omnimirror"][0]
    return [
        f"| {name} | {s:.2f} | {cpu:.2f} | {s / best:.1f} |" for name, (s, cpu) in found.items()
    ]


def many_pictures(folder: Path, count: int, runs: int) -> list[str]:
    """Return table rows for a folder: each interpolation, and its codecs alone."""
    source, target, view = folder / "in", folder / "out", folder / "view.jpg"
    source.mkdir()
    picture = om.render_image(
        om.load_sensor("paper-spherical"), om.Room(), samples=4, low_pass=True
    )
    rng = np.random.default_rng(0)
    for k in range(count):
        om.write_image(
            source / f"{k:04d}.jpg",
            (picture + rng.normal(0, 2, picture.shape)).clip(0, 255).astype(np.uint8),
        )

    def emptied(words: list[str | Path]) -> Callable[[], list[str | Path]]:
        def fresh() -> list[str | Path]:
            shutil.rmtree(target, ignore_errors=True)
            target.mkdir()
            return words

        return fresh

    one = [*OURS, source / "0000.jpg", "--sensor", "paper-spherical", "--size", "1440x", "-o", view]
    subprocess.run([str(w) for w in one], check=True)
    ours = [*OURS, source, "--sensor", "paper-spherical", "--size", "1440x", "-o", target]
    ways = {how: emptied([*ours, "--interpolation", how]) for how in ("linear", "cubic", "auto")}
    codecs = [sys.executable, "-c", CODECS, source, view, target, str(os.cpu_count() or 1)]
    started = [
        *OURS,
        source / "0000.jpg",
        "--sensor",
        "paper-spherical",
        "--size",
        "1440x",
        "-o",
        view,
    ]
    found = costs(
        {
            **ways,
            "OpenCV, reading and writing only": emptied(codecs),
            "one picture": lambda: started,
        },
        runs,
    )
    alone, start = found["OpenCV, reading and writing only"][1], found.pop("one picture")[1]
    return [
        f"| {name} | {s:.2f} | {cpu:.2f} | {1e3 * cpu / count:.1f} | {100 * (cpu / alone - 1):+.0f} % |"
        for name, (s, cpu) in found.items()
    ] + [
        "",
        f"omnimirror includes {start:.2f} s for the start of the command and one image.",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--count", type=int, default=1000, help="number of images in the folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        large, many = (
            one_picture(Path(folder), arguments.runs),
            many_pictures(Path(folder), arguments.count, 3),
        )
    text = "\n".join(
        [
            "# Whole commands",
            "",
            circumstances(arguments.runs),
            "",
            "One JPEG of 3840 x 2160 px to a panorama of 3840 x 960:",
            "",
            "| program | s | processor, s | ratio to omnimirror |",
            "|---|---:|---:|---:|",
            *large,
            "",
            f"A folder of {arguments.count} JPEGs of 1024 x 1024 px to panoramas of 1440 x 540:",
            "",
            "| interpolation | s | processor, s | per image, ms | overhead over the codecs |",
            "|---|---:|---:|---:|---:|",
            *many,
            "",
        ]
    )
    print(text)
    write_text(arguments.out / "whole_commands.md", text)


if __name__ == "__main__":
    main()
