"""Measure the peak memory of commands on images of 20,000 x 20,000 px.

The reference is the memory of the images and tables that a command reads and writes (three bytes per pixel for images).
The sensor is that of the paper with smaller pixels; the first command renders its image. This program itself uses
little memory, because a child process starts with the peak memory of its parent.

    python benchmarks/memory.py --out out/benchmarks
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


def held_mb(words: list[str], folder: Path) -> float:
    """Return the peak memory of one command, MB."""
    process = subprocess.Popen(
        [PROGRAM, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    said = process.stderr.read() if process.stderr else b""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"omnimirror {' '.join(words)} failed: {said.decode()}")
    return usage.ru_maxrss / 1024


def commands(side: int) -> dict[str, float]:
    """Return commands with the size of their images or tables, MB."""
    picture, panorama = 3 * side * side / 2**20, 3 * side * (3 * side // 8) / 2**20
    return {
        "simulate big.toml --spp 1 --no-blur -o big.jpg": picture,
        f"dewarp big.jpg --sensor big.toml --size {side}x -o panorama.jpg": picture + panorama,
        f"dewarp big.jpg --sensor big.toml --view sphere --size {side}x -o sphere.jpg": 1.5
        * picture,
        "dewarp big.jpg --sensor big.toml --view perspective --size 4000x3000 -o view.jpg": picture
        + 36e6 / 2**20,
        f"dewarp big.jpg --auto --size {side}x -o auto.jpg": picture + panorama,
        "rim big.jpg -o rim.svg": picture,
        "simulate big.toml --spp 1 --no-blur --set detector.full_well_e=10000 -o noisy.jpg": picture,
        f"maps big.toml --view panorama --size {side}x --format opencv -o map.npz": panorama
        / 3
        * (8 + 6),
        "rays big.toml --step 4 -o rays.npz": side * side / 16 * 7 * 8 / 2**20,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--side", type=int, default=20_000, help="side of the images, px")
    arguments = parser.parse_args()
    sensor = om.load_sensor("paper-spherical")
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / arguments.side
    fine = replace(
        sensor.imager, width_px=arguments.side, height_px=arguments.side, pixel_pitch_um=pitch
    )
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        om.save_sensor(replace(sensor, imager=fine), folder / "big.toml")
        for words, needed in commands(arguments.side).items():
            most = held_mb(words.split(), folder)
            lines.append(f"| `{words}` | {needed:,.0f} | {most:,.0f} | {most / needed:.1f} |")
            print(lines[-1], flush=True)
    head = f"Images of {arguments.side} x {arguments.side} px; megabytes are 2^20 bytes."
    columns = "| command | images, MB | peak memory, MB | ratio |\n|---|---:|---:|---:|"
    write_text(
        arguments.out / "memory.md", "\n".join(["# Memory", "", head, "", columns, *lines, ""])
    )


if __name__ == "__main__":
    main()
