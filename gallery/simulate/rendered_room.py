"""Rendered image of a room."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
om.write_image("rendered_room.png", om.render_image(sensor, om.Room(), samples=8))
