"""What there is of a kind by name: what comes with the package, and what others add to it."""

from __future__ import annotations

import logging
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from ..arguments import shown
from ..errors import InvalidParameter, OmnimirrorError
from .lazy import cached_property

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Things of a kind by name, in order: our own, those that packages bring, those that were registered.

    An installed package brings some by entry points, in a group of its ``pyproject.toml``; one is imported when it is
    first looked up, so that names can be listed without importing anything.

    Parameters
    ----------
    group
        Of entry points, such as ``"omnimirror.mirrors"``.
    what
        In words, for errors: "a mirror".
    ours
        What comes with the package.
    check
        Called with a name and a thing; raises what is wrong with it.

    Examples
    --------
    >>> sizes = Registry("omnimirror.sizes", "a size", {"A4": 297.0}, lambda name, size: None)
    >>> sizes.register("A3", 420.0)
    >>> dict(sizes)
    {'A4': 297.0, 'A3': 420.0}
    """

    def __init__(self, group: str, what: str, ours: Mapping[str, T], check: Callable[[str, Any], None]) -> None:
        self.group, self.what, self._check = group, what, check
        self._ours = frozenset(ours)
        self._known: dict[str, T] = dict(ours)
        self._named: set[str] = set()  # broken ones that were warned of

    def register(self, name: str, thing: T) -> None:
        """Add a thing under a name of its own; one that is defined anew, as in a notebook, takes its own place.

        Raises
        ------
        InvalidParameter
            The name is taken, or the thing is none of the kind.
        """
        self._check(name, thing)
        if not isinstance(name, str) or not name:
            raise InvalidParameter(f"{shown(name)} is no name for {self.what}")
        if name in self and (name in self._ours or _place(self[name]) != _place(thing)):
            raise InvalidParameter(f"there is {self.what} {name!r} already; choose another name")
        self._known[name] = thing

    def withdraw(self, name: str) -> None:
        """Forget what was registered under a name.

        Raises
        ------
        InvalidParameter
            Nothing was, or it is one of ours.
        """
        if name in self._ours or name not in self._known:
            raise InvalidParameter(f"{shown(name)} was not registered as {self.what}")
        del self._known[name]

    def __getitem__(self, name: str) -> T:
        if name not in self._known:
            self._known[name] = self._imported(self._offered[name])
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._known, *self._offered)))

    def __len__(self) -> int:
        return len(self._known.keys() | self._offered.keys())

    def __contains__(self, name: object) -> bool:
        return name in self._known or name in self._offered

    def items(self) -> ItemsView[str, T]:
        """Those that can be used, with their names; what a package brings that cannot is named in a warning, once."""
        return self._usable().items()

    def values(self) -> ValuesView[T]:
        """Those that can be used, as :meth:`items`."""
        return self._usable().values()

    def _usable(self) -> dict[str, T]:
        found = {}
        for name in self:
            try:
                found[name] = self[name]
            except OmnimirrorError as e:
                if name not in self._named:
                    logging.getLogger("omnimirror").warning("%s", e)
                    self._named.add(name)
        return found

    @cached_property
    def _offered(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group)}

    def _imported(self, point: EntryPoint) -> T:
        package = point.dist.name if point.dist else "a package"
        try:
            thing: T = point.load()
            self._check(point.name, thing)
        except Exception as e:  # whatever another package raises while it is imported
            named = f"{self.what} {point.name!r} of {package} ({point.value})"
            raise OmnimirrorError(f"{named} cannot be used: {e}") from e
        return thing


def _place(thing: Any) -> tuple[str, str]:
    """Where a class or function was defined."""
    return getattr(thing, "__module__", ""), getattr(thing, "__qualname__", repr(thing))
