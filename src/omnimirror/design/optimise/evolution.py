"""Evolutionary multi-objective optimisation, starting from known mirrors."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import Any

import numpy as np

from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...optics.batch.optics import DEGREE
from ..criteria.merits import Merit
from .objective import requirements_of
from .optimiser import optimise, start
from .variables import DesignSpace

ANGLES = 161  # of every evaluation
MARGIN = 0.1  # extension of the search box beyond the first designs, in every coordinate
REFUSED = 1e6  # merit of an invalid design


@dataclass(frozen=True)
class Contest:
    """Comparison of designs by several merits."""

    space: DesignSpace
    merits: list[Merit]

    def compare(self, y: Array) -> tuple[Array, Array, Array]:
        """Return designs (n, dim) at best focus, merits (n, merits) and violations (n,)."""
        y = self.space.at_best_focus(y, ANGLES)
        result = self.space.evaluate(y, ANGLES)
        field, omega = self.space.field(y, result), result.omega_deg * DEGREE
        hidden = self.space.hidden(field, omega)
        counting = partial(self.space.counting, omega, hidden)
        counted = field.at(counting())
        values = np.stack([m.value(counted) for m in self.merits], axis=1)
        broken = np.where(result.valid, 0.0, 1.0)
        image = self.space.image(self.space.given(y))
        for _, rows in requirements_of(self.space, field, counting, omega, hidden, image):
            broken = np.maximum(broken, rows.max(axis=1))
        usable = result.valid & np.isfinite(values).all(axis=1) & np.isfinite(broken)
        return y, np.where(usable[:, None], values, REFUSED), np.where(usable, broken, 1.0)

    def best_of(self, y: Array) -> tuple[Array, Array]:
        """Return the non-dominated designs (n, dim), sorted by the first merit, and merits."""
        y, values, broken = self.compare(y)
        better: Any = (values[:, None] <= values).all(axis=2) & (values[:, None] < values).any(axis=2)
        keep = np.flatnonzero((broken <= 0) & ~better[broken <= 0].any(axis=0))
        _, first = np.unique(values[keep], axis=0, return_index=True)  # sorted by the first merit, without duplicates
        keep = keep[first]
        if not keep.size:
            raise OmnimirrorError(
                "no design found that keeps all limits; allow more generations or looser limits, or optimise one merit "
                "alone, which says what conflicts"
            )
        return y[keep], values[keep]


@dataclass(frozen=True)
class Generation:
    """Generation of designs (n, dim) with its search box (2, dim)."""

    number: int
    y: Array
    box: Array


def first_generation(contest: Contest, population: int, seed: int) -> Generation:
    """Return the first generation: known mirrors, single optima, and convex combinations."""
    space = contest.space
    known = [start(space, i, seed)[1] for i in range(2)]
    for merit in contest.merits:
        with suppress(OmnimirrorError):  # limits that a single start does not meet
            known.append(optimise(space.problem, merit.name, starts=1, seed=seed).y)
    corners = np.array(known)
    rng = np.random.default_rng(seed)
    blends = rng.dirichlet(np.full(len(corners), 0.5), max(population - len(corners), 0)) @ corners
    blends *= 1 + 0.003 * rng.standard_normal(blends.shape)
    low, high = space.bounds
    box = np.clip([corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN], low, high)
    return Generation(0, np.clip(np.concatenate([corners, blends])[:population], *box), box)


def evolved(contest: Contest, alive: Generation, generations: int, seed: int) -> Generation:
    """Return the generation after some steps of NSGA-II, or NSGA-III for three or more merits."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.algorithms.moo.nsga3 import NSGA3
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize
    from pymoo.util.ref_dirs import get_reference_directions

    class Comparison(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            count = len(contest.merits)
            super().__init__(n_var=contest.space.dim, n_obj=count, n_ieq_constr=1, xl=alive.box[0], xu=alive.box[1])

        def _evaluate(self, y: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            values, broken = contest.compare(y)[1:]
            out["F"], out["G"] = values, broken[:, None]

    size, count = len(alive.y), len(contest.merits)
    if count == 2:
        algorithm = NSGA2(pop_size=size, sampling=alive.y)
    else:
        steps = next(n for n in range(size, 0, -1) if comb(n + count - 1, count - 1) <= size or n == 1)
        directions = get_reference_directions("das-dennis", count, n_partitions=steps)
        algorithm = NSGA3(ref_dirs=directions, pop_size=max(size, len(directions)), sampling=alive.y)
    seed_here = int(np.random.SeedSequence([seed, alive.number]).generate_state(1)[0] >> 1)
    with np.errstate(all="ignore"):
        found = minimize(Comparison(), algorithm, ("n_gen", generations + 1), seed=seed_here, verbose=False)
    return Generation(alive.number + generations, found.pop.get("X"), alive.box)
