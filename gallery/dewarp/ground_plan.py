"""Plan view of the ground with 5 mm per pixel, computed with the true reflection points."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.Room(), samples=8)
plan = om.screens.Ground((600, 600), height_mm=1200, mm_per_px=5.0)
om.write_image("ground_plan.png", om.Dewarper(sensor, plan)(image))
