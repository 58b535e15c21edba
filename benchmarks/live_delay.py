"""Measure frame rate, latency and dropped frames of a live stream on the loopback interface with a moving view.

Another process sends pre-encoded H.264 frames of 1000 x 1000 px at a constant rate. The number of each frame is drawn
in a corner. The latency is the time from the transmission of a frame until its view of 1280 x 720 px is complete, and
is compared with decoding by FFmpeg alone, which returns a frame after the start of the next one (MPEG-TS: one frame
later). ``unparsed`` is a stream opened with ``options={"fflags": "+noparse+nofillin"}``, which avoids one of these
frames.

    python benchmarks/live_delay.py --out out/benchmarks --picture photograph.jpg
"""

from __future__ import annotations

import argparse
import os
import platform
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import av
import cv2
import numpy as np

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.dewarp.video_files import dewarp_frame
from omnimirror.io.live_sources import LOW_DELAY, LiveSource
from omnimirror.io.video_frames import frame_of_image, planes
from omnimirror.io.video_writer import VideoWriter

SIDE, SIZE = 1000, (1280, 720)
CAMERA = om.MirrorBall(
    centre_px=((SIDE - 1) / 2, (SIDE - 1) / 2),
    rim_radius_px=0.48 * SIDE,
    field_deg=270.0,
    image_size=(SIDE, SIDE),
)
BITS, CELL = 12, 16  # of the frame number, in squares of CELL pixels
FORMATS = {"HTTP": "mpegts", "UDP": "mpegts", "RTSP": "rtsp"}


# -- sender
# -------------------------------------------------------------------------------------------


def numbered(picture: np.ndarray, number: int) -> np.ndarray:
    """Draw a number into the corner of an image, outside the image circle."""
    for bit in range(BITS):
        picture[:CELL, bit * CELL : (bit + 1) * CELL] = 235 if number >> bit & 1 else 20
    return picture


