"""Instructions of CONTRIBUTING.md, applied to copies of the sources: mirror, camera model, export
format, camera file format, command, tab and compiled kernel.

Extensions in other packages: ``test_extensions.py``.
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

import numpy as np
import pytest

import omnimirror as om

CHECKOUT = Path(__file__).parents[1]
WEB, NATIVE = CHECKOUT / "web", CHECKOUT / "native"


# An editable installation locates the package by a finder that precedes sys.path.
COPY_FINDER = """
import sys
sys.meta_path[:] = [f for f in sys.meta_path if not type(f).__name__.startswith("ScikitBuild")]
"""
RUN_THE_COPY = f"""{COPY_FINDER}
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
    command = ["git", "check-ignore", "--stdin"]
    process = subprocess.run(
        command, input="\n".join(map(str, files)), cwd=CHECKOUT, capture_output=True, text=True
    )
    return set(process.stdout.split())


@pytest.mark.parametrize("page", NAMED_IN)
def test_named_programs_exist(page):
    """The named programs are present here and in a clone."""
    names = {
        name
        for name in PROGRAM.findall((CHECKOUT / page).read_text())
        if not re.search("[A-Z]{3}|^build/", name)
    }
    assert names
    paths = {
        name: CHECKOUT / under / name
        for name in names
        for under in UNDER
        if (CHECKOUT / under / name).is_file()
    }
    assert names - set(paths) == set()
    assert ignored(list(paths.values())) == set()


def test_mutation_table_names_existing_modules_and_tests():
    table = tomllib.loads((CHECKOUT / "tests" / "mutation.toml").read_text())
    assert len(table["tests"]) >= 30
    paths = {
        part.split("::")[0]
        for row in table["tests"].items()
        for part in " ".join(row).split(" -k")[0].split()
    }
    assert {path for path in paths if not (CHECKOUT / path).exists()} == set()
    assert {entry["module"] for entry in table["equivalent"]} <= set(table["tests"])
    for entry in table["equivalent"]:
        source = " ".join((CHECKOUT / entry["module"]).read_text().split())
        assert entry["reason"]
        assert entry["mutants"]
        for before, after in entry["mutants"]:
            assert before in source, f"{entry['module']}: {before}"
            assert before != after


def edit(file: Path, *changes: tuple[str, str]) -> None:
    """Replace texts that occur exactly once."""
    text = file.read_text()
    for old, new in changes:
        assert text.count(old) == 1, f"{file.name}: {old}"
        text = text.replace(old, new)
    file.write_text(text)


def run(command, folder, **environment) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, command)],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


def command_of(copy: Path, *arguments) -> subprocess.CompletedProcess[str]:
    """Run a command of a copy."""
    program = [sys.executable, "-c", RUN_THE_COPY, *arguments]
    return run(program, copy, PYTHONPATH=str(copy / "src"))


def use(copy: Path, code: str) -> list[str]:
    """Run a program that imports a copy; return the printed lines."""
    process = run([sys.executable, "-c", COPY_FINDER + code], copy, PYTHONPATH=str(copy / "src"))
    assert process.returncode == 0, process.stderr
    return process.stdout.splitlines()


@pytest.fixture
def copy(tmp_path) -> Path:
    """The package in a separate folder."""
    left_out = shutil.ignore_patterns("__pycache__", "_native*", "page")
    shutil.copytree(Path(om.__file__).parent, tmp_path / "src" / "omnimirror", ignore=left_out)
    return tmp_path


# -- mirror ----------------------------------------------------------------------------------------

MIRROR = """
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.parameters import Parameter
from .mirror import RIM_RADIUS, Mirror


@dataclass(frozen=True)
class Paraboloid(Mirror):
    depth_mm: float
    rim_radius_mm: float
    KIND: ClassVar[str] = "bowl"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "depth_mm": Parameter("mm", 0.1, 1e3, "height of the rim above the vertex"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    def profile(self, x_mm: ArrayLike):
        x, a = np.asarray(x_mm, dtype=float), self.depth_mm / self.rim_radius_mm**2
        return a * x**2, 2 * a * x, np.full_like(x, 2 * a)
"""
MIRROR_USE = """
import omnimirror as om
from omnimirror.apps.studio._design_sensors import design_start
from omnimirror.optics.mirrors.bowl import Paraboloid
from omnimirror.optics.testing import check_mirror

check_mirror(Paraboloid(20.0, 44.0))
print("bowl" in [mirror.kind for mirror in design_start().mirrors])
text = om.sensor_template()
print('kind = "bowl"' in text)
"""


