"""Tables of mirrors, without PyTorch: their cubic pieces are the mirror and its derivatives; kernels that use them."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibrate.physical.names import place_of, shape_names
from omnimirror.calibrate.physical.shape_rates import profile_rates
from omnimirror.errors import InvalidParameter, OmnimirrorError
from omnimirror.interop.torch import differentiable, differentiable_camera
from omnimirror.interop.torch.pieces import rate_table
from omnimirror.interop.torch.reflection import CLOSE
from omnimirror.native import backend
from omnimirror.tracing.reflection import CELLS, Ends, MirrorTables, meridian_table, specular_points
from omnimirror.tracing.reflection.beginning import NOT_SETTLED, SEARCH, SEEN, SETTLED
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few
from tests.samplers import instructions


def at(table, position):
    cell = np.clip(position.astype(int), 0, len(table) - 1)
    t = position - cell
    return [sum(table[cell, k + i] * t**i for i in range(4)) for k in (0, 4)]


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


@pytest.fixture(params=[name for name in instructions() if name in ("plain", "avx2")])
def kernels(request):
    before = backend.name
    backend.kernels.use_instructions(request.param)
    yield backend.kernels
    backend.kernels.use_instructions(before)


PUPIL = (4.0, -2.5)  # mm beside the axis


def looked_for(kernels, tables, telecentric, distant, targets):
    """What kernels find of targets (n, 3), and how."""
    rows, states = np.full((8, len(targets)), np.nan), np.zeros(len(targets), np.uint8)
    pupil = (0.02, -0.01, -np.sqrt(1 - 5e-4)) if telecentric else (*PUPIL, -180.0)
    surface, search, columns = tables.surface(pupil, telecentric), SEARCH.until(SETTLED, 0.03), targets.T.copy()
    kernels.find_reflections(
        surface, search, tables.by_omega, tables.omegas, tables.middle_mm, distant, columns, rows, states
    )
    return np.array(pupil), rows, states


@pytest.mark.parametrize("distant", [False, True], ids=["near", "distant"])
@pytest.mark.parametrize(
    ("kind", "lens"),
    few(
        [(k, n) for k in sorted(MIRRORS) for n in ("perspective", "telecentric") if (k, n) != ("cone", "telecentric")],
        ("cone", "perspective"),
        ("conic-asphere", "telecentric"),
        ("equidistant", "perspective"),
        ("sampled", "perspective"),
    ),
)  # which sees one field angle
def test_kernels_find_the_reflection_points_that_numpy_proves(kind, lens, distant, kernels):
    """In blocks of which the last is not full, with targets all around, some of them out of sight."""
    mirror, telecentric = MIRRORS[kind][0], lens == "telecentric"
    towards = np.random.default_rng(3).normal(size=(203, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    targets = towards if distant else towards * np.random.default_rng(4).uniform(300, 5000, (203, 1))
    tables = MirrorTables.of(mirror, np.inf if telecentric else 180.0)
    pupil, rows, states = looked_for(kernels, tables, telecentric, distant, targets)
    right = specular_points(mirror, Ends.of(pupil, telecentric), Ends.of(targets, distant))
    settled = states != NOT_SETTLED
    assert settled[right.valid].mean() > 0.95
    np.testing.assert_array_equal((states == SEEN)[settled], right.valid[settled])
    seen = states == SEEN
    assert seen.sum() > 10
    np.testing.assert_allclose(rows[:3, seen].T, right.points[seen], rtol=0, atol=1e-7)
    slope = mirror.slope(np.hypot(*rows[:2, seen]))
    np.testing.assert_allclose(np.hypot(*rows[3:5, seen]), np.abs(slope), rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_kernels_meet_the_mirror_where_its_formula_says(kind, kernels):
    mirror = MIRRORS[kind][0]
    tables = MirrorTables.of(mirror, 180.0)
    at = np.random.default_rng(5).uniform(-1, 1, (2, 333)) * mirror.rim_radius_mm
    radius = np.hypot(*at)
    on = radius <= mirror.rim_radius_mm
    points = np.array([*at, mirror.sag(np.where(on, radius, 0.0))])
    pupil = np.array([*PUPIL, -180.0])
    ways = (points - pupil[:, None]) / (points[2] + 180.0)
    rows, states = np.zeros((6, 333)), np.zeros(333, np.uint8)
    kernels.meet_mirror(
        tables.surface(tuple(pupil), False), SEARCH.until(CLOSE), tables.depth, tables.most_tangent, ways, rows, states
    )
    assert (states == SEEN)[on].all()
    np.testing.assert_allclose(rows[:3, on], points[:, on], rtol=0, atol=1e-7)
    np.testing.assert_allclose(rows[5, on], points[2, on] + 180.0, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"targets": np.zeros((2, 9))}, r"targets must have shape \(3, any\); got \(2, 9\)"),
        ({"rows": np.zeros((8, 8))}, r"rows must have shape \(8, 9\); got \(8, 8\)"),
        ({"rows": np.zeros((7, 9))}, r"rows must have shape \(8, 9\)"),
        ({"states": np.zeros(8, np.uint8)}, r"states must have shape \(9,\); got \(8,\)"),
        ({"by_omega": np.zeros((0, 4))}, "by_omega must not be empty"),
        ({"by_omega": np.zeros((9, 3))}, r"by_omega must have shape \(any, 4\)"),
        ({"omegas": (1.0, 0.9)}, "omegas must not decrease"),
    ],
)
def test_kernels_refuse_what_would_leave_memory(change, says, kernels):
    tables = MirrorTables.of(MIRRORS["sphere"][0], 180.0)
    arguments = {
        "surface": tables.surface((0.0, 0.0, -180.0), False), "search": SEARCH.until(SETTLED), "distant": False,
        "by_omega": tables.by_omega, "omegas": tables.omegas, "middle": tables.middle_mm,
        "targets": np.ones((3, 9)), "rows": np.zeros((8, 9)), "states": np.zeros(9, np.uint8), **change,
    }  # fmt: skip
    with pytest.raises(ValueError, match=says):
        kernels.find_reflections(**arguments)


def test_what_is_no_number_is_not_settled(kernels):
    tables = MirrorTables.of(MIRRORS["sphere"][0], 180.0)
    targets = np.array([[np.nan, 1.0, 2.0], [np.inf, 0.0, 0.0], [500.0, 0.0, -100.0]])
    _, rows, states = looked_for(kernels, tables, False, False, targets)
    assert states.tolist()[:2] == [NOT_SETTLED] * 2
    assert states[2] == SEEN
    assert np.isfinite(rows[:, 2]).all()


def test_without_pytorch_one_is_told_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(differentiable_camera, "torch", type(_library())())
    with pytest.raises(OmnimirrorError, match=r"need PyTorch.*pip install 'omnimirror\[torch\]'"):
        differentiable(om.load_sensor("paper-spherical"))


def test_only_sensors_have_free_parameters():
    camera = om.Unified(0.9, (30.0, 30.0), (31.5, 23.5), (64, 48))
    with pytest.raises(InvalidParameter, match="a Unified is taken as it is"):
        differentiable(camera, "focal")
    with pytest.raises(InvalidParameter, match="is no parameter"):
        differentiable(om.load_sensor("paper-spherical"), "radius")


def _library():
    from omnimirror.interop.torch.library import torch

    return torch