def number_of(frame: av.VideoFrame) -> int:
    """Read the number in the corner of a frame."""
    middles = planes(frame)[0][CELL // 2, CELL // 2 : BITS * CELL : CELL]
    return sum(1 << bit for bit, value in enumerate(middles) if value > 128)


def make_clip(path: Path, photograph: np.ndarray, frames: int, rate: int) -> None:
    """Encode a rotating photograph with camera settings, without B-frames."""
    middle = ((SIDE - 1) / 2, (SIDE - 1) / 2)
    options = {"preset": "veryfast", "tune": "zerolatency", "g": str(rate), "b": "8000000"}
    with VideoWriter(path, (SIDE, SIDE), rate, options=options) as video:
        for i in range(frames):
            turned = cv2.warpAffine(
                photograph, cv2.getRotationMatrix2D(middle, 0.5 * i, 1.0), (SIDE, SIDE)
            )
            video.write(frame_of_image(numbered(turned, i)))


def send(clip: str, url: str, kind: str, rate: int, told: str) -> None:
    """Send the packets of a clip at a constant rate, and record their times; runs in the sender
    process."""
    with av.open(clip) as source:
        stream = source.streams.video[0]
        packets = [packet for packet in source.demux(stream) if packet.size]
        target, connection = url, None
        if kind == "HTTP":
            listener = socket.create_server(
                ("127.0.0.1", int(url.rpartition(":")[2].split("/")[0]))
            )
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.recv(4096)
            connection.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: video/mp2t\r\n\r\n")
            target = connection.makefile("wb", buffering=0)
        sent: list[float] = []
        # The receiver closes the connection after its last frame.
        with (
            suppress(OSError),
            av.open(target, "w", format=FORMATS[kind], options={"flush_packets": "1"}) as sink,
        ):
            out = sink.add_stream_from_template(stream)
            begin = time.monotonic()
            for number, packet in enumerate(packets):
                with suppress(ValueError):
                    time.sleep(begin + number / rate - time.monotonic())
                sent.append(time.monotonic())
                packet.stream = out
                packet.pts = packet.dts = round(number / rate / packet.time_base)
                sink.mux(packet)
    Path(told).write_text("\n".join(map(str, sent)))


# -- receiver
# -----------------------------------------------------------------------------------------


def free_port(kind: str) -> int:
    with socket.socket(
        socket.AF_INET, socket.SOCK_DGRAM if kind == "UDP" else socket.SOCK_STREAM
    ) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def decoded(url: str, options: dict[str, str]) -> Iterator[av.VideoFrame]:
    """Yield decoded frames of FFmpeg as soon as they are available."""
    with av.open(url, options={**LOW_DELAY, **options}) as container:
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"
        yield from container.decode(stream)


def viewed(url: str, options: dict[str, str]) -> Iterator[av.VideoFrame]:
    """Yield the same frames after their views have been computed."""
    with LiveSource(
        url, timeout_s=10.0, min_delay_s=0.05, reconnect=False, options=options
    ) as source:
        for i, frame in enumerate(source.frames()):
            view = om.screens.Plane(SIZE, 0.5 * i, -20.0)
            dewarp_frame(om.Dewarper(CAMERA, view, "linear"), frame, source.siting)
            yield frame


def receive(
    frames: Callable[..., Iterator[av.VideoFrame]], clip: Path, kind: str, rate: int, count: int
) -> Received:
    """Record the times of reception and transmission of each frame."""
    port = free_port(kind)
    url, to, options = {
        "HTTP": (f"http://127.0.0.1:{port}/live.ts", "", {}),
        "UDP": (f"udp://127.0.0.1:{port}", "?pkt_size=1316", {}),
        "RTSP": (
            f"rtsp://127.0.0.1:{port}/live",
            "",
            {"rtsp_flags": "listen", "listen_timeout": "10"},
        ),
    }[kind.split()[0]]
    if kind.endswith("unparsed"):
        options = {**options, "fflags": "+noparse+nofillin"}
    told = clip.with_name("sent.txt")
    with subprocess.Popen(
        [sys.executable, __file__, "--send", clip, url + to, kind.split()[0], str(rate), told]
    ):
        time.sleep(1.0 if "http" in url else 0.0)  # HTTP: the sender is the server
        done = {}
        for frame in frames(url, options):
            number = number_of(frame)
            done[number] = time.monotonic()
            if number >= count - 3:
                break
    sent = [float(line) for line in told.read_text().split()]
    kept = {n: at for n, at in done.items() if n >= rate}  # excludes the first second
    return Received(
        np.array(list(kept)), np.array(list(kept.values())), np.array([sent[n] for n in kept])
    )


class Received(NamedTuple):
    """Frame numbers with times of reception and transmission, s."""

    numbers: np.ndarray
    done: np.ndarray
    sent: np.ndarray

    @property
    def delay_ms(self) -> np.ndarray:
        return 1e3 * (self.done - self.sent)

    @property
    def rate(self) -> float:
        return float((len(self.done) - 1) / (self.done[-1] - self.done[0]))

    @property
    def missing(self) -> int:
        return int(self.numbers[-1] - self.numbers[0] + 1 - len(self.numbers))


def row_of(clip: Path, kind: str, rate: int, count: int) -> str:
    """Return a row of the table."""
    alone, ours = (receive(frames, clip, kind, rate, count) for frames in (decoded, viewed))
    delay, added = np.median(ours.delay_ms), np.median(ours.delay_ms) - np.median(alone.delay_ms)
    row = (
        f"| {kind} | {rate} | {ours.rate:.1f} | {ours.missing} of {len(ours.numbers) + ours.missing} | "
        f"{np.median(alone.delay_ms):.1f} | {delay:.1f} | {np.percentile(ours.delay_ms, 95):.1f} | {added:.1f} | "
        f"{added * rate / 1e3:.2f} |"
    )
    print(row, flush=True)
    return row


def main() -> None:
    if sys.argv[1:2] == ["--send"]:
        clip, url, kind, rate, told = sys.argv[2:]
        return send(clip, url, kind, int(rate), told)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--picture", type=Path, help="photograph; a drawn one by default")
    parser.add_argument("--seconds", type=int, default=8)
    parser.add_argument("--rates", type=int, nargs="*", default=[60, 120])
    parser.add_argument("--kinds", nargs="*", default=["RTSP", "HTTP", "UDP", "UDP unparsed"])
    arguments = parser.parse_args()
    if arguments.picture:
        photograph = om.read_image(arguments.picture)
    else:
        photograph = cv2.GaussianBlur(
            np.random.default_rng(0).integers(0, 255, (SIDE, SIDE, 3), np.uint8), (0, 0), 4
        )
    photograph = cv2.resize(photograph, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for rate in arguments.rates:
            frames = arguments.seconds * rate
            make_clip(folder / "clip.ts", photograph, frames, rate)
            rows += [row_of(folder / "clip.ts", kind, rate, frames) for kind in arguments.kinds]
    lines = [
        f"# Live, {SIDE} x {SIDE} to a view of {SIZE[0]} x {SIZE[1]} that moves with every frame",
        "",
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {backend.name} samplers, "
        f"{backend.threads} threads, PyAV {av.__version__}; "
        f"{arguments.seconds} s per transport, excluding the first second.",
        "",
        "| transport | sent/s | views/s | dropped | FFmpeg alone, ms | to the view, ms | 95 % | added, ms | frames |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out / "live_delay.md", "\n".join(lines) + "\n")
    return None


if __name__ == "__main__":
    main()
