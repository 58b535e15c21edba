"""Blur against field angle for the three mirrors of the paper at best focus."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

figure, ax = plt.subplots(figsize=(7, 4))
for colour, name in enumerate(["paper-spherical", "paper-hyperboloidal", "paper-equidistant"]):
    sensor = om.load_sensor(name)
    low, high = sensor.field_deg
    table = om.evaluate(sensor, omega_deg=np.linspace(max(low, 1), high, 200), focus_mm="auto")
    ax.plot(table.omega_deg, table.blur_t_deg, f"C{colour}", label=f"{name[6:]}: tangential")
    ax.plot(table.omega_deg, table.blur_s_deg, f"C{colour}--", label="sagittal")
ax.axhline(0, color="0.5", lw=0.8)
ax.set(
    xlabel="field angle, deg",
    ylabel="blur (signed), deg",
    title="F/4, focus with the smallest maximum blur area",
)
ax.legend(loc="lower right", ncols=3, fontsize=8)
ax.set_ylim(-1.6, 1.4)
figure.savefig("blur_of_three_mirrors.png", bbox_inches="tight")
