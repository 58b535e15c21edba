"""Detected mirror outline in an image, with its confidence."""

from dataclasses import replace

import matplotlib.pyplot as plt

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(
    om.load_sensor("paper-spherical"), imager=Imager(480, 400, 10.4, centre_px=(250.0, 190.0))
)
image = om.render_image(sensor, om.load_scene("street"), samples=4)
outline = om.detect_mirror_outline(image)
figure, ax = plt.subplots(figsize=(5, 4))
ax.imshow(image)
ax.plot(*outline.points(100).T, "C3--")
u, v = outline.centre_px
ax.set_title(
    f"centre {u:.1f}, {v:.1f}, radius {outline.radius_px:.1f} px, confidence {outline.confidence:.2f}"
)
figure.savefig("mirror_outline.png", bbox_inches="tight")
