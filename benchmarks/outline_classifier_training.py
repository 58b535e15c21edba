"""Train the classifier that selects the outline of a mirror from candidate rings, with images generated from seeds.

    python benchmarks/outline_detection.py --environments ENVIRONMENTS --train 260 --jobs 2

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
from mirror_composites import LabelledImage, TrueOutline, outline_error
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

MAX_ERROR = 0.01  # relative to the radius
MAX_INITIAL_ERROR = (
    0.04  # largest error at working size at which a candidate can be the outline after refinement
)
MEMBERS, HIDDEN_UNITS = 7, 16
L2_PENALTY, INITIAL_SCALE = 4.0, 0.15
MAX_ITERATIONS = 150
FOLDS = 4
PRIOR_WEIGHT = 0.15  # weight of the initial odds; gives confident results for photographs of mirrors in housings
DESCRIPTION = "features of rings to log odds; trained on generated images: "


class Example(NamedTuple):
    """Training example of one image."""

    generator: str
    seed: int
    features: Array
    """Features (n, count)."""
    labels: NDArray[np.bool_]
    """Labels of the candidates (n,)."""


def example(generator: str, seed: int, labelled: LabelledImage) -> Example | None:
    """Return the example of a photograph; None without candidates."""
    working = at_working_size(labelled.image)
    rings = candidate_rings(labelled.image, working, edges_of(working))
    if not rings:
        return None
    listed, features = listed_rows(rings, working)
    levels = levels_of(labelled.image)
    levels = levels.reshape(*levels.shape[:2], -1)
    labels = np.zeros(len(listed), dtype=bool)
    for k, i in enumerate(listed):
        ring = rings[i].ellipse.scaled(working.scale)
        if labelled.rim is not None and _error(ring, labelled.rim) < MAX_INITIAL_ERROR:
            labels[k] = (
                _error(refine_ring(levels, ring, working.scale)[0], labelled.rim) < MAX_ERROR
            )
    return Example(generator, seed, features, labels)


def _error(ring: Ellipse, rim: TrueOutline) -> float:
    return outline_error(
        om.MirrorOutline(ring.centre, ring.semi_axes, ring.angle_deg, 1.0, (0, 0)), rim
    )


def _examples_of_seed(seed: int, generators: dict[str, Any], folder: Path | None) -> list[Example]:
    examples = [
        example(generator, seed, make(seed, folder)) for generator, make in generators.items()
    ]
    return [item for item in examples if item is not None]


def train_and_serialise(
    generators: dict[str, Any], folder: Path | None, seeds: Sequence[int], jobs: int
) -> str:
    """Train the classifier on all generators and seeds; return its file."""
    with ProcessPoolExecutor(jobs) as pool:
        examples = [
            item
            for batch in pool.map(
                partial(_examples_of_seed, generators=generators, folder=folder), seeds
            )
            for item in batch
        ]
    description = (
        f"{DESCRIPTION}{', '.join(generators)}; seeds {seeds[0]} "
        f"to {seeds[-1]}; benchmarks/outline_classifier_training.py"
    )
    return as_json(train_calibrated(examples), description)


def as_json(classifier: RimClassifier, description: str) -> str:
    """Serialise a classifier with four digits."""

    def rounded(values: Array) -> Any:
        return [rounded(v) for v in values] if values.ndim else float(f"{values:.4g}")

    members = [
        {name: rounded(np.asarray(values)) for name, values in vars(item).items()}
        for item in classifier.members
    ]
    lines = [
        f'"made": {json.dumps(description)}',
        f'"trust": {classifier.trust:.4g}',
        f'"first_share": {classifier.first_share:.4g}',
        f'"middle": {json.dumps(rounded(classifier.middle))}',
        f'"spread": {json.dumps(rounded(classifier.spread))}',
        '"members": [\n' + ",\n".join(json.dumps(item) for item in members) + "\n]",
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def train_calibrated(examples: list[Example]) -> RimClassifier:
    """Train the classifier on all examples, with its calibration from cross-validation."""
    held_out: list[tuple[Example, Array]] = []
    for part in range(FOLDS):
        others = train([item for item in examples if item.seed % FOLDS != part])
        held_out += [
            (item, others.decision(item.features).mean(axis=0))
            for item in examples
            if item.seed % FOLDS == part
        ]

    def negative_log_likelihood(trust: float) -> float:
        likelihoods = [
            _probability(
                trust * mean + PRIOR_WEIGHT * np.maximum(item.features[:, FIRST], UNLISTED),
                item.labels,
            )
            for item, mean in held_out
        ]
        return -float(np.log(likelihoods).sum())

    trust = float(minimize_scalar(negative_log_likelihood, bounds=(0.1, 2.0), method="bounded").x)
    return replace(train(examples), trust=trust)


def _probability(odds: Array, labels: NDArray[np.bool_]) -> float:
    """Return the likelihood of the labels, including those without an outline."""
    all_odds = np.append(odds, 0.0)
    weights = np.exp(all_odds - all_odds.max())
    return max(float(weights[np.append(labels, not labels.any())].sum() / weights.sum()), 1e-12)


def train(examples: list[Example]) -> RimClassifier:
    """Train a classifier without calibration."""
    features = np.concatenate([item.features for item in examples])
    middle = np.nan_to_num(np.nanmedian(features, axis=0))
    low, high = np.nanpercentile(features, [10, 90], axis=0)
    spread = np.maximum((high - low) / 2.56, np.maximum(0.3 * np.nanstd(features, axis=0), 1e-3))
    empty = RimClassifier(middle, spread, (), 1.0, PRIOR_WEIGHT)
    scaled = [item._replace(features=empty.scaled(item.features)) for item in examples]
    return replace(empty, members=tuple(_member(scaled, seed) for seed in range(MEMBERS)))


def _member(examples: list[Example], seed: int) -> LogisticMember:
    """Train one member by maximum likelihood: a conditional logit of the candidates and none."""
    rng = np.random.default_rng(seed)
    selected = [item for item in examples if rng.random() > 0.2]
    features = np.concatenate([item.features for item in selected])
    labels = np.concatenate([item.labels for item in selected])
    image_index = np.repeat(np.arange(len(selected)), [len(item.labels) for item in selected])
    no_outline = np.array([not item.labels.any() for item in selected])
    width = features.shape[1]
    shapes = [(width,), (), (width, HIDDEN_UNITS), (HIDDEN_UNITS,), (HIDDEN_UNITS,)]
    sizes = [int(np.prod(shape)) for shape in shapes]
    ends = np.cumsum(sizes)[:-1]

    def parts(parameters: Array) -> list[Array]:
        return [
            part.reshape(shape)
            for part, shape in zip(np.split(parameters, ends), shapes, strict=True)
        ]

    def loss(parameters: Array) -> tuple[float, Array]:
        linear, bias, hidden, shift, out = parts(parameters)
        hidden_values = np.tanh(features @ hidden + shift)
        odds = features @ linear + bias + hidden_values @ out
        top = np.zeros(len(selected))
        np.maximum.at(top, image_index, odds)
        weights, none_weight = np.exp(odds - top[image_index]), np.exp(-top)
        total = none_weight + np.bincount(image_index, weights, len(selected))
        p = weights / total[image_index]
        likelihood = np.maximum(
            np.bincount(image_index, p * labels, len(selected)) + no_outline * none_weight / total,
            1e-12,
        )
        d_odds = p - p * labels / likelihood[image_index]
        d_hidden = d_odds[:, None] * out * (1 - hidden_values**2)
        gradient = [
            features.T @ d_odds,
            [d_odds.sum()],
            (features.T @ d_hidden).ravel(),
            d_hidden.sum(axis=0),
            hidden_values.T @ d_odds,
        ]
        penalised = parameters.copy()
        penalised[width] = 0.0  # no penalty on the bias
        return L2_PENALTY * float(penalised @ penalised) - float(
            np.log(likelihood).sum()
        ), np.concatenate(gradient) + 2 * L2_PENALTY * penalised

    start = np.zeros(sum(sizes))
    start[width + 1 :] = rng.normal(0, INITIAL_SCALE, sum(sizes) - width - 1)
    linear, bias, hidden, shift, out = parts(
        minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": MAX_ITERATIONS}).x
    )
    return LogisticMember(linear, float(bias), hidden, shift, out)
