"""Panorama of the image of a mirror sensor."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.load_scene("street"), samples=4)
dewarp = om.Dewarper(sensor, om.views.panorama(sensor, (1200, None)))
om.write_image("panorama.png", dewarp(image))
