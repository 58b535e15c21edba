"""Clearance of rays at the edges of apertures and obstructions, the measure of transmission.

A clearance is a smooth function of the ray, in mm: 0 at the edge, positive for transmitted and
negative for blocked rays. :meth:`omnimirror.optics.tracing.optical_train.OpticalTrain.clearances`
collects those of all parts of a sensor.
"""

from __future__ import annotations

import numpy as np

from ...base.typing import Array


def past_circle(across: Array, radius: float) -> Array:
    """Return the clearance (n,), mm, of plane crossings (n, 2) outside a circle.

    The difference of squares ``(r^2 - a^2)/(2 a)`` has the sign of ``r - a`` and its slope at the
    edge, and is smooth for rays through the axis; it can be interpolated over an aperture.

    >>> past_circle(np.array([[3.0, 0.0], [0.0, 5.0]]), 4.0).round(3)
    array([-0.875,  1.125])
    """
    if radius <= 0:
        return np.full(across.shape[:-1], np.inf)
    clearance: Array = ((across**2).sum(axis=-1) - radius**2) / (2 * radius)
    return clearance
