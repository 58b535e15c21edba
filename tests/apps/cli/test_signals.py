"""Signals end each command with one message and its exit code, without leftover files or processes;
`main` restores the state of the calling process."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import av
import click
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import omnimirror as om
from omnimirror.apps.cli import app, main
from omnimirror.apps.cli.commands import sensors
from omnimirror.base.errors import OmnimirrorError
from omnimirror.base.native import backend
from tests.commands import omnimirror, reset_signals
from tests.everyday import few

BALL = ("--ball", "31.5,31.5,30,300")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
MARK = "OMNIMIRROR_TEST_RUN"
"""Environment variable that identifies the processes of a command."""
REQUIREMENTS = """
[field]
omega_max_deg = 120
[mirror]
family = "sphere"
rim_radius_mm = 30
[[limit]]
quantity = "total_blur_deg"
at_most = 0.8
"""
PARTS = '[parts]\ncatalogue = "typical"\n'
PATH = "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n100,1000,0,0\n"
JOB = """
[inputs]
files = ["large/*.png"]
[[sensor]]
file = "paper-spherical"
[view.front]
view = "perspective"
size = [64, 48]
[output]
url = "views"
format = ".png"
"""
VIEWS = '[front]\nview = "perspective"\nsize = [64, 48]\n'

ENDLESS_COMMANDS: dict[str, tuple[tuple[str, ...], str]] = {
    "reproduce": (("reproduce", "-o", "out"), "out/*"),
    "tolerance": (
        ("tolerance", "paper-spherical", "tolerances.toml", "--trials", "100000000", "-o", "out"),
        "out/trials/*",
    ),
    "design": (
        (
            "design",
            "--like",
            "paper-spherical",
            "--optimise",
            "worst_blur_deg",
            "--set",
            "search.starts=99",
            "--set",
            "search.resume=s.json",
        ),
        "s.json",
    ),
    "simulate": (("simulate", "paper-spherical", "--spp", "4000", "-o", "a.png"), ""),
    "dataset": (("simulate", "dataset", "paper-spherical", "--views", "500", "-o", "set"), "set/*"),
    "demo": (("demo", "-o", "out"), "out/*"),
    "dewarp a video": (
        ("dewarp", "long.mp4", *BALL, "--size", "1600x800", "-o", "view.mp4"),
        ".view*",
    ),
    "dewarp a folder": (("dewarp", "many", *BALL, "--size", "1600x800", "-o", "out"), "out/*"),
    "bracket": (("bracket", "plan", "paper-spherical"), ""),
    "evaluate": (("evaluate", "paper-spherical", "-o", "out"), ""),
    "export": (("export", "paper-spherical", "-o", "x"), ""),
    "parts": (("parts", "paper-spherical"), ""),
    "studio": (("studio", "--no-open"), "stdout"),
    "view": (("view", "long.mp4", *BALL, "--no-open"), "stdout"),
    "serve": (("serve", "long.mp4", "--views", "views.toml", *BALL), "stdout"),
    "serve and publish": (
        (
            "serve",
            "long.mp4",
            "--views",
            "views.toml",
            *BALL,
            "--publish",
            "udp://127.0.0.1:9/{view}",
        ),
        "2 processes",
    ),
    "dewarp a bag": (
        ("dewarp", "ride", *BALL, "--size", "1600x800", "-o", "straight.mcap"),
        "*.omnimirror-*",
    ),
    "dewarp with a preview": (
        ("dewarp", "long.mp4", *BALL, "--size", "64x32", "--preview"),
        "2 processes",
    ),
    "dewarp in a preview": (
        ("dewarp", "long.mp4", *BALL, "--size", "64x32", "--preview"),
        "io.live_outputs:Preview.write",
    ),
    "calibrate": (
        ("calibrate", "boards", "--board", "5x4", "--square-mm", "30", "-o", "camera.toml"),
        "2 processes",
    ),
    "design with parts": (
        ("design", "parts.toml", "--set", "search.processes=2", "--set", "search.max_designs=999"),
        "2 processes",
    ),
    "training": (
        (
            "simulate",
            "training",
            "paper-spherical",
            "--path",
            "path.csv",
            "--spp",
            "1",
            "-o",
            "set",
        ),
        "set/*",
    ),
}
"""Running commands and the evidence of their progress: a file, a line of output, processes, a call,
or a signal handler."""
REPEATED: dict[str, tuple[tuple[str, ...], str]] = {
    "sensors": (("sensors",), "apps.cli.commands.sensors:load_sensor"),
    "init": (("init", "-o", "new.toml"), "apps.cli.commands.init:write_text"),
    "schema": (("schema", "sensor", "-o", "schema.json"), "apps.cli.commands.schema:write_text"),
    "batch plan": (("batch", "plan", "job.toml"), "apps.cli.commands.batch:plan"),
    "batch run": (("batch", "run", "job.toml"), "apps.cli.commands.batch:load_job"),
    "batch status": (("batch", "status", "job.toml"), "apps.cli.commands.batch:load_job"),
    "check": (
        ("check", "lens.toml", "paper-spherical"),
        "apps.cli.commands.check:check_requirements",
    ),
    "mappings": (("mappings", "-o", "a.png"), "analysis.figures:save_figure"),
    "rays": (
        ("rays", "paper-spherical", "-o", "rays.npz", "--step", "8"),
        "apps.cli.commands.rays:write_rays",
    ),
    "maps": (
        ("maps", "paper-spherical", "-o", "out", "--formats", "stmap,opencv", "--size", "64x32"),
        "apps.cli.commands.maps:write_maps",
    ),
    "colmap": (
        ("colmap", "paper-spherical", "large", "--set", "view.size=64", "-o", "out"),
        "apps.cli.commands.colmap:load_camera",
    ),
    "spots": (("spots", "paper-spherical", "-o", "a.png"), "apps.cli.commands.spots:spots"),
    "psf": (("psf", "paper-spherical"), "apps.cli.commands.psf:psf"),
    "mtf": (("mtf", "paper-spherical"), "apps.cli.commands.mtf:mtf"),
    "illumination": (
        ("illumination", "paper-spherical"),
        "apps.cli.commands.illumination:illumination",
    ),
    "form": (
        ("form", "paper-spherical", "points.csv", "-o", "made.toml"),
        "apps.cli.commands.form:form_error",
    ),
    "compare": (
        ("compare", "paper-spherical", "paper-hyperboloidal", "-o", "a.html"),
        "apps.cli.commands.compare:compare",
    ),
    "roundtrip": (
        ("simulate", "roundtrip", "paper-spherical", "--spp", "1"),
        "apps.cli.commands.simulate:load_sensor",
    ),
    "bracket render": (
        (
            "bracket",
            "render",
            "paper-spherical",
            "--focus-mm",
            "212,228",
            "--spp",
            "1",
            "-o",
            "out",
        ),
        "apps.cli.commands.bracket:expose",
    ),
    "bracket merge": (
        (
            "bracket",
            "merge",
            "paper-spherical",
            "large/0.png",
            "large/0.png",
            "--focus-mm",
            "212,228",
            "-o",
            "a.png",
        ),
        "apps.cli.commands.bracket:merge_bracket",
    ),
    "board": (
        ("board", "--board", "5x4", "--square-mm", "30", "-o", "a.pdf"),
        "apps.cli.commands.board:write_board",
    ),
    "rim": (
        ("rim", "view/0.png", "-o", "a.png"),
        "apps.cli.commands.rim:detect_mirror_outline",
    ),
    "lines": (
        ("lines", "large/0.png", "--camera", "paper-spherical", "--rim", "512", "512", "500"),
        "apps.cli.commands.lines:load_camera",
    ),
    "uncertainty": (
        ("uncertainty", "paper-spherical"),
        "apps.cli.commands.uncertainty:load_camera",
    ),
    "measure": (
        ("measure", "paper-spherical", "700", "500", "500", "700"),
        "apps.cli.commands.measure:load_camera",
    ),
    "probe": (
        ("probe", "large/0.png", "--sensor", "paper-spherical", "-o", "a.hdr"),
        "apps.cli.commands.probe:light_probe",
    ),
    "convert": (
        ("convert", "paper-spherical", "-o", "a.yaml", "--to", "kalibr-ds", "--tolerance-px", "9"),
        "apps.cli.commands.convert:convert",
    ),
    "apertures": (("apertures", "paper-spherical"), "apps.cli.commands.apertures:best_apertures"),
}
"""Short commands, and the function of their module that a test repeats until a signal arrives."""
REPEAT_SCRIPT = """
import functools, importlib, pathlib, sys
from omnimirror.__main__ import run
is_repeated = bool(sys.argv.pop(1))
module, name = sys.argv.pop(1).split(":")
*owners, name = name.split(".")
owner = functools.reduce(getattr, owners, importlib.import_module(module))
function = getattr(owner, name)
@functools.wraps(function)
def repeated(*args, **more):
    pathlib.Path("begun").touch()
    while is_repeated:
        function(*args, **more)
    return function(*args, **more)
