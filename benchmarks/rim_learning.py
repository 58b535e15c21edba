"""Train the classifier that selects the outline of a mirror from candidate rings, with images generated from seeds.

    python benchmarks/rim.py --environments ../shared/data/environments --learn 260 --jobs 2

writes ``rim_classifier.json`` next to the detection. Each image contributes the feature vectors of its candidates and a
label for each: whether the candidate, refined in the full image, is within 1 % of the outline. The members of the
ensemble differ in their initial values and in the 20 % of the images that each omits. The calibration of their
probabilities maximises the likelihood of images with other seeds.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mirror_photographs import Photograph, Rim, error_of
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

import omnimirror as om
from omnimirror.calibration.edge_detection import at_working_size, edges_of, levels_of
from omnimirror.calibration.rim._candidates import candidate_rings
from omnimirror.calibration.rim._classifier import (
    FIRST,
    UNLISTED,
    LogisticMember,
    RimClassifier,
    listed_rows,
)
from omnimirror.calibration.rim._ellipses import Ellipse, refine_ring

Array = NDArray[np.float64]

RIGHT = 0.01  # relative to the radius
NEARLY = (
    0.04  # largest error at working size at which a candidate can be the outline after refinement
)
MEMBERS, BENDS = 7, 16
RIDGE, START = 4.0, 0.15
STEPS = 150
FOLDS = 4
FIRST_SHARE = 0.15  # weight of the initial odds; gives confident results for photographs of mirrors in housings
WORDS = "numbers of rings to log odds; learned from pictures made by seed: "


class Example(NamedTuple):
    """Training example of one image."""

    way: str
    seed: int
    rows: Array
    """Features (n, count)."""
    right: NDArray[np.bool_]
    """Labels of the candidates (n,)."""


def example(way: str, seed: int, photograph: Photograph) -> Example | None:
    """Return the example of a photograph; None without candidates."""
    working = at_working_size(photograph.image)
    rings = candidate_rings(photograph.image, working, edges_of(working))
    if not rings:
        return None
    listed, rows = listed_rows(rings, working)
    levels = levels_of(photograph.image)
    levels = levels.reshape(*levels.shape[:2], -1)
    right = np.zeros(len(listed), dtype=bool)
    for k, i in enumerate(listed):
        ring = rings[i].ellipse.scaled(working.scale)
        if photograph.rim is not None and _error(ring, photograph.rim) < NEARLY:
            right[k] = _error(refine_ring(levels, ring, working.scale)[0], photograph.rim) < RIGHT
    return Example(way, seed, rows, right)


def _error(ring: Ellipse, rim: Rim) -> float:
    return error_of(om.MirrorOutline(ring.centre, ring.semi_axes, ring.angle_deg, 1.0, (0, 0)), rim)


def _of_seed(seed: int, ways: dict[str, Any], folder: Path | None) -> list[Example]:
    made = [example(way, seed, make(seed, folder)) for way, make in ways.items()]
    return [one for one in made if one is not None]


def learned(ways: dict[str, Any], folder: Path | None, seeds: Sequence[int], jobs: int) -> str:
    """Train the classifier on all generators and seeds; return its file."""
    with ProcessPoolExecutor(jobs) as pool:
        examples = [
            one
            for many in pool.map(partial(_of_seed, ways=ways, folder=folder), seeds)
            for one in many
        ]
    told = f"{WORDS}{', '.join(ways)}; seeds {seeds[0]} to {seeds[-1]}; benchmarks/rim_learning.py"
    return as_json(with_trust(examples), told)


def as_json(classifier: RimClassifier, told: str) -> str:
    """Serialise a classifier with four digits."""

    def short(values: Array) -> Any:
        return [short(v) for v in values] if values.ndim else float(f"{values:.4g}")

    members = [
        {name: short(np.asarray(values)) for name, values in vars(one).items()}
        for one in classifier.members
    ]
    lines = [
        f'"made": {json.dumps(told)}',
        f'"trust": {classifier.trust:.4g}',
        f'"first_share": {classifier.first_share:.4g}',
        f'"middle": {json.dumps(short(classifier.middle))}',
        f'"spread": {json.dumps(short(classifier.spread))}',
        '"members": [\n' + ",\n".join(json.dumps(one) for one in members) + "\n]",
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def with_trust(examples: list[Example]) -> RimClassifier:
    """Train the classifier on all examples, with its calibration from cross-validation."""
    judged: list[tuple[Example, Array]] = []
    for part in range(FOLDS):
        others = trained([one for one in examples if one.seed % FOLDS != part])
        judged += [
            (one, others.decision(one.rows).mean(axis=0))
            for one in examples
            if one.seed % FOLDS == part
        ]

    def surprise(trust: float) -> float:
        chances = [
            _probability(
                trust * mean + FIRST_SHARE * np.maximum(one.rows[:, FIRST], UNLISTED), one.right
            )
            for one, mean in judged
        ]
        return -float(np.log(chances).sum())

    trust = float(minimize_scalar(surprise, bounds=(0.1, 2.0), method="bounded").x)
    return replace(trained(examples), trust=trust)


def _probability(odds: Array, right: NDArray[np.bool_]) -> float:
    """Return the likelihood of the labels, including those without an outline."""
    every = np.append(odds, 0.0)
    weights = np.exp(every - every.max())
    return max(float(weights[np.append(right, not right.any())].sum() / weights.sum()), 1e-12)


def trained(examples: list[Example]) -> RimClassifier:
    """Train a classifier without calibration."""
    rows = np.concatenate([one.rows for one in examples])
    middle = np.nan_to_num(np.nanmedian(rows, axis=0))
    low, high = np.nanpercentile(rows, [10, 90], axis=0)
    spread = np.maximum((high - low) / 2.56, np.maximum(0.3 * np.nanstd(rows, axis=0), 1e-3))
    empty = RimClassifier(middle, spread, (), 1.0, FIRST_SHARE)
    scaled = [one._replace(rows=empty.scaled(one.rows)) for one in examples]
    return replace(empty, members=tuple(_member(scaled, seed) for seed in range(MEMBERS)))


def _member(examples: list[Example], seed: int) -> LogisticMember:
    """Train one member by maximum likelihood: a conditional logit of the candidates and none."""
    rng = np.random.default_rng(seed)
    chosen = [one for one in examples if rng.random() > 0.2]
    rows = np.concatenate([one.rows for one in chosen])
    right = np.concatenate([one.right for one in chosen])
    which = np.repeat(np.arange(len(chosen)), [len(one.right) for one in chosen])
    none = np.array([not one.right.any() for one in chosen])
    width = rows.shape[1]
    shapes = [(width,), (), (width, BENDS), (BENDS,), (BENDS,)]
    sizes = [int(np.prod(shape)) for shape in shapes]
    ends = np.cumsum(sizes)[:-1]

    def parts(numbers: Array) -> list[Array]:
        return [
            part.reshape(shape) for part, shape in zip(np.split(numbers, ends), shapes, strict=True)
        ]

    def loss(numbers: Array) -> tuple[float, Array]:
        linear, bias, hidden, shift, out = parts(numbers)
        bends = np.tanh(rows @ hidden + shift)
        odds = rows @ linear + bias + bends @ out
        top = np.zeros(len(chosen))
        np.maximum.at(top, which, odds)
        weights, nothing = np.exp(odds - top[which]), np.exp(-top)
        total = nothing + np.bincount(which, weights, len(chosen))
        p = weights / total[which]
        good = np.maximum(
            np.bincount(which, p * right, len(chosen)) + none * nothing / total, 1e-12
        )
        slope = p - p * right / good[which]
        back = slope[:, None] * out * (1 - bends**2)
        gradient = [
            rows.T @ slope,
            [slope.sum()],
            (rows.T @ back).ravel(),
            back.sum(axis=0),
            bends.T @ slope,
        ]
        held = numbers.copy()
        held[width] = 0.0  # no penalty on the bias
        return RIDGE * float(held @ held) - float(np.log(good).sum()), np.concatenate(
            gradient
        ) + 2 * RIDGE * held

    start = np.zeros(sum(sizes))
    start[width + 1 :] = rng.normal(0, START, sum(sizes) - width - 1)
    linear, bias, hidden, shift, out = parts(
        minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": STEPS}).x
    )
    return LogisticMember(linear, float(bias), hidden, shift, out)
