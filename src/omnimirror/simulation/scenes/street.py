"""Street between houses on a sunny day; the sensor is on the road, 1.6 m high."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from ._painting import (
    Canvas,
    Landscape,
    Paint,
    Surroundings,
    illuminated_texels,
    outer_faces,
    surfaces_of_faces,
    under_sky,
)
from .scene import Box, Face, combine_surfaces, corners, face_of, rays_from, tree_crown

# -- Decoration ------------------------------------------------------------------------------------

GROUND_MM = -1600.0
FRONT_MM = 7_600.0  # distance of the houses from the middle of the road
KERB_MM = 4_200.0
STOREY_MM = 3_200.0

ASPHALT, WALK, WHITE, GLASS = Paint("#55585b"), Paint("#a29d94"), Paint("#ecebe6"), Paint("#3f5566")
DARK, FRAME, TYRE = Paint("#2b3136"), Paint("#f1eee6"), Paint("#17191b")


class House(NamedTuple):
    """House with a shop."""

    box: Box
    colour: str
    sign: str
    awning: str


class Car(NamedTuple):
    """Parked car."""

    boxes: tuple[Box, Box]
    """Body and cabin."""
    colour: str


_LEFT = (
    (-45, -33, 2, "#c98f6b", "BAKERY", "#8a3b2e"),
    (-33, -24, 3, "#d9c9a3", "HOTEL", "#2f4858"),
    (-24, -12, 4, "#a9b7bf", "MUSEUM", "#54415f"),
    (-12, -2, 3, "#e0d3c0", "CAFE", "#a8402f"),
    (-2, 8, 4, "#b7695a", "BOOKS", "#26456b"),
    (8, 20, 3, "#d8d2b8", "FLOWERS", "#3f6e46"),
    (26, 38, 5, "#8f9aa3", "BANK", "#1f3a52"),
    (38, 50, 3, "#cda98a", "POST", "#b08a2e"),
    (50, 60, 4, "#b9ad9e", "CLOCKS", "#4a5056"),
)
_RIGHT = (
    (-45, -35, 4, "#b5a99a", "TOOLS", "#4a5056"),
    (-35, -22, 3, "#c7b287", "SCHOOL", "#7a2e2a"),
    (-18, -6, 3, "#9fb0a0", "GARAGE", "#1f3a52"),
    (-6, 5, 5, "#d6b98f", "MARKET", "#2c6a45"),
    (5, 14, 3, "#c3cad0", "SHOES", "#8a4a2e"),
    (14, 27, 4, "#a9695c", "THEATRE", "#3d2e4f"),
    (27, 38, 2, "#ddd0b4", "OPTICS", "#26456b"),
    (38, 60, 4, "#9c9c96", "STATION", "#7a2e2a"),
)


def _house_of_row(row: tuple[int, int, int, str, str, str], side: int) -> House:
    start, stop, storeys, colour, sign, awning = row
    near, far = side * FRONT_MM, side * (FRONT_MM + 9_000.0)
    top = GROUND_MM + STOREY_MM * storeys + 900.0
    box = Box((1e3 * start, min(near, far), GROUND_MM), (1e3 * stop, max(near, far), top))
    return House(box, colour, sign, awning)


HOUSES = (*(_house_of_row(row, 1) for row in _LEFT), *(_house_of_row(row, -1) for row in _RIGHT))
TREES = tuple(
    (1e3 * x, 5_600.0 * side)
    for side, xs in ((1, (-29, -9.5, 12, 23, 34)), (-1, (-24, -3, 17, 31)))
    for x in xs
)
LANTERNS = tuple(
    box
    for side in (1, -1)
    for x in (-37_000.0, -17_000.0, 3_500.0, 21_000.0, 43_000.0)
    for box in (
        Box((x - 50, side * 4_600.0 - 50, GROUND_MM), (x + 50, side * 4_600.0 + 50, 2_900.0)),
        Box(
            (x - 90, min(side * 4_700.0, side * 3_300.0), 2_900.0),
            (x + 90, max(side * 4_700.0, side * 3_300.0), 3_000.0),
        ),
    )
)


def _car(x: float, y: float, colour: str) -> Car:
    ground = GROUND_MM
    body = Box((x - 2100, y - 850, ground + 180), (x + 2100, y + 850, ground + 850))
    cabin = Box((x - 1250, y - 760, ground + 850), (x + 950, y + 760, ground + 1420))
    return Car((body, cabin), colour)


CARS = (
    _car(6_500.0, 3_200.0, "#a3262a"),
    _car(12_500.0, 3_150.0, "#2e5c8a"),
    _car(-8_000.0, 3_200.0, "#d8d9d6"),
    _car(2_500.0, -3_250.0, "#3f4a44"),
    _car(-6_200.0, -3_200.0, "#d2a33a"),
    _car(17_000.0, -3_200.0, "#e4e2dc"),
    _car(27_000.0, 1_900.0, "#6d7f8f"),
)


def paint_road(face: Face, texel_mm: float) -> Canvas:
    """Paint road and pavements from above: up is forward."""
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, ASPHALT)
    middle = face.width_mm / 2
    for left, right in ((0.0, middle - KERB_MM), (middle + KERB_MM, face.width_mm)):
        canvas.rectangle(left, 0, right, face.height_mm, WALK)
        for y in np.arange(0.0, face.height_mm, 1200.0):
            canvas.rectangle(left, y, right, y + 20, Paint("#87827a"))
    for side in (-1, 1):
        x = middle + side * KERB_MM
        canvas.rectangle(x - 90, 0, x + 90, face.height_mm, Paint("#c4c0b8"))
        canvas.rectangle(
            middle + side * 2200 - 40,
            0,
            middle + side * 2200 + 40,
            face.height_mm,
            Paint("#b9b9b4"),
        )
    for y in np.arange(500.0, face.height_mm, 6000.0):
        canvas.rectangle(middle - 60, y, middle + 60, y + 3000, WHITE)
    for crossing in (45_000.0 + 9_500.0, 45_000.0 - 14_500.0):
        canvas.rectangle(
            middle - KERB_MM + 90, crossing - 300, middle + KERB_MM - 90, crossing + 3700, ASPHALT
        )
        for x in np.arange(middle - KERB_MM + 300, middle + KERB_MM - 600, 1000.0):
            canvas.rectangle(x, crossing, x + 500, crossing + 3400, WHITE)
    canvas.disc(middle - 1400, 45_000.0 + 1_900.0, 330.0, Paint("#3c3f42"))
    canvas.text("BUS", middle + 3_200.0, 45_000.0 - 2_800.0, 900.0, WHITE)
    return canvas


def paint_front(house: House, face: Face, texel_mm: float) -> Canvas:
    """Paint the front of a house: a shop below, windows above."""
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, Paint(house.colour))
    width, height = face.width_mm, face.height_mm
    canvas.rectangle(0, height - 450, width, height, Paint("#8c857a"))
    canvas.rectangle(0, height - 520, width, height - 450, FRAME)
    _shop(canvas, house, width)
    bays = max(2, int(width // 2600))
    for storey in range(1, round((height - 900) / STOREY_MM)):
        bottom = 900 + storey * STOREY_MM
        canvas.rectangle(0, bottom - 650, width, bottom - 590, Paint("#e6dfd0"))
        for bay in range(bays):
            _window(canvas, (bay + 0.5) * width / bays, bottom, storey + bay)
    return canvas


def _shop(canvas: Canvas, house: House, width: float) -> None:
    canvas.rectangle(0, 0, width, 350, Paint("#6f6a63"))
    canvas.rectangle(350, 350, width - 350, 2500, DARK)
    panes = max(3, int(width // 2000))
    door = panes // 2
    for pane in range(panes):
        left, right = (420 + (width - 840) * i / panes for i in (pane, pane + 1))
        if pane == door:
            canvas.rectangle(left + 150, 0, right - 150, 2420, Paint(house.awning))
            canvas.rectangle(left + 320, 900, right - 320, 2250, GLASS)
            continue
        canvas.rectangle(left + 40, 500, right - 40, 2420, Paint("#7b93a3"))
        canvas.rectangle(left + 40, 500, right - 40, 1100, Paint("#54483d"))
        for i in range(4):  # goods
            x = left + (right - left) * (i + 0.7) / 4.6
            canvas.disc(
                x,
                1230,
                120 + 30 * (i % 2),
                Paint(("#c9583f", "#d8b04c", "#6f9a6b", "#7f9fc0")[(i + pane) % 4]),
            )
    for i in range(int(width // 500)):
        canvas.rectangle(500 * i, 2500, 500 * i + 250, 2780, Paint(house.awning))
        canvas.rectangle(500 * i + 250, 2500, 500 * i + 500, 2780, FRAME)
    canvas.rectangle(300, 2800, width - 300, 3550, Paint(house.awning))
    canvas.text(house.sign, width / 2, 3175, 480, FRAME)


def _window(canvas: Canvas, x: float, bottom: float, number: int) -> None:
    canvas.rectangle(x - 640, bottom - 90, x + 640, bottom, FRAME)
    canvas.rectangle(x - 560, bottom, x + 560, bottom + 1800, FRAME)
    canvas.rectangle(
        x - 480,
        bottom + 80,
        x + 480,
        bottom + 1720,
        Paint(("#3f5566", "#4d6678", "#37495a")[number % 3]),
    )
    if number % 2:
        canvas.rectangle(x - 480, bottom + 900, x - 200, bottom + 1720, Paint("#cfc3a8"))
    canvas.rectangle(x - 30, bottom, x + 30, bottom + 1800, FRAME)
    canvas.rectangle(x - 560, bottom + 1180, x + 560, bottom + 1240, FRAME)


def paint_side(house: House, number: int, face: Face, texel_mm: float) -> Canvas:
    """Paint walls without windows, and the roof."""
    canvas = Canvas(
        face.width_mm, face.height_mm, texel_mm, Paint("#6e6a66" if number == 5 else house.colour)
    )
    if number != 5:
        canvas.rectangle(0, face.height_mm - 450, face.width_mm, face.height_mm, Paint("#8c857a"))
    return canvas


def paint_car(car: Car, number: int, face: Face, texel_mm: float) -> Canvas:
    """Paint a face of body or cabin."""
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, Paint(car.colour))
    width, height, is_body, side = face.width_mm, face.height_mm, number < 6, number % 6
    if not is_body and side < 4:
        canvas.rectangle(70, 60, width - 70, height - 60, GLASS)
        if side >= 2:
            canvas.rectangle(width / 2 - 50, 0, width / 2 + 50, height, Paint(car.colour))
    elif side in (2, 3):
        for x in (0.2 * width, 0.8 * width):
            canvas.disc(x, 60, 380, TYRE)
            canvas.disc(x, 60, 210, Paint("#9a9da0"))
        for x in (0.37, 0.56, 0.72):
            canvas.rectangle(x * width - 8, 120, x * width + 8, height, DARK)
    elif side < 2:
        lamp = "#f4ecd2" if side == 1 else "#b3322c"
        for x in (200.0, width - 200.0):
            canvas.disc(x, 0.6 * height, 110, Paint(lamp))
        canvas.rectangle(
            width / 2 - 260, 0.25 * height, width / 2 + 260, 0.25 * height + 110, WHITE
        )
    return canvas


# -- Street ----------------------------------------------------------------------------------------

TEXEL = Parameter("mm", 4.0, 200.0, "texel size of the painted surfaces")
NEAR_MM = 15_000.0  # beyond twice this distance the texel size is doubled
GRID_MM = 250.0  # grid spacing of light and shadows
SUN_DIRECTION = np.array([0.35, -0.55, 0.75]) / np.linalg.norm([0.35, -0.55, 0.75])
ROAD = Box((-45_000.0, -8_000.0, GROUND_MM - 1.0), (60_000.0, 8_000.0, GROUND_MM))
FIELDS = Box((-400_000.0, -400_000.0, GROUND_MM - 30.0), (400_000.0, 400_000.0, GROUND_MM - 20.0))
TRUNKS = tuple(
    Box((x - 120, y - 120, GROUND_MM), (x + 120, y + 120, GROUND_MM + 2200)) for x, y in TREES
)
LEAVES = ("#5c7f3a", "#6b8a3f", "#4f7440")
CROWNS = tuple(
    Box((x - 900, y - 900, GROUND_MM + 2200), (x + 900, y + 900, GROUND_MM + 4600))
    for x, y in TREES
)


@dataclass(frozen=True)
class Street:
    """Street of 105 x 16 m between houses with shops, cars, trees and lanterns.

    Parameters
    ----------
    texel_mm : mm
        Texel size of nearby faces. The street is painted and lit on first use, once for all
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
        non-zero length.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, non-zero vectors of any length.

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
        low_mm, high_mm = corners(low_mm, high_mm)
        is_free = low_mm[2] >= GROUND_MM and not any(
            _overlap(box, low_mm, high_mm) for _, box in _solids()
        )
        return _painted(self.texel_mm) if is_free else None

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays; infinite for the sky.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, non-zero vectors of any length.

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
        raise InvalidParameter("origins_mm must not contain NaN")
    low, high = origins.min(axis=0), origins.max(axis=0)
    if low[2] < GROUND_MM:
        raise InvalidParameter(
            f"ray origins must be above the ground of the street, z = {GROUND_MM:g} mm; got {low[2]:.6g} mm"
        )
    for what, box in _solids():
        if _overlap(box, low, high):
            inside = ((origins > box.low) & (origins < box.high)).all(axis=1)
            if inside.any():
                raise InvalidParameter(
                    f"ray origins must be outside {what} from {list(box.low)} to {list(box.high)} mm; "
                    f"got {origins[inside][0].round(3).tolist()} mm"
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
    pending: list[Canvas] = []

    def painted_faces() -> Iterator[tuple[Face, Canvas]]:
        for face, canvas in _all_faces(texel_mm):
            faces.append(face)
            pending.append(canvas)
            yield face, canvas

    images = [
        illuminated_texels(pending.pop(), light)
        for light in under_sky(painted_faces(), solids, SUN_DIRECTION, GRID_MM)
    ]
    leaves = [
        tree_crown(box, LEAVES[i % len(LEAVES)], SUN_DIRECTION) for i, box in enumerate(CROWNS)
    ]
    return Surroundings(combine_surfaces([surfaces_of_faces(faces, images), *leaves]), Landscape())


def _all_faces(texel_mm: float) -> Iterator[tuple[Face, Canvas]]:
    """Yield each face with its paint one by one: the whole street would take much memory."""
    road = face_of(ROAD, 5, inside=False)
    yield road, paint_road(road, texel_mm)
    fields = face_of(FIELDS, 5, inside=False)
    yield fields, Canvas(fields.width_mm, fields.height_mm, 10_000.0, Paint("#7d9a5e"))
    for house in HOUSES:
        yield from _house_faces(house, texel_mm)
    for car in CARS:
        for number, face in enumerate(outer_faces(car.boxes)):
            yield face, paint_car(car, number, face, texel_mm)
    for face in outer_faces([*TRUNKS, *LANTERNS]):
        is_trunk = face.width_mm > 200
        yield (
            face,
            Canvas(
                face.width_mm, face.height_mm, 50.0, Paint("#5d4a38" if is_trunk else "#3a4146")
            ),
        )


def _house_faces(house: House, texel_mm: float) -> Iterator[tuple[Face, Canvas]]:
    front = 2 if house.box.low[1] > 0 else 3
    middle = (house.box.low[0] + house.box.high[0]) / 2
    texel_size = texel_mm * max(1.0, abs(middle) / NEAR_MM)
    for i in (0, 1, 2, 3, 5):
        face = face_of(house.box, i, inside=False)
        yield (
            face,
            (
                paint_front(house, face, texel_size)
                if i == front
                else paint_side(house, i, face, 4 * texel_size)
            ),
        )
