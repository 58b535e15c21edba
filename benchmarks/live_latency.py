"""Measure frame rate, latency and dropped frames of a live stream on the loopback interface with a moving view.

Another process sends pre-encoded H.264 frames of 1000 x 1000 px at a constant rate. The number of each frame is drawn
in a corner. The latency is the time from the transmission of a frame until its view of 1280 x 720 px is complete, and
is compared with decoding by FFmpeg alone, which returns a frame after the start of the next one (MPEG-TS: one frame
later). ``unparsed`` is a stream opened with ``options={"fflags": "+noparse+nofillin"}``, which avoids one of these
frames.

    python benchmarks/live_latency.py -o out/benchmarks --image photograph.jpg
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

SOURCE_PX, VIEW_SIZE = 1000, (1280, 720)
CAMERA = om.MirrorBall(
    centre_px=((SOURCE_PX - 1) / 2, (SOURCE_PX - 1) / 2),
    rim_radius_px=0.48 * SOURCE_PX,
    field_deg=270.0,
    image_size=(SOURCE_PX, SOURCE_PX),
)
BITS, CELL = 12, 16  # code of the frame number, in squares of CELL pixels
FORMATS = {"HTTP": "mpegts", "UDP": "mpegts", "RTSP": "rtsp"}


# -- sender
# -------------------------------------------------------------------------------------------


def draw_number(image: np.ndarray, number: int) -> np.ndarray:
    """Draw a number into the corner of an image, outside the image circle."""
    for bit in range(BITS):
        image[:CELL, bit * CELL : (bit + 1) * CELL] = 235 if number >> bit & 1 else 20
    return image


def read_number(frame: av.VideoFrame) -> int:
    """Read the number in the corner of a frame."""
    values = planes(frame)[0][CELL // 2, CELL // 2 : BITS * CELL : CELL]
    return sum(1 << bit for bit, value in enumerate(values) if value > 128)


def make_clip(path: Path, photograph: np.ndarray, frames: int, rate: int) -> None:
    """Encode a rotating photograph with camera settings, without B-frames."""
    centre = ((SOURCE_PX - 1) / 2, (SOURCE_PX - 1) / 2)
    options = {"preset": "veryfast", "tune": "zerolatency", "g": str(rate), "b": "8000000"}
    with VideoWriter(path, (SOURCE_PX, SOURCE_PX), rate, options=options) as video:
        for i in range(frames):
            rotated = cv2.warpAffine(
                photograph, cv2.getRotationMatrix2D(centre, 0.5 * i, 1.0), (SOURCE_PX, SOURCE_PX)
            )
            video.write(frame_of_image(draw_number(rotated, i)))


def send(clip: str, url: str, transport: str, rate: int, times_path: str) -> None:
    """Send the packets of a clip at a constant rate, and record their times; runs in the sender
    process."""
    with av.open(clip) as source:
        stream = source.streams.video[0]
        packets = [packet for packet in source.demux(stream) if packet.size]
        target, connection = url, None
        if transport == "HTTP":
            listener = socket.create_server(
                ("127.0.0.1", int(url.rpartition(":")[2].split("/")[0]))
            )
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.recv(4096)
            connection.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: video/mp2t\r\n\r\n")
            target = connection.makefile("wb", buffering=0)
        sent_s: list[float] = []
        # The receiver closes the connection after its last frame.
        with (
            suppress(OSError),
            av.open(target, "w", format=FORMATS[transport], options={"flush_packets": "1"}) as sink,
        ):
            out = sink.add_stream_from_template(stream)
            begin = time.monotonic()
            for number, packet in enumerate(packets):
                with suppress(ValueError):
                    time.sleep(begin + number / rate - time.monotonic())
                sent_s.append(time.monotonic())
                packet.stream = out
                packet.pts = packet.dts = round(number / rate / packet.time_base)
                sink.mux(packet)
    Path(times_path).write_text("\n".join(map(str, sent_s)))


# -- receiver
# -----------------------------------------------------------------------------------------


def free_port(transport: str) -> int:
    with socket.socket(
        socket.AF_INET, socket.SOCK_DGRAM if transport == "UDP" else socket.SOCK_STREAM
    ) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def decoded_frames(url: str, options: dict[str, str]) -> Iterator[av.VideoFrame]:
    """Yield decoded frames of FFmpeg as soon as they are available."""
    with av.open(url, options={**LOW_DELAY, **options}) as container:
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"
        yield from container.decode(stream)


def dewarped_frames(url: str, options: dict[str, str]) -> Iterator[av.VideoFrame]:
    """Yield the same frames after their views have been computed."""
    with LiveSource(
        url, timeout_s=10.0, min_delay_s=0.05, reconnect=False, options=options
    ) as source:
        for i, frame in enumerate(source.frames()):
            view = om.screens.Plane(VIEW_SIZE, 0.5 * i, -20.0)
            dewarp_frame(om.Dewarper(CAMERA, view, "linear"), frame, source.siting)
            yield frame


def receive(
    frames: Callable[..., Iterator[av.VideoFrame]],
    clip: Path,
    transport: str,
    rate: int,
    count: int,
) -> LatencyMeasurement:
    """Record the times of reception and transmission of each frame."""
    port = free_port(transport)
    url, url_suffix, options = {
        "HTTP": (f"http://127.0.0.1:{port}/live.ts", "", {}),
        "UDP": (f"udp://127.0.0.1:{port}", "?pkt_size=1316", {}),
        "RTSP": (
            f"rtsp://127.0.0.1:{port}/live",
            "",
            {"rtsp_flags": "listen", "listen_timeout": "10"},
        ),
    }[transport.split()[0]]
    if transport.endswith("unparsed"):
        options = {**options, "fflags": "+noparse+nofillin"}
    times_path = clip.with_name("sent.txt")
    with subprocess.Popen(
        [
            sys.executable,
            __file__,
            "--send",
            clip,
            url + url_suffix,
            transport.split()[0],
            str(rate),
            times_path,
        ]
    ):
        time.sleep(1.0 if "http" in url else 0.0)  # HTTP: the sender is the server
        received_s = {}
        for frame in frames(url, options):
            number = read_number(frame)
            received_s[number] = time.monotonic()
            if number >= count - 3:
                break
    sent_s = [float(line) for line in times_path.read_text().split()]
    steady = {
        number: at for number, at in received_s.items() if number >= rate
    }  # excludes the first second
    return LatencyMeasurement(
        np.array(list(steady)),
        np.array(list(steady.values())),
        np.array([sent_s[number] for number in steady]),
    )


class LatencyMeasurement(NamedTuple):
    """Frame numbers with times of reception and transmission, s."""

    numbers: np.ndarray
    received_s: np.ndarray
    sent_s: np.ndarray

    @property
    def latency_ms(self) -> np.ndarray:
        return 1e3 * (self.received_s - self.sent_s)

    @property
    def rate(self) -> float:
        return float((len(self.received_s) - 1) / (self.received_s[-1] - self.received_s[0]))

    @property
    def dropped(self) -> int:
        return int(self.numbers[-1] - self.numbers[0] + 1 - len(self.numbers))


def table_row(clip: Path, transport: str, rate: int, count: int) -> str:
    """Return a row of the table."""
    ffmpeg_only, with_view = (
        receive(frames, clip, transport, rate, count)
        for frames in (decoded_frames, dewarped_frames)
    )
    latency, added = (
        np.median(with_view.latency_ms),
        np.median(with_view.latency_ms) - np.median(ffmpeg_only.latency_ms),
    )
    row = (
        f"| {transport} | {rate} | {with_view.rate:.1f} | {with_view.dropped} "
        f"of {len(with_view.numbers) + with_view.dropped} | "
        f"{np.median(ffmpeg_only.latency_ms):.1f} | {latency:.1f} | "
        f"{np.percentile(with_view.latency_ms, 95):.1f} | {added:.1f} | "
        f"{added * rate / 1e3:.2f} |"
    )
    print(row, flush=True)
    return row


def main() -> None:
    if sys.argv[1:2] == ["--send"]:
        clip, url, transport, rate, times_path = sys.argv[2:]
        return send(clip, url, transport, int(rate), times_path)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--image", type=Path, help="photograph; generated noise by default")
    parser.add_argument("--seconds", type=int, default=8)
    parser.add_argument("--rates", type=int, nargs="*", default=[60, 120])
    parser.add_argument("--transports", nargs="*", default=["RTSP", "HTTP", "UDP", "UDP unparsed"])
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
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for rate in arguments.rates:
            frames = arguments.seconds * rate
            make_clip(folder / "clip.ts", photograph, frames, rate)
            rows += [
                table_row(folder / "clip.ts", transport, rate, frames)
                for transport in arguments.transports
            ]
    lines = [
        f"# Live, {SOURCE_PX} x {SOURCE_PX} to a view of {VIEW_SIZE[0]} x {VIEW_SIZE[1]} that moves with every frame",
        "",
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {backend.name} samplers, "
        f"{backend.threads} threads, PyAV {av.__version__}; "
        f"{arguments.seconds} s per transport, excluding the first second.",
        "",
        "| transport | sent frames/s | views/s | dropped frames | latency of FFmpeg, ms | latency "
        "of the view, ms | 95th percentile, ms | added latency, ms | added latency, frames |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "live_latency.md", "\n".join(lines) + "\n")
    return None


if __name__ == "__main__":
    main()
