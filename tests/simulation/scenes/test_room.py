"""Room scene: readable signs, valid light, and error messages."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.simulation.rendering import render_pinhole_image
from omnimirror.simulation.scenes._painting import lettering
from omnimirror.simulation.scenes.room import PIECES, ROOM
from omnimirror.simulation.scenes.scene import DistantScene, Scene, are_blocked

WORDS = ("OMNIMIRROR", "GARDEN", "LIBRARY", "EXIT")


@pytest.fixture(scope="module")
def room() -> om.Room:
    return om.Room(texel_mm=10.0)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize("word", WORDS)
def test_signs_are_not_mirrored(room: om.Room, word: str):
    """A pinhole facing a sign, with the right direction of section 1a, images the word as written."""
    letters = lettering(word, 40.0)
    rows, columns = letters.shape
    corners = room.sign_corners_mm(word)
    middle = corners.mean(axis=0)
    axis = int(np.ptp(corners, axis=0).argmin())
    forward = np.zeros(3)
    forward[axis] = np.sign(middle[axis])
    right = np.cross(
        forward, [0.0, 0.0, 1.0]
    )  # x forward, y left, z up: for a view along x, right is -y
    size = np.array([(corners - middle) @ right, corners[:, 2] - middle[2]]).max(axis=1)
    x = ((np.arange(columns) + 0.5) / columns * 2 - 1) * size[0]
    y = -((np.arange(rows) + 0.5) / rows * 2 - 1) * size[1]
    directions = middle + x[None, :, None] * right + y[:, None, None] * np.array([0.0, 0.0, 1.0])
    grey = render_pinhole_image(room, directions).astype(float).mean(axis=2)
    upright = abs(correlation(grey, letters))
    assert upright > 0.9
    assert abs(correlation(grey, letters[:, ::-1])) < upright - 0.3
    assert abs(correlation(grey, letters[::-1])) < upright - 0.15


def test_signs_are_visible(room: om.Room):
    assert set(room.words) == set(WORDS)
    solids = [piece.box for piece in PIECES]
    for word in room.words:
        corners = room.sign_corners_mm(word)
        assert not are_blocked(solids, np.zeros((4, 3)), corners).any()
        assert np.ptp(corners[:, 2]) >= 250 - 10, "large enough for 3.7 px per degree"


def test_solids_are_inside_room():
    for piece in PIECES:
        low, high = np.array(piece.box.low), np.array(piece.box.high)
        assert (low < high).all()
        assert (low >= ROOM.low).all()
        assert (high <= ROOM.high).all()
        assert np.linalg.norm(np.clip(0, low, high)) > 500


def test_room_radiance_range(room: om.Room):
    directions = np.random.default_rng(1).normal(size=(20_000, 3))
    light = room.radiance(np.zeros_like(directions), directions)
    assert light.shape == (20_000, 3)
    assert np.isfinite(light).all()
    assert light.min() >= 0
    assert 0.15 < light.mean() < 0.5
    assert (light.min(axis=1) > 1).mean() < 0.05, "only the lamps are above white"


def test_radiance_is_independent_of_direction_length(room: om.Room):
    directions = np.random.default_rng(2).normal(size=(500, 3))
    origins = np.full((500, 3), 10.0)
    np.testing.assert_allclose(
        room.radiance(origins, directions), room.radiance(origins, 1e3 * directions), atol=1e-4
    )


def test_radiance_is_independent_of_batch(room: om.Room):
    directions = np.random.default_rng(3).normal(size=(500, 3))
    together = room.radiance(np.zeros((500, 3)), directions)
    alone = np.concatenate([room.radiance(np.zeros((1, 3)), d[None]) for d in directions[:50]])
    np.testing.assert_array_equal(together[:50], alone)


def test_parallax_of_near_and_distant_scene(room: om.Room):
    """A wall point is observed in two directions from two positions; distant scenes depend on the
    direction only."""
    origins = np.array([[0.0, 0.0, 0.0], [100.0, -200.0, 150.0]])
    corner = room.sign_corners_mm("OMNIMIRROR")[0]
    light = room.radiance(origins, corner - origins)
    np.testing.assert_allclose(light[0], light[1], atol=1e-4)
    distant = DistantScene(room)
    assert isinstance(distant, Scene)
    towards = np.tile(corner, (2, 1))
    np.testing.assert_array_equal(*distant.radiance(origins, towards))
    sky = np.array([[1.5, 2.3, 0.8]] * 2)
    np.testing.assert_allclose(
        *room.radiance(np.array([[0.0, 0.0, 0.0], [40.0, 0.0, 30.0]]), sky), atol=1e-5
    )


def test_invalid_value_raises(room: om.Room):
    with pytest.raises(InvalidParameter, match=r"inside the room, .*; got .*4000.0"):
        room.radiance(np.array([[4000.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(InvalidParameter, match="directions must be finite and nonzero"):
        room.radiance(np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(InvalidParameter, match="directions must be finite and nonzero"):
        room.radiance(np.zeros((1, 3)), np.array([[np.nan, 0.0, 1.0]]))
    with pytest.raises(InvalidParameter, match=r"OMNIMIRROR.*; got 'NORTH'"):
        room.sign_corners_mm("NORTH")
    with pytest.raises(InvalidParameter, match="texel_mm must be between 1 and 100 mm; got 0"):
        om.Room(texel_mm=0.0)


def test_texel_size_of_wall_ahead():
    """Its lettering equals that of a room with fine texels throughout; other texels are coarse."""
    fine, coarse_sides = om.Room(10.0), om.Room(10.0, other_texel_mm=80.0)
    y, z = np.meshgrid(np.linspace(-2000, 1600, 300), np.linspace(500, 950, 60))
    towards = np.stack([np.full(y.size, 3399.0), y.ravel(), z.ravel()], axis=-1)
    origins = np.zeros_like(towards)
    light, expected = coarse_sides.radiance(origins, towards), fine.radiance(origins, towards)
    assert expected.std() > 0.1  # letters
    np.testing.assert_allclose(light, expected, atol=0.01)  # lit by windows with coarser edges
    np.testing.assert_allclose(
        coarse_sides.sign_corners_mm("OMNIMIRROR"), fine.sign_corners_mm("OMNIMIRROR")
    )
    with pytest.raises(InvalidParameter, match="other_texel_mm"):
        om.Room(10.0, other_texel_mm=0.1)


@pytest.mark.full
def test_fine_wall_memory():
    tracemalloc.start()
    try:
        om.Room(2.0, other_texel_mm=20.0).words  # noqa: B018
        assert tracemalloc.get_traced_memory()[1] < 400e6
    finally:
        tracemalloc.stop()
