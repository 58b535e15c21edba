"""Registry of views by name, including views of plug-ins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from ...base.arguments import WrongKind, shown
from ...base.numerics.registry import Registry
from ..screens import (
    View,
)
from .makers import cube, dome, ground, mosaic, panorama, perspective, planet, sphere


def _check_maker(name: str, make: Any) -> None:
    if not callable(make):
        raise WrongKind(f"{shown(make)} is no function of a camera that gives a view")


ViewMaker: TypeAlias = Callable[..., View]


VIEWS: Registry[ViewMaker] = Registry(
    "omnimirror.views",
    "a view",
    {
        "panorama": panorama,
        "perspective": lambda _, **options: perspective(**options),
        "dome": dome,
        "sphere": sphere,
        "ground": ground,
        "planet": planet,
        "cube": cube,
        "mosaic": mosaic,
    },
    _check_maker,
)
"""Views by command-line name, called as ``make(camera, **options)``."""


def register_view(name: str, make: ViewMaker) -> None:
    """Register a view under a name for ``omnimirror dewarp --view NAME``.

    Installed packages register views with an entry point in ``pyproject.toml``:
    ``[project.entry-points."omnimirror.views"]`` with ``fan = "my_package:fan"``. In Python no
    registration is required: :class:`omnimirror.Dewarper` accepts any screen.

    Parameters
    ----------
    name
        Name such as ``"fan"``.
    make
        Function called as ``make(camera, **options)``. Its keywords define the applicable options
        of ``omnimirror dewarp``: ``size`` (width, height) in px, each side possibly None,
        ``pan_deg``, ``hfov_deg`` ... It returns a screen
        (:class:`omnimirror.dewarp.screens.Screen`), or several in one image.

    Raises
    ------
    InvalidParameter
        If the name is taken by another view, or ``make`` is not a function.

    Examples
    --------
    >>> import omnimirror as om
    >>> def strip(camera, size=(720, 90), pan_deg=0.0):
    ...     return om.screens.Cylinder(size, -10.0, 10.0, pan_deg)
    >>> om.register_view("docs-strip", strip)
    >>> om.views.VIEWS["docs-strip"](om.load_sensor("paper-spherical")).size
    (720, 90)
    >>> om.views.VIEWS.withdraw("docs-strip")
    """
    VIEWS.register(name, make)
