"""Real photographs of a board in a mirror: 17 images of 640 x 480 px from the OpenCV module
omnidir."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from tests.commands import omnimirror
from tests.conftest import SHARED

PHOTOGRAPHS = sorted((SHARED / "kaidan_omni").glob("*.jpg"))
BOARD = om.Board("chessboard", 11, 7, 30.0)

pytestmark = pytest.mark.skipif(not PHOTOGRAPHS, reason=f"the photographs are not in {SHARED}")


@pytest.mark.full
def test_all_images_are_used_with_realistic_noise(tmp_path):
    """OpenCV omnidir rejects one image with a residual of 0.465 px; here 99 % of all corners are
    within the targets."""
    file = tmp_path / "calibration.json"
    run = omnimirror(
        "calibrate",
        *map(str, PHOTOGRAPHS),
        "--board",
        "11x7",
        "--square-mm",
        "30",
        "-o",
        "camera.toml",
        "--json",
        file.name,
        "--report",
        "report",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    report = json.loads(file.read_text())
    assert all(p["used"] and p["found"] == 77 for p in report["images"])
    assert len(report["outliers"]) <= 0.01 * report["corners"] == 13.09
    assert report["rms_px"] < 0.13
    assert report["held_out_rms_px"] < 0.14
    page = (tmp_path / "report" / "calibration.html").read_text()
    figures = len(list((tmp_path / "report").glob("*.svg")))
    assert figures == page.count("<figure>") == 5
    om.load_camera(tmp_path / "camera.toml")


@pytest.mark.full
def test_targets_are_met_without_board_shape():
    calibration = om.calibrate_camera(
        om.find_boards(PHOTOGRAPHS, BOARD), BOARD, model="viewpoint-spline", board_shape=False
    )
    assert all(p.used for p in calibration.images)
    assert calibration.rms_px < 0.16
    assert calibration.held_out_rms_px < 0.18


def shifted(first, shift, images=PHOTOGRAPHS):
    """Return detections with a mirror shift applied from one image on."""
    detections = om.find_boards(images, BOARD)
    return [
        replace(d, corners_px=d.corners_px + shift) if i >= first else d
        for i, d in enumerate(detections)
    ]


@pytest.mark.full
@pytest.mark.long
@pytest.mark.parametrize("images", [PHOTOGRAPHS[::3], PHOTOGRAPHS], ids=["few", "all"])
def test_mirror_motion_after_half_of_images_is_detected(images):
    """Individual image centres do not reveal it at once: the common centre is wrong for each."""
    half = (len(images) + 1) // 2
    with pytest.raises(
        InvalidParameter, match="the mirror moved relative to the camera between them"
    ) as error:
        om.calibrate_camera(shifted(half, [9.0, 4.0], images), BOARD, model="unified")
    first, second = str(error.value).split(" px from that in ")
    assert images[half].name in first
    assert images[0].name in second


@pytest.mark.full
def test_small_or_late_mirror_motion_is_detected():
    with pytest.raises(
        InvalidParameter, match=r"in each differs from that in the other images|between them"
    ):
        om.calibrate_camera(shifted(9, [3.0, 2.0]), BOARD, model="unified")
    last = om.calibrate_camera(shifted(16, [9.0, 4.0]), BOARD, model="unified")
    assert [p.name for p in last.images if not p.used] == [PHOTOGRAPHS[16].name]


@pytest.mark.long
def test_command_line_calibrates_few_images(tmp_path):
    run = omnimirror(
        "calibrate",
        *map(str, PHOTOGRAPHS[:4]),
        "--board",
        "11x7",
        "--square-mm",
        "30",
        "--model",
        "unified",
        "--set",
        "estimation.fixed=k3",
        "--prior",
        "k2=0+-0.05",
        "-o",
        "camera.toml",
        "--json",
        "c.json",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "unified: 0." in run.stdout
    assert "4 of 4 images" in run.stdout
    assert "The fit error of 4 images is not representative of other images" in run.stdout
    camera = om.load_camera(tmp_path / "camera.toml")
    assert camera.k3 == 0.0
    assert camera.uncertainty.sigmas["k3"] == 0.0
    report = json.loads((tmp_path / "c.json").read_text())
    values = {p["name"]: p["value"] for p in report["parameters"]}
    assert values["cx"] == camera.centre_px[0]
    assert np.hypot(values["cx"] - 325.8, values["cy"] - 245.2) < 8.0  # the result of all 17


def test_wrong_board_is_reported(tmp_path):
    run = omnimirror(
        "calibrate", *map(str, PHOTOGRAPHS[:2]), "--board", "9x6", "--square-mm", "30", cwd=tmp_path
    )
    assert run.returncode == 2
    assert "a board of 11 x 7 corners was detected instead of 9 x 6 corners" in run.stderr


def test_pattern_and_folder_expand_to_images(tmp_path):
    """Same behaviour as all other commands; missing files are reported."""
    run = omnimirror("calibrate", "*.jpg", "--board", "11x7", "--square-mm", "30", cwd=tmp_path)
    assert run.returncode == 1
    assert "got *.jpg" in run.stderr
    for photograph in PHOTOGRAPHS[:2]:
        (tmp_path / photograph.name).symlink_to(photograph)
    for images in (["*.jpg"], ["."]):
        run = omnimirror("calibrate", *images, "--board", "9x6", "--square-mm", "30", cwd=tmp_path)
        assert "0 of 2 images" in run.stderr


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudoterminals")
@pytest.mark.parametrize(
    ("state", "model"),
    [
        ("Detecting boards, 4 of 6", "unified"),
        ("Detecting boards, 6 of 6", "unified"),
        ("fitting ocam", "auto"),
        ("cross-validating ", "auto"),
    ],
)
def test_interrupt_keeps_partial_results(state, model, tmp_path):
    """The signal is sent on a progress update; a throttled progress bar may never print it."""
    output, code = interrupted(
        [
            "calibrate",
            *map(str, PHOTOGRAPHS[:6]),
            "--board",
            "11x7",
            "--square-mm",
            "30",
            "--model",
            model,
            "-o",
            "camera.toml",
        ],
        state,
        tmp_path,
    )
    assert code == 130, output
    assert "Stopped: best camera so far" in output
    assert ("stopped early" in output) == (model == "auto")
    assert ("the search was stopped before this image" in output) == (
        state == "Detecting boards, 4 of 6"
    )
    om.load_camera(tmp_path / "camera.toml")


INTERRUPTED = """
import os, signal, sys
from rich.progress import Progress

state, *words = sys.argv[1:]
update, sent = Progress.update, []

def told(self, *args, description=None, **more):
    update(self, *args, description=description, **more)
    if state in (description or "") and not sent:
        sent.append(state)
        os.kill(os.getpid(), signal.SIGINT)

Progress.update = told
sys.argv = ["omnimirror", *words]
from omnimirror.apps.cli import main
main()
"""


def interrupted(arguments: list[str], state: str, cwd: Path) -> tuple[str, int]:
    """Run a command in a terminal, send SIGINT when it prints a state, and return output and exit
    code."""
    import pty

    terminal, child_terminal = pty.openpty()
    environment = {**os.environ, "COLUMNS": "200", "TERM": "xterm"}
    command = [sys.executable, "-c", INTERRUPTED, state, *arguments]
    output = ""
    with subprocess.Popen(
        command,
        cwd=cwd,
        stdin=child_terminal,
        stdout=child_terminal,
        stderr=child_terminal,
        env=environment,
    ) as run:
        os.close(child_terminal)
        with suppress(OSError):  # raised by Linux when the other side is closed
            while more := os.read(terminal, 65536):
                output += more.decode(errors="replace")
    os.close(terminal)
    return output, run.returncode
