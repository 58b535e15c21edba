"""Images of a hall at F/16 and F/1.4: the focused zone of a mirror is a ring."""

from dataclasses import replace

import numpy as np

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-hyperboloidal"), imager=Imager(400, 400, 13.3))
hall = om.load_scene("hall")
images = []
for f_number in (16.0, 1.4):
    sensor_at_f = replace(sensor, lens=replace(sensor.lens, f_number=f_number))
    images.append(om.render_image(sensor_at_f, hall, samples=16, blur=True))
om.write_image("aperture_and_blur.png", np.hstack(images))
