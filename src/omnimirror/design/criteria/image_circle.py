"""Truncation of the image circle by an imager smaller than the circle."""

from __future__ import annotations

import numpy as np

from ...optics.sensor import Sensor

AZIMUTHS = 7200
EDGE_PX = 0.02  # tolerance at the edge of the outermost pixel


def cut_off(sensor: Sensor) -> tuple[str, ...]:
    """Return a remark on the truncated part of the image circle; empty if the circle is complete.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.image_sensor import Imager
    >>> cut_off(replace(om.load_sensor("paper-spherical"), imager=Imager(1024, 576, 5.2)))[0]  # doctest: +ELLIPSIS
    'the rim is on the imager over 38.9% of the azimuths; ...'
    """
    rim, (u, v) = sensor.rim_radius_px, sensor.imager.centre
    width, height = sensor.imager.size
    edges = np.array([width - 1 - u, height - 1 - v, u, v]) + 0.5  # right, bottom, left, top
    if rim <= edges.min() + EDGE_PX:
        return ()
    azimuth = (np.arange(AZIMUTHS) + 0.5) * (2 * np.pi / AZIMUTHS)
    towards = np.stack([np.cos(azimuth), np.sin(azimuth), -np.cos(azimuth), -np.sin(azimuth)])
    with np.errstate(divide="ignore"):
        edge = np.where(towards > 0, edges[:, None] / towards, np.inf).min(axis=0)
    seen = np.minimum(edge, rim)
    shown = sensor.x_from_height_px([max(float(seen.min()), _first_radius_px(sensor))])
    omega_deg = float(np.degrees(sensor.meridian.trace(shown).omega[0]))
    whole = (edge >= rim - EDGE_PX).mean()
    return (
        f"the rim is on the imager over {whole:.1%} of the azimuths; the nearest edge shows up to {omega_deg:.4g} deg, "
        f"and {1 - (seen**2).mean() / rim**2:.1%} of the circle falls off",
    )


def _first_radius_px(sensor: Sensor) -> float:
    """Return the image radius of the inner end of the field."""
    return float(sensor.image_height_px(sensor.meridian.trace(np.array([sensor.meridian.x_min])))[0])
