"""Try an installed omnimirror: a sensor evaluated, its picture taken, straightened, and an angle by hand."""

import platform
import sys

import numpy as np

import omnimirror as om
from omnimirror.base.native import backend

compiled = "--without-kernels" not in sys.argv
if compiled == (backend.name == "opencv"):
    sys.exit(
        f"the kernels are {'missing' if compiled else 'there'}: it computes with {backend.name}"
    )

sensor = om.load_sensor("paper-spherical")
# The law of reflection on a sphere: where its normal leans by phi, the lens sees it theta off the axis, and in it a
# thing at 2 phi + theta.
phi, radius_mm, distance_mm = np.radians(40.0), 49.9582, 180.429
image_distance_px = 11.6 * 212 / (212 - 11.6) / 5.2e-3  # of a lens that is focused at 212 mm
slope = radius_mm * np.sin(phi) / (distance_mm + radius_mm * (1 - np.cos(phi)))
found_px = float(om.evaluate(sensor, omega_deg=np.degrees(2 * phi + np.arctan(slope))).h_px[0])
if abs(found_px - image_distance_px * slope) > 1e-6:
    sys.exit(
        f"the image radius is {found_px} px, by the law of reflection {image_distance_px * slope}"
    )

picture = om.render_image(sensor, om.Room(), samples=4, seed=1)
screen = om.screens.Plane(size=(320, 240), pan_deg=30, hfov_deg=60)
straight = om.Dewarper(sensor, screen)(picture)
if straight.shape != (240, 320, 3) or not 5 < float(np.std(straight)) < 120:
    sys.exit(
        f"the straightened picture is wrong: {straight.shape}, contrast {np.std(straight):.1f}"
    )
print(
    f"  omnimirror {om.__version__} on Python {platform.python_version()}, {platform.machine()}, {backend.name}"
)
