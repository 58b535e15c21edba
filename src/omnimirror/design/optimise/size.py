"""Overall dimensions and mass of designs, with derivatives, for limits in a search."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...optics.batch.built import walls_of
from ...optics.housing import Rim
from ..catalogue.whole import density_of, gauss_nodes
from ..criteria.merits import FieldValues

if TYPE_CHECKING:
    from .variables import DesignSpace, Given

Array = NDArray[Any]


def with_size(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> FieldValues:
    """Return field values of designs (b, dim) with the limited overall quantities (b, 1)."""
    asked = {limit.quantity for limit in space.problem.limits}
    return field._replace(**{name: of(field, space, y, g) for name, of in SIZES.items() if name in asked})


def _rim(space: DesignSpace) -> Rim:
    return space.problem.housing.rim or Rim()


def _diameter(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    camera = space.problem.housing.camera
    widest: Array = 2 * (g.M + _rim(space).width_mm)
    for other in (0.0 if camera is None else camera.diameter_mm, _cover(space, y, g)):
        widest = np.where(widest.real >= np.real(other), widest, other)
    return widest


def _cover(space: DesignSpace, y: Array, g: Given) -> Any:
    """Return the outer diameter of a tube or a dome fitted to a design, or of a bounded window."""
    housing = space.problem.housing
    if housing.shell is None or housing.shell.diameter_mm is not None:
        return 0.0 if housing.shell is None else housing.shell.diameter_mm
    rim = g.M * space.sags(y, g, np.ones(1))
    walls = walls_of(housing, space.reach(g) - rim, rim, g.M)
    assert walls is not None
    kind, radius, _ = walls.sides[1]
    return 0.0 if kind == "plane" else 2 * radius


def _height(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    height: Array = field.image_distance + field.length + _rim(space).thickness_mm
    return height


def _mass(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    nodes, weights = gauss_nodes()
    u = (nodes + 1) / 2
    z = g.M * space.sags(y, g, u)
    top = g.M * space.sags(y, g, np.ones(1))
    depth = np.where(top.real > 0, top, 0 * top) + _rim(space).thickness_mm - z
    # V = 2 pi integral of x depth dx with x = M u; the weights refer to 2 u - 1 in (-1, 1).
    volume = np.pi * g.M**2 * (u * depth * weights).sum(axis=-1, keepdims=True)
    mass: Array = density_of(space.problem.mirror_material) * volume / 1000
    return mass


SIZES: dict[str, Callable[[FieldValues, DesignSpace, Array, Given], Array]] = {
    "whole_diameter_mm": _diameter,
    "whole_height_mm": _height,
    "whole_mass_g": _mass,
}
