"""Compute the depths of exported rays in the box; run by a Python with Newton.

in_newton.py RAYS.npy DEPTHS.npy
"""

from __future__ import annotations

import sys
from pathlib import Path

import newton
import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parent))
import box

AHEAD = wp.mat33(0.0, 0.0, -1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Columns: right, up and back of the camera in a world with x ahead, y left and z up."""


def main(rays, depths):
    builder = newton.ModelBuilder()
    for corners in box.walls():
        triangles = np.array([0, 1, 2, 0, 2, 3], np.int32)
        builder.add_shape_mesh(
            body=-1, mesh=newton.Mesh((corners / 1000).astype(np.float32), triangles)
        )
    model = builder.finalize(device="cpu")
    camera = newton.sensors.SensorCamera(model)
    camera.default_render_config.enable_backface_culling = False
    field = wp.array(np.load(rays), dtype=wp.vec3f, device="cpu")
    transform = wp.array(
        [wp.transform(wp.vec3(), wp.quat_from_matrix(AHEAD))], dtype=wp.transformf, device="cpu"
    )
    depth = camera.allocate_image_depth(1, field.shape[1], field.shape[0])
    camera.update(model.state(), transform, field, depth_image=depth)
    np.save(depths, depth.numpy()[0])


main(*sys.argv[1:])
