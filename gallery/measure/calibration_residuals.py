"""Calibration from seven images of a board, with residuals enlarged 100 times."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

camera = om.Unified(
    xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
)
board = om.Board("chessboard", 11, 7, 30.0)
result = om.calibrate_camera(
    om.simulate_detections(camera, board, 7, noise_px=0.1), board, model="unified"
)
pixels = np.concatenate([observation.pixels for observation in result.adjustment.observations])
residuals = result.adjustment.residuals
figure, ax = plt.subplots(figsize=(6, 4.5))
ax.quiver(*pixels.T, *residuals.T, angles="xy", scale_units="xy", scale=1 / 100, width=0.002)
ax.set(
    xlim=(0, 639),
    ylim=(479, 0),
    aspect="equal",
    title=f"RMS {result.rms_px:.2f} px at {result.corners} corners",
)
figure.savefig("calibration_residuals.png", bbox_inches="tight")
