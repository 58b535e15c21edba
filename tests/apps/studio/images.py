"""Test images and videos, and reference views by the Python dewarper."""

from __future__ import annotations

import shlex
from pathlib import Path

import av
import click
import numpy as np

import omnimirror as om
from omnimirror.apps.cli.commands.dewarp import command as dewarp
from omnimirror.io import read_image


def pattern(size: tuple[int, int]) -> np.ndarray:
    """Return a smooth image with unique values at each position, (h, w, 3)."""
    width, height = size
    v, u = np.arange(height)[:, None], np.arange(width)
    waves = np.empty((height, width, 3), np.float32)
    waves[..., 0] = 128 + 90 * np.sin(u / 53) * np.cos(v / 61)
    waves[..., 1] = 128 + 90 * (np.cos(u / 83) * np.cos(v / 47) - np.sin(u / 83) * np.sin(v / 47))
    waves[..., 2] = 40 + 170 * u / width
    return np.rint(waves, out=waves).astype(np.uint8)


def write_video(path: Path, frames: int = 40) -> Path:
    """Write a video with increasing brightness."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=20)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(frames):
            image = np.full((48, 64, 3), 2 * i % 256, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


def python_view(line: str, folder: Path) -> om.Dewarper:
    """Return the dewarper of a command line."""
    from omnimirror.apps.cli._camera_options import CameraOptions
    from omnimirror.apps.cli._declarations import parsed_options
    from omnimirror.apps.cli.commands.dewarp import ViewOptions

    arguments = [str(folder / w) if (folder / w).is_file() else w for w in shlex.split(line)[2:]]
    context = dewarp.make_context(
        "dewarp", arguments, parent=click.Context(click.Command("omnimirror"))
    )
    height, width = read_image(context.params["sources"][0]).shape[:2]
    camera = parsed_options(CameraOptions, context).camera((width, height))
    view = parsed_options(ViewOptions, context).of(camera)
    return om.Dewarper(camera, view, context.params["interpolation"])


def psnr(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> float:
    error = np.mean((a[where].astype(float) - b[where].astype(float)) ** 2)
    return float(10 * np.log10(255**2 / max(error, 1e-9)))
