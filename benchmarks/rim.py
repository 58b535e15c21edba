"""Measure the detection rate and the confidence of mirror outlines in generated images, some without a mirror.

The classifier was trained with seeds below 1000 (``rim_learning.py``, `--learn`). Failures of these seeds and of the
seeds 1000 to 1059, 5000 to 5199 and 7000 to 7199 were inspected during development. The reported seeds from 9100, 12000
and 20000 were evaluated once, after development.

    python benchmarks/rim.py --environments ../shared/data/environments --ways composed --out out/benchmarks
    python benchmarks/rim.py --environments ../shared/data/environments --first 5000 --out out/benchmarks
    python benchmarks/rim.py --environments ../shared/data/environments --learn 260 --jobs 2
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mirror_photographs import Photograph, error_of
from mirror_pictures import WAYS, nothing
from mirror_surroundings import SURROUNDINGS, rings
from rim_learning import learned

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.calibration.rim import MIN_CONFIDENCE
from omnimirror.calibration.rim._classifier import CLASSIFIER_FILE

FIRST, MIRRORS = 9100, 200
RIGHT = 0.01  # relative to the radius
MIRRORLESS = {"no mirror": nothing, "rings": rings}


class Found(NamedTuple):
    """Result for one photograph."""

    seed: int
    error: float
    confidence: float
    seconds: float
    words: str


def looked_at(seed: int, photograph: Photograph) -> Found:
    """Detect the mirror outline in a photograph."""
    begun = time.perf_counter()
    rim = om.detect_mirror_outline(photograph.image)
    seconds = time.perf_counter() - begun
    error = np.inf if photograph.rim is None else error_of(rim, photograph.rim)
    return Found(seed, error, rim.confidence, seconds, photograph.words)


def table_of(found: dict[str, list[Found]]) -> str:
    """Return the table by generator, and the failures."""
    head = (
        "pictures",
        "count",
        "within 1 %",
        "of these sure",
        "wrong, but sure",
        "median error, %",
        "median seconds",
    )
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for way, every in found.items():
        right = [one for one in every if one.error < RIGHT]
        sure = sum(one.confidence >= MIN_CONFIDENCE for one in right)
        wrong = sum(one.error >= RIGHT and one.confidence >= MIN_CONFIDENCE for one in every)
        error = f"{100 * np.median([one.error for one in right]):.3f}" if right else "-"
        seconds = np.median([one.seconds for one in every])
        lines.append(
            f"| {way} | {len(every)} | {len(right)} | {sure} | {wrong} | {error} | {seconds:.2f} |"
        )
    told = [
        f"{way} {one.seed}: error {100 * one.error:.1f} %, confidence {one.confidence:.2f} ({one.words})"
        for way, every in found.items()
        for one in every
        if (one.error >= RIGHT) == (one.confidence >= MIN_CONFIDENCE)
    ]
    return "\n".join([*lines, "", *told]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=Path, help="folder of equirectangular images")
    parser.add_argument("--count", type=int, default=MIRRORS, help="total number of mirror images")
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--ways", help="comma-separated generators; all by default")
    parser.add_argument("--learn", type=int, help="train the classifier on N seeds and save it")
    parser.add_argument("--jobs", type=int, default=1, help="number of training processes")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    folder = arguments.environments
    every = WAYS | SURROUNDINGS | MIRRORLESS
    if arguments.learn:
        write_text(CLASSIFIER_FILE, learned(every, folder, range(arguments.learn), arguments.jobs))
        return
    chosen = {way: every[way] for way in (arguments.ways.split(",") if arguments.ways else every)}
    each = -(-arguments.count // sum(way not in MIRRORLESS for way in chosen))
    seeds = range(arguments.first, arguments.first + each)
    found = {
        way: [looked_at(seed, make(seed, folder)) for seed in seeds] for way, make in chosen.items()
    }
    table = table_of(found)
    write_text(arguments.out / "rim.md", "# The rim in pictures made by seed\n\n" + table)
    print(table)


if __name__ == "__main__":
    main()