def test_adding_a_mirror(copy):
    mirrors = copy / "src" / "omnimirror" / "optics" / "mirrors"
    (mirrors / "bowl.py").write_text(MIRROR)
    edit(
        mirrors / "__init__.py",
        ("from .splines import", "from .bowl import Paraboloid\nfrom .splines import"),
        (
            "SHAPES: tuple[type[Mirror], ...] = (\n",
            "SHAPES: tuple[type[Mirror], ...] = (\n    Paraboloid,\n",
        ),
    )
    assert use(copy, MIRROR_USE) == ["True", "True"]


# -- camera model ----------------------------------------------------------------------------------

MODEL = """
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera_model import FocalModel, Optics, RadialProjection


@dataclass(frozen=True, kw_only=True)
class Stereographic(FocalModel):
    # r = 2 tan(Omega / 2)
    optics: Optics = "fisheye"

    KIND = "stereographic"
    _projection_end = np.radians(170.0)

    @property
    def _parameter_slots(self):
        return (), self._affine_slots

    def _projected_radius(self, omega):
        return 2 * np.tan(omega / 2)

    def _projection(self, omega):
        rate = 1 / np.cos(omega / 2) ** 2
        return RadialProjection(self._projected_radius(omega), rate, np.empty((len(omega), 0)))

    def _inverse_projection(self, radius):
        return 2 * np.arctan(radius / 2)
"""
MODEL_USE = """
import numpy as np
import omnimirror as om
from omnimirror.cameras.models.stereographic import Stereographic

board = om.Board(columns=8, rows=6, square_mm=30.0)
truth = Stereographic(
    focal_px=(150.0, 150.0), centre_px=(319.5, 239.5), image_size=(640, 480)
)
corners = om.simulate_detections(truth, board, 8, noise_px=0.0)
fit = om.calibrate_camera(corners, board, model="stereographic", optics="fisheye", board_shape=False)
om.save_camera(fit.model, "camera.toml")
loaded = om.load_camera("camera.toml")
print(type(loaded).__name__, np.allclose(loaded.focal_px, 150.0, atol=0.01))
"""


def test_adding_a_camera_model(copy):
    package = copy / "src" / "omnimirror"
    models, estimation = package / "cameras" / "models", package / "calibration" / "estimation"
    (models / "stereographic.py").write_text(MODEL)
    edit(
        models / "__init__.py",
        ("    | MirrorBall\n", "    | MirrorBall\n    | Stereographic\n"),
        (
            "\nCalibratedCamera: TypeAlias",
            "from .stereographic import Stereographic\n\nCalibratedCamera: TypeAlias",
        ),
    )
    edit(
        estimation / "model_sequence.py",
        (
            "KINDS: dict[str, ModelConstructor] = {\n",
            "def _stereographic(u: Unified, omega_max_deg: float) -> CameraModel:\n"
            "    from ...cameras.models.stereographic import Stereographic\n\n"
            "    return Stereographic(\n"
            "        focal_px=_focal(u), centre_px=u.centre_px, image_size=u.image_size, optics=u.optics\n"
            "    )\n\n\n"
            'KINDS: dict[str, ModelConstructor] = {\n    "stereographic": _stereographic,\n',
        ),
    )
    assert use(copy, MODEL_USE) == ["Stereographic True"]
    assert "stereographic" in command_of(copy, "calibrate", "--help").stdout


# -- export format ---------------------------------------------------------------------------------

EXPORT = """
from __future__ import annotations

from pathlib import Path

import numpy as np

from ...optics.mirrors import Mirror


def write_profile(path: Path, mirror: Mirror) -> float:
    x = np.linspace(0, mirror.rim_radius_mm, 5)
    np.savetxt(path, np.stack([x, mirror.sag(x)], axis=1), fmt="%.6f")
    return 5e-7
"""


