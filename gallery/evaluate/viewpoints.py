"""Viewpoints of a hyperboloid, which has a single viewpoint, and of a sphere."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

figure, ax = plt.subplots(figsize=(7, 4))
for name in ["paper-hyperboloidal", "paper-spherical", "paper-equidistant"]:
    sensor = om.load_sensor(name)
    low, high = sensor.field_deg
    table = om.evaluate(sensor, omega_deg=np.linspace(max(low, 1), high, 200))
    viewpoint = om.best_viewpoint(sensor, object_distance_mm=1000)
    label = f"{name}: {viewpoint.worst_px:.2f} px error at 1 m with a single viewpoint"
    (line,) = ax.plot(table.omega_deg, table.viewpoint_z_mm, label=label)
    ax.axhline(viewpoint.z_mm, color=line.get_color(), ls=":")
ax.set(xlabel="field angle, deg", ylabel="viewpoint on the axis, mm")
ax.legend(fontsize=8)
figure.savefig("viewpoints.png", bbox_inches="tight")
