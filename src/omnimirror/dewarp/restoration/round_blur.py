"""Radially symmetric blur: from the optics of a sensor, or specified for other cameras."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import numbers, shown
from ...base.errors import InvalidParameter, SpecError
from ...base.files import read_bytes
from ...base.typing import Array
from ...cameras.camera import Camera
from ...cameras.models import RadialModel
from ...optics.sensor import Sensor
from .blurring import BlurSize, blur_sizes, offsets_from_axis, whole_radius_px

ToldBlur: TypeAlias = ArrayLike | Callable[[Array], Any]

MOST_BLUR_PX = 30.0
MOST_BYTES = 10 << 20
TOLD_COLUMNS = ("radius_px", "omega_deg")


@dataclass(frozen=True, eq=False)
class RoundBlur:
    """Blur that is symmetric about the optical axis."""

    offsets: Array
    """Offsets (h, w, 2) px of the pixels from the axis, right and down."""
    whole_radius_px: float
    """Distance from the axis within which pixels receive all of their light from the mirror."""
    sizes: Callable[[Array], BlurSize]
    """Blur at distances (n,) px from the axis."""

    @property
    def radius(self) -> Array:
        """Distances (h, w) from the axis, px."""
        return np.asarray(np.hypot(self.offsets[..., 0], self.offsets[..., 1]))

    @property
    def by_pixel(self) -> BlurSize:
        """Blur of every pixel (h, w)."""
        radius = self.radius
        radii = np.arange(int(radius.max()) + 2, dtype=float)
        return BlurSize(*(np.interp(radius, radii, size) for size in self.sizes(radii)))

    def window(self, rows: slice, columns: slice) -> RoundBlur:
        """Return the blur of an image window."""
        return replace(self, offsets=self.offsets[rows, columns])

    def scaled(self, share: float) -> RoundBlur:
        """Return a fraction of the blur."""
        return replace(self, sizes=lambda radius: BlurSize(*(share * size for size in self.sizes(radius))))


def round_blur_of(
    camera: Camera,
    object_distance_mm: float = np.inf,
    told: ToldBlur | None = None,
    *,
    f_number: float | None = None,
    focus_mm: float | None = None,
) -> RoundBlur:
    """Return the blur of the images of a camera.

    Parameters
    ----------
    camera
        Sensor, whose blur follows from its optics, or any camera with a specified blur.
    object_distance_mm
        Object distance from the mirror of a sensor.
    told
        Blur diameters in px: one number, a pair (tangential, sagittal), a table (n, 3) of radius,
        tangential and sagittal diameters, or a function of radii (n,) that returns both.
    f_number, focus_mm
        Exposure settings that differ from those of the sensor. They reduce its blur and never
        increase it.

    Raises
    ------
    InvalidParameter
        If the blur is unknown, the table is invalid, or the mirror of a sensor is decentred or
        tilted.
    """
    if isinstance(camera, Sensor):
        offsets = offsets_from_axis(camera)
        if told is None:
            share = 1.0 if f_number is None else min(1.0, camera.lens.stop_number / f_number)

            def sizes(radius: Array) -> BlurSize:
                found = blur_sizes(camera, radius, object_distance_mm)
                if focus_mm is not None:
                    # Focusing changes the image scale: compared at equal fractions of the rim
                    # radius
                    focused = replace(camera, lens=camera.lens.focused_at(focus_mm))
                    scale = focused.rim_radius_px / camera.rim_radius_px
                    other = blur_sizes(focused, scale * radius, object_distance_mm)
                    found = BlurSize(*(np.minimum(*pair) for pair in zip(found, other, strict=True)))
                return BlurSize(*(share * size for size in found))

            return RoundBlur(offsets, whole_radius_px(camera), sizes)
        return _told(offsets, camera.rim_radius_px, told)
    if told is None:
        raise InvalidParameter(
            f"nothing is known of the blur of {type(camera).__name__}; tell it, or give a sensor with lens and mirror"
        )
    if not isinstance(camera, RadialModel):
        raise InvalidParameter(
            f"{type(camera).__name__} is no camera with an axis; valid are a Sensor and the camera models"
        )
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    offsets = (pixels - np.asarray(camera.centre_px)) @ np.linalg.inv(camera.stretch).T
    return _told(offsets, camera.field_radius_px, told)


def _told(offsets: Array, rim_px: float, told: ToldBlur) -> RoundBlur:
    sizes = _sizes_of(told)
    blur = float(sizes(np.array([rim_px])).larger[0])
    return RoundBlur(offsets, rim_px - 1.0 - blur / 2, sizes)


def _sizes_of(told: ToldBlur) -> Callable[[Array], BlurSize]:
    """Return the blur as a function of the radius, after validation."""
    if callable(told):
        function = told

        def sizes(radius: Array) -> BlurSize:
            found = function(radius)
            if not isinstance(found, Sequence | np.ndarray) or len(found) != 2:
                raise InvalidParameter(f"the function of the blur returns {shown(found)}; valid are two sizes")
            return _checked(BlurSize(*(np.broadcast_to(numbers("blur", size), radius.shape) for size in found)))

        return sizes
    table = numbers("blur", told, "one, two, or (n, 3)")
    if table.ndim < 2 and table.size in (1, 2):
        tangential, sagittal = np.broadcast_to(table.ravel(), 2)
        _checked(BlurSize(tangential, sagittal))
        return lambda radius: BlurSize(np.full(radius.shape, tangential), np.full(radius.shape, sagittal))
    if table.ndim != 2 or table.shape[1] != 3:
        raise InvalidParameter(f"a blur of shape {table.shape} is not valid; give one number, two, or a table (n, 3)")
    if not (len(table) and np.isfinite(table).all() and (np.diff(table[:, 0]) > 0).all()):
        raise InvalidParameter("the radii of the blur's table do not increase, or are no numbers")
    _checked(BlurSize(table[:, 1], table[:, 2]))
    return lambda radius: BlurSize(*(np.interp(radius, table[:, 0], column) for column in table.T[1:]))


def _checked(sizes: BlurSize) -> BlurSize:
    for size in sizes:
        wrong = ~((size >= 0) & (size <= MOST_BLUR_PX))
        if wrong.any():
            raise InvalidParameter(f"blur = {np.asarray(size)[wrong][0]:g} px is outside 0 to {MOST_BLUR_PX:g} px")
    return sizes


def load_blur(path: str | Path, camera: Camera) -> Array:
    """Read a blur table from a CSV file with the columns ``radius_px`` or ``omega_deg``, ``t_px``
    and ``s_px``.

    Returns
    -------
    (n, 3) array
        Radius, tangential and sagittal diameters in px, sorted by radius.

    Raises
    ------
    SpecError
        If the file cannot be read or lacks columns, or a field angle is outside the field.
    """
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
    except OSError as e:
        raise SpecError(f"cannot read the blur {path}: {e.strerror or e}") from None
    except UnicodeDecodeError:
        raise SpecError(f"cannot read the blur {path}: it is not a text file") from None
    lines = [line for line in csv.reader(text.splitlines()) if line and not line[0].lstrip().startswith("#")]
    names = [name.strip() for name in lines[0]] if lines else []
    where = next((name for name in TOLD_COLUMNS if name in names), None)
    if where is None or not {"t_px", "s_px"} <= set(names):
        raise SpecError(f"{path} has the columns {names}; the blur needs radius_px or omega_deg, t_px and s_px")
    try:
        rows = [[float(line[names.index(name)]) for name in (where, "t_px", "s_px")] for line in lines[1:]]
    except (ValueError, IndexError):
        raise SpecError(f"{path} holds a line that is not one number for each of {', '.join(names)}") from None
    table = np.array(rows).reshape(-1, 3)
    if where == "omega_deg":
        table[:, 0] = _radii_of(table[:, 0], camera, path)
    ordered: Array = table[np.argsort(table[:, 0])]
    return ordered


def _radii_of(omega_deg: Array, camera: Camera, path: str | Path) -> Array:
    symmetry = camera.symmetry
    if symmetry is None:
        raise SpecError(f"{path} tells the blur by the field angle, and the picture is not round; tell it by radius_px")
    omega = np.radians(omega_deg)
    outside = ~((omega >= symmetry.omega_min - 1e-9) & (omega <= symmetry.omega_max + 1e-9))
    if outside.any():
        low, high = np.degrees([symmetry.omega_min, symmetry.omega_max])
        raise SpecError(f"{path}: {omega_deg[outside][0]:g} deg is not seen; the field is {low:.4g} to {high:.4g} deg")
    return symmetry.radius_px(np.clip(omega, symmetry.omega_min, symmetry.omega_max))
