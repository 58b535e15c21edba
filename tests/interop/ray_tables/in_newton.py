"""Compute the depths of exported rays in the box; run by a Python with Newton.

in_newton.py RAYS.npy DEPTHS.npy CODE.py

CODE.py contains the lines of the documentation that compute ``depth``.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import newton
import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parent))
import box

AHEAD = wp.mat33(0.0, 0.0, -1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Columns: right, up and back of the camera in a world with x ahead, y left and z up."""


def main(rays, depths, code):
    builder = newton.ModelBuilder()
    for corners in box.walls():
        triangles = np.array([0, 1, 2, 0, 2, 3], np.int32)
        builder.add_shape_mesh(
            body=-1, mesh=newton.Mesh((corners / 1000).astype(np.float32), triangles)
        )
    model = builder.finalize(device="cpu")
    transforms = wp.array(
        [wp.transform(wp.vec3(), wp.quat_from_matrix(AHEAD))], dtype=wp.transformf, device="cpu"
    )
    if hasattr(newton.sensors, "SensorCamera"):
        names = globals() | {"model": model, "state": model.state(), "transforms": transforms}
        os.chdir(Path(rays).parent)
        exec(Path(code).read_text(), names)
        depth = names["depth"]
    else:
        depth = depths_before_1_7(model, np.load(rays), transforms)
    np.save(depths, depth.numpy().squeeze())
    Path(depths).with_name("version.txt").write_text(newton.__version__)


def depths_before_1_7(model, rays, transforms):
    """Return the depths by the older sensor, which has dimensions for cameras and worlds."""
    camera = newton.sensors.SensorTiledCamera(model)
    camera.default_render_config.enable_backface_culling = False
    field = wp.array(rays[None, :, :, 0], dtype=wp.vec3f, device="cpu")
    depth = wp.zeros((1, 1, *rays.shape[:2]), dtype=wp.float32, device="cpu")
    camera.update(model.state(), transforms.reshape((1, 1)), field, depth_image=depth)
    return depth


main(*sys.argv[1:])