def test_adding_an_export_format(copy):
    manufacturing = copy / "src" / "omnimirror" / "manufacturing"
    (manufacturing / "formats" / "profile.py").write_text(EXPORT)
    edit(
        manufacturing / "exporter.py",
        (
            "BUILT_IN_FORMATS = {\n",
            "def _profile(plan, part, path):\n"
            "    from .formats.profile import write_profile\n\n"
            '    return Content("5 points", write_profile(path, part.mirror))\n\n\n'
            'BUILT_IN_FORMATS = {\n    "profile": Format(_profile, (".profile",)),\n',
        ),
    )
    run_of_copy = command_of(copy, "export", "paper-spherical", "-o", "mirror.profile")
    assert run_of_copy.returncode == 0, run_of_copy.stderr
    x, z = np.loadtxt(copy / "mirror.profile").T
    np.testing.assert_allclose(z, om.load_sensor("paper-spherical").mirror.sag(x), atol=1e-6)
    assert "profile" in command_of(copy, "export", "--help").stdout


# -- camera file format ----------------------------------------------------------------------------

CAMERA_FORMAT = """
from __future__ import annotations

from ...cameras.models import Unified
from ._camera_format import CameraEntry, CameraFormat, Layout


def read(file, reading):
    _, xi, f, u, v, width, height = file.text.split()
    camera = Unified(
        xi=float(xi),
        focal_px=(float(f), float(f)),
        centre_px=(float(u), float(v)),
        image_size=(int(width), int(height)),
        **reading.model_arguments,
    )
    return [CameraEntry("", camera)]


def write(camera, name=""):
    numbers = (camera.xi, camera.focal_px[0], *camera.centre_px, *camera.image_size)
    return "mei " + " ".join(map(str, numbers))


FORMAT = CameraFormat(
    "one line of MEI parameters",
    lambda file: file.text.startswith("mei "),
    read,
    {"mei-line": Layout(Unified, write, "mei")},
    ("*.mei",),
)
"""


def test_adding_a_camera_file_format(copy):
    formats = copy / "src" / "omnimirror" / "calibration" / "formats"
    (formats / "_mei_line.py").write_text(CAMERA_FORMAT)
    edit(
        formats / "_registry.py",
        ("    _kalibr,\n", "    _kalibr,\n    _mei_line,\n")
        if "    _kalibr,\n" in (formats / "_registry.py").read_text()
        else ("_kalibr, ", "_kalibr, _mei_line, "),
        ("BUILT_IN_FORMATS = {\n", 'BUILT_IN_FORMATS = {\n    "mei-line": _mei_line.FORMAT,\n'),
    )
    (copy / "a.mei").write_text("mei 1.0 200.0 319.5 239.5 640 480")
    read_back = command_of(
        copy, "convert", "a.mei", "-o", "camera.toml", "--set", "camera.optics=fisheye"
    )
    assert read_back.returncode == 0, read_back.stderr
    assert om.load_camera(copy / "camera.toml").xi == 1.0
    export_process = command_of(copy, "convert", "camera.toml", "-o", "b.mei", "--to", "mei-line")
    assert export_process.returncode == 0, export_process.stderr
    assert (copy / "b.mei").read_text().split() == [
        "mei",
        "1.0",
        "200.0",
        "319.5",
        "239.5",
        "640",
        "480",
    ]


# -- command ---------------------------------------------------------------------------------------

COMMAND = '''"""``omnimirror girth``: diameter of a mirror."""

from __future__ import annotations

from dataclasses import dataclass

import click

from ....optics.sensor_files import load_sensor
from .._declarations import NUMBER, Options, add_options, option


@dataclass(frozen=True)
class ScaleOptions(Options):
    """Size."""

    scale: float = option(type=NUMBER, default=1.0, help="Scale factor of the mirror.")


@click.command()
@click.argument("sensor")
@add_options(ScaleOptions, "size")
def command(sensor: str, size: ScaleOptions) -> None:
    """Print the diameter of the mirror of SENSOR."""
    click.echo(f"{2 * size.scale * load_sensor(sensor).mirror.rim_radius_mm:.2f} mm")
'''


def test_adding_a_command(copy):
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
    process = run([*program, "girth", "paper-spherical", "--scale", 2], copy, **path)
    assert process.stdout == "175.62 mm\n", process.stderr  # twice 2 x 43.905
    assert "Print the diameter of a mirror." in run([*program, "--help"], copy, **path).stdout
    assert (
        run([*program, "girth", "paper-spherical", "--scale", "wide"], copy, **path).returncode == 2
    )


