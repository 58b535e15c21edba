"""Obscuration of a street by the camera body and a central rod."""

from dataclasses import replace

import omnimirror as om
from omnimirror.optics.housing import CameraBody, Housing, Rod
from omnimirror.optics.image_sensor import Imager

housing = Housing(camera=CameraBody(60.0), rod=Rod(diameter_mm=4.0, end_diameter_mm=8.0))
sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32), housing=housing)
print(
    f"{sensor.obscured_percent:.1f} % of the image is obscured, up to {sensor.obscured_to_deg:.0f} deg"
)
om.write_image("obscurations.png", om.render_image(sensor, om.load_scene("street"), samples=4))
