"""Image shift due to a mirror that is decentred by 1 mm and tilted by 1 deg."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om
from omnimirror.optics.mirrors.mirror import MirrorPose

nominal = om.load_sensor("paper-spherical")
misaligned = replace(nominal, mirror_pose=MirrorPose(decentre_x_mm=1.0, tilt_x_deg=1.0))
grid = np.stack(np.meshgrid(np.arange(32, 1024, 64), np.arange(32, 1024, 64)), axis=-1).reshape(
    -1, 2
)
rays = nominal.backproject(grid)
projected = misaligned.project_directions(rays.directions)
valid = rays.valid & projected.valid
shift_px = (projected.pixels - grid)[valid]
figure, ax = plt.subplots(figsize=(5, 5))
arrows = ax.quiver(*grid[valid].T, *shift_px.T, np.hypot(*shift_px.T), angles="xy", cmap="viridis")
figure.colorbar(arrows, label="px")
ax.set(aspect="equal", xlim=(0, 1023), ylim=(1023, 0))
figure.savefig("misaligned_mirror.png", bbox_inches="tight")