setattr(owner, name, repeated)
run()
"""
REPORTING_COMMANDS = ("dewarp", "simulate", "dataset", "training", "design")
"""Commands that first report completed work."""
DEFAULT_CASES = [
    ("reproduce", signal.SIGTERM),
    ("tolerance", signal.SIGHUP),
    ("dewarp a video", signal.SIGHUP),
    ("simulate", signal.SIGTERM),
    ("studio", signal.SIGHUP),
    ("serve", signal.SIGTERM),
    ("evaluate", signal.SIGINT),
    ("calibrate", signal.SIGTERM),
    ("serve and publish", signal.SIGHUP),
    ("dewarp a bag", signal.SIGTERM),
    ("dewarp with a preview", signal.SIGTERM),
    ("dewarp in a preview", signal.SIGHUP),
    ("design with parts", signal.SIGINT),
    ("rim", signal.SIGHUP),
    ("lines", signal.SIGTERM),
    ("form", signal.SIGTERM),
    ("colmap", signal.SIGINT),
    ("rays", signal.SIGHUP),
    ("maps", signal.SIGTERM),
    ("check", signal.SIGHUP),
]

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/environ").exists(), reason="looks for processes in /proc"
)


def has_handler(process: int, number: int) -> bool:
    """Check if a process has a handler for a signal, other than the interpreter's for Ctrl-C."""
    match = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process}/status").read_text())
    return bool(
        int(match[1], 16) & 1 << (number if number != signal.SIGINT else signal.SIGTERM) - 1
    )


