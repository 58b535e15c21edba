"""Differences between the evaluated sensor and the one that an export describes."""

from __future__ import annotations

from dataclasses import fields

from ..analysis.comparison import compare
from ..sensor import Sensor
from ..tracing.obscuration import Obscuration


def changes_of(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List the quantities that differ between a sensor and the one that is drawn and exported, with both values.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.manufacturing import Body
    >>> from omnimirror.manufacturing.parts import housed, parts_of
    >>> sensor = om.load_sensor("paper-spherical")
    >>> changes_of(sensor, housed(parts_of(sensor, Body(thickness_mm=8.0))))
    []
    >>> changes_of(sensor, housed(parts_of(sensor, Body(flange_width_mm=5.0))))[0]
    'rim hides nothing -> 129.3 to 135 deg'
    """
    evaluated, exported = evaluated.aligned(), exported.aligned()
    found = [*_cover_changes(evaluated, exported), *_ring_changes(evaluated.obscurations, exported.obscurations)]
    if not found and _rounded(evaluated.field_deg) == _rounded(exported.field_deg):
        return []
    pair = compare([evaluated, exported])
    rows = [f"{row.name} {row.texts[0]} -> {row.texts[1]} {row.quantity.unit}".rstrip()
            for row in pair.rows if row.texts[0] != row.texts[1]]  # fmt: skip
    return [*found, *rows]


def _rounded(numbers: tuple[float, ...]) -> tuple[str, ...]:
    return tuple(f"{number:.6g}" for number in numbers)


def _cover_changes(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List the differing fields of tube, dome or window, fitted to either sensor."""
    before, after = evaluated.obstructions.housing.shell, exported.obstructions.housing.shell
    if type(before) is not type(after):
        kinds = ["none" if shell is None else shell.KIND for shell in (before, after)]
        return [f"cover {kinds[0]} -> {kinds[1]}"]
    if before is None or after is None:
        return []
    values = [(f.name, getattr(before, f.name), getattr(after, f.name)) for f in fields(before)]
    return [
        f"{before.KIND} {name} {_words(old)} -> {_words(new)}"
        for name, old, new in values if _words(old) != _words(new)
    ]  # fmt: skip


def _ring_changes(before: tuple[Obscuration, ...], after: tuple[Obscuration, ...]) -> list[str]:
    """List the parts that hide another part of the field."""
    rings = [
        {part: " and ".join(_ring_words(ring) for ring in found if ring.part == part) for part in _parts(found)}
        for found in (before, after)
    ]
    names = list(dict.fromkeys([*rings[0], *rings[1]]))
    pairs = [(name, *(found.get(name, "nothing") for found in rings)) for name in names]
    return [f"{name} hides {old} -> {new}" for name, old, new in pairs if old != new]


def _parts(rings: tuple[Obscuration, ...]) -> list[str]:
    return list(dict.fromkeys(ring.part for ring in rings))


def _ring_words(ring: Obscuration) -> str:
    return f"{ring.omega_deg[0]:.4g} to {ring.omega_deg[1]:.4g} deg"


def _words(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
