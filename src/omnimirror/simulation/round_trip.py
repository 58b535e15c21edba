"""There and back: a wall of the room simulated, straightened, and compared with what a pinhole sees of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..analysis.meridional.viewpoints import best_viewpoint, viewpoint_angle_error
from ..base.arguments import checked
from ..base.colour import srgb_from_linear
from ..base.errors import OutsideField
from ..dewarp import Dewarper
from ..dewarp.screens import Plane
from ..optics.sensor import Sensor
from .rendering.exposure import expose
from .rendering.picture import pinhole_picture
from .scenes.contract import Scene
from .scenes.posed import Pose, PosedScene
from .scenes.worlds.room import Room

Array = NDArray[np.float64]

SIZE = (600, 300)
WALL_MM = 800.0
"""From the sensor to the wall ahead, on which OMNIMIRROR is written."""
POSE = Pose(x_mm=3400.0 - WALL_MM, y_mm=-200.0, z_mm=300.0)
VIEW = Plane(SIZE, hfov_deg=80.0, distance_mm=WALL_MM, offset_mm=(0.0, 0.0, 430.0))
ELSEWHERE_MM = 10.0
"""Fineness of what the view does not show; the whole room as fine as its wall would take 1.7 GB to paint."""
ROWS = 30
STRIPS = 4
SMOOTHING_PX, STEPS = 4.0, 6
LETTERS = slice(72, 252)  # rows of the view where there is something to measure a shift by


@dataclass(frozen=True)
class RoundTrip:
    """How near a straightened picture comes to the truth: decibels in sRGB, and shifts in source pixels.

    Attributes
    ----------
    exact_db
        A sharp picture, straightened by the true reflection: what is left is sampling.
    finer_db
        The same with pixels of half the size: how much of it is.
    blurred_db
        The picture through the whole aperture: what focus costs; NaN for a sensor of two mirrors.
    single_db
        The sharp one straightened as if the mirror had one viewpoint, the best for that distance.
    exact_px, single_px : (strips,)
        By how much strips of the picture are found shifted across the image's radius.
    predicted_px : (strips,)
        By how much the single viewpoint shifts them (Eq. 23, the paper's Fig. 15).
    """

    exact_db: float
    finer_db: float
    blurred_db: float
    single_db: float
    exact_px: Array
    single_px: Array
    predicted_px: Array

    @property
    def blur_share(self) -> float:
        """Share of the blurred picture's mean square error that the blur has added, 0 to 1."""
        return float(1 - 10 ** ((self.blurred_db - self.exact_db) / 10))


@checked
def measure_round_trip(sensor: Sensor, samples: int = 16, texel_mm: float = 2.0) -> RoundTrip:
    """Simulate the room's wall 800 mm ahead, straighten it in four ways, and compare each with a pinhole's picture.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    samples
        Rays per pixel.
    texel_mm
        Fineness of the wall, mm.

    Returns
    -------
    RoundTrip
        Decibels of each way, shifts in px, and the one that Eq. 23 predicts.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted, and has no field angles.
    OutsideField
        If the sensor does not see all of the wall's letters.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=256, height_px=256, pixel_pitch_um=20.8))
    >>> found = om.measure_round_trip(small, samples=1, texel_mm=10.0)
    >>> found.finer_db > found.exact_db
    True
    """
    room = PosedScene(Room(texel_mm, max(texel_mm, ELSEWHERE_MM)), POSE)
    truth = _truth(room)
    near = best_viewpoint(sensor, WALL_MM)
    exact, single = Dewarper(sensor, VIEW, "cubic"), Dewarper(sensor, VIEW, "cubic", viewpoint=near.z_mm)
    if not np.isfinite(exact.coordinates()[LETTERS]).all():
        raise OutsideField(f"{sensor.name!r} does not see all of the letters on the wall {WALL_MM:g} mm ahead")
    sharp = _picture(sensor, room, samples)
    straight, guessed = exact(sharp), single(sharp)
    blurred_db = np.nan
    if sensor.secondary is None:  # no rays of the aperture are traced by way of a second mirror
        blurred_db = _decibels(exact(_picture(sensor, room, samples, blur=True)), truth)
    u, v = sensor.imager.centre
    halved = replace(
        sensor.imager,
        width_px=2 * sensor.imager.width_px,
        height_px=2 * sensor.imager.height_px,
        pixel_pitch_um=sensor.imager.pixel_pitch_um / 2,
        centre_px=(2 * u + 0.5, 2 * v + 0.5),
    )
    finer = replace(sensor, imager=halved)
    fine = Dewarper(finer, VIEW, "cubic")(_picture(finer, room, max(1, samples // 4)))
    return RoundTrip(
        _decibels(straight, truth),
        _decibels(fine, truth),
        blurred_db,
        _decibels(guessed, truth),
        _shifts(straight, truth, exact, sensor),
        _shifts(guessed, truth, exact, sensor),
        _predicted(sensor, exact, near.z_mm),
    )


def _picture(sensor: Sensor, scene: Scene, samples: int, *, blur: bool = False) -> NDArray[np.float32]:
    """sRGB, converted in place, some rows at a time."""
    picture = expose(sensor, scene, samples=samples, blur=blur)
    for rows in np.array_split(picture, max(1, len(picture) // ROWS)):
        rows[:] = srgb_from_linear(rows)
    return picture


def _truth(scene: Scene) -> NDArray[np.float32]:
    """What a pinhole in the sensor's place sees of the wall, four rays by four a pixel."""
    fine = replace(VIEW, size=(4 * SIZE[0], 4 * SIZE[1]))
    edges = range(0, fine.size[1] + 1, 4 * ROWS)  # a part at a time: three million rays take half a gigabyte
    parts = [pinhole_picture(scene, fine.targets(*rows), 4) for rows in pairwise(edges)]
    return (np.concatenate(parts) / 255).astype(np.float32)


def _decibels(picture: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    return float(-10 * np.log10(np.mean((picture[LETTERS] - truth[LETTERS]) ** 2)))


def _strips() -> list[slice]:
    edges = np.linspace(LETTERS.start, LETTERS.stop, STRIPS + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]


def _middle(dewarp: Dewarper, sensor: Sensor) -> Array:
    """Image radius (rows,), px, of the middle column, by the true reflection."""
    return sensor.radius_from_centre_px(dewarp.coordinates()[:, SIZE[0] // 2])


def _shifts(picture: NDArray[np.float32], truth: NDArray[np.float32], exact: Dewarper, sensor: Sensor) -> Array:
    """Shift (strips,) of a picture against the truth, downwards, by least squares over the middle third; source px.

    Both are smoothed first, and the truth is shifted by what was found until nothing is left to find.
    """
    import cv2

    radius, columns, found = _middle(exact, sensor), slice(SIZE[0] // 3, 2 * SIZE[0] // 3), []
    seen, smooth = (cv2.GaussianBlur(p, (0, 0), SMOOTHING_PX) for p in (picture, truth))
    for rows in _strips():
        shift = 0.0
        for _ in range(STEPS):
            moved = cv2.warpAffine(
                smooth, np.array([[1.0, 0, 0], [0, 1.0, shift]]), SIZE, borderMode=cv2.BORDER_REPLICATE
            )
            slope = np.gradient(moved, axis=0)[rows, columns].ravel()
            shift += float(slope @ (moved - seen)[rows, columns].ravel() / (slope @ slope))
        found.append(shift * abs(radius[rows.stop] - radius[rows.start]) / (rows.stop - rows.start))
    return np.array(found)


def _predicted(sensor: Sensor, exact: Dewarper, viewpoint_mm: float) -> Array:
    """Shifts (strips,) in px by Eq. 23, whose sign is that of rows, which count downwards."""
    radius = _middle(exact, sensor)
    rays = sensor.meridian.trace(sensor.x_from_height_px(radius))
    targets = VIEW.targets(0, SIZE[1])[:, SIZE[0] // 2]
    origins = sensor.backproject(exact.coordinates()[:, SIZE[0] // 2]).origins
    angle = viewpoint_angle_error(rays, viewpoint_mm, np.linalg.norm(targets - origins, axis=1))
    # a place of the view takes what lies at a smaller field angle: lower, if the camera looks up, and so all moves up
    down = -1.0 if sensor.axis[2] < 0 else 1.0
    error = down * angle * sensor.image_height_rate_px(rays)
    return np.array([float(error[rows].mean()) for rows in _strips()])
