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
    (curve,) = [a for ax in figure.axes for a in ax.get_lines() if a.get_gid() == gid]
    return np.asarray(curve.get_xdata(), float), np.asarray(curve.get_ydata(), float)


@pytest.mark.parametrize(
    "focuses", [[212.0], pytest.param([205.0, 212.0, 219.0], marks=pytest.mark.full)]
)
def test_spot_figure_matches_rays(focuses):
    result = om.spots(SPH, [0.0, 90.0, 135.0], focus_mm=focuses)
    figure = spot_matrix(result)
    assert len(figure.axes) == 3 * len(focuses)
    t, s = line(figure, "spot:1:0")
    assert np.ptp(t) == pytest.approx(result.extent_px()[0][1, 0])
    assert np.ptp(s) == pytest.approx(result.extent_px()[1][1, 0])
    markers, _ = line(figure, "spot:2:0")
    assert len(markers) < len(t)
    limits = {ax.get_xlim() for ax in figure.axes}
    assert len(limits) == 1  # one scale
    assert figure.axes[0].get_ylim()[0] > 0  # rows increase downwards, as in the image
    render(figure)


def test_mtf_figure_matches_mtf():
    result = om.mtf(SPH, [0.0, 100.0])
    figure = mtf_curves(result)
    for orientation, values in (("t", result.tangential), ("s", result.sagittal)):
        nu, mtf = line(figure, f"mtf_{orientation}:100")
        np.testing.assert_array_equal(mtf, values[1])
        np.testing.assert_array_equal(nu, result.cycles_per_px)
    render(figure)


def test_psf_figure_orientation():
    """The spot at 120 deg is taller than wide, and coma of a fast lens extends along one axis only."""
    responses = [om.psf(SPH, 120.0, step_px=0.5)]
    figure = psf_images(responses)
    (image,) = figure.axes[0].get_images()
    spread = [
        np.sqrt(
            (responses[0].density.sum(axis=a) @ responses[0].offset_px ** 2)
            / responses[0].density.sum()
        )
        for a in (0, 1)
    ]
    assert spread[1] > 2 * spread[0]
    left, right, bottom, top = image.get_extent()
    assert right > 0 > left
    assert bottom > 0 > top
    render(figure)
    radius, energy = line(encircled_energy(responses), "energy:120")
    np.testing.assert_allclose(energy, responses[0].encircled_energy(radius))


def test_illumination_figure_matches_illumination():
    result = om.illumination(SPH, [0.0, 60.0, 120.0])
    figure = illumination_curves([("SPH", result)])
    np.testing.assert_array_equal(line(figure, "SPH:relative")[1], result.relative)
    render(figure)
