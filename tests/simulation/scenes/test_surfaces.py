"""Environments and textured surfaces: against closed forms, and the compiled search against
exhaustive search.
"""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.cameras.camera import pan_tilt_direction
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.scene import (
    FACES,
    Box,
    Surfaces,
    Texture,
    are_blocked,
    are_blocked_numpy,
    face_of,
    facets,
    intersect_boxes,
    intersect_boxes_numpy,
)
from tests.samplers import instructions

# -- Environments and textured surfaces: against closed forms, and the compiled search against exhaustive search

needs_native = pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")


def test_environment_directions():
    height, width = 90, 180
    pan = np.radians((np.arange(width) + 0.5) / width * 360 - 180)
    tilt = np.radians(90 - (np.arange(height) + 0.5) / height * 180)
    light = np.stack(
        np.broadcast_arrays(np.cos(pan) + 1, (tilt + 2)[:, None], np.sin(pan) + 1), axis=-1
    )
    world = Environment(light.astype(np.float32), heading_deg=20.0)
    pans, tilts = np.radians([0.0, 77.0, -179.9, 179.9]), np.radians([0.0, 40.0, -60.0, 10.0])
    radiance = world.radiance(np.zeros((4, 3)), pan_tilt_direction(pans, tilts))
    angles = pans - np.radians(20.0)
    np.testing.assert_allclose(
        radiance, np.stack([np.cos(angles) + 1, tilts + 2, np.sin(angles) + 1], -1), atol=1e-3
    )


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (np.ones((4, 8), np.float32), "height, width, 3"),
        (-np.ones((4, 8, 3), np.float32), "finite values from 0"),
    ],
)
def test_invalid_environment_raises(light, message):
    with pytest.raises(InvalidParameter, match=message):
        Environment(light)


def clutter(count: int, rng: np.random.Generator) -> Surfaces:
    vertices = np.concatenate(
        [rng.uniform(-5, 5, (count, 1, 3)), rng.normal(0, 1.5, (count, 2, 3))], axis=1
    )
    textures = (
        Texture(rng.uniform(0, 1, (5, 7, 4)).astype(np.float32)),
        Texture(rng.uniform(0, 1, (3, 2, 4)).astype(np.float32), repeats=True),
    )
    texels = rng.uniform(-3, 9, (count, 3, 2))
    return Surfaces.of(
        vertices, texels, rng.integers(0, 2, count), rng.random(count) < 0.5, textures
    )


@pytest.fixture(params=instructions())
def every_instruction(request):
    before = backend.name
    backend.kernels.set_instruction_set(request.param)
    yield
    backend.kernels.set_instruction_set(before)


@pytest.mark.usefixtures("every_instruction")
@needs_native
@pytest.mark.parametrize("count", [0, 1, 2, 3, 50, 400])
def test_first_hit_is_nearest(count):
    rng = np.random.default_rng(count)
    scene = clutter(count, rng)
    origins, directions = rng.uniform(-6, 6, (3000, 3)), rng.normal(size=(3000, 3))
    directions[:300, 0] = 0.0  # including rays along planes of the boxes
    fast = scene.first_hits(origins, directions)
    if not count:
        assert np.isinf(fast.distance).all()
        return
    slow = scene._hits_in_parts(origins, directions)
    same = np.isclose(fast.distance, slow.distance, rtol=1e-4) | (
        np.isinf(fast.distance) & np.isinf(slow.distance)
    )
    assert same.mean() > 0.998  # rays that graze an edge
    hit = same & np.isfinite(slow.distance)
    assert count < 50 or hit.mean() > 0.15
    assert np.quantile(np.abs(fast.light - slow.light)[hit], 0.99) < 2e-3


