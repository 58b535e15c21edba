"""Contract of callbacks, warnings and loggers, checked for all public functions and modules."""

from __future__ import annotations

import ast
import inspect
import logging
import re
import types
import typing
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import omnimirror as om
from omnimirror.apps.reproduction import draw_figures
from omnimirror.base.logs import forward_steps

SOURCES = sorted(Path(om.__file__).parent.rglob("*.py"))
CALLBACKS = re.compile(
    r"on_(progress|iteration|design|frame|warning|note|start|status)|should_stop"
)
OTHER_NAMES = {"progress", "listener", "tell", "report", "say", "stop", "callback", "callbacks"}
"""Names of callbacks that the style guide replaces."""
LONG_FUNCTIONS = {
    "ImageSequence.image",
    "ImageSequence.light",
    "batch.run",
    "bundle_adjust",
    "calibrate_camera",
    "design_from_parts",
    "design_sensor",
    "detect_mirror_outline",
    "dewarp_bag",
    "dewarp_images",
    "dewarp_video",
    "export",
    "expose",
    "find_boards",
    "pareto",
    "render_image",
    "reproduce_paper",
    "select_frames",
    "tolerance",
    "write_calibration_dataset",
    "write_colmap",
    "write_demo",
    "write_training_dataset",
    "write_video",
    "write_video_dataset",
}
"""Functions that take more than a few seconds for common input."""
OTHER_LOGGERS = {"distributed", "uvicorn.error"}


def public_functions() -> Iterator[tuple[str, Callable]]:
    for name in om.__all__:
        value = getattr(om, name)
        if isinstance(value, types.ModuleType):
            for part in value.__all__:
                if inspect.isfunction(getattr(value, part)):
                    yield f"{name}.{part}", getattr(value, part)
        elif inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value):
            yield name, value.__init__
            for part, method in vars(value).items():
                if inspect.isfunction(method) and not part.startswith("_"):
                    yield f"{name}.{part}", method


FUNCTIONS = dict(public_functions())


def callables_of(hint: object) -> Iterator[tuple]:
    """Yield the argument types of all callables in a type hint."""
    if typing.get_origin(hint) is not None and "Callable" in str(typing.get_origin(hint)):
        yield typing.get_args(hint)
    else:
        for part in typing.get_args(hint):
            yield from callables_of(part)


def hints_of(function: Callable) -> dict[str, object]:
    try:
        return typing.get_type_hints(inspect.unwrap(function))
    except (NameError, TypeError):  # types that are imported for type checkers only
        return {}


def test_callbacks_have_standard_names_and_arguments():
    progress = 0
    for name, function in FUNCTIONS.items():
        for parameter, hint in hints_of(function).items():
            signatures = [] if parameter == "return" else list(callables_of(hint))
            if parameter.startswith("on_"):
                assert CALLBACKS.fullmatch(parameter), f"{parameter} of {name}"
            assert not (signatures and parameter in OTHER_NAMES), f"{parameter} of {name}"
            if parameter == "on_progress":
                progress += 1
                ((arguments, result),) = signatures
                assert result is None, name
                assert arguments in ([int, int], [int, int | None]), name
    assert progress >= len(LONG_FUNCTIONS)


@pytest.mark.parametrize("name", sorted(LONG_FUNCTIONS))
def test_long_functions_report_progress(name):
    parameters = inspect.signature(FUNCTIONS[name]).parameters
    assert "on_progress" in parameters
    assert parameters["on_progress"].default is None
    assert "on_progress" in inspect.getdoc(FUNCTIONS[name])


def test_functions_with_progress_are_listed():
    reporting = {
        name
        for name, function in FUNCTIONS.items()
        if "on_progress" in inspect.signature(function).parameters
    }
    assert reporting == LONG_FUNCTIONS


def calls(text: str, name: str) -> Iterator[ast.Call]:
    """Yield the calls of a function in a module, by the end of its name."""
    for node in ast.walk(ast.parse(text)) if f"{name}(" in text else ():
        if isinstance(node, ast.Call) and ast.unparse(node.func).rsplit(".")[-1] == name:
            yield node


def test_all_warnings_have_public_category():
    count = 0
    for path in SOURCES:
        for call in calls(path.read_text(encoding="utf-8"), "warn"):
            count += 1
            assert ast.unparse(call.args[1]) == "OmnimirrorWarning", path
    assert count >= 2
    assert issubclass(om.OmnimirrorWarning, UserWarning)


def test_loggers_are_named_after_modules():
    names = set()
    for path in SOURCES:
        for call in calls(path.read_text(encoding="utf-8"), "getLogger"):
            names.add(ast.unparse(call.args[0]).strip("'"))
    assert names - OTHER_LOGGERS == {"__name__", "name"}


def test_steps_are_logged_with_progress(tmp_path, caplog):
    updates, steps = [], []
    with forward_steps(steps.append):
        names = ["fig6", "fig5"]
        draw_figures(tmp_path, names, ["svg"], on_progress=lambda *n: updates.append(n))
    assert steps == names
    assert updates == [(1, 2), (2, 2)]
    names = {record.name for record in caplog.records if record.name.startswith("omnimirror")}
    assert names == {"omnimirror.analysis.figures"}
    logging.getLogger("omnimirror.example").info("not forwarded after the context")
    assert len(steps) == 2


def test_design_reports_steps():
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=135),
        mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=43.9),
        lens=om.LensRequirements(theta_max_deg=(10, 12)),
    )
    updates, steps = [], []
    with forward_steps(steps.append, "omnimirror.design"):
        om.design_sensor(requirements, on_progress=lambda *n: updates.append(n))
    assert updates == [(i + 1, None) for i in range(len(steps))]
    assert steps
