"""Blur of nearby objects against distance for three F-numbers."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-equidistant")
distances = np.geomspace(50, 5000, 60)
figure, ax = plt.subplots(figsize=(7, 4))
for f_number in (2.0, 4.0, 8.0):
    sensor_at_f = replace(sensor, lens=replace(sensor.lens, f_number=f_number))
    blur_px = []
    for distance in distances:
        table = om.evaluate(
            sensor_at_f, omega_deg=np.linspace(5, 130, 60), object_distance_mm=distance
        )
        blur_px.append(np.maximum(np.abs(table.blur_t_px), np.abs(table.blur_s_px)).max())
    ax.loglog(distances, blur_px, label=f"F/{f_number:g}")
ax.set(xlabel="object distance from the mirror, mm", ylabel="maximum blur over the field, px")
ax.grid(which="both", alpha=0.3)
ax.legend()
figure.savefig("depth_of_field.png", bbox_inches="tight")
