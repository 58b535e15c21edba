"""Ellipse fit to edges against the true ellipse."""

import numpy as np
import pytest

from omnimirror.calibration.edge_detection import EdgePoints
from omnimirror.calibration.rim._ellipses import Ellipse, Shift, fit_ellipse, shifted


def edges_on(
    a: float, b: float, angle_deg: float, centre: tuple[float, float], share: float = 1.0
) -> EdgePoints:
    """Return EdgePoints on an ellipse given by its axes, over a fraction of its circumference."""
    turn, phase = np.linspace(0, 2 * np.pi * share, 600), np.radians(angle_deg)
    turned = np.array([[np.cos(phase), np.sin(phase)], [-np.sin(phase), np.cos(phase)]])
    points = np.stack([a * np.cos(turn), b * np.sin(turn)], axis=1) @ turned + centre
    normals = np.stack([np.cos(turn) / a, np.sin(turn) / b], axis=1) @ turned
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return EdgePoints(points, normals, np.full(600, 30.0), np.ones(600))


@pytest.mark.parametrize("angle_deg", [0.0, 35.0, 90.0, 140.0])
@pytest.mark.parametrize("b", [100.0, 97.0, 94.0])
def test_ellipse_is_fitted_from_offset_circle(angle_deg, b):
    edges = edges_on(100.0, b, angle_deg, (200.0, 150.0))
    fit = fit_ellipse(edges, Ellipse((202.0, 149.0), 98.0), (6.0, 3.0, 1.5, 0.8))
    assert fit.centre == (pytest.approx(200, abs=0.05), pytest.approx(150, abs=0.05))
    assert fit.semi_axes == (pytest.approx(100, abs=0.05), pytest.approx(b, abs=0.05))
    if b < 100:
        assert abs((fit.angle_deg - angle_deg + 90) % 180 - 90) < 1


def test_clutter_shifts_ellipse_by_less_than_0_5_px():
    edges, rng = edges_on(100.0, 98.0, 20.0, (200.0, 150.0)), np.random.default_rng(0)
    neighbour = edges_on(107.0, 105.0, 20.0, (200.0, 150.0), share=0.3)
    phase = rng.uniform(0, 2 * np.pi, 400)
    points = np.concatenate([edges.points, neighbour.points, rng.uniform(50, 300, (400, 2))])
    normals = np.concatenate(
        [edges.normals, neighbour.normals, np.stack([np.cos(phase), np.sin(phase)], axis=1)]
    )
    cluttered = EdgePoints(points, normals, np.full(1600, 30.0), np.ones(1600))
    fit = fit_ellipse(cluttered, Ellipse((200.5, 150.0), 99.5), (1.0, 0.7))
    assert fit.centre == (pytest.approx(200, abs=0.5), pytest.approx(150, abs=0.5))
    assert fit.semi_axes == (pytest.approx(100, abs=0.5), pytest.approx(98, abs=0.5))


def test_circle_is_shifted_and_stretched_to_edges():
    """Many arcs are locally closer to the circle than the ellipse is."""
    edges = edges_on(104.0, 96.0, 30.0, (203.0, 148.0))
    arcs = [
        edges_on(100.0 + k, 100.0 + k, 0.0, (200.0, 150.0), share=0.25) for k in (-1.5, 0.5, 1.5)
    ]
    crowd = EdgePoints(
        *(
            np.concatenate([getattr(one, name) for one in (edges, *arcs)])
            for name in ("points", "normals", "steps", "weights")
        )
    )
    start = Ellipse((200.0, 150.0), 100.0)
    moved = shifted(crowd, start, Shift(4.0, 2.0, turns=72, stretch_px=4.0))
    fit = fit_ellipse(crowd, moved, (2.0, 1.0, 0.7))
    assert fit.centre == (pytest.approx(203, abs=0.2), pytest.approx(148, abs=0.2))
    assert fit.semi_axes == (pytest.approx(104, abs=0.2), pytest.approx(96, abs=0.2))
    assert fit.angle_deg == pytest.approx(30, abs=2)


def test_points_lie_on_their_own_ellipse():
    ellipse = Ellipse((20.0, 30.0), 50.0, (0.03, -0.02))
    turn = np.linspace(0, 6, 50)
    assert np.allclose(ellipse.away(ellipse.points(turn)), 0, atol=1e-9)
    a, b = ellipse.semi_axes
    reach = np.linalg.norm(
        ellipse.points(np.linspace(0, 2 * np.pi, 20001)) - ellipse.centre, axis=1
    )
    assert (reach.max(), reach.min()) == (pytest.approx(a, rel=1e-6), pytest.approx(b, rel=1e-6))
