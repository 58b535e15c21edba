"""Measure the detection rate and the confidence of mirror outlines in generated images, some without a mirror.

The classifier was trained with seeds below 1000 (``outline_classifier_training.py``, `--train`).
Failures of these seeds and of the seeds 1000 to 1059, 5000 to 5199 and 7000 to 7199 were inspected
during development. The reported seeds from 9100, 12000 and 20000 were evaluated once, after
development.

    python benchmarks/outline_detection.py --environments ENVIRONMENTS --generators composite -o out/benchmarks
    python benchmarks/outline_detection.py --environments ENVIRONMENTS --first-seed 5000 -o out/benchmarks
    python benchmarks/outline_detection.py --environments ENVIRONMENTS --train 260 --jobs 2
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mirror_composites import LabelledImage, outline_error
from mirror_renderings import GENERATORS, without_mirror
from mirror_surroundings import SURROUNDINGS, rings
from outline_classifier_training import train_and_serialise

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.calibration.rim import MIN_CONFIDENCE
from omnimirror.calibration.rim._classifier import CLASSIFIER_FILE

FIRST_SEED, IMAGE_COUNT = 9100, 200
MAX_ERROR = 0.01  # relative to the radius
NO_MIRROR = {"no mirror": without_mirror, "rings": rings}


class DetectionResult(NamedTuple):
    """Result for one photograph."""

    seed: int
    error: float
    confidence: float
    seconds: float
    description: str


def detect_outline(seed: int, labelled: LabelledImage) -> DetectionResult:
    """Detect the mirror outline in a photograph."""
    start = time.perf_counter()
    rim = om.detect_mirror_outline(labelled.image)
    seconds = time.perf_counter() - start
    error = np.inf if labelled.rim is None else outline_error(rim, labelled.rim)
    return DetectionResult(seed, error, rim.confidence, seconds, labelled.description)


def table_of(results: dict[str, list[DetectionResult]]) -> str:
    """Return the table by generator, and the failures."""
    header = (
        "generator",
        "images",
        "within 1 %",
        "of these accepted",
        "incorrect and accepted",
        "median error, %",
        "median time, s",
    )
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    for generator, every in results.items():
        correct = [result for result in every if result.error < MAX_ERROR]
        accepted = sum(result.confidence >= MIN_CONFIDENCE for result in correct)
        false_accepted = sum(
            result.error >= MAX_ERROR and result.confidence >= MIN_CONFIDENCE for result in every
        )
        error = f"{100 * np.median([result.error for result in correct]):.3f}" if correct else "-"
        seconds = np.median([result.seconds for result in every])
        lines.append(
            f"| {generator} | {len(every)} | {len(correct)} | {accepted} | {false_accepted} | {error} | {seconds:.2f} |"
        )
    failures = [
        f"{generator} {result.seed}: error {100 * result.error:.1f} "
        f"%, confidence {result.confidence:.2f} ({result.description})"
        for generator, every in results.items()
        for result in every
        if (result.error >= MAX_ERROR) == (result.confidence >= MIN_CONFIDENCE)
    ]
    return "\n".join([*lines, "", *failures]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=Path, help="folder of equirectangular images")
    parser.add_argument(
        "--count", type=int, default=IMAGE_COUNT, help="total number of mirror images"
    )
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--generators", help="comma-separated generators; all by default")
    parser.add_argument("--train", type=int, help="train the classifier on N seeds and save it")
    parser.add_argument("--jobs", type=int, default=1, help="number of training processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    folder = arguments.environments
    every = GENERATORS | SURROUNDINGS | NO_MIRROR
    if arguments.train:
        write_text(
            CLASSIFIER_FILE,
            train_and_serialise(every, folder, range(arguments.train), arguments.jobs),
        )
        return
    selected = {
        generator: every[generator]
        for generator in (arguments.generators.split(",") if arguments.generators else every)
    }
    seeds_per_generator = -(
        -arguments.count // sum(generator not in NO_MIRROR for generator in selected)
    )
    seeds = range(arguments.first_seed, arguments.first_seed + seeds_per_generator)
    results = {
        generator: [detect_outline(seed, make(seed, folder)) for seed in seeds]
        for generator, make in selected.items()
    }
    table = table_of(results)
    write_text(arguments.output / "rim.md", "# Outline detection in generated images\n\n" + table)
    print(table)


if __name__ == "__main__":
    main()
