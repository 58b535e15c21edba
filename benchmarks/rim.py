"""How often the rim of a mirror is found, and how sure that is: pictures made by seed in five ways, some of no mirror.

The weights were learned from composed photographs with seeds below 1000, with `--learn`, which prints them; failures of
the seeds 1000 to 1059 were looked at while the finder was made, those from 5000 on never.

    python benchmarks/rim.py --environments ../shared/data/environments --out out/benchmarks
    python benchmarks/rim.py --environments ../shared/data/environments --learn 240
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mirror_photographs import Photograph, compose, error_of
from mirror_pictures import WAYS, nothing
from scipy.optimize import minimize

import omnimirror as om
from omnimirror.calibrate.rim import SURE
from omnimirror.calibrate.rim.candidates import rings_of
from omnimirror.calibrate.rim.choice import terms
from omnimirror.calibrate.rim.cues import cues_of
from omnimirror.calibrate.rim.edges import at_working_size, edges_of
from omnimirror.files import write_text

FIRST, MIRRORS = 5000, 200
RIGHT = 0.01  # of the radius
NEARLY = 0.015  # at working size, from where it is placed in the full picture
RIDGE = 0.06


class Found(NamedTuple):
    """What became of one photograph."""

    seed: int
    error: float
    confidence: float
    seconds: float
    words: str


def looked_at(seed: int, photograph: Photograph) -> Found:
    """Find the rim of a photograph."""
    begun = time.perf_counter()
    rim = om.find_rim(photograph.picture)
    seconds = time.perf_counter() - begun
    error = np.inf if photograph.rim is None else error_of(rim, photograph.rim)
    return Found(seed, error, rim.confidence, seconds, photograph.words)


def table_of(found: dict[str, list[Found]]) -> str:
    """The table, way by way, and what went wrong."""
    head = ("pictures", "count", "within 1 %", "of these sure", "wrong, but sure", "median error, %", "median seconds")
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for way, every in found.items():
        right = [one for one in every if one.error < RIGHT]
        sure = sum(one.confidence >= SURE for one in right)
        wrong = sum(one.error >= RIGHT and one.confidence >= SURE for one in every)
        error = f"{100 * np.median([one.error for one in right]):.3f}" if right else "-"
        seconds = np.median([one.seconds for one in every])
        lines.append(f"| {way} | {len(every)} | {len(right)} | {sure} | {wrong} | {error} | {seconds:.2f} |")
    told = [
        f"{way} {one.seed}: error {100 * one.error:.1f} %, confidence {one.confidence:.2f} ({one.words})"
        for way, every in found.items() for one in every
        if (one.error >= RIGHT) == (one.confidence >= SURE)
    ]  # fmt: skip
    return "\n".join([*lines, "", *told]) + "\n"


# -- learning ------------------------------------------------------------------------------


def example(photograph: Photograph) -> tuple[np.ndarray, np.ndarray]:
    """The terms (n, t) of the rings of a photograph, and which of them are the rim (n,)."""
    working = at_working_size(photograph.picture)
    found = rings_of(photograph.picture, working, edges_of(working))
    rows = np.array([terms(cues_of(ring, found, min(working.size))) for ring in found])
    if photograph.rim is None:
        return rows, np.zeros(len(found), dtype=bool)
    scaled = [ring.ellipse.scaled(working.scale) for ring in found]
    rims = [om.FoundRim(one.centre, one.semi_axes, one.angle_deg, 1.0, (0, 0)) for one in scaled]
    return rows, np.array([error_of(rim, photograph.rim) < NEARLY for rim in rims])


def learned(examples: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, float]:
    """Weights (t,) and the odds of none: those under which what is right is most probable (a conditional logit)."""
    every = np.concatenate([rows for rows, _ in examples])
    middle, spread = every.mean(axis=0), every.std(axis=0) + 1e-9
    scaled = [((rows - middle) / spread, right) for rows, right in examples]

    def loss(numbers: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = RIDGE * float(numbers[:-1] @ numbers[:-1]), 2 * RIDGE * np.append(numbers[:-1], 0.0)
        for rows, right in scaled:
            odds = np.append(rows @ numbers[:-1], numbers[-1])
            p = np.exp(odds - odds.max())
            p /= p.sum()
            good = p * np.append(right, not right.any())
            total -= np.log(max(good.sum(), 1e-30))
            away = p - good / max(good.sum(), 1e-30)
            slope = slope + np.append(rows.T @ away[:-1], away[-1])
        return total, slope

    numbers = minimize(loss, np.zeros(every.shape[1] + 1), jac=True, method="L-BFGS-B").x
    weights = numbers[:-1] / spread
    return weights, float(numbers[-1] + middle @ weights)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=Path, help="folder of the equirectangular pictures; else own scenes")
    parser.add_argument("--count", type=int, default=MIRRORS, help="pictures of mirrors, of all ways together")
    parser.add_argument("--learn", type=int, help="learn the weights from so many photographs, and a fifth without")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    folder = arguments.environments
    if arguments.learn:
        seen = [example(compose(seed, folder)) for seed in range(arguments.learn)]
        seen += [example(compose(500 + seed, folder, mirror=False)) for seed in range(arguments.learn // 5)]
        weights, none = learned([one for one in seen if len(one[0])])
        print("WEIGHTS =", np.array2string(weights, precision=3, separator=", ", suppress_small=True))
        print(f"NONE = {none:.3f}")
        return
    each = -(-arguments.count // len(WAYS))
    found = {
        way: [looked_at(FIRST + k, make(FIRST + k, folder)) for k in range(each)]
        for way, make in (WAYS | {"no mirror": nothing}).items()
    }
    table = table_of(found)
    write_text(arguments.out / "rim.md", "# The rim in pictures made by seed\n\n" + table)
    print(table)


if __name__ == "__main__":
    main()
