"""Cube map with six faces, as used by game engines."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.Room(), samples=8)
om.write_image("cube_map.png", om.Dewarper(sensor, om.screens.CubeMap((800, 600)))(image))
