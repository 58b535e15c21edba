"""The mirrors of a sensor as parts that are made: one, or two where the lens sees the first in a second."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..housing import Housing
from ..lenses import GaussianLens
from ..mirrors import Mirror
from ..sensor import Sensor
from ..tracing.meridian import ROUNDING
from .body import Body, deepest_counterbore_mm

Array = NDArray[np.float64]

LENS_HEAD_MM = 14.0
"""Diameter of the head of an M12 lens, for which a counterbore has room unless it is said."""
BEFORE_LENS_MM = 2.0
"""How far before the lens's principal point its counterbore reaches, where there is wall."""


@dataclass(frozen=True)
class Part:
    """A mirror of a sensor and the solid behind it.

    A secondary has a frame of its own: its vertex is the origin, and z leads away from the lens, as does that of
    a mirror without one; so every file of it reads like that of any mirror.
    """

    sensor: Sensor
    body: Body
    is_secondary: bool = False

    @property
    def mirror(self) -> Mirror:
        return mirror_of(self.sensor, self.is_secondary)

    @property
    def name(self) -> str:
        return f"{self.sensor.name} secondary" if self.is_secondary else self.sensor.name


def parts_of(sensor: Sensor, body: Body | None = None, secondary_body: Body | None = None) -> list[Part]:
    """The first mirror, with the bore through which a camera behind it looks, and the second one if there is one.

    Bodies that are not given are those that the rims of the sensor's housing say.

    Raises
    ------
    InvalidParameter
        A bore that is narrower than the camera needs, or a body for a second mirror that is not there.

    Examples
    --------
    >>> import omnimirror as om
    >>> [(part.name, part.body.bore_mm) for part in parts_of(om.load_sensor("folded-spherical"), Body())]
    [('folded-spherical', 10.0), ('folded-spherical secondary', 0.0)]
    """
    body = body or Body.of(sensor.housing.rim, sensor.mirror)
    if sensor.secondary is None:
        if secondary_body is not None:
            raise InvalidParameter(f"{sensor.name!r} has no secondary; leave out the thickness of one")
        return [Part(sensor, body)]
    second = secondary_body or Body.of(sensor.housing.secondary_rim, sensor.secondary.mirror)
    return [Part(sensor, bored(sensor, body)), Part(sensor, second, is_secondary=True)]


def housed(parts: list[Part], housing: Housing | None = None) -> Sensor:
    """Return the sensor with the housing that is drawn, by default its own; the rims are those of the parts' bodies."""
    first, *second = parts
    housing = replace(housing or first.sensor.housing, rim=first.body.rim(first.mirror))
    if second:
        housing = replace(housing, secondary_rim=second[0].body.rim(second[0].mirror))
    return replace(first.sensor, housing=housing)


def bored(sensor: Sensor, body: Body) -> Body:
    """The body of the first mirror, pierced where the camera looks through it.

    Raises
    ------
    InvalidParameter
        The body has another bore, which does not go through or is narrower.
    """
    if sensor.secondary is None:
        return body
    lens = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    to_imager = 0.0 if sensor.lens.TELECENTRIC else cast(GaussianLens, sensor.lens).imager_mm
    if not lens + to_imager > 0:  # the camera stands before the mirror
        return body
    needed = 2 * sensor.secondary.bore_radius_mm
    if not body.bore_mm:
        return _counterbored(sensor, replace(body, bore_diameter_mm=needed, bore_depth_mm=np.inf), lens)
    if not body.bore_goes_through or body.bore_mm < needed:
        raise InvalidParameter(
            f"the camera of {sensor.name!r} looks through a bore of {needed:g} mm in its mirror; a bore is valid from "
            "that diameter and all the way through, or leave it out"
        )
    return body


def _counterbored(sensor: Sensor, body: Body, lens: float) -> Body:
    """The body with room for a lens that stands inside it at a height (mm), from a little before the lens backwards."""
    if body.counterbore_diameter_mm or not lens < body.back_mm(sensor.mirror):
        return body
    imager = sensor.imager
    diagonal = imager.pitch_mm * float(np.hypot(imager.width_px, imager.height_px))
    wide = replace(body, counterbore_diameter_mm=max(LENS_HEAD_MM, body.bore_mm + 2, diagonal + 2))
    depth = min(body.back_mm(sensor.mirror) - lens + BEFORE_LENS_MM, deepest_counterbore_mm(wide, sensor.mirror))
    fits = depth > 0 and wide.counterbore_diameter_mm / 2 < sensor.mirror.rim_radius_mm
    return replace(wide, counterbore_depth_mm=float(np.floor(100 * depth) / 100)) if fits else body


def mirror_of(sensor: Sensor, secondary: bool = False) -> Mirror:
    """The first mirror, or the second one."""
    if not secondary:
        return sensor.mirror
    if sensor.secondary is None:
        raise InvalidParameter(f"{sensor.name!r} has no secondary")
    return sensor.secondary.mirror


def omega_of(sensor: Sensor, x_mm: ArrayLike, secondary: bool = False) -> Array:
    """Field angles (n,) in radians that are seen by way of points of a mirror; NaN where nothing is.

    The middle of a folded sensor is hidden, and the secondary may be wider than it need be.
    """
    x, meridian = np.asarray(x_mm, dtype=float), sensor.meridian
    ends = meridian.trace(np.array([meridian.x_min, sensor.mirror.rim_radius_mm]))
    low, high = ends.first.x if secondary else ends.x
    seen = (x >= low * (1 - ROUNDING)) & (x <= high * (1 + ROUNDING))
    omega = np.full(x.shape, np.nan)
    inside = np.clip(x[seen], low, high)
    on_mirror = meridian.x_from_first(inside) if secondary else inside
    omega[seen] = meridian.trace(np.clip(on_mirror, *ends.x)).omega
    return omega
