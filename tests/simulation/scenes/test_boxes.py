"""Ray-box intersections against marching along each ray in small steps."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.base.native import backend
from omnimirror.simulation.scenes.boxes import FACES, Box, blocked, blocked_in_numpy, face_of, meet, meet_in_numpy

ROOM = Box((-3.0, -2.0, -1.0), (3.0, 4.0, 2.0))
SOLIDS = (
    Box((1.0, -1.0, -1.0), (2.0, 1.0, 0.5)),
    Box((-2.0, 1.0, 0.0), (0.5, 3.0, 1.0)),
    Box((1.5, 0.5, 0.4), (2.5, 3, 2)),
)
STEP = 1e-3


def inside(box: Box, points: np.ndarray) -> np.ndarray:
    return ((points > box.low) & (points < box.high)).all(axis=-1)


def march(origin: np.ndarray, direction: np.ndarray) -> tuple[float, int]:
    """Return distance and box of the first step outside the room or inside a solid."""
    t = np.arange(0, 10, STEP)
    points = origin + t[:, None] * direction
    where = np.where(inside(ROOM, points), -1, 0)
    for number, solid in enumerate(SOLIDS, start=1):
        where[inside(solid, points)] = number
    first = int(np.argmax(where >= 0))
    return float(t[first]), int(where[first])


def rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    origins = rng.uniform((-0.3, -0.3, -0.3), (0.3, 0.3, -0.05), (count, 3))
    directions = rng.normal(size=(count, 3))
    directions[: count // 4, rng.integers(0, 3)] = 0.0  # along a plane
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.skipif(not backend.is_compiled, reason="not built")
def test_compiled_boxes_are_those_of_numpy_to_the_last_bit():
    """Depth and light are therefore independent of it; includes rays along planes, from faces, and
    from inside a solid."""
    origins, directions = rays(5000)
    origins[:50, 0], origins[50:80] = ROOM.high[0], (1.5, 0.0, 0.0)
    directions[:50, 0] = -abs(directions[:50, 0])
    hits, expected = meet(ROOM, SOLIDS, origins, directions), meet_in_numpy(ROOM, SOLIDS, origins, directions)
    np.testing.assert_array_equal(hits.distance, expected.distance)
    np.testing.assert_array_equal(hits.face, expected.face)
    ways = 1.7 * directions
    np.testing.assert_array_equal(blocked(SOLIDS, origins, ways), blocked_in_numpy(SOLIDS, origins, ways))
    assert not blocked((), origins, ways).any()


def test_rays_end_where_marching_ends():
    origins, directions = rays(300)
    hits = meet(ROOM, SOLIDS, origins, directions)
    marched = [march(o, d) for o, d in zip(origins, directions, strict=True)]
    np.testing.assert_allclose(hits.distance, [t for t, _ in marched], atol=1.01 * STEP)
    assert (hits.face // 6 == [box for _, box in marched]).all()
    assert set(hits.face // 6) == {0, 1, 2, 3}


def test_rays_end_on_the_face_that_is_named():
    origins, directions = rays(3000)
    hits = meet(ROOM, SOLIDS, origins, directions)
    for number in np.unique(hits.face):
        box, inside_out = ((ROOM, *SOLIDS)[number // 6], number < 6)
        face = face_of(box, number % 6, inside=inside_out)
        chosen = hits.face == number
        offset = origins[chosen] + hits.distance[chosen, None] * directions[chosen] - face.corner
        np.testing.assert_allclose(offset @ face.normal, 0, atol=1e-12)
        assert (directions[chosen] @ face.normal < 0).all(), "the face looks at the viewer"
        for along, size in ((face.right, face.width_mm), (face.up, face.height_mm)):
            assert ((offset @ along >= -1e-12) & (offset @ along <= size + 1e-12)).all()


def test_rays_along_the_axes_do_not_divide_by_zero():
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    hits = meet(ROOM, (), np.zeros((6, 3)), directions)
    np.testing.assert_array_equal(hits.distance, [3, 4, 2, 3, 2, 1])
    np.testing.assert_array_equal(hits.face, [1, 3, 5, 0, 2, 4])


def test_a_ray_that_starts_in_a_solid_meets_it_at_once():
    hits = meet(ROOM, SOLIDS, np.array([[1.5, 0.0, 0.0]]), np.array([[1.0, 0.1, 0.0]]))
    assert hits.distance[0] == 0
    assert hits.face[0] // 6 == 1


def test_ways_are_blocked_where_a_step_on_them_is_in_a_solid():
    rng = np.random.default_rng(6)
    starts, ends = rng.uniform(ROOM.low, ROOM.high, (2, 400, 3))
    t = np.linspace(0, 1, 4001)[:, None]
    marched = [any(inside(s, a + t * (b - a)).any() for s in SOLIDS) for a, b in zip(starts, ends, strict=True)]
    answer = blocked(SOLIDS, starts, ends - starts)
    assert np.count_nonzero(answer != marched) <= 1  # one that cuts an edge by less than a step
    assert 0.2 < answer.mean() < 0.8


@pytest.mark.parametrize("number", FACES)
@pytest.mark.parametrize("inside", [True, False])
def test_faces_are_seen_the_right_way_round(number: int, inside: bool):
    """Right, up and the direction to the viewer form a right-handed set; no face is mirrored."""
    face = face_of(ROOM, number, inside)
    np.testing.assert_array_equal(np.cross(face.right, face.up), face.normal)
    centre = (np.array(ROOM.low) + ROOM.high) / 2
    middle = face.point(face.width_mm / 2, face.height_mm / 2)
    assert ((centre - middle) @ face.normal > 0) == inside
    assert face.point(face.width_mm, face.height_mm) == pytest.approx(2 * middle - face.corner)
    assert abs((middle - centre) @ face.normal) == pytest.approx((np.array(ROOM.high) - ROOM.low)[number // 2] / 2)
