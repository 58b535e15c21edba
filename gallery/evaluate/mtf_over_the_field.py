"""Tangential and sagittal MTF over the field at a quarter and half of the Nyquist frequency."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-equidistant")
omega = np.arange(5, 131, 12.5)
mtf = om.mtf(
    sensor, omega_deg=omega, cycles_per_px=[0.125, 0.25], focus_mm=om.best_focus(sensor).focus_mm
)
figure, ax = plt.subplots(figsize=(7, 4))
for i, frequency in enumerate(mtf.cycles_per_px):
    ax.plot(omega, mtf.tangential[:, i], f"C{i}", label=f"tangential, {frequency:g} cycles/px")
    ax.plot(omega, mtf.sagittal[:, i], f"C{i}--", label="sagittal")
ax.set(xlabel="field angle, deg", ylabel="modulation", ylim=(0, 1))
ax.legend()
figure.savefig("mtf_over_the_field.png", bbox_inches="tight")
