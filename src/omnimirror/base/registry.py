"""Registries of named objects: bundled, from entry points of other packages, and registered at run
time.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .arguments import format_value
from .caching import cached_property
from .errors import InvalidParameter, OmnimirrorError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Named objects of one kind, in the order: bundled, from installed packages, registered.

    Installed packages provide objects by entry points, in a group of their ``pyproject.toml``. An
    entry point is imported on first access, which allows listing names without imports.

    Parameters
    ----------
    group
        Group of entry points, such as ``"omnimirror.mirrors"``.
    kind
        Kind of object for error messages: "a mirror".
    bundled
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
        self, group: str, kind: str, bundled: Mapping[str, T], check: Callable[[str, Any], None]
    ) -> None:
        self.group, self.kind, self._check = group, kind, check
        self._bundled = frozenset(bundled)
        self._loaded: dict[str, T] = dict(bundled)
        self._reported: set[str] = set()  # broken entry points with a previous warning

    def register(self, name: str, value: T) -> None:
        """Register an object under a unique name; redefinition of the same object, as in a
        notebook, replaces it.

        Raises
        ------
        InvalidParameter
            If the name is taken, or the object is invalid.
        """
        self._check(name, value)
        if not isinstance(name, str) or not name:
            raise InvalidParameter(
                f"the name of {self.kind} must be a non-empty string; got {format_value(name)}"
            )
        if name in self and (name in self._bundled or _location(self[name]) != _location(value)):
            raise InvalidParameter(f"the name of {self.kind} must be unique; got {name!r}")
        self._loaded[name] = value

    def withdraw(self, name: str) -> None:
        """Remove a registered object.

        Raises
        ------
        InvalidParameter
            If the name is not registered, or the object is bundled.
        """
        if name in self._bundled or name not in self._loaded:
            raise InvalidParameter(
                f"name must be that of a registered object ({self.kind}); got {format_value(name)}"
            )
        del self._loaded[name]

    def __getitem__(self, name: str) -> T:
        if name not in self._loaded:
            self._loaded[name] = self._load(self._entry_points[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._loaded, *self._entry_points)))

    def __len__(self) -> int:
        return len(self._loaded.keys() | self._entry_points.keys())

    def __contains__(self, name: object) -> bool:
        return name in self._loaded or name in self._entry_points

    def items(self) -> ItemsView[str, T]:
        """Return the usable objects with their names; a broken entry point causes one warning."""
        return self._usable().items()

    def values(self) -> ValuesView[T]:
        """Return the usable objects, as :meth:`items`."""
        return self._usable().values()

    def _usable(self) -> dict[str, T]:
        usable = {}
        for name in self:
            try:
                usable[name] = self[name]
            except OmnimirrorError as e:
                if name not in self._reported:
                    logging.getLogger(__name__).warning("%s", e)
                    self._reported.add(name)
        return usable

    @cached_property
    def _entry_points(self) -> dict[str, EntryPoint]:
        from importlib.metadata import entry_points  # not required for bundled objects

        return {point.name: point for point in entry_points(group=self.group)}

    def _load(self, point: EntryPoint) -> T:
        package = point.dist.name if point.dist else "an unknown package"
        try:
            value: T = point.load()
            self._check(point.name, value)
        except Exception as e:  # any error in the import of another package
            raise OmnimirrorError(
                f"cannot load {self.kind} {point.name!r} of {package} ({point.value}): {e}"
            ) from e
        return value


def _location(value: Any) -> tuple[str, str]:
    """Return the location of the definition of a class or function."""
    return getattr(value, "__module__", ""), getattr(value, "__qualname__", repr(value))
