"""Registries of named objects: bundled, from entry points of other packages, and registered at run
time.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from .arguments import shown
from .caching import cached_property
from .errors import InvalidParameter, OmnimirrorError

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Named objects of one kind, in the order: bundled, from installed packages, registered.

    Installed packages provide objects by entry points, in a group of their ``pyproject.toml``. An
    entry point is imported on first access, which allows listing names without imports.

    Parameters
    ----------
    group
        Group of entry points, such as ``"omnimirror.mirrors"``.
    what
        Kind of object for error messages: "a mirror".
    ours
        Bundled objects.
    check
        Called with a name and an object; raises an error for invalid ones.

    Examples
    --------
    >>> sizes = Registry("omnimirror.sizes", "a size", {"A4": 297.0}, lambda name, size: None)
    >>> sizes.register("A3", 420.0)
    >>> dict(sizes)
    {'A4': 297.0, 'A3': 420.0}
    """

    def __init__(
        self, group: str, what: str, ours: Mapping[str, T], check: Callable[[str, Any], None]
    ) -> None:
        self.group, self.what, self._check = group, what, check
        self._ours = frozenset(ours)
        self._known: dict[str, T] = dict(ours)
        self._named: set[str] = set()  # broken entry points with a previous warning

    def register(self, name: str, thing: T) -> None:
        """Register an object under a unique name; redefinition of the same object, as in a
        notebook, replaces it.

        Raises
        ------
        InvalidParameter
            The name is taken, or the object is invalid.
        """
        self._check(name, thing)
        if not isinstance(name, str) or not name:
            raise InvalidParameter(f"{shown(name)} is no name for {self.what}")
        if name in self and (name in self._ours or _place(self[name]) != _place(thing)):
            raise InvalidParameter(f"there is {self.what} {name!r} already; choose another name")
        self._known[name] = thing

    def withdraw(self, name: str) -> None:
        """Remove a registered object.

        Raises
        ------
        InvalidParameter
            The name is not registered, or the object is bundled.
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
        """Return the usable objects with their names; a broken entry point causes one warning."""
        return self._usable().items()

    def values(self) -> ValuesView[T]:
        """Return the usable objects, as :meth:`items`."""
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
        except Exception as e:  # any error in the import of another package
            named = f"{self.what} {point.name!r} of {package} ({point.value})"
            raise OmnimirrorError(f"{named} cannot be used: {e}") from e
        return thing


def _place(thing: Any) -> tuple[str, str]:
    """Return the location of the definition of a class or function."""
    return getattr(thing, "__module__", ""), getattr(thing, "__qualname__", repr(thing))
