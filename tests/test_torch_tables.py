"""Tables of mirrors, without PyTorch: their cubic pieces are the mirror and its derivatives."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibrate.physical.names import place_of, shape_names
from omnimirror.calibrate.physical.shape_rates import profile_rates
from omnimirror.errors import InvalidParameter, OmnimirrorError
from omnimirror.torch import differentiable
from omnimirror.torch.pieces import CELLS, meridian_table, rate_table
from tests.conftest import MIRRORS, sensor_of


def at(table, position):
    cell = np.clip(position.astype(int), 0, table.shape[1] - 1)
    t = position - cell
    return [sum(table[k + i, cell] * t**i for i in range(4)) for k in (0, 4)]


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_between_its_nodes_a_table_is_the_mirror(kind):
    mirror = MIRRORS[kind][0]
    x = np.random.default_rng(1).uniform(0.01, 1.0, 2000) * mirror.rim_radius_mm
    sag, slope = at(meridian_table(mirror), x / mirror.rim_radius_mm * CELLS)
    np.testing.assert_allclose(sag, mirror.sag(x), rtol=0, atol=1e-9)  # across knots of a spline; 1e-12 of others
    np.testing.assert_allclose(slope, mirror.slope(x), rtol=0, atol=2e-9)


@pytest.mark.parametrize("kind", ["hyperboloid", "even-polynomial", "slope-spline", "equidistant"])
def test_so_are_its_derivatives_by_a_parameter(kind):
    sensor = sensor_of(kind)
    place = place_of(sensor, list(shape_names(sensor))[-1])
    x = np.linspace(0.3, sensor.mirror.rim_radius_mm, 777)
    sag, slope = at(rate_table(sensor.mirror, place), x / sensor.mirror.rim_radius_mm * CELLS)
    truth = profile_rates(sensor.mirror, x, (place,))[..., 0]
    for found, right in zip((sag, slope), truth, strict=False):
        np.testing.assert_allclose(found, right, rtol=0, atol=1e-5 * np.abs(right).max())  # at a spline's knots


def test_without_pytorch_one_is_told_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr("omnimirror.torch.differentiable_camera.torch", type(_library())())
    with pytest.raises(OmnimirrorError, match=r"need PyTorch.*pip install 'omnimirror\[torch\]'"):
        differentiable(om.load_sensor("paper-spherical"))


def test_only_sensors_have_free_parameters():
    camera = om.Unified(0.9, (30.0, 30.0), (31.5, 23.5), (64, 48))
    with pytest.raises(InvalidParameter, match="a Unified is taken as it is"):
        differentiable(camera, "focal", dtype=float)
    with pytest.raises(InvalidParameter, match="is no parameter"):
        differentiable(replace(om.load_sensor("paper-spherical")), "radius", dtype=float)


def _library():
    from omnimirror.torch.library import torch

    return torch