def ball(rings: int) -> np.ndarray:
    """Return triangles (n, 3, 3) around the origin without gaps."""
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    radius = 3000 * (1 + 0.05 * np.sin(9 * turn) * np.sin(7 * polar) * np.sin(polar))
    across, up = radius * np.sin(polar), radius * np.cos(polar)
    points = np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate(
        [np.stack(corners, axis=-2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    )


@pytest.mark.usefixtures("every_instruction")
@needs_native
def test_hits_are_independent_of_batch():
    rng = np.random.default_rng(3)
    triangles = ball(60)
    scene = facets(triangles, rng.uniform(0, 1, (len(triangles), 3, 3)).astype(np.float32))
    origins, directions = rng.uniform(-50, 50, (20_005, 3)), rng.normal(size=(20_005, 3))
    directions[:9000] = (
        triangles.mean(axis=1)[rng.integers(len(triangles), size=9000)] - origins[:9000]
    )
    directions[9000:12000] = (
        triangles[rng.integers(len(triangles), size=3000), 1] - origins[9000:12000]
    )  # at corners
    hits, order = scene.first_hits(origins, directions), rng.permutation(len(origins))
    assert np.isinf(hits.distance).mean() < 1e-3  # between triangles
    for alone, together in zip(
        scene.first_hits(origins[order], directions[order]), hits, strict=True
    ):
        np.testing.assert_array_equal(alone, together[order])


@needs_native
def test_coincident_surfaces():
    wall = np.array([[5.0, 1, -1], [0, -2, 0], [0, 0, 2]])
    count = 5000  # which no plane separates
    scene = Surfaces.of(
        np.tile(wall, (count, 1, 1)),
        np.zeros((count, 3, 2)),
        np.zeros(count, int),
        np.zeros(count, bool),
        (Texture(np.full((1, 1, 4), 0.5, np.float32)),),
    )
    hits = scene.first_hits(np.zeros((2, 3)), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    assert hits.distance.tolist() == [5.0, np.inf]


@needs_native
def test_kernels_share_texels():
    scene = facets(ball(20), np.full((1600, 3, 3), 0.25, np.float32))
    texels = scene.textures[0].texels
    native, texels_reference = (
        scene.native,
        weakref.ref(texels if texels.base is None else texels.base),
    )
    del scene, texels
    gc.collect()
    assert texels_reference() is not None
    light, distance = np.empty((1, 4), np.float32), np.empty(1, np.float32)
    native.radiance(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), light, distance)
    np.testing.assert_allclose(light[0, :3], 0.25, rtol=1e-5)
    del native
    gc.collect()
    assert texels_reference() is None


@needs_native
def test_compiled_surfaces_are_cached():
    """Records of 64 bytes in tree order: results are unchanged, and no second copy remains."""
    rng = np.random.default_rng(7)
    scene = facets(
        rng.uniform(-50, 50, (500, 3, 3)), rng.uniform(0, 1, (500, 3, 3)).astype(np.float32)
    )
    expected = np.sort(scene.records, order=["texel"])
    before = scene._hits_in_parts(np.zeros((99, 3)), towards := rng.normal(size=(99, 3)))
    records = scene.native.records
    assert records.nbytes == 500 * 64
    assert np.shares_memory(scene.records, records)
    assert np.array_equal(np.sort(scene.records, order=["texel"]), expected)
    for now, then in zip(scene._hits_in_parts(np.zeros((99, 3)), towards), before, strict=True):
        np.testing.assert_array_equal(now, then)


@needs_native
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e20])
def test_nan_surfaces_raise(bad):
    wall = np.array([[[5.0, 1, -1], [0, -2, 0], [0, 0, bad]]])
    scene = Surfaces.of(
        wall,
        np.zeros((1, 3, 2)),
        np.zeros(1, int),
        np.zeros(1, bool),
        (Texture(np.ones((1, 1, 4), np.float32)),),
    )
    with pytest.raises(ValueError, match="records must be between"):
        scene.first_hits(np.zeros((1, 3)), np.ones((1, 3)))


def test_texture_orientation():
    texels = np.zeros((2, 3, 4), np.float32)
    texels[..., 0] = [[0, 1, 2], [3, 4, 5]]
    wall = np.array(
        [[[5.0, 3.0, 2.0], [0, -6, 0], [0, 0, -4]]]
    )  # top left corner, as seen from the origin
    scene = Surfaces.of(
        wall,
        np.array([[[-0.5, -0.5], [3, 0], [0, 2]]]),
        np.zeros(1, int),
        np.zeros(1, bool),
        (Texture(texels),),
    )
    towards = np.array(
        [[5.0, 2.0, 1.0], [5.0, -2.0, 1.0], [5.0, 0.0, -1.0], [5.0, 0.0, 0.0], [-5.0, 0.0, 0.0]]
    )
    hits = scene.first_hits(np.zeros((5, 3)), towards)
    np.testing.assert_allclose(hits.light[:, 0], [0, 2, 4, 2.5, 0], atol=1e-4)


