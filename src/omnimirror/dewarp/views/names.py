"""Views by their names, ours and those of others."""

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
"""Every view by its name on the command line, called as ``make(camera, **options)``."""


def register_view(name: str, make: ViewMaker) -> None:
    """Make a view of one's own known by a name, such as ``omnimirror dewarp --view NAME`` takes.

    An installed package does the same without a call, by an entry point in its ``pyproject.toml``:
    ``[project.entry-points."omnimirror.views"]`` with ``fan = "my_package:fan"``. In Python no name is needed: a
    :class:`omnimirror.Dewarper` takes any screen.

    Parameters
    ----------
    name
        Such as ``"fan"``.
    make
        Called as ``make(camera, **options)``. Its keywords say which options belong to the view, among those of
        ``omnimirror dewarp``: ``size`` (width, height) in px, each perhaps None, ``pan_deg``, ``hfov_deg`` ... It
        returns a screen (:class:`omnimirror.dewarp.screens.Screen`), or several in one picture.

    Raises
    ------
    InvalidParameter
        Another view has this name, or ``make`` is no function.

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
