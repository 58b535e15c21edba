"""Lazily computed and cached attributes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

T = TypeVar("T")


class cached_property(Generic[T]):
    """Cached property without a lock, as :class:`functools.cached_property` since Python 3.12.

    Earlier versions hold one lock per property, shared by all objects of a class, during the
    computation. Two threads that each need a property of the other's sensor then deadlock. Here
    both threads may compute a value on first use; for frozen objects both obtain the same value.

    >>> class Circle:
    ...     radius = 2.0
    ...     @cached_property
    ...     def diameter(self) -> float:
    ...         return 2 * self.radius
    >>> Circle().diameter
    4.0
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self._compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> Self | T:
        if instance is None:
            return self
        value = self._compute(instance)
        # Without ``__set__``, the instance dictionary takes precedence. Another thread's value is
        # kept.
        stored: T = instance.__dict__.setdefault(self._name, value)
        return stored
