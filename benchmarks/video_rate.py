"""Measure the conversion of a video file against the filter v360 of FFmpeg with the same codecs, sizes and threads.

v360 runs in the filter graph of PyAV between the same reader and writer, and in the ``ffmpeg`` program if it is
installed. Both treat the image as that of a mirror ball; the results differ (v360 supports one mirror and reverses the
image), but the amount of work is the same. Variants run interleaved; results are medians.

    python benchmarks/video_rate.py -o out/benchmarks --image photograph.jpg
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.filter import Graph
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.dewarp.video_files import dewarp_frame
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_processing import process
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter

SOURCE_PX, VIEW_SIZE = 1000, (1440, 360)
CAMERA = om.MirrorBall(
    centre_px=((SOURCE_PX - 1) / 2, (SOURCE_PX - 1) / 2),
    rim_radius_px=0.48 * SOURCE_PX,
    field_deg=270.0,
    image_size=(SOURCE_PX, SOURCE_PX),
)
SCREEN = om.screens.Cylinder(VIEW_SIZE, -70.0, 40.0)
V360 = f"input=ball:output=equirect:w={VIEW_SIZE[0]}:h={VIEW_SIZE[1]}:interp=linear"
CODECS: dict[str, tuple[str, dict[str, str], str]] = {
    "H.264, veryfast": ("libx264", {"preset": "veryfast", "crf": "23"}, ".mp4"),
    "MPEG-4": ("mpeg4", {"b": "8000000"}, ".mp4"),
    "FFV1": ("ffv1", {}, ".mkv"),
    "uncompressed": ("rawvideo", {}, ".mkv"),
}


def make_source(
    path: Path, photograph: np.ndarray, frames: int, codec: str, options: dict[str, str]
) -> Path:
    """Encode a photograph that rotates about its centre."""
    centre = ((SOURCE_PX - 1) / 2, (SOURCE_PX - 1) / 2)
    with VideoWriter(path, (SOURCE_PX, SOURCE_PX), 60, codec=codec, options=options) as video:
        for i in range(frames):
            rotation = cv2.getRotationMatrix2D(centre, 0.5 * i, 1.0)
            video.write(
                frame_of_image(cv2.warpAffine(photograph, rotation, (SOURCE_PX, SOURCE_PX)))
            )
    return path


class Filter:
    """v360 in its own filter graph."""

    def __init__(self, frame: av.VideoFrame, threads: int) -> None:
        self.graph = Graph()
        self.graph.threads = threads
        source = self.graph.add_buffer(
            width=SOURCE_PX,
            height=SOURCE_PX,
            format=frame.format,
            time_base=frame.time_base,
            name="source",
        )
        v360, sink = self.graph.add("v360", V360), self.graph.add("buffersink")
        source.link_to(v360)
        v360.link_to(sink)
        self.graph.configure()

    def __call__(self, frame: av.VideoFrame, time_s: float = 0.0) -> av.VideoFrame:
        self.graph.vpush(frame)
        return self.graph.vpull()


def convert(
    source: Path, output: Path, codec: str, options: dict[str, str], function: Callable[..., Any]
) -> None:
    """Convert a video file with a function of frames."""
    with VideoReader(source) as reader:
        sink = VideoWriter.from_source(reader, output, VIEW_SIZE, codec=codec, options=options)
        process(reader.items(), sink, function, "frame")


def convert_with_ffmpeg(
    source: Path, output: Path, codec: str, options: dict[str, str], threads: int, program: str
) -> None:
    """Convert with the ffmpeg program."""
    settings = [word for name, value in options.items() for word in (f"-{name}:v", value)]
    command = [
        program,
        "-v",
        "error",
        "-y",
        "-threads",
        str(threads),
        "-filter_threads",
        str(threads),
        "-i",
        source,
    ]
    command += ["-vf", "v360=" + V360, "-c:v", codec, *settings, "-threads", str(threads), output]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)


def measure_files(
    photograph: np.ndarray, folder: Path, frames: int, runs: int, program: str | None
) -> list[str]:
    rows = []
    threads = backend.threads
    for name, (codec, options, suffix) in CODECS.items():
        source = make_source(folder / f"source{suffix}", photograph, frames, codec, options)
        output = folder / f"view{suffix}"
        with VideoReader(source) as reader:
            v360 = Filter(next(reader.frames()), threads)
        dewarp = partial(dewarp_frame, om.Dewarper(CAMERA, SCREEN, "linear", keep_map=True))
        functions: dict[str, Callable[[], object]] = {
            "omnimirror": lambda: convert(
                source,
                output,
                codec,
                options,
                lambda frame, time_s: dewarp(frame),
            ),
            "v360 in PyAV": lambda: convert(source, output, codec, options, v360),
        }
        if program:
            functions["ffmpeg"] = lambda: convert_with_ffmpeg(
                source,
                output,
                codec,
                options,
                threads,
                program,
            )
        ms = measure_interleaved(functions, runs)
        rate = {program_name: 1e3 * frames / each for program_name, each in ms.items()}
        others = [rate[program_name] for program_name in functions if program_name != "omnimirror"]
        cells = " | ".join(f"{rate[program_name]:.0f}" for program_name in functions)
        rows.append(
            f"| {name} | {cells} | {'' if program else '| '}{rate['omnimirror'] / max(others):.2f} |"
        )
        print(rows[-1], flush=True)
    return rows


def measure_frames(photograph: np.ndarray, runs: int) -> list[str]:
    """Measure the repeated conversion of one frame in memory."""
    rows = []
    frame = frame_of_image(photograph).reformat(format="yuv420p")
    frame.pts, frame.time_base = 0, Fraction(1, 60)
    max_threads = backend.threads
    for threads in sorted({1, max_threads}):
        backend.set_threads(threads)
        v360 = Filter(frame, threads)
        dewarp = om.Dewarper(CAMERA, SCREEN, "linear", keep_map=True)
        pan_angles = iter(np.arange(0.0, 1e6, 0.1))

        def dewarp_moving_view(pan_angles: Any = pan_angles) -> av.VideoFrame:
            view = om.screens.Plane((1280, 720), float(next(pan_angles)) % 360, -20.0)
            return dewarp_frame(om.Dewarper(CAMERA, view, "linear"), frame)

        dewarp_frame(dewarp, frame), dewarp_frame(dewarp, frame)  # the second one builds the map
        ms = measure_interleaved(
            {
                "planes": lambda: dewarp_frame(dewarp, frame),
                "v360": lambda: v360(frame),
                "through RGB": lambda: frame_of_image(
                    dewarp(frame.to_ndarray(format="rgb24"))
                ).reformat(format="yuv420p"),
                "moving": dewarp_moving_view,
            },
            runs,
        )
        rows.append(
            f"| {threads} | {ms['planes']:.2f} | {ms['v360']:.2f} | {ms['v360'] / ms['planes']:.1f} | "
            f"{ms['through RGB']:.2f} | {ms['moving']:.2f} |"
        )
        print(rows[-1], flush=True)
    backend.set_threads(max_threads)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--image", type=Path, help="photograph; generated noise by default")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=4)
    parser.add_argument(
        "--ffmpeg", default=shutil.which("ffmpeg"), help="ffmpeg program for the comparison"
    )
    arguments = parser.parse_args()
    if arguments.image:
        photograph = om.read_image(arguments.image)
    else:
        photograph = cv2.GaussianBlur(
            np.random.default_rng(0).integers(0, 255, (SOURCE_PX, SOURCE_PX, 3), np.uint8),
            (0, 0),
            4,
        )
    photograph = cv2.resize(photograph, (SOURCE_PX, SOURCE_PX), interpolation=cv2.INTER_AREA)
    backend.set_threads(arguments.threads)
    with tempfile.TemporaryDirectory() as folder:
        files = measure_files(
            photograph, Path(folder), arguments.frames, arguments.runs, arguments.ffmpeg
        )
    lines = [
        f"# Video, {SOURCE_PX} x {SOURCE_PX} to {VIEW_SIZE[0]} x {VIEW_SIZE[1]}, yuv420p",
        "",
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {backend.name} samplers, "
        f"{arguments.threads} threads, PyAV {av.__version__}; medians of {arguments.runs} runs of "
        f"{arguments.frames} frames, interleaved.",
        "",
        "File to file, frames per second:",
        "",
        "| codec | omnimirror | v360 in PyAV | ffmpeg -vf v360 | ratio to the faster |",
        "|---|---|---|---|---|",
        *files,
        "",
        "One frame in memory, ms; the last column a moving view of 1280 x 720, with new coordinates for each frame:",
        "",
        "| threads | omnimirror | v360 | ratio | through RGB | moving view |",
        "|---|---|---|---|---|---|",
        *measure_frames(photograph, 60),
    ]
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "video_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