# -- Ray-box intersections against marching along each ray in small steps --------------------------

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


@pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")
def test_compiled_boxes_match_numpy():
    """Depth and light are therefore independent of it; includes rays along planes, from faces, and
    from inside a solid."""
    origins, directions = rays(5000)
    origins[:50, 0], origins[50:80] = ROOM.high[0], (1.5, 0.0, 0.0)
    directions[:50, 0] = -abs(directions[:50, 0])
    hits, expected = (
        intersect_boxes(ROOM, SOLIDS, origins, directions),
        intersect_boxes_numpy(ROOM, SOLIDS, origins, directions),
    )
    np.testing.assert_array_equal(hits.distance, expected.distance)
    np.testing.assert_array_equal(hits.face, expected.face)
    displacements = 1.7 * directions
    np.testing.assert_array_equal(
        are_blocked(SOLIDS, origins, displacements),
        are_blocked_numpy(SOLIDS, origins, displacements),
    )
    assert not are_blocked((), origins, displacements).any()


def test_box_hits_match_ray_marching():
    origins, directions = rays(300)
    hits = intersect_boxes(ROOM, SOLIDS, origins, directions)
    expected = [march(o, d) for o, d in zip(origins, directions, strict=True)]
    np.testing.assert_allclose(hits.distance, [t for t, _ in expected], atol=1.01 * STEP)
    assert (hits.face // 6 == [box for _, box in expected]).all()
    assert set(hits.face // 6) == {0, 1, 2, 3}


def test_box_hits_face():
    origins, directions = rays(3000)
    hits = intersect_boxes(ROOM, SOLIDS, origins, directions)
    for number in np.unique(hits.face):
        box, inside_out = ((ROOM, *SOLIDS)[number // 6], number < 6)
        face = face_of(box, number % 6, inside=inside_out)
        chosen = hits.face == number
        offset = origins[chosen] + hits.distance[chosen, None] * directions[chosen] - face.corner
        np.testing.assert_allclose(offset @ face.normal, 0, atol=1e-12)
        assert (directions[chosen] @ face.normal < 0).all(), "the face looks at the viewer"
        for along, size in ((face.right, face.width_mm), (face.up, face.height_mm)):
            assert ((offset @ along >= -1e-12) & (offset @ along <= size + 1e-12)).all()


def test_axis_parallel_rays():
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    hits = intersect_boxes(ROOM, (), np.zeros((6, 3)), directions)
    np.testing.assert_array_equal(hits.distance, [3, 4, 2, 3, 2, 1])
    np.testing.assert_array_equal(hits.face, [1, 3, 5, 0, 2, 4])


def test_ray_starting_in_solid():
    hits = intersect_boxes(ROOM, SOLIDS, np.array([[1.5, 0.0, 0.0]]), np.array([[1.0, 0.1, 0.0]]))
    assert hits.distance[0] == 0
    assert hits.face[0] // 6 == 1


def test_segments_are_blocked_by_solids():
    rng = np.random.default_rng(6)
    starts, ends = rng.uniform(ROOM.low, ROOM.high, (2, 400, 3))
    t = np.linspace(0, 1, 4001)[:, None]
    expected = [
        any(inside(s, a + t * (b - a)).any() for s in SOLIDS)
        for a, b in zip(starts, ends, strict=True)
    ]
    answer = are_blocked(SOLIDS, starts, ends - starts)
    assert np.count_nonzero(answer != expected) <= 1  # one that cuts an edge by less than a step
    assert 0.2 < answer.mean() < 0.8


@pytest.mark.parametrize("number", FACES)
@pytest.mark.parametrize("inside", [True, False])
def test_face_orientation(number: int, inside: bool):
    """Right, up and the direction to the viewer form a right-handed set; no face is mirrored."""
    face = face_of(ROOM, number, inside)
    np.testing.assert_array_equal(np.cross(face.right, face.up), face.normal)
    centre = (np.array(ROOM.low) + ROOM.high) / 2
    middle = face.point(face.width_mm / 2, face.height_mm / 2)
    assert ((centre - middle) @ face.normal > 0) == inside
    assert face.point(face.width_mm, face.height_mm) == pytest.approx(2 * middle - face.corner)
    assert abs((middle - centre) @ face.normal) == pytest.approx(
        (np.array(ROOM.high) - ROOM.low)[number // 2] / 2
    )
