"""Street between houses on a sunny day; the sensor is on the road, 1.6 m high."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ....base.arguments import finite
from ....base.colour import Light
from ....base.errors import InvalidParameter
from ....base.parameters import Parameter
from ....base.typing import Array
from ..boxes import Box, Face, face_of
from ..canvas import Canvas, Paint
from ..contract import rays_from
from ..lighting import under_sky
from ..triangles import combined, crown
from .painted import Landscape, Surroundings, finished, outsides, surfaces_of
from .streetside import CARS, GROUND_MM, HOUSES, LANTERNS, TREES, House, paint_car, paint_front, paint_road, paint_side

TEXEL = Parameter("mm", 4.0, 200.0, "fineness of what is painted")
NEAR_MM = 15_000.0  # beyond twice this distance the texel size is doubled
GRID_MM = 250.0  # grid spacing of light and shadows
SUN = np.array([0.35, -0.55, 0.75]) / np.linalg.norm([0.35, -0.55, 0.75])
ROAD = Box((-45_000.0, -8_000.0, GROUND_MM - 1.0), (60_000.0, 8_000.0, GROUND_MM))
FIELDS = Box((-400_000.0, -400_000.0, GROUND_MM - 30.0), (400_000.0, 400_000.0, GROUND_MM - 20.0))
TRUNKS = tuple(Box((x - 120, y - 120, GROUND_MM), (x + 120, y + 120, GROUND_MM + 2200)) for x, y in TREES)
LEAVES = ("#5c7f3a", "#6b8a3f", "#4f7440")
CROWNS = tuple(Box((x - 900, y - 900, GROUND_MM + 2200), (x + 900, y + 900, GROUND_MM + 4600)) for x, y in TREES)


@dataclass(frozen=True)
class Street:
    """Street of 105 x 16 m between houses with shops, cars, trees and lanterns.

    Parameters
    ----------
    texel_mm : mm
        Texel size of nearby faces. The street is painted and lit at the first use, once for all
        equal streets.

    Raises
    ------
    InvalidParameter
        If the texel size is out of range.

    Examples
    --------
    >>> street = Street(texel_mm=100.0)
    >>> street.distance_mm(np.zeros((2, 3)), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])).round(2)
    array([1600.,   inf])
    """

    texel_mm: float = 20.0

    def __post_init__(self) -> None:
        TEXEL.check("texel_mm", self.texel_mm)

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        length but 0.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length but 0.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.

        Raises
        ------
        InvalidParameter
            If a ray starts below the ground, or in a house or a car, or a direction is zero or not
            finite.
        """
        origins, towards = _rays_outside(origins_mm, directions)
        return _painted(self.texel_mm).radiance(origins, towards)

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between two corners.

        Parameters
        ----------
        low_mm, high_mm : (3,)
            Corners of the box, mm.

        Returns
        -------
        Surroundings
            Surfaces of the street; None if the box intersects an object.

        Raises
        ------
        InvalidParameter
            If the corners are not points.
        """
        low_mm, high_mm = (finite(name, v, last=3) for name, v in (("low_mm", low_mm), ("high_mm", high_mm)))
        is_free = low_mm[2] >= GROUND_MM and not any(_overlap(box, low_mm, high_mm) for _, box in _solids())
        return _painted(self.texel_mm) if is_free else None

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays; infinite for the sky.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length but 0.

        Returns
        -------
        (n,) array
            Distances, mm; infinite for the sky.

        Raises
        ------
        InvalidParameter
            If a ray starts below the ground, or in a house or a car, or a direction is zero or not
            finite.
        """
        origins, towards = _rays_outside(origins_mm, directions)
        return _painted(self.texel_mm).distance_mm(origins, towards)


def _rays_outside(origins_mm: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    origins, towards = rays_from(origins_mm, directions)
    if not len(origins):
        return origins, towards
    if np.isnan(origins).any():
        raise InvalidParameter("a ray starts at what is no point; origins_mm are valid as finite numbers")
    low, high = origins.min(axis=0), origins.max(axis=0)
    if low[2] < GROUND_MM:
        raise InvalidParameter(
            f"a ray starts at z = {low[2]:.6g} mm, under the ground of the street, which lies at {GROUND_MM:g} mm"
        )
    for what, box in _solids():
        if _overlap(box, low, high):
            inside = ((origins > box.low) & (origins < box.high)).all(axis=1)
            if inside.any():
                raise InvalidParameter(
                    f"a ray starts at {origins[inside][0].round(3).tolist()} mm, in {what} that reaches from "
                    f"{list(box.low)} to {list(box.high)} mm"
                )
    return origins, towards


def _solids() -> Iterator[tuple[str, Box]]:
    """Yield names and boxes that must not contain ray origins."""
    yield from (("a house", house.box) for house in HOUSES)
    yield from (("a car", box) for car in CARS for box in car.boxes)


def _overlap(box: Box, low_mm: Array, high_mm: Array) -> bool:
    return bool((low_mm < np.array(box.high)).all() and (high_mm > np.array(box.low)).all())


@lru_cache(maxsize=2)
def _painted(texel_mm: float) -> Surroundings:
    houses = [house.box for house in HOUSES]
    cars = [box for car in CARS for box in car.boxes]
    solids = [*houses, *cars, *TRUNKS, *CROWNS, *LANTERNS]
    faces: list[Face] = []
    waiting: list[Canvas] = []

    def one_by_one() -> Iterator[tuple[Face, Canvas]]:
        for face, canvas in _everything(texel_mm):
            faces.append(face)
            waiting.append(canvas)
            yield face, canvas

    pictures = [finished(waiting.pop(), light) for light in under_sky(one_by_one(), solids, SUN, GRID_MM)]
    leaves = [crown(box, LEAVES[i % len(LEAVES)], SUN) for i, box in enumerate(CROWNS)]
    return Surroundings(combined([surfaces_of(faces, pictures), *leaves]), Landscape())


def _everything(texel_mm: float) -> Iterator[tuple[Face, Canvas]]:
    """Yield each face with its paint one by one: the whole street would take much memory."""
    road = face_of(ROAD, 5, inside=False)
    yield road, paint_road(road, texel_mm)
    fields = face_of(FIELDS, 5, inside=False)
    yield fields, Canvas(fields.width_mm, fields.height_mm, 10_000.0, Paint("#7d9a5e"))
    for house in HOUSES:
        yield from _house(house, texel_mm)
    for car in CARS:
        for number, face in enumerate(outsides(car.boxes)):
            yield face, paint_car(car, number, face, texel_mm)
    for face in outsides([*TRUNKS, *LANTERNS]):
        is_trunk = face.width_mm > 200
        yield face, Canvas(face.width_mm, face.height_mm, 50.0, Paint("#5d4a38" if is_trunk else "#3a4146"))


def _house(house: House, texel_mm: float) -> Iterator[tuple[Face, Canvas]]:
    front = 2 if house.box.low[1] > 0 else 3
    middle = (house.box.low[0] + house.box.high[0]) / 2
    fineness = texel_mm * max(1.0, abs(middle) / NEAR_MM)
    for i in (0, 1, 2, 3, 5):
        face = face_of(house.box, i, inside=False)
        yield face, (paint_front(house, face, fineness) if i == front else paint_side(house, i, face, 4 * fineness))
