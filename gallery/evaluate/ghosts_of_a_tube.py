"""Intensity and direction of the reflections of a transparent tube."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om
from omnimirror.optics.housing import Housing, Tube

sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=Tube(120.0)))
ghosts = om.ghosts(sensor, np.arange(20, 131, 2.0))
figure, ax = plt.subplots(figsize=(7, 4))
ax.plot(ghosts.omega_deg, ghosts.ghost_percent, "o-", ms=3)
ax.set(xlabel="field angle, deg", ylabel="relative intensity of the ghost, %")
figure.savefig("ghosts_of_a_tube.png", bbox_inches="tight")
