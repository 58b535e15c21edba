"""Names of sensor parameters as in sensor files: ``mirror.radius_mm``, ``imager.centre_px[0]``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from ...base.arguments import shown
from ...base.errors import InvalidParameter
from ...optics.lenses import Perspective
from ...optics.sensor import Sensor

NAME = re.compile(r"(mirror|lens|imager|mirror_pose|mount)\.(\w+)(?:\[(\d+)\])?")
DISTANCE = "mount.mirror_distance_mm"


class NamedNumber(NamedTuple):
    """Location of a sensor parameter: its section, its key, and its index in a list."""

    section: str
    key: str
    item: int | None = None

    @property
    def name(self) -> str:
        """Name as in sensor files and error messages."""
        return f"{self.section}.{self.key}" + ("" if self.item is None else f"[{self.item}]")

    def of(self, part: Any) -> float:
        """Return the value in a section."""
        value = part.centre if self.key == "centre_px" else getattr(part, self.key)
        return float(value if self.item is None else value[self.item])

    def change(self, part: Any, value: Any) -> dict[str, Any]:
        """Return the replacements in a section for another value."""
        if self.item is None:
            return {self.key: value}
        values = list(part.centre if self.key == "centre_px" else getattr(part, self.key))
        values[self.item] = value
        return {self.key: tuple(values)}


def place_of(sensor: Sensor, name: str) -> NamedNumber:
    """Return the location of a named parameter of a sensor.

    >>> import omnimirror as om
    >>> place_of(om.load_sensor("paper-spherical"), "imager.centre_px[1]")
    NamedNumber(section='imager', key='centre_px', item=1)
    """
    matched = NAME.fullmatch(name)
    known = list(known_names(sensor))
    if matched is None or name not in known:
        raise InvalidParameter(f"{shown(name)} is no parameter of {sensor.name!r}; valid are {', '.join(known)}")
    section, key, index = matched.groups()
    return NamedNumber(section, key, None if index is None else int(index))


def known_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of all parameters that affect the image of a sensor."""
    yield from shape_names(sensor)
    yield from lens_names(sensor)
    yield from ("imager.centre_px[0]", "imager.centre_px[1]", "imager.pixel_pitch_um")
    if not sensor.lens.TELECENTRIC:
        yield DISTANCE
    yield from (f"mirror_pose.{key}" for key in sensor.mirror_pose.PARAMETERS)


NO_SHAPE = ("omega_min_deg", "rim_radius_mm", "normalization_radius_mm", "uncertainty_um", "x_mm", "height")
"""Parameters of the extent and the normalisation of a mirror, which do not affect its shape."""
FROM_THE_AXIS = ("slopes", "z_mm", "omega_deg")
"""Lists whose first element is on the axis, where it is fixed for a smooth mirror."""


def shape_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of the mirror's shape parameters."""
    for key, parameter in sensor.mirror.PARAMETERS.items():
        value = getattr(sensor.mirror, key)
        if parameter.choices or value is None or key in NO_SHAPE:
            continue
        if isinstance(value, tuple):
            first = 1 if key in FROM_THE_AXIS else 0
            yield from (f"mirror.{key}[{i}]" for i in range(first, len(value)))
        else:
            yield f"mirror.{key}"


def lens_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of lens parameters that affect image positions, not only blur."""
    if not isinstance(sensor.lens, Perspective):
        yield "lens.magnification"
        return
    yield "lens.focal_length_mm"
    yield from (f"lens.{key}" for key in ("k1", "k2", "k3", "p1", "p2"))


def value_of(sensor: Sensor, place: NamedNumber) -> float:
    """Return the value of a parameter."""
    return place.of(sensor if place.section == "mount" else getattr(sensor, place.section))


def changed(sensor: Sensor, places: Iterable[NamedNumber], values: Iterable[float]) -> Sensor:
    """Return the sensor with other parameter values and without uncertainty.

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> changed(sensor, [place_of(sensor, "mirror.radius_mm")], [51.0]).mirror.radius_mm
    51.0
    """
    parts: dict[str, dict[str, Any]] = {}
    for place, value in zip(places, values, strict=True):
        entries = parts.setdefault(place.section, {})
        if place.item is not None and place.key in entries:
            values_so_far = list(entries[place.key])
            values_so_far[place.item] = float(value)
            entries[place.key] = tuple(values_so_far)
            continue
        part = sensor if place.section == "mount" else getattr(sensor, place.section)
        entries |= place.change(part, float(value))
    whole = parts.pop("mount", {})
    made = {section: replace(getattr(sensor, section), **entries) for section, entries in parts.items()}
    return replace(sensor, **made, **whole, uncertainty=None)
