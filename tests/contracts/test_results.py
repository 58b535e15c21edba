"""Contract of results: short ``repr``, HTML for notebooks, and data frames."""

from __future__ import annotations

import csv
import doctest
import inspect
import re
import sys
import typing
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.quantities import QUANTITIES
from omnimirror.base.results import LINE_WIDTH, MAX_LINES, FieldResult, Result, short_text

INPUTS = re.compile(r"^(load|read|parse)_|_like$|^show$")
"""Public functions that return inputs of other functions, or a page."""


def classes_in(annotation: Any) -> Iterator[type]:
    """Yield the classes of the package in a type annotation."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("omnimirror"):
        yield annotation
    for part in typing.get_args(annotation):
        yield from classes_in(part)


def result_classes() -> dict[type, str]:
    """Return the classes that public functions return, each with the first of these functions."""
    classes: dict[type, str] = {}
    for name in om.__all__:
        function = getattr(om, name)
        if not inspect.isfunction(function) or INPUTS.search(name):
            continue
        for cls in classes_in(typing.get_type_hints(function).get("return")):
            if not hasattr(cls, "backproject") and not issubclass(cls, Exception):  # no camera
                classes.setdefault(cls, name)
    return classes


RESULTS = result_classes()


def results_in(value: Any) -> Iterator[Result]:
    """Yield the results in a return value."""
    if isinstance(value, Result):
        yield value
    elif isinstance(value, Mapping):
        yield from results_in(list(value.values()))
    elif isinstance(value, list | tuple):
        for part in value:
            yield from results_in(part)


def run_examples(docstring: str | None, names: dict[str, Any]) -> None:
    """Run the examples of a docstring, except those that raise errors."""
    for example in doctest.DocTestParser().get_examples(docstring or ""):
        if example.exc_msg is None:
            exec(compile(example.source, "example", "single"), names)


def example_of(cls: type, monkeypatch: pytest.MonkeyPatch) -> Result:
    """Return a result from the example of its class, or of the function that returns it."""
    names = dict(vars(sys.modules[cls.__module__]))
    run_examples(inspect.getdoc(cls), names)
    if results := [value for value in names.values() if type(value) is cls]:
        return results[-1]
    name = RESULTS[cls]
    function = getattr(om, name)
    return_values: list[Any] = []

    def recorded(*args: Any, **kwargs: Any) -> Any:
        return_values.append(function(*args, **kwargs))
        return return_values[-1]

    monkeypatch.setattr(om, name, recorded)
    module = inspect.unwrap(function).__module__
    run_examples(inspect.getdoc(function), {**vars(sys.modules[module]), name: recorded})
    results = [result for result in results_in(return_values) if type(result) is cls]
    assert results, f"the examples of {cls.__name__} and {name} contain no {cls.__name__}"
    return results[-1]


def test_return_types_are_results():
    assert len(RESULTS) > 40
    assert [cls for cls in RESULTS if not issubclass(cls, Result)] == []


@pytest.mark.long
@pytest.mark.parametrize("cls", RESULTS, ids=lambda cls: cls.__name__)
def test_results_of_examples(cls, monkeypatch, tmp_path):
    pandas, polars = (pytest.importorskip(package) for package in ("pandas", "polars"))
    monkeypatch.chdir(tmp_path)
    result = example_of(cls, monkeypatch)

    text = repr(result)
    assert text.startswith(f"{type(result).__name__}(")
    assert len(text.splitlines()) <= MAX_LINES
    assert len(text) <= MAX_LINES * LINE_WIDTH
    assert "array([" not in text

    html = result._repr_html_()
    card = ElementTree.fromstring(html)
    assert card.find(".//b").text == type(result).__name__
    assert len(html) < 40_000

    frame = result.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame.columns) == len(set(frame.columns)) >= 1
    with monkeypatch.context() as without_pandas:
        without_pandas.setitem(sys.modules, "pandas", None)
        other = result.to_dataframe()
    assert isinstance(other, polars.DataFrame)
    assert (other.columns, other.height) == (list(frame.columns), len(frame))

    if hasattr(result, "to_csv"):
        result.to_csv(tmp_path / "table.csv")
        header, *rows = csv.reader((tmp_path / "table.csv").read_text().splitlines())
        assert header == list(frame.columns)
        assert len(rows) == len(frame)
        for column, cells in zip(frame.columns, zip(*rows, strict=True), strict=True):
            if frame[column].dtype.kind == "f":
                np.testing.assert_allclose(frame[column], np.array(cells, float), rtol=1e-9)

    if isinstance(result, FieldResult):
        check_dataset(result.to_xarray(), frame)


def check_dataset(dataset, frame):
    """Compare a data set with the data frame of the same result, and with descriptions of names."""
    assert len(dataset.data_vars) > 0
    shapes = [variable.shape for variable in dataset.data_vars.values()]
    sizes = dict(max(dataset.data_vars.values(), key=lambda v: v.ndim).sizes)
    assert len(frame) == np.prod(list(sizes.values()))
    assert all(len(shape) >= 1 for shape in shapes)
    template = np.zeros(tuple(sizes.values()))
    common = [name for name in dataset.variables if name in frame.columns]
    assert set(dataset.data_vars) <= set(common)
    for name in common:
        values, axes = dataset[name].values, [list(sizes).index(dim) for dim in dataset[name].dims]
        shape = [size if i in axes else 1 for i, size in enumerate(template.shape)]
        values = np.broadcast_to(values.reshape(shape), template.shape)
        np.testing.assert_array_equal(values.ravel(), frame[name], err_msg=name)
        quantity = QUANTITIES.get(name)
        assert dataset[name].attrs.get("units") == (quantity.unit or None if quantity else None)


def test_results_over_field_angles_have_data_sets():
    classes = [cls for cls in RESULTS if "omega_deg" in typing.get_type_hints(cls)]
    assert len(classes) >= 5
    assert [cls.__name__ for cls in classes if not issubclass(cls, FieldResult)] == []


def test_missing_xarray(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(om.OmnimirrorError, match=r"^data sets require xarray: .*'\.\[tables\]'"):
        om.evaluate(om.load_sensor("paper-spherical"), [0.0, 90.0]).to_xarray()


def test_missing_data_frame_packages(monkeypatch):
    result = om.best_focus(om.load_sensor("paper-spherical"))
    for package in ("pandas", "polars"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(om.OmnimirrorError, match=r"^data frames require .*'\.\[tables\]'"):
        result.to_dataframe()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.array([[1.0, np.nan]]), "array (1, 2), 1 to 1, 1 not finite"),
        (np.full(3, np.nan), "array (3,), not finite"),
        (np.empty((0, 2)), "array (0, 2)"),
        ("x" * 100, repr("x" * 57 + "...")),
        ({"a": 1, "b": 2}, "2 entries"),
        ([object()] * 5, "5 object"),
        ((), "()"),
        ((1.0,), "(1,)"),
    ],
)
def test_short_text(value, text):
    assert short_text(value) == text


def test_long_reprs_are_abbreviated():
    sensor = om.load_sensor("paper-spherical")
    text = repr(om.evaluate(sensor, np.linspace(0.0, 130.0, 500)))
    assert re.search(r"\.\.\. \d+ more\)$", text)
    assert "omega_deg=array (500,), 0 to 130" in text
