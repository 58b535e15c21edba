"""Values that an object works out when they are first asked for, and keeps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

T = TypeVar("T")


class cached_property(Generic[T]):
    """As :class:`functools.cached_property` from Python 3.12 on: without its lock.

    Before, one lock per property was shared by all objects of a class and held while a value was worked out. Two
    threads that needed two properties of each other's sensors then waited for ever. Here both work a value out
    that both need first; what is frozen gives both the same.

    >>> class Circle:
    ...     radius = 2.0
    ...     @cached_property
    ...     def diameter(self) -> float:
    ...         return 2 * self.radius
    >>> Circle().diameter
    4.0
    """

    def __init__(self, work_out: Callable[[Any], T]) -> None:
        self._work_out = work_out
        self.__doc__ = work_out.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> Self | T:
        if instance is None:
            return self
        found = self._work_out(instance)
        # Having no ``__set__``, the descriptor is not asked again. What another thread kept first is kept.
        kept: T = instance.__dict__.setdefault(self._name, found)
        return kept
