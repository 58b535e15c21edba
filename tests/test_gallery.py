"""The gallery's programs run as they stand, each writes the picture that it is named after, and the page shows them."""

from __future__ import annotations

import runpy
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from omnimirror.media import read_image

ROOT = Path(__file__).parents[1]
GALLERY = runpy.run_path(str(ROOT / "docs" / "gallery.py"))
EXAMPLES = GALLERY["examples"]()
LONG = (
    "a_lens_wide_open", "apertures", "calibrated_by_boards", "camera_and_rod", "depth_of_field", "folded_in_half",
    "little_planet", "restored", "rim_of_a_mirror", "spot_diagrams", "trade_offs", "yield_before_and_after",
)  # fmt: skip
"""Take a second or more each, and are run by ``make test-full``."""


@pytest.mark.parametrize(
    "example",
    [pytest.param(path, id=path.stem, marks=[pytest.mark.full] * (path.stem in LONG)) for path in EXAMPLES],
)
def test_an_example_writes_the_picture_it_is_named_after(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    runpy.run_path(str(example), run_name="__main__")
    plt.close("all")
    drawn = read_image(tmp_path / f"{example.stem}.png")[..., :3]
    shown = read_image(ROOT / "docs" / "images" / "gallery" / f"{example.stem}.webp")[..., :3]
    assert aspect(drawn) == pytest.approx(aspect(shown), rel=0.02), (
        "python docs/gallery.py makes the page's pictures anew"
    )
    assert np.abs(mean_colour(drawn) - mean_colour(shown)).max() < 8, "python docs/gallery.py makes them anew"


def aspect(picture: np.ndarray) -> float:
    return picture.shape[1] / picture.shape[0]


def mean_colour(picture: np.ndarray) -> np.ndarray:
    return picture.reshape(-1, 3).mean(axis=0)


def test_the_page_shows_every_example_as_it_stands():
    assert (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8") == GALLERY["page"](), "python docs/gallery.py"


def test_there_are_two_dozen_examples_and_each_is_short():
    assert len(EXAMPLES) >= 24
    assert {path.stem for path in EXAMPLES}.issuperset(LONG)
    long = [path.stem for path in EXAMPLES if len(path.read_text(encoding="utf-8").splitlines()) >= 30]
    assert not long
