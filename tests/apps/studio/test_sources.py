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
FIXTURES = runpy.run_path(str(WEB / "tests" / "fixtures" / "make.py"))
MAX_BYTES = {
    "index.html": 160_000,
    "design.js": 195_000,
    "space.js": 20_000,
    "calibrate.js": 60_000,
    "webgpu.js": 22_000,
}
"""Sizes in bytes; larger growth than a feature requires fails."""
MAX_COMPRESSED_BYTES = (
    150_000  # bytes of everything but the 3-D view; the requirement is twice as large
)


def run_tool(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a tool of the page, or skip if it is not installed."""
    path = WEB / "node_modules" / ".bin" / name
    if not path.exists():
        pytest.skip(f"{name} is not here: `npm ci` in web/, or `make node`, fetches it")
    environment = {**os.environ, "NODE_ENV": "production", "NO_COLOR": "1"}
    return subprocess.run(
        [path, *map(str, arguments)], cwd=WEB, capture_output=True, text=True, env=environment
    )


def test_types_of_page_match_server():
    types = (WEB / "src" / "shared" / "messages.ts").read_text()
    assert runpy.run_path(str(WEB / "message_types.py"))["typescript"]() == types


def test_page_is_built_from_its_sources(tmp_path):
    for arguments in (
        (),
        *(
            ("--mode", name, "--emptyOutDir", "false")
            for name in ("design", "space", "calibrate", "webgpu")
        ),
    ):
        built = run_tool("vite", "build", *arguments, "--outDir", tmp_path, "--logLevel", "error")
        assert built.returncode == 0, built.stderr
    for name, max_bytes in MAX_BYTES.items():
        assert (tmp_path / name).read_text() == (PAGE / name).read_text(), (
            "`make page` builds it anew"
        )
        assert (PAGE / name).stat().st_size < max_bytes
    assert (
        sum(
            len(gzip.compress((PAGE / name).read_bytes()))
            for name in MAX_BYTES
            if name != "space.js"
        )
        < MAX_COMPRESSED_BYTES
    )


def test_type_check_of_page_passes():
    checked = run_tool("tsc", "--noEmit")
    assert checked.returncode == 0, checked.stdout


def test_unit_tests_of_page_pass():
    run = run_tool("vitest", "run")
    assert run.returncode == 0, run.stdout + run.stderr


def is_equal(value: Any, expected: Any) -> bool:
    """Check if two JSON texts are equal, numbers to single precision."""
    if isinstance(value, dict):
        return value.keys() == expected.keys() and all(
            is_close(value[k], expected[k])
            if k == "tables" and isinstance(value[k], str)
            else is_equal(value[k], expected[k])
            for k in value
        )
    if isinstance(value, list | tuple):
        return len(value) == len(expected) and all(map(is_equal, value, expected))
    if isinstance(value, float):
        return value == pytest.approx(expected, rel=1e-6, abs=2e-5)
    return value == expected


def is_close(value: str, expected: str) -> bool:
    """Check if two tables of float32 values, in base64, are equal up to rounding."""
    a, b = (np.frombuffer(base64.b64decode(text), "<f4") for text in (value, expected))
    return a.shape == b.shape and np.allclose(a, b, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("name", ["cameras", "views"])
def test_reference_values_of_unit_tests_match_python(name):
    expected = json.loads((WEB / "tests" / "fixtures" / f"{name}.json").read_text())
    assert is_equal(json.loads(FIXTURES["one_entry_per_line"](FIXTURES[name]())), expected), (
        "python web/tests/fixtures/make.py writes them anew"
    )
