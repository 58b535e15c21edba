"""Small image archives and jobs for tests of batch processing."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

import omnimirror as om
from omnimirror.interop.batch.job import BatchJob, parse_job

CAMERA = om.Unified(xi=0.9, focal_px=(20.0, 20.0), centre_px=(31.5, 23.5), image_size=(64, 48))
VIEWS = """
[view.north]
size = [24, 16]
[view.around]
view = "panorama"
size = [40, 10]
"""
SENSOR = '[[sensor]]\nfile = "camera.toml"\n'


def image(number: int) -> np.ndarray:
    """Return a random image."""
    return np.random.default_rng(number).integers(0, 255, (48, 64, 3), dtype=np.uint8)


def write_archive(folder: Path, count: int, name: str = "raw/{:04d}.png") -> list[Path]:
    """Write a camera file and images."""
    om.save_camera(CAMERA, folder / "camera.toml")
    paths = [folder / name.format(number) for number in range(count)]
    for number, path in enumerate(paths):
        om.write_image(path, image(number))
    return paths


def job_of(
    folder: Path, inputs: str = 'files = ["raw"]', output: str = "", more: str = SENSOR + VIEWS
) -> BatchJob:
    """Parse a job in a folder, with outputs in ``out``."""
    head = "" if "url" in output else 'url = "out"\n'
    text = f"[inputs]\n{inputs}\n[output]\n{head}{output}\n{more}"
    if "[execution]" not in text:
        text += "[execution]\nworkers = 2\nretry_delay_s = 0.01\n"
    return parse_job(text, "job.toml", folder)


def contents(folder: Path) -> dict[str, str]:
    """Return the digest of each output by name."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "_manifest" not in path.parts and path.name != "manifest.parquet"
    }
