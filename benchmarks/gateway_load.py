"""Measure the load of the gateway: eight views of 640 x 360 px from one stream of 1920 x 1080 px at 25 frames/s.

First, the processor time of each step is measured separately, per frame of the source or of a view. Then the gateway
runs with a sending process on the loopback interface and a receiving process: processor time, dropped frames, and the
latency from a decoded frame to its transmitted view are measured. The latency of FFmpeg (``live_latency.py``) is not
included.

    python benchmarks/gateway_load.py -o out/benchmarks --image photograph.jpg
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import live_latency
import numpy as np

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.base.native import backend
from omnimirror.dewarp.video_files import dewarp_frame
from omnimirror.interop.gateway.live_views import Gateway
from omnimirror.interop.gateway.routes import create_app
from omnimirror.interop.gateway.stream_outputs import JpegEncoder, StreamOutput, TransportEncoder
from omnimirror.interop.http_server.server import Server, listen, server_config
from omnimirror.io.live_sources import TICKS
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter

WIDTH, HEIGHT, RATE = 1920, 1080, 25
CAMERA = om.MirrorBall(
    centre_px=((WIDTH - 1) / 2, (HEIGHT - 1) / 2),
    rim_radius_px=0.48 * HEIGHT,
    field_deg=270.0,
    image_size=(WIDTH, HEIGHT),
)
VIEWS = {
    f"view{i}": om.NamedView(
        f"view{i}",
        options={"size": (640, 360), "pan_deg": 45.0 * i, "tilt_deg": -15.0, "hfov_deg": 80.0},
    )
    for i in range(8)
}
TARGET_CORES = 2


def make_clip(path: Path, photograph: np.ndarray, frames: int) -> None:
    """Encode a rotating photograph with typical camera settings."""
    centre = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    side = round(0.96 * HEIGHT)
    mirror_image = cv2.resize(photograph, (side, side), interpolation=cv2.INTER_AREA)
    full_frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    top, left = (HEIGHT - side) // 2, (WIDTH - side) // 2
    full_frame[top : top + side, left : left + side] = mirror_image
    options = {"preset": "veryfast", "tune": "zerolatency", "g": str(RATE), "b": "8000000"}
    with VideoWriter(path, (WIDTH, HEIGHT), RATE, options=options) as video:
        for i in range(frames):
            rotation = cv2.getRotationMatrix2D(centre, 0.5 * i, 1.0)
            video.write(frame_of_image(cv2.warpAffine(full_frame, rotation, (WIDTH, HEIGHT))))


# -- separate steps
# -----------------------------------------------------------------------------------


def processor_ms(count: int, work: Callable[[], object]) -> float:
    """Return the processor time of all threads per call."""
    start = time.process_time()
    work()
    return 1e3 * (time.process_time() - start) / count


def measure_steps(clip: Path, max_frames: int) -> dict[str, float]:
    """Return the processor time (ms) per step, per frame of the source or of a view."""
    times_ms, frames = {}, []

    def decode() -> None:
        with av.open(str(clip)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"
            for frame in container.decode(stream):
                frames.append(frame)
                if len(frames) == max_frames:
                    return

    times_ms["decoding a frame of the source"] = processor_ms(max_frames, decode)
    dewarps = [om.Dewarper(CAMERA, view(CAMERA), keep_map=True) for view in VIEWS.values()]
    for dewarp in dewarps:  # builds the maps
        dewarp_frame(dewarp, frames[0])
    dewarped: list[av.VideoFrame] = []
    count = len(VIEWS) * max_frames
    times_ms["dewarping a view"] = processor_ms(
        count,
        lambda: dewarped.extend(
            dewarp_frame(dewarp, frame) for dewarp in dewarps for frame in frames
        ),
    )
    for i, frame in enumerate(dewarped):
        frame.time_base, frame.pts = TICKS, round(i / RATE / TICKS)
    transport, jpeg = TransportEncoder((640, 360), RATE), JpegEncoder()
    times_ms["H.264 in MPEG-TS, of a view"] = processor_ms(
        count, lambda: [transport(frame) for frame in dewarped]
    )
    times_ms["JPEG, of a view"] = processor_ms(count, lambda: [jpeg(frame) for frame in dewarped])
    return times_ms


# -- running gateway
# ----------------------------------------------------------------------------------

CLIENT_SCRIPT = """
import asyncio, sys, httpx
async def watch(url):
    async with httpx.AsyncClient(timeout=60) as client, client.stream("GET", url) as answer:
        async for _ in answer.aiter_raw(): pass
async def main():
    tasks = [asyncio.create_task(watch(url)) for url in sys.argv[1:]]
    await asyncio.wait(tasks)
