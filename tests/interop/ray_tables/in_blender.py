"""Render the box through an exported camera; run by the Python of Blender.

in_blender.py CAMERA.py IMAGE.exr SAMPLES
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import box


def build_wall(number, corners):
    """Build a wall (4, 3) mm that emits its texture."""
    mesh = bpy.data.meshes.new(f"wall{number}")
    mesh.from_pydata((corners / 1000).tolist(), [], [(0, 1, 2, 3)])
    uv_layer = mesh.uv_layers.new()
    for k, corner_uv in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
        uv_layer.data[k].uv = corner_uv
    paint = box.texture(corners)
    image = bpy.data.images.new(
        f"wall{number}", *paint.shape[1::-1], float_buffer=True, is_data=True
    )
    image.pixels.foreach_set(np.concatenate([paint, np.ones_like(paint[..., :1])], axis=-1).ravel())
    material = bpy.data.materials.new(f"wall{number}")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    texture, light, out = (
        nodes.new(f"Shader{n}") for n in ("NodeTexImage", "NodeEmission", "NodeOutputMaterial")
    )
    texture.image, texture.extension = image, "EXTEND"
    links.new(texture.outputs[0], light.inputs[0])
    links.new(light.outputs[0], out.inputs[0])
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))


def main(script, output, samples):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for number, corners in enumerate(box.walls()):
        build_wall(number, corners)
    scene = bpy.context.scene
    placed = bpy.data.objects.new("placed", bpy.data.cameras.new("placed"))
    placed.rotation_euler = (
        np.pi / 2,
        0,
        -np.pi / 2,
    )  # level, along x; matrix_world is stale until an update
    scene.collection.objects.link(placed)
    scene.camera = placed
    runpy.run_path(script)["set_up"]()
    scene.cycles.samples, scene.cycles.max_bounces = int(samples), 0
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = (
        "OPEN_EXR",
        "32",
    )
    scene.render.filepath = output
    bpy.ops.render.render(write_still=True)
    Path(output).with_name("version.txt").write_text(bpy.app.version_string)


main(*sys.argv[1:])
