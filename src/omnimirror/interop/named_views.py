"""Named views of one camera and the TOML files that define them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import create_model

from ..base.arguments import check_fields, file_name
from ..base.errors import InvalidParameter, SpecError
from ..base.files import read_tables
from ..base.table_models import Table
from ..base.toml_validation import did_you_mean, merge_tables
from ..cameras.camera import Camera
from ..dewarp import views
from ..dewarp.screens import View

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
"""Names that are valid in ROS topics, TF frames and URLs."""
MAX_VIEWS = 64
STEERABLE_KIND = "perspective"
TUPLE_OPTIONS = ("size", "elevation_deg", "offset_mm")
"""Options that are tuples in Python and arrays in TOML."""


@dataclass(frozen=True)
class NamedView:
    """A view of a camera with a name.

    Parameters
    ----------
    name
        Name of letters, digits and underscores.
    kind
        Type of the view, such as ``"perspective"``; any key of :data:`omnimirror.views.VIEWS`.
    options
        Arguments of the function of this name in :mod:`omnimirror.views`, such as ``pan_deg``
        and ``size``.
    steerable
        Whether clients of a live view may pan, tilt and zoom.

    Raises
    ------
    InvalidParameter
        If the name, the kind or an option is invalid, or the kind is not steerable.

    Examples
    --------
    >>> import omnimirror as om
    >>> door = NamedView("door", "perspective", {"pan_deg": 30.0, "size": (640, 360)})
    >>> print(door(om.load_sensor("paper-spherical")))
    perspective view (pan 30, tilt 0, hfov 90 deg)
    """

    name: str
    kind: str = "perspective"
    options: Mapping[str, Any] = field(default_factory=dict)
    steerable: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        check_view_name(self.name)
        if self.kind not in views.VIEWS:
            raise InvalidParameter(
                f"view must be one of {', '.join(views.VIEWS)}; got {self.kind!r}"
            )
        if self.steerable and self.kind != STEERABLE_KIND:
            raise InvalidParameter(
                f"a steerable view must be {STEERABLE_KIND}; {self.name!r} is a {self.kind} view"
            )
        valid = _options(self.kind)
        if unknown := next((name for name in self.options if name not in valid), None):
            raise InvalidParameter(
                f"options of a {self.kind} view must be from view, {', '.join(valid)}; got {unknown!r}"
                f"{did_you_mean(unknown, valid)}"
            )
        required = [name for name, p in valid.items() if _is_required(p)]
        if missing := [name for name in required if name not in self.options]:
            raise InvalidParameter(f"a {self.kind} view requires {' and '.join(missing)}")

    def __call__(self, camera: Camera) -> View:
        """Construct the view for a camera.

        Parameters
        ----------
        camera
            Sensor or calibrated camera.

        Returns
        -------
        View
            Screen, or a composition of several screens.
        """
        return views.VIEWS[self.kind](camera, **self.options)


def check_view_name(name: str) -> None:
    """Raise InvalidParameter unless the name is valid for a view."""
    if not NAME.fullmatch(name):
        raise InvalidParameter(
            f"the name of a view must consist of letters, digits and underscores and begin with a letter; got {name!r}"
        )


def load_views(path: str | Path, changes: Mapping[str, Any] | None = None) -> dict[str, NamedView]:
    """Read a TOML file of views.

    Each table defines the view of its name by the options of ``omnimirror dewarp``. The key
    ``view`` selects the type (default: perspective); ``steerable = true`` permits clients of a
    live view to pan, tilt and zoom.

    Parameters
    ----------
    path
        Name of the file.
    changes
        Replacements for entries of the file: ``{"door": {"pan_deg": 40}}``; None removes an entry.

    Returns
    -------
    dict of NamedView
        Views by name, in the order of the file.

    Raises
    ------
    SpecError
        If the file does not exist, a view is invalid, or a change is not that of a view; the message
        names the view.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/views.toml").write_text(
    ...         "[front]\\nsize = [640, 360]\\n[door]\\npan_deg = 90\\nsteerable = true"
    ...     )
    ...     {name: view.steerable for name, view in om.load_views(f"{folder}/views.toml").items()}
    {'front': False, 'door': True}
    """
    path = file_name("path", path)
    tables = read_tables(path, "view", "views", MAX_VIEWS)
    for name, entries in (changes or {}).items():
        if name not in tables:
            raise SpecError(
                f"{path}: unknown view {name}{did_you_mean(name, tables)}; use {', '.join(tables)}"
            )
        if not isinstance(entries, Mapping):
            raise SpecError(
                f"{path}: changes of the view {name} must be entries such as {name}.pan_deg"
            )
    tables = merge_tables(tables, changes or {})
    return {name: _view_in_file(name, table, str(path)) for name, table in tables.items()}


def parse_view(name: str, table: dict[str, Any]) -> NamedView:
    """Convert a table of a file to a view; ``view`` is its type, ``steerable`` permits steering.

    >>> parse_view("door", {"view": "panorama", "size": [720, 180]}).options
    {'size': (720, 180)}
    """
    options = {
        key: tuple(value) if key in TUPLE_OPTIONS and isinstance(value, list) else value
        for key, value in table.items()
    }
    kind, steerable = options.pop("view", STEERABLE_KIND), options.pop("steerable", False)
    if not isinstance(kind, str):
        raise InvalidParameter(f"view must be a string; got {kind!r}")
    if not isinstance(steerable, bool):
        raise InvalidParameter(f"steerable must be true or false; got {steerable!r}")
    return NamedView(name, kind, options, steerable)


def _view_in_file(name: str, table: dict[str, Any], source: str) -> NamedView:
    try:
        return parse_view(name, table)
    except InvalidParameter as e:
        raise SpecError(f"{source}, [{name}]: {e}") from None


def _options(kind: str) -> dict[str, inspect.Parameter]:
    """Return the parameters of a view function except the camera."""
    parameters = inspect.signature(_function_of(kind)).parameters
    return {name: p for name, p in parameters.items() if name != "camera"}


def _is_required(p: inspect.Parameter) -> bool:
    return p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)


def _function_of(kind: str) -> views.ViewMaker:
    return views.perspective if kind == "perspective" else views.VIEWS[kind]


def options_model(kind: str) -> type[Table]:
    """Create the pydantic model of the options of a kind of view, from the signature of its function.

    Options without type hints, of registered functions, accept all values.
    """
    try:
        hints = get_type_hints(_function_of(kind))
    except (NameError, TypeError):
        hints = {}
    entries: dict[str, Any] = {
        name: (hints.get(name, Any), ... if p.default is p.empty else p.default)
        for name, p in _options(kind).items()
        if p.kind is not p.VAR_KEYWORD
    }
    model: type[Table] = create_model(kind, __base__=Table, **entries)
    return model
