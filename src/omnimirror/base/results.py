"""Results: base classes with short ``repr``, data frames, xarray data sets, and HTML cards."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import OmnimirrorError, extra_remedy
from .escaping import html_text
from .files import write_json, write_text
from .quantities import QUANTITIES
from .typing import Array

# -- Notebook cards --------------------------------------------------------------------------------
# HTML tables and SVG drawings with the colours of light and dark notebook themes.

Rows = Mapping[str, str]

MAX_HEIGHT_PX, MAX_WIDTH_PX = 190.0, 230.0  # maximum size of a drawing
MARGIN_PX = 5.0
LINE_STYLES = {
    "strong": 'stroke-width="2.6"',
    "plain": 'stroke-width="1.2"',
    "fine": 'stroke-width="1" stroke-opacity=".45"',
}
CELL_STYLE = "background:none;border:0;padding:0 1.2em 0 0;text-align:left;vertical-align:top"


class Line(NamedTuple):
    """Polyline of a drawing: coordinates (n,) to the right and up, and a line style."""

    x: Array
    y: Array
    style: str


def card(title: str, kind: str, drawing: str, rows: Rows, note: str) -> str:
    """Return the HTML of a card: a drawing next to a table and a note.

    >>> "<b" in card("mine", "camera", "", {"Field": "0 to 90°"}, "")
    True
    """
    cells = "".join(
        f'<tr style="background:none"><th scope="row" style="{CELL_STYLE};font-weight:400;opacity:.75">'
        f'{html_text(name)}</th><td style="{CELL_STYLE};max-width:32em">{html_text(value)}</td></tr>'
        for name, value in rows.items()
    )
    below = f'<div style="max-width:44em;opacity:.75">{html_text(note)}</div>' if note else ""
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:.6em 1.6em;align-items:center;font:13px/1.5 system-ui,sans-serif">'
        f'{drawing}<div><b style="font-size:15px">{html_text(title)}</b> '
        f'<span style="opacity:.75">{html_text(kind)}</span>'
        f'<table style="border-collapse:collapse;margin:.3em 0;font-size:13px">{cells}</table>{below}</div></div>'
    )


def line_drawing(lines: Sequence[Line], label: str) -> str:
    """Return an SVG of lines to a common scale, in the colour of the surrounding text; "" without
    lines.
    """
    if not lines:
        return ""
    x, y = (np.concatenate([line[axis] for line in lines]) for axis in (0, 1))
    low, size = (
        (np.nanmin(x), np.nanmax(y)),
        (max(np.ptp(x[np.isfinite(x)]), 1e-9), max(np.ptp(y[np.isfinite(y)]), 1e-9)),
    )
    scale = min(MAX_WIDTH_PX / size[0], MAX_HEIGHT_PX / size[1])
    width, height = (scale * s + 2 * MARGIN_PX for s in size)
    paths = "".join(_path(line, low, scale) for line in lines)
    return (
        f'<svg role="img" aria-label="{html_text(label)}" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" fill="none" stroke="currentColor">{paths}</svg>'
    )


def _path(line: Line, low: tuple[float, float], scale: float) -> str:
    """Return an SVG path that is interrupted at NaN coordinates."""
    commands, is_down = [], False
    for u, v in zip(
        MARGIN_PX + (line.x - low[0]) * scale, MARGIN_PX + (low[1] - line.y) * scale, strict=True
    ):
        is_finite = bool(np.isfinite(u) and np.isfinite(v))
        if is_finite:
            commands.append(f"{'L' if is_down else 'M'}{u:.1f} {v:.1f}")
        is_down = is_finite
    return f'<path d="{"".join(commands)}" {LINE_STYLES[line.style]}/>'


def field_range(low_rad: float, high_rad: float) -> str:
    """Format a range of field angles.

    >>> field_range(0.0, np.pi / 2)
    '0 to 90° from the axis'
    """
    return f"{np.degrees(low_rad):.4g} to {np.degrees(high_rad):.4g}° from the axis"


def origin(notes: str, calibrated_parameters: int) -> str:
    """Describe the origin of a camera: its notes and the number of calibrated parameters."""
    parts = [notes] if notes else []
    if calibrated_parameters:
        parts.append(f"Calibrated parameters: {calibrated_parameters}, with covariance.")
    return " ".join(parts)


# -- Base classes ----------------------------------------------------------------------------------

Columns = Mapping[str, Any]
"""Columns of a table by name: arrays or lists of one length."""

LINE_WIDTH, MAX_LINES = 88, 6  # characters and lines of a repr
MAX_TEXT = 60  # characters of a text in a repr
MAX_SEQUENCE = 3  # elements that are printed individually
MAX_FACTS, MAX_ROWS, MAX_COLUMNS = 12, 10, 12  # entries of the HTML card
DATA_FRAME_PACKAGES = ("pandas", "polars")


# -- Values as text --------------------------------------------------------------------------------


def short_text(value: object) -> str:
    """Describe a value in a few words: arrays by shape and range, sequences by their length.

    >>> short_text(np.linspace(0.0, 2.0, 50)), short_text(np.zeros((2, 3), bool))
    ('array (50,), 0 to 2', 'array (2, 3), 0 of 6 true')
    >>> short_text(1 / 3), short_text((640, 480)), short_text(["a", "b", "c", "d"])
    ('0.333333', '(640, 480)', '4 str')
    """
    if isinstance(value, np.ndarray):
        return _array_text(value)
    if isinstance(value, str | Path):
        return repr(_shortened(str(value)))
    if value is None or isinstance(value, bool | np.bool_ | Integral):
        return str(value)
    if isinstance(value, Real):
        return f"{float(value):.6g}"
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return f"{type(value).__name__}(...)"
    if isinstance(value, Collection):
        return _collection_text(value)
    name = getattr(value, "name", None)
    kind = type(value).__name__
    return f"{kind}({_shortened(name)!r})" if isinstance(name, str) else f"{kind}(...)"


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_TEXT else f"{text[: MAX_TEXT - 3]}..."


def _array_text(values: np.ndarray[Any, Any]) -> str:
    shape = f"array {values.shape}"
    if values.dtype == bool:
        return f"{shape}, {int(values.sum())} of {values.size} true"
    if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        return f"{shape} of {values.dtype}"
    finite = values[np.isfinite(values)]
    if not finite.size:
        return f"{shape}, not finite" if values.size else shape
    missing = f", {values.size - finite.size} not finite" if finite.size < values.size else ""
    return f"{shape}, {finite.min():.6g} to {finite.max():.6g}{missing}"


def _collection_text(values: Collection[Any]) -> str:
    if not values:
        return "{}" if isinstance(values, Mapping) else "()"
    if len(values) <= MAX_SEQUENCE and isinstance(values, list | tuple) and _are_scalars(values):
        return f"({', '.join(map(short_text, values))}{',' * (len(values) == 1)})"
    kinds = {type(value).__name__ for value in values}
    if isinstance(values, Mapping) or len(kinds) > 1:
        return f"{len(values)} {'entry' if len(values) == 1 else 'entries'}"
    return f"{len(values)} {kinds.pop()}"


def _are_scalars(values: Iterable[Any]) -> bool:
    return all(isinstance(v, str | Path | bool | Real) or v is None for v in values)


# -- Tables ----------------------------------------------------------------------------------------


def table_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Convert records to columns; missing entries become None.

    >>> table_of([{"a": 1}, {"a": 2, "b": 3.0}])
    {'a': [1, 2], 'b': [None, 3.0]}
    """
    rows = list(rows)
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def record_of(value: Any) -> dict[str, Any]:
    """Return the scalar fields of a dataclass or named tuple; texts of a sequence are joined.

    >>> from typing import NamedTuple
    >>> record_of(NamedTuple("P", [("x", float), ("notes", tuple), ("y", object)])(1.0, ("a", "b"), {}))
    {'x': 1.0, 'notes': 'a; b'}
    """
    names = [f.name for f in fields(value)] if is_dataclass(value) else value._fields
    record = {}
    for name in names:
        entry = getattr(value, name)
        if isinstance(entry, Path):
            record[name] = str(entry)
        elif _are_scalars([entry]):
            record[name] = entry
        elif isinstance(entry, tuple | list) and all(isinstance(part, str) for part in entry):
            record[name] = "; ".join(entry)
    return record


