"""Invalid meshes: error messages with the file and the cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes._mesh_files import load_mesh
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.scene import Pose, PosedScene
from omnimirror.simulation.scenes.street import Street

trimesh = pytest.importorskip("trimesh")

SQUARE = "v 1 -1 0\nv 1 1 0\nv 1 0 1\n"


def write_scene(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SQUARE + "f 0 1 2\n", "indices of OBJ files must be nonzero; got 0 in line 4"),
        (SQUARE + "vt 0 0\nf 1/1 2/0 3/1\n", "got 0 in line 5"),
        (
            SQUARE.replace("v 1 0 1", "v nan 0 1") + "f 1 2 3\n",
            "must be finite; 1 of 1 triangles",
        ),
        (
            SQUARE.replace("v 1 0 1", "v inf 0 1") + "f 1 2 3\n",
            "must be finite; 1 of 1 triangles",
        ),
        ("v nan nan nan\n" * 3 + "f 1 2 3\n", "must be finite"),
        ("v 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3\n", "must have an area; all 1 triangles"),
        (
            "v 1e-12 0 0\nv 0 1e-12 0\nv 0 0 0\nf 1 2 3\n",
            r"between 0.01 and 1e\+09 mm; got 1e-09 mm",
        ),
        ("v 1e30 0 0\nv 0 1e30 0\nv 0 0 0\nf 1 2 3\n", "got 1e[+]33 mm"),
        (
            "mtllib none.mtl\n" + SQUARE + "f 1 2 3\n",
            "cannot find the material file 'none.mtl'",
        ),
        (
            "mtllib there.mtl\nusemtl a\n" + SQUARE + "vt 0 0\nf 1/1 2/1 3/1\n",
            "cannot find the texture 'none.png'",
        ),
        (SQUARE, "must contain triangles"),
    ],
)
def test_invalid_obj_raises(tmp_path, text, message):
    write_scene(tmp_path, "there.mtl", "newmtl a\nmap_Kd -s 1 1 1 none.png\n")
    path = write_scene(tmp_path, "bad.obj", text)
    with pytest.raises(MediaError, match=message) as e:
        load_mesh(path)
    assert str(path) in str(e.value)


@pytest.mark.parametrize("corner", ["3", "1000", "-1"])
def test_invalid_corner_index_raises(tmp_path, corner):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    path = write_scene(
        tmp_path, "bad.ply", f"{head}1 -1 0\n1 1 0\n1 0 1\n3 0 1 2\n3 0 1 {corner}\n"
    )
    with pytest.raises(
        MediaError, match=f"between 0 and 2; got {corner}, in total 1 invalid triangles"
    ):
        load_mesh(path)


def test_indices_containing_digit_zero_are_valid(tmp_path):
    corners = "".join(f"v 1 {i % 3 - 1} {i // 3}\n" for i in range(12))
    path = write_scene(tmp_path, "good.obj", f"# f 0 1 2\n{corners}f 10 1 5\nf -1 -2 -6\n")
    assert len(load_mesh(path).surfaces.records) == 2


def test_missing_texture_raises(tmp_path):
    image = '{"asset": {"version": "2.0"}, "images": [{"uri": "none%20here.png"}]}'
    with pytest.raises(MediaError, match=r"cannot find the texture 'none here.png'"):
        load_mesh(write_scene(tmp_path, "a.gltf", image))
    with pytest.raises(MediaError, match=r"cannot find the texture 'none.png'"):
        load_mesh(
            write_scene(
                tmp_path,
                "a.ply",
                "ply\nformat ascii 1.0\ncomment TextureFile none.png\nend_header\n",
            )
        )


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_ply_and_stl_meshes(tmp_path, suffix):
    """A ball 1.5 m ahead: in STL along x and in mm, otherwise along -z and in m, as in glTF."""
    ball = trimesh.creation.icosphere(4, 0.5)
    ball.apply_translation([0, 0, -1.5])
    if suffix == ".stl":
        ball.vertices = 1000 * ball.vertices @ np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    else:
        ball.visual.vertex_colors = [255, 0, 0, 255]
    ball.export(tmp_path / f"ball{suffix}")
    scene = load_mesh(tmp_path / f"ball{suffix}")
    assert scene.distance_mm(np.zeros((1, 3)), np.array([[1.0, 0, 0]]))[0] == pytest.approx(
        1000, abs=5
    )
    light = scene.radiance(np.zeros((1, 3)), np.array([[1.0, 0, 0]]))[0]
    assert light[0] > 0.1
    assert (light[1] == 0) == (suffix == ".ply")


def test_mirror_inside_scene_raises(tmp_path):
    """A cube of 20 mm about the vertex of a mirror of 88 mm; a larger one is a room."""
    sensor = om.load_sensor("paper-spherical")
    small = replace(
        sensor, imager=replace(sensor.imager, width_px=16, height_px=16, pixel_pitch_um=330.0)
    )
    for size in (0.02, 0.4):
        trimesh.creation.box((size, size, size)).export(tmp_path / "cube.ply")
        cube = load_mesh(tmp_path / "cube.ply")
        if size > 0.1:
            assert expose(small, cube, samples=1).max() > 0
            assert (
                expose(
                    om.load_sensor("folded-spherical"), PosedScene(cube, Pose()), samples=1
                ).max()
                > 0
            )
            continue
        for mirror in (small, replace(small, mount=replace(small.mount, camera_looks="down"))):
            with pytest.raises(InvalidParameter, match="the mirror must not intersect the scene"):
                expose(mirror, cube, samples=1)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (Pose(z_mm=-10_000.0), "above the ground of the street, z = -1600 mm"),
        (Pose(x_mm=3000.0, y_mm=10_000.0), "outside a house from"),
        (Pose(x_mm=6500.0, y_mm=3200.0, z_mm=-1000.0), "outside a car from"),
    ],
)
def test_sensor_inside_street_objects_raises(pose, message):
    sensor = om.load_sensor("paper-spherical")
    with pytest.raises(InvalidParameter, match=message):
        expose(sensor, PosedScene(Street(texel_mm=200.0), pose), samples=1)


def test_tiny_environment_raises(tmp_path):
    om.write_image(tmp_path / "tiny.png", np.full((1, 2, 3), 99, np.uint8))
    with pytest.raises(MediaError, match="at least 8 x 4 px; got 2 x 1 px"):
        Environment.load(tmp_path / "tiny.png")
