"""Reflection points from the initial values of compiled kernels against those from a guess, and
Alhazen's problem."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.base.native import backend
from omnimirror.optics.mirrors import EvenPolynomial, Sphere
from omnimirror.optics.mirrors.mirror import NO_FORM
from omnimirror.optics.tracing import reflection
from omnimirror.optics.tracing.reflection import (
    MIN_PAIRS,
    MirrorSurface,
    RayEndpoints,
    compiled_reflection_points,
    specular_points,
)
from tests.conftest import MIRRORS
from tests.everyday import few

COUNT = 4 * MIN_PAIRS
EVERY_DAY = "conic-asphere", "cylinder", "sampled", "sphere", "hyperboloid", "even-polynomial"
compiled = pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")


def ends_about(kind: str, distant: bool, telecentric: bool) -> tuple[RayEndpoints, RayEndpoints]:
    """Return a lens off the axis, and targets all around, some of them outside the field."""
    mirror, m = MIRRORS[kind]
    directions = np.random.default_rng(3).normal(size=(COUNT, 3))
    targets = directions if distant else 4 * mirror.rim_radius_mm * directions
    lens = [0.01, -0.02, -1.0] if telecentric else [1.5, -0.8, -m]
    return RayEndpoints.of([lens], telecentric), RayEndpoints.of(targets, distant)


@pytest.mark.parametrize("telecentric", [False, True])
@pytest.mark.parametrize("distant", [False, True])
@pytest.mark.parametrize("kind", few(sorted({*MIRRORS} - {"cone"}), *EVERY_DAY))
def test_solution_independent_of_initial_value(kind, distant, telecentric, monkeypatch):
    mirror = MIRRORS[kind][0]
    pupils, targets = ends_about(kind, distant, telecentric)
    solution = specular_points(mirror, pupils, targets)
    monkeypatch.setattr(reflection, "compiled_reflection_points", lambda *_: None)
    from_guess = specular_points(mirror, pupils, targets)
    assert np.array_equal(solution.valid, from_guess.valid)
    assert solution.valid.sum() > COUNT / 5
    size = mirror.rim_radius_mm
    assert np.abs(solution.points - from_guess.points)[solution.valid].max() < 1e-11 * size
    assert np.abs(solution.path - from_guess.path)[solution.valid].max() < 1e-11 * size


def test_sphere_reflection_of_distant_point():
    """A direction observed from far away along the axis is at half of its angle from the axis."""
    directions = np.random.default_rng(5).normal(size=(COUNT, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ball = Sphere(50.0, 50.0 * np.sin(np.radians(70.0)))
    solution = specular_points(
        ball,
        RayEndpoints.of([[0.0, 0.0, -1.0]], distant=True),
        RayEndpoints.of(directions, distant=True),
    )
    off_axis = np.degrees(np.arcsin(np.hypot(*solution.points[solution.valid, :2].T) / 50.0))
    np.testing.assert_allclose(
        off_axis, np.degrees(np.arccos(-directions[solution.valid, 2])) / 2, rtol=0, atol=1e-9
    )
    assert np.array_equal(solution.valid, -directions[:, 2] > np.cos(np.radians(140.0)))


@compiled
def test_surface_evaluation_count(monkeypatch):
    """The measure is work: points of the exact surface over all steps."""
    point_counts = []

    class EvaluableField(MirrorSurface):
        def __init__(self, mirror, xy, form=NO_FORM):
            point_counts.append(len(xy))
            super().__init__(mirror, xy, form)

    monkeypatch.setattr(reflection, "MirrorSurface", EvaluableField)
    pupils, targets = ends_about("sphere", True, False)
    inside = RayEndpoints(
        targets.xyz[specular_points(MIRRORS["sphere"][0], pupils, targets).valid], True
    )
    point_counts.clear()
    specular_points(MIRRORS["sphere"][0], pupils, inside)
    with_kernels = sum(point_counts)
    point_counts.clear()
    monkeypatch.setattr(reflection, "compiled_reflection_points", lambda *_: None)
    specular_points(MIRRORS["sphere"][0], pupils, inside)
    assert with_kernels <= 3.1 * len(inside.xyz)
    assert with_kernels < 0.6 * sum(point_counts)


@compiled
def test_kernels_not_used_outside_their_scope():
    pupils, targets = ends_about("sphere", True, False)
    pupils = pupils.spread(COUNT)
    sphere = Sphere(50.0, 40.0)
    assert compiled_reflection_points(sphere, NO_FORM, pupils, targets) is not None
    below_minimum = slice(0, MIN_PAIRS - 1)
    assert (
        compiled_reflection_points(sphere, NO_FORM, pupils[below_minimum], targets[below_minimum])
        is None
    )
    moving = RayEndpoints(pupils.xyz + np.linspace(0, 1, COUNT)[:, None])
    assert compiled_reflection_points(sphere, NO_FORM, moving, targets) is None
    assert compiled_reflection_points(MIRRORS["cone"][0], NO_FORM, pupils, targets) is None
    hollow = EvenPolynomial((0.6, -0.3), 40.0, 40.0)
    assert compiled_reflection_points(hollow, NO_FORM, pupils, targets) is None
