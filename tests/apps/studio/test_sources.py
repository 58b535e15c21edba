"""Sources of the page in web/: types, build results, and unit tests."""

from __future__ import annotations

import base64
import gzip
import json
import os
import runpy
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import omnimirror as om

WEB = Path(__file__).parents[3] / "web"
PAGE = Path(om.__file__).parent / "apps" / "studio" / "page"
MADE = runpy.run_path(str(WEB / "tests" / "fixtures" / "make.py"))
LARGEST = {"index.html": 135_000, "design.js": 180_000, "space.js": 20_000, "calibrate.js": 60_000}
"""Sizes in bytes; larger growth than a feature requires fails."""
COMPRESSED = 150_000  # bytes of everything but the 3-D view; the requirement is twice as large


def tool(name: str, *words: object) -> subprocess.CompletedProcess[str]:
    """Run a tool of the page, or skip if it is not installed."""
    path = WEB / "node_modules" / ".bin" / name
    if not path.exists():
        pytest.skip(f"{name} is not here: `npm ci` in web/, or `make node`, fetches it")
    environment = {**os.environ, "NODE_ENV": "production", "NO_COLOR": "1"}
    return subprocess.run(
        [path, *map(str, words)], cwd=WEB, capture_output=True, text=True, env=environment
    )


def test_types_of_page_match_server():
    written = (WEB / "src" / "shared" / "messages.ts").read_text()
    assert runpy.run_path(str(WEB / "message_types.py"))["typescript"]() == written


def test_page_is_built_from_its_sources(tmp_path):
    for words in (
        (),
        *(("--mode", name, "--emptyOutDir", "false") for name in ("design", "space", "calibrate")),
    ):
        built = tool("vite", "build", *words, "--outDir", tmp_path, "--logLevel", "error")
        assert built.returncode == 0, built.stderr
    for name, largest in LARGEST.items():
        assert (tmp_path / name).read_text() == (PAGE / name).read_text(), (
            "`make page` builds it anew"
        )
        assert (PAGE / name).stat().st_size < largest
    assert (
        sum(
            len(gzip.compress((PAGE / name).read_bytes())) for name in LARGEST if name != "space.js"
        )
        < COMPRESSED
    )


def test_type_check_of_page_passes():
    checked = tool("tsc", "--noEmit")
    assert checked.returncode == 0, checked.stdout


def test_unit_tests_of_page_pass():
    run = tool("vitest", "run")
    assert run.returncode == 0, run.stdout + run.stderr


def alike(here: Any, there: Any) -> bool:
    """Check if two JSON texts are equal, numbers to single precision."""
    if isinstance(here, dict):
        return here.keys() == there.keys() and all(
            close(here[k], there[k])
            if k == "tables" and isinstance(here[k], str)
            else alike(here[k], there[k])
            for k in here
        )
    if isinstance(here, list | tuple):
        return len(here) == len(there) and all(map(alike, here, there))
    if isinstance(here, float):
        return here == pytest.approx(there, rel=1e-6, abs=2e-5)
    return here == there


def close(here: str, there: str) -> bool:
    """Check if two tables of float32 values, in base64, are equal up to rounding."""
    a, b = (np.frombuffer(base64.b64decode(text), "<f4") for text in (here, there))
    return a.shape == b.shape and np.allclose(a, b, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("name", ["cameras", "views"])
def test_reference_values_of_unit_tests_match_python(name):
    kept = json.loads((WEB / "tests" / "fixtures" / f"{name}.json").read_text())
    assert alike(json.loads(MADE["written"](MADE[name]())), kept), (
        "python web/tests/fixtures/make.py writes them anew"
    )
