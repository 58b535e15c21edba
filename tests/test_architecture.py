"""The rules of the house: arrows run downwards, nothing runs in circles, and importing stays light."""

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
CROWD, LONG = 12, 400  # files of a room, lines of code of a file
HEAVY = ("scipy", "pydantic", "matplotlib", "cv2", "av", "rich", "tomli_w")


def test_arrows_run_downwards_only():
    run = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout


def test_nothing_runs_in_circles():
    """Within every room: what stands in it, rooms of its own taken whole, imports in one direction."""
    graph = grimp.build_graph("omnimirror", exclude_type_checking_imports=True, cache_dir=None)
    for room in sorted(m for m in graph.modules if graph.find_children(m)):
        whole = {child: {child} | graph.find_descendants(child) for child in graph.find_children(room)}
        home = {module: child for child, modules in whole.items() for module in modules}
        reached = {
            child: {home[to] for m in modules for to in graph.find_modules_directly_imported_by(m) if to in home}
            for child, modules in whole.items()
        }
        try:
            TopologicalSorter({child: to - {child} for child, to in reached.items()}).prepare()
        except CycleError as e:
            pytest.fail(f"in {room}: {' <- '.join(e.args[1])}")


def test_no_room_is_crowded_and_no_file_is_long():
    rooms = [SOURCE, *(p for p in SOURCE.rglob("*") if p.is_dir() and (p / "__init__.py").exists())]
    files = {room: [p for p in room.glob("*.py") if not p.stem.startswith("__")] for room in rooms}
    assert not {str(room): len(found) for room, found in files.items() if len(found) > CROWD}
    lengths = {str(p): lines_of_code(p.read_text()) for found in files.values() for p in found}
    assert not {name: lines for name, lines in lengths.items() if lines > LONG}


def test_tests_patch_objects_and_no_dotted_names():
    """Modules that pytest imports by path may be no attributes of their packages, where dotted names look for them."""
    dotted = re.compile(r"monkeypatch\.setattr\(\s*[rf]*[\"']")
    assert [str(file) for file in (ROOT / "tests").rglob("*.py") if dotted.search(file.read_text())] == []


def lines_of_code(text: str) -> int:
    """Without docstrings, comments and empty lines: what is explained well may be long."""
    told = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    lines = enumerate(text.splitlines(), 1)
    return sum(1 for i, line in lines if i not in told and line.strip() and not line.lstrip().startswith("#"))


@pytest.mark.parametrize("name", ["constraints.txt", "web/package-lock.json"])
def test_locks_name_versions_and_no_addresses(name):
    addresses = [line for line in (ROOT / name).read_text().splitlines() if "://" in line]
    assert not addresses, "npm writes `resolved` and `funding`: take them out"


def test_what_the_docs_show_of_the_code_is_the_code():
    """The drawings of the house and the glossary's quantities; `python docs/from_code.py` makes them."""
    made = runpy.run_path(str(ROOT / "docs" / "from_code.py"))["MADE"]
    stale = [name for name, make in made.items() if (ROOT / "docs" / name).read_text() != make()]
    assert not stale, "python docs/from_code.py makes them anew"


@pytest.mark.parametrize("statement", ["import omnimirror", "from omnimirror.cli import main; main(['--help'])"])
def test_importing_is_light(statement):
    """Heavy packages are imported where they are used, so that the import and --help are instant."""
    assert not imported(HEAVY, statement)


UNUSED = ("scipy", "matplotlib", "av", "omnimirror.design", "omnimirror.calibrate.estimation", "omnimirror.figures")
OF_SENSORS = ("pydantic", "omnimirror.sensor", "omnimirror.mirrors", "omnimirror.simulate.restoration")
OF_A_BALL = ("--ball", "32,32,30,260")


@pytest.mark.parametrize(
    ("command", "unused"),
    [
        ("evaluate paper-spherical --omega-deg 0:90:45", UNUSED),
        ("dewarp circle.png -o view.png", (*UNUSED, *OF_SENSORS, "numpy.ma")),
    ],
)
def test_what_is_asked_most_waits_for_nothing_that_it_does_not_use(command, unused, tmp_path):
    """Optimisers alone take longer to import than a picture to straighten; so do the sensors that a ball is none of."""
    om.write_image(tmp_path / "circle.png", np.zeros((64, 64, 3), np.uint8))
    words = [*command.split(), *(OF_A_BALL if "dewarp" in command else ())]
    statement = f"import os; os.chdir({str(tmp_path)!r}); from omnimirror.cli import main; main({words})"
    assert not imported(unused, statement)
    assert "dewarp" not in command or (tmp_path / "view.png").exists()


def imported(names: tuple[str, ...], statement: str) -> list[str]:
    """Which modules a statement leaves imported."""
    code = f"import sys, atexit; atexit.register(lambda: print(*[m for m in {names} if m in sys.modules])); {statement}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout.splitlines()[-1].split()


def test_public_names_resolve():
    import omnimirror as om

    for name in om.__all__:
        assert getattr(om, name) is not None
    assert set(om.__all__) <= set(dir(om))
    with pytest.raises(AttributeError, match="no attribute 'lode_sensor'"):
        om.lode_sensor  # noqa: B018


def modules() -> list[ModuleType]:
    """Every module of the package."""
    import omnimirror

    names = [m.name for m in pkgutil.walk_packages(omnimirror.__path__, "omnimirror.")]
    return [importlib.import_module(name) for name in names if not name.endswith(("__main__", "_native"))]


def test_no_module_bears_the_name_of_a_function_that_it_exports():
    named = []
    for module in modules():
        same = getattr(module, module.__name__.rpartition(".")[2], None)
        if inspect.isfunction(same) and same.__module__ == module.__name__:
            named.append(module.__name__)
    assert not named


def test_no_function_stands_before_a_module_of_its_package():
    """``omnimirror.analysis.evaluation`` is the module, whatever the package takes from it."""
    hidden = []
    for module in modules():
        package, _, name = module.__name__.rpartition(".")
        if getattr(sys.modules[package], name, module) is not module:  # doctests leave packages that know it not yet
            hidden.append(module.__name__)
    assert not hidden


HOMONYMS = {"Sphere", "Dome"}
"""Shapes of mirrors and housings, and of screens, which are called with their room: ``screens.Sphere``."""


def test_no_class_name_means_two_things():
    rooms: dict[str, set[str]] = {}
    for module in modules():
        for name, value in vars(module).items():
            if inspect.isclass(value) and value.__module__ == module.__name__ and not name.startswith("_"):
                rooms.setdefault(name, set()).add(module.__name__)
    shared = {name: homes for name, homes in rooms.items() if len(homes) > 1 and name not in HOMONYMS}
    assert not shared
