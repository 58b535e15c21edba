"""Several views of one camera, each with a name: what a file of them says."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..arguments import check_fields, file_name
from ..cameras import Camera
from ..dewarp import views
from ..dewarp.screens import View
from ..errors import InvalidParameter, SpecError
from ..files import read_tables

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
"""What names of topics, of frames and of addresses may all be."""
MOST = 64
"""Views of one camera."""
STEERED = "perspective"
"""What can be steered: a view that pans, tilts and zooms."""
PAIRS = ("size", "elevation_deg")


@dataclass(frozen=True)
class NamedView:
    """A view of a camera, by a name.

    Parameters
    ----------
    name
        Of letters, digits and underscores.
    kind
        Such as ``"perspective"``; any of :data:`omnimirror.views.VIEWS`.
    options
        What the function of that name in :mod:`omnimirror.views` takes, such as ``pan_deg`` and ``size``.
    steered
        Whether whoever watches it live may pan, tilt and zoom.

    Raises
    ------
    InvalidParameter
        For a name that is none, or a kind that is not known, or one that cannot be steered.

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
    steered: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        check_name(self.name)
        if self.kind not in views.VIEWS:
            raise InvalidParameter(f"view = {self.kind!r} is not known; valid are {', '.join(views.VIEWS)}")
        if self.steered and self.kind != STEERED:
            raise InvalidParameter(f"the view {self.name!r} is a {self.kind}, and only a {STEERED} can be steered")
        known = _keywords(self.kind)
        if other := next((name for name in self.options if name not in known), None):
            raise InvalidParameter(f"{other!r} does not belong to a {self.kind}; valid are {', '.join(known)}")

    def __call__(self, camera: Camera) -> View:
        """The view of a camera.

        Parameters
        ----------
        camera
            A sensor, or a calibrated camera.

        Returns
        -------
        View
            A screen, or several in one picture.
        """
        return views.VIEWS[self.kind](camera, **self.options)


def check_name(name: str) -> None:
    """Refuse what is no name of a view."""
    if not NAME.fullmatch(name):
        raise InvalidParameter(
            f"{name!r} is no name of a view; valid are letters, digits and underscores, a letter first"
        )


def load_views(path: str | Path) -> dict[str, NamedView]:
    """Read a TOML file of views: a table for each, by its name, with what ``omnimirror dewarp`` has options for.

    ``view`` says which it is, a perspective one unless said; ``steered = true`` lets whoever watches it live pan, tilt
    and zoom.

    Parameters
    ----------
    path
        Name of the file.

    Returns
    -------
    dict of NamedView
        By name, in the order of the file.

    Raises
    ------
    SpecError
        There is no such file, or it holds no views; the message names the view.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/views.toml").write_text(
    ...         "[front]\\nsize = [640, 360]\\n[door]\\npan_deg = 90\\nhfov_deg = 40\\nsteered = true"
    ...     )
    ...     {name: view.steered for name, view in om.load_views(f"{folder}/views.toml").items()}
    {'front': False, 'door': True}
    """
    path = file_name("path", path)
    return {name: _view(name, table, str(path)) for name, table in read_tables(path, "view", "views", MOST).items()}


def _view(name: str, table: dict[str, Any], source: str) -> NamedView:
    options = {key: tuple(v) if key in (*PAIRS, "offset_mm") and isinstance(v, list) else v for key, v in table.items()}
    kind, steered = options.pop("view", STEERED), options.pop("steered", False)
    try:
        if not isinstance(kind, str) or not isinstance(steered, bool):
            raise InvalidParameter("view is a word, and steered is true or false")
        return NamedView(name, kind, options, steered)
    except InvalidParameter as e:
        raise SpecError(f"{source}, [{name}]: {e}") from None


def _keywords(kind: str) -> list[str]:
    """What a view of a kind is told beside the camera."""
    make = views.perspective if kind == "perspective" else views.VIEWS[kind]
    return [name for name in inspect.signature(make).parameters if name != "camera"]
