"""Which error makes which share of what varies: Sobol's indices of single errors and of groups.

A merit's variance over all trials is split among independent numbers that errors are drawn from (Sobol, Math. Comput.
Simul. 55, 271, 2001). The first-order share of an error is what would go if it alone were known; its total share is
what would be left if all others were. They differ where errors work together: decentre and tilt of a sphere cancel, so
that the shares of each are little without the other, and the group of both has what is common to them. Shares follow
from pairs of trials that have one error, or one group, in common, and all others drawn anew (first order by Saltelli et
al., Comput. Phys. Commun. 181, 259, 2010; total by Jansen, Comput. Phys. Commun. 117, 35, 1999).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from .errors import group_of
from .tolerances import LEAST_SHARE, Tolerances
from .trials.judge import Judge

Array = NDArray[np.float64]

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
