"""Blur of the equidistant mirror of the paper and the lower bound for all mirrors."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-equidistant")
bound = om.blur_bound(sensor)
table = om.evaluate(
    sensor, omega_deg=np.linspace(1, 135, 200), focus_mm="auto", merit="worst_blur_deg"
)
figure, ax = plt.subplots(figsize=(7, 4))
ax.plot(table.omega_deg, table.blur_t_deg, "C0", label="equidistant mirror, tangential")
ax.plot(table.omega_deg, table.blur_s_deg, "C0--", label="sagittal")
ax.plot(bound.omega_deg, bound.t_deg, "C3", label="optimal mirror, tangential")
ax.plot(bound.omega_deg, bound.s_deg, "C3--", label="sagittal")
ax.set(
    xlabel="field angle, deg",
    ylabel="blur (signed), deg",
    title=f"lower bound {bound.blur_deg:.3f} deg",
)
ax.legend()
figure.savefig("lower_bound_of_the_blur.png", bbox_inches="tight")
