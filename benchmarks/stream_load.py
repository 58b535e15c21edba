"""Measure the server load of one video of 1024 x 1024 px at 25 frames/s for 20 clients of one studio.

The clients are plain sockets in a separate process, which request a frame as soon as they have received one, offer
compression like browsers, and do not decode. Results are the frames received per client and the processor time of the
server.

    python benchmarks/stream_load.py --out out/benchmarks
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
from circumstances import other_load, processor

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter

SIDE, RATE, FRAMES = 1024, 25, 100
HANDSHAKE = (
    "GET /api/stream?id=source HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Extensions: permessage-deflate\r\n\r\n"
)
ASK = bytes([0x81, 0x84, 0, 0, 0, 0]) + b"next"  # masked text frame


def make_clip(path: Path) -> None:
    """Render the bundled room with the bundled sphere during a rotation."""
    sensor = om.load_sensor("paper-spherical")
    picture = cv2.resize(
        om.render_image(sensor, om.Room(), blur=False), (SIDE, SIDE), interpolation=cv2.INTER_AREA
    )
    middle = ((SIDE - 1) / 2, (SIDE - 1) / 2)
    with VideoWriter(
        path, (SIDE, SIDE), RATE, options={"preset": "veryfast", "g": str(RATE)}
    ) as video:
        for i in range(FRAMES):
            turn = cv2.getRotationMatrix2D(middle, 0.5 * i, 1.0)
            video.write(frame_of_image(cv2.warpAffine(picture, turn, (SIDE, SIDE))))


class Watcher:
    """Client that only receives frames."""

    def __init__(self, host: str) -> None:
        name, port = host.split(":")
        self.socket = socket.create_connection((name, int(port)))
        self.socket.sendall(HANDSHAKE.format(host=host).encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self.socket.recv(1)
        self.left, self.frames, self.bytes, self.head, self.buffer = (
            0,
            0,
            0,
            b"",
            bytearray(1 << 18),
        )
        self.socket.sendall(ASK)

    def take(self) -> None:
        """Read available data; request the next frame at the end of an image."""
        if not self.left:
            self._begin()
            return
        self.left -= self.socket.recv_into(self.buffer, min(self.left, len(self.buffer)))
        if not self.left and self.is_picture:
            self.frames += 1
            self.socket.sendall(ASK)

    def _begin(self) -> None:
        """Parse the head of a message byte by byte: its type, and its length of one, three or nine
        bytes."""
        needed = 2 if len(self.head) < 2 else 2 + {126: 2, 127: 8}.get(self.head[1], 0)
        self.head += self.socket.recv(needed - len(self.head))
        if len(self.head) < 2 or len(self.head) < 2 + {126: 2, 127: 8}.get(self.head[1], 0):
            return
        self.is_picture = self.head[0] & 15 == 2
        self.left = int.from_bytes(self.head[2:], "big") or self.head[1]
        self.bytes, self.head = self.bytes + self.left, b""


def watch(
    host: str, count: int, seconds: float, told: multiprocessing.connection.Connection
) -> None:
    """Receive frames with several clients for a given time; send the counts of frames and bytes."""
    pages = [Watcher(host) for _ in range(count)]
    waiting = selectors.DefaultSelector()
    for page in pages:
        waiting.register(page.socket, selectors.EVENT_READ, page)

    def until(end: float) -> None:
        while time.monotonic() < end:
            for key, _ in waiting.select(0.1):
                key.data.take()

    until(time.monotonic() + 2)  # excludes the first 2 s
    before = [(page.frames, page.bytes) for page in pages]
    told.send("begun")
    until(time.monotonic() + seconds)
    told.send(
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
    here, there = multiprocessing.Pipe()
    pages = multiprocessing.Process(target=watch, args=(host, count, seconds, there))
    pages.start()
    here.recv()
    before = processor_s(server.pid)
    found = here.recv()
    used = processor_s(server.pid) - before
    pages.join()
    rates = np.array([frames for frames, _ in found]) / seconds
    frames, size = np.array(found).sum(axis=0)
    line = (
        f"| {count} | {np.median(rates):.1f} | {rates.min():.1f} | {size / frames / 1e3:.0f} | {used / seconds:.2f} | "
        f"{1e3 * used / frames:.2f} |"
    )
    print(line, flush=True)
    return line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--seconds", type=float, default=8)
    parser.add_argument("--pages", type=int, nargs="*", default=[1, 20])
    arguments = parser.parse_args()
    load = other_load()
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        make_clip(clip)
        words = [sys.executable, "-m", "omnimirror", "view", str(clip), "--no-open", "--port", "0"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
            try:
                host = urlsplit(re.search(r"http://\S+", server.stdout.readline())[0]).netloc
                rows = [row(server, host, count, arguments.seconds) for count in arguments.pages]
            finally:
                server.terminate()
    said = f"{processor()}, {os.cpu_count()} cores, PyAV {av.__version__}; {arguments.seconds:g} s each.{load}"
    lines = [
        f"# One video of {SIDE} x {SIDE} px at {RATE} frames per second, for many pages",
        "",
        f"`{Path(__file__).name}` on {said}",
        "",
        "| pages | frames/s per page, median | minimum | kB/frame | server cores | server ms per frame sent |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
    ]
    write_text(arguments.out / "stream_load.md", "\n".join(lines))


if __name__ == "__main__":
    main()
