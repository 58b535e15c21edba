"""pytest configuration: skip examples of differentiable cameras without PyTorch, and report
comparisons with other programs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.cross_validation import Compare, Comparison, version_of, write

TORCH = "src/omnimirror/interop/torch"
TORCH_MODULES = ("_camera.py", "_dewarper.py", "_factory.py", "_tables.py")
collect_ignore = [] if find_spec("torch") else [f"{TORCH}/{name}" for name in TORCH_MODULES]
collect_ignore += ["src/omnimirror/interop/gstreamer/python"]  # loaded by GStreamer only
LONG_EXAMPLES = {
    "omnimirror.calibration.estimation._camera_calibration.calibrate_camera",
    "omnimirror.calibration.estimation.calibration_result.Calibration",
    "omnimirror.calibration.targets.board_detection.find_board",
    "omnimirror.design.optimiser.optimise",
    "omnimirror.apps.reports.calibration.write_calibration_figures",
    "omnimirror.apps.reports.calibration.write_calibration_report",
    "omnimirror.apps.reports.write_demo",
    "omnimirror.simulation.datasets.write_calibration_dataset",
}
"""Docstring examples run by `make test-full` only; the tests of the same functions run daily."""
OPTION, PROPERTY = "--cross-validation", "compared"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        OPTION,
        type=Path,
        metavar="FILE",
        help="write the comparisons with other programs as a page",
    )


@pytest.hookimpl(tryfirst=True)  # before deselection
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.name in LONG_EXAMPLES:
            item.add_marker(pytest.mark.full)


@pytest.fixture
def beside(record_property) -> Compare:
    """Return a function that records the deviation from another program and checks its tolerance."""

    def compare(
        program: str,
        quantity: str,
        deviation: float,
        tolerance: float,
        unit: str,
        version: str | None = None,
    ) -> None:
        version = version_of(program) if version is None else version
        record_property(
            PROPERTY,
            tuple(Comparison(program, quantity, float(deviation), float(tolerance), unit, version)),
        )
        assert deviation <= tolerance, (
            f"{program}, {quantity}: deviation {deviation:g} {unit} exceeds tolerance {tolerance:g} {unit}"
        )

    return compare


def pytest_terminal_summary(terminalreporter) -> None:
    """Write the comparison page once, if requested."""
    path = terminalreporter.config.getoption(OPTION)
    if path is None:
        return
    properties = [
        p for report in terminalreporter.stats.get("passed", []) for p in report.user_properties
    ]
    write(path, [Comparison(*value) for name, value in properties if name == PROPERTY])
