"""Architecture rules: downward imports without cycles, and fast import of the package."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import runpy
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import ModuleType

import grimp
import numpy as np
import pytest

import omnimirror as om

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "omnimirror"
HEAVY = ("scipy", "pydantic", "matplotlib", "cv2", "av", "rich", "tomli_w")


def test_imports_follow_layer_order():
    run = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout


def test_imports_have_no_cycles():
    """Imports have one direction in each package, with its subpackages as units."""
    graph = grimp.build_graph("omnimirror", exclude_type_checking_imports=True, cache_dir=None)
    for package in sorted(m for m in graph.modules if graph.find_children(m)):
        families = {
            child: {child} | graph.find_descendants(child) for child in graph.find_children(package)
        }
        parent = {module: child for child, modules in families.items() for module in modules}
        imports = {
            child: {
                parent[to]
                for m in modules
                for to in graph.find_modules_directly_imported_by(m)
                if to in parent
            }
            for child, modules in families.items()
        }
        try:
            TopologicalSorter({child: to - {child} for child, to in imports.items()}).prepare()
        except CycleError as e:
            pytest.fail(f"in {package}: {' <- '.join(e.args[1])}")


READERS = {
    "open",
    "read_text",
    "read_bytes",
    "loads",
    "loadtxt",
    "genfromtxt",
    "fromfile",
    "memmap",
    "ZipFile",
    "TarFile",
    "GzipFile",
    "decompress",
    "decompressobj",
    "imread",
    "imdecode",
    "VideoCapture",
    "FileStorage",
    "read_topography",
    "open_topography",
    "load_scene",
    "load_mesh",
    "AnyReader",
    "ParquetFile",
    "read_table",
    "read_metadata",
    "safe_load",
    "compose",
    "readfile",
    "loadmat",
    "np.load",
    "numpy.load",
    "json.load",
    "yaml.load",
    "tomllib.load",
    "pickle.load",
    "trimesh.load",
    "yaml.parse",
    "ElementTree.parse",
    "ET.parse",
    "ElementTree.fromstring",
    "library.File",
}
"""Calls that read or parse files, by their last name or, for common words, with their prefix."""
PARSED_OWN = "data of its own process"
READS = {
    "base.files": "the bounded reader itself",
    "base.native": "a file of the kernel",
    "optics.materials": "a file of the package",
    "calibration.rim._classifier": "a file of the package",
    "interop.export_formats": "a file of the package",
    "apps.studio.pages": "a file of the package",
    "apps.studio._standalone_page": "a file of the package",
    "apps.reports": "a file of the package, and one that it wrote",
    "apps.studio._design_files": "a file that it wrote",
    "apps.studio._export_process": "files that it wrote, and an archive in memory",
    "apps.cli._process_state": "standard streams and the null device",
    "io.image_sequences": "standard input, to a file",
    "io.mp4": "a file that it wrote",
    "io.video_encoder": "writes, and opens codecs",
    "io.video_metadata": "opens codecs",
    "io.video_reader": "check_file, then FFmpeg, frame by frame",
    "io.live_sources": "streams, with timeouts",
    "interop.gateway.publishing": "streams",
    "simulation.datasets": "writes",
    "interop.view_maps._arrays": "writes",
    "io.image_metadata": "the header of bytes that were read",
    "io.exr": "bytes that were read and checked",
    "io.images": "bytes that were read and checked",
    "interop.http_server.request_bodies": "bytes of a request, limited",
    "manufacturing.metrology.readers": "check_file, then the number of points before the heights",
    "simulation.scenes._mesh_files": "check_mesh_file, then trimesh",
    "interop.batch.inputs": "check_file and limited stores, then the headers of archives",
    "interop.batch.manifest": PARSED_OWN,
    "interop.batch.stores": "objects of limited size",
    "interop.ros_bags.bag_files": "checked, then message by message",
    "design.pareto_front": "check_file and the number of values, then pyarrow",
    "manufacturing.tolerancing.sweep": "check_file, then block by block; data of its own process",
    "apps.reports.comparison": "an image that it drew",
    "simulation.dataset_manifest": PARSED_OWN,
    "design.optimiser": PARSED_OWN,
    "base.block_runner": PARSED_OWN,
    "base.worker_processes": PARSED_OWN,
    "optics.testing": PARSED_OWN,
    "apps.studio._design_tolerances": PARSED_OWN,
}
"""Modules with such calls, and the reason for which their input is bounded."""


def test_tests_patch_objects_instead_of_dotted_names():
    """Modules imported by path may not be attributes of their packages, where dotted names are
    resolved."""
    dotted = re.compile(r"monkeypatch\.setattr\(\s*[rf]*[\"']")
    assert [
        str(file) for file in (ROOT / "tests").rglob("*.py") if dotted.search(file.read_text())
    ] == []


def test_files_are_read_by_the_bounded_reader():
    """All other modules call :mod:`omnimirror.base.files` and :mod:`omnimirror.io.images`."""
    calls_by_module = {
        ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(
            ".__init__"
        ): _reading_calls(path)
        for path in SOURCE.rglob("*.py")
    }
    calls = {module: names for module, names in calls_by_module.items() if names}
    assert {module: names for module, names in calls.items() if module not in READS} == {}
    assert set(READS) <= set(calls), "READS must list modules with such calls only"


def _reading_calls(path: Path) -> list[str]:
    """List the calls of readers in a module, with their lines."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        callee = ast.unparse(node.func)
        if callee in ("read_bytes", "read_text", "decompress", "load_mesh") or callee.startswith(
            "files."
        ):
            continue  # bounded functions of the package
        if callee in READERS or callee.rpartition(".")[2] in READERS:
            names.append(f"{callee}, line {node.lineno}")
    return names


