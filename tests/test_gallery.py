"""Run the programs of the gallery and compare their images with those of the documentation."""

from __future__ import annotations

import runpy
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from omnimirror.io import read_image

ROOT = Path(__file__).parents[1]
GALLERY = runpy.run_path(str(ROOT / "docs" / "gallery.py"))
EXAMPLES = GALLERY["examples"]()
LONG = {
    "aperture_and_blur",
    "calibration_residuals",
    "depth_of_field",
    "drawing_of_a_folded_sensor",
    "little_planet",
    "manufacturing_yield",
    "mirror_outline",
    "obscurations",
    "optimal_aperture",
    "pareto_front",
    "restoration",
    "spot_diagrams",
}
"""Examples that take more than 1 s and run in ``make test-full``."""


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.full] * (path.stem in LONG))
        for path in EXAMPLES
    ],
)
def test_example_writes_its_image(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    runpy.run_path(str(example), run_name="__main__")
    plt.close("all")
    image = read_image(tmp_path / f"{example.stem}.png")[..., :3]
    expected = read_image(ROOT / "docs" / "images" / "gallery" / f"{example.stem}.webp")[..., :3]
    assert aspect(image) == pytest.approx(aspect(expected), rel=0.02), (
        "update the images with python docs/gallery.py"
    )
    assert np.abs(mean_colour(image) - mean_colour(expected)).max() < 8, (
        "update the images with python docs/gallery.py"
    )


def aspect(image: np.ndarray) -> float:
    return image.shape[1] / image.shape[0]


def mean_colour(image: np.ndarray) -> np.ndarray:
    return image.reshape(-1, 3).mean(axis=0)


def test_page_is_up_to_date():
    assert (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8") == GALLERY["page"](), (
        "run python docs/gallery.py"
    )


def test_examples_are_short():
    assert len(EXAMPLES) >= 24
    assert {path.stem for path in EXAMPLES} >= LONG
    long = [
        path.stem for path in EXAMPLES if len(path.read_text(encoding="utf-8").splitlines()) >= 30
    ]
    assert not long
