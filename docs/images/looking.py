"""Generate the animation of README.md: a mirror image, and a view that turns by 360 deg.

python docs/images/looking.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import omnimirror as om
from omnimirror.optics.image_sensor import Imager

FRAMES, SECONDS = 60, 9.0
TALL = 300  # px
COLOUR = (255, 200, 60)


def main() -> None:
    """Draw the frames and write them as one looping WebP."""
    sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(900, 900, 5.9))
    circle = om.render_image(sensor, om.load_scene("street"), samples=16)
    small = cv2.resize(circle, (TALL, TALL), interpolation=cv2.INTER_AREA)
    frames = [
        Image.fromarray(frame(sensor, circle, small, 360 * i / FRAMES)) for i in range(FRAMES)
    ]
    frames[0].save(
        Path(__file__).with_name("looking.webp"),
        save_all=True,
        append_images=frames[1:],
        loop=0,
        quality=60,
        method=6,
        duration=round(1000 * SECONDS / FRAMES),
    )


def frame(sensor: om.Sensor, circle: np.ndarray, small: np.ndarray, pan_deg: float) -> np.ndarray:
    """Return the image circle with the outline of the view, and the view."""
    dewarper = om.Dewarper(
        sensor, om.screens.Plane((500, TALL), pan_deg=pan_deg, tilt_deg=-4, hfov_deg=75)
    )
    at = dewarper.coordinates()
    edge = np.concatenate([at[0], at[1:, -1], at[-1, -2::-1], at[-2:0:-1, 0]]) * TALL / len(circle)
    marked = small.copy()
    cv2.polylines(
        marked, [np.round(16 * edge).astype(np.int32)], True, COLOUR, 2, cv2.LINE_AA, shift=4
    )
    return np.hstack([marked, dewarper(circle)])


if __name__ == "__main__":
    main()
