"""Instructions of CONTRIBUTING.md to add a command, a tab and a compiled kernel, applied to copies
of the sources.

Mirrors, cameras, screens, quantities and formats are added by other packages:
``test_extensions.py``.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

import omnimirror as om

CHECKOUT = Path(__file__).parents[1]
WEB, NATIVE = CHECKOUT / "web", CHECKOUT / "native"


# An editable installation locates the package through a finder that precedes every path.
OF_THE_COPY = """
import sys
sys.meta_path[:] = [f for f in sys.meta_path if not type(f).__name__.startswith("ScikitBuild")]
"""
RUN_THE_COPY = f"""{OF_THE_COPY}
import runpy
runpy.run_module("omnimirror", run_name="__main__", alter_sys=True)
"""


PROGRAM = re.compile(r"(?<![\w/.-])[\w/]+/\w+\.(?:sh|py|cpp)\b")
NAMED_IN = (
    "Makefile",
    "CONTRIBUTING.md",
    "native/README.md",
    "native/sanitize.sh",
    "web/README.md",
)
UNDER = ("", "native", "web", "src", "src/omnimirror")


def ignored(files: list[Path]) -> set[str]:
    """Return the files excluded from a clone by git; empty outside a git checkout."""
    words = ["git", "check-ignore", "--stdin"]
    found = subprocess.run(
        words, input="\n".join(map(str, files)), cwd=CHECKOUT, capture_output=True, text=True
    )
    return set(found.stdout.split())


@pytest.mark.parametrize("page", NAMED_IN)
def test_programs_that_are_named_are_there(page):
    """Present here and in a clone."""
    named = {
        name
        for name in PROGRAM.findall((CHECKOUT / page).read_text())
        if not re.search("[A-Z]{3}|^build/", name)
    }
    assert named
    there = {
        name: CHECKOUT / under / name
        for name in named
        for under in UNDER
        if (CHECKOUT / under / name).is_file()
    }
    assert named - set(there) == set()
    assert ignored(list(there.values())) == set()


def test_the_table_of_mutation_testing_names_modules_and_tests_that_exist():
    table = tomllib.loads((CHECKOUT / "tests" / "mutation.toml").read_text())
    assert len(table["tests"]) >= 30
    paths = {
        part.split("::")[0]
        for row in table["tests"].items()
        for part in " ".join(row).split(" -k")[0].split()
    }
    assert {path for path in paths if not (CHECKOUT / path).exists()} == set()
    assert {entry["module"] for entry in table["equivalent"]} <= set(table["tests"])
    assert all(
        entry["reason"] and entry["before"] != entry["after"] for entry in table["equivalent"]
    )


def edit(file: Path, *changes: tuple[str, str]) -> None:
    """Replace texts that occur exactly once."""
    text = file.read_text()
    for old, new in changes:
        assert text.count(old) == 1, f"{file.name}: {old}"
        text = text.replace(old, new)
    file.write_text(text)


def run(words, folder, **environment) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, words)],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


@pytest.fixture
def copy(tmp_path) -> Path:
    """The package in a separate folder."""
    left_out = shutil.ignore_patterns("__pycache__", "_native*", "page")
    shutil.copytree(Path(om.__file__).parent, tmp_path / "src" / "omnimirror", ignore=left_out)
    return tmp_path


# -- command ---------------------------------------------------------------------------------------

COMMAND = '''"""``omnimirror rim``: how wide a mirror is."""

from __future__ import annotations

from dataclasses import dataclass

import click

from ....optics.sensor_files import load_sensor
from .._declarations import Options, option, takes
from .._option_types import NUMBER


@dataclass(frozen=True)
class ScaleOptions(Options):
    """How large the mirror is made."""

    scale: float = option(type=NUMBER, default=1.0, help="Times its own size.")


@click.command()
@click.argument("sensor")
@takes(ScaleOptions, "size")
def command(sensor: str, size: ScaleOptions) -> None:
    """Print the diameter of the mirror of SENSOR."""
    click.echo(f"{2 * size.scale * load_sensor(sensor).mirror.rim_radius_mm:.2f} mm")
'''


def test_a_command_is_a_module_and_its_name(copy):
    cli = copy / "src" / "omnimirror" / "apps" / "cli"
    (cli / "commands" / "girth.py").write_text(COMMAND)
    edit(
        cli / "__init__.py",
        (
            '    "compare": "Comp',
            '    "girth": "Print the diameter of a mirror.",\n    "compare": "Comp',
        ),
    )
    program, path = [sys.executable, "-c", RUN_THE_COPY], {"PYTHONPATH": str(copy / "src")}
    said = run([*program, "girth", "paper-spherical", "--scale", 2], copy, **path)
    assert said.stdout == "175.62 mm\n", said.stderr  # twice 2 x 43.905
    assert "Print the diameter of a mirror." in run([*program, "--help"], copy, **path).stdout
    assert (
        run([*program, "girth", "paper-spherical", "--scale", "wide"], copy, **path).returncode == 2
    )


# -- tab of the page -------------------------------------------------------------------------------

BEGIN = """import { h } from "../shared/dom";
import type { Store } from "../shared/store";

