"""Spot diagrams at three field angles and three focus distances."""

import matplotlib.pyplot as plt

import omnimirror as om

sensor = om.load_sensor("paper-spherical")
best = om.best_focus(sensor).focus_mm
spots = om.spots(sensor, omega_deg=[30, 80, 130], focus_mm=[0.95 * best, best, 1.05 * best])
figure, axes = plt.subplots(3, 3, figsize=(6, 6), layout="constrained")
for i, row in enumerate(axes):
    for j, ax in enumerate(row):
        ax.scatter(spots.t_px[i, j], spots.s_px[i, j], s=1)
        ax.set_title(
            f"{spots.omega_deg[i]:g} deg, focused at {spots.focus_mm[j]:.0f} mm", fontsize=8
        )
        ax.set(aspect="equal", xlim=(-6, 6), ylim=(-6, 6))
figure.supxlabel("tangential, px")
figure.supylabel("sagittal, px")
figure.savefig("spot_diagrams.png", bbox_inches="tight")
