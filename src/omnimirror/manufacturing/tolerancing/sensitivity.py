"""Sensitivity analysis: derivatives of merits, effect of single errors, and Sobol indices.

**Derivatives.** Merits are lengths, sums and maxima over the field of motions (vectors) and blurs
(matrices). These vary smoothly, whereas merits have a kink at 0. Derivatives are therefore computed
for vectors and single objects, by fourth-order central differences of exactly traced images, and
those of the merits follow for errors increasing from 0: a length ``|r e + b e^2/2|`` has the slope
``|r|`` and the second derivative ``r b/|r|``; of several worst objects, the fastest growing counts.

**Variance.** The variance of a merit over all trials is decomposed by error (Sobol, Math. Comput.
Simul. 55, 271, 2001). The first-order index of an error is the variance reduction if it alone were
known; its total index is the remaining variance if all others were known. They differ if errors
interact: decentre and tilt of a sphere cancel, so that each has a small index, and their group has a
large one. Indices follow from pairs of trials with one error or group in common (first order:
Saltelli et al., Comput. Phys. Commun. 181, 259, 2010; total: Jansen, Comput. Phys. Commun. 117, 35,
1999).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, table_of
from ...base.typing import Array
from .compensation import CALIBRATIONS, OF_MOTION, after, motion
from .evaluator import MeritRows, TrialEvaluator, image_motions, is_lower_limit
from .monte_carlo import satisfies_limit
from .tolerances import MIN_PROBABILITY, Tolerances, group_of
from .trial_images import TrialImages, diameter_components, largest_diameter

NODES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
"""Finite-difference weights of the first and second derivative, times the step or its square."""
NEGLIGIBLE_RATE = 1e-9
"""First derivatives below this value (px per step) are rounding errors."""
TIED = 1e-6
"""Relative difference of objects that are considered equally bad, for symmetric sensors."""


class Rates(NamedTuple):
    """First and second derivative of a merit with respect to an error."""

    first: float
    second: float


def merit_rates(
    evaluator: TrialEvaluator, name: str, step: float, tolerances: Tolerances | None = None
) -> dict[str, Rates]:
    """Compute derivatives of all merits with respect to an error increasing from 0.

    Parameters
    ----------
    evaluator
        Evaluator of the sensor.
    name
        Error source.
    step
        Step of the differences, in the unit of the error.
    tolerances
        Tolerances with measured forms.

    Returns
    -------
    dict
        Derivatives by merit name; NaN if rays are lost within two steps.

    Examples
    --------
    A shift of the imager by 1 px moves the image by 1 px:

    >>> import omnimirror as om
    >>> evaluator = TrialEvaluator.of(om.load_sensor("paper-spherical"))
    >>> rates = merit_rates(evaluator, "imager.shift_x_px", 0.1)
    >>> round(rates["motion_px"].first, 9), round(rates["motion_px after principal-point"].first, 9)
    (1.0, 0.0)
    """
    objects = evaluator.field
    nodes: Mapping[str, Array] = {name: step * NODES}
    values = nodes if tolerances is None else tolerances.expand_forms(nodes)
    images, _, focus_mm = objects.images_and_focus(values, refocus=evaluator.refocus)
    displaced = motion(images.offsets_px, evaluator.reference_px)
    residuals = evaluator.compensators.left(displaced)
    vectors = np.stack(np.split(residuals, 2, axis=-1), axis=-1)  # (calibrations, nodes, n, 2)
    deg_per_px = np.linalg.inv(objects.px_per_deg)
    rates = {}
    for depth, of in zip(CALIBRATIONS, vectors, strict=True):
        for unit, turned in (("px", of), ("deg", np.einsum("nij,tnj->tni", deg_per_px, of))):
            first, second = _differences(turned, step)
            still = (
                NEGLIGIBLE_RATE / step * (1.0 if unit == "px" else float(np.abs(deg_per_px).max()))
            )
            rms, worst = (n for n in OF_MOTION if n.endswith(unit))
            rates[after(rms, depth)] = _of_rms(first, second, still)
            at_zero = np.zeros_like(first)
            rates[after(worst, depth)] = _largest(
                at_zero[:, 0], *_of_lengths(at_zero, first, second, still)
            )
    focus = _differences(focus_mm, step)
    return (
        rates
        | _of_blur(evaluator, images, step)
        | {"focus_distance_mm": Rates(*map(float, focus))}
        | _of_required(evaluator, values, step)
    )


def _of_required(
    evaluator: TrialEvaluator, values: Mapping[str, Array], step: float
) -> dict[str, Rates]:
    """Return derivatives of merits that limits require; NaN if rays are lost."""
    if evaluator.required is None:
        return {}
    rows, _ = evaluator.required.rows(values, image_motions)
    return {name: _of_rows(one, step) for name, one in rows.items()}


def _of_rows(rows: MeritRows, step: float) -> Rates:
    value, (first, second) = rows.values[2], _differences(rows.values, step)
    if not np.isfinite(rows.values).all():
        return Rates(np.nan, np.nan)
    if rows.takes == "length":
        (rate,), (bend,) = _of_lengths(
            0 * value[None], first[None], second[None], NEGLIGIBLE_RATE / step
        )
        return Rates(float(rate), float(bend))
    if rows.takes == "departure":
        at_zero = np.zeros_like(value)
        return _largest(
            at_zero,
            *_of_lengths(at_zero[:, None], first[:, None], second[:, None], NEGLIGIBLE_RATE / step),
        )
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
    """Return first and second derivatives at the middle node of values along the first axis."""
    return np.tensordot(FIRST, values, 1) / step, np.tensordot(SECOND, values, 1) / step**2


def _of_rms(first: Array, second: Array, still: float) -> Rates:
    """Return derivatives of the RMS length of vectors (n, 2) that start at 0."""
    rates, bends = (v.reshape(1, -1) / np.sqrt(len(v)) for v in (first, second))
    (rate,), (bend,) = _of_lengths(np.zeros_like(rates), rates, bends, still)
    return Rates(float(rate), float(bend))


def _of_lengths(value: Array, first: Array, second: Array, still: float) -> tuple[Array, Array]:
    """Return derivatives (n,) of vector lengths; lengths below ``still`` count as 0."""
    length, rate = np.linalg.norm(value, axis=1), np.linalg.norm(first, axis=1)
    along = (value * first).sum(axis=1)
    with np.errstate(all="ignore"):
        moving = (
            along / length,
            (rate**2 + (value * second).sum(axis=1)) / length - along**2 / length**3,
        )
        starting = rate, (first * second).sum(axis=1) / rate
    at_zero, moves = length < still, rate < still
    at_rest = np.zeros_like(rate), np.linalg.norm(second, axis=1)
    choose = [
        np.where(at_zero, np.where(moves, at_rest[k], starting[k]), moving[k]) for k in (0, 1)
    ]
    return choose[0], choose[1]


def _largest(value: Array, first: Array, second: Array) -> Rates:
    """Return derivatives of the maximum (n,): of tied values, those with the largest derivatives."""
    if not np.isfinite(value + first + second).all():
        return Rates(np.nan, np.nan)
    is_largest = value >= value.max() - TIED * abs(value.max())
    rate = first[is_largest].max()
    is_largest &= first >= rate - TIED * np.abs(first[is_largest]).max()
    return Rates(float(rate), float(second[is_largest].max()))


def _of_blur(evaluator: TrialEvaluator, images: TrialImages, step: float) -> dict[str, Rates]:
    blur, floor = images.blur_px, evaluator.floor_px2
    squares = (blur**2).sum(axis=(-2, -1))
    area = np.sqrt(np.linalg.det(blur) ** 2 + floor * squares + floor**2) / np.abs(
        np.linalg.det(evaluator.field.px_per_deg)
    )
    parts = [
        _of_lengths(part[2], *_differences(part, step), NEGLIGIBLE_RATE / step)
        for part in (np.stack([one, other], axis=-1) for one, other in diameter_components(blur))
    ]
    diameters = [sum(of) for of in zip(*parts, strict=True)]
    return {
        "blur_px": _largest(largest_diameter(blur[2]), *diameters),
        "floored_area_deg2": _largest(area[2], *_differences(area, step)),
    }


STEP = 0.05  # step of differences, relative to the tolerance
GRID_SIZE = 48
"""Number of grid points in each of the two searches for the maximum tolerance."""
BATCH_SIZE = 8
REACH = 1e4  # search range of the maximum tolerance, relative to the tolerance


@dataclass(frozen=True)
class ErrorSensitivity(Result):
    """Effect of one error.

    Attributes
    ----------
    name
        Error source.
    tolerance
        Tolerance of the error.
    merits : dict
        Worse merit of plus and minus the tolerance, by name.
    rates : dict
        First and second derivatives of each merit, for an error increasing from 0.
    max_tolerance : dict
        Tolerance at which this error alone reaches each limit.
    """

    name: str
    tolerance: float
    merits: Mapping[str, float]
    rates: Mapping[str, Rates]
    max_tolerance: Mapping[str, float]

    def _table(self) -> Columns:
        return table_of([self.record()])

    def record(self) -> dict[str, Any]:
        """Return the row of the table: error, tolerance, and for each merit its value and the
        largest tolerance.
        """
        largest = {f"max_tolerance_{name}": value for name, value in self.max_tolerance.items()}
        return {"error": self.name, "tolerance": self.tolerance, **self.merits, **largest}


def sensitivities(
    evaluator: TrialEvaluator, tolerances: Tolerances, limits: Mapping[str, float]
) -> list[ErrorSensitivity]:
    """Evaluate the effect of each error alone.

    Parameters
    ----------
    evaluator
        Evaluator of the sensor.
    tolerances
        Tolerances of its errors.
    limits
        Limits by merit name.

    Returns
    -------
    list of ErrorSensitivity
        Effects in the order of the errors.
    """
    rows = []
    for name, bound in tolerances.errors.items():
        size = bound.value
        at_ends = evaluator.evaluate(tolerances.expand_forms({name: np.array([size, -size])}))
        worst = {
            merit: _worst(merit, values)
            for merit, values in zip(evaluator.names, at_ends.T, strict=True)
        }
        rows.append(
            ErrorSensitivity(
                name,
                size,
                worst,
                _rates(evaluator, name, STEP * size, tolerances) if size else {},
                {
                    merit: _max_single_tolerance(evaluator, tolerances, name, merit, limit)
                    for merit, limit in limits.items()
                },
            )
        )
    return rows


def _rates(
    evaluator: TrialEvaluator, name: str, step: float, tolerances: Tolerances
) -> dict[str, Rates]:
    with np.errstate(all="ignore"):  # NaN if a step loses all rays
        return merit_rates(evaluator, name, step, tolerances)


def _worst(merit: str, values: Array) -> float:
    """Return the worst value of a merit; infinite, or 0 for lower limits, if rays are lost."""
    if np.isnan(values).any():
        return 0.0 if is_lower_limit(merit) else np.inf
    return float(values.min() if is_lower_limit(merit) else values.max())


def _max_single_tolerance(
    evaluator: TrialEvaluator, tolerances: Tolerances, name: str, merit: str, limit: float
) -> float:
    """Find the maximum tolerance of a single error; infinite without a bound, 0 if no tolerance is
    valid.
    """
    size = tolerances.errors[name].value
    if size == 0:
        return np.nan
    sizes = size * np.geomspace(1 / REACH, REACH, GRID_SIZE)
    low, high = 0.0, np.inf
    for _ in range(2):  # coarse grid, then a fine grid between two of its points
        bad = _first_violation(evaluator, tolerances, name, merit, limit, sizes)
        if bad is None:
            return float(high)
        high = float(sizes[bad])
        low = float(sizes[bad - 1]) if bad else low
        if not low:
            return 0.0
        sizes = np.linspace(low, high, GRID_SIZE)
    return low


def _first_violation(
    evaluator: TrialEvaluator,
    tolerances: Tolerances,
    name: str,
    merit: str,
    limit: float,
    sizes: Array,
) -> int | None:
    """Return the index of the first increasing error that violates a limit; evaluate in small
    batches.
    """
    column = evaluator.names.index(merit)
    for start in range(0, len(sizes), BATCH_SIZE):
        some = sizes[start : start + BATCH_SIZE]
        values = tolerances.expand_forms({name: np.concatenate([some, -some])})
        good = (
            satisfies_limit(evaluator.evaluate(values)[:, column], merit, limit)
            .reshape(2, -1)
            .all(axis=0)
        )
        bad = np.flatnonzero(~good)
        if bad.size:
            return start + int(bad[0])
    return None


DRAWS, RUNS = 512, 8
"""Trials per column and run, and number of independent runs for standard errors."""
CHUNK_TRIALS = 16_384
MAX_LOST = 0.5
"""Maximum fraction of trials with lost rays for meaningful indices."""


class SobolIndex(NamedTuple):
    """Sobol indices of one error or group for one merit."""

    first: float
    """First-order index."""
    total: float
    """Total index, including interactions."""
    first_error: float
    total_error: float
    """Standard errors of both indices."""


@dataclass(frozen=True)
class VarianceDecomposition(Result):
    """Sobol indices of all errors.

    Attributes
    ----------
    groups : dict
        Members of each group: correlated errors, and errors of one kind without correlations to others.
    indices : dict
        Indices by merit name, and by error or group. Correlated errors have no individual indices.
    lost
        Fraction of trials that were excluded because of lost rays.
    """

    groups: Mapping[str, tuple[str, ...]]
    indices: Mapping[str, Mapping[str, SobolIndex]]
    lost: float

    def _table(self) -> Columns:
        return table_of(
            {"merit": merit, "error": error, **index._asdict()}
            for merit, indices in self.indices.items()
            for error, index in indices.items()
        )


def sobol_indices(
    evaluator: TrialEvaluator,
    tolerances: Tolerances,
    merits: tuple[str, ...],
    *,
    seed: int = 0,
    draws: int = DRAWS,
) -> VarianceDecomposition:
    """Compute Sobol indices of errors and groups for given merits.

    Parameters
    ----------
    evaluator
        Evaluator of the sensor.
    tolerances
        Tolerances of its errors; those of 0 are excluded.
    merits
        Merit names.
    seed
        Random seed.
    draws
        Trials per column, a power of two; the total is ``8 draws (errors + groups + 2)``.

    Returns
    -------
    VarianceDecomposition
        Indices with standard errors.

    Raises
    ------
    InvalidParameter
        If a merit is unknown or more than half of the trials lose rays.
    """
    names = evaluator.names[:-1]
    for name in merits:
        if name not in names:
            raise InvalidParameter(f"merits must be from {', '.join(names)}; got {name!r}")
    groups, factors = _factors(tolerances)
    columns = [names.index(name) for name in merits]
    runs, losses = [], []
    for run in range(RUNS):
        values = _values(evaluator, tolerances, list(factors.values()), columns, (seed, run), draws)
        runs.append(_indices(values))
        losses.append(np.isnan(values[..., 0]).mean())
    if np.mean(losses) > MAX_LOST:
        raise InvalidParameter(
            f"at most half of the trials may lose rays; got {100 * np.mean(losses):.0f} %; reduce the tolerances or "
            "the field"
        )
    mean, error = np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / np.sqrt(RUNS)
    shares = {
        merit: {name: SobolIndex(*mean[:, i, k], *error[:, i, k]) for i, name in enumerate(factors)}
        for k, merit in enumerate(merits)
    }
    return VarianceDecomposition(groups, shares, float(np.mean(losses)))


def _factors(tolerances: Tolerances) -> tuple[dict[str, tuple[str, ...]], dict[str, list[int]]]:
    """Return groups, and the random-number columns of each uncorrelated error and each group."""
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
    return groups, single | {
        name: [tolerances.names.index(m) for m in members] for name, members in groups.items()
    }


def _values(
    evaluator: TrialEvaluator,
    tolerances: Tolerances,
    factors: list[list[int]],
    columns: list[int],
    seed: tuple[int, int],
    draws: int,
) -> Array:
    """Compute merits (2 + factors, draws, m) of two random matrices and their mixtures by factor."""
    from scipy.stats.qmc import Sobol

    numbers = Sobol(2 * len(tolerances.names), seed=np.random.default_rng(seed)).random(draws)
    one, other = np.split(np.maximum(numbers, MIN_PROBABILITY), 2, axis=1)
    parts = [one, other]
    for factor in factors:
        mixed = one.copy()
        mixed[:, factor] = other[:, factor]
        parts.append(mixed)
    shares = np.concatenate(parts)
    merits = [
        evaluator.evaluate(tolerances.at(shares[k : k + CHUNK_TRIALS]))[:, columns]
        for k in range(0, len(shares), CHUNK_TRIALS)
    ]
    return np.concatenate(merits).reshape(len(parts), draws, len(columns))


def _indices(values: Array) -> Array:
    """Return first-order and total indices (2, factors, m); rows with lost rays are excluded."""
    one, other, mixed = values[0], values[1], values[2:]
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = _mean(values[:2], (0, 1))
        variance = _mean((values[:2] - middle) ** 2, (0, 1))
        first = _mean((other - middle) * (mixed - one), 1) / variance
        total = _mean((one - mixed) ** 2, 1) / (2 * variance)
    return np.stack([first, total])


def _mean(values: Array, axis: int | tuple[int, int]) -> Array:
    """Return the mean of valid values."""
    return np.asarray(np.nansum(values, axis=axis) / (~np.isnan(values)).sum(axis=axis))
