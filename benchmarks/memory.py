"""Measure the peak memory of commands on images of 20,000 x 20,000 px.

The reference is the memory of the images and tables that a command reads and writes (three bytes per pixel for images).
The sensor is that of the paper with smaller pixels; the first command renders its image. This program itself uses
little memory, because a child process starts with the peak memory of its parent.

    python benchmarks/memory.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import omnimirror as om
from omnimirror.base.files import write_text

PROGRAM = str(Path(sys.executable).with_name("omnimirror"))


def peak_memory_mb(command: list[str], folder: Path) -> float:
    """Return the peak memory of one command, MB."""
    process = subprocess.Popen(
        [PROGRAM, *command], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    stderr = process.stderr.read() if process.stderr else b""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"omnimirror {' '.join(command)} failed: {stderr.decode()}")
    return usage.ru_maxrss / 1024


def commands(size_px: int) -> dict[str, float]:
    """Return commands with the size of their images or tables, MB."""
    image, panorama = 3 * size_px * size_px / 2**20, 3 * size_px * (3 * size_px // 8) / 2**20
    return {
        "simulate big.toml --spp 1 --no-blur -o big.jpg": image,
        f"dewarp big.jpg --sensor big.toml --size {size_px}x -o panorama.jpg": image + panorama,
        f"dewarp big.jpg --sensor big.toml --view sphere --size {size_px}x -o sphere.jpg": 1.5
        * image,
        "dewarp big.jpg --sensor big.toml --view perspective --size 4000x3000 -o view.jpg": image
        + 36e6 / 2**20,
        f"dewarp big.jpg --auto --size {size_px}x -o auto.jpg": image + panorama,
        "rim big.jpg -o rim.svg": image,
        "simulate big.toml --spp 1 --no-blur --set detector.full_well_e=10000 -o noisy.jpg": image,
        f"maps big.toml --view panorama --size {size_px}x --format opencv -o map.npz": panorama
        / 3
        * (8 + 6),
        "rays big.toml --step 4 -o rays.npz": size_px * size_px / 16 * 7 * 8 / 2**20,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--size-px", type=int, default=20_000, help="side of the images, px")
    arguments = parser.parse_args()
    sensor = om.load_sensor("paper-spherical")
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / arguments.size_px
    imager = replace(
        sensor.imager, width_px=arguments.size_px, height_px=arguments.size_px, pixel_pitch_um=pitch
    )
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        om.save_sensor(replace(sensor, imager=imager), folder / "big.toml")
        for command, data_mb in commands(arguments.size_px).items():
            peak_mb = peak_memory_mb(command.split(), folder)
            lines.append(
                f"| `{command}` | {data_mb:,.0f} | {peak_mb:,.0f} | {peak_mb / data_mb:.1f} |"
            )
            print(lines[-1], flush=True)
    header = f"Images of {arguments.size_px} x {arguments.size_px} px; megabytes are 2^20 bytes."
    columns = "| command | images, MB | peak memory, MB | ratio |\n|---|---:|---:|---:|"
    write_text(
        arguments.output / "memory.md", "\n".join(["# Memory", "", header, "", columns, *lines, ""])
    )


if __name__ == "__main__":
    main()