@pytest.mark.parametrize("name", ["constraints.txt", "web/package-lock.json"])
def test_lock_files_have_versions_and_no_addresses(name):
    addresses = [line for line in (ROOT / name).read_text().splitlines() if "://" in line]
    assert not addresses, "remove the entries `resolved` and `funding` that npm writes"


def test_code_excerpts_in_docs_are_current():
    """Package diagrams and quantities of the glossary, generated by `python docs/generated_content.py`."""
    generators = runpy.run_path(str(ROOT / "docs" / "generated_content.py"))["GENERATED"]
    stale = [
        name for name, make in generators.items() if (ROOT / "docs" / name).read_text() != make()
    ]
    assert not stale, "run python docs/generated_content.py"


@pytest.mark.parametrize(
    "statement", ["import omnimirror", "from omnimirror.apps.cli import main; main(['--help'])"]
)
def test_import_loads_no_heavy_modules(statement):
    """Heavy packages are imported on first use, for a fast import and --help."""
    assert not imported(HEAVY, statement)


UNUSED = (
    "scipy",
    "matplotlib",
    "av",
    "omnimirror.design",
    "omnimirror.calibration.estimation",
    "omnimirror.analysis.figures",
)
SENSOR_MODULES = (
    "pydantic",
    "omnimirror.optics.sensor",
    "omnimirror.optics.mirrors",
    "omnimirror.dewarp.restoration",
)
BALL_OPTION = ("--ball", "32,32,30,260")


@pytest.mark.parametrize(
    ("command", "unused"),
    [
        ("evaluate paper-spherical --omega-deg 0:90:45", UNUSED),
        ("dewarp circle.png -o view.png", (*UNUSED, *SENSOR_MODULES, "numpy.ma")),
    ],
)
def test_frequent_commands_import_no_unused_packages(command, unused, tmp_path):
    """Importing the optimisers takes longer than dewarping an image, as does importing the sensor
    modules to dewarp a mirror ball."""
    om.write_image(tmp_path / "circle.png", np.zeros((64, 64, 3), np.uint8))
    arguments = [*command.split(), *(BALL_OPTION if "dewarp" in command else ())]
    statement = f"import os; os.chdir({str(tmp_path)!r}); from omnimirror.apps.cli import main; main({arguments})"
    assert not imported(unused, statement)
    assert "dewarp" not in command or (tmp_path / "view.png").exists()


def imported(names: tuple[str, ...], statement: str) -> list[str]:
    """Return the modules of a list that a statement imports."""
    code = f"import sys, atexit; atexit.register(lambda: print(*[m for m in {names} if m in sys.modules])); {statement}"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return process.stdout.splitlines()[-1].split()


def test_public_names_resolve():
    import omnimirror as om

    for name in om.__all__:
        assert getattr(om, name) is not None
    assert set(om.__all__) <= set(dir(om))
    with pytest.raises(AttributeError, match="no attribute 'lode_sensor'"):
        om.lode_sensor  # noqa: B018


def modules() -> list[ModuleType]:
    """Return all modules of the package."""
    import omnimirror

    names = [m.name for m in pkgutil.walk_packages(omnimirror.__path__, "omnimirror.")]
    return [
        importlib.import_module(name)
        for name in names
        if not name.endswith(("__main__", "_native"))
    ]


def test_no_module_has_the_name_of_an_exported_function():
    modules_with_function = []
    for module in modules():
        same = getattr(module, module.__name__.rpartition(".")[2], None)
        if inspect.isfunction(same) and same.__module__ == module.__name__:
            modules_with_function.append(module.__name__)
    assert not modules_with_function


def test_no_function_shadows_a_module():
    """``omnimirror.analysis.evaluation`` is the module, even if the package imports a function of
    that name."""
    shadowed = []
    for module in modules():
        package, _, name = module.__name__.rpartition(".")
        if (
            getattr(sys.modules[package], name, module) is not module
        ):  # doctests leave packages without this attribute
            shadowed.append(module.__name__)
    assert not shadowed
