"""The rules of the house: arrows run downwards, and importing stays light."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
HEAVY = ("scipy", "pydantic", "matplotlib", "cv2", "av", "rich", "tomli_w")


def test_arrows_run_downwards_only():
    run = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize("statement", ["import omnimirror", "from omnimirror.cli import main; main(['--help'])"])
def test_importing_is_light(statement):
    """Heavy packages are imported where they are used, so that the import and --help are instant."""
    code = f"import sys, atexit; atexit.register(lambda: print([m for m in {HEAVY} if m in sys.modules])); {statement}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.splitlines()[-1] == "[]", run.stdout


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
        if getattr(sys.modules[package], name) is not module:
            hidden.append(module.__name__)
    assert not hidden


HOMONYMS = {
    "Sphere", "Cone", "Dome", "Tube",  # shapes of mirrors, screens and what stands around the mirror
    "Surfaces", "Design", "Format", "Progress", "Values", "Curve",  # each of one room alone
}  # fmt: skip


def test_no_class_name_means_two_things():
    rooms: dict[str, set[str]] = {}
    for module in modules():
        for name, value in vars(module).items():
            if inspect.isclass(value) and value.__module__ == module.__name__ and not name.startswith("_"):
                rooms.setdefault(name, set()).add(module.__name__)
    shared = {name: homes for name, homes in rooms.items() if len(homes) > 1 and name not in HOMONYMS}
    assert not shared
