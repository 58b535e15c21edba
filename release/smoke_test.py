"""Smoke test of an installed omnimirror: evaluate a sensor, and render and dewarp an image.

One image radius is compared with its value from the law of reflection.
"""

import platform
import sys

import numpy as np

import omnimirror as om
from omnimirror.base.native import backend

compiled = "--without-kernels" not in sys.argv
if compiled == (backend.name == "opencv"):
    sys.exit(
        f"compiled kernels must be {'present' if compiled else 'absent'}; got backend {backend.name}"
    )

sensor = om.load_sensor("paper-spherical")
# Law of reflection on a sphere: at the mirror point whose normal is inclined by phi to the axis, the chief ray has the
# angle theta to the axis, and the reflected ray has the field angle 2 phi + theta. `slope` is tan(theta).
phi, radius_mm, distance_mm = np.radians(40.0), 49.9582, 180.429
# Image distance b = f d / (d - f) of a lens focused at d = 212 mm, in pixels.
image_distance_px = 11.6 * 212 / (212 - 11.6) / 5.2e-3
slope = radius_mm * np.sin(phi) / (distance_mm + radius_mm * (1 - np.cos(phi)))
radius_px = float(om.evaluate(sensor, omega_deg=np.degrees(2 * phi + np.arctan(slope))).h_px[0])
expected_px = image_distance_px * slope
if abs(radius_px - expected_px) > 1e-6:
    sys.exit(f"image radius must be {expected_px} px; got {radius_px} px")

image = om.render_image(sensor, om.Room(), samples=4, seed=1)
screen = om.screens.Plane(size=(320, 240), pan_deg=30, hfov_deg=60)
view = om.Dewarper(sensor, screen)(image)
contrast = float(np.std(view))
if view.shape != (240, 320, 3):
    sys.exit(f"dewarped view must have the shape (240, 320, 3); got {view.shape}")
if not 5 < contrast < 120:
    sys.exit(
        f"standard deviation of the dewarped view must be between 5 and 120; got {contrast:.1f}"
    )
print(
    f"  omnimirror {om.__version__} on Python {platform.python_version()}, {platform.machine()}, {backend.name}"
)
