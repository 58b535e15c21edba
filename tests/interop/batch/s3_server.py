"""Local S3 server in a separate process, and a proxy that injects faults."""

from __future__ import annotations

import http.client
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


def options(address: str, key: str = "test") -> dict[str, Any]:
    """Return the fsspec options of a server, without retries by the client library."""
    return {
        "key": key,
        "secret": "test",
        "client_kwargs": {"endpoint_url": address, "region_name": "eu-central-1"},
        "config_kwargs": {"retries": {"max_attempts": 1}, "read_timeout": 20},
        "use_listings_cache": False,
        "skip_instance_cache": True,
    }


@contextmanager
def s3_server() -> Iterator[str]:
    """Run moto's server and yield its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    code = "import sys; from moto.server import main; main(sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    address = f"http://127.0.0.1:{port}"
    try:
        end = time.monotonic() + 120
        while True:
            try:
                urllib.request.urlopen(f"{address}/moto-api/", timeout=5).close()
                break
            except OSError:
                assert time.monotonic() < end
                assert process.poll() is None
                time.sleep(0.1)
        yield address
    finally:
        process.kill()
        process.wait()


def require_credentials(address: str) -> None:
    """Reject all subsequent requests without known credentials."""
    request = urllib.request.Request(
        f"{address}/moto-api/reset-auth",
        data=b"0",
        headers={"Content-Type": "text/plain"},
        method="POST",
    )
    urllib.request.urlopen(request, timeout=20).close()


class Faults:
    """Faults of the proxy; counters of injected ones."""

    def __init__(self) -> None:
        self.period = 0
        """Every n-th request fails; none for 0."""
        self.kind = "503"
        self.delay_s = 0.0
        self.requests = self.injected = 0
        self.lock = threading.Lock()

    def applies(self) -> bool:
        """Count a request and return whether it fails."""
        with self.lock:
            self.requests += 1
            fails = self.period > 0 and self.requests % self.period == 0
            self.injected += fails
            return fails


@contextmanager
def proxy(target: str, faults: Faults) -> Iterator[str]:
    """Forward requests to a server with faults, and yield the address."""
    host = target.removeprefix("http://")

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def forward(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            time.sleep(faults.delay_s)
            if faults.applies():
                self.close_connection = True
                if faults.kind == "503":
                    self.send_response(503)
                    self.send_header("Content-Length", "0")
                    self.end_headers()
                elif faults.kind == "late":  # the request is processed, its answer is lost
                    self.send(body)
                self.connection.shutdown(socket.SHUT_RDWR)
                return
            status, headers, content = self.send(body)
            self.send_response(status)
            for name, value in headers:
                if name.lower() not in ("transfer-encoding", "connection", "content-length"):
                    self.send_header(name, value)
            length = dict(headers).get("Content-Length") if self.command == "HEAD" else None
            self.send_header("Content-Length", length or str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def send(self, body: bytes) -> tuple[int, list[tuple[str, str]], bytes]:
            connection = http.client.HTTPConnection(host, timeout=60)
            try:
                connection.request(self.command, self.path, body, dict(self.headers))
                answer = connection.getresponse()
                return answer.status, answer.getheaders(), answer.read()
            finally:
                connection.close()

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = forward

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.handle_error = lambda *_: None  # type: ignore[method-assign]
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
