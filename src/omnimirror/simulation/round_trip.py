"""Round trip: a simulated wall of the room is dewarped and compared with a pinhole image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..analysis.focus import best_viewpoint, viewpoint_angle_error
from ..base.arguments import validate_arguments
from ..base.colour import srgb_from_linear
from ..base.errors import OutsideField
from ..base.results import Result
from ..base.typing import Array
from ..dewarp import Dewarper
from ..dewarp.screens import Plane
from ..optics.sensor import Sensor
from .rendering import expose, render_pinhole_image
from .scenes.room import Room
from .scenes.scene import Pose, PosedScene, Scene

SIZE = (600, 300)
WALL_MM = 800.0
"""Distance from the sensor to the wall ahead with the word OMNIMIRROR."""
POSE = Pose(x_mm=3400.0 - WALL_MM, y_mm=-200.0, z_mm=300.0)
VIEW = Plane(SIZE, hfov_deg=80.0, distance_mm=WALL_MM, offset_mm=(0.0, 0.0, 430.0))
OTHER_TEXEL_MM = 10.0
"""Texel size outside the view; painting the whole room as finely as its wall would take 1.7 GB."""
ROWS = 30
STRIPS = 4
SMOOTHING_PX, STEPS = 4.0, 6
LETTERS = slice(72, 252)  # rows of the view with features for measuring shifts


@dataclass(frozen=True)
class RoundTrip(Result):
    """Deviation of dewarped images from the reference: decibels in sRGB, and shifts in source
    pixels.

    Attributes
    ----------
    exact_db
        Sharp image, dewarped with the true reflection: the residual is due to sampling.
    finer_db
        As `exact_db`, with pixels of half the size, which isolates the sampling error.
    blurred_db
        Image with the whole aperture, including defocus; NaN for a sensor with two mirrors.
    single_db
        Sharp image dewarped with a single-viewpoint model, optimised for that distance.
    exact_px, single_px : (strips,)
        Measured shifts of image strips along the image radius.
    predicted_px : (strips,)
        Predicted shifts by the single-viewpoint model (Eq. 23, Fig. 15 of the paper).
    """

    exact_db: float
    finer_db: float
    blurred_db: float
    single_db: float
    exact_px: Array
    single_px: Array
    predicted_px: Array

    @property
    def blur_fraction(self) -> float:
        """Fraction of the mean squared error of the blurred image that is due to blur, 0 to 1."""
        return float(1 - 10 ** ((self.blurred_db - self.exact_db) / 10))


@validate_arguments
def measure_round_trip(sensor: Sensor, samples: int = 16, texel_mm: float = 2.0) -> RoundTrip:
    """Simulate the wall of the room at 800 mm, dewarp it with four methods, and compare each with a
    pinhole image.

    Parameters
    ----------
    sensor
        Sensor, such as returned by :func:`omnimirror.load_sensor`.
    samples
        Rays per pixel.
    texel_mm
        Texel size of the wall, mm.

    Returns
    -------
    RoundTrip
        Decibels of each method, shifts in px, and the prediction of Eq. 23.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted, and has no field angles.
    OutsideField
        If the field does not contain all letters on the wall.

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
    room = PosedScene(Room(texel_mm, max(texel_mm, OTHER_TEXEL_MM)), POSE)
    truth = _truth(room)
    near = best_viewpoint(sensor, WALL_MM)
    exact, single = (
        Dewarper(sensor, VIEW, "cubic"),
        Dewarper(sensor, VIEW, "cubic", viewpoint=near.z_mm),
    )
    if not np.isfinite(exact.coordinates()[LETTERS]).all():
        raise OutsideField(
            f"the sensor must observe all letters on the wall {WALL_MM:g} mm ahead; got {sensor.name!r}"
        )
    sharp = _rendered(sensor, room, samples)
    exact_view, single_view = exact(sharp), single(sharp)
    blurred_db = np.nan
    if sensor.secondary is None:  # aperture rays via a second mirror are not traced
        blurred_db = _decibels(exact(_rendered(sensor, room, samples, blur=True)), truth)
    u, v = sensor.imager.centre
    halved = replace(
        sensor.imager,
        width_px=2 * sensor.imager.width_px,
        height_px=2 * sensor.imager.height_px,
        pixel_pitch_um=sensor.imager.pixel_pitch_um / 2,
        centre_px=(2 * u + 0.5, 2 * v + 0.5),
    )
    finer = replace(sensor, imager=halved)
    fine = Dewarper(finer, VIEW, "cubic")(_rendered(finer, room, max(1, samples // 4)))
    return RoundTrip(
        _decibels(exact_view, truth),
        _decibels(fine, truth),
        blurred_db,
        _decibels(single_view, truth),
        _shifts(exact_view, truth, exact, sensor),
        _shifts(single_view, truth, exact, sensor),
        _predicted(sensor, exact, near.z_mm),
    )


def _rendered(
    sensor: Sensor, scene: Scene, samples: int, *, blur: bool = False
) -> NDArray[np.float32]:
    """Render an sRGB image, converted in place in bands of rows."""
    image = expose(sensor, scene, samples=samples, blur=blur)
    for rows in np.array_split(image, max(1, len(image) // ROWS)):
        rows[:] = srgb_from_linear(rows)
    return image


def _truth(scene: Scene) -> NDArray[np.float32]:
    """Render the wall with a pinhole at the sensor, 4 x 4 rays per pixel."""
    fine = replace(VIEW, size=(4 * SIZE[0], 4 * SIZE[1]))
    edges = range(
        0, fine.size[1] + 1, 4 * ROWS
    )  # processed in parts: three million rays take 0.5 GB
    parts = [render_pinhole_image(scene, fine.targets(*rows), 4) for rows in pairwise(edges)]
    return (np.concatenate(parts) / 255).astype(np.float32)


def _decibels(image: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    return float(-10 * np.log10(np.mean((image[LETTERS] - truth[LETTERS]) ** 2)))


def _strips() -> list[slice]:
    edges = np.linspace(LETTERS.start, LETTERS.stop, STRIPS + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]


def _radii_of_middle_column(dewarp: Dewarper, sensor: Sensor) -> Array:
    """Return the image radius (rows,), px, of the middle column by the true reflection."""
    return sensor.radius_from_centre_px(dewarp.coordinates()[:, SIZE[0] // 2])


def _shifts(
    image: NDArray[np.float32], truth: NDArray[np.float32], exact: Dewarper, sensor: Sensor
) -> Array:
    """Return the downward shift (strips,) of an image relative to the reference by least squares;
    source px.

    Only the middle third is used. Both images are smoothed first, and the reference is shifted by
    the estimate until convergence.
    """
    import cv2

    radius, columns, shifts_px = (
        _radii_of_middle_column(exact, sensor),
        slice(SIZE[0] // 3, 2 * SIZE[0] // 3),
        [],
    )
    smooth_image, smooth = (cv2.GaussianBlur(p, (0, 0), SMOOTHING_PX) for p in (image, truth))
    for rows in _strips():
        shift = 0.0
        for _ in range(STEPS):
            shifted = cv2.warpAffine(
                smooth,
                np.array([[1.0, 0, 0], [0, 1.0, shift]]),
                SIZE,
                borderMode=cv2.BORDER_REPLICATE,
            )
            slope = np.gradient(shifted, axis=0)[rows, columns].ravel()
            shift += float(
                slope @ (shifted - smooth_image)[rows, columns].ravel() / (slope @ slope)
            )
        shifts_px.append(
            shift * abs(radius[rows.stop] - radius[rows.start]) / (rows.stop - rows.start)
        )
    return np.array(shifts_px)


def _predicted(sensor: Sensor, exact: Dewarper, viewpoint_mm: float) -> Array:
    """Return shifts (strips,) in px by Eq. 23, with the sign of rows, which increase downwards."""
    radius = _radii_of_middle_column(exact, sensor)
    rays = sensor.meridian.trace(sensor.x_from_height_px(radius))
    targets = VIEW.targets(0, SIZE[1])[:, SIZE[0] // 2]
    origins = sensor.backproject(exact.coordinates()[:, SIZE[0] // 2]).origins
    angle = viewpoint_angle_error(rays, viewpoint_mm, np.linalg.norm(targets - origins, axis=1))
    # A view position samples a smaller field angle: lower for an upward camera, which moves the
    # image up
    down = -1.0 if sensor.axis[2] < 0 else 1.0
    error = down * angle * sensor.image_height_rate_px(rays)
    return np.array([float(error[rows].mean()) for rows in _strips()])
