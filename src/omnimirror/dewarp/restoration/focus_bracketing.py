"""Focus bracketing: images at several focus distances, merged by radius to an image that is sharp
everywhere.

The blur of each field angle at each focus follows from its virtual images; no sharpness search in
the images is required. If tangential and sagittal image are far apart, no focus is sharp for both:
astigmatism is the limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.focus import FocusStudy, virtual_images
from ...base.arguments import distances, instance, number, row, validate_arguments
from ...base.errors import InvalidParameter
from ...base.results import Columns, FieldResult, Fields, column_fields
from ...base.typing import Array
from ...optics.sensor import Sensor, check_sensor
from ..maps import PixelMap
from ..sampling import remap
from .blur_model import offsets_from_axis

ANGLES, FOCUSES = 541, 1201
# Allowed ratio of the blur to its minimum over all focus distances if astigmatism dominates
SLACK = 1.25
SOFTNESS_PX = 0.25  # blur difference of the transition between images
MAX_BRACKET_IMAGES = 64
ROUNDED = 1 - 1e-9


@dataclass(frozen=True)
class Bracket(FieldResult):
    """Focus distances and the residual blur at n field angles.

    Attributes
    ----------
    focus_mm : (k,)
        Object distances in focus, near to far.
    omega_deg : (n,)
    blur_px : (n,)
        Larger of tangential and sagittal blur in the sharpest image.
    least_px : (n,)
        Minimum over all focus distances: about half of the astigmatism.
    limit_px
    """

    focus_mm: Array
    omega_deg: Array = field(repr=False)
    blur_px: Array = field(repr=False)
    least_px: Array = field(repr=False)
    limit_px: float

    def _table(self) -> Columns:
        names = ("omega_deg", "blur_px", "least_px")
        return {name: getattr(self, name) for name in names}

    def _fields(self) -> Fields:
        return column_fields(self._table(), {"focus_mm": self.focus_mm, "limit_px": self.limit_px})

    @property
    def astigmatic(self) -> NDArray[np.bool_]:
        """Field angles (n,) that no focus brings below the limit with a margin of 25 %."""
        return SLACK * self.least_px > self.limit_px


def plan_bracket(
    sensor: Sensor, limit_px: float = 1.0, *, object_distance_mm: float = np.inf
) -> Bracket:
    """Return the minimum number of focus distances that keep the maximum blur below a limit.

    If astigmatism does not permit this with a margin of 25 %, the blur is kept within 25 % of its
    minimum.

    Parameters
    ----------
    sensor
        Sensor; its own focus is irrelevant.
    limit_px
        Maximum blur diameter, tangential and sagittal.
    object_distance_mm
        Object distance from the mirror.

    Returns
    -------
    Bracket
        Focus distances (k,) in mm, and the residual blur.

    Raises
    ------
    InvalidParameter
        If the limit is out of range, or the mirror is decentred or tilted.

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
        raise InvalidParameter(f"limit_px must be between 0.05 and 1000 px; got {limit_px:g}")
    sensor.check("a focus bracket", "single mirror")
    omega = np.linspace(*sensor.field_deg, ANGLES)
    omega[-1] *= ROUNDED
    study = _study(sensor, np.radians(omega), _distance(object_distance_mm))
    candidates = _candidates(sensor, study)
    blur = np.stack([_worst(study, focus) for focus in candidates])  # (focus, angle)
    minimum = blur.min(axis=0)
    chosen = _stab(blur <= np.maximum(limit_px, SLACK * minimum))
    if len(chosen) > MAX_BRACKET_IMAGES:
        raise InvalidParameter(
            f"the focus bracket must have at most {MAX_BRACKET_IMAGES} images; got "
            f"{len(chosen)} with limit_px = {limit_px:g}"
        )
    return Bracket(candidates[chosen], omega, blur[chosen].min(axis=0), minimum, limit_px)


def _distance(object_distance_mm: float) -> float:
    distance = distances("object_distance_mm", object_distance_mm)
    if distance.ndim:
        raise InvalidParameter(f"object_distance_mm must be one number; got shape {distance.shape}")
    return float(distance)


def _study(sensor: Sensor, omega: Array, object_distance_mm: float) -> FocusStudy:
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(omega))
    return FocusStudy(sensor, rays, virtual_images(rays, object_distance_mm), "exact", None, 550.0)


def _worst(study: FocusStudy, focus_mm: float) -> Array:
    blur = study.at(focus_mm)
    worst: Array = np.maximum(np.abs(blur.t_px), np.abs(blur.s_px))
    return worst


def _candidates(sensor: Sensor, study: FocusStudy) -> Array:
    """Return focus distances between the nearest and the farthest image, uniformly spaced in blur."""
    L = np.concatenate(study.distances)
    low, high = float(L.min()), float(L.max())
    if sensor.lens.TELECENTRIC:
        return np.linspace(low, high, FOCUSES)
    if not (np.isfinite(L).all() and low > sensor.lens.PARAMETERS["focus_distance_mm"].low):
        raise InvalidParameter(
            f"the virtual images of {sensor.name!r} must be within the focus range of its "
            f"lens; got {low:.4g} to {high:.4g} mm"
        )
    spaced: Array = 1 / np.linspace(1 / low, 1 / high, FOCUSES)
    return spaced


