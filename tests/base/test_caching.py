"""Cached properties: threads with mutual dependencies do not deadlock."""

from __future__ import annotations

from collections.abc import Callable
from threading import Barrier, Thread

import omnimirror as om
from omnimirror.base.caching import cached_property


class Link:
    """Two values of the same kind of object; each depends on the other value of the next object."""

    def __init__(self, further: Link | None = None, barrier: Barrier | None = None) -> None:
        self.further, self.barrier, self.times = further, barrier, 0

    def _value(self, of_further: Callable[[Link], int]) -> int:
        self.times += 1
        if self.barrier:
            self.barrier.wait(60)
        return 1 + of_further(self.further) if self.further else 0

    @cached_property
    def left(self) -> int:
        """Number of links to the end."""
        return self._value(lambda further: further.right)

    @cached_property
    def right(self) -> int:
        return self._value(lambda further: further.left)


def in_threads(*functions: Callable[[], object]) -> list[object]:
    """Return the results of functions, each run in a thread; a deadlock yields no result."""
    results: list[object] = []
    threads = [
        Thread(target=lambda function=function: results.append(function()), daemon=True)
        for function in functions
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    return results


def test_cached_property_computes_once_and_keeps_docstring():
    link = Link(Link())
    assert (link.left, link.left, link.times) == (1, 1, 1)
    assert Link.left.__doc__ == "Number of links to the end."


def test_cached_properties_of_two_threads_do_not_deadlock():
    """Both start before either continues: one lock per value of the class would deadlock."""
    barrier = Barrier(2)
    one, two = Link(Link(), barrier), Link(Link(), barrier)
    assert in_threads(lambda: one.left, lambda: two.right) == [1, 1]


def test_sensors_are_thread_safe():
    names = ["folded-hyperboloidal", "paper-spherical", "folded-spherical", "paper-equidistant"] * 2
    sensors = [om.load_sensor(name) for name in names]
    barrier = Barrier(len(sensors))

    def field(sensor: om.Sensor) -> tuple[str, float, float]:
        barrier.wait(60)
        return sensor.name, sensor.meridian.omega_min, sensor.meridian.omega_max

    fields = in_threads(*(lambda sensor=sensor: field(sensor) for sensor in sensors))
    assert len(fields) == len(sensors)
    assert len(set(fields)) == len(set(names))
