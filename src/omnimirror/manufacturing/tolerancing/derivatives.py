"""First and second derivatives of every merit by an error, where a sensor without errors begins to have one.

Merits are lengths, sums and the worst over the field of what each object does: of motions, which are vectors, and of
blurs, which are matrices. Those change smoothly, their merits have a kink at 0. So derivatives are taken of the vectors
and of each object, by central differences of fourth order of exactly traced pictures, and those of the merits are what
follows for errors that grow from 0 to plus: a length |r e + b e^2/2| begins with |r| and bends by r b/|r|, and of the
objects that are worst that counts which grows most.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .tolerances import Tolerances
from .trials.compensation import CALIBRATIONS, motion
from .trials.judge import Judge, motions_of
from .trials.merits import OF_MOTION, after
from .trials.picture import Picture, diameter_parts, largest_diameter
from .trials.required.merits import MeritRows

Array = NDArray[np.float64]

NODES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
"""Weights of values at the nodes, to be divided by the step and its square."""
STILL = 1e-9
"""px by a step: what moves less does not move at first, but by rounding."""
TIED = 1e-6
"""Share by which two objects may differ and are both the worst: symmetry makes them alike but for rounding."""


class Rates(NamedTuple):
    """Of a merit by an error: per unit of it, and per unit squared."""

    first: float
    second: float


def merit_rates(judge: Judge, name: str, step: float, tolerances: Tolerances | None = None) -> dict[str, Rates]:
    """Derivatives of all merits by an error that grows from 0.

    Parameters
    ----------
    judge
        Of the sensor.
    name
        Of the error.
    step
        Of the differences, in its unit.
    tolerances
        That know of measured forms.

    Returns
    -------
    dict
        By the names of merits; NaN where rays are lost within two steps.

    Examples
    --------
    A shift of the imager by a pixel is one of the picture:

    >>> import omnimirror as om
    >>> rates = merit_rates(Judge.of(om.load_sensor("paper-spherical")), "imager.shift_x_px", 0.1)
    >>> round(rates["motion_px"].first, 9), round(rates["motion_px after principal-point"].first, 9)
    (1.0, 0.0)
    """
    objects = judge.field
    nodes: Mapping[str, Array] = {name: step * NODES}
    values = nodes if tolerances is None else tolerances.spelt_out(nodes)
    shown, _, focus_mm = objects.shown(values, refocus=judge.refocus)
    moved = motion(shown.offsets_px, judge.reference_px)
    left = judge.compensators.left(moved)
    vectors = np.stack(np.split(left, 2, axis=-1), axis=-1)  # (calibrations, nodes, n, 2)
    deg_per_px = np.linalg.inv(objects.px_per_deg)
    rates = {}
    for depth, of in zip(CALIBRATIONS, vectors, strict=True):
        for unit, turned in (("px", of), ("deg", np.einsum("nij,tnj->tni", deg_per_px, of))):
            first, second = _differences(turned, step)
            still = STILL / step * (1.0 if unit == "px" else float(np.abs(deg_per_px).max()))
            rms, worst = (n for n in OF_MOTION if n.endswith(unit))
            rates[after(rms, depth)] = _of_rms(first, second, still)
            begins = np.zeros_like(first)
            rates[after(worst, depth)] = _largest(begins[:, 0], *_of_lengths(begins, first, second, still))
    focus = _differences(focus_mm, step)
    return (
        rates
        | _of_blur(judge, shown, step)
        | {"focus_distance_mm": Rates(*map(float, focus))}
        | _of_required(judge, values, step)
    )


def _of_required(judge: Judge, values: Mapping[str, Array], step: float) -> dict[str, Rates]:
    """Of merits that limits ask for; NaN where rays are lost."""
    if judge.required is None:
        return {}
    rows, _ = judge.required.rows(values, motions_of)
    return {name: _of_rows(one, step) for name, one in rows.items()}


def _of_rows(rows: MeritRows, step: float) -> Rates:
    value, (first, second) = rows.values[2], _differences(rows.values, step)
    if not np.isfinite(rows.values).all():
        return Rates(np.nan, np.nan)
    if rows.takes == "length":
        (rate,), (bend,) = _of_lengths(0 * value[None], first[None], second[None], STILL / step)
        return Rates(float(rate), float(bend))
    if rows.takes == "departure":
        begins = np.zeros_like(value)
        return _largest(begins, *_of_lengths(begins[:, None], first[:, None], second[:, None], STILL / step))
    high, low = _largest(value, first, second), _largest(-value, -first, -second)
    fall, bend = -low.first, -low.second
    if rows.takes == "largest":
        return high
    if rows.takes == "smallest":
        return Rates(fall, bend)
    if rows.takes == "spread":
        return Rates(high.first - fall, high.second - bend)
    top, ratio = value.max(), value.min() / value.max()
    rate = (fall - ratio * high.first) / top
    return Rates(float(rate), float((bend - 2 * rate * high.first - ratio * high.second) / top))


def _differences(values: Array, step: float) -> tuple[Array, Array]:
    """First and second derivatives at the middle of values at the nodes, which come first."""
    return np.tensordot(FIRST, values, 1) / step, np.tensordot(SECOND, values, 1) / step**2


def _of_rms(first: Array, second: Array, still: float) -> Rates:
    """Of the rms of lengths of vectors (n, 2) that begin at 0."""
    rates, bends = (v.reshape(1, -1) / np.sqrt(len(v)) for v in (first, second))
    (rate,), (bend,) = _of_lengths(np.zeros_like(rates), rates, bends, still)
    return Rates(float(rate), float(bend))


def _of_lengths(value: Array, first: Array, second: Array, still: float) -> tuple[Array, Array]:
    """Derivatives (n,) of the lengths of vectors (n, k) with these derivatives; what is shorter than ``still`` is 0."""
    length, rate = np.linalg.norm(value, axis=1), np.linalg.norm(first, axis=1)
    along = (value * first).sum(axis=1)
    with np.errstate(all="ignore"):
        moving = along / length, (rate**2 + (value * second).sum(axis=1)) / length - along**2 / length**3
        begun = rate, (first * second).sum(axis=1) / rate
    begins, moves = length < still, rate < still
    at_rest = np.zeros_like(rate), np.linalg.norm(second, axis=1)
    choose = [np.where(begins, np.where(moves, at_rest[k], begun[k]), moving[k]) for k in (0, 1)]
    return choose[0], choose[1]


def _largest(value: Array, first: Array, second: Array) -> Rates:
    """Of the largest (n,): among those tied in value those that grow most, and of these those that bend most."""
    if not np.isfinite(value + first + second).all():
        return Rates(np.nan, np.nan)
    most = value >= value.max() - TIED * abs(value.max())
    rate = first[most].max()
    most &= first >= rate - TIED * np.abs(first[most]).max()
    return Rates(float(rate), float(second[most].max()))


def _of_blur(judge: Judge, shown: Picture, step: float) -> dict[str, Rates]:
    blur, floor = shown.blur_px, judge.floor_px2
    squares = (blur**2).sum(axis=(-2, -1))
    area = np.sqrt(np.linalg.det(blur) ** 2 + floor * squares + floor**2) / np.abs(
        np.linalg.det(judge.field.px_per_deg)
    )
    parts = [
        _of_lengths(part[2], *_differences(part, step), STILL / step)
        for part in (np.stack([one, other], axis=-1) for one, other in diameter_parts(blur))
    ]
    diameters = [sum(of) for of in zip(*parts, strict=True)]
    return {
        "blur_px": _largest(largest_diameter(blur[2]), *diameters),
        "floored_area_deg2": _largest(area[2], *_differences(area, step)),
    }
