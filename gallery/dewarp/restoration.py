"""Image at F/1.4 before and after restoration with the known blur of each pixel."""

from dataclasses import replace

import numpy as np

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(320, 320, 16.64))
sensor = replace(sensor, lens=replace(sensor.lens, f_number=1.4))
blurred = om.render_image(sensor, om.load_scene("hall"), samples=16, blur=True)
dewarp = om.Dewarper(sensor, om.screens.Plane((400, 300), pan_deg=20, tilt_deg=-15, hfov_deg=80))
om.write_image("restoration.png", np.hstack([dewarp(blurred), dewarp(om.restore(sensor, blurred))]))
