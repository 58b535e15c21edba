"""Figures of the whole aperture against the analysis."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis.figures import render
from omnimirror.analysis.figures.aperture import (
    encircled_energy,
    illumination_curves,
    mtf_curves,
    psf_images,
    spot_matrix,
)

SPH = om.load_sensor("paper-spherical")


def line(figure, gid):
    (found,) = [a for ax in figure.axes for a in ax.get_lines() if a.get_gid() == gid]
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


@pytest.mark.parametrize(
    "focuses", [[212.0], pytest.param([205.0, 212.0, 219.0], marks=pytest.mark.full)]
)
def test_spot_figure_matches_rays(focuses):
    found = om.spots(SPH, [0.0, 90.0, 135.0], focus_mm=focuses)
    figure = spot_matrix(found, 1.1)
    assert len(figure.axes) == 3 * len(focuses)
    t, s = line(figure, "spot:1:0")
    assert np.ptp(t) == pytest.approx(found.extent_px()[0][1, 0])
    assert np.ptp(s) == pytest.approx(found.extent_px()[1][1, 0])
    cut, _ = line(figure, "spot:2:0")
    assert len(cut) < len(t)
    limits = {ax.get_xlim() for ax in figure.axes}
    assert len(limits) == 1  # one scale
    assert figure.axes[0].get_ylim()[0] > 0  # rows increase downwards, as in the image
    render(figure)


def test_mtf_figure_matches_mtf():
    found = om.mtf(SPH, [0.0, 100.0])
    figure = mtf_curves(found)
    for way, values in (("t", found.tangential), ("s", found.sagittal)):
        nu, mtf = line(figure, f"mtf_{way}:100")
        np.testing.assert_array_equal(mtf, values[1])
        np.testing.assert_array_equal(nu, found.cycles_per_px)
    render(figure)


def test_psf_figure_orientation():
    """The spot at 120 deg is taller than wide, and coma of a fast lens extends along one axis only."""
    found = [om.psf(SPH, 120.0, step_px=0.5)]
    figure = psf_images(found)
    (image,) = figure.axes[0].get_images()
    spread = [
        np.sqrt((found[0].density.sum(axis=a) @ found[0].offset_px ** 2) / found[0].density.sum())
        for a in (0, 1)
    ]
    assert spread[1] > 2 * spread[0]
    left, right, bottom, top = image.get_extent()
    assert right > 0 > left
    assert bottom > 0 > top
    render(figure)
    radius, energy = line(encircled_energy(found), "energy:120")
    np.testing.assert_allclose(energy, found[0].encircled_energy(radius))


def test_illumination_figure_matches_illumination():
    found = om.illumination(SPH, [0.0, 60.0, 120.0])
    figure = illumination_curves([("SPH", found)])
    np.testing.assert_array_equal(line(figure, "SPH:relative")[1], found.relative)
    render(figure)
