"""Shutdown of a server by Ctrl-C and SIGTERM: immediate, regardless of open connections."""

from __future__ import annotations

import gc
import json
import re
import signal
import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import pytest

import omnimirror as om
from omnimirror.optics.sensor_files import tables_of
from tests.serving import served

from .images import write_video


def wait_for_port(port: int) -> None:
    while True:
        with socket.socket() as probe:
            if not probe.connect_ex(("127.0.0.1", port)):
                return
        time.sleep(0.05)


@pytest.mark.parametrize(
    "before",
    [
        pytest.param(signal.SIG_DFL, id="in the foreground", marks=pytest.mark.full),
        pytest.param(signal.SIG_IGN, id="as a job of a script"),
    ],
)
def test_ctrl_c_ends_server_with_open_connections(before, tmp_path):
    from websockets.sync.client import connect

    video = write_video(tmp_path / "ride.mp4", 100)
    arguments = [sys.executable, "-m", "omnimirror", "view", video, "--no-open"]
    with subprocess.Popen(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, before),
    ) as server:
        port = int(re.search(r":(\d+)/", server.stdout.readline())[1])
        wait_for_port(port)
        head = f"POST /api/convert HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 100000\r\n"
        with (
            connect(f"ws://127.0.0.1:{port}/api/stream?id=source") as stream,
            socket.create_connection(("127.0.0.1", port)) as upload,
            socket.create_connection(("127.0.0.1", port)),
        ):
            stream.send("next")
            assert stream.recv()
            upload.sendall(f"{head}Expect: 100-continue\r\n\r\n".encode())
            assert upload.recv(100).startswith(b"HTTP/1.1 100")  # the server now waits for the rest
            upload.sendall(b"abc")
            server.send_signal(signal.SIGINT)
            output = server.communicate()
        assert server.returncode == 130
        assert output == ("", "\nomnimirror: stopped\n")


def children_of(pid: int) -> list[int]:
    """Return processes started by any thread of a process."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for file in lists for child in file.read_text().split()]


def is_running(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_sigterm_ends_server_and_its_searches():
    from websockets.sync.client import connect

    task = {
        "kind": "optimise",
        "tables": tables_of(om.load_sensor("paper-spherical")),
        "requirements": None,
        "terms": 12,
        "object_distance_mm": None,
        "merit": "worst_blur_deg",
        "shape": "spline",
        "starts": 8,
    }
    arguments = [sys.executable, "-m", "omnimirror", "studio", "--no-open"]
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        port = int(re.search(r":(\d+)/", server.stdout.readline())[1])
        # the address is reachable once it is printed
        with connect(f"ws://127.0.0.1:{port}/api/design/work", open_timeout=None) as socket:
            socket.send(json.dumps(task))
            while not (searches := children_of(server.pid)):
                time.sleep(0.01)
            server.send_signal(signal.SIGTERM)
            output = server.communicate()
    assert server.returncode == 128 + signal.SIGTERM
    assert output == ("", "omnimirror: stopped\n")
    assert not any(map(is_running, searches))


@pytest.mark.full
def test_unresponsive_tasks_are_cancelled_and_sockets_closed():
    """A client that does not read a long response keeps its connection open beyond the shutdown
    timeout."""

    async def endless(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})
        while True:
            await send({"type": "http.response.body", "body": bytes(1 << 20), "more_body": True})

    gc.collect()
    with warnings.catch_warnings(record=True) as records, socket.socket() as client:
        warnings.simplefilter("always", ResourceWarning)
        with served(endless) as address:
            host, port = address.removeprefix("http://").rstrip("/").split(":")
            client.connect((host, int(port)))
            client.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert client.recv(12) == b"HTTP/1.1 200"
        gc.collect()
    assert [str(w.message) for w in records if issubclass(w.category, ResourceWarning)] == []
