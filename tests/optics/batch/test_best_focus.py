"""Best focus of random floored areas with several valleys, against dense sampling."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.optics.batch.best_focus import AreaModel, IdealAreas, best_vergences

COUNT, ANGLES = 150, 6
INVERSE_F = 0.1


def areas_with(mode: str, bounds: tuple[float, float]) -> IdealAreas:
    """Return areas whose maxima have several valleys: vergences in random order.

    The best valley is never the narrowest of them, which may be between two samples of the scan.
    """
    draw = np.random.default_rng(5)
    vergence_t, vergence_s = draw.uniform(-0.02, 0.02, (2, COUNT, ANGLES))
    density = draw.uniform(0.2, 1.0, (COUNT, ANGLES)) * 1e12
    density[:, 0] = 0.0  # an excluded angle
    column = np.ones((COUNT, 1))
    return IdealAreas(
        vergence_t,
        vergence_s,
        density,
        AreaModel(
            INVERSE_F * column,
            3e-3 * column,
            4e-6 * draw.uniform(0.5, 2.0, (COUNT, 1)) / (1 if mode == "paper" else 0.013),
            2.5 * column,
            mode == "paper",
            {"paper": 0, "scaled": -1, "exact": 1}[mode],
            (bounds[0] * column, bounds[1] * column),
        ),
    )


def squared_areas(areas: IdealAreas, v):
    """Return A^2 (count, places, angles) by the formula of the module, at vergences v."""
    v = np.broadcast_to(v, (COUNT, v.shape[-1]))[..., None]
    model, b = areas.model, INVERSE_F - v
    scale = model.scale[..., None]
    r = scale * (1 + 3e-3 / b**2) if model.paper else scale * (b**2 + 3e-3)
    sides = [(v - x[:, None]) ** 2 + r for x in (areas.vergence_t, areas.vergence_s)]
    return 2.5 * b ** (4 * model.power) * sides[0] * sides[1] * areas.density[:, None]


@pytest.mark.parametrize("mode", ["paper", "scaled", "exact"])
@pytest.mark.parametrize(
    "bounds", [(1e-7 * INVERSE_F - 0.1, 0.999 * INVERSE_F), (-0.004, 0.003)], ids=["free", "narrow"]
)
def test_best_focus_matches_dense_sampling(mode, bounds):
    areas = areas_with(mode, bounds)
    vergences = np.concatenate([areas.vergence_t, areas.vergence_s], axis=1)
    low, high = vergences.min(axis=1), vergences.max(axis=1)
    margin = 0.05 * (high - low)
    ends = [np.clip(x, *bounds)[:, None] for x in (low - margin, high + margin)]
    np.testing.assert_allclose(np.hstack(areas.range), np.hstack(ends), rtol=1e-12)
    for _ in range(3):  # the second and third time around the minimum
        dense = ends[0] + (ends[1] - ends[0]) * np.linspace(0, 1, 1500)
        worst = squared_areas(areas, dense).max(axis=-1)
        k = worst.argmin(axis=1)[:, None]
        ends = [np.take_along_axis(dense, np.clip(k + side, 0, 1499), axis=1) for side in (-1, 1)]
    v, area = best_vergences(areas)
    np.testing.assert_allclose(area, np.sqrt(worst.min(axis=1)), rtol=1e-6)
    at_best = squared_areas(areas, v[:, None]).max(axis=-1)[:, 0]
    np.testing.assert_allclose(area, np.sqrt(at_best), rtol=1e-12)
    assert ((v >= bounds[0]) & (v <= bounds[1])).all()


@pytest.mark.parametrize("mode", ["paper", "scaled", "exact"])
def test_derivative_matches_differences(mode):
    areas, step = areas_with(mode, (-1.0, 0.09)), 1e-7
    v = np.full((COUNT, 1), 0.0013)
    value, rate, angle = areas.maximum(v)
    expected = squared_areas(areas, v)[:, 0]
    np.testing.assert_allclose(value[:, 0], expected.max(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(angle[:, 0], expected.argmax(axis=1))
    after, before = (
        np.take_along_axis(squared_areas(areas, v + s)[:, 0], angle, axis=1) for s in (step, -step)
    )
    np.testing.assert_allclose(rate, (after - before) / (2 * step), rtol=1e-6)
    selection = np.array([3, 0, 77])
    for full, part in zip(
        areas.maximum(v), areas.part(selection).maximum(v[selection]), strict=True
    ):
        np.testing.assert_array_equal(full[selection], part)
