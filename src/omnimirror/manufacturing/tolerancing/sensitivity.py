"""First and second derivatives of every merit by an error, where a sensor without errors begins to have one.

Merits are lengths, sums and the worst over the field of what each object does: of motions, which are vectors, and of
blurs, which are matrices. Those change smoothly, their merits have a kink at 0. So derivatives are taken of the vectors
and of each object, by central differences of fourth order of exactly traced pictures, and those of the merits are what
follows for errors that grow from 0 to plus: a length |r e + b e^2/2| begins with |r| and bends by r b/|r|, and of the
objects that are worst that counts which grows most.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from .compensation import CALIBRATIONS, OF_MOTION, after, motion
from .evaluator import Judge, motions_of
from .monte_carlo import within
from .perturbation import group_of
from .requirement_merits import MeritRows, is_least
from .tolerances import LEAST_SHARE, Tolerances
from .trial_images import Picture, diameter_parts, largest_diameter

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


STEP = 0.05  # of the tolerance, of the differences that derivatives are made of
LADDER = 48
"""Rungs between which the largest tolerance is looked for; each halves what is left of the search."""
RUNGS_AT_ONCE = 8
REACH = 1e4  # times its tolerance, beyond which an error alone is not asked for


@dataclass(frozen=True)
class ErrorEffect:
    """Of one error.

    Attributes
    ----------
    name
        Of the error.
    tolerance
        What was asked.
    merits : dict
        At the tolerance, the worse of plus and minus, by name.
    rates : dict
        First and second derivatives of each merit by the error, as it grows from 0 to plus.
    alone : dict
        By the name of each limit, the tolerance at which this error alone comes to it.
    """

    name: str
    tolerance: float
    merits: Mapping[str, float]
    rates: Mapping[str, Rates]
    alone: Mapping[str, float]


def sensitivities(judge: Judge, tolerances: Tolerances, limits: Mapping[str, float]) -> list[ErrorEffect]:
    """Of all errors, one by one.

    Parameters
    ----------
    judge
        Of the sensor.
    tolerances
        Of its errors.
    limits
        By names of merits.

    Returns
    -------
    list of ErrorEffect
        In the order of the errors.
    """
    rows = []
    for name, bound in tolerances.errors.items():
        size = bound.value
        at_ends = judge.judged(tolerances.spelt_out({name: np.array([size, -size])}))
        worst = {merit: _worst(merit, values) for merit, values in zip(judge.names, at_ends.T, strict=True)}
        rows.append(
            ErrorEffect(
                name,
                size,
                worst,
                _rates(judge, name, STEP * size, tolerances) if size else {},
                {merit: _alone(judge, tolerances, name, merit, limit) for merit, limit in limits.items()},
            )
        )
    return rows


def _rates(judge: Judge, name: str, step: float, tolerances: Tolerances) -> dict[str, Rates]:
    with np.errstate(all="ignore"):  # a step beyond the mirror loses every ray: NaN
        return merit_rates(judge, name, step, tolerances)


def _worst(merit: str, values: Array) -> float:
    """Of a merit's values; where rays are lost, infinite, or 0 of what is to be large."""
    if np.isnan(values).any():
        return 0.0 if is_least(merit) else np.inf
    return float(values.min() if is_least(merit) else values.max())


def _alone(judge: Judge, tolerances: Tolerances, name: str, merit: str, limit: float) -> float:
    """The largest tolerance of an error alone; infinite where any will do, 0 where none does."""
    size = tolerances.errors[name].value
    if size == 0:
        return np.nan
    sizes = size * np.geomspace(1 / REACH, REACH, LADDER)
    low, high = 0.0, np.inf
    for _ in range(2):  # a ladder, and one between two of its rungs
        bad = _first_bad(judge, tolerances, name, merit, limit, sizes)
        if bad is None:
            return float(high)
        high = float(sizes[bad])
        low = float(sizes[bad - 1]) if bad else low
        if not low:
            return 0.0
        sizes = np.linspace(low, high, LADDER)
    return low


def _first_bad(judge: Judge, tolerances: Tolerances, name: str, merit: str, limit: float, sizes: Array) -> int | None:
    """The first of rising sizes of an error that breaks a limit; those far beyond it are not asked for."""
    place = judge.names.index(merit)
    for start in range(0, len(sizes), RUNGS_AT_ONCE):
        some = sizes[start : start + RUNGS_AT_ONCE]
        values = tolerances.spelt_out({name: np.concatenate([some, -some])})
        good = within(judge.judged(values)[:, place], merit, limit).reshape(2, -1).all(axis=0)
        bad = np.flatnonzero(~good)
        if bad.size:
            return start + int(bad[0])
    return None


DRAWS, RUNS = 512, 8
"""Trials of each column of one run, and runs with other random numbers, which tell how sure the shares are."""
CHUNK_TRIALS = 16_384
MOST_LOST = 0.5
"""Share of trials without merits, beyond which what the others say means little."""


class VarianceShare(NamedTuple):
    """Of one error or group, in the variance of one merit."""

    first: float
    """First order: alone."""
    total: float
    """With all that others do together with it."""
    first_error: float
    total_error: float
    """Standard errors of both."""