def processes_of(mark: str) -> list[int]:
    """Return running processes with the mark in their environment."""
    processes = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes():
                processes.append(int(folder.name))
        except OSError:  # owned by others, or ended
            continue
    return processes


def wait_until(state: Callable[[], bool], run: subprocess.Popen) -> None:
    while not state():
        assert run.poll() is None, run.stderr.read()
        time.sleep(0.01)


@pytest.fixture
def folder(tmp_path):
    """A folder with inputs, and one for temporary files."""
    (tmp_path / "temporary").mkdir()
    (tmp_path / "work").mkdir()
    return tmp_path


def write_inputs(folder: Path, arguments: tuple[str, ...]) -> None:
    image = np.full((64, 64, 3), 90, np.uint8)
    if "long.mp4" in arguments:
        with av.open(str(folder / "long.mp4"), "w") as file:
            stream = file.add_stream("mpeg4", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
            for _ in range(500):
                file.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            file.mux(stream.encode())
    if "tolerances.toml" in arguments:
        omnimirror("tolerance", "init", "paper-spherical", cwd=folder)
    if "many" in arguments:
        for number in range(100):
            om.write_image(folder / "many" / f"{number}.png", image)
    for name, count, side in (("boards", 400, 320), ("view", 1, 256), ("large", 1, 1024)):
        if any(argument.startswith(name) for argument in arguments) or (
            "job.toml" in arguments and name == "large"
        ):
            for number in range(count):
                om.write_image(folder / name / f"{number}.png", noise(side))
    if "ride" in arguments:
        write_bag(folder / "ride", image)
    if "points.csv" in arguments:
        x, y = (
            grid.ravel() for grid in np.meshgrid(np.linspace(-20, 20, 30), np.linspace(-20, 20, 30))
        )
        z = om.load_sensor("paper-spherical").mirror.sag(np.hypot(x, y))
        np.savetxt(folder / "points.csv", np.column_stack([x, y, z]), delimiter=",")
    (folder / "views.toml").write_text(VIEWS)
    (folder / "job.toml").write_text(JOB)
    (folder / "requirements.toml").write_text(REQUIREMENTS)
    (folder / "lens.toml").write_text(REQUIREMENTS + "[lens]\ntheta_max_deg = 12\n")
    (folder / "parts.toml").write_text(REQUIREMENTS + PARTS)
    (folder / "path.csv").write_text(PATH)


def noise(side: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (side, side, 3), np.uint8)


def write_bag(folder: Path, image: np.ndarray) -> None:
    """Write a robot recording that repeats one image."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    height, width = image.shape[:2]
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = "sensor_msgs/msg/Image"
        connection = writer.add_connection("/camera/image_raw", kind, typestore=store)
        for number in range(500):
            header = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](number, 0), "camera"
            )
            message = types[kind](header, height, width, "rgb8", 0, 3 * width, image.ravel())
            writer.write(connection, number * 10**9, store.serialize_cdr(message, kind))


@pytest.mark.parametrize(
    ("name", "number"),
    few([(name, n) for name in (*ENDLESS_COMMANDS, *REPEATED) for n in SIGNALS], *DEFAULT_CASES),
)
def test_signal_ends_command_without_temporary_files(name, number, folder, request):
    program = ["-m", "omnimirror"]
    arguments, file = (ENDLESS_COMMANDS | REPEATED)[name]
    if ":" in file:
        program = [
            "-c",
            REPEAT_SCRIPT,
            "repeated" if name in REPEATED else "",
            f"omnimirror.{file}",
        ]
        file = "begun"
    if "--preview" in arguments:
        request.getfixturevalue("display")
    work, temporary = folder / "work", folder / "temporary"
    write_inputs(work, arguments)
    environment = {**os.environ, MARK: str(folder), "TMPDIR": str(temporary)}
    with subprocess.Popen(
        [sys.executable, *program, *arguments],
        cwd=work,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        process_group=0,
        preexec_fn=reset_signals,
    ) as run:
        if file == "stdout":
            assert run.stdout.readline()
        elif file.endswith("processes"):
            wait_until(lambda: len(processes_of(str(folder))) >= int(file.split()[0]), run)
        elif file:
            wait_until(lambda: any(work.glob(file)), run)
        else:
            wait_until(lambda: has_handler(run.pid, number), run)
        if number == signal.SIGTERM:
            run.send_signal(number)
        else:  # a terminal sends it to all processes of the command
            os.killpg(run.pid, number)
        messages = run.communicate()[1]
    assert run.returncode == 128 + number, messages
    assert "Traceback" not in messages
    assert "ignored" not in messages
    lines = [
        line for line in messages.split("\n") if not line.endswith("retrying")
    ]  # of a publisher, at any time
    assert sum("omnimirror: stopped" in line for line in lines) == 1, messages
    assert len([line for line in lines if line]) <= 1 + name.startswith(REPORTING_COMMANDS), (
        messages
    )
    assert [path.name for path in work.rglob("*") if ".omnimirror-" in path.name] == []
    assert list(temporary.rglob("*omnimirror*")) == []
    assert processes_of(str(folder)) == []


def command_paths(
    command: click.Command, parents: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    """Yield the words of each command below a group."""
    if not isinstance(command, click.Group):
        yield parents
        return
    context = click.Context(command)
    for name in command.list_commands(context):
        yield from command_paths(command.get_command(context, name), (*parents, name))


class SignalOnAccess:
    """Attribute in which the interpreter wraps the signal exception in RuntimeError."""

    def __set_name__(self, owner, name):
        signal.raise_signal(signal.SIGTERM)


def interrupted_import():
    """Raise the missing-package message for an extension module with interrupted initialisation."""
    try:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as e:
            raise ImportError("initialization failed") from e  # as pybind11 does
    except ImportError:
        raise OmnimirrorError("one more package is needed: pip install '.[exr]'") from None


@pytest.mark.parametrize(
    "interruption", [lambda: type("Owner", (), {"attribute": SignalOnAccess()}), interrupted_import]
)
def test_wrapped_signal_ends_command(interruption, monkeypatch, capsys):
    monkeypatch.setattr(sensors, "bundled_sensors", interruption)
    with pytest.raises(SystemExit) as error:
        main(["sensors"])
    assert error.value.code == 128 + signal.SIGTERM
    assert "omnimirror: stopped" in capsys.readouterr().err


def test_all_commands_are_interrupted():
    tested = [arguments for arguments, _ in (*ENDLESS_COMMANDS.values(), *REPEATED.values())]
    tested.append(("simulate", "image"))  # to which "simulate SENSOR" expands
    assert [
        arguments
        for arguments in command_paths(app)
        if not any(arguments == prefix[: len(arguments)] for prefix in tested)
    ] == []


def test_ignored_sighup_stays_ignored(tmp_path):
    """The command continues under nohup, and another signal ends it."""
    with subprocess.Popen(
        [sys.executable, "-m", "omnimirror", "studio", "--no-open"],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    ) as run:
        assert run.stdout.readline()
        run.send_signal(signal.SIGHUP)
        run.send_signal(signal.SIGTERM)
        assert run.communicate()[1] == "omnimirror: stopped\n"
    assert run.returncode == 128 + signal.SIGTERM


# -- process state after main
# ----------------------------------------------------------------------------


def state() -> dict[str, object]:
    """Return the process state that a command could change."""
    return {
        "signals": {n: signal.getsignal(n) for n in signal.valid_signals()},
        "environment": dict(os.environ),
        "warnings": list(warnings.filters),
        "showwarning": warnings.showwarning,
        "hooks": (sys.excepthook, sys.unraisablehook, sys.displayhook),
        "argv": list(sys.argv),
        "path": list(sys.path),
        "streams": (sys.stdin, sys.stdout, sys.stderr),
        "errors": (sys.stdout.errors, sys.stderr.errors),
        "descriptors": [(os.fstat(n).st_dev, os.fstat(n).st_ino) for n in range(3)],
        "folder": Path.cwd(),
        "numbers": np.geterr(),
        "threads": backend.threads,
        "recursion": sys.getrecursionlimit(),
    }


CALLS = {
    "success": (("sensors",), None),
    "quiet": (("sensors", "--quiet"), None),
    "help": (("--help",), None),
    "wrong use": (("evaluate", "--no-such-option"), 2),
    "error": (("evaluate", "nothing.toml"), 1),
    "threads": (("dewarp", "a.png", *BALL, "-o", "b.png", "--set", "resampling.threads=3"), None),
    "debug": (("evaluate", "nothing.toml", "--debug"), 1),
}


@pytest.mark.parametrize("name", CALLS)
def test_main_restores_process_state(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    om.write_image(tmp_path / "a.png", np.full((64, 64, 3), 90, np.uint8))
    arguments, code = CALLS[name]
    before = state()
    if code is None:
        main(list(arguments))
    else:
        with pytest.raises(SystemExit) as error:
            main(list(arguments))
        assert error.value.code == code
    assert state() == before


@pytest.mark.parametrize("number", SIGNALS)
def test_main_restores_process_state_after_signal(number, monkeypatch, capsys):
    inherited = {n: signal.getsignal(n) for n in SIGNALS}
    reset_signals()  # background jobs and nohup ignore some
    try:
        before = state()
        monkeypatch.setattr(sensors, "bundled_sensors", lambda: signal.raise_signal(number))
        with pytest.raises(SystemExit) as error:
            main(["sensors"])
        assert error.value.code == 128 + number
        assert "omnimirror: stopped" in capsys.readouterr().err
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert state() == before
    finally:
        for n, handler in inherited.items():
            signal.signal(n, handler)


def test_main_keeps_streams_of_caller(tmp_path):
    """Separate process with standard error at descriptor 2: C code of the caller can write to it
    again."""
    code = (
        "import os, signal, sys, omnimirror.apps.cli as cli\n"
        "cli.main(['sensors', '--quiet'])\n"
        "try: cli.main(['evaluate', 'nothing.toml'])\n"
        "except SystemExit as e: print(e.code)\n"
        "os.write(2, b'by the caller')\n"
        "assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL\n"
        "assert 'OPENBLAS_NUM_THREADS' not in os.environ\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    assert (run.returncode, run.stdout) == (0, "1\n"), run.stderr
    assert run.stderr.startswith("omnimirror: ")
    assert run.stderr.endswith("by the caller")


@pytest.mark.parametrize("function", ["cli.app.invoke", "cli.main"])
def test_ctrl_c_during_exec_sets_exit_code(function, tmp_path):
    """Case of dataclass definitions: the interpreter would end with SIGINT even if the exception is
    handled."""
    (tmp_path / "interrupted.py").write_text(
        "import signal, sys, omnimirror.apps.cli as cli\n"
        "from omnimirror.__main__ import run\n"
        "def work(*args, **more): exec('signal.raise_signal(signal.SIGINT)')\n"
        f"{function} = work\n"
        "sys.argv = ['omnimirror', 'sensors']\n"
        "run()\n"
    )
    run = subprocess.run(
        [sys.executable, "-m", "interrupted"],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=tmp_path,
        preexec_fn=reset_signals,
    )
    assert (run.returncode, run.stderr.strip()) == (128 + signal.SIGINT, "omnimirror: stopped")


def test_unraisable_signal_is_resent(capsys):
    """An exception in a destructor is lost; the command ends regardless."""
    code = (
        "import signal, sys, time, omnimirror.apps.cli as cli\n"
        "class Deaf:\n"
        "    def __del__(self): signal.raise_signal(signal.SIGTERM); sum(range(100))\n"
        "def work(*args, **more):\n"
        "    Deaf()\n"
        "    while True: time.sleep(0.01)\n"
        "cli.app.invoke = work\n"
        "cli.main(['sensors'])\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert run.returncode == 128 + signal.SIGTERM
    assert run.stderr.strip() == "omnimirror: stopped"


def test_signal_during_import_is_resent(tmp_path):
    """Extension modules such as OpenEXR discard exceptions during their initialisation."""
    (tmp_path / "discarding.py").write_text(
        "import signal\ntry: signal.raise_signal(signal.SIGTERM)\nexcept KeyboardInterrupt: pass\n"
    )
    code = (
        "import time, omnimirror.apps.cli as cli\n"
        "def work(*args, **more):\n"
        "    import discarding\n"
        "    time.sleep(60)\n"
        "cli.app.invoke = work\n"
        "cli.main(['sensors'])\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, cwd=tmp_path
    )
    assert (run.returncode, run.stderr.strip()) == (128 + signal.SIGTERM, "omnimirror: stopped")
