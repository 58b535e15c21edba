"""Overall dimensions and mass of a sensor: mirror, camera and housing."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..optics.housing import Rim
from ..optics.lenses import GaussianLens
from ..optics.mirrors import Mirror
from ..optics.sensor import Sensor
from ..optics.thermal import DENSITIES_G_PER_CM3
from .catalogue import BallComponent, Component

MATERIAL = "aluminium"
"""Default material of the mirror body."""
POINTS = 64  # nodes of the Gauss-Legendre quadrature


class OuterSize(NamedTuple):
    """Overall dimensions of a sensor."""

    diameter_mm: float
    height_mm: float
    """Height along the axis, from imager or camera back to the back of the mirror body."""


def outer_size(sensor: Sensor, parts: tuple[Component, ...] = ()) -> OuterSize:
    """Return the largest diameter and the height of a sensor, including parts of known dimensions.

    For a telecentric lens, whose distance is free, the height includes only the mirror and the
    parts.

    Examples
    --------
    >>> import omnimirror as om
    >>> [round(mm, 1) for mm in outer_size(om.load_sensor("paper-spherical"))]
    [87.8, 223.8]
    """
    housing, lens = sensor.housing, sensor.lens
    rim, (_, (_, top)) = housing.rim or Rim(), sensor.mirror.bounds
    widths = [
        2 * (sensor.mirror.rim_radius_mm + rim.width_mm),
        *(part.diameter_mm or 0.0 for part in parts),
    ]
    if housing.camera is not None:
        widths.append(housing.camera.diameter_mm)
    if housing.shell is not None:
        shell = sensor.obstructions.housing.shell
        assert shell is not None
        widths.append(shell.diameter_mm or 0.0)  # a window may be unbounded
    behind = sum(part.length_mm or 0.0 for part in parts if part.KIND == "imager")
    height = top + rim.thickness_mm + behind
    if isinstance(lens, GaussianLens):
        height += sensor.mirror_distance_mm + lens.imager_mm
    else:
        height += sum(part.length_mm or 0.0 for part in parts if part.KIND == "lens")
    return OuterSize(float(max(widths)), float(height))


def mirror_mass_g(
    mirror: Mirror, thickness_mm: float = Rim().thickness_mm, material: str | None = None
) -> float:
    """Return the mass of a mirror between its surface and a flat back behind its highest point.

    Examples
    --------
    Cylinder with a conical cavity:

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
    """Return the density of a mirror material, g/cm3; None selects the default material."""
    return DENSITIES_G_PER_CM3[material or MATERIAL]


@cache
def gauss_nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes (n,) in (-1, 1) and weights of the Gauss-Legendre quadrature for volumes."""
    u, weight = np.polynomial.legendre.leggauss(POINTS)
    return u, weight


def body_mass_g(sensor: Sensor) -> float:
    """Return the mass of the mirror of a sensor, with the material of its thermal properties.

    Examples
    --------
    >>> import omnimirror as om
    >>> round(body_mass_g(om.load_sensor("paper-spherical")))
    321
    """
    thickness = (sensor.housing.rim or Rim()).thickness_mm
    material = None if sensor.thermal is None else sensor.thermal.mirror_material
    return mirror_mass_g(sensor.mirror, thickness, material)


def mass_g(sensor: Sensor, parts: tuple[Component, ...]) -> float | None:
    """Return the mass of mirror (or mirror ball) and parts; None if a mass is unknown."""
    masses_g = [part.mass_g for part in parts]
    if any(mass is None for mass in masses_g):
        return None
    mirror_g = (
        0.0 if any(isinstance(part, BallComponent) for part in parts) else body_mass_g(sensor)
    )
    return mirror_g + sum(mass or 0.0 for mass in masses_g)


def price(parts: tuple[Component, ...]) -> float | None:
    """Return the total price of the parts; None if a price is unknown."""
    prices = [part.price for part in parts]
    return None if any(p is None for p in prices) else sum(p or 0.0 for p in prices)