@dataclass(frozen=True)
class VarianceShares:
    """Of all errors.

    Attributes
    ----------
    groups : dict
        Names of errors by the name of their group: those that are correlated, and those of one kind, unless they are
        correlated with others.
    shares : dict
        By the name of a merit, and by the name of an error or group. Errors that are correlated have none of their own.
    lost
        Share of the trials that lost rays and were left out.
    """

    groups: Mapping[str, tuple[str, ...]]
    shares: Mapping[str, Mapping[str, VarianceShare]]
    lost: float


def variance_shares(
    judge: Judge,
    tolerances: Tolerances,
    merits: tuple[str, ...],
    *,
    seed: int = 0,
    draws: int = DRAWS,
) -> VarianceShares:
    """What each error, and each group, has of the variance of merits.

    Parameters
    ----------
    judge
        Of the sensor.
    tolerances
        Of its errors; those of 0 have no share.
    merits
        Names.
    seed
        Of the trials.
    draws
        Trials of each column, a power of two; there are ``8 draws (errors + groups + 2)`` in all.

    Returns
    -------
    VarianceShares
        With standard errors.

    Raises
    ------
    InvalidParameter
        Names of no merits, or more than half of the trials lose rays.
    """
    known = judge.names[:-1]
    for name in merits:
        if name not in known:
            raise InvalidParameter(f"{name!r} is no merit of trials; valid are {', '.join(known)}")
    groups, factors = _factors(tolerances)
    columns = [known.index(name) for name in merits]
    runs, lost = [], []
    for run in range(RUNS):
        values = _values(judge, tolerances, list(factors.values()), columns, (seed, run), draws)
        runs.append(_indices(values))
        lost.append(np.isnan(values[..., 0]).mean())
    if np.mean(lost) > MOST_LOST:
        raise InvalidParameter(
            f"{100 * np.mean(lost):.0f} % of the trials lose rays, and have no merit that varies; make the tolerances "
            "smaller, or the field"
        )
    mean, error = np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / np.sqrt(RUNS)
    shares = {
        merit: {name: VarianceShare(*mean[:, i, k], *error[:, i, k]) for i, name in enumerate(factors)}
        for k, merit in enumerate(merits)
    }
    return VarianceShares(groups, shares, float(np.mean(lost)))


def _factors(tolerances: Tolerances) -> tuple[dict[str, tuple[str, ...]], dict[str, list[int]]]:
    """Groups, and the columns of random numbers behind each error that has one of its own and each group."""
    names = [name for name, bound in tolerances.errors.items() if bound.value > 0]
    together: dict[str, set[str]] = {name: {name} for name in names}
    for pair in tolerances.correlations:
        both = set.union(*(together[name] for name in pair if name in together), set())
        together |= dict.fromkeys(both, both)
    grouped: dict[str, list[str]] = {}
    for name in names:
        grouped.setdefault(group_of(name), []).append(name)
    groups = {
        name: tuple(members)
        for name, members in grouped.items()
        if len(members) > 1 and all(together[member] <= set(members) for member in members)
    }
    for both in together.values():
        if len(both) > 1:
            members = tuple(name for name in names if name in both)
            groups[" + ".join(members)] = members
    single = {name: [tolerances.names.index(name)] for name in names if len(together[name]) == 1}
    return groups, single | {name: [tolerances.names.index(m) for m in members] for name, members in groups.items()}


def _values(
    judge: Judge,
    tolerances: Tolerances,
    factors: list[list[int]],
    columns: list[int],
    seed: tuple[int, int],
    draws: int,
) -> Array:
    """Merits (2 + factors, draws, m): of a matrix of random numbers, of another, and of the first with each factor of
    the other."""
    from scipy.stats.qmc import Sobol

    numbers = Sobol(2 * len(tolerances.names), seed=np.random.default_rng(seed)).random(draws)
    one, other = np.split(np.maximum(numbers, LEAST_SHARE), 2, axis=1)
    parts = [one, other]
    for factor in factors:
        mixed = one.copy()
        mixed[:, factor] = other[:, factor]
        parts.append(mixed)
    shares = np.concatenate(parts)
    merits = [
        judge.judged(tolerances.at(shares[k : k + CHUNK_TRIALS]))[:, columns]
        for k in range(0, len(shares), CHUNK_TRIALS)
    ]
    return np.concatenate(merits).reshape(len(parts), draws, len(columns))


def _indices(values: Array) -> Array:
    """First-order and total shares (2, factors, m) of merits (2 + factors, draws, m); rows that lose rays left out."""
    one, other, mixed = values[0], values[1], values[2:]
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = _mean(values[:2], (0, 1))
        variance = _mean((values[:2] - middle) ** 2, (0, 1))
        first = _mean((other - middle) * (mixed - one), 1) / variance
        total = _mean((one - mixed) ** 2, 1) / (2 * variance)
    return np.stack([first, total])


def _mean(values: Array, axis: int | tuple[int, int]) -> Array:
    """Of those that are numbers."""
    return np.asarray(np.nansum(values, axis=axis) / (~np.isnan(values)).sum(axis=axis))
