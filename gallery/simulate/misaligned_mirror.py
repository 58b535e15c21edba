"""Image shift due to a mirror that is decentred by 1 mm and tilted by 1 deg."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om
from omnimirror.optics.mirrors.as_built import MirrorPose

meant = om.load_sensor("paper-spherical")
built = replace(meant, mirror_pose=MirrorPose(decentre_x_mm=1.0, tilt_x_deg=1.0))
grid = np.stack(np.meshgrid(np.arange(32, 1024, 64), np.arange(32, 1024, 64)), axis=-1).reshape(
    -1, 2
)
rays = meant.backproject(grid)
seen = built.project_directions(rays.directions)
kept = rays.valid & seen.valid
moved = (seen.pixels - grid)[kept]
figure, ax = plt.subplots(figsize=(5, 5))
arrows = ax.quiver(*grid[kept].T, *moved.T, np.hypot(*moved.T), angles="xy", cmap="viridis")
figure.colorbar(arrows, label="px")
ax.set(aspect="equal", xlim=(0, 1023), ylim=(1023, 0))
figure.savefig("misaligned_mirror.png", bbox_inches="tight")
