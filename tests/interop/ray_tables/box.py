"""Box with smooth patterns on its walls around the sensor, for omnimirror and other renderers."""

from __future__ import annotations

import numpy as np

HALF_MM = np.array([1500.0, 1100.0, 900.0])
CENTRE_MM = np.array([150.0, -80.0, 60.0])  # centre of the box in the sensor frame, asymmetric


def colours(points):
    """Return linear RGB (..., 3) of points (..., 3) mm: smooth, and unique at each point."""
    x, y, z = np.moveaxis(points / 1000.0, -1, 0)
    waves = [
        np.sin(5 * x + 2 * y) * np.cos(4 * z),
        np.sin(4 * y - 3 * z + 1),
        np.cos(3 * x + 5 * z - 2 * y),
    ]
    return 0.45 + 0.3 * np.stack(waves, axis=-1)


def walls():
    """Return corners (4, 3) mm of each wall, in the order observed from inside: (0, 0), (1, 0), (1, 1), (0, 1)."""
    for axis in range(3):
        for side in (-1.0, 1.0):
            one, other = [i for i in range(3) if i != axis]
            corners = np.zeros((4, 3))
            corners[:, axis] = side * HALF_MM[axis]
            for k, (a, b) in enumerate([(-1, -1), (1, -1), (1, 1), (-1, 1)]):
                corners[k, [one, other]] = a * HALF_MM[one], b * HALF_MM[other]
            yield CENTRE_MM + corners


def texture(corners, pixels=512):
    """Return the texture of a wall (pixels, pixels, 3): texel (i, j) is centred at (j + 0.5, i +
    0.5)."""
    s, t = np.meshgrid(*[(np.arange(pixels) + 0.5) / pixels] * 2)
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    return colours(corners[0] + s[..., None] * across + t[..., None] * up).astype(np.float32)


def first_hits(origins, directions):
    """Return the points at which rays (..., 3) from inside leave the box, mm."""
    with np.errstate(divide="ignore"):
        steps = (CENTRE_MM + np.sign(directions) * HALF_MM - origins) / directions
    steps = np.where(directions == 0, np.inf, steps).min(axis=-1)
    return origins + steps[..., None] * directions


class Box:
    """Scene for :mod:`omnimirror.simulation`: exact, without texels."""

    def radiance(self, origins, directions):
        return colours(
            first_hits(np.asarray(origins, float), np.asarray(directions, float))
        ).astype(np.float32)
