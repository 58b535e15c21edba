"""View map for cv2.remap of OpenCV."""

from dataclasses import replace

import cv2
import numpy as np

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.Room(), samples=8)
view = om.screens.Plane((600, 400), pan_deg=60, hfov_deg=80)
x, y = np.moveaxis(om.view_map(sensor, view).border_clamped_dewarp_map.astype(np.float32), -1, 0)
dewarped = cv2.remap(image, x, y, cv2.INTER_LINEAR)
om.write_image("opencv_remap.png", dewarped)
