"""Kill a batch job at random moments and compare its outputs with those of an uninterrupted run.

The main process and its workers receive SIGKILL after random numbers of outputs; the command is then repeated. Reported
are lost, duplicated and different outputs after the last run, and the outputs computed twice.

    python benchmarks/batch_interruptions.py --images 10000 --kills 50 -o out/benchmarks
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.io.images import encode_image

JOB = """
[inputs]
files = ["raw"]
[[sensor]]
file = "camera.toml"
[view.north]
size = [24, 16]
[output]
url = "{url}"
"""


def write_inputs(folder: Path, count: int) -> None:
    """Write a camera of 64 x 48 px and random images."""
    camera = om.Unified(xi=0.9, focal_px=(20.0, 20.0), centre_px=(31.5, 23.5), image_size=(64, 48))
    om.save_camera(camera, folder / "camera.toml")
    rng = np.random.default_rng(0)
    (folder / "raw").mkdir()
    for number in range(count):
        image = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
        (folder / "raw" / f"{number:05d}.png").write_bytes(encode_image("a.png", image))
    for name in ("uninterrupted", "interrupted"):
        (folder / f"{name}.toml").write_text(JOB.format(url=name))


def start_command(folder: Path, name: str) -> subprocess.Popen[bytes]:
    program = Path(sys.executable).with_name("omnimirror")
    return subprocess.Popen(
        [program, "--quiet", "batch", "run", f"{name}.toml"], cwd=folder, start_new_session=True
    )


def children(process: int) -> list[int]:
    """Return the processes started by a process."""
    tasks = Path(f"/proc/{process}/task")
    with suppress(OSError):
        return [
            int(child)
            for task in tasks.iterdir()
            for child in (task / "children").read_text().split()
        ]
    return []


def count_rows(folder: Path) -> int:
    """Return the number of rows that workers appended."""
    parts = (folder / "_manifest").glob("rows-*.jsonl")
    return sum(part.read_bytes().count(b"\n") for part in parts)


def file_digests(folder: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("*.png")
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--images", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=50)
    options = parser.parse_args()
    rng, load_note = np.random.default_rng(1), load_warning()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder, options.images)
        assert start_command(folder, "uninterrupted").wait() == 0
        kills = 0
        for number in range(options.kills):
            target_rows = (number + rng.random()) * options.images / (options.kills + 1)
            run = start_command(folder, "interrupted")
            while count_rows(folder / "interrupted") < target_rows and run.poll() is None:
                time.sleep(0.01)
            time.sleep(0.2 * rng.random())
            kills += run.poll() is None
            for process in (run.pid, *children(run.pid)):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            run.wait()
        computed = count_rows(folder / "interrupted")
        assert start_command(folder, "interrupted").wait() == 0
        whole, killed = file_digests(folder / "uninterrupted"), file_digests(folder / "interrupted")
        rows = om.batch.plan(folder / "interrupted.toml").manifest.rows.values()
        inputs = [row.input for row in rows if row.status == "done"]
        lost = len(whole.keys() - killed.keys())
        duplicated = len(killed.keys() - whole.keys()) + len(inputs) - len(set(inputs))
        different = sum(whole[key] != killed.get(key) for key in whole)
        temporary = len(list((folder / "interrupted/_manifest/_temporary").iterdir()))
    text = (
        f"{kills} kills during a job of {options.images} images of 64 x 48 px; {processor_name()}.{load_note}\n\n"
        "| outputs | number |\n|---|---:|\n"
        f"| lost | {lost} |\n| duplicated | {duplicated} |\n| different bytes | {different} |\n"
        f"| recorded before the last run | {computed} |\n| temporary files left | {temporary} |\n"
    )
    write_text(options.output / "batch_interruptions.md", text)
    print(text)
    assert lost == duplicated == different == 0


if __name__ == "__main__":
    main()
