"""Documentation of all public names: parameters with shapes, return values, exceptions, an example."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import omnimirror as om
from omnimirror.base import arguments

SECTIONS = (
    "Parameters",
    "Attributes",
    "Returns",
    "Yields",
    "Raises",
    "Notes",
    "Examples",
    "References",
    "See Also",
)
CHECKS = {
    name
    for name, f in vars(arguments).items()
    if inspect.isfunction(f) and not name.startswith("_")
} - {"shown"}
"""Functions that raise errors of arguments."""
ARRAYS = re.compile(r"\b(Array|ArrayLike|NDArray|Image|ImageArray|Light|Mask|Planes)\b")
SHAPE = re.compile(
    r"\(([^)]*\b(n|m|k|h|w|height|width|rows|2|3)\b[^)]*|\.\.\., \w)\)|\bscalar\b|\bshape\b"
)


def sections(doc: str) -> dict[str, str]:
    """Return the text of each NumPy section, the summary under an empty name."""
    parts = re.split(rf"(?m)^({'|'.join(SECTIONS)})\n-+\n", doc)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def entries(text: str) -> dict[str, str]:
    """Return the description of each name in a section: ``a, b : (n,)`` and the following lines."""
    descriptions: dict[str, str] = {}
    for block in re.split(r"(?m)^(?=\S)", text):
        head, _, body = block.partition("\n")
        names = head.partition(" : ")[0]
        for name in names.split(","):
            descriptions[name.strip().lstrip("*")] = f"{head.partition(' : ')[2]} {body}"
    return descriptions


def fields_explained(cls: type) -> dict[str, str]:
    """Return the fields of a class with their attribute docstrings."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(tree, ast.ClassDef)
    descriptions = {}
    for field, below in zip(tree.body, tree.body[1:], strict=False):
        is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and is_text:
            descriptions[field.target.id] = str(below.value.value)
    return descriptions


def raises(function: Any) -> bool:
    """Check if a function raises directly, or through an argument check."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    calls = {
        n.func.id
        for n in ast.walk(tree)
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
    }
    return any(isinstance(n, ast.Raise) and n.exc for n in ast.walk(tree)) or bool(calls & CHECKS)


def missing_sections(item: Any, of: type | None = None) -> Iterator[str]:
    """Yield the parts that the docstring of a function, class or method lacks."""
    doc = inspect.getdoc(item)
    if not doc:
        yield "a docstring"
        return
    parts = sections(doc)
    is_class = inspect.isclass(item)
    explained = entries(parts.get("Parameters", ""))
    if is_class:
        explained |= entries(parts.get("Attributes", ""))
        for cls in item.__mro__:  # fields of a dataclass are explained where they are defined
            if cls is item or dataclasses.is_dataclass(cls):
                explained |= fields_explained(cls)
                explained |= entries(sections(inspect.getdoc(cls) or "").get("Parameters", ""))
    if is_class and issubclass(item, Warning):
        return  # created by messages only, without a signature
    for name, parameter in inspect.signature(item).parameters.items():
        if name in ("self", "cls") or name.startswith("_"):
            continue
        if name not in explained:
            yield f"parameter {name}"
        elif ARRAYS.search(str(parameter.annotation)) and not SHAPE.search(explained[name]):
            yield f"shape of {name}"
    if not is_class:
        yield from (
            f"no parameter {name}"
            for name in explained
            if name and name not in inspect.signature(item).parameters
        )
        annotation = str(inspect.signature(item).return_annotation)
        if annotation not in ("None", "Self") and not {"Returns", "Yields"} & parts.keys():
            yield "Returns"
        if ARRAYS.search(annotation) and not SHAPE.search(parts.get("Returns", "") + parts[""]):
            yield "shape of the returned array"
        if raises(item) and "Raises" not in parts:
            yield "Raises"
    if of is None and ">>>" not in doc:
        yield "an example"


def explained_names() -> dict[str, tuple[Any, type | None]]:
    """Return all names that require documentation, methods with their class."""
    items: dict[str, tuple[Any, type | None]] = {}
    for name in om.__all__:
        item = getattr(om, name)
        if inspect.isfunction(item) or inspect.isclass(item):
            items[name] = item, None
        if inspect.ismodule(item):
            parts = {f"{name}.{own}": getattr(item, own) for own in item.__all__}
            items |= {
                n: (p, None)
                for n, p in parts.items()
                if inspect.isfunction(p) or dataclasses.is_dataclass(p)
            }
        if inspect.isclass(item):
            for own, method in inspect.getmembers(
                item, lambda m: inspect.isfunction(m) or inspect.ismethod(m)
            ):
                if not own.startswith("_") and method.__module__.startswith("omnimirror"):
                    items[f"{name}.{own}"] = getattr(method, "__func__", method), item
    return items


NAMES = explained_names()


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_docstring(name):
    assert list(missing_sections(*NAMES[name])) == []


def test_missing_docstrings_are_detected():
    def half(sensor: om.Sensor, pixels: om.dewarp._dewarper.Array) -> int:
        """Half of it.

        Parameters
        ----------
        pixels
            In the picture.
        angle
            Long gone.
        """
        raise ValueError

    assert list(missing_sections(half)) == [
        "parameter sensor",
        "shape of pixels",
        "no parameter angle",
        "Returns",
        "Raises",
        "an example",
    ]


def test_documented_parameters_exist():
    """Docstrings of all functions, including private ones, name existing parameters only."""
    unknown, count = [], 0
    for path in sorted(Path(om.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            documented = entries(sections(ast.get_docstring(node) or "").get("Parameters", ""))
            groups = (node.args.posonlyargs, node.args.args, node.args.kwonlyargs)
            variable = [arg for arg in (node.args.vararg, node.args.kwarg) if arg]
            names = {arg.arg for group in (*groups, variable) for arg in group}
            unknown += [f"{path.name} {node.name} {n}" for n in documented if n and n not in names]
            count += bool(documented)
    assert unknown == []
    assert count > 500
