"""Landscape outside the windows: sky and hills at infinity, which depend on the direction only."""

from __future__ import annotations

import numpy as np

from ....base.colour import Light, hex_colour
from ....base.typing import Array

ZENITH, HAZE = hex_colour("#4f86c6"), hex_colour("#e6edf2")
SOFTNESS_DEG = 0.15  # edge width of the ridges

RIDGES = (
    ("#8fa6b8", 7.0, ((1.6, 5, 0.4), (0.9, 13, 1.9), (0.3, 41, 0.0))),
    ("#6f8f74", 3.2, ((1.3, 4, 2.2), (0.6, 17, 0.7), (0.2, 59, 1.0))),
    ("#4d6b45", -1.0, ((0.9, 6, 5.1), (0.4, 23, 0.2), (0.25, 97, 2.0))),
)
"""Ridges from far to near: colour, height (deg), and the waves of their outline
(deg, per turn, phase).
"""


def landscape_light(directions: Array) -> Light:
    """Return linear RGB (n, 3) of the landscape in directions (n, 3) of any length but 0.

    >>> blue_sky, meadow = landscape_light(np.array([[0.0, 1.0, 2.0], [0.0, 1.0, -0.2]]))
    >>> bool(blue_sky[2] > blue_sky[0]), bool(meadow[1] > meadow[2])
    (True, True)
    """
    x, y, z = directions.T
    azimuth, elevation = np.arctan2(y, x), np.degrees(np.arctan2(z, np.hypot(x, y)))
    haze = np.exp(-np.clip(elevation, 0, None) / 14.0)[:, None].astype(np.float32)
    light: Light = ZENITH + haze * (HAZE - ZENITH)
    for colour, height, waves in RIDGES:
        line = height + sum(size * np.sin(turns * azimuth + phase) for size, turns, phase in waves)
        covered = np.clip((line - elevation) / SOFTNESS_DEG + 0.5, 0, 1)[:, None].astype(np.float32)
        light += covered * (hex_colour(colour) - light)
    return light
