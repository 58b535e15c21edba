"""Exit codes: 2 for incorrect usage, 1 for all other errors."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import omnimirror as om
from tests.commands import omnimirror

BALL = ("--ball", "31.5,31.5,30,300")
DESIGN = ("design", "--optimise", "worst_blur_deg")


@pytest.fixture
def folder(tmp_path):
    om.write_image(tmp_path / "a.png", np.full((64, 64, 3), 90, np.uint8))
    (tmp_path / "broken.toml").write_text("name = ")
    (tmp_path / "broken.png").write_bytes(b"no picture")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ("dewarp", "a.png", "-o", "b.png"),  # no camera
        ("dewarp", "a.png", *BALL),  # no output
        ("dewarp", "a.png", *BALL, "-o", "a.png"),
        ("dewarp", "a.png", *BALL, "-o", "b.jpg", "--set=image.transparent=true"),
        ("dewarp", "a.png", "a.png", *BALL, "-o", "b.png"),
        ("dewarp", "a.png", *BALL, "-o", "b.png", "--restore"),
        ("dewarp", "a.png", *BALL, "-o", "b.png", "--border", "blue-ish"),
        ("dewarp", "a.png", *BALL, "-o", "b.png", "--set", "video.codec=h264"),
        (
            "dewarp",
            "a.png",
            *BALL,
            "-o",
            "b.png",
            "--view",
            "cylinder",
            "--set",
            "view.wall_mm=100:50",
        ),
        ("dewarp", "a.png", *BALL, "-o", "b.png", "--pan-deg", "west"),
        ("calibrate", "a.png"),  # no board
        ("calibrate", "a.png", "--board", "7x5"),  # no square size
        ("board", "-o", "b.pdf"),
        ("bracket", "merge", "paper-spherical", "a.png", "-o", "m.png"),  # no focus distances
        ("evaluate", "paper-spherical", "--object-distance-mm", "-1"),
        ("psf", "paper-spherical", "--omega-deg", "0:130:1", "-o", "p.png"),
        ("simulate", "paper-spherical", "-o", "p.jpg", "--set", "detector.bits=12"),
        ("simulate", "paper-spherical", "-o", "p.png", "--spp", "0"),
        ("simulate", "dataset", "-o", "set"),
        ("compare", *["paper-spherical"] * 7),
        ("apertures", "paper-spherical", "--f-number", "8:4"),
        (*DESIGN, "--set", "search.starts=0"),
        (*DESIGN, "--set", "search.resume=s.json", "--set", "search.terms=3,4"),
        ("design", "--pareto", "worst_blur_deg"),
        ("init", "--no-such-option"),
        ("nothing",),
    ],
    ids=" ".join,
)
def test_usage_errors_exit_with_2(folder, arguments):
    run = omnimirror(*arguments, cwd=folder)
    assert run.returncode == 2, run.stderr
    assert run.stderr.startswith("omnimirror: ")
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("dewarp", "missing.png", *BALL, "-o", "b.png"),
        ("dewarp", "broken.png", *BALL, "-o", "b.png"),
        ("dewarp", "a.png", "--sensor", "broken.toml", "-o", "b.png"),
        ("evaluate", "missing.toml"),
        ("evaluate", "broken.toml"),
        ("design", "broken.toml"),
        ("check", "missing.toml", "paper-spherical"),
        ("simulate", "paper-spherical", "--scene", "missing.hdr", "-o", "p.png"),
        ("simulate", "dataset", "--reproduce", "broken.toml", "-o", "set"),
        ("parts", "paper-spherical", "missing.csv"),
        ("evaluate", "paper-spherical", "--omega-deg", "170"),  # outside the field of this sensor
    ],
    ids=" ".join,
)
def test_missing_or_invalid_files_exit_with_1(folder, arguments):
    run = omnimirror(*arguments, cwd=folder)
    assert run.returncode == 1, run.stderr
    assert run.stderr.startswith("omnimirror: ")
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "statement",
    [
        "from omnimirror.apps.cli import main; main('dewarp a.png --ball 31.5,31.5,30,300 -o b.png'.split())",
        "import omnimirror as om; om.read_image('a.png')",
    ],
)
def test_missing_opencv_raises_with_remedy(statement, folder):
    """The folder cv2 is missing, as after removal of one of two OpenCV packages."""
    code = f"import sys; sys.modules['cv2'] = None; {statement}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=folder)
    assert run.returncode == 1
    last = run.stderr.strip().splitlines()[-1]
    assert "cannot import OpenCV" in last
    assert last.endswith("pip install --force-reinstall --no-deps opencv-python-headless")
    assert "internal error" not in run.stderr


@pytest.mark.parametrize(
    "statement",
    [
        "from omnimirror.apps.cli import main; main('dewarp a.png --ball 31.5,31.5,30,300 -o b.png'.split())",
        "import omnimirror as om; om.Dewarper",
    ],
)
def test_incomplete_opencv_raises_with_remedy(statement, folder):
    """Other files remain in the folder cv2, which is imported as an empty namespace package."""
    code = f"import sys, types; sys.modules['cv2'] = types.ModuleType('cv2'); {statement}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=folder)
    assert run.returncode == 1
    last = run.stderr.strip().splitlines()[-1]
    assert "cannot import OpenCV (module 'cv2' has no attribute" in last
    assert last.endswith("pip install --force-reinstall --no-deps opencv-python-headless")