asyncio.run(main())
"""


class LatencyRecorder:
    """Delays between decoding of a frame and output of each chunk or image of its view, s."""

    def __init__(self, gateway: Gateway) -> None:
        self.seconds: list[float] = []
        for view in gateway.views.values():
            for group in view.outputs.values():
                for output in group:
                    self._record(gateway, output)

    def _record(self, gateway: Gateway, output: StreamOutput) -> None:
        take = output.take

        def timed(frame: av.VideoFrame) -> None:
            decoded_at = gateway._start + float(frame.pts * TICKS)
            take(frame)
            self.seconds.append(time.monotonic() - decoded_at)

        output.take = timed  # type: ignore[method-assign]


def measure_gateway(
    clip: Path, suffix: str, seconds: float
) -> tuple[int, float, int, float, float, float]:
    """Return the number of views, cores, dropped views, median and 95 % quantile of the delay in
    ms, and source frames/s."""
    port = live_latency.free_port("HTTP")
    url = f"http://127.0.0.1:{port}/live.ts"
    command = [
        sys.executable,
        live_latency.__file__,
        "--send",
        clip,
        url,
        "HTTP",
        str(RATE),
        clip.with_name("sent.txt"),
    ]
    gateway = Gateway(url, True, CAMERA, VIEWS)
    latencies = LatencyRecorder(gateway)
    server, listening = (
        Server(server_config(create_app(gateway, None), "error")),
        listen("127.0.0.1", 0),
    )
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    urls = [f"http://127.0.0.1:{listening.getsockname()[1]}/{name}.{suffix}" for name in VIEWS]
    with (
        subprocess.Popen(command) as sender,
        subprocess.Popen([sys.executable, "-c", CLIENT_SCRIPT, *urls]) as client,
    ):
        while (
            min(view.frames_dewarped for view in gateway.views.values()) < RATE
        ):  # excludes the first second
            time.sleep(0.05)
        before = resource.getrusage(resource.RUSAGE_SELF)
        start, received = time.monotonic(), gateway.frames_received
        initial_counts = (
            sum(v.frames_dewarped for v in gateway.views.values()),
            sum(v.frames_dropped for v in gateway.views.values()),
        )
        first = len(latencies.seconds)
        time.sleep(seconds)
        after, elapsed_s = resource.getrusage(resource.RUSAGE_SELF), time.monotonic() - start
        dewarped = sum(v.frames_dewarped for v in gateway.views.values()) - initial_counts[0]
        dropped = sum(v.frames_dropped for v in gateway.views.values()) - initial_counts[1]
        received_frames = gateway.frames_received - received
        client.terminate()
        server.should_exit = True
        thread.join()
        sender.terminate()
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    latencies_ms = 1e3 * np.array(latencies.seconds[first:])
    return (
        dewarped,
        used_s / elapsed_s,
        dropped,
        float(np.median(latencies_ms)),
        float(np.percentile(latencies_ms, 95)),
        received_frames / elapsed_s,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--image", type=Path, help="photograph; generated noise by default")
    parser.add_argument(
        "--frames", type=int, default=50, help="number of frames for the separate steps"
    )
    parser.add_argument("--seconds", type=int, default=8)
    arguments = parser.parse_args()
    if arguments.image:
        photograph = om.read_image(arguments.image)[..., :3]
    else:
        photograph = cv2.GaussianBlur(
            np.random.default_rng(0).integers(0, 255, (1000, 1000, 3), np.uint8), (0, 0), 4
        )
    rows, gateway_rows = [], []
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.ts"
        make_clip(clip, photograph, RATE * (arguments.seconds + 20))
        times_ms = measure_steps(clip, arguments.frames)
        decoding, drawing, h264, jpeg = times_ms.values()
        for name, ms in times_ms.items():
            repetitions = 1 if name.startswith("decoding") else len(VIEWS)
            rows.append(f"| {name} | {ms:.2f} | {repetitions * ms * RATE / 1e3:.2f} |")
        for name, encoding in (("H.264", h264), ("JPEG", jpeg)):
            cores = (decoding + len(VIEWS) * (drawing + encoding)) * RATE / 1e3
            rows.append(f"| total, {name} | | {cores:.2f} of {TARGET_CORES} |")
        for suffix in ("ts", "mjpg"):
            dewarped, cores, dropped, median, percentile_95, rate = measure_gateway(
                clip, suffix, arguments.seconds
            )
            gateway_rows.append(
                f"| {suffix} | {rate:.1f} | {dewarped} | {dropped} | "
                f"{cores:.2f} | {median:.1f} | {percentile_95:.1f} | "
                f"{percentile_95 * RATE / 1e3:.2f} |"
            )
    lines = [
        f"# Gateway: {len(VIEWS)} views of 640 x 360 px from {WIDTH} x {HEIGHT} px at {RATE} frames per second",
        "",
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {backend.name} samplers, PyAV "
        f"{av.__version__}; {arguments.frames} frames per step, {arguments.seconds} s of operation.",
        "",
        "| step | processor time, ms | cores |",
        "|---|---|---|",
        *rows,
        "",
        "| client protocol | frames/s of the source | dewarped views | dropped frames "
        "| cores | latency, ms | 95th percentile, ms | latency, frames |",
        "|---|---|---|---|---|---|---|---|",
        *gateway_rows,
    ]
    print("\n".join(lines))
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "gateway_load.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
