"""Point-spread functions with diffraction at three field angles, on a logarithmic scale."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-hyperboloidal")
focus = om.best_focus(sensor).focus_mm
figure, axes = plt.subplots(1, 3, figsize=(8, 3))
for ax, omega in zip(axes, [20, 70, 120], strict=True):
    psf = om.psf(sensor, omega, focus_mm=focus, width_px=12)
    ax.pcolormesh(
        psf.offset_px,
        psf.offset_px,
        np.log10(psf.density / psf.density.max() + 1e-4),
        cmap="inferno",
    )
    ax.set(title=f"{omega} deg, Strehl {psf.strehl:.2f}", aspect="equal")
figure.supxlabel("tangential, px")
figure.savefig("point_spread_functions.png", bbox_inches="tight")
