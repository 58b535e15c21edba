"""Command line in separate processes, with their streams and exit codes.

On Linux, these processes are forked from one with preloaded modules: the start of Python and the
import of NumPy, SciPy and Matplotlib take ten times as long as most commands. That process computes
no results and has no threads; a command therefore runs as in a new process. Tests of the program
start (deferred imports, unusual streams, signals) run the program directly.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

PROGRAM = Path(sys.executable).with_name("omnimirror")
LATER = """
matplotlib.figure matplotlib.backends.backend_agg matplotlib.backends.backend_svg PIL.JpegImagePlugin cv2 av
scipy.integrate scipy.interpolate scipy.ndimage scipy.optimize scipy.spatial scipy.special
omnimirror.base._native omnimirror.dewarp.video_files omnimirror.analysis.figures.aperture
""".split()  # noqa: SIM905
"""Deferred imports of the commands."""


def omnimirror(
    *args: object, cwd: Path | None = None, text: bool = True
) -> subprocess.CompletedProcess[Any]:
    """Run a command; return its exit code and output streams."""
    arguments = [str(arg) for arg in args]
    if sys.platform != "linux":  # graphics libraries of other systems do not support a fork
        return subprocess.run([PROGRAM, *arguments], capture_output=True, text=text, cwd=cwd)
    return _forks().command(arguments, cwd or Path.cwd(), text)


def fails(*args: object, cwd: Path | None = None) -> str:
    """Run a command, expect failure, and return the error message."""
    process = omnimirror(*args, cwd=cwd)
    assert process.returncode != 0
    assert "Traceback" not in process.stderr
    lines = process.stderr.strip().splitlines()
    assert len(lines) == 1, process.stderr
    return lines[0]


def reset_signals() -> None:
    """Reset signals to their default actions: background jobs and nohup ignore some, and children
    inherit that."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Forks:
    """Process with preloaded modules in an environment, and a connection for its commands."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._environment = environment
        self._line, its = socket.socketpair()
        code = "import sys; from tests.commands import serve; serve(int(sys.argv[1]))"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, str(its.fileno())],
            pass_fds=[its.fileno()],
            cwd=Path(__file__).parents[1],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env={**environment, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
        )
        its.close()
        atexit.register(self.kill)

    def command(
        self, arguments: list[str], cwd: Path, text: bool = True
    ) -> subprocess.CompletedProcess[Any]:
        """Run a command and return its result."""
        code, *streams = self._run(arguments, cwd)
        if text:
            streams = [stream.decode().replace("\r\n", "\n") for stream in streams]
        return subprocess.CompletedProcess(arguments, code, *streams)

    def _run(self, arguments: list[str], cwd: Path) -> tuple[int, bytes, bytes]:
        """Return exit code, standard output and standard error."""
        request = json.dumps(
            {"arguments": arguments, "cwd": str(cwd), "environment": dict(self._environment)}
        ).encode()
        (out, its_out), (err, its_err) = os.pipe(), os.pipe()
        try:
            socket.send_fds(self._line, [len(request).to_bytes(8, "big")], [its_out, its_err])
            self._line.sendall(request)
            os.close(its_out)
            os.close(its_err)
            outputs = _all_of(out, err)
            code = _exactly(self._line, 8)
        except BaseException:  # the next test must not read the response of an interrupted one
            self.kill()
            raise
        return int.from_bytes(code, "big", signed=True), *outputs  # type: ignore[return-value]

    def kill(self) -> None:
        """Terminate the process and all its forks."""
        if _forks.cache_info().currsize and _forks() is self:
            _forks.cache_clear()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


@cache
def _forks() -> Forks:
    return Forks()


def _all_of(*ends: int) -> list[bytes]:
    """Read several pipes simultaneously until all are closed."""
    outputs = dict.fromkeys(ends, b"")
    with selectors.DefaultSelector() as waiting:
        for end in ends:
            waiting.register(end, selectors.EVENT_READ)
        while waiting.get_map():
            for key, _ in waiting.select():
                if more := os.read(key.fd, 65536):
                    outputs[key.fd] += more
                else:
                    waiting.unregister(key.fd)
                    os.close(key.fd)
    return list(outputs.values())


def _exactly(line: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        if not (more := line.recv(size - len(data))):
            raise EOFError("the process with preloaded modules has ended")
        data += more
    return data


# -- in the preloaded process
# -------------------------------------------------------------------------------


def serve(line_number: int) -> None:
    """Fork one process per command until the connection is closed."""
    from omnimirror.apps import cli

    for name in cli.COMMANDS:
        cli.app.get_command(None, name)  # type: ignore[arg-type]
    for name in LATER:
        with suppress(ImportError):  # of an extra that is not installed
            import_module(name)
    gc.collect()
    gc.freeze()
    line = socket.socket(fileno=line_number)
    while True:
        size, streams, _, _ = socket.recv_fds(line, 8, 2)
        if not size:
            return
        request = json.loads(_exactly(line, int.from_bytes(size, "big")))
        if pid := os.fork():
            for stream in streams:
                os.close(stream)
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            line.sendall(code.to_bytes(8, "big", signed=True))
        else:
            line.close()
            _run(request, streams)


def _run(request: dict[str, Any], streams: list[int]) -> None:
    """Run the command with streams, folder and environment of the client, and end the process."""
    from omnimirror.apps.cli import main

    for number, stream in enumerate(streams, 1):
        os.dup2(stream, number)
        os.close(stream)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", 1, encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = [str(PROGRAM), *request["arguments"]]
    code: object = 0
    try:
        main()
    except SystemExit as e:
        code = e.code
    except BaseException:
        sys.excepthook(*sys.exc_info())  # type: ignore[arg-type]
        code = 1
    threading._shutdown()  # interpreter shutdown without the teardown of modules
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code if isinstance(code, int) else int(code is not None))