def _stab(serves: NDArray[np.bool_]) -> list[int]:
    """Return the smallest set of rows of (rows, columns) that covers every column, each covered by
    adjacent rows.
    """
    last = len(serves) - 1 - np.argmax(serves[::-1], axis=0)
    is_uncovered = np.ones(serves.shape[1], bool)
    chosen: list[int] = []
    while is_uncovered.any():
        chosen.append(int(last[is_uncovered].min()))
        is_uncovered &= ~serves[chosen[-1]]
    return chosen


def focused_at(sensor: Sensor, focus_mm: float) -> Sensor:
    """Return the sensor at another focus distance; with focusing by image distance, the image scale
    changes.

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> round(focused_at(sensor, 190.0).rim_radius_px / sensor.rim_radius_px, 4)
    1.0067
    """
    return replace(sensor, lens=sensor.lens.focused_at(focus_mm))


@validate_arguments
def merge_bracket(
    sensor: Sensor,
    images: Sequence[NDArray[Any]],
    *,
    focus_mm: ArrayLike,
    object_distance_mm: float = np.inf,
) -> NDArray[Any]:
    """Merge several images into one, using at each radius the sharpest images.

    Parameters
    ----------
    sensor
        Sensor of the result: its focus defines the scale.
    images : k arrays (h, w) or (h, w, 3)
        Images of the size of the sensor and of one type.
    focus_mm : (k,)
        Focus distances of the images, mm.
    object_distance_mm
        Object distance from the mirror.

    Returns
    -------
    (h, w) or (h, w, 3) array
        Merged image of the same type.

    Raises
    ------
    InvalidParameter
        If images, focus distances and sensor are inconsistent, or the mirror is decentred or
        tilted.

    Notes
    -----
    Focusing changes the image distance and therefore the scale: every image is resampled (bicubic)
    to the scale of the sensor's own focus. The weight of an image decreases smoothly with its blur
    relative to the sharpest image.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> images = [np.full((1024, 1024), grey, np.uint8) for grey in (100, 100)]
    >>> merged = om.merge_bracket(om.load_sensor("paper-spherical"), images, focus_mm=[212.0, 228.0])
    >>> merged.shape, merged[512, 300]
    ((1024, 1024), np.uint8(100))
    """
    check_sensor(sensor)
    for image in instance("images", images, Sequence, "a list of images"):
        instance("an image", image, np.ndarray, "an array of pixels")
    focuses = row("focus_mm", focus_mm)
    _check(sensor, images, focuses)
    offsets = offsets_from_axis(sensor)
    height, width = offsets.shape[:2]
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    radius = np.hypot(offsets[..., 0], offsets[..., 1])
    weights = image_weights(sensor, focuses, radius, _distance(object_distance_mm))
    merged = np.zeros(images[0].shape, np.float32)
    for image, focus, weight in zip(images, focuses, weights, strict=True):
        scale = focused_at(sensor, focus).rim_radius_px / sensor.rim_radius_px
        moved = remap(image, PixelMap(pixels + (scale - 1) * offsets, (width, height)), "cubic")
        merged += moved * (weight if image.ndim == 2 else weight[..., None]).astype(np.float32)
    if np.issubdtype(images[0].dtype, np.integer):
        merged = np.clip(np.rint(merged), 0, np.iinfo(images[0].dtype).max)
    result: NDArray[Any] = merged.astype(images[0].dtype)
    return result


def image_weights(
    sensor: Sensor, focus_mm: Array, radius_px: Array, object_distance_mm: float = np.inf
) -> Array:
    """Return weights (k, ...) of images at distances (...) px from the optical axis, normalised to
    the sum 1.
    """
    h = np.linspace(0, sensor.rim_radius_px * ROUNDED, ANGLES)
    rays = sensor.meridian.trace(sensor.x_from_height_px(h))
    study = FocusStudy(sensor, rays, virtual_images(rays, object_distance_mm), "exact", None, 550.0)
    blur = np.stack([_worst(study, float(focus)) for focus in focus_mm])
    weights = np.exp(-((blur - blur.min(axis=0)) / SOFTNESS_PX))
    weights /= weights.sum(axis=0)
    return np.stack([np.interp(radius_px, h, weight) for weight in weights])


def _check(sensor: Sensor, images: Sequence[NDArray[Any]], focuses: Array) -> None:
    if not images or len(images) != len(focuses):
        raise InvalidParameter(
            f"focus_mm must have one distance per image; got {len(focuses)} distances for {len(images)} images"
        )
    width, height = sensor.image_size
    for image in images:
        if image.shape[:2] != (height, width):
            raise InvalidParameter(
                f"all images must have the {width} x {height} px of {sensor.name!r}; got "
                f"{image.shape[1]} x {image.shape[0]} px"
            )
        if image.shape != images[0].shape or image.dtype != images[0].dtype:
            raise InvalidParameter("all images must have the same type and number of channels")
