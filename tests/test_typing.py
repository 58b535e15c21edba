"""Types of the public names by a type checker."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import omnimirror as om

SOURCE = Path(om.__file__)


def test_package_is_marked_as_typed():
    assert (SOURCE.parent / "py.typed").exists()


def test_type_checkers_resolve_every_public_name():
    module_by_name = {}
    for node in ast.walk(ast.parse(SOURCE.read_text())):
        if (
            isinstance(node, ast.If)
            and isinstance(node.test, ast.Name)
            and node.test.id == "TYPE_CHECKING"
        ):
            module_by_name |= {
                name.asname: line.module for line in node.body for name in line.names
            }
    assert set(module_by_name) == set(om.__all__) - {"__version__"}
    for name, home in module_by_name.items():
        public = getattr(om, name)  # imports a submodule such as batch
        assert getattr(import_module(f"omnimirror.{home}"), name) is public


@pytest.mark.full
def test_user_script_is_type_checked(tmp_path):
    api = pytest.importorskip("mypy.api")
    script = tmp_path / "script.py"
    script.write_text(
        "import omnimirror as om\n"
        'sensor = om.load_sensor("paper-spherical")\n'
        "reveal_type(om.best_focus(sensor).focus_mm)\n"
        "om.best_fokus(sensor)\n"
        "om.best_focus(3)\n"
    )
    output, _, _ = api.run(
        [str(script), "--cache-dir", str(tmp_path / "cache"), "--no-error-summary"]
    )
    lines = output.splitlines()
    assert 'Revealed type is "float"' in output.replace("builtins.", "")
    assert len([line for line in lines if ": error:" in line]) == 2, output
    assert 'script.py:4: error: Module has no attribute "best_fokus"' in output
    assert "script.py:5: error: Argument 1" in output
