"""How large and how heavy the whole of a sensor is: mirror, camera, and what stands around them."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...optics.housing import Rim
from ...optics.lenses import GaussianLens
from ...optics.mirrors import Mirror
from ...optics.sensor import Sensor
from ...optics.thermal import DENSITIES_G_PER_CM3
from .catalogue import BallComponent, Component

MATERIAL = "aluminium"
"""Of the mirror's body, where nothing is said of it."""
POINTS = 64  # of Gauss's rule


class OuterSize(NamedTuple):
    """What bounds a sensor on the outside."""

    diameter_mm: float
    height_mm: float
    """Along the axis, from the imager (or the back of a camera of known length) to the back of the mirror's body."""


def whole_of(sensor: Sensor, parts: tuple[Component, ...] = ()) -> OuterSize:
    """Largest diameter and height of a sensor as it is built, of parts whose outside may be known.

    Under a telecentric lens the height is that of mirror and parts: where the lens stands is free.

    Examples
    --------
    >>> import omnimirror as om
    >>> [round(mm, 1) for mm in whole_of(om.load_sensor("paper-spherical"))]
    [87.8, 223.8]
    """
    housing, lens = sensor.housing, sensor.lens
    rim, (_, (_, top)) = housing.rim or Rim(), sensor.mirror.bounds
    widths = [2 * (sensor.mirror.rim_radius_mm + rim.width_mm), *(part.diameter_mm or 0.0 for part in parts)]
    if housing.camera is not None:
        widths.append(housing.camera.diameter_mm)
    if housing.shell is not None:
        shell = sensor.obstructions.housing.shell
        assert shell is not None
        widths.append(shell.diameter_mm or 0.0)  # a window may have no edge
    behind = sum(part.length_mm or 0.0 for part in parts if part.KIND == "imager")
    height = top + rim.thickness_mm + behind
    if isinstance(lens, GaussianLens):
        height += sensor.mirror_distance_mm + lens.imager_mm
    else:
        height += sum(part.length_mm or 0.0 for part in parts if part.KIND == "lens")
    return OuterSize(float(max(widths)), float(height))


def mirror_mass_g(mirror: Mirror, thickness_mm: float = Rim().thickness_mm, material: str | None = None) -> float:
    """Mass of a mirror, from its surface to a flat back that lies so far behind its highest point.

    Examples
    --------
    A cylinder with a cone out of it:

    >>> from omnimirror.optics.mirrors import Cone
    >>> round(mirror_mass_g(Cone(45.0, 10.0), 5.0), 2), round(2.7e-3 * np.pi * 100 * (5 + 10 * 2 / 3 - 10 / 3), 2)
    (7.07, 7.07)
    """
    u, weight = gauss_nodes()
    x = mirror.rim_radius_mm * (u + 1) / 2
    (_, _), (_, top) = mirror.bounds
    depth = top + thickness_mm - mirror.sag(x)
    volume = np.pi * mirror.rim_radius_mm * float((x * depth * weight).sum())
    return density_of(material) * volume / 1000


def density_of(material: str | None) -> float:
    """Of a mirror's body, g/cm3; of the usual one where nothing is said."""
    return DENSITIES_G_PER_CM3[material or MATERIAL]


@cache
def gauss_nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (n,) in (-1, 1) and weights of Gauss's rule, by which bodies are weighed."""
    u, weight = np.polynomial.legendre.leggauss(POINTS)
    return u, weight


def body_mass_g(sensor: Sensor) -> float:
    """Mass of a sensor's mirror, of the material that is said of it.

    Examples
    --------
    >>> import omnimirror as om
    >>> round(body_mass_g(om.load_sensor("paper-spherical")))
    321
    """
    thickness = (sensor.housing.rim or Rim()).thickness_mm
    said = None if sensor.thermal is None else sensor.thermal.mirror_material
    return mirror_mass_g(sensor.mirror, thickness, said)


def mass_g(sensor: Sensor, parts: tuple[Component, ...]) -> float | None:
    """Of the mirror and the parts, a ball in the mirror's stead; None where that of a part is not known."""
    known = [part.mass_g for part in parts]
    if any(mass is None for mass in known):
        return None
    made = 0.0 if any(isinstance(part, BallComponent) for part in parts) else body_mass_g(sensor)
    return made + sum(mass or 0.0 for mass in known)


def price(parts: tuple[Component, ...]) -> float | None:
    """Of all parts; None where that of one is not known."""
    prices = [part.price for part in parts]
    return None if any(p is None for p in prices) else sum(p or 0.0 for p in prices)