def pixel_grid(columns: Any, rows: Any) -> dict[str, Any]:
    """Return the columns ``u_px`` and ``v_px`` of a pixel grid in row-major order.

    >>> pixel_grid([0, 1], [5, 6])
    {'u_px': array([0, 1, 0, 1]), 'v_px': array([5, 5, 6, 6])}
    """
    u, v = np.meshgrid(columns, rows)
    return {"u_px": u.ravel(), "v_px": v.ravel()}


def axis_columns(name: str, vectors: Any, unit: str = "") -> dict[str, Any]:
    """Return the columns x, y and z of vectors (..., 3).

    >>> axis_columns("origin", np.array([[1, 2, 3]]), "_mm")
    {'origin_x_mm': array([1]), 'origin_y_mm': array([2]), 'origin_z_mm': array([3])}
    """
    return {f"{name}_{axis}{unit}": vectors[..., i].ravel() for i, axis in enumerate("xyz")}


def write_columns(path: str | Path, columns: Columns, digits: int = 17) -> None:
    """Write numeric columns as CSV; 17 significant digits are exact for double precision."""
    rows = (",".join(f"{v:.{digits}g}" for v in row) for row in zip(*columns.values(), strict=True))
    write_text(path, "\n".join([",".join(columns), *rows]) + "\n")


