"""Bundled scenes by name."""

from __future__ import annotations

from collections.abc import Callable

from ....base.errors import InvalidParameter
from ..contract import Scene
from .hall import Hall
from .room import Room
from .street import Street

BUNDLED: dict[str, Callable[..., Scene]] = {"room": Room, "street": Street, "hall": Hall}


def bundled_scene(name: str) -> Scene:
    """Return a bundled scene by name.

    Raises
    ------
    InvalidParameter
        If there is no scene of that name.
    """
    if name not in BUNDLED:
        raise InvalidParameter(f"there is no scene {name!r}; valid are {', '.join(BUNDLED)}")
    return BUNDLED[name]()