# -- tab of the page -------------------------------------------------------------------------------

ENTRY = """import { h } from "../shared/dom";
import type { Store } from "../shared/store";

/** Display the pan angle of the view. */
export function begin(place: HTMLElement, store: Store): void {
  const pan = h("p", { role: "status" });
  place.append(pan);
  store.listen((s) => (pan.textContent = `${s.pan}`));
}
"""


@pytest.mark.full
def test_adding_a_tab_to_the_studio(tmp_path):
    if shutil.which("node") is None or not (WEB / "node_modules" / "typescript").is_dir():
        pytest.skip("the page's types need Node and web/node_modules: make node")
    web = tmp_path / "web"
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns("node_modules"))
    (web / "node_modules").symlink_to(WEB / "node_modules", target_is_directory=True)
    (web / "src" / "notes").mkdir()
    (web / "src" / "notes" / "entry.ts").write_text(ENTRY)
    edit(
        web / "src" / "shared" / "state.ts",
        ('"design", "calibrate"]', '"design", "calibrate", "notes"]'),
    )
    edit(
        web / "src" / "tabs.ts",
        (
            "import { byId, embeddedData }",
            'import { begin as beginNotes } from "./notes/entry";\nimport { byId, embeddedData }',
        ),
        ('calibrate: "calibrate" } as const', 'calibrate: "calibrate", notes: "notes" } as const'),
        ('calibrate: "#calibrate .desk",', 'calibrate: "#calibrate .desk", notes: "#notes",'),
        (
            "    const requested = LAZY_TABS[tab];",
            '    if (tab === "notes" && !byId("notes").hasChildNodes()) beginNotes(byId("notes"), this.store);\n'
            "    const requested = LAZY_TABS[tab];",
        ),
    )
    edit(
        web / "index.html",
        ('<main id="look">', '<main id="notes" hidden></main>\n<main id="look">'),
    )
    edit(
        web / "tests" / "architecture.test.ts",
        (
            '"": ["", "look", "design", "calibrate", "shared"]',
            'notes: ["notes", "shared"], "": ["", "look", "design", "calibrate", "notes", "shared"]',
        ),
    )
    checked = run(["node", "node_modules/typescript/bin/tsc", "--noEmit"], web)
    assert checked.returncode == 0, checked.stdout
    tested = run(
        ["node", "node_modules/vitest/vitest.mjs", "run", "tests/architecture.test.ts"], web
    )
    assert tested.returncode == 0, tested.stdout + tested.stderr
    edit(
        web / "src" / "notes" / "entry.ts",
        ('"../shared/store"', '"../look/look"'),
        ("Store }", "Look as Store }"),
    )
    rejection = run(
        ["node", "node_modules/vitest/vitest.mjs", "run", "tests/architecture.test.ts"], web
    )
    assert rejection.returncode != 0
    assert "notes/entry imports look/look" in rejection.stdout + rejection.stderr


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
CALLS = f"""{COPY_FINDER}
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
def test_adding_a_kernel(copy):
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
        for line in (package / "base" / "native.py").read_text().splitlines()
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
        ("  src/pool.cpp\n", "  src/pool.cpp\n  src/twice/twice.cpp\n"),
        ("    src/module.cpp\n", "    src/module.cpp\n    src/twice/module.cpp\n"),
    )
    edit(
        package / "base" / "native.py",
        (f"INTERFACE = {number} ", f"INTERFACE = {number + 1} "),
        (
            "    def get_threads(self) -> int: ...",
            "    def twice(self, values: Array, out: Array) -> None: ...\n    def get_threads(self) -> int: ...",
        ),
    )
    build_folder = copy / "build"
    cmake = run(
        ["cmake", "-S", native, "-B", build_folder, f"-DPython_EXECUTABLE={sys.executable}"], copy
    )
    assert cmake.returncode == 0, cmake.stderr
    cmake = run(["cmake", "--build", build_folder, "-j", 2], copy)
    assert cmake.returncode == 0, cmake.stdout + cmake.stderr
    (kernels,) = build_folder.glob("_native*.so")
    shutil.copy(kernels, package / "base")
    call = run(
        [sys.executable, "-c", CALLS], copy, PYTHONPATH=str(copy / "src"), OMNIMIRROR_NATIVE=""
    )
    assert call.stdout == "the arrays differ in length\n", call.stderr