/** A tab that says how the view is turned. */
export function begin(place: HTMLElement, store: Store): void {
  const said = h("p", { role: "status" });
  place.append(said);
  store.listen((s) => (said.textContent = `${s.pan}`));
}
"""


@pytest.mark.full
def test_a_tab_is_a_room_that_the_types_and_the_rules_of_rooms_allow(tmp_path):
    if shutil.which("node") is None or not (WEB / "node_modules" / "typescript").is_dir():
        pytest.skip("the page's types need Node and web/node_modules: make node")
    web = tmp_path / "web"
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns("node_modules"))
    (web / "node_modules").symlink_to(WEB / "node_modules", target_is_directory=True)
    (web / "src" / "notes").mkdir()
    (web / "src" / "notes" / "begin.ts").write_text(BEGIN)
    edit(
        web / "src" / "shared" / "state.ts",
        ('"design", "calibrate"]', '"design", "calibrate", "notes"]'),
    )
    edit(
        web / "src" / "tabs.ts",
        (
            "import { byId, heldBy }",
            'import { begin as beginNotes } from "./notes/begin";\nimport { byId, heldBy }',
        ),
        ('calibrate: "calibrate" } as const', 'calibrate: "calibrate", notes: "notes" } as const'),
        ('calibrate: "#calibrate .desk" }', 'calibrate: "#calibrate .desk", notes: "#notes" }'),
        (
            "    const wanted = FETCHED[tab];",
            '    if (tab === "notes" && !byId("notes").hasChildNodes()) beginNotes(byId("notes"), this.store);\n'
            "    const wanted = FETCHED[tab];",
        ),
    )
    edit(
        web / "index.html",
        ('<main id="look">', '<main id="notes" hidden></main>\n<main id="look">'),
    )
    edit(
        web / "tests" / "rooms.test.ts",
        (
            '"": ["", "look", "bench", "calibrate", "shared"]',
            'notes: ["notes", "shared"], "": ["", "look", "bench", "calibrate", "notes", "shared"]',
        ),
    )
    checked = run(["node", "node_modules/typescript/bin/tsc", "--noEmit"], web)
    assert checked.returncode == 0, checked.stdout
    tested = run(["node", "node_modules/vitest/vitest.mjs", "run", "tests/rooms.test.ts"], web)
    assert tested.returncode == 0, tested.stdout + tested.stderr
    edit(
        web / "src" / "notes" / "begin.ts",
        ('"../shared/store"', '"../look/look"'),
        ("Store }", "Look as Store }"),
    )
    refused = run(["node", "node_modules/vitest/vitest.mjs", "run", "tests/rooms.test.ts"], web)
    assert refused.returncode != 0
    assert "notes/begin imports look/look" in refused.stdout + refused.stderr


# -- compiled kernel -------------------------------------------------------------------------------

HEADER = """// out[i] = 2 values[i].
#pragma once

#include <cstddef>

namespace omnimirror {

void twice(const double* values, std::size_t count, double* out);

}  // namespace omnimirror
"""
KERNEL = """#include "twice.hpp"

namespace omnimirror {

void twice(const double* values, std::size_t count, double* out) {
    for (std::size_t i = 0; i < count; ++i) out[i] = 2 * values[i];
}

}  // namespace omnimirror
"""
MODULE = """// The part of omnimirror.base._native that a test calls.
#include "bindings.hpp"
#include "twice.hpp"

namespace omnimirror {

void add_twice(nb::module_& m) {
    m.def(
        "twice",
        [](const Doubles& values, const DoublesOut& out) {
            require(values.size() == out.size(), "the arrays differ in length");
            nb::gil_scoped_release released;
            twice(values.data(), values.size(), out.data());
        },
        "values"_a, "out"_a);
}

}  // namespace omnimirror
"""
CALLS = f"""{OF_THE_COPY}
import numpy as np
from omnimirror.base.native import backend
values, out = np.arange(5.0), np.zeros(5)
backend.kernels.twice(values, out)
assert (out == 2 * values).all()
try:
    backend.kernels.twice(values, np.zeros(4))
except ValueError as e:
    print(e)
"""


@pytest.mark.full
def test_a_kernel_is_a_room_of_its_own(copy):
    if shutil.which("cmake") is None or find_spec("nanobind") is None:
        pytest.skip("kernels are compiled by cmake and nanobind, which are not both here")
    native, package = copy / "native", copy / "src" / "omnimirror"
    shutil.copytree(NATIVE, native)
    room = native / "src" / "twice"
    room.mkdir()
    for name, text in (("twice.hpp", HEADER), ("twice.cpp", KERNEL), ("module.cpp", MODULE)):
        (room / name).write_text(text)
    interface = next(
        line
        for line in (package / "native.py").read_text().splitlines()
        if line.startswith("INTERFACE")
    )
    number = int(interface.split()[2])
    edit(
        native / "src" / "bindings.hpp",
        ("void add_sampling", "void add_twice(nb::module_& m);\nvoid add_sampling"),
    )
    edit(
        native / "src" / "module.cpp",
        ("    add_sampling(m);", "    add_twice(m);\n    add_sampling(m);"),
        (f'"INTERFACE") = {number};', f'"INTERFACE") = {number + 1};'),
    )
    edit(
        native / "CMakeLists.txt",
        ("  src/pool.cpp\n", "  src/pool.cpp\n  src/twice/module.cpp\n  src/twice/twice.cpp\n"),
    )
    edit(
        package / "native.py",
        (f"INTERFACE = {number} ", f"INTERFACE = {number + 1} "),
        (
            "    def get_threads(self) -> int: ...",
            "    def twice(self, values: Array, out: Array) -> None: ...\n    def get_threads(self) -> int: ...",
        ),
    )
    built = copy / "build"
    made = run(["cmake", "-S", native, "-B", built, f"-DPython_EXECUTABLE={sys.executable}"], copy)
    assert made.returncode == 0, made.stderr
    made = run(["cmake", "--build", built, "-j", 2], copy)
    assert made.returncode == 0, made.stdout + made.stderr
    (kernels,) = built.glob("_native*.so")
    shutil.copy(kernels, package)
    called = run(
        [sys.executable, "-c", CALLS], copy, PYTHONPATH=str(copy / "src"), OMNIMIRROR_NATIVE=""
    )
    assert called.stdout == "the arrays differ in length\n", called.stderr
