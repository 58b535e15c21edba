"""Mirror tables and compiled kernels of differentiable cameras, without PyTorch."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.base.native import backend
from omnimirror.calibration.sensor_parameters import (
    parameter_location,
    profile_derivatives,
    shape_names,
)
from omnimirror.interop.torch import _factory, _library, differentiable
from omnimirror.interop.torch._reflection import TOLERANCE
from omnimirror.interop.torch._tables import shape_derivative_table
from omnimirror.optics.tracing.reflection import (
    CELLS,
    NOT_CONVERGED,
    SEARCH,
    SETTLED,
    VISIBLE,
    MirrorTables,
    RayEndpoints,
    meridian_table,
    specular_points,
)
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few
from tests.samplers import instructions


def at(table, position):
    cell = np.clip(position.astype(int), 0, len(table) - 1)
    t = position - cell
    return [sum(table[cell, k + i] * t**i for i in range(4)) for k in (0, 4)]


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_meridian_table_interpolates_sag_and_slope(kind):
    mirror = MIRRORS[kind][0]
    x = np.random.default_rng(1).uniform(0.01, 1.0, 2000) * mirror.rim_radius_mm
    sag, slope = at(meridian_table(mirror), x / mirror.rim_radius_mm * CELLS)
    np.testing.assert_allclose(
        sag, mirror.sag(x), rtol=0, atol=1e-9
    )  # at spline knots; 1e-12 elsewhere
    np.testing.assert_allclose(slope, mirror.slope(x), rtol=0, atol=2e-9)


@pytest.mark.parametrize("kind", ["hyperboloid", "even-polynomial", "slope-spline", "equidistant"])
def test_shape_derivative_table_interpolates_derivatives(kind):
    sensor = sensor_of(kind)
    location = parameter_location(sensor, list(shape_names(sensor))[-1])
    x = np.linspace(0.3, sensor.mirror.rim_radius_mm, 777)
    sag, slope = at(
        shape_derivative_table(sensor.mirror, location), x / sensor.mirror.rim_radius_mm * CELLS
    )
    truth = profile_derivatives(sensor.mirror, x, (location,))[..., 0]
    for value, expected in zip((sag, slope), truth, strict=False):
        np.testing.assert_allclose(
            value, expected, rtol=0, atol=1e-5 * np.abs(expected).max()
        )  # at spline knots


@pytest.fixture(params=[name for name in instructions() if name in ("plain", "avx2")])
def kernels(request):
    before = backend.name
    backend.kernels.set_instruction_set(request.param)
    yield backend.kernels
    backend.kernels.set_instruction_set(before)


PUPIL = (4.0, -2.5)  # mm from the axis


def find_reflections(kernels, tables, telecentric, distant, targets):
    """Run the kernel for targets (n, 3); return pupil, results and states."""
    rows, states = np.full((8, len(targets)), np.nan), np.zeros(len(targets), np.uint8)
    pupil = (0.02, -0.01, -np.sqrt(1 - 5e-4)) if telecentric else (*PUPIL, -180.0)
    surface, search, columns = (
        tables.surface(pupil, telecentric),
        SEARCH.until(SETTLED, 0.03),
        targets.T.copy(),
    )
    kernels.find_reflections(
        surface,
        search,
        tables.by_omega,
        tables.omegas,
        tables.middle_mm,
        distant,
        columns,
        rows,
        states,
    )
    return np.array(pupil), rows, states


@pytest.mark.parametrize("distant", [False, True], ids=["near", "distant"])
@pytest.mark.parametrize(
    ("kind", "lens"),
    few(
        [
            (k, n)
            for k in sorted(MIRRORS)
            for n in ("perspective", "telecentric")
            if (k, n) != ("cone", "telecentric")
        ],
        ("cone", "perspective"),
        ("conic-asphere", "telecentric"),
        ("equidistant", "perspective"),
        ("sampled", "perspective"),
    ),
)  # a telecentric lens images a cone at one field angle
def test_kernel_finds_the_verified_reflection_points(kind, lens, distant, kernels):
    """Targets in all directions, some of them not visible; the last block is partial."""
    mirror, telecentric = MIRRORS[kind][0], lens == "telecentric"
    directions = np.random.default_rng(3).normal(size=(203, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    targets = (
        directions
        if distant
        else directions * np.random.default_rng(4).uniform(300, 5000, (203, 1))
    )
    tables = MirrorTables.of(mirror, np.inf if telecentric else 180.0)
    pupil, rows, states = find_reflections(kernels, tables, telecentric, distant, targets)
    expected = specular_points(
        mirror, RayEndpoints.of(pupil, telecentric), RayEndpoints.of(targets, distant)
    )
    settled = states != NOT_CONVERGED
    assert settled[expected.valid].mean() > 0.95
    np.testing.assert_array_equal((states == VISIBLE)[settled], expected.valid[settled])
    visible = states == VISIBLE
    assert visible.sum() > 10
    np.testing.assert_allclose(rows[:3, visible].T, expected.points[visible], rtol=0, atol=1e-7)
    slope = mirror.slope(np.hypot(*rows[:2, visible]))
    np.testing.assert_allclose(np.hypot(*rows[3:5, visible]), np.abs(slope), rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_kernel_intersects_rays_with_the_mirror(kind, kernels):
    mirror = MIRRORS[kind][0]
    tables = MirrorTables.of(mirror, 180.0)
    at = np.random.default_rng(5).uniform(-1, 1, (2, 333)) * mirror.rim_radius_mm
    radius = np.hypot(*at)
    on = radius <= mirror.rim_radius_mm
    points = np.array([*at, mirror.sag(np.where(on, radius, 0.0))])
    pupil = np.array([*PUPIL, -180.0])
    directions = (points - pupil[:, None]) / (points[2] + 180.0)
    rows, states = np.zeros((6, 333)), np.zeros(333, np.uint8)
    kernels.intersect_mirror(
        tables.surface(tuple(pupil), False),
        SEARCH.until(TOLERANCE),
        tables.depth,
        tables.max_tangent,
        directions,
        rows,
        states,
    )
    assert (states == VISIBLE)[on].all()
    np.testing.assert_allclose(rows[:3, on], points[:, on], rtol=0, atol=1e-7)
    np.testing.assert_allclose(rows[5, on], points[2, on] + 180.0, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"targets": np.zeros((2, 9))}, r"targets must have shape \(3, any\); got \(2, 9\)"),
        ({"rows": np.zeros((8, 8))}, r"rows must have shape \(8, 9\); got \(8, 8\)"),
        ({"rows": np.zeros((7, 9))}, r"rows must have shape \(8, 9\)"),
        ({"states": np.zeros(8, np.uint8)}, r"states must have shape \(9,\); got \(8,\)"),
        ({"by_omega": np.zeros((0, 4))}, "by_omega must not be empty"),
        ({"by_omega": np.zeros((9, 3))}, r"by_omega must have shape \(any, 4\)"),
        ({"omegas": (1.0, 0.9)}, "omegas must be in ascending order"),
    ],
)
def test_kernel_rejects_arrays_of_wrong_shape(change, message, kernels):
    tables = MirrorTables.of(MIRRORS["sphere"][0], 180.0)
    arguments = {
        "surface": tables.surface((0.0, 0.0, -180.0), False),
        "search": SEARCH.until(SETTLED),
        "distant": False,
        "by_omega": tables.by_omega,
        "omegas": tables.omegas,
        "middle": tables.middle_mm,
        "targets": np.ones((3, 9)),
        "rows": np.zeros((8, 9)),
        "states": np.zeros(9, np.uint8),
        **change,
    }
    with pytest.raises(ValueError, match=message):
        kernels.find_reflections(**arguments)


def test_non_finite_targets_are_not_settled(kernels):
    tables = MirrorTables.of(MIRRORS["sphere"][0], 180.0)
    targets = np.array([[np.nan, 1.0, 2.0], [np.inf, 0.0, 0.0], [500.0, 0.0, -100.0]])
    _, rows, states = find_reflections(kernels, tables, False, False, targets)
    assert states.tolist()[:2] == [NOT_CONVERGED] * 2
    assert states[2] == VISIBLE
    assert np.isfinite(rows[:, 2]).all()


def test_missing_pytorch_raises_with_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(_factory, "torch", type(_library.torch)())
    with pytest.raises(OmnimirrorError, match=r"requires PyTorch.*pip install '\.\[torch\]'"):
        differentiable(om.load_sensor("paper-spherical"))


def test_free_parameters_require_a_sensor():
    camera = om.Unified(xi=0.9, focal_px=(30.0, 30.0), centre_px=(31.5, 23.5), image_size=(64, 48))
    with pytest.raises(
        InvalidParameter, match=r"free must be empty unless camera is a sensor; .* for a Unified"
    ):
        differentiable(camera, "focal")
    with pytest.raises(InvalidParameter, match=r"free must contain groups .*; got 'radius'"):
        differentiable(om.load_sensor("paper-spherical"), "radius")
