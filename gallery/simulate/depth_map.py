"""Depth map: distance to the object for each pixel of a rendered image."""

from dataclasses import replace

import matplotlib.pyplot as plt

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(400, 400, 13.3))
truth = om.ground_truth(sensor, om.Room())
figure, ax = plt.subplots(figsize=(5, 4))
colours = ax.imshow(truth.depth_mm / 1000, cmap="magma_r")
figure.colorbar(colours, label="m")
ax.axis("off")
figure.savefig("depth_map.png", bbox_inches="tight")
