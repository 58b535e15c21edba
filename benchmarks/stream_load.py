"""Measure the server load of one video of 1024 x 1024 px at 25 frames/s for 20 clients of one studio.

The clients are plain sockets in a separate process, which request a frame as soon as they have received one, offer
compression like browsers, and do not decode. Results are the frames received per client and the processor time of the
server.

    python benchmarks/stream_load.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import selectors
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

import av
import cv2
import numpy as np
from measurement_conditions import load_warning, processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter

VIDEO_PX, RATE, FRAMES = 1024, 25, 100
HANDSHAKE = (
    "GET /api/stream?id=source HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Extensions: permessage-deflate\r\n\r\n"
)
NEXT_REQUEST = bytes([0x81, 0x84, 0, 0, 0, 0]) + b"next"  # masked text frame


def make_clip(path: Path) -> None:
    """Render the bundled room with the bundled sphere during a rotation."""
    sensor = om.load_sensor("paper-spherical")
    image = cv2.resize(
        om.render_image(sensor, om.Room(), blur=False),
        (VIDEO_PX, VIDEO_PX),
        interpolation=cv2.INTER_AREA,
    )
    centre = ((VIDEO_PX - 1) / 2, (VIDEO_PX - 1) / 2)
    with VideoWriter(
        path, (VIDEO_PX, VIDEO_PX), RATE, options={"preset": "veryfast", "g": str(RATE)}
    ) as video:
        for i in range(FRAMES):
            rotation = cv2.getRotationMatrix2D(centre, 0.5 * i, 1.0)
            video.write(frame_of_image(cv2.warpAffine(image, rotation, (VIDEO_PX, VIDEO_PX))))


class Client:
    """Client that only receives frames."""

    def __init__(self, host: str) -> None:
        name, port = host.split(":")
        self.socket = socket.create_connection((name, int(port)))
        self.socket.sendall(HANDSHAKE.format(host=host).encode())
        response = b""
        while not response.endswith(b"\r\n\r\n"):
            response += self.socket.recv(1)
        self.remaining, self.frames, self.bytes, self.header, self.buffer = (
            0,
            0,
            0,
            b"",
            bytearray(1 << 18),
        )
        self.socket.sendall(NEXT_REQUEST)

    def receive(self) -> None:
        """Read available data; request the next frame at the end of an image."""
        if not self.remaining:
            self._read_header()
            return
        self.remaining -= self.socket.recv_into(self.buffer, min(self.remaining, len(self.buffer)))
        if not self.remaining and self.is_image:
            self.frames += 1
            self.socket.sendall(NEXT_REQUEST)

    def _read_header(self) -> None:
        """Parse the head of a message byte by byte: its type, and its length of one, three or nine
        bytes."""
        needed = 2 if len(self.header) < 2 else 2 + {126: 2, 127: 8}.get(self.header[1], 0)
        self.header += self.socket.recv(needed - len(self.header))
        if len(self.header) < 2 or len(self.header) < 2 + {126: 2, 127: 8}.get(self.header[1], 0):
            return
        self.is_image = self.header[0] & 15 == 2
        self.remaining = int.from_bytes(self.header[2:], "big") or self.header[1]
        self.bytes, self.header = self.bytes + self.remaining, b""


def run_clients(
    host: str, count: int, seconds: float, connection: multiprocessing.connection.Connection
) -> None:
    """Receive frames with several clients for a given time; send the counts of frames and bytes."""
    pages = [Client(host) for _ in range(count)]
    selector = selectors.DefaultSelector()
    for page in pages:
        selector.register(page.socket, selectors.EVENT_READ, page)

    def receive_until(end: float) -> None:
        while time.monotonic() < end:
            for key, _ in selector.select(0.1):
                key.data.receive()

    receive_until(time.monotonic() + 2)  # excludes the first 2 s
    before = [(page.frames, page.bytes) for page in pages]
    connection.send("begun")
    receive_until(time.monotonic() + seconds)
    connection.send(
        [(page.frames - f, page.bytes - b) for page, (f, b) in zip(pages, before, strict=True)]
    )
    for page in pages:
        page.socket.close()


def processor_s(pid: int) -> float:
    """Return the processor time of a process (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def row(server: subprocess.Popen[str], host: str, count: int, seconds: float) -> str:
    """Return the row for a number of pages."""
    parent_end, child_end = multiprocessing.Pipe()
    pages = multiprocessing.Process(target=run_clients, args=(host, count, seconds, child_end))
    pages.start()
    parent_end.recv()
    before = processor_s(server.pid)
    counts = parent_end.recv()
    server_s = processor_s(server.pid) - before
    pages.join()
    rates = np.array([frames for frames, _ in counts]) / seconds
    frames, size = np.array(counts).sum(axis=0)
    line = (
        f"| {count} | {np.median(rates):.1f} | {rates.min():.1f} "
        f"| {size / frames / 1e3:.0f} | {server_s / seconds:.2f} | "
        f"{1e3 * server_s / frames:.2f} |"
    )
    print(line, flush=True)
    return line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--seconds", type=float, default=8)
    parser.add_argument("--pages", type=int, nargs="*", default=[1, 20])
    arguments = parser.parse_args()
    load_note = load_warning()
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        make_clip(clip)
        command = [
            sys.executable,
            "-m",
            "omnimirror",
            "view",
            str(clip),
            "--no-open",
            "--port",
            "0",
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            try:
                host = urlsplit(re.search(r"http://\S+", server.stdout.readline())[0]).netloc
                rows = [row(server, host, count, arguments.seconds) for count in arguments.pages]
            finally:
                server.terminate()
    conditions = (
        f"{processor_name()}, {os.cpu_count()} cores, PyAV "
        f"{av.__version__}; {arguments.seconds:g} s each.{load_note}"
    )
    lines = [
        f"# One video of {VIDEO_PX} x {VIDEO_PX} px at {RATE} frames/s for several clients",
        "",
        f"`{Path(__file__).name}` on {conditions}",
        "",
        "| clients | frames/s per client, median | frames/s per client, minimum "
        "| kB per frame | server load, cores | CPU time per sent frame, ms |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
    ]
    write_text(arguments.output / "stream_load.md", "\n".join(lines))


if __name__ == "__main__":
    main()