def data_frame_package() -> Any:
    """Return pandas, or Polars without pandas.

    Raises
    ------
    OmnimirrorError
        If neither is installed.
    """
    for name in DATA_FRAME_PACKAGES:
        try:
            return import_module(name)
        except ImportError:
            continue
    raise OmnimirrorError(f"data frames require pandas or Polars: {extra_remedy('tables')}")


# -- repr and HTML ---------------------------------------------------------------------------------


def _plain(column: Any) -> Any:
    """Return a column with paths as text."""
    if isinstance(column, np.ndarray):
        return column
    return [str(value) if isinstance(value, Path) else value for value in column]


def _facts(result: Any) -> dict[str, str]:
    """Return the fields of a result as text."""
    return {f.name: short_text(getattr(result, f.name)) for f in fields(result) if f.repr}


def _repr(self: Any) -> str:
    parts = [f"{name}={text}" for name, text in _facts(self).items()]
    head = f"{type(self).__name__}("
    lines = _filled(head, parts)
    count = len(parts)
    while len(lines) > MAX_LINES:
        count -= 1
        lines = _filled(head, [*parts[:count], f"... {len(parts) - count} more"])
    return "\n".join(lines)


def _filled(head: str, parts: Sequence[str]) -> list[str]:
    """Distribute parts over lines; a part is not divided."""
    joined = ", ".join(part.replace(" ", "\0") for part in parts)
    lines = textwrap.wrap(
        f"{head}{joined})",
        LINE_WIDTH,
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\0", " ") for line in lines]


def _html_table(columns: Columns) -> str:
    """Return the first rows and columns of a table as HTML; "" for at most one row."""
    count = max((len(column) for column in columns.values()), default=0)
    if count <= 1:
        return ""
    names = list(columns)[:MAX_COLUMNS]
    head = _html_row("th", names)
    rows = zip(*(columns[name][:MAX_ROWS] for name in names), strict=True)
    body = "".join(_html_row("td", map(_cell_text, row)) for row in rows)
    parts = [
        f"first {MAX_ROWS} of {count} rows" * (count > MAX_ROWS),
        f"first {MAX_COLUMNS} of {len(columns)} columns" * (len(columns) > MAX_COLUMNS),
    ]
    note = ", ".join(filter(None, parts))
    below = f'<div style="opacity:.75">{html_text(note)}</div>' if note else ""
    return f'<table style="border-collapse:collapse;font-size:12px">{head}{body}</table>{below}'


def _html_row(tag: str, cells: Iterable[str]) -> str:
    joined = "".join(f'<{tag} style="{CELL_STYLE}">{html_text(cell)}</{tag}>' for cell in cells)
    return f"<tr>{joined}</tr>"


def _cell_text(value: object) -> str:
    return _shortened(str(value)) if isinstance(value, str | Path) else short_text(value)


# -- Results ---------------------------------------------------------------------------------------


class Result:
    """Base class of results: short ``repr``, HTML for notebooks, and a data frame.

    Subclasses are dataclasses. A result with more than scalars and one-dimensional arrays overrides
    ``_table``.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__repr__" not in cls.__dict__:  # `dataclass` keeps a repr in the class itself
            cls.__repr__ = _repr  # type: ignore[method-assign]  # decorator

    def _table(self) -> Columns:
        """Return the columns of the data frame: the arrays (n,) of one length, or one row of the
        scalar fields.
        """
        values = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]  # subclasses are dataclasses
        arrays = {k: v for k, v in values.items() if isinstance(v, np.ndarray) and v.ndim == 1}
        if arrays and len({len(v) for v in arrays.values()}) == 1:
            return arrays
        return table_of([record_of(self)])

    def to_dataframe(self) -> Any:
        """Convert to a data frame with the columns of the CSV file, if the result has one.

        Returns
        -------
        pandas.DataFrame or polars.DataFrame
            A pandas data frame if pandas is installed, otherwise a Polars data frame.

        Raises
        ------
        OmnimirrorError
            If neither pandas nor Polars is installed.

        Examples
        --------
        >>> import omnimirror as om
        >>> result = om.evaluate(om.load_sensor("paper-spherical"), [0.0, 90.0])
        >>> result.to_dataframe()[["omega_deg", "x_mm"]].round(2)
           omega_deg   x_mm
        0        0.0   0.00
        1       90.0  32.27
        """
        package = data_frame_package()
        columns = {name: _plain(column) for name, column in self._table().items()}
        if package.__name__ == "polars":
            return package.DataFrame(columns, strict=False)
        return package.DataFrame(columns)

    def _repr_html_(self) -> str:
        """Return an HTML card for notebooks: scalar values and the first rows of the table."""
        facts = dict(list(_facts(self).items())[:MAX_FACTS])
        return (
            f"<div>{card(type(self).__name__, '', '', facts, '')}{_html_table(self._table())}</div>"
        )


class Fields(NamedTuple):
    """Fields of a result over its coordinates, each with the names of its dimensions."""

    variables: Mapping[str, tuple[tuple[str, ...], Any]]
    coordinates: Mapping[str, tuple[tuple[str, ...], Any]]
    attributes: Mapping[str, Any]


def column_fields(
    columns: Mapping[str, Any], attributes: Mapping[str, Any], *more_coordinates: str
) -> Fields:
    """Return columns (n,) as fields over the first of them.

    >>> fields = column_fields({"omega_deg": [0, 90], "h_px": [0, 200]}, {"kind": "geometric"})
    >>> fields.variables, fields.coordinates
    ({'h_px': (('omega_deg',), [0, 200])}, {'omega_deg': (('omega_deg',), [0, 90])})
    """
    dimension = (next(iter(columns)),)
    variables = {name: (dimension, column) for name, column in columns.items()}
    coordinates = {name: variables.pop(name) for name in dimension + more_coordinates}
    return Fields(variables, coordinates, attributes)


class FieldResult(Result, ABC):
    """Result that consists of fields over coordinates: field angle, distance, frequency, ..."""

    @abstractmethod
    def _fields(self) -> Fields:
        """Return the fields, with quantity names as keys."""

    def to_xarray(self) -> Any:
        """Convert to an xarray data set over the coordinates of the result.

        Results at several object distances are joined by ``xarray.concat``.

        Returns
        -------
        xarray.Dataset
            Variables with the attributes ``units`` and ``long_name``.

        Raises
        ------
        OmnimirrorError
            If xarray is not installed.

        Examples
        --------
        >>> import omnimirror as om
        >>> sensor = om.load_sensor("paper-spherical")
        >>> om.spots(sensor, [45.0, 90.0], focus_mm=[200.0, 300.0, 400.0]).to_xarray().rms_t_px.dims
        ('omega_deg', 'focus_mm')

        Blur over field angle and object distance:

        >>> import xarray
        >>> results = [om.evaluate(sensor, [0.0, 90.0], object_distance_mm=p) for p in (300.0, 900.0)]
        >>> blur = xarray.concat([r.to_xarray() for r in results], "object_distance_mm").blur_t_px
        >>> dict(blur.sizes), blur.attrs["units"]
        ({'object_distance_mm': 2, 'omega_deg': 2}, 'px')
        """
        try:
            xarray = import_module("xarray")
        except ImportError:
            raise OmnimirrorError(f"data sets require xarray: {extra_remedy('tables')}") from None
        variables, coordinates, attributes = self._fields()
        return xarray.Dataset(
            {name: (*field, _quantity_attributes(name)) for name, field in variables.items()},
            {name: (*field, _quantity_attributes(name)) for name, field in coordinates.items()},
            {name: value for name, value in attributes.items() if value is not None},
        )


def _quantity_attributes(name: str) -> dict[str, str]:
    """Return unit and title of a quantity in the conventions of xarray."""
    if name not in QUANTITIES:
        return {}
    quantity = QUANTITIES[name]
    attributes = {"units": quantity.unit, "long_name": quantity.title}
    return {key: text for key, text in attributes.items() if text}


class TabularResult(Result, ABC):
    """Result that consists of uniform records."""

    @abstractmethod
    def records(self) -> list[dict[str, float]]:
        """Return the records, with quantity names as keys."""

    def _table(self) -> Columns:
        return table_of(self.records())

    def to_csv(self, path: str | Path) -> None:
        """Write one CSV line per record, with ten significant digits."""
        write_columns(path, self._table(), digits=10)

    def to_json(self, path: str | Path) -> None:
        """Write a JSON list of objects; unknown values are null."""
        write_json(path, self.records())
