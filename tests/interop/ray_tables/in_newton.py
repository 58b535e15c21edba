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
    field = np.load(rays)
    height, width = field.shape[:2]
    transform = wp.array(
        [wp.transform(wp.vec3(), wp.quat_from_matrix(AHEAD))], dtype=wp.transformf, device="cpu"
    )
    depth = wp.zeros((1, height, width), dtype=wp.float32, device="cpu")
    if hasattr(newton.sensors, "SensorCamera"):
        camera = newton.sensors.SensorCamera(model)
    else:  # of older releases: one camera in one world
        camera = newton.sensors.SensorTiledCamera(model)
        field = field[None, :, :, 0]
        transform, depth = transform.reshape((1, 1)), depth.reshape((1, 1, height, width))
    camera.default_render_config.enable_backface_culling = False
    camera.update(
        model.state(), transform, wp.array(field, dtype=wp.vec3f, device="cpu"), depth_image=depth
    )
    np.save(depths, depth.numpy().reshape(height, width))
    Path(depths).with_name("version.txt").write_text(newton.__version__)


main(*sys.argv[1:])
