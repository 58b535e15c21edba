"""Three perspective views with pan, tilt and zoom from one image."""

from dataclasses import replace

import numpy as np

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.Room(), samples=8)
directions = [(-40, 0, 75), (60, -20, 60), (150, 10, 40)]
views = [om.screens.Plane((400, 300), pan_deg=p, tilt_deg=t, hfov_deg=f) for p, t, f in directions]
om.write_image("pan_tilt_zoom.png", np.hstack([om.Dewarper(sensor, view)(image) for view in views]))
