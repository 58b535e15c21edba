"""Street as a little planet (stereographic projection)."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
image = om.render_image(sensor, om.load_scene("street"), samples=4)
planet = om.screens.LittlePlanet((500, 500), hfov_deg=250)
om.write_image("little_planet.png", om.Dewarper(sensor, planet)(image))
