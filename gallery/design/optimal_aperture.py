"""Geometric blur and diffraction against F-number, and the aperture with the smallest maximum."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-equidistant")
best = om.best_apertures(sensor)[0]
figure, ax = plt.subplots(figsize=(7, 4))
f_numbers = np.geomspace(1.4, 32, 25)
blur_px = []
for f_number in f_numbers:
    table = om.evaluate(
        replace(sensor, lens=replace(sensor.lens, f_number=f_number)),
        np.arange(5, 131, 5),
        focus_mm="auto",
    )
    blur_px.append([np.abs([table.blur_t_px, table.blur_s_px]).max(), table.airy_px])
ax.loglog(f_numbers, np.array(blur_px)[:, 0], label="maximum blur, px")
ax.loglog(f_numbers, np.array(blur_px)[:, 1], "--", label="Airy disc, px")
ax.axvline(best.f_number, color="C3", label=f"best: F/{best.f_number:.1f}")
ax.set(xlabel="F-number", ylabel="px")
ax.legend()
figure.savefig("optimal_aperture.png", bbox_inches="tight")
