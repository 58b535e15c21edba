"""Street, hall and meshes: positions of objects, readable signs, and equal results without the
compiled module."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.base.native import backend
from omnimirror.simulation.rendering import render_pinhole_image
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.scene import Scene, facets
from omnimirror.simulation.scenes.street import Street
from tests.everyday import few

needs_native = pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")


@pytest.fixture(scope="module")
def hall() -> Hall:
    return Hall(texel_mm=12.5)


def face_radiance(scene, face_corners, columns, rows):
    """Return an image of the flat patch between corners (rows, columns, 3), from the front."""
    v, u = np.meshgrid(
        (np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij"
    )
    top_left, top_right, bottom_left = face_corners[0, 0], face_corners[0, -1], face_corners[-1, 0]
    points = (
        top_left + u[..., None] * (top_right - top_left) + v[..., None] * (bottom_left - top_left)
    )
    return render_pinhole_image(scene, points)


@needs_native
def test_room_surfaces_match_boxes(uncompiled):
    room, chance = om.Room(texel_mm=20.0), np.random.default_rng(5)
    origins, directions = chance.uniform(-300, 300, (60_000, 3)), chance.normal(size=(60_000, 3))
    fast = room.radiance(origins, directions)
    uncompiled()
    different = np.abs(fast - room.radiance(origins, directions)).max(axis=1)
    assert np.median(different) < 1e-6
    assert (different > 5e-3).mean() < 2e-4  # rays that graze an edge


@needs_native
@pytest.mark.parametrize(
    "scene",
    few([Hall(texel_mm=50.0), Street(texel_mm=200.0)], Hall(texel_mm=50.0)),
    ids=["hall", "street"],
)
def test_uncompiled_scenes_match(scene, uncompiled):
    chance = np.random.default_rng(6)
    origins, directions = chance.uniform(-300, 300, (4000, 3)), chance.normal(size=(4000, 3))
    fast, distance = scene.radiance(origins, directions), scene.distance_mm(origins, directions)
    uncompiled()
    assert (np.abs(fast - scene.radiance(origins, directions)).max(axis=1) > 5e-3).mean() < 1e-3
    np.testing.assert_allclose(distance, scene.distance_mm(origins, directions), rtol=1e-3)


@pytest.mark.parametrize(
    "scene", [Hall(texel_mm=50.0), Street(texel_mm=200.0)], ids=["hall", "street"]
)
def test_scene_radiance_range(scene):
    assert isinstance(scene, Scene)
    directions = np.random.default_rng(1).normal(size=(20_000, 3))
    light = scene.radiance(np.zeros_like(directions), directions)
    assert np.isfinite(light).all()
    assert 0.1 < light.mean() < 0.6
    assert (light.min(axis=1) > 1).mean() < 0.05


@pytest.mark.parametrize("name", few(["A4", "B2", "C5"], "B2"))
def test_board_corner_positions(hall, name):
    """The image around each corner is that of a corner: opposite quarters are equal and neighbours
    are not."""
    corners = hall.board_corners_mm(name)
    right, down = corners[0, 1] - corners[0, 0], corners[1, 0] - corners[0, 0]
    np.testing.assert_allclose(
        [np.linalg.norm(right), np.linalg.norm(down), right @ down], [100, 100, 0], atol=1e-9
    )
    quarters = [
        render_pinhole_image(hall, corners + 0.25 * (x * right + y * down))[..., 1].astype(int) > 90
        for x, y in ((-1, -1), (1, 1), (1, -1), (-1, 1))
    ]
    black = (np.arange(7)[:, None] + np.arange(11)) % 2 == 0
    for quarter, expected in zip(quarters, (~black, ~black, black, black), strict=True):
        np.testing.assert_array_equal(quarter, expected)


def test_board_corners_match_opencv(hall):
    import cv2

    corners = hall.board_corners_mm("A4")
    right, down = (corners[0, -1] - corners[0, 0]) / 10, (corners[-1, 0] - corners[0, 0]) / 6
    outer = corners[0, 0] - 1.9 * right - 1.9 * down
    frame = (
        outer
        + 13.8 * np.array([0.0, 1.0])[:, None] * right
        + 9.8 * np.array([0.0, 1.0])[:, None, None] * down
    )
    image = face_radiance(hall, frame, 1380, 980)
    success, pixels = cv2.findChessboardCornersSB(
        image[..., 1].copy(), (11, 7), flags=cv2.CALIB_CB_ACCURACY
    )
    assert success
    # OpenCV may start at either end
    expected = (
        np.stack(np.meshgrid(190 + 100 * np.arange(11), 190 + 100 * np.arange(7)), axis=-1) - 0.5
    )
    pixels = pixels.reshape(7, 11, 2)
    error_px = min(np.abs(p - expected).max() for p in (pixels, pixels[::-1, ::-1]))
    assert error_px < 0.2  # px of 1 mm; texels have 12


def test_hall_depth_of_boards(hall):
    corners = hall.board_corners_mm("C1").reshape(-1, 3)
    np.testing.assert_allclose(
        hall.distance_mm(np.zeros_like(corners), corners),
        np.linalg.norm(corners, axis=1),
        atol=1e-2,
    )


def test_unknown_board_raises(hall):
    with pytest.raises(InvalidParameter, match=r"board must be one of .*; got 'D1'"):
        hall.board_corners_mm("D1")
    with pytest.raises(InvalidParameter, match="must be inside the hall"):
        hall.radiance(np.array([[9e4, 0, 0]]), np.ones((1, 3)))


def test_facet_colours_are_interpolated():
    chance = np.random.default_rng(3)
    triangles, colours = (
        chance.normal(size=(5, 3, 3)),
        chance.uniform(0, 1, (5, 3, 3)).astype(np.float32),
    )
    weights = chance.dirichlet([1, 1, 1], 5)
    points = np.einsum("nc,ncx->nx", weights, triangles)
    for i in range(5):
        alone = facets(triangles[i : i + 1], colours[i : i + 1])
        normal = np.cross(*(triangles[i, 1:] - triangles[i, 0]))
        hit = alone.first_hits((points[i] + normal)[None], -normal[None])
        np.testing.assert_allclose(hit.light[0], weights[i] @ colours[i], atol=1e-5)


def test_mesh_colours(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    from PIL import Image

    from omnimirror.simulation.scenes._mesh_files import load_mesh

    visual, pbr = trimesh.visual.TextureVisuals, trimesh.visual.material.PBRMaterial
    image = Image.fromarray(
        np.uint8([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]])
        .repeat(32, 0)
        .repeat(32, 1)
    )
    corners = np.array(
        [[-1, -1, -3], [1, -1, -3], [1, 1, -3], [-1, 1, -3]], float
    )  # ahead, from lower left
    wall = trimesh.Trimesh(
        corners, [[0, 1, 2], [0, 2, 3]], process=False,
        visual=visual(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=pbr(baseColorTexture=image)),
    )  # fmt: skip
    ball = trimesh.creation.icosphere(3, 0.5)
    ball.visual = visual(material=pbr(baseColorFactor=[1.0, 0.5, 0.0, 1.0]))
    ball.apply_translation([2, 0, 0])  # to the right
    leaf = trimesh.Trimesh([[-3, -1, -1], [-3, -1, 1], [-3, 2, 0]], [[0, 1, 2]], process=False,
                           vertex_colors=[[255, 0, 0, 255], [255, 0, 0, 255], [0, 0, 255, 255]])  # fmt: skip
    trimesh.Scene([wall, ball, leaf]).export(tmp_path / "scene.glb")
    sky = Environment(np.full((2, 4, 3), 0.25, np.float32))
    scene = load_mesh(tmp_path / "scene.glb", background=sky)
    towards = np.array(
        [[3, 0.5, 0.5], [3, -0.5, 0.5], [3, 0.5, -0.5], [0, -1, 0], [0, 3, 0], [0, 0, 1.0]]
    )
    light = scene.radiance(np.zeros_like(towards), towards)
    np.testing.assert_allclose(
        light[:3], np.eye(3), atol=1e-5
    )  # red upper left, green upper right, blue lower left
    assert light[3, 2] == 0
    assert light[3, 0] == pytest.approx(2 * light[3, 1], rel=0.02)
    assert light[4, 0] / light[4, 2] == pytest.approx(2.0, rel=1e-3)  # 67 % red, 33 % blue
    np.testing.assert_allclose(light[5], 0.25, atol=1e-6)
    assert scene.distance_mm(np.zeros((1, 3)), towards[3:4])[0] == pytest.approx(1500, abs=5)
    rotated = load_mesh(tmp_path / "scene.glb", unit_mm=1.0, up="z")
    assert np.isinf(rotated.distance_mm(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])))
    assert rotated.distance_mm(np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]]))[0] == pytest.approx(
        3.0
    )


def test_invalid_mesh_raises(tmp_path):
    pytest.importorskip("trimesh")
    from omnimirror.simulation.scenes._mesh_files import load_mesh

    (tmp_path / "bad.glb").write_bytes(b"glTF and nothing else")
    with pytest.raises(MediaError, match="cannot read the mesh"):
        load_mesh(tmp_path / "bad.glb")
    with pytest.raises(MediaError, match="cannot read the mesh"):
        load_mesh(tmp_path / "none.obj")
    with pytest.raises(InvalidParameter, match=r"up must be one of .*; got 'x'"):
        load_mesh(tmp_path / "bad.glb", up="x")
