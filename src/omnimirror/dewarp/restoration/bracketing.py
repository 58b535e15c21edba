"""Focus bracketing: pictures focused at a few distances, merged by radius into one that is sharp all over.

How blurred each field angle is at each focus follows from its virtual images, so nobody searches pictures for
sharpness. Where tangential and sagittal image lie far apart no focus serves both: astigmatism sets the limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.meridional.coddington import virtual_images
from ...analysis.meridional.focus import FocusStudy
from ...base.arguments import checked, distances, instance, number, row
from ...base.errors import InvalidParameter
from ...optics.sensor import Sensor, check_sensor
from ..maps.pixels import PixelMap
from ..sampling.samplers import remap
from .blurring import offsets_from_axis

Array = NDArray[np.float64]

ANGLES, FOCUSES = 541, 1201
SLACK = 1.25  # where astigmatism rules, blur may be so many times the least that any focus leaves
SOFTNESS_PX = 0.25  # of the change from one picture to the next: difference of blur that decides
MOST_PICTURES = 64
ROUNDED = 1 - 1e-9


@dataclass(frozen=True)
class Bracket:
    """Where to focus, and what blur is left at n field angles.

    Attributes
    ----------
    focus_mm : (k,)
        Object distances in focus, near to far.
    omega_deg : (n,)
    blur_px : (n,)
        Larger of tangential and sagittal blur in the picture that is sharpest there.
    least_px : (n,)
        The least that any focus leaves: half the astigmatism, about.
    limit_px
    """

    focus_mm: Array
    omega_deg: Array = field(repr=False)
    blur_px: Array = field(repr=False)
    least_px: Array = field(repr=False)
    limit_px: float

    @property
    def astigmatic(self) -> NDArray[np.bool_]:
        """Field angles (n,) that no focus brings under the limit with a quarter to spare."""
        return SLACK * self.least_px > self.limit_px


def plan_bracket(sensor: Sensor, limit_px: float = 1.0, *, object_distance_mm: float = np.inf) -> Bracket:
    """The fewest focus distances that keep the worst blur under a limit.

    Where astigmatism does not allow that, with a quarter to spare, blur is kept within a quarter of the least possible.

    Parameters
    ----------
    sensor
        Its own focus does not matter.
    limit_px
        Largest blur diameter, tangential and sagittal.
    object_distance_mm
        From the mirror to the object.

    Returns
    -------
    Bracket
        Focus distances (k,) in mm, and the blur that they leave.

    Raises
    ------
    InvalidParameter
        For a limit out of range, or a decentred or tilted mirror.

    Examples
    --------
    >>> import omnimirror as om
    >>> plan = plan_bracket(om.load_sensor("paper-hyperboloidal"))
    >>> len(plan.focus_mm), round(float(plan.blur_px.max()), 2), plan.astigmatic.any()
    (10, 1.0, np.False_)
    """
    check_sensor(sensor)
    limit_px = number("limit_px", limit_px)
    if not 0.05 <= limit_px <= 1000:
        raise InvalidParameter(f"limit_px = {limit_px:g} is outside 0.05 to 1000 px")
    sensor.check("a focus bracket", "one mirror")
    omega = np.linspace(*sensor.field_deg, ANGLES)
    omega[-1] *= ROUNDED
    study = _study(sensor, np.radians(omega), _distance(object_distance_mm))
    candidates = _candidates(sensor, study)
    blur = np.stack([_worst(study, focus) for focus in candidates])  # (focus, angle)
    least = blur.min(axis=0)
    chosen = _stab(blur <= np.maximum(limit_px, SLACK * least))
    if len(chosen) > MOST_PICTURES:
        raise InvalidParameter(
            f"limit_px = {limit_px:g} would take {len(chosen)} pictures; up to {MOST_PICTURES} are valid"
        )
    return Bracket(candidates[chosen], omega, blur[chosen].min(axis=0), least, limit_px)


def _distance(object_distance_mm: float) -> float:
    distance = distances("object_distance_mm", object_distance_mm)
    if distance.ndim:
        raise InvalidParameter(f"object_distance_mm has shape {distance.shape}; it is valid as one number")
    return float(distance)


def _study(sensor: Sensor, omega: Array, object_distance_mm: float) -> FocusStudy:
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(omega))
    return FocusStudy(sensor, rays, virtual_images(rays, object_distance_mm), "exact", None, 550.0)


def _worst(study: FocusStudy, focus_mm: float) -> Array:
    blur = study.at(focus_mm)
    worst: Array = np.maximum(np.abs(blur.t_px), np.abs(blur.s_px))
    return worst


def _candidates(sensor: Sensor, study: FocusStudy) -> Array:
    """Focus distances between the nearest and the farthest image, evenly spaced in blur."""
    L = np.concatenate(study.distances)
    low, high = float(L.min()), float(L.max())
    if sensor.lens.TELECENTRIC:
        return np.linspace(low, high, FOCUSES)
    if not (np.isfinite(L).all() and low > sensor.lens.PARAMETERS["focus_distance_mm"].low):
        raise InvalidParameter(f"the virtual images of {sensor.name!r} lie where its lens cannot be focused")
    spaced: Array = 1 / np.linspace(1 / low, 1 / high, FOCUSES)
    return spaced


def _stab(serves: NDArray[np.bool_]) -> list[int]:
    """The fewest rows of (rows, columns) that serve every column, each column being served by neighbouring rows."""
    last = len(serves) - 1 - np.argmax(serves[::-1], axis=0)
    left = np.ones(serves.shape[1], bool)
    chosen: list[int] = []
    while left.any():
        chosen.append(int(last[left].min()))
        left &= ~serves[chosen[-1]]
    return chosen


def focused_at(sensor: Sensor, focus_mm: float) -> Sensor:
    """The same sensor focused elsewhere; where its lens focuses by its image distance, its picture grows or shrinks.

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> round(focused_at(sensor, 190.0).rim_radius_px / sensor.rim_radius_px, 4)
    1.0067
    """
    return replace(sensor, lens=sensor.lens.focused_at(focus_mm))


@checked
def merge_bracket(
    sensor: Sensor,
    pictures: Sequence[NDArray[Any]],
    *,
    focus_mm: ArrayLike,
    object_distance_mm: float = np.inf,
) -> NDArray[Any]:
    """One picture from several, each radius from those that are sharpest there.

    Parameters
    ----------
    sensor
        As whose picture the result comes out: at its focus, which sets the scale.
    pictures : k arrays (h, w) or (h, w, 3)
        All of the sensor's size, and of one kind.
    focus_mm : (k,)
        Where the pictures are focused, mm.
    object_distance_mm
        From the mirror to what is seen.

    Returns
    -------
    (h, w) or (h, w, 3) array
        Of the same kind.

    Raises
    ------
    InvalidParameter
        If pictures and focuses do not fit together or the sensor, or the mirror is decentred or tilted.

    Notes
    -----
    Focusing changes the image distance, and with it the scale: every picture is resampled (bicubic) to the scale
    of the sensor's own focus. A picture's weight falls off with its blur over that of the sharpest, smoothly.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> pictures = [np.full((1024, 1024), grey, np.uint8) for grey in (100, 100)]
    >>> merged = om.merge_bracket(om.load_sensor("paper-spherical"), pictures, focus_mm=[212.0, 228.0])
    >>> merged.shape, merged[512, 300]
    ((1024, 1024), np.uint8(100))
    """
    check_sensor(sensor)
    for picture in instance("pictures", pictures, Sequence, "a list of pictures"):
        instance("a picture", picture, np.ndarray, "an array of pixels")
    focuses = row("focus_mm", focus_mm)
    _check(sensor, pictures, focuses)
    offsets = offsets_from_axis(sensor)
    height, width = offsets.shape[:2]
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    radius = np.hypot(offsets[..., 0], offsets[..., 1])
    weights = picture_weights(sensor, focuses, radius, _distance(object_distance_mm))
    merged = np.zeros(pictures[0].shape, np.float32)
    for picture, focus, weight in zip(pictures, focuses, weights, strict=True):
        scale = focused_at(sensor, focus).rim_radius_px / sensor.rim_radius_px
        moved = remap(picture, PixelMap(pixels + (scale - 1) * offsets, (width, height)), "cubic")
        merged += moved * (weight if picture.ndim == 2 else weight[..., None]).astype(np.float32)
    if np.issubdtype(pictures[0].dtype, np.integer):
        merged = np.clip(np.rint(merged), 0, np.iinfo(pictures[0].dtype).max)
    result: NDArray[Any] = merged.astype(pictures[0].dtype)
    return result


def picture_weights(sensor: Sensor, focus_mm: Array, radius_px: Array, object_distance_mm: float = np.inf) -> Array:
    """Weights (k, ...) of pictures at distances (...) px from the optical axis; they add up to 1."""
    h = np.linspace(0, sensor.rim_radius_px * ROUNDED, ANGLES)
    rays = sensor.meridian.trace(sensor.x_from_height_px(h))
    study = FocusStudy(sensor, rays, virtual_images(rays, object_distance_mm), "exact", None, 550.0)
    blur = np.stack([_worst(study, float(focus)) for focus in focus_mm])
    weights = np.exp(-((blur - blur.min(axis=0)) / SOFTNESS_PX))
    weights /= weights.sum(axis=0)
    return np.stack([np.interp(radius_px, h, weight) for weight in weights])


def _check(sensor: Sensor, pictures: Sequence[NDArray[Any]], focuses: Array) -> None:
    if not pictures or len(pictures) != len(focuses):
        raise InvalidParameter(
            f"there are {len(pictures)} pictures and {len(focuses)} focus distances; give one for each"
        )
    width, height = sensor.image_size
    for picture in pictures:
        if picture.shape[:2] != (height, width):
            raise InvalidParameter(
                f"a picture has {picture.shape[1]} x {picture.shape[0]} px, and those of {sensor.name!r} have "
                f"{width} x {height}"
            )
        if picture.shape != pictures[0].shape or picture.dtype != pictures[0].dtype:
            raise InvalidParameter("the pictures differ in depth or channels; give pictures of one kind")
