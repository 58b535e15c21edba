"""Error messages: commands that install extras."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from omnimirror.base.errors import OPENCV_REMEDY, extra_remedy

ROOT = Path(__file__).parents[2]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def trees() -> Iterator[tuple[Path, ast.AST]]:
    """Yield the syntax trees of the package."""
    for path in (ROOT / "src").rglob("*.py"):
        yield path, ast.parse(path.read_text(encoding="utf-8"))


def remedies() -> list[tuple[str, str]]:
    """Return the file and the argument of each call of extra_remedy."""
    return [
        (path.name, ast.literal_eval(argument))
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "extra_remedy"
        for argument in node.args
    ]


def docstrings(tree: ast.AST) -> set[int]:
    """Return the identities of all constants that are statements, such as docstrings."""
    return {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}


@pytest.mark.parametrize(("file", "extra"), remedies())
def test_recommended_extras_exist(file, extra):
    program, action, requirement = shlex.split(re.search("pip.*'", extra_remedy(extra))[0])
    assert (program, action) == ("pip", "install")
    assert requirement == f".[{extra}]"  # a clone; the package is not on an index
    assert EXTRAS[extra]


def test_install_commands_are_written_by_one_function():
    assert len(remedies()) >= 14
    literal = [
        (path.name, node.value)
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if re.search(r"pip install|omnimirror\[", node.value) and id(node) not in docstrings(tree)
    ]
    assert sorted(literal) == [("errors.py", OPENCV_REMEDY), ("errors.py", "run pip install '.[")]


def test_extras_in_documentation_exist():
    mentioned = [
        (page.name, extra)
        for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))
        for names in re.findall(r"(?:omnimirror|')\.?\[([a-z,]+)\]", page.read_text("utf-8"))
        for extra in names.split(",")
    ]
    assert len(mentioned) > 5
    assert [(page, extra) for page, extra in mentioned if extra not in EXTRAS] == []
